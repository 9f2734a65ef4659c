"""The blocking client: a method for each call of the service."""

from __future__ import annotations

import collections.abc
import math
from typing import Any, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple, Union

import numpy as np

from .answers import Answer, Frame, Scan, with_warnings
from .calls import Calls
from .connections import Connections
from .errors import reading_answer
from .frame_order import AnswersInOrder, answers_in_order
from .records import Fields, records_of_arrays, records_of_objects
from .region import region_of
from .request_body import json_body, npz_body, without_none
from .request_types import (AnyFrameRequest, AnyHorizonsRequest, AnyIlluminationRequest, AnyLidarRequest, AnyLight,
                            AnyMapError, AnyMapRequest, AnyRegion, AnySkyRequest, Request)

# Texts of /v1/project by the number that stands for each in arrays.
REASONS = (None, "no dataset covers this place", "the datasets here have no valid post", "behind the camera",
           "beyond the lens's field of view", "seen by no row")
NO_OBJECT = 65535  # index of the object, in the arrays of /v1/rays, where a ray hits terrain


class Client:
    """Asks a selenograph service. Several threads may use one client; connections are persistent and shared.

    url        e.g. "http://127.0.0.1:8080"; https and a path in front of /v1 (of a proxy) work, too
    token      sent as `Authorization: Bearer TOKEN`; for a proxy that asks for it (deploy/operation). It also gets
               `Selenograph-Region`, the part of the Moon that a request is about, to choose a node by
    timeout_s  time limit of one call, all of its tries and waits together; the service is told, and gives up as well

    A busy service (429 or 503 with Retry-After) is asked again when it says so, a lost connection once: every call only
    reads. Errors: `Refused` for an answer that is one, `ConnectionError` where nothing answers, `TimeoutError`.
    """

    def __init__(self, url: str, token: Optional[str] = None, timeout_s: float = 60) -> None:
        self._connections = Connections(url, token, timeout_s)
        self._calls = Calls(self._connections)

    def __reduce__(self) -> Any:
        # For multiprocessing: the copy has connections of its own.
        return Client, (self.url, self._connections.token, self.timeout_s)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def url(self) -> str:
        """The service's address."""
        return self._connections.url

    @property
    def timeout_s(self) -> float:
        """Time limit of one call."""
        return self._connections.timeout_s

    @timeout_s.setter
    def timeout_s(self, timeout_s: float) -> None:
        self._connections.timeout_s = timeout_s

    def close(self) -> None:
        """Closes the connections. Calls in other threads get their answers."""
        self._connections.close()

    def frame(self, request: AnyFrameRequest) -> Frame:
        """Renders a frame: POST /v1/frames. The service's warnings become Python's, of the class FrameWarning."""
        return with_warnings(self._frame_without_warnings(request))

    def frames(self, requests: Iterable[AnyFrameRequest], in_flight: int = 2, ahead: int = 4) -> Iterator[Frame]:
        """Renders one frame after the other, and yields them in order.

        requests   any iterable. Request number i is taken from it when the loop comes back from frame i - in_flight,
                   not earlier: a generator may compute its requests from the frames so far
        in_flight  number of requests in flight, each on its own connection: the service renders while an answer
                   travels. 1 for a loop in which each request depends on the frame before it. With more, requests are
                   taken in other threads, and while the iterable waits (for a queue, say) frames are handed out
        ahead      number of poses, at most 64, that a request without "ahead" gets from the requests after it, so that
                   the service loads their terrain early. They are known where `requests` is a list or another sequence;
                   other iterables are not read ahead

        Neither changes a byte of any frame. An error ends the frames, in its place in the order.
        """
        # This method is no generator itself, so that wrong arguments are reported here, not at the first frame.
        return _frames_of(answers_in_order(requests, in_flight, ahead, self._frame_without_warnings))

    def encoded(self, request: Union[AnyFrameRequest, AnyMapRequest], media_type: str = "image/png") -> Answer:
        """Renders a frame, or the map of a request with "map", as a file: `answer.content` are its bytes.

        media_type: image/png (product "image" alone), image/tiff (one product; a GeoTIFF of a map), image/x-exr,
        application/x-npz, application/x-npy (one product).
        """
        return self._calls.post_encoded("/v1/maps" if "map" in request else "/v1/frames", request, media_type)

    def map(self, request: AnyMapRequest) -> Frame:
        """Renders products in a map projection: POST /v1/maps. `frame.meta["grid"]` has geotransform and WKT."""
        return with_warnings(Frame(self._calls.post_encoded("/v1/maps", request, "application/x-npz")))

    def horizons(self, request: AnyHorizonsRequest) -> Frame:
        """Finds elevations of the horizon, `elevation_deg` of azimuth and pixel or place: POST /v1/horizons."""
        return Frame(self._calls.post_encoded("/v1/horizons", request, "application/x-npz"))

    def illumination(self, request: AnyIlluminationRequest) -> Frame:
        """Finds the light of Sun and Earth over a time span: POST /v1/illumination.

        Statistics by pixel or place, sun_mean, earth_mean, longest_night_h, nights, longest_without_earth_h; and of
        places the shares `sun` and `earth` of epoch and place.
        """
        return Frame(self._calls.post_encoded("/v1/illumination", request, "application/x-npz"))

    def rays(self, origins_m: Any, directions: Any, sun: Optional[Request] = None,
             objects: Optional[Sequence[Request]] = None, detail: Optional[str] = None,
             light: Optional[AnyLight] = None, map_error: Optional[AnyMapError] = None) -> np.recarray:
        """Casts rays, as of an altimeter: POST /v1/rays.

        origins_m and directions are arrays of (..., 3), MOON_ME; one origin serves many directions and the other way
        round. light: `indirect` of a frame, and optionally `surface` and `band`. map_error: casts them against the map
        that a lander would carry, with these errors.

        Returns a record array of their shape without the 3: hit, range_m, position_m (x, y, z), normal (x, y, z),
        lit (NaN without `sun`), rock (the number that is its id in features(), there as f"{rock:016x}"; 0: none), and
        with `light` irradiance (direct, from terrain, from the Earth; W m-2; NaN on objects and rocks). Where nothing
        is hit, hit is False and the rest is NaN. `rays.range_m` is an array of all ranges. Warns as frame() does.
        """
        origins, towards = np.broadcast_arrays(np.asarray(origins_m, float), np.asarray(directions, float))
        if origins.ndim < 1 or origins.shape[-1] != 3:
            raise ValueError(f"origins_m and directions are arrays of (..., 3); together they are {origins.shape}")
        answers = self._calls.post_arrays(
            "/v1/rays", {"origin_m": origins.reshape(-1, 3), "direction": towards.reshape(-1, 3)},
            without_none(sun=sun, objects=objects, detail=detail, map_error=map_error) | (light or {}))
        fields: List[Tuple[Any, ...]] = [("hit", bool), ("range_m", float), ("position_m", float, 3),
                                         ("normal", float, 3), ("lit", float), ("rock", np.uint64)]
        if light:
            fields.append(("irradiance", float, 3))
        if objects:
            fields.append(("object", object))  # index into objects; None: terrain
            answers["object"] = [None if i == NO_OBJECT else int(i) for i in answers.get("object", ())]
        return records_of_arrays(answers, fields, origins.shape[:-1])

    def project(self, camera: Request, pose: Optional[Request], points: Any, sun: Optional[Request] = None,
                objects: Optional[Sequence[Request]] = None, shutter: Optional[Request] = None,
                detail: Optional[str] = None, light: Optional[AnyLight] = None) -> np.recarray:
        """Projects landmarks into an image: POST /v1/project.

        points is an array of (..., 3): lat_deg, lon_deg, height_m; or of (..., 2), or with NaN heights: on the terrain;
        or a list of dicts as in the service's JSON. light: see rays(); irradiance is that of the ground.

        Returns a record array: x_px, y_px, range_m, height_m, in_frame, visible, lit (NaN without `sun`), reason (None,
        or a text that says why there is no pixel), and with a shutter time_s. Warns as frame() does.
        """
        landmarks = _landmarks(points)
        rows = landmarks.reshape(-1, landmarks.shape[-1])
        if np.isnan(rows[:, :2]).any():
            raise ValueError("points have NaN in lat_deg or lon_deg; only height_m may be left open so")
        common = without_none(camera=camera, pose=pose, sun=sun, objects=objects, shutter=shutter, detail=detail)
        answers = self._calls.post_arrays("/v1/project", {"points": rows}, common | (light or {}))
        with reading_answer():
            answers["reason"] = [REASONS[i] for i in answers.get("reason", ())]
        fields: List[Tuple[Any, ...]] = [("x_px", float), ("y_px", float), ("range_m", float), ("height_m", float),
                                         ("in_frame", bool), ("visible", bool), ("lit", float), ("reason", object)]
        if shutter:
            fields.append(("time_s", float))
        if light:
            fields.append(("irradiance", float, 3))
        return records_of_arrays(answers, fields, landmarks.shape[:-1])

    def lidar(self, request: AnyLidarRequest, directions: Any = None, times_s: Any = None) -> Scan:
        """Scans with a lidar: POST /v1/lidar.

        request     its JSON: "instrument" or "instrument_preset", "pose", "motion", "pattern", "seed", ...
        directions  (..., 3), camera axes: pulses in place of "pattern"
        times_s     times of the pulses with `directions`: one for each, or one for all

        Returns a mapping of arrays: range_m (of the strongest detection; NaN: none), first_m, last_m, intensity, count,
        velocity_m_s; the ground truth true_range_m, true_width_m, true_intensity, axis_range_m, false_alarm, rock,
        object; and direction, origin_m, time_s. They have the shape of `directions`, or the rows and columns of a
        pattern that is an image. `scan.meta` has the resolved request.
        """
        shape = None
        if directions is None:
            body = json_body(request)
        else:
            rows = np.asarray(directions, float)
            if rows.ndim < 1 or rows.shape[-1] != 3:
                raise ValueError(f"directions is an array of (..., 3); it is {rows.shape}")
            shape = rows.shape[:-1]
            arrays = {"direction": rows.reshape(-1, 3)}
            if times_s is not None:
                arrays["time_s"] = np.broadcast_to(np.asarray(times_s, float), shape).reshape(-1)
            body = npz_body(request, arrays)
        answer = self._connections.call("POST", "/v1/lidar", body, "application/x-npz", region_of(request))
        return Scan(answer.content, shape)

    def heights(self, lat_deg: Any, lon_deg: Any, detail: Optional[str] = None,
                map_error: Optional[AnyMapError] = None) -> np.recarray:
        """Returns heights of the terrain at numbers or arrays: POST /v1/heights. map_error: see rays().

        The record array has their shape: height_m (above the sphere of 1 737 400 m; NaN where there is no data),
        post_spacing_m, source (name of the DEM tile), filled, blended (a mean of two layers), reason (why there is no
        height), lat_deg, lon_deg.
        """
        lats, lons = np.broadcast_arrays(np.asarray(lat_deg, float), np.asarray(lon_deg, float))
        points = [{"lat_deg": lat, "lon_deg": lon} for lat, lon in zip(lats.ravel().tolist(), lons.ravel().tolist())]
        answers = self._calls.post_list("/v1/heights", "points", points,
                                        without_none(detail=detail, map_error=map_error))
        fields = [("lat_deg", float), ("lon_deg", float), ("height_m", float), ("post_spacing_m", float),
                  ("source", object), ("filled", bool), ("blended", bool), ("reason", object)]
        return records_of_objects(answers, fields, lats.shape)

    def features(self, detail: str, region: AnyRegion, kind: str = "craters", smallest_m: Optional[float] = None,
                 min_depth_over_diameter: Optional[float] = None) -> np.recarray:
        """Returns craters or rocks ("rocks") of a detail, ground truth for detectors: POST /v1/features.

        region                   south_deg, north_deg, west_deg and east_deg of their centres
        min_depth_over_diameter  of craters: left out, 0.02; 0 gives all

        The record array begins with the largest: id, lat_deg, lon_deg, height_m, diameter_m, age_Ma, and for craters
        depth_m, depth_over_diameter, visibility, rim_share and brightness.
        """
        document = without_none(detail=detail, region=region, kind=kind, smallest_m=smallest_m,
                                min_depth_over_diameter=min_depth_over_diameter)
        found = self._calls.post_objects("/v1/features", document, kind)
        fields = [("id", object), ("lat_deg", float), ("lon_deg", float), ("height_m", float), ("diameter_m", float),
                  ("age_Ma", float)]
        if kind == "craters":
            fields += [("depth_m", float), ("depth_over_diameter", float), ("visibility", float), ("rim_share", float),
                       ("brightness", float)]
        return records_of_objects(found, fields, (len(found),))

    def sky(self, request: AnySkyRequest) -> np.recarray:
        """Returns stars, Sun, Earth and planets in a camera's view: POST /v1/sky.

        request has camera, pose, utc or et_s, and sky; band and sensor for electrons. The record array begins with the
        stars, the brightest of them first: kind, id, x_px, y_px, in_frame, visible, hidden_by, direction_icrf,
        direction (MOON_ME), direction_camera, magnitude, irradiance_w_m2, electrons, distance_m, phase_deg,
        angular_radius_deg. Numbers that do not exist are NaN.
        """
        found = self._calls.post_objects("/v1/sky", request, "objects")
        fields = [("kind", object), ("id", object), ("x_px", float), ("y_px", float), ("in_frame", bool),
                  ("visible", bool), ("hidden_by", object), ("direction_icrf", float, 3), ("direction", float, 3),
                  ("direction_camera", float, 3), ("magnitude", float), ("irradiance_w_m2", float),
                  ("electrons", float), ("distance_m", float), ("phase_deg", float), ("angular_radius_deg", float)]
        return records_of_objects(found, fields, (len(found),))

    def limb(self, camera: Request, pose: Request, points: int = 360, detail: Optional[str] = None) -> np.recarray:
        """Returns the Moon's limb in an image, of its terrain and of a sphere: POST /v1/limb.

        The record array has `points` azimuths: azimuth_deg, angle_deg, x_px, y_px, in_frame, position_m, lat_deg,
        lon_deg, height_m, range_m, sphere_angle_deg, sphere_x_px, sphere_y_px, difference_px. Numbers that do not exist
        are NaN.
        """
        fields = [("angle_deg", float), ("range_m", float), ("sphere_angle_deg", float), ("difference_px", float)]
        return self._outline("points", fields, camera=camera, pose=pose, points=points, detail=detail)

    def terminator(self, camera: Request, pose: Request, sun: Request, points: int = 360,
                   detail: Optional[str] = None) -> np.recarray:
        """Returns the Moon's terminator in an image, of its terrain and of a sphere: POST /v1/limb with a Sun.

        The record array has `points` azimuths around the direction to the Sun: azimuth_deg, x_px, y_px, in_frame,
        visible, position_m, lat_deg, lon_deg, height_m, sphere_x_px, sphere_y_px, sphere_visible.
        """
        fields = [("visible", bool), ("sphere_visible", bool)]
        return self._outline("terminator", fields, camera=camera, pose=pose, sun=sun, points=points, detail=detail)

    def datasets(self) -> Dict[str, Any]:
        """Returns the catalogue: GET /v1/datasets.

        "datasets" is a list of tiles (name, footprint, post_spacing_m, ...), "problems" a list of files that could not
        be used.
        """
        return self._calls.document("/v1/datasets")

    def document(self, path: str, request: Optional[Request] = None) -> Dict[str, Any]:
        """Returns the JSON of any other call: a GET or, with a request, a POST.

        document("/v1/verify/roundtrip", {...}), or document(path) of the "metadata_at" in a header Selenograph-Meta.
        """
        return self._calls.document(path, request)

    def _frame_without_warnings(self, request: AnyFrameRequest) -> Frame:
        return Frame(self.encoded(request, "application/x-npz"))

    def _outline(self, name: str, own_fields: Fields, **request: Any) -> np.recarray:
        """Returns the list `name` of /v1/limb, whose fields follow those of both outlines."""
        found = self._calls.post_objects("/v1/limb", without_none(**request), name)
        fields = [("azimuth_deg", float), ("x_px", float), ("y_px", float), ("in_frame", bool),
                  ("position_m", float, 3), ("lat_deg", float), ("lon_deg", float), ("height_m", float),
                  ("sphere_x_px", float), ("sphere_y_px", float), *own_fields]
        return records_of_objects(found, fields, (len(found),))


def _landmarks(points: Any) -> np.ndarray:
    """Returns the points of project() as an array of (..., 2) or (..., 3)."""
    if isinstance(points, collections.abc.Sequence) and any(isinstance(p, collections.abc.Mapping) for p in points):
        unknown = {repr(member) for p in points for member in p} - {"'lat_deg'", "'lon_deg'", "'height_m'"}
        if unknown:
            raise ValueError(f"points have lat_deg, lon_deg and height_m, not {', '.join(sorted(unknown))}")
        points = [[p["lat_deg"], p["lon_deg"], p.get("height_m", math.nan)] for p in points]
    landmarks = np.asarray(points, float)
    if landmarks.ndim < 1 or landmarks.shape[-1] not in (2, 3):
        raise ValueError(f"points is an array of (..., 2) or (..., 3), lat_deg, lon_deg, height_m; it is "
                         f"{landmarks.shape}")
    return landmarks


def _frames_of(answers: AnswersInOrder) -> Iterator[Frame]:
    """Yields the frames and warns of their warnings. Leaving the loop early stops the requests."""
    try:
        for frame in answers:
            yield with_warnings(frame)
    finally:
        answers.stop()
