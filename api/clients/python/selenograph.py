"""Client of selenograph, the service that renders camera frames of the Moon.

    import selenograph
    from selenograph import Camera, Client, Pose, Sun

    with Client("http://127.0.0.1:8080") as moon:
        frame = moon.frame({
            "camera": Camera.pinhole(width=1024, height=1024, fov_deg=50),
            "pose": Pose.nadir(lat_deg=-6.5, lon_deg=40.0, height_m=30000),
            "sun": Sun.local(lat_deg=-6.5, lon_deg=40.0, azimuth_deg=90, elevation_deg=15),
            "products": ["radiance", "range"],
        })
    print(frame["radiance"].max(), frame.meta["lod_error_px"], frame.timing["visibility"])

A request is the JSON of POST /v1/frames as a dict; `Camera`, `Pose` and `Sun` are dicts that make its parts. Units and
frames: metres, degrees, MOON_ME, camera axes as in OpenCV (+x right, +y down, +z boresight), pixel (0, 0) is the centre
of the top-left one. conventions.md, one folder up, has a drawing.

This file is the whole client: it can be copied beside a script. It needs Python 3.9 and NumPy. As a program:

    python3 -m selenograph render request.json frame.npz
    python3 -m selenograph watch trajectory.csv --out frames
"""

from __future__ import annotations

import argparse
import asyncio
import collections.abc
import concurrent.futures
import contextlib
import csv
import dataclasses
import datetime
import email.utils
import functools
import http.client
import io
import json
import math
import os
import re
import socket
import ssl
import struct
import sys
import threading
import time
import urllib.parse
import warnings
import zipfile
import zlib
from typing import (Any, AsyncIterable, AsyncIterator, Callable, Dict, Iterable, Iterator, List, Mapping, Optional,
                    Sequence, Tuple, Union)

import numpy as np

__version__ = "0.1.0"
__all__ = ["Answer", "AsyncClient", "Camera", "Client", "Frame", "FrameWarning", "Pose", "Refused", "Scan", "Sun",
           "Trajectory", "random_views"]

Request = Mapping[str, Any]
Vector = Union[Sequence[float], np.ndarray]

MOON_RADIUS_M = 1737400.0  # heights are above this sphere
INERTIAL = ("ICRF", "J2000")  # frames whose poses need an epoch
MOST_AHEAD = 64  # of a request's "ahead"
# Rays or points of one request. Each answer depends on its own ray alone, so that long lists may be sent in pieces: the
# service's default limits are 100 000 rays, and 4 MiB of text, which is less.
POINTS_AT_ONCE = 10000
ROWS_AT_ONCE = 65536  # the same of arrays
# Of landmarks, by their number in arrays.
REASONS = (None, "no dataset covers this place", "the datasets here have no valid post", "behind the camera",
           "beyond the lens's field of view", "seen by no row")


# --- What comes back


class Refused(Exception):
    """The service's answer was an error.

    status   HTTP status: 422 for a request that is impossible, 503 for a busy service, ...
    problem  the problem document (RFC 9457) as a dict: "type", "title", "detail", and "errors", a list of
             {"pointer": ..., "detail": ...} with a JSON Pointer to each member at fault; empty if the answer had none
    """

    def __init__(self, status: int, problem: Dict[str, Any], text: str = "") -> None:
        self.status = status
        self.problem = problem
        self._text = text  # what came instead of a problem document
        errors = problem.get("errors") or []
        lines = [f"{status} {problem.get('title') or http.client.responses.get(status, 'unknown status')}"]
        if problem.get("detail") and len(errors) != 1:  # else it is the same as the only error's
            lines[0] += f": {problem['detail']}"
        elif text and not problem:
            lines[0] += f": {text}"
        lines += [f"  {error.get('pointer') or 'the body'}: {error.get('detail')}" for error in errors]
        super().__init__("\n".join(lines))

    def __reduce__(self) -> Any:  # for pickle: an exception's own way knows the message only
        return Refused, (self.status, self.problem, self._text)

    @property
    def pointers(self) -> List[str]:
        """JSON Pointers of the members at fault."""
        return [error["pointer"] for error in self.problem.get("errors") or [] if "pointer" in error]


class FrameWarning(UserWarning):
    """What the service warns of with a frame, a map, rays or landmarks: it is probably not what was meant."""


@contextlib.contextmanager
def _reading() -> Iterator[None]:
    """Around, or as a decorator of, what reads an answer: one that can't be read is of something else than selenograph,
    or was cut off where nobody could tell."""
    try:
        yield
    except (ArithmeticError, AttributeError, EOFError, LookupError, RuntimeError, TypeError, ValueError, struct.error,
            zipfile.BadZipFile, zlib.error) as error:
        raise ConnectionError(f"the answer cannot be read as selenograph's: {error!r}") from error


@dataclasses.dataclass(frozen=True)
class Answer:
    """A frame or map as the service sent it, and what its headers say."""

    content: bytes
    media_type: str
    timing: Dict[str, float]  # stage -> milliseconds
    etag: Optional[str]  # as in the header, with its quotes; None for a frame with an unusable DEM file
    echo: Optional[Dict[str, Any]]  # the request's "echo"
    headers: http.client.HTTPMessage


class Frame(Mapping[str, np.ndarray]):
    """The products of a frame or map: `frame["radiance"]` is a NumPy array, row 0 on top.

    meta      metadata: the resolved request, the DEM tiles used, bounds on errors, warnings, content hash
    timing    stage -> milliseconds, from the header Server-Timing; "total" is the whole request
    etag      the header ETag, with its quotes; None for a frame whose bytes must not be kept
    echo      the request's "echo", from the header Selenograph-Echo; None without
    warnings  those of the metadata: texts, empty for a frame that is in order; with several cameras each begins with
              its camera's name
    labels    annotations of a request with "labels": "coco", the document that the numbers in crater_mask and rock_mask
              are of; with several cameras NAME/coco
    """

    @_reading()
    def __init__(self, answer: Answer) -> None:
        self._arrays, texts = _read_npz(answer.content)
        self.meta: Dict[str, Any] = texts.pop("meta", {})
        self.labels: Dict[str, Any] = texts
        self.timing = answer.timing
        self.etag = answer.etag
        self.echo = answer.echo
        self.warnings: List[str] = list(self.meta.get("warnings") or [])
        for name, camera in self.meta.get("cameras", {}).items():
            self.warnings += [f"{name}: {text}" for text in camera.get("warnings") or []]

    def __getitem__(self, product: str) -> np.ndarray:
        try:
            return self._arrays[product]
        except KeyError:
            raise KeyError(f"{product!r}: the frame has {', '.join(self._arrays)}; name it in the request's "
                           "\"products\"") from None

    def __contains__(self, product: object) -> bool:
        return product in self._arrays

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __repr__(self) -> str:
        products = ", ".join(f"{name}: {a.dtype} {'x'.join(map(str, a.shape))}" for name, a in self._arrays.items())
        return f"<selenograph.Frame {products}>"


def _read_npz(content: bytes) -> Tuple[Dict[str, np.ndarray], Dict[str, Any]]:
    """Arrays and JSON texts by their names in the archive: "range", "meta"."""
    # Members are stored, not deflated. numpy.load would check their sums, which takes as long as a frame does.
    arrays: Dict[str, np.ndarray] = {}
    texts: Dict[str, Any] = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for info in archive.infolist():
            if info.compress_type == zipfile.ZIP_STORED:
                name_size, extra_size = struct.unpack_from("<HH", content, info.header_offset + 26)
                start = info.header_offset + 30 + name_size + extra_size
                member = memoryview(content)[start:start + info.file_size]
            else:
                member = memoryview(archive.read(info))
            name, suffix = os.path.splitext(info.filename)
            if suffix == ".json":
                texts[name] = json.loads(bytes(member))
            elif suffix == ".npy":
                arrays[name] = _read_npy(member)
    return arrays, texts


def _read_npy(member: memoryview) -> np.ndarray:
    head = io.BytesIO(member[:4096])
    if np.lib.format.read_magic(head) != (1, 0):
        return np.load(io.BytesIO(member), allow_pickle=False)
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(head)
    values = np.frombuffer(member, dtype, count=int(np.prod(shape)), offset=head.tell())
    # A copy: aligned, writable, and not holding on to the other products.
    return values.reshape(shape, order="F" if fortran else "C").copy()


class Scan(Mapping[str, np.ndarray]):
    """A lidar's scan: `scan["range_m"]` is a NumPy array. Its metadata is `meta`."""

    @_reading()
    def __init__(self, content: bytes, shape: Optional[Tuple[int, ...]] = None) -> None:
        arrays, texts = _read_npz(content)
        self.meta: Dict[str, Any] = texts.get("meta", {})
        self.shape = tuple(self.meta["shape"]) if shape is None else shape
        self._arrays = {name: a.reshape(self.shape + a.shape[1:]) for name, a in arrays.items()}

    def points_m(self, ranges: str = "range_m") -> np.ndarray:
        """Where the beams' axes are at these ranges, MOON_ME: measured (range_m, first_m, last_m) or true."""
        return self["origin_m"] + self[ranges][..., None] * self["direction"]

    def __getitem__(self, name: str) -> np.ndarray:
        return self._arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __repr__(self) -> str:
        return f"<selenograph.Scan {'x'.join(map(str, self.shape))}: {', '.join(self._arrays)}>"


# --- What is sent


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays, and paths, as JSON has them."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, collections.abc.Mapping):
        return dict(value)
    if isinstance(value, (datetime.datetime, os.PathLike)):
        return _utc_text(value) if isinstance(value, datetime.datetime) else os.fspath(value)
    raise TypeError(f"{type(value).__name__} cannot be part of a request: {value!r}")


def _not_finite(value: Any, pointer: str = "") -> Optional[str]:
    """JSON Pointer of the first number that JSON doesn't have."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, float):
        return None if math.isfinite(value) else f"{pointer} is {value}"
    items: Iterable[Tuple[Any, Any]] = ()
    if isinstance(value, collections.abc.Mapping):
        items = value.items()
    elif isinstance(value, (list, tuple)):
        items = enumerate(value)
    return next(filter(None, (_not_finite(v, f"{pointer}/{k}") for k, v in items)), None)


def _body(document: Any) -> bytes:
    if not isinstance(document, collections.abc.Mapping):
        raise TypeError(f"a request is a dict, not {type(document).__name__}; json.loads makes one of a text")
    try:
        return json.dumps(document, default=_plain, allow_nan=False, separators=(",", ":")).encode()
    except ValueError:
        where = _not_finite(document)
        if where is None:
            raise
        raise ValueError(f"a request holds finite numbers only: {where}") from None


def _npz_body(document: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """A request with arrays in the place of lists."""
    file = io.BytesIO()
    np.savez(file, request=_body(document).decode(), **arrays)
    return file.getvalue()


REGION_DEG = 4.0  # height of the cells of _region()


def _region(document: Any) -> Optional[str]:
    """The header Selenograph-Region: the cell of about 120 km that a request is about, by which a proxy in front of
    several nodes sends neighbouring views to the node that has their terrain in memory. None where that isn't plain;
    what is wrong with the request is for the service to say."""
    try:
        lat_deg, lon_deg = _about(document)
        row = min(math.floor((lat_deg + 90) / REGION_DEG), round(180 / REGION_DEG) - 1)
        middle = math.radians((row + 0.5) * REGION_DEG - 90)
        columns = max(1, round(360 / REGION_DEG * math.cos(middle)))
        return f"{row}-{math.floor(lon_deg % 360 / 360 * columns) % columns}" if row >= 0 else None
    except (ArithmeticError, AttributeError, IndexError, LookupError, TypeError, ValueError):
        return None


def _about(document: Any) -> Tuple[float, float]:
    """Latitude and longitude. KeyError and the like where there are none."""
    pose = document.get("pose")
    if pose is None and document.get("cameras"):
        pose = next(iter(document["cameras"].values()))["pose"]
    if pose is not None:
        if "geodetic" in pose:
            return _degrees(pose["geodetic"])
        if "position_m" in pose and pose.get("frame") not in INERTIAL:  # in which the Moon turns
            return _below(pose["position_m"])
        return _degrees(pose["look_at"])
    if "map" in document:
        return _degrees(document["map"]["center"])
    return _below(document["rays"][0]["origin_m"]) if "rays" in document else _degrees(document["points"][0])


def _degrees(place: Mapping[str, Any]) -> Tuple[float, float]:
    return float(place["lat_deg"]), float(place["lon_deg"])


def _below(position_m: Any) -> Tuple[float, float]:
    x, y, z = (float(c) for c in position_m)
    return math.degrees(math.atan2(z, math.hypot(x, y))), math.degrees(math.atan2(y, x))


def _timing(header: Optional[str]) -> Dict[str, float]:
    # A proxy may add what it likes; what is no number is left out.
    found = re.findall(r"([^\s;,]+)\s*;(?:[^,]*;)?\s*dur=(\d+\.?\d*(?:[eE][+-]?\d+)?)(?![^\s;,])", header or "")
    return {name: float(duration) for name, duration in found}


# --- Connections


class Client:
    """Asks a selenograph service. May be used by several threads; connections are kept and shared.

    url        e.g. "http://127.0.0.1:8080"; https and a path in front of /v1 (of a proxy) work, too
    token      sent as `Authorization: Bearer TOKEN`; for a proxy that asks for it (deploy/operation). It also gets
               `Selenograph-Region`, the part of the Moon that a request is about, to choose a node by
    timeout_s  for one call, all of its tries and waits together; the service is told, and gives up as well

    A busy service (429 or 503 with Retry-After) is asked again when it says so, a lost connection once: every call only
    reads. Errors: `Refused` for an answer that is one, `ConnectionError` where nothing answers, `TimeoutError`.
    """

    def __init__(self, url: str, token: Optional[str] = None, timeout_s: float = 60) -> None:
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f"{url!r} is no address; write for example http://127.0.0.1:8080")
        if parts.username is not None or parts.query or parts.fragment:
            raise ValueError("an address has neither a user nor a query; a proxy that asks for one gets token=")
        if not 0 < timeout_s <= 1e6:  # sockets know no more than 24 days
            raise ValueError(f"timeout_s is {timeout_s!r}; seconds above 0, and up to 1e6, are needed")
        self.url = url.rstrip("/")
        self.timeout_s = float(timeout_s)
        self._host, self._port, self._prefix = parts.hostname, parts.port, parts.path.rstrip("/")
        self._tls = ssl.create_default_context() if parts.scheme == "https" else None
        self._token = token
        self._headers = {"User-Agent": f"selenograph-python/{__version__}"}
        if token is not None:
            self._headers["Authorization"] = f"Bearer {token}"
        self._idle: List[http.client.HTTPConnection] = []
        self._lock = threading.Lock()
        self._process = os.getpid()
        self._closed = False

    def __reduce__(self) -> Any:  # for multiprocessing: the same, with connections of its own
        return Client, (self.url, self._token, self.timeout_s)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        for connection in getattr(self, "_idle", ()):
            connection.close()

    def close(self) -> None:
        """Closes the connections. Calls in other threads get their answers."""
        self._closed = True
        self._drop_idle()

    # Frames

    def frame(self, request: Request) -> Frame:
        """Renders a frame: POST /v1/frames. The service's warnings are Python's, of the class FrameWarning."""
        return _warned(Frame(self.encoded(request, "application/x-npz")))

    def frames(self, requests: Iterable[Request], in_flight: int = 2, ahead: int = 4) -> Iterator[Frame]:
        """Renders frames one after the other, and yields them in order.

        requests   any iterable. Request number i is taken from it when the loop comes back from frame i - in_flight,
                   not earlier: a generator may compute its requests from the frames so far
        in_flight  requests under way at a time, each on a connection of its own: the service renders while an answer
                   travels. 1 for a loop in which each request depends on the frame before it. With more, requests are
                   taken in other threads, and while the iterable waits (for a queue, say) frames are handed out
        ahead      a request without "ahead" gets the poses of so many requests behind it (at most 64), so that the
                   service loads their terrain early. They are known where `requests` is a list or another sequence;
                   of others nothing is taken for this, and the service takes the camera to go on as it did

        Neither changes a byte of any frame. An error ends the frames, in its place in the order.
        """
        # Not itself a generator: wrong arguments are told here, not at the first frame.
        return _handed_out(self._in_order(requests, in_flight, ahead,
                                          lambda request: Frame(self.encoded(request, "application/x-npz"))))

    def encoded(self, request: Request, media_type: str = "image/png") -> Answer:
        """A frame as a file: image/png (product "image" alone), image/tiff (one product), image/x-exr,
        application/x-npz, application/x-npy (one product). `answer.content` are its bytes. Of a request with "map" the
        map: image/tiff is a GeoTIFF."""
        return self._post("/v1/maps" if "map" in request else "/v1/frames", request, media_type)

    def map(self, request: Request) -> Frame:
        """Products in a map projection: POST /v1/maps. `frame.meta["grid"]` has geotransform and WKT."""
        return _warned(Frame(self._post("/v1/maps", request, "application/x-npz")))

    # Points

    def rays(self, origins_m: Any, directions: Any, sun: Optional[Request] = None,
             objects: Optional[Sequence[Request]] = None, detail: Optional[str] = None,
             light: Optional[Request] = None) -> np.recarray:
        """Casts rays: POST /v1/rays, an altimeter or lidar.

        origins_m and directions are arrays of (..., 3), MOON_ME; one origin serves many directions and the other way
        round. Gives a record array of their shape without the 3: hit, range_m, position_m (x, y, z), normal (x, y, z),
        lit (NaN without `sun`), rock (the number that is its id in features(), there as f"{rock:016x}"; 0: none). Where
        nothing is hit, hit is False and the rest is NaN. `rays.range_m` is an array of all ranges. light: `indirect` of
        a frame, and `surface` and `band` if you like; it adds irradiance (direct, from terrain, from the Earth; W m-2;
        NaN on objects and rocks). Warns as frame() does.
        """
        origins, towards = np.broadcast_arrays(np.asarray(origins_m, float), np.asarray(directions, float))
        if origins.ndim < 1 or origins.shape[-1] != 3:
            raise ValueError(f"origins_m and directions are arrays of (..., 3); together they are {origins.shape}")
        answers = self._arrays_in_pieces(
            "/v1/rays", {"origin_m": origins.reshape(-1, 3), "direction": towards.reshape(-1, 3)},
            _given(sun=sun, objects=objects, detail=detail) | (light or {}))
        fields = [("hit", bool), ("range_m", float), ("position_m", float, 3), ("normal", float, 3), ("lit", float),
                  ("rock", np.uint64)]
        if light:
            fields.append(("irradiance", float, 3))
        if objects:
            fields.append(("object", object))  # index into objects; None: terrain
            answers["object"] = [None if i == 65535 else int(i) for i in answers.get("object", ())]
        return _recarray(answers, fields, origins.shape[:-1])

    def project(self, camera: Request, pose: Optional[Request], points: Any, sun: Optional[Request] = None,
                objects: Optional[Sequence[Request]] = None, shutter: Optional[Request] = None,
                detail: Optional[str] = None, light: Optional[Request] = None) -> np.recarray:
        """Where landmarks appear: POST /v1/project.

        points is an array of (..., 3): lat_deg, lon_deg, height_m; or of (..., 2), or with NaN heights: on the terrain;
        or a list of dicts as in the service's JSON. Gives a record array: x_px, y_px, range_m, height_m, in_frame,
        visible, lit (NaN without `sun`), reason (None, or a text that says why there is no pixel), and with a shutter
        time_s. light: see rays(); irradiance is that of the ground. Warns as frame() does.
        """
        if isinstance(points, collections.abc.Sequence) and any(isinstance(p, collections.abc.Mapping) for p in points):
            unknown = {repr(member) for p in points for member in p} - {"'lat_deg'", "'lon_deg'", "'height_m'"}
            if unknown:
                raise ValueError(f"points have lat_deg, lon_deg and height_m, not {', '.join(sorted(unknown))}")
            points = [[p["lat_deg"], p["lon_deg"], p.get("height_m", math.nan)] for p in points]
        places = np.asarray(points, float)
        if places.ndim < 1 or places.shape[-1] not in (2, 3):
            raise ValueError(f"points is an array of (..., 2) or (..., 3), lat_deg, lon_deg, height_m; it is "
                             f"{places.shape}")
        rows = places.reshape(-1, places.shape[-1])
        if np.isnan(rows[:, :2]).any():
            raise ValueError("points have NaN in lat_deg or lon_deg; only height_m may be left open so")
        answers = self._arrays_in_pieces("/v1/project", {"points": rows},
                                         _given(camera=camera, pose=pose, sun=sun, objects=objects, shutter=shutter,
                                                detail=detail) | (light or {}))
        with _reading():
            answers["reason"] = [REASONS[i] for i in answers.get("reason", ())]
        fields = [("x_px", float), ("y_px", float), ("range_m", float), ("height_m", float), ("in_frame", bool),
                  ("visible", bool), ("lit", float), ("reason", object)]
        if shutter:
            fields.append(("time_s", float))
        if light:
            fields.append(("irradiance", float, 3))
        return _recarray(answers, fields, places.shape[:-1])

    def lidar(self, request: Request, directions: Any = None, times_s: Any = None) -> Scan:
        """A lidar's scan: POST /v1/lidar.

        request     its JSON: "instrument" or "instrument_preset", "pose", "motion", "pattern", "seed", ...
        directions  (..., 3), camera axes: pulses in the place of "pattern"; with times_s: one for each, or one for all

        Gives a mapping of arrays: range_m (of the strongest detection; NaN: none), first_m, last_m, intensity, count,
        velocity_m_s, and beside them what is true: true_range_m, true_width_m, true_intensity, axis_range_m,
        false_alarm, rock, object; direction, origin_m, time_s. They have the shape of `directions`, or the rows and
        columns of a pattern that is an image. `scan.meta` has the request as it was understood.
        """
        shape = None
        if directions is None:
            body = _body(request)
        else:
            rows = np.asarray(directions, float)
            if rows.ndim < 1 or rows.shape[-1] != 3:
                raise ValueError(f"directions is an array of (..., 3); it is {rows.shape}")
            shape = rows.shape[:-1]
            arrays = {"direction": rows.reshape(-1, 3)}
            if times_s is not None:
                arrays["time_s"] = np.broadcast_to(np.asarray(times_s, float), shape).reshape(-1)
            body = _npz_body(request, arrays)
        content = self._ask("POST", "/v1/lidar", body, "application/x-npz", _region(request))[2]
        return Scan(content, shape)

    def heights(self, lat_deg: Any, lon_deg: Any, detail: Optional[str] = None) -> np.recarray:
        """Heights of the terrain: POST /v1/heights, of numbers or arrays.

        Gives a record array of their shape: height_m (above the sphere of 1 737 400 m; NaN where there is no data),
        post_spacing_m, source (name of the DEM tile), filled, blended (a mean of two layers), reason (why there is no
        height), lat_deg, lon_deg.
        """
        lats, lons = np.broadcast_arrays(np.asarray(lat_deg, float), np.asarray(lon_deg, float))
        places = [{"lat_deg": lat, "lon_deg": lon} for lat, lon in zip(lats.ravel().tolist(), lons.ravel().tolist())]
        answers = self._in_pieces("/v1/heights", "points", places, _given(detail=detail))
        fields = [("lat_deg", float), ("lon_deg", float), ("height_m", float), ("post_spacing_m", float),
                  ("source", object), ("filled", bool), ("blended", bool), ("reason", object)]
        return _records(answers, fields, lats.shape)

    def features(self, detail: str, region: Request, kind: str = "craters", smallest_m: Optional[float] = None,
                 min_depth_over_diameter: Optional[float] = None) -> np.recarray:
        """Craters or rocks ("rocks") of a detail: POST /v1/features, truth for what looks for them.

        region is south_deg, north_deg, west_deg and east_deg of their centres. Gives a record array, the largest first:
        id, lat_deg, lon_deg, height_m, diameter_m, age_Ma, and of craters depth_m, depth_over_diameter, visibility and
        rim_share. min_depth_over_diameter is of craters: left out, 0.02; 0 gives all.
        """
        document = _given(detail=detail, region=region, kind=kind, smallest_m=smallest_m,
                          min_depth_over_diameter=min_depth_over_diameter)
        found = self._objects("/v1/features", document, kind)
        fields = [("id", object), ("lat_deg", float), ("lon_deg", float), ("height_m", float), ("diameter_m", float),
                  ("age_Ma", float)]
        if kind == "craters":
            fields += [("depth_m", float), ("depth_over_diameter", float), ("visibility", float), ("rim_share", float)]
        return _records(found, fields, (len(found),))

    def sky(self, request: Request) -> np.recarray:
        """Stars, Sun, Earth and planets as a camera sees them: POST /v1/sky.

        request has camera, pose, utc or et_s, and sky; band and sensor for electrons. Gives a record array, stars
        first, the brightest of them first: kind, id, x_px, y_px, in_frame, visible, hidden_by, direction_icrf,
        direction (MOON_ME), direction_camera, magnitude, irradiance_w_m2, electrons, distance_m, phase_deg,
        angular_radius_deg. What does not exist is NaN.
        """
        found = self._objects("/v1/sky", request, "objects")
        fields = [("kind", object), ("id", object), ("x_px", float), ("y_px", float), ("in_frame", bool),
                  ("visible", bool), ("hidden_by", object), ("direction_icrf", float, 3), ("direction", float, 3),
                  ("direction_camera", float, 3), ("magnitude", float), ("irradiance_w_m2", float),
                  ("electrons", float), ("distance_m", float), ("phase_deg", float), ("angular_radius_deg", float)]
        return _records(found, fields, (len(found),))

    def limb(self, camera: Request, pose: Request, points: int = 360, detail: Optional[str] = None) -> np.recarray:
        """The Moon's limb in an image, of its terrain and of a sphere: POST /v1/limb.

        Gives a record array of as many azimuths: azimuth_deg, angle_deg, x_px, y_px, in_frame, position_m, lat_deg,
        lon_deg, height_m, range_m, sphere_angle_deg, sphere_x_px, sphere_y_px, difference_px. What does not exist is
        NaN.
        """
        fields = [("angle_deg", float), ("range_m", float), ("sphere_angle_deg", float), ("difference_px", float)]
        return self._outline("points", fields, camera=camera, pose=pose, points=points, detail=detail)

    def terminator(self, camera: Request, pose: Request, sun: Request, points: int = 360,
                   detail: Optional[str] = None) -> np.recarray:
        """The Moon's terminator in an image, of its terrain and of a sphere: POST /v1/limb with a Sun.

        Gives a record array of as many azimuths around the direction to the Sun: azimuth_deg, x_px, y_px, in_frame,
        visible, position_m, lat_deg, lon_deg, height_m, sphere_x_px, sphere_y_px, sphere_visible.
        """
        fields = [("visible", bool), ("sphere_visible", bool)]
        return self._outline("terminator", fields, camera=camera, pose=pose, sun=sun, points=points, detail=detail)

    def datasets(self) -> Dict[str, Any]:
        """The catalogue: GET /v1/datasets. "datasets" is a list of tiles (name, footprint, post_spacing_m, ...),
        "problems" a list of files that could not be used."""
        return self._document(self._ask("GET", "/v1/datasets", None, "application/json")[2])

    # Underneath

    def _outline(self, which: str, more: Any, **request: Any) -> np.recarray:
        found = self._objects("/v1/limb", _given(**request), which)
        fields = [("azimuth_deg", float), ("x_px", float), ("y_px", float), ("in_frame", bool),
                  ("position_m", float, 3), ("lat_deg", float), ("lon_deg", float), ("height_m", float),
                  ("sphere_x_px", float), ("sphere_y_px", float)]
        return _records(found, fields + more, (len(found),))

    def _post(self, path: str, document: Any, accept: str) -> Answer:
        _, headers, content = self._ask("POST", path, _body(document), accept, _region(document))
        with _reading():
            echo = json.loads(headers.get("Selenograph-Echo", "null"))
        return Answer(content, headers.get_content_type(), _timing(headers.get("Server-Timing")), headers.get("ETag"),
                      echo, headers)

    def _in_pieces(self, path: str, name: str, items: List[Any], rest: Dict[str, Any]) -> List[Dict[str, Any]]:
        answers: List[Dict[str, Any]] = []
        for start in range(0, len(items), POINTS_AT_ONCE):
            document = {**rest, name: items[start:start + POINTS_AT_ONCE]}
            try:
                found = self._objects(path, document, name, _region(document))
            except Refused as refused:
                if not start:
                    raise
                raise Refused(refused.status, _pointers_shifted(refused.problem, f"/{name}/", start)) from None
            if len(found) != len(document[name]):
                raise self._strange(f"{len(found)} {name} of {len(document[name])}")
            answers += found
        return answers

    def _objects(self, path: str, document: Any, name: str, region: Optional[str] = None) -> List[Dict[str, Any]]:
        """The list `name` of an answer in JSON. Warns in the name of its caller's caller."""
        _, headers, content = self._ask("POST", path, _body(document), "application/json", region)
        found = self._document(content).get(name)
        if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
            raise self._strange(f"its {name!r} is no list of objects")
        _warn(_warnings_of(headers))
        return found

    def _document(self, content: bytes) -> Dict[str, Any]:
        try:
            document = json.loads(content)
        except ValueError:
            document = None
        if not isinstance(document, dict):
            raise self._strange(f"{content[:60]!r} is no JSON object")
        return document

    def _strange(self, what: str) -> ConnectionError:
        return ConnectionError(f"{self.url} doesn't answer as selenograph does: {what}")

    def _arrays_in_pieces(self, path: str, arrays: Dict[str, np.ndarray], rest: Dict[str, Any]) -> Dict[str, Any]:
        """The answer's arrays; those of the request have as many rows. Warns in the name of its caller's caller."""
        pieces: List[Dict[str, np.ndarray]] = []
        texts: Dict[str, None] = {}  # most pieces say the same
        for start in range(0, len(next(iter(arrays.values()))), ROWS_AT_ONCE):
            some = {name: rows[start:start + ROWS_AT_ONCE] for name, rows in arrays.items()}
            about = _region({"rays": [{"origin_m": some["origin_m"][0]}]} if "origin_m" in some else rest)
            try:
                body = _npz_body(rest, some)
                _, headers, content = self._ask("POST", path, body, "application/x-npz", about)
                with _reading():
                    pieces.append(_read_npz(content)[0])
                texts.update(dict.fromkeys(_warnings_of(headers)))
            except Refused as refused:
                if not start:
                    raise
                problem = refused.problem
                for name in arrays:
                    problem = _pointers_shifted(problem, f"/{name}/", start)
                raise Refused(refused.status, problem) from None
        _warn(texts)
        with _reading():
            return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]} if pieces else {}

    def _in_order(self, requests: Iterable[Request], in_flight: int, ahead: int,
                  ask: Callable[[Request], Any]) -> _InOrder:
        if in_flight < 1 or int(in_flight) != in_flight:
            raise ValueError(f"in_flight is {in_flight!r}; a whole number from 1 on is needed")
        if not 0 <= ahead <= MOST_AHEAD or int(ahead) != ahead:
            raise ValueError(f"ahead is {ahead!r}; a whole number from 0 to {MOST_AHEAD} is needed")
        if isinstance(requests, collections.abc.Mapping):
            raise TypeError("frames takes several requests, e.g. a list of them; for one there is frame()")
        def asked(request: Request, poses: List[Any]) -> Any:
            return _with_ahead(ask, request, poses)
        if in_flight == 1:
            return _InStep(requests, int(ahead), asked)
        return _Pipeline(requests, int(in_flight), int(ahead), asked)

    def _ask(self, method: str, path: str, body: Optional[bytes], accept: str,
             region: Optional[str] = None) -> _Whole:
        """Status, headers and content of an answer that is no error."""
        give_up = time.monotonic() + self.timeout_s
        lost = False
        while True:
            connection = self._connection(give_up)
            try:
                status, headers, content = self._exchange(connection, method, path, body, accept, region, give_up)
            except socket.timeout:  # of Python 3.10 on TimeoutError
                connection.close()
                raise self._timed_out() from None
            except (ConnectionError, http.client.IncompleteRead) as error:
                connection.close()
                if lost:
                    raise ConnectionError(f"{self.url} closed two connections before its answer was whole") from error
                lost = True
                self._drop_idle()  # the others are as old
                continue
            except http.client.HTTPException as error:
                connection.close()
                raise ConnectionError(f"{self.url} doesn't answer as HTTP does: {error!r}") from error
            except BaseException:
                connection.close()
                raise
            if 200 <= status < 300:
                # A proxy's page to log in, say. One who asks for any of several types sees which it is.
                if headers.get_content_type() != accept.lower() and not set("*,;") & set(accept):
                    raise self._strange(f"with {headers.get_content_type()} where {accept} was asked for")
                return status, headers, content
            wait_s = _retry_after_s(headers) if status in (429, 503) else None
            if wait_s is None or time.monotonic() + wait_s > give_up:
                raise _refusal(status, headers, content)
            time.sleep(max(wait_s, 0.05))  # of "0" no busy loop

    def _exchange(self, connection: http.client.HTTPConnection, method: str, path: str, body: Optional[bytes],
                  accept: str, region: Optional[str], give_up: float) -> _Whole:
        remaining_s = _remaining_s(give_up)
        connection.sock.settimeout(remaining_s)
        headers = {**self._headers, "Accept": accept}
        if region is not None:
            headers["Selenograph-Region"] = region
        if body is not None:
            # A zip archive begins so, and no JSON does.
            headers["Content-Type"] = "application/x-npz" if body[:2] == b"PK" else "application/json"
            # A little less, so that its answer (504) is here before the client turns away.
            headers["Request-Timeout-Ms"] = str(max(1, int(950 * remaining_s)))
        connection.response_class = functools.partial(_Response, give_up)
        connection.request(method, self._prefix + path, body, headers)
        response = connection.getresponse()
        pieces = []
        while True:
            piece = response.read(1 << 20)
            if not piece:
                break
            pieces.append(piece)
        if response.length:  # a read of so many bytes doesn't complain when there are fewer
            raise http.client.IncompleteRead(b"", response.length)
        if response.will_close or self._closed:
            connection.close()
        else:
            with self._lock:
                self._idle.append(connection)
        return response.status, response.headers, b"".join(pieces)

    def _connection(self, give_up: float) -> http.client.HTTPConnection:
        """One that was used before, or a new one."""
        if self._process != os.getpid():  # after a fork: two processes must not share a connection
            self._process = os.getpid()
            self._drop_idle()  # this process' end only
        with self._lock:
            if self._idle:
                return self._idle.pop()
        timeout_s = give_up - time.monotonic()
        if timeout_s <= 0:
            raise self._timed_out()
        connection = (http.client.HTTPSConnection(self._host, self._port, timeout=timeout_s, context=self._tls)
                      if self._tls else http.client.HTTPConnection(self._host, self._port, timeout=timeout_s))
        try:
            connection.connect()  # also sets TCP_NODELAY
        except socket.timeout:
            raise self._timed_out() from None
        except ssl.SSLError as error:
            raise ConnectionError(f"{self.url}: no TLS connection: {error}") from error
        except OSError as error:
            raise ConnectionError(f"nothing answers at {self.url} ({error}): is the service running? It is started by "
                                  "`selenograph serve`, which prints its address") from error
        return connection

    def _timed_out(self) -> TimeoutError:
        return TimeoutError(f"no answer from {self.url} within timeout_s = {self.timeout_s:g} s")

    def _drop_idle(self) -> None:
        with self._lock:
            idle, self._idle = self._idle, []
        for connection in idle:
            connection.close()


_Whole = Tuple[int, http.client.HTTPMessage, bytes]


def _remaining_s(give_up: float) -> float:
    remaining_s = give_up - time.monotonic()
    if remaining_s <= 0:
        raise socket.timeout()
    return remaining_s


class _Response(http.client.HTTPResponse):
    """An answer, head and body, that is here by a time. A socket's own timeout is for one piece, however small."""

    def __init__(self, give_up: float, sock: socket.socket, *arguments: Any, **options: Any) -> None:
        super().__init__(sock, *arguments, **options)
        self.fp = io.BufferedReader(_Until(give_up, sock, self.fp.detach()))


class _Until(io.RawIOBase):
    """What a socket receives, up to a time."""

    def __init__(self, give_up: float, sock: socket.socket, received: io.RawIOBase) -> None:
        self._give_up, self._sock, self._received = give_up, sock, received

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> Optional[int]:
        self._sock.settimeout(_remaining_s(self._give_up))
        return self._received.readinto(buffer)

    def close(self) -> None:
        self._received.close()
        super().close()


def _retry_after_s(headers: http.client.HTTPMessage) -> Optional[float]:
    """Seconds, of a header with seconds or a date; None without."""
    text = (headers.get("Retry-After") or "").strip()
    if re.fullmatch(r"\d+", text):
        return float(text)
    try:
        date = email.utils.parsedate_to_datetime(text)
    except (TypeError, ValueError):
        return None
    if date.tzinfo is None:
        date = date.replace(tzinfo=datetime.timezone.utc)
    return max(0.0, (date - datetime.datetime.now(datetime.timezone.utc)).total_seconds())


def _refusal(status: int, headers: http.client.HTTPMessage, content: bytes) -> Refused:
    if headers.get_content_type() == "application/problem+json":
        try:
            problem = json.loads(content)
            errors = problem.get("errors") or [] if isinstance(problem, dict) else None
            if isinstance(errors, list) and all(isinstance(error, dict) and isinstance(error.get("pointer", ""), str)
                                                for error in errors):
                return Refused(status, problem)
        except ValueError:
            pass
    text = headers.get("Location") or content[:300].decode("utf-8", "replace").strip()
    return Refused(status, {}, text)


def _given(**members: Any) -> Dict[str, Any]:
    return {name: value for name, value in members.items() if value is not None}


def _pointers_shifted(problem: Dict[str, Any], prefix: str, by: int) -> Dict[str, Any]:
    """The problem of a piece of a list, with the pointers of the whole list."""
    def shifted(pointer: str) -> str:
        head, slash, tail = pointer[len(prefix):].partition("/")
        return f"{prefix}{int(head) + by}{slash}{tail}" if pointer.startswith(prefix) and head.isdigit() else pointer
    errors = [dict(error, pointer=shifted(error.get("pointer", ""))) for error in problem.get("errors") or []]
    return {**problem, "errors": errors, "detail": f"of the items from {by} on: {problem.get('detail')}"}


@_reading()
def _records(answers: List[Dict[str, Any]], fields: Sequence[Tuple[Any, ...]], shape: Tuple[int, ...]) -> np.recarray:
    records = np.zeros(len(answers), dtype=list(fields))
    for name, kind, *_ in fields:
        missing = math.nan if kind is float else None if kind is object else False
        values = (answer.get(name) for answer in answers)
        for i, value in enumerate(values):
            records[name][i] = missing if value is None else value
    return records.reshape(shape).view(np.recarray)[() if not shape else ...]  # of a single one its record


@_reading()
def _recarray(answers: Mapping[str, Any], fields: Sequence[Tuple[Any, ...]], shape: Tuple[int, ...]) -> np.recarray:
    """The same of arrays; numbers that the answer has not are NaN."""
    records = np.zeros(math.prod(shape), dtype=list(fields))
    for name, *_ in fields if len(records) else ():  # of no rows nothing was asked
        records[name] = answers.get(name, math.nan)
    return records.reshape(shape).view(np.recarray)[() if not shape else ...]


@_reading()
def _warnings_of(headers: http.client.HTTPMessage) -> List[str]:
    return [str(text) for text in json.loads(headers.get("Selenograph-Warnings", "[]"))]


def _warn(texts: Iterable[str]) -> None:
    """In the name of its caller's caller's caller."""
    for text in texts:
        warnings.warn(text, FrameWarning, stacklevel=4)


def _warned(frame: Frame) -> Frame:
    _warn(frame.warnings)
    return frame


# --- Frames in order


def _with_ahead(ask: Callable[[Request], Any], request: Request, poses: List[Any]) -> Any:
    """Asks with these poses as "ahead". A fault of theirs is that of the requests they come from, not of this one."""
    if not poses or "ahead" in request:
        return ask(request)
    try:
        return ask({**request, "ahead": poses})
    except Refused as refused:
        if not refused.pointers or not all(pointer.split("/")[1:2] == ["ahead"] for pointer in refused.pointers):
            raise
    return ask(request)


def _poses_behind(requests: Optional[Sequence[Request]], i: int, most: int) -> List[Any]:
    """Of the requests behind number i, up to the first without a pose (with several cameras, say)."""
    poses: List[Any] = []
    for k in range(i + 1, min(i + 1 + most, len(requests or ()))):
        request = requests[k]  # type: ignore[index]
        if not isinstance(request, collections.abc.Mapping) or "pose" not in request:
            break
        poses.append(request["pose"])
    return poses


def _handed_out(in_order: _InOrder) -> Iterator[Frame]:
    try:
        for frame in in_order:
            yield _warned(frame)
    finally:
        in_order.stop()


class _InStep:
    """One request at a time; the next one is taken after the answer to the last has been handed out."""

    def __init__(self, requests: Iterable[Request], ahead: int, ask: Callable[..., Any]) -> None:
        self._known = requests if isinstance(requests, collections.abc.Sequence) else None
        self._requests = enumerate(requests)
        self._ahead, self._ask = ahead, ask

    def __iter__(self) -> _InStep:
        return self

    def __next__(self) -> Any:
        i, request = next(self._requests)
        return self._ask(request, _poses_behind(self._known, i, self._ahead))

    def stop(self) -> None:
        pass


class _Pipeline:
    """`in_flight` requests at a time, answers in order. As many threads take requests, one after the other, and ask."""

    def __init__(self, requests: Iterable[Request], in_flight: int, ahead: int, ask: Callable[..., Any]) -> None:
        self._known = requests if isinstance(requests, collections.abc.Sequence) else None
        self._requests = iter(requests)
        self._in_flight, self._ahead, self._ask = in_flight, ahead, ask
        self._taking = threading.Lock()  # held while the iterable is asked, which may take for ever
        self._changed = threading.Condition()  # guards what follows
        self._taken = 0
        self._answers: Dict[int, Tuple[Any, Optional[BaseException]]] = {}
        self._awaited = -1  # by the loop
        self._end: Optional[int] = None  # how many there are, once known
        self._started = self._stopped = False

    def __iter__(self) -> _Pipeline:
        return self

    def __next__(self) -> Any:
        if not self._started:
            self._started = True
            for _ in range(self._in_flight):  # daemons: they must not keep a program that ends
                threading.Thread(target=self._answer_them, name="selenograph frames", daemon=True).start()
        with self._changed:
            # Only now, when the loop has come back, is there a place for another: before, it may have been changing
            # what requests are made from.
            i = self._awaited = self._awaited + 1
            self._changed.notify_all()
            self._changed.wait_for(lambda: i in self._answers or self._stopped or i == self._end)
            if i not in self._answers:
                raise StopIteration
            answer, error = self._answers.pop(i)
        if error is not None:
            self.stop()
            raise error
        return answer

    def stop(self) -> None:
        """What is under way ends by itself, unseen."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def _answer_them(self) -> None:
        while True:
            with self._taking:
                with self._changed:
                    i = self._taken
                    self._changed.wait_for(lambda: self._stopped or i < self._awaited + self._in_flight)
                    if self._stopped or self._end is not None:
                        return
                try:
                    request = next(self._requests)
                except BaseException as error:
                    with self._changed:
                        self._end = i
                        if not isinstance(error, StopIteration):  # the loop's to know
                            self._answers[i] = None, error
                        self._changed.notify_all()
                    return
                self._taken += 1
            answer: Tuple[Any, Optional[BaseException]]
            try:
                answer = self._ask(request, _poses_behind(self._known, i, self._ahead)), None
            except BaseException as error:
                answer = None, error
            with self._changed:
                self._answers[i] = answer
                self._changed.notify_all()


_InOrder = Union[_InStep, _Pipeline]


class AsyncClient:
    """`Client` for asyncio: the same methods, to be awaited; `frames` is for `async for`.

    Calls run in threads, up to `calls_at_once` of them at a time. Who stops waiting for a call (by asyncio.wait_for,
    say) doesn't stop the call: it ends by its timeout_s.
    """

    def __init__(self, url: str, token: Optional[str] = None, timeout_s: float = 60, calls_at_once: int = 8) -> None:
        self._client = Client(url, token, timeout_s)
        self._threads = concurrent.futures.ThreadPoolExecutor(calls_at_once, "selenograph")

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        self._client.close()
        self._threads.shutdown(wait=False)

    async def _run(self, call: Callable[..., Any], *arguments: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._threads, call, *arguments)

    async def frame(self, request: Request) -> Frame:
        return _warned(Frame(await self.encoded(request, "application/x-npz")))

    async def encoded(self, request: Request, media_type: str = "image/png") -> Answer:
        return await self._run(self._client.encoded, request, media_type)

    async def map(self, request: Request) -> Frame:
        return await self._run(self._client.map, request)

    async def rays(self, origins_m: Any, directions: Any, sun: Optional[Request] = None,
                   objects: Optional[Sequence[Request]] = None, detail: Optional[str] = None,
                   light: Optional[Request] = None) -> np.recarray:
        return await self._run(self._client.rays, origins_m, directions, sun, objects, detail, light)

    async def project(self, camera: Request, pose: Optional[Request], points: Any, sun: Optional[Request] = None,
                      objects: Optional[Sequence[Request]] = None, shutter: Optional[Request] = None,
                      detail: Optional[str] = None, light: Optional[Request] = None) -> np.recarray:
        return await self._run(self._client.project, camera, pose, points, sun, objects, shutter, detail, light)

    async def lidar(self, request: Request, directions: Any = None, times_s: Any = None) -> Scan:
        return await self._run(self._client.lidar, request, directions, times_s)

    async def heights(self, lat_deg: Any, lon_deg: Any, detail: Optional[str] = None) -> np.recarray:
        return await self._run(self._client.heights, lat_deg, lon_deg, detail)

    async def features(self, detail: str, region: Request, kind: str = "craters", smallest_m: Optional[float] = None,
                       min_depth_over_diameter: Optional[float] = None) -> np.recarray:
        return await self._run(self._client.features, detail, region, kind, smallest_m, min_depth_over_diameter)

    async def sky(self, request: Request) -> np.recarray:
        return await self._run(self._client.sky, request)

    async def limb(self, camera: Request, pose: Request, points: int = 360,
                   detail: Optional[str] = None) -> np.recarray:
        return await self._run(self._client.limb, camera, pose, points, detail)

    async def terminator(self, camera: Request, pose: Request, sun: Request, points: int = 360,
                         detail: Optional[str] = None) -> np.recarray:
        return await self._run(self._client.terminator, camera, pose, sun, points, detail)

    async def datasets(self) -> Dict[str, Any]:
        return await self._run(self._client.datasets)

    def frames(self, requests: Union[Iterable[Request], AsyncIterable[Request]], in_flight: int = 2,
               ahead: int = 4) -> AsyncIterator[Frame]:
        """As Client.frames. Requests are taken in the event loop's thread; an iterable that waits for something should
        be an asynchronous one."""
        if not isinstance(requests, (collections.abc.Sequence, collections.abc.Mapping)):
            requests = _FromLoop(requests, asyncio.get_running_loop())
        in_order = self._client._in_order(requests, in_flight, ahead,
                                          lambda request: Frame(self._client.encoded(request, "application/x-npz")))
        return self._handed_out(in_order)

    async def _handed_out(self, in_order: _InOrder) -> AsyncIterator[Frame]:
        # A thread of its own: it waits while other calls work.
        waiting = concurrent.futures.ThreadPoolExecutor(1, "selenograph frames")
        try:
            while True:
                frame: Any = await asyncio.get_running_loop().run_in_executor(waiting, next, in_order, None)
                if frame is None:
                    return
                yield _warned(frame)
        finally:
            in_order.stop()
            waiting.shutdown(wait=False)


_END = object()


class _FromLoop:
    """An iterable for other threads, whose items are taken in the event loop's."""

    def __init__(self, requests: Any, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._iterator = requests.__aiter__() if hasattr(requests, "__aiter__") else iter(requests)

    def __iter__(self) -> _FromLoop:
        return self

    def __next__(self) -> Request:
        request = asyncio.run_coroutine_threadsafe(self._take(), self._loop).result()
        if request is _END:
            raise StopIteration
        return request

    async def _take(self) -> Any:
        try:
            return await self._iterator.__anext__() if hasattr(self._iterator, "__anext__") else next(self._iterator)
        except (StopAsyncIteration, StopIteration):
            return _END


# --- Rotations. A quaternion is an array w, x, y, z; a_from_b rotates vectors of b into a: v_a = q v_b q*.


def _matrix_of(q: np.ndarray) -> np.ndarray:
    w, x, y, z = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def _quaternion_of(matrix: np.ndarray) -> np.ndarray:
    # The largest component comes from the diagonal, the others from it (Shepperd 1978): none loses its digits.
    m = matrix
    squares = np.array([1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2],
                        1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]])
    k = int(np.argmax(squares))
    q = np.array([[squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
                  [m[2, 1] - m[1, 2], squares[1], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]],
                  [m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], squares[2], m[2, 1] + m[1, 2]],
                  [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], squares[3]]][k])
    return q / np.linalg.norm(q)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def _slerp(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """From a to b at a constant rate, the shorter way."""
    if share <= 0 or share >= 1:
        return a if share <= 0 else b
    b = b if a @ b >= 0 else -b
    # The angle between them by its tangent: its cosine has no digits where they are close.
    angle = 2 * math.atan2(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))
    if angle < 1e-12:
        return a
    q = (math.sin((1 - share) * angle) * a + math.sin(share * angle) * b) / math.sin(angle)
    return q / np.linalg.norm(q)


def _vector(value: Any, size: int, name: str) -> np.ndarray:
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {value!r}; {size} numbers are needed") from None
    if array.shape != (size,) or not np.isfinite(array).all():
        raise ValueError(f"{name} is {value!r}; {size} finite numbers are needed")
    return array


def _one_of(value: Any, words: Tuple[str, ...], name: str) -> str:
    if value not in words:
        raise ValueError(f"{name} is {value!r}; write " + " or ".join(f"{name}={word!r}" for word in words))
    return value


DIRECTIONS = ("camera_from_moon", "moon_from_camera")


# --- Parts of a request


class Pose(dict):
    """The "pose" of a request: where the camera is, and how it is turned.

    Every way to make one takes the place as position_m=[x, y, z] (metres from the Moon's centre, MOON_ME or `frame`),
    or as lat_deg=, lon_deg=, height_m= (above the sphere of 1 737 400 m, MOON_ME).
    """

    @classmethod
    def nadir(cls, *, position_m: Optional[Vector] = None, lat_deg: Optional[float] = None,
              lon_deg: Optional[float] = None, height_m: Optional[float] = None, up_azimuth_deg: float = 0.0,
              frame: str = "MOON_ME") -> Pose:
        """Looks at the Moon's centre. up_azimuth_deg: compass azimuth, clockwise from north, of up in the image."""
        return cls({**_place(position_m, lat_deg, lon_deg, height_m, frame),
                    "nadir": {"up_azimuth_deg": float(up_azimuth_deg)}})

    @classmethod
    def look_at(cls, *, target_lat_deg: float, target_lon_deg: float, target_height_m: float = 0.0,
                up: Union[str, Vector] = "north", position_m: Optional[Vector] = None,
                lat_deg: Optional[float] = None, lon_deg: Optional[float] = None, height_m: Optional[float] = None,
                frame: str = "MOON_ME") -> Pose:
        """Looks at a place, which then lies at (cx, cy).

        up: what is up in the image: "north"; "zenith", away from the Moon's centre, so that the horizon lies level; or
        a MOON_ME vector.
        """
        place = _place(position_m, lat_deg, lon_deg, height_m, frame)
        if isinstance(up, str):
            _one_of(up, ("north", "zenith"), "up")
            if up == "zenith":  # as a vector: not every service knows the word
                if frame != "MOON_ME":
                    raise ValueError(f"up=\"zenith\" needs a place in MOON_ME, not in {frame}; write up=[x, y, z]")
                up = _from_centre(place)
        target = {"lat_deg": float(target_lat_deg), "lon_deg": float(target_lon_deg),
                  "height_m": float(target_height_m),
                  "up": up if isinstance(up, str) else _vector(up, 3, "up").tolist()}
        return cls({**place, "look_at": target})

    @classmethod
    def from_quaternion(cls, q: Vector, *, order: str, direction: str, position_m: Optional[Vector] = None,
                        lat_deg: Optional[float] = None, lon_deg: Optional[float] = None,
                        height_m: Optional[float] = None, axes: str = "opencv", frame: str = "MOON_ME") -> Pose:
        """An attitude as a unit quaternion of four numbers (Hamilton's product, ij = k).

        order      "wxyz": scalar first, as Eigen's constructor, pyquaternion and SPICE have it;
                   "xyzw": scalar last, as ROS and SciPy's Rotation.as_quat() have it
        direction  "camera_from_moon": q v q* turns a vector in MOON_ME into camera axes;
                   "moon_from_camera": its inverse, the orientation of the camera in MOON_ME (as ROS and Blender
                   store orientations)
        axes       "opencv" (+x right, +y down, +z boresight) or "opengl" (+x right, +y up, -z boresight; Blender's)
        """
        _one_of(order, ("wxyz", "xyzw"), "order")
        wxyz = _vector(q, 4, "q")
        wxyz = wxyz if order == "wxyz" else wxyz[[3, 0, 1, 2]]
        length = float(np.linalg.norm(wxyz))
        if abs(length - 1) > 1e-3:  # the service's tolerance
            raise ValueError(f"q has length {length:.6g}; a unit quaternion is needed. Modified Rodrigues parameters "
                             "are for Pose.from_mrp")
        return cls._turned(wxyz / length, direction, position_m, lat_deg, lon_deg, height_m, axes, frame)

    @classmethod
    def from_matrix(cls, matrix: Any, *, direction: str, position_m: Optional[Vector] = None,
                    lat_deg: Optional[float] = None, lon_deg: Optional[float] = None, height_m: Optional[float] = None,
                    axes: str = "opencv", frame: str = "MOON_ME") -> Pose:
        """An attitude as a 3 x 3 rotation matrix, rows first.

        direction  "camera_from_moon": matrix @ v_moon = v_camera. Its rows are the camera's axes in MOON_ME; the R of
                   OpenCV's solvePnP, and a direction cosine matrix [CM];
                   "moon_from_camera": its transpose. Its columns are the camera's axes in MOON_ME
        """
        m = np.asarray(matrix, float)
        if m.shape != (3, 3) or not np.isfinite(m).all():
            raise ValueError(f"matrix has the shape {m.shape}; 3 x 3 finite numbers are needed. Of a 4 x 4 pose take "
                             "[:3, :3] as the matrix")
        off = float(np.abs(m @ m.T - np.eye(3)).max())
        if off > 1e-6:
            raise ValueError(f"matrix is no rotation: its rows are {off:.2g} from orthonormal (1e-6 is allowed)")
        if np.linalg.det(m) < 0:
            raise ValueError("matrix mirrors (its determinant is -1): one of its axes points the wrong way. A camera "
                             "with +y up has -z as its boresight: axes=\"opengl\"")
        return cls._turned(_quaternion_of(m), direction, position_m, lat_deg, lon_deg, height_m, axes, frame)

    @classmethod
    def from_mrp(cls, sigma: Vector, *, direction: str, position_m: Optional[Vector] = None,
                 lat_deg: Optional[float] = None, lon_deg: Optional[float] = None, height_m: Optional[float] = None,
                 axes: str = "opencv", frame: str = "MOON_ME") -> Pose:
        """An attitude as modified Rodrigues parameters, e tan(angle / 4), in the convention of Schaub and Junkins that
        Basilisk uses: the matrix of sigma_CM, their [CM], turns vectors in M into C.

        direction  "camera_from_moon": sigma_CM, the camera's attitude relative to MOON_ME (as sigma_BN is the body's
                   relative to N); "moon_from_camera": sigma_MC
        """
        s = _vector(sigma, 3, "sigma")
        square = float(s @ s)
        # [CM] rotates the frame, where a quaternion's product rotates the vector: hence the minus.
        q = np.concatenate([[1 - square], -2 * s]) / (1 + square)
        return cls._turned(q, direction, position_m, lat_deg, lon_deg, height_m, axes, frame)

    @classmethod
    def _turned(cls, q: np.ndarray, direction: str, position_m: Optional[Vector], lat_deg: Optional[float],
                lon_deg: Optional[float], height_m: Optional[float], axes: str, frame: str) -> Pose:
        _one_of(direction, DIRECTIONS, "direction")
        _one_of(axes, ("opencv", "opengl"), "axes")
        pose = cls({**_place(position_m, lat_deg, lon_deg, height_m, frame),
                    direction: dict(zip("wxyz", (q + 0.0).tolist()))})  # + 0.0: no "-0.0"
        if axes != "opencv":
            pose["axes"] = axes
        return pose


def _place(position_m: Optional[Vector], lat_deg: Optional[float], lon_deg: Optional[float],
           height_m: Optional[float], frame: str) -> Dict[str, Any]:
    geodetic = _given(lat_deg=lat_deg, lon_deg=lon_deg, height_m=height_m)
    if position_m is None:
        if len(geodetic) < 3:
            raise ValueError("where is the camera? Write position_m=[x, y, z], or lat_deg=, lon_deg= and height_m=")
        if frame != "MOON_ME":
            raise ValueError(f"lat_deg, lon_deg and height_m are MOON_ME; in {frame} write position_m=[x, y, z]")
        return {"geodetic": {name: float(value) for name, value in geodetic.items()}}
    if geodetic:
        raise ValueError(f"write either position_m or lat_deg, lon_deg and height_m; got position_m and "
                         f"{', '.join(geodetic)}")
    position = _vector(position_m, 3, "position_m")
    distance = float(np.linalg.norm(position))
    if 1500 < distance < 1e6:
        raise ValueError(f"position_m is {distance:.6g} m from the Moon's centre, deep inside: kilometres? Metres are "
                         "needed")
    place: Dict[str, Any] = {"position_m": position.tolist()}
    if frame != "MOON_ME":
        place["frame"] = frame
    return place


def _from_centre(place: Mapping[str, Any]) -> np.ndarray:
    """A place as a vector from the Moon's centre, m."""
    if "position_m" in place:
        return np.asarray(place["position_m"], float)
    geodetic = place["geodetic"]
    lat, lon = math.radians(geodetic["lat_deg"]), math.radians(geodetic["lon_deg"])
    return (MOON_RADIUS_M + geodetic["height_m"]) * np.array(
        [math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])


class Camera(dict):
    """The "camera" of a request: projection and image size."""

    @classmethod
    def pinhole(cls, *, width: int, height: int, fov_deg: Optional[float] = None, fx: Optional[float] = None,
                fy: Optional[float] = None, cx: Optional[float] = None, cy: Optional[float] = None,
                focal_length_mm: Optional[float] = None, pixel_pitch_um: Optional[float] = None,
                distortion: Optional[Mapping[str, Any]] = None) -> Camera:
        """fov_deg: horizontal, full angle (not vertical, not half). Or fx in pixels; fy, cx, cy are optional then:
        fx, (width - 1) / 2, (height - 1) / 2. Or focal_length_mm with pixel_pitch_um. distortion: {"k1": .., "k2": ..,
        "k3": .., "p1": .., "p2": ..}."""
        lens = None if distortion is None else {"model": "brown_conrady", **distortion}
        return cls._made("pinhole", width, height, lens, fov_deg, _given(fx=fx, fy=fy, cx=cx, cy=cy),
                         _given(focal_length_mm=focal_length_mm, pixel_pitch_um=pixel_pitch_um))

    @classmethod
    def fisheye(cls, *, width: int, height: int, fov_deg: Optional[float] = None, fx: Optional[float] = None,
                fy: Optional[float] = None, cx: Optional[float] = None, cy: Optional[float] = None,
                focal_length_mm: Optional[float] = None, pixel_pitch_um: Optional[float] = None,
                distortion: Optional[Mapping[str, Any]] = None) -> Camera:
        """Equidistant (radius = f theta), or with distortion {"k1": .., .. "k4": ..} as OpenCV's fisheye."""
        lens = None if distortion is None else {"model": "kannala_brandt", **distortion}
        return cls._made("fisheye", width, height, lens, fov_deg, _given(fx=fx, fy=fy, cx=cx, cy=cy),
                         _given(focal_length_mm=focal_length_mm, pixel_pitch_um=pixel_pitch_um))

    @classmethod
    def from_opencv(cls, matrix: Any, distortion: Any = (), *, width: int, height: int,
                    fisheye: bool = False) -> Camera:
        """From OpenCV's camera matrix and distortion coefficients, in OpenCV's order: k1, k2, p1, p2[, k3], or k1..k4
        of cv2.fisheye. Pixels count as in OpenCV, so that nothing is shifted."""
        m = np.asarray(matrix, float)
        if m.shape != (3, 3) or abs(m[0, 1]) > 0 or m[1, 0] or tuple(m[2]) != (0, 0, 1):
            raise ValueError(f"matrix is {m.tolist()}; [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] is needed (no skew)")
        values = [] if distortion is None else np.asarray(distortion, float).ravel().tolist()
        names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
        if any(values[len(names):]):
            raise ValueError(f"distortion has {len(values)} coefficients; at most {', '.join(names)} can be used")
        make = cls.fisheye if fisheye else cls.pinhole
        return make(width=width, height=height, fx=m[0, 0], fy=m[1, 1], cx=m[0, 2], cy=m[1, 2],
                    distortion=dict(zip(names, values)) if any(values) else None)

    @classmethod
    def _made(cls, model: str, width: int, height: int, distortion: Optional[Mapping[str, Any]],
              fov_deg: Optional[float], pixels: Dict[str, float], lengths: Dict[str, float]) -> Camera:
        given = [way for way in (_given(fov_deg=fov_deg), pixels, lengths) if way]
        if len(given) != 1 or len(lengths) == 1:
            raise ValueError("write either fov_deg (horizontal, full angle) or fx (and fy, cx, cy), in pixels, or "
                             "focal_length_mm and pixel_pitch_um")
        camera = cls(model=model, width=int(width), height=int(height),
                     **{name: float(value) for name, value in given[0].items()})
        if distortion is not None:
            camera["distortion"] = dict(distortion)
        return camera


class Sun(dict):
    """The "sun" of a request. Every way to make one takes, too:

    distance_au         scales irradiance by 1/r^2; left out: 1, or the ephemeris' with utc
    angular_radius_deg  0: a point Sun, hard shadows; "sun": penumbra, by the distance; left out: 0, or "sun" with utc
    """

    @classmethod
    def direction(cls, vector: Vector, **more: Any) -> Sun:
        """A MOON_ME vector toward the Sun (not the way that light travels), of any length."""
        return cls(direction=_vector(vector, 3, "vector").tolist(), **more)

    @classmethod
    def subsolar(cls, *, lat_deg: float, lon_deg: float, **more: Any) -> Sun:
        """The place that has the Sun in its zenith."""
        return cls(subsolar={"lat_deg": float(lat_deg), "lon_deg": float(lon_deg)}, **more)

    @classmethod
    def local(cls, *, lat_deg: float, lon_deg: float, azimuth_deg: float, elevation_deg: float, **more: Any) -> Sun:
        """As seen from a place: azimuth clockwise from north, elevation above the local horizontal."""
        return cls(local={"lat_deg": float(lat_deg), "lon_deg": float(lon_deg), "azimuth_deg": float(azimuth_deg),
                          "elevation_deg": float(elevation_deg)}, **more)

    @classmethod
    def utc(cls, when: Union[str, datetime.datetime], **more: Any) -> Sun:
        """By epoch: ISO 8601, e.g. "2026-11-20T00:00:00Z", or a datetime with its time zone."""
        return cls(utc=when if isinstance(when, str) else _utc_text(when), **more)

    @classmethod
    def et(cls, et_s: float, **more: Any) -> Sun:
        """By SPICE's Ephemeris Time: seconds of TDB since J2000.0, as str2et gives them."""
        return cls(et_s=float(et_s), **more)


def _utc_text(when: datetime.datetime) -> str:
    if when.tzinfo is None:
        raise ValueError(f"{when!r} has no time zone; write datetime(..., tzinfo=timezone.utc)")
    return when.astimezone(datetime.timezone.utc).replace(tzinfo=None).isoformat() + "Z"


# --- Random views

def random_views(client: Client, request: Request, count: int, *, region: Mapping[str, float],
                 altitude_m: Tuple[float, float], off_nadir_deg: Tuple[float, float] = (0, 0),
                 sun_elevation_deg: Tuple[float, float] = (5, 60), seed: int = 0) -> Iterator[Dict[str, Any]]:
    """The request with `count` random poses and Suns, as for a training set; each has a "name" for a manifest.

    region              south_deg, north_deg, west_deg, east_deg of the places that the camera looks at, the image's
                        middle; uniform by area
    altitude_m          (least, most) of the camera above that place's ground; uniform by its logarithm
    off_nadir_deg       (least, most) between the line of sight and the place's vertical, below 85; from any side
    sun_elevation_deg   (least, most) there; from any azimuth

    Angles are uniform; the image is turned at random, too. Views that see ground without data, by a small frame of the
    service's (of a "camera_preset" a whole one), are drawn again: ValueError when they are nineteen of twenty. The same
    seed gives the same views.
    """
    if "camera" not in request and "camera_preset" not in request:
        raise ValueError('the request has neither "camera" nor "camera_preset"; one is needed')
    for name, (least, most), low, high in (("altitude_m", altitude_m, 1e-3, math.inf),
                                           ("off_nadir_deg", off_nadir_deg, 0, 85),
                                           ("sun_elevation_deg", sun_elevation_deg, -90, 90)):
        if not low <= least <= most <= high:
            raise ValueError(f"{name}=({least}, {most}) must be (least, most) within {low:g} and {high:g}")
    draw = np.random.default_rng(seed)
    refused = 0
    for number in range(count):
        while True:
            view = _random_view(client, draw, region, altitude_m, off_nadir_deg, sun_elevation_deg,
                                request.get("detail"))
            if view is not None and _has_data(client, request, view):
                break
            refused += 1
            if refused > 20 + 19 * (number + 1):
                raise ValueError(f"of {refused + number} views drawn {refused} see ground without data, or none: is "
                                 "the region within the service's tiles?")
        yield {**request, **view, "name": f"{number:06d}"}


def _random_view(client: Client, draw: np.random.Generator, region: Mapping[str, float],
                 altitude_m: Tuple[float, float], off_nadir_deg: Tuple[float, float],
                 sun_elevation_deg: Tuple[float, float], detail: Optional[str]) -> Optional[Dict[str, Any]]:
    """Pose and Sun; None where there is no ground to look at. As many numbers are drawn in any case."""
    sines = np.sin(np.radians([region["south_deg"], region["north_deg"]]))
    lat = math.asin(draw.uniform(*sines))
    west, east = region["west_deg"], region["east_deg"]
    lon = math.radians(draw.uniform(west, east if east > west else east + 360))
    altitude = math.exp(draw.uniform(*np.log(altitude_m)))
    tilt, side, turn = np.radians([draw.uniform(*off_nadir_deg), draw.uniform(0, 360), draw.uniform(0, 360)])
    azimuth_deg, elevation_deg = draw.uniform(0, 360), draw.uniform(*sun_elevation_deg)
    lat_deg, lon_deg = math.degrees(lat), (math.degrees(lon) + 180) % 360 - 180
    ground_m = float(client.heights(lat_deg, lon_deg, detail=detail).height_m)
    if math.isnan(ground_m):
        return None
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    east_axis, north = np.array([-math.sin(lon), math.cos(lon), 0]), np.cross(up, [-math.sin(lon), math.cos(lon), 0])
    aside = math.sin(side) * east_axis + math.cos(side) * north
    camera = (MOON_RADIUS_M + ground_m) * up + altitude * (up + math.tan(tilt) * aside)
    pose = Pose.look_at(target_lat_deg=lat_deg, target_lon_deg=lon_deg, target_height_m=ground_m,
                        up=math.sin(turn) * east_axis + math.cos(turn) * north, position_m=camera)
    return {"pose": pose, "sun": Sun.local(lat_deg=lat_deg, lon_deg=lon_deg, azimuth_deg=azimuth_deg,
                                           elevation_deg=elevation_deg)}


def _has_data(client: Client, request: Request, view: Mapping[str, Any]) -> bool:
    """Whether each place of a frame, seen in 32 pixels along its longer side, has ground with data, or sky."""
    lens = {"camera": _small(request["camera"])} if "camera" in request else {"camera_preset": request["camera_preset"]}
    try:
        request = {**lens, "pose": view["pose"], "products": ["depth"]}
        frame = Frame(client.encoded(request, "application/x-npz"))  # whose warnings are of so small a frame
    except Refused as refused:
        if refused.status != 422:
            raise
        return False  # below the ground
    return frame.meta["missing_fraction"] == 0 and frame.meta["hit_fraction"] > 0


def _small(camera: Mapping[str, Any]) -> Dict[str, Any]:
    """The same lens with 32 pixels along the image's longer side."""
    small = 32 / max(camera["width"], camera["height"])
    size = {name: max(1, round(small * camera[name])) for name in ("width", "height")}
    shares = {name: size[name] / camera[name] for name in size}
    made = {**camera, **size}
    for name, across in (("fx", "width"), ("cx", "width"), ("fy", "height"), ("cy", "height")):
        if name in camera:
            share = shares[across]
            made[name] = camera[name] * share if name[0] == "f" else (camera[name] + 0.5) * share - 0.5
    if "pixel_pitch_um" in camera:
        made["pixel_pitch_um"] = camera["pixel_pitch_um"] / shares["width"]
    return made


# --- Trajectories


class Trajectory:
    """Positions and attitudes over time; `at` gives the pose in between.

    times_s           rising, in seconds from `start` (or from anything, without)
    positions_m       (N, 3), MOON_ME or `frame`
    velocities_m_s    (N, 3); without them those of the parabola through each position and its neighbours
    attitudes         (N, 4) unit quaternions w, x, y, z in the direction `direction`; or, instead,
    up_azimuth_deg    of a camera that looks at nadir: a number or (N,), as in Pose.nadir
    start             the epoch of 0 s, a datetime with its time zone: then `requests` sets the Sun by it
    method, degree    of positions: "hermite" (cubic by default; from positions and velocities), "lagrange", "linear"

    Attitudes turn at a constant rate from one to the next, the shorter way (slerp).
    """

    def __init__(self, times_s: Vector, positions_m: Any, *, velocities_m_s: Any = None, attitudes: Any = None,
                 direction: Optional[str] = None, up_azimuth_deg: Any = None,
                 start: Optional[datetime.datetime] = None, frame: str = "MOON_ME", method: str = "hermite",
                 degree: Optional[int] = None) -> None:
        track = _Track(times_s, positions_m, velocities_m_s, method, degree)
        if (attitudes is None) == (up_azimuth_deg is None):
            raise ValueError("write either attitudes (quaternions w, x, y, z; with direction=) or up_azimuth_deg (the "
                             "camera looks at nadir)")
        if attitudes is not None:
            if direction is None:
                raise ValueError('attitudes need a direction: "camera_from_moon" or "moon_from_camera"')
            turns = [_Turns(times_s, attitudes, direction)]
            self._set([track], turns, None, start, frame)
        else:
            azimuths = np.broadcast_to(np.asarray(up_azimuth_deg, float), track.times.shape)
            # The shorter way from one to the next; unwrap knows degrees from NumPy 1.21 on.
            turns = np.cumsum(np.round(np.diff(azimuths, prepend=azimuths[:1]) / 360))
            self._set([track], [], (track.times, azimuths - 360 * turns), start, frame)

    def _set(self, tracks: List[_Track], turns: List[_Turns], azimuths: Optional[Tuple[np.ndarray, np.ndarray]],
             start: Optional[datetime.datetime], frame: str) -> None:
        if start is not None and start.tzinfo is None:
            raise ValueError(f"start = {start!r} has no time zone; write datetime(..., tzinfo=timezone.utc)")
        self._tracks, self._turns, self._azimuths = tracks, turns, azimuths
        self.start, self.frame = start, frame
        times = np.unique(np.concatenate([t.times[(t.times >= t.first) & (t.times <= t.last)] for t in tracks]))
        if turns:
            times = np.array([t for t in times if _span(turns, float(t))])
        if not len(times):
            raise ValueError("positions and attitudes have no time in common")
        self.times_s: np.ndarray = times  # of the positions, where there is an attitude, too

    @classmethod
    def from_csv(cls, path: Union[str, os.PathLike], *, frame: str = "MOON_ME") -> Trajectory:
        """From a file with a line of names, and commas. Columns, in any order:

        time_s, or utc (ISO 8601)
        x_m, y_m, z_m, and vx_m_s, vy_m_s, vz_m_s if known; or lat_deg, lon_deg, height_m
        camera_from_moon_w, .._x, .._y, .._z, or moon_from_camera_w, ...; or up_azimuth_deg: the camera looks at nadir
        """
        columns, times = _read_csv(path)
        start = None
        if "utc" in columns:
            epochs = [_epoch(text, f"{path}: utc") for text in columns.pop("utc")]
            times = [_seconds(epoch, epochs[0]) for epoch in epochs]
            start = _datetime(epochs[0])
        numbers = {name: np.array(values) for name, values in columns.items()}

        def taken(*names: str) -> Optional[np.ndarray]:
            there = [name for name in names if name in numbers]
            if there and len(there) < len(names):
                raise ValueError(f"{path}: there is {', '.join(there)} but not "
                                 f"{', '.join(name for name in names if name not in numbers)}")
            return np.stack([numbers.pop(name) for name in names], -1) if there else None

        positions, velocities = taken("x_m", "y_m", "z_m"), taken("vx_m_s", "vy_m_s", "vz_m_s")
        places = taken("lat_deg", "lon_deg", "height_m")
        if (positions is None) == (places is None):
            raise ValueError(f"{path}: write either x_m, y_m, z_m or lat_deg, lon_deg, height_m")
        if places is not None:
            if velocities is not None or frame != "MOON_ME":
                raise ValueError(f"{path}: velocities and other frames than MOON_ME go with x_m, y_m, z_m")
            positions = np.array([_from_centre({"geodetic": dict(zip(("lat_deg", "lon_deg", "height_m"), place))})
                                  for place in places])
        given = {direction: taken(*(f"{direction}_{c}" for c in "wxyz")) for direction in DIRECTIONS}
        given = {direction: attitudes for direction, attitudes in given.items() if attitudes is not None}
        azimuths = numbers.pop("up_azimuth_deg", None)
        if len(given) + (azimuths is not None) != 1:
            raise ValueError(f"{path}: one attitude is needed: camera_from_moon_w, .._x, .._y, .._z, or "
                             "moon_from_camera_w, .., or up_azimuth_deg of a camera that looks at nadir")
        if numbers:
            raise ValueError(f"{path}: unknown column {', '.join(map(repr, numbers))}; there are "
                             f"{', '.join(sorted(_COLUMNS))}")
        direction, attitudes = next(iter(given.items()), (None, None))
        try:
            return cls(times, positions, velocities_m_s=velocities, attitudes=attitudes, direction=direction,
                       up_azimuth_deg=azimuths, start=start, frame=frame)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    @classmethod
    def from_ccsds(cls, oem: Union[str, os.PathLike], aem: Union[str, os.PathLike, None] = None, *,
                   up_azimuth_deg: Optional[float] = None, camera_from_body: Any = None,
                   frame: Optional[str] = None) -> Trajectory:
        """From an Orbit Ephemeris Message (CCSDS 502.0) and an Attitude Ephemeris Message (504.0), as KVN text.

        Positions by the OEM's INTERPOLATION, or by cubic Hermite polynomials where it says none; attitudes by slerp.
        An AEM holds quaternions of frame B relative to A; one of the two is the OEM's REF_FRAME, the other the
        spacecraft's body. camera_from_body is the 3 x 3 matrix that turns body axes into camera axes (+x right, +y
        down, +z boresight); left out, body and camera are the same. Without an AEM the camera looks at nadir, with
        up_azimuth_deg.

        frame: what the files' REF_FRAME is called here, where it isn't MOON_ME, MOON_PA_DE421, MOON_PA_DE440 or ICRF;
        "J2000", of EME2000 say.
        """
        if (aem is None) == (up_azimuth_deg is None):
            raise ValueError("write either aem= (attitudes) or up_azimuth_deg= (the camera looks at nadir)")
        if camera_from_body is not None and aem is None:
            raise ValueError("camera_from_body goes with aem=: without attitudes the camera looks at nadir")
        orbit = _read_kvn(oem, "OEM")
        attitude = [] if aem is None else _read_kvn(aem, "AEM")
        system = _same(oem, orbit + attitude, "TIME_SYSTEM")
        named = _same(oem, orbit, "REF_FRAME")
        frame = frame or FRAMES.get(named.upper())
        if frame is None:
            raise ValueError(f"{oem}: REF_FRAME is {named}; the service knows {', '.join(sorted(set(FRAMES.values())))}"
                             ". If it is one of them by another name, write frame=")
        if _same(oem, orbit, "CENTER_NAME").upper() not in ("MOON", "LUNA"):
            raise ValueError(f"{oem}: CENTER_NAME is {_same(oem, orbit, 'CENTER_NAME')}; MOON is needed")
        epoch = min(segment.epochs[0] for segment in orbit)
        tracks = [segment.track(epoch) for segment in orbit]
        mounting = np.array([1.0, 0, 0, 0])
        if camera_from_body is not None:
            q = Pose.from_matrix(camera_from_body, direction="camera_from_moon", position_m=[0, 0, 0])
            mounting = np.array([q["camera_from_moon"][c] for c in "wxyz"])
        turns = [segment.turns(epoch, named, mounting) for segment in attitude]
        trajectory = cls.__new__(cls)
        azimuths = None if aem is not None else (np.zeros(1), np.array([float(up_azimuth_deg or 0)]))
        trajectory._set(tracks, turns, azimuths, _datetime(epoch) if system.upper() == "UTC" else None, frame)
        if frame in INERTIAL and trajectory.start is None:
            raise ValueError(f"{oem}: TIME_SYSTEM is {system}; with REF_FRAME {named} UTC is needed, since the Moon's "
                             "rotation depends on it")
        return trajectory

    def __len__(self) -> int:
        return len(self.times_s)

    def __iter__(self) -> Iterator[Pose]:
        """The poses at times_s."""
        return (self.at(t) for t in self.times_s)

    def position_m(self, time_s: float) -> np.ndarray:
        """The position at a time, in `frame`."""
        track = _span(self._tracks, time_s)
        if track is None:
            spans = ", ".join(f"{t.first:g} to {t.last:g}" for t in self._tracks)
            raise ValueError(f"no position at {time_s:g} s; there are positions from {spans} s")
        return track.at(time_s)

    def at(self, time_s: float) -> Pose:
        """The pose at a time, in seconds as in times_s. There are none before the first nor behind the last."""
        position = self.position_m(float(time_s))
        if self._azimuths is not None:
            pose = Pose.nadir(position_m=position, frame=self.frame,
                              up_azimuth_deg=math.remainder(float(np.interp(time_s, *self._azimuths)), 360))
        else:
            turns = _span(self._turns, float(time_s))
            if turns is None:
                spans = ", ".join(f"{t.first:g} to {t.last:g}" for t in self._turns)
                raise ValueError(f"no attitude at {time_s:g} s; there are attitudes from {spans} s")
            pose = Pose.from_quaternion(turns.at(float(time_s)), order="wxyz", direction=turns.direction,
                                        position_m=position, frame=self.frame)
        if self.frame in INERTIAL:
            pose["utc"] = self.utc(time_s)
        return pose

    def utc(self, time_s: float) -> str:
        """The epoch of a time, for Sun.utc."""
        if self.start is None:
            raise ValueError("the trajectory has no epoch: its times are not UTC")
        return _utc_text(self.start + datetime.timedelta(seconds=float(time_s)))

    def requests(self, request: Request, times_s: Optional[Iterable[float]] = None) -> List[Dict[str, Any]]:
        """`request` with the pose of each time (default: times_s), and with the Sun of its epoch if it has no "sun".
        A list: frames() then knows all poses ahead."""
        if "sun" not in request and self.start is None and set(request.get("products", ["radiance"])) & NEED_SUN:
            raise ValueError('the request has no "sun", and the trajectory no epoch to find it by; add one by Sun')
        made = []
        for time_s in self.times_s if times_s is None else times_s:
            more: Dict[str, Any] = {"pose": self.at(time_s)}
            if "sun" not in request and self.start is not None:
                more["sun"] = Sun.utc(self.utc(time_s))
            made.append({**request, **more})
        return made


# REF_FRAME of files (the service's, SPICE's and SANA's names) -> pose.frame
FRAMES = {"MOON_ME": "MOON_ME", "MOON_ME_DE421": "MOON_ME", "MOON_ME_DE440_ME421": "MOON_ME",
          "MOON_PA_DE421": "MOON_PA_DE421", "MOON_PA421": "MOON_PA_DE421", "MOON_PA_DE440": "MOON_PA_DE440",
          "MOON_PA440": "MOON_PA_DE440", "ICRF": "ICRF"}
NEED_SUN = {"image", "radiance", "angles", "lit", "irradiance"}


class _Track:
    """Positions over time: one segment."""

    def __init__(self, times_s: Any, positions_m: Any, velocities_m_s: Any, method: str, degree: Optional[int],
                 first: Optional[float] = None, last: Optional[float] = None) -> None:
        self.times = _rising(times_s)
        self.positions = _rows(positions_m, len(self.times), 3, "positions_m")
        _one_of(method, ("hermite", "lagrange", "linear"), "method")
        if method == "linear":
            method, degree = "lagrange", 1
        # Of a Hermite polynomial each node fixes two coefficients.
        degree = degree or (3 if method == "hermite" else 5)
        nodes = -(-(degree + 1) // 2) if method == "hermite" else degree + 1
        self.nodes = min(max(nodes, 2), len(self.times))
        self.velocities = None
        if method == "hermite":
            if velocities_m_s is not None:
                self.velocities = _rows(velocities_m_s, len(self.times), 3, "velocities_m_s")
            elif len(self.times) > 1:
                self.velocities = np.gradient(self.positions, self.times, axis=0,
                                              edge_order=2 if len(self.times) > 2 else 1)
        self.first = float(self.times[0]) if first is None else max(first, float(self.times[0]))
        self.last = float(self.times[-1]) if last is None else min(last, float(self.times[-1]))

    def at(self, time_s: float) -> np.ndarray:
        k = int(np.searchsorted(self.times, time_s))
        if k < len(self.times) and self.times[k] == time_s:
            return self.positions[k].copy()
        start = min(max(k - self.nodes // 2, 0), len(self.times) - self.nodes)
        here = slice(start, start + self.nodes)
        # Newton's form, each node twice where velocities count; positions relative to a near one keep their digits.
        twice = 1 if self.velocities is None else 2
        x = np.repeat(self.times[here] - time_s, twice)
        origin = self.positions[start + self.nodes // 2]
        column = np.repeat(self.positions[here] - origin, twice, axis=0)
        coefficients = [column[0]]
        for level in range(1, len(x)):
            gap = (x[level:] - x[:-level])[:, None]
            difference = column[1:] - column[:-1]
            if level == 1 and self.velocities is not None:
                slopes = np.repeat(self.velocities[here], 2, axis=0)[:-1]
                column = np.where(gap == 0, slopes, difference / np.where(gap == 0, 1, gap))
            else:
                column = difference / gap
            coefficients.append(column[0])
        value = coefficients[-1]
        for coefficient, node in zip(coefficients[-2::-1], x[len(x) - 2::-1]):
            value = coefficient - node * value
        return origin + value


class _Turns:
    """Attitudes over time: one segment."""

    def __init__(self, times_s: Any, attitudes: Any, direction: str, first: Optional[float] = None,
                 last: Optional[float] = None) -> None:
        self.times = _rising(times_s)
        self.direction = _one_of(direction, DIRECTIONS, "direction")
        attitudes = _rows(attitudes, len(self.times), 4, "attitudes")
        lengths = np.linalg.norm(attitudes, axis=1)
        if np.abs(lengths - 1).max() > 1e-3:
            worst = int(np.abs(lengths - 1).argmax())
            raise ValueError(f"attitude {worst} has length {lengths[worst]:.6g}; unit quaternions are needed")
        self.attitudes = attitudes / lengths[:, None]
        self.first = float(self.times[0]) if first is None else max(first, float(self.times[0]))
        self.last = float(self.times[-1]) if last is None else min(last, float(self.times[-1]))

    def at(self, time_s: float) -> np.ndarray:
        k = int(np.clip(np.searchsorted(self.times, time_s), 1, max(1, len(self.times) - 1)))
        if len(self.times) == 1:
            return self.attitudes[0]
        share = (time_s - self.times[k - 1]) / (self.times[k] - self.times[k - 1])
        return _slerp(self.attitudes[k - 1], self.attitudes[k], float(share))


def _span(segments: Sequence[Any], time_s: float) -> Any:
    return next((s for s in segments if s.first <= time_s <= s.last), None)


def _rising(times_s: Any) -> np.ndarray:
    times = np.asarray(times_s, float)
    if times.ndim != 1 or not len(times) or not np.isfinite(times).all():
        raise ValueError("times are needed: one row of finite numbers")
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        raise ValueError(f"times must rise; number {late[0] + 1} (from 0), {times[late[0] + 1]:.9g} s, does not")
    return times


def _rows(values: Any, count: int, size: int, name: str) -> np.ndarray:
    rows = np.asarray(values, float)
    if rows.shape != (count, size) or not np.isfinite(rows).all():
        raise ValueError(f"{name} have the shape {rows.shape}; ({count}, {size}) finite numbers are needed")
    return rows


# An epoch: a second, and what is beyond it. Files have more digits than a datetime.
_Epoch = Tuple[datetime.datetime, float]


def _epoch(text: str, where: str) -> _Epoch:
    found = re.fullmatch(r"(\d{4}-(?:\d\d-\d\d|\d{3}))[T ](\d\d:\d\d:\d\d)(\.\d*)?(?:Z|\+00:00)?", text.strip())
    try:
        if not found:
            raise ValueError
        date = "%Y-%m-%d" if len(found[1]) == 10 else "%Y-%j"
        return (datetime.datetime.strptime(f"{found[1]}T{found[2]}", date + "T%H:%M:%S"),
                float(found[3]) if found[3] not in (None, ".") else 0.0)
    except ValueError:
        raise ValueError(f"{where}: {text!r} is no epoch like 2026-11-20T00:00:00.000") from None


def _datetime(epoch: _Epoch) -> datetime.datetime:
    return epoch[0].replace(tzinfo=datetime.timezone.utc) + datetime.timedelta(seconds=epoch[1])


def _seconds(epoch: _Epoch, since: _Epoch) -> float:
    return (epoch[0] - since[0]).total_seconds() + (epoch[1] - since[1])


_COLUMNS = ({"time_s", "utc", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "lat_deg", "lon_deg", "height_m",
             "up_azimuth_deg"} | {f"{direction}_{c}" for direction in DIRECTIONS for c in "wxyz"})
_WITHIN = {"lat_deg": (-90, 90), "lon_deg": (-180, 360)}  # as the service takes them


def _read_csv(path: Union[str, os.PathLike]) -> Tuple[Dict[str, List[Any]], List[float]]:
    """Columns by name (utc as text, others as numbers), and the column time_s."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        lines = [(number, line) for number, line in enumerate(file, 1) if line.strip() and not line.startswith("#")]
    rows = list(csv.reader(line for _, line in lines))
    if len(rows) < 2:
        raise ValueError(f"{path}: a line of names and at least one of numbers are needed")
    names = [name.strip() for name in rows[0]]
    if len(names) == 1 and ";" in names[0]:
        raise ValueError(f"{path}: columns are separated by semicolons; commas are needed, and points in numbers")
    if len(set(names)) < len(names):
        raise ValueError(f"{path}: two columns have the same name")
    if ("time_s" in names) == ("utc" in names):
        raise ValueError(f"{path}: one column with the time is needed, time_s or utc; there are {', '.join(names)}")
    columns: Dict[str, List[Any]] = {name: [] for name in names}
    for (number, _), row in zip(lines[1:], rows[1:]):
        if len(row) != len(names):
            raise ValueError(f"{path}, line {number}: {len(row)} values for {len(names)} columns")
        for name, text in zip(names, row):
            try:
                value = 0.0 if name == "utc" else float(text)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise ValueError(f"{path}, line {number}: {name} is {text!r}, no number")
            least, most = _WITHIN.get(name, (value, value))
            if not least <= value <= most:
                raise ValueError(f"{path}, line {number}: {name} is {text}; {least} to {most} is needed")
            columns[name].append(text if name == "utc" else value)
    return columns, columns.pop("time_s", [])


@dataclasses.dataclass
class _Segment:
    """Of an OEM or AEM: metadata and lines of data."""

    path: str
    meta: Dict[str, str]
    epochs: List[_Epoch] = dataclasses.field(default_factory=list)
    values: List[List[float]] = dataclasses.field(default_factory=list)

    def times_s(self, since: _Epoch) -> List[float]:
        return [_seconds(epoch, since) for epoch in self.epochs]

    def usable(self, since: _Epoch) -> List[Optional[float]]:
        keys = ("USEABLE_START_TIME", "USEABLE_STOP_TIME")
        return [_seconds(_epoch(self.meta[key], f"{self.path}: {key}"), since) if key in self.meta else None
                for key in keys]

    def track(self, since: _Epoch) -> _Track:
        method = self.meta.get("INTERPOLATION", "HERMITE").lower()
        degree = int(self.meta["INTERPOLATION_DEGREE"]) if "INTERPOLATION_DEGREE" in self.meta else None
        state = 1e3 * self._columns(6)  # km, km/s
        try:
            return _Track(self.times_s(since), state[:, :3], state[:, 3:], method, degree, *self.usable(since))
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from None

    def turns(self, since: _Epoch, moon: str, camera_from_body: np.ndarray) -> _Turns:
        meta = self.meta
        kind = meta.get("ATTITUDE_TYPE", "missing").upper()
        if not kind.startswith("QUATERNION"):
            raise ValueError(f"{self.path}: ATTITUDE_TYPE is {kind}; QUATERNION is needed")
        frames = [meta.get(key, "").upper() for key in ("REF_FRAME_A", "REF_FRAME_B")]
        if (frames[0] == moon.upper()) == (frames[1] == moon.upper()):
            raise ValueError(f"{self.path}: REF_FRAME_A and REF_FRAME_B are {' and '.join(frames)}; one of them must "
                             f"be the OEM's REF_FRAME, {moon}, and the other the spacecraft's")
        q = self._columns(4)
        if meta.get("QUATERNION_TYPE", "LAST").upper() == "LAST":
            q = q[:, [3, 0, 1, 2]]
        # The rotation that carries the axes of A into those of B (A2B, the only one of version 2) gives a vector's
        # components in A from those in B.
        moon_from_body = (frames[0] == moon.upper()) == (meta.get("ATTITUDE_DIR", "A2B").upper() == "A2B")
        body_from_moon = q * [1, -1, -1, -1] if moon_from_body else q
        try:
            return _Turns(self.times_s(since), [_product(camera_from_body, row) for row in body_from_moon],
                          "camera_from_moon", *self.usable(since))
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from None

    def _columns(self, count: int) -> np.ndarray:
        short = next((i for i, row in enumerate(self.values) if len(row) < count), None)
        if short is not None:
            raise ValueError(f"{self.path}: a line of data has {len(self.values[short])} numbers; {count} are needed")
        return np.array([row[:count] for row in self.values])


def _read_kvn(path: Union[str, os.PathLike], kind: str) -> List[_Segment]:
    segments: List[_Segment] = []
    inside = "header"
    with open(path, encoding="utf-8-sig") as file:
        for number, line in enumerate(file, 1):
            line = line.strip()
            if not line or line.startswith("COMMENT"):
                continue
            if number == 1 and not line.startswith(f"CCSDS_{kind}_VERS"):
                raise ValueError(f"{path}: begins with {line[:40]!r}, not with CCSDS_{kind}_VERS; a text file (KVN) of "
                                 f"this kind is needed")
            if line == "META_START":
                segments.append(_Segment(os.fspath(path), {}))
            if line in ("META_START", "META_STOP", "DATA_START", "DATA_STOP", "COVARIANCE_START", "COVARIANCE_STOP"):
                inside = {"META_START": "meta", "COVARIANCE_START": "covariance"}.get(line, "data")
            elif inside == "meta" and "=" in line:
                key, value = line.split("=", 1)
                segments[-1].meta[key.strip()] = value.strip()
            elif inside == "data" and segments:
                words = line.split()
                segments[-1].epochs.append(_epoch(words[0], f"{path}, line {number}"))
                try:
                    segments[-1].values.append([float(word) for word in words[1:]])
                except ValueError as error:
                    raise ValueError(f"{path}, line {number}: {error}") from None
    if not segments or not all(segment.epochs for segment in segments):
        raise ValueError(f"{path}: a segment (META_START) with lines of data is needed")
    return segments


def _same(path: Any, segments: List[_Segment], key: str) -> str:
    values = {segment.meta.get(key, "missing") for segment in segments}
    if len(values) > 1:
        raise ValueError(f"{path}: {key} is {' and '.join(sorted(values))}; all segments need the same")
    return values.pop()


# --- Command line

MEDIA_TYPES = {".npz": "application/x-npz", ".npy": "application/x-npy", ".png": "image/png", ".tif": "image/tiff",
               ".tiff": "image/tiff", ".exr": "image/x-exr"}
DEFAULT_URL = "http://127.0.0.1:8080"


def _media_type(path: str) -> str:
    suffix = os.path.splitext(path)[1].lower()
    if suffix not in MEDIA_TYPES:
        raise ValueError(f"{path}: the suffix says the format; there are {' '.join(MEDIA_TYPES)}")
    return MEDIA_TYPES[suffix]


def _write(path: str, answer: Answer) -> None:
    """All of the file or nothing."""
    if answer.media_type == MEDIA_TYPES[".npz"]:
        Frame(answer)  # an answer that a proxy has cut off ends here
    part = f"{path}.{os.getpid()}.part"
    try:
        with open(part, "wb") as file:
            file.write(answer.content)
        os.replace(part, path)
    except BaseException:
        if os.path.exists(part):
            os.unlink(part)
        raise


def _read_request(path: str) -> Dict[str, Any]:
    with (open(path, encoding="utf-8") if path != "-" else os.fdopen(os.dup(0), encoding="utf-8")) as file:
        try:
            request = json.load(file)
        except ValueError as error:
            raise ValueError(f"{path}: no JSON: {error}") from None
    if not isinstance(request, dict):
        raise ValueError(f"{path}: a JSON object is needed")
    return request


def _stages(timing: Mapping[str, float]) -> str:
    # What is below a tenth of a millisecond tells nothing.
    return ", ".join(f"{stage} {ms:.1f}" for stage, ms in timing.items() if ms >= 0.1) or "nothing above 0.1"


def _warn_of(path: str, answer: Answer) -> None:
    """What the service says against a frame."""
    texts = _warnings_of(answer.headers)
    missing = answer.headers.get("Selenograph-Missing-Fraction")
    if missing:
        texts.append(f"{100 * float(missing):.3g} % of the pixels look at the Moon where there is no data")
    for text in texts:
        print(f"{path}: warning: {text}", file=sys.stderr)


def _render(options: argparse.Namespace) -> None:
    media_type = _media_type(options.output)
    with Client(options.url, options.token, options.timeout_s) as client:
        answer = client.encoded(_read_request(options.request), media_type)
    _write(options.output, answer)
    print(f"{options.output}: {len(answer.content)} bytes; ms: {_stages(answer.timing)}", flush=True)
    _warn_of(options.output, answer)


def _watched_request(options: argparse.Namespace, trajectory: Trajectory) -> Dict[str, Any]:
    """What all frames have in common."""
    request = _read_request(options.request) if options.request else {
        "camera": Camera.pinhole(width=512, height=512, fov_deg=50),
        "products": ["image"] if options.format == "png" else ["radiance"]}
    request.pop("pose", None)
    needs_sun = set(request.get("products", ["radiance"])) & NEED_SUN
    if needs_sun and "sun" not in request and trajectory.start is None:
        x, y, z = trajectory.position_m(float(trajectory.times_s[0]))
        place = {"lat_deg": math.degrees(math.atan2(z, math.hypot(x, y))), "lon_deg": math.degrees(math.atan2(y, x))}
        request["sun"] = Sun.local(**place, azimuth_deg=90, elevation_deg=30)
        print("no Sun is given, by a request's \"sun\" or by epochs (column utc): it stands in the east, 30 degrees "
              "high, at the first pose", file=sys.stderr)
    return request


def _steps(times_s: np.ndarray, step_s: float) -> np.ndarray:
    """From the first time to the last."""
    if not 0 < step_s < math.inf:
        raise ValueError(f"--step-s is {step_s:g}; seconds above 0 are needed")
    first, last = float(times_s[0]), float(times_s[-1])
    # 0.3 / 0.1 is an ulp below 3, and 3 * 0.1 an ulp above 0.3; seconds since an epoch have fewer digits yet.
    count = math.floor((last - first) / step_s + 1e-4) + 1
    return np.minimum(first + step_s * np.arange(count), last)


def _watch(options: argparse.Namespace) -> None:
    if options.trajectory.lower().endswith(".csv"):
        trajectory = Trajectory.from_csv(options.trajectory)
    else:
        azimuth = None if options.aem else options.up_azimuth_deg
        trajectory = Trajectory.from_ccsds(options.trajectory, options.aem, up_azimuth_deg=azimuth)
    times = trajectory.times_s if options.step_s is None else _steps(trajectory.times_s, options.step_s)
    requests = trajectory.requests(_watched_request(options, trajectory), times)
    os.makedirs(options.out, exist_ok=True)
    media_type = MEDIA_TYPES["." + options.format]
    with Client(options.url, options.token, options.timeout_s) as client:
        answers = client._in_order(requests, options.in_flight, options.ahead,
                                   lambda request: client.encoded(request, media_type))
        for i, (time_s, answer) in enumerate(zip(times, answers)):
            path = os.path.join(options.out, f"{i:05d}.{options.format}")
            _write(path, answer)
            print(f"{path}  t = {time_s:.3f} s  ms: {_stages(answer.timing)}", flush=True)
            _warn_of(path, answer)


def main(arguments: Optional[Sequence[str]] = None) -> int:
    parser = argparse.ArgumentParser(prog="python3 -m selenograph",
                                     description="Asks a selenograph service for frames.")
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--url", default=os.environ.get("SELENOGRAPH_URL", DEFAULT_URL),
                        help="of the service (default: SELENOGRAPH_URL, else %(default)s)")
    common.add_argument("--token", default=os.environ.get("SELENOGRAPH_TOKEN"),
                        help="bearer token (default: SELENOGRAPH_TOKEN)")
    common.add_argument("--timeout-s", type=float, default=60.0, help="for one frame (default: %(default)s)")
    commands = parser.add_subparsers(required=True, metavar="command")
    render = commands.add_parser("render", parents=[common], help="one request to one file")
    render.add_argument("request", help="JSON file as for POST /v1/frames; -: standard input")
    render.add_argument("output", help="frame to write: " + " ".join(MEDIA_TYPES))
    render.set_defaults(run=_render)
    watch = commands.add_parser("watch", parents=[common], help="a frame for each pose of a trajectory")
    watch.add_argument("trajectory", help=".csv (Trajectory.from_csv lists its columns), or a CCSDS OEM as text (KVN)")
    watch.add_argument("--aem", help="CCSDS AEM as text: the attitudes of an OEM's positions")
    watch.add_argument("--up-azimuth-deg", type=float, default=0.0,
                       help="of an OEM without AEM: the camera looks at nadir, with this azimuth up (default: 0)")
    watch.add_argument("--out", required=True, metavar="DIR", help="folder for the frames, 00000.npz and so on")
    watch.add_argument("--request", help="JSON file with what all frames have in common; its pose is not used "
                       "(default: a camera of 512 x 512 pixels and 50 degrees, the Sun of the epoch)")
    watch.add_argument("--format", default="npz", choices=[suffix[1:] for suffix in MEDIA_TYPES],
                       help="of the files (default: %(default)s)")
    watch.add_argument("--step-s", type=float, help="time between frames (default: the trajectory's own times)")
    watch.add_argument("--in-flight", type=int, default=2, help="requests under way at a time (default: %(default)s)")
    watch.add_argument("--ahead", type=int, default=4, help="poses told in advance (default: %(default)s)")
    watch.set_defaults(run=_watch)
    options = parser.parse_args(arguments)
    try:
        options.run(options)
    except BrokenPipeError:  # before OSError: the reader of our lines has left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (Refused, OSError, ValueError) as error:
        print(f"selenograph: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
