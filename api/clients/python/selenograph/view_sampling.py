r"""Random views for campaigns and training sets.

      camera *   |
             |\  |      altitude: height of the camera above the target's horizontal plane
    altitude | \ |      off-nadir angle: between the target's vertical and the line of sight
             |  \|
    ---------+---* target: the place on the ground in the image's middle
"""

from __future__ import annotations

import math
from typing import Any, Dict, Iterator, Mapping, NamedTuple, Optional, Tuple

import numpy as np

from .answers import Frame
from .client import Client
from .errors import Refused
from .moon import MOON_RADIUS_M, zenith
from .noise import numbered_sensors
from .pose import Pose
from .request_types import AnyFrameRequest, AnyRegion
from .sun import Sun

PREVIEW_PX = 32  # longer side of the small frame that tells whether a view has data
MAX_OFF_NADIR_DEG = 85
MIN_ALTITUDE_M = 1e-3
# ValueError after more than FREE_REJECTIONS + REJECTIONS_PER_VIEW * (number of views) rejected views.
FREE_REJECTIONS = 20
REJECTIONS_PER_VIEW = 19

Interval = Tuple[float, float]  # lower and upper bound


def random_views(client: Client, request: AnyFrameRequest, count: int, *, region: AnyRegion,
                 altitude_m: Interval, off_nadir_deg: Interval = (0, 0), sun_elevation_deg: Interval = (5, 60),
                 seed: int = 0) -> Iterator[Dict[str, Any]]:
    """Yields the request with `count` random poses and Suns, as for a training set. Each has a "name" for a manifest.
    A sensor without a "frame" gets 0, 1, 2 .., so that each frame has its own noise.

    region              south_deg, north_deg, west_deg, east_deg of the targets, the places in the image's middle;
                        uniform by area
    altitude_m          (lower, upper) bound of the camera's height above the target's ground; uniform by its logarithm
    off_nadir_deg       (lower, upper) bound of the angle between the line of sight and the target's vertical, below 85;
                        from any side
    sun_elevation_deg   (lower, upper) bound at the target; from any azimuth

    Angles are uniform; the image is turned at random, too. The service renders a small frame of each view (of a
    "camera_preset" a whole one); views of ground without data are drawn again: ValueError when they are nineteen of
    twenty. The same seed gives the same views.
    """
    if "camera" not in request and "camera_preset" not in request:
        raise ValueError('the request has neither "camera" nor "camera_preset"; one is needed')
    _check_interval("altitude_m", altitude_m, MIN_ALTITUDE_M, math.inf)
    _check_interval("off_nadir_deg", off_nadir_deg, 0, MAX_OFF_NADIR_DEG)
    _check_interval("sun_elevation_deg", sun_elevation_deg, -90, 90)
    generator = np.random.default_rng(seed)
    rejected = 0
    for number in range(count):
        while True:
            draw = _draw(generator, region, altitude_m, off_nadir_deg, sun_elevation_deg)
            view = _view_of(client, draw, request.get("detail"))
            if view is not None and _has_data(client, request, view):
                break
            rejected += 1
            if rejected > FREE_REJECTIONS + REJECTIONS_PER_VIEW * (number + 1):
                raise ValueError(f"of {rejected + number} views drawn {rejected} see ground without data, or none: is "
                                 "the region within the service's tiles?")
        yield {**request, **view, **numbered_sensors(request, number), "name": f"{number:06d}"}


class _Draw(NamedTuple):
    """Random numbers of one view."""

    lat_rad: float  # latitude of the target
    lon_rad: float  # longitude of the target
    altitude_m: float
    off_nadir_rad: float
    side_rad: float  # azimuth of the camera from the target
    roll_rad: float  # azimuth of up in the image
    sun_azimuth_deg: float
    sun_elevation_deg: float


def _check_interval(name: str, interval: Interval, min_value: float, max_value: float) -> None:
    lower, upper = interval
    if not min_value <= lower <= upper <= max_value:
        raise ValueError(f"{name}=({lower}, {upper}) must be (lower, upper) within {min_value:g} and {max_value:g}")


def _draw(generator: np.random.Generator, region: AnyRegion, altitude_m: Interval, off_nadir_deg: Interval,
          sun_elevation_deg: Interval) -> _Draw:
    sines = np.sin(np.radians([region["south_deg"], region["north_deg"]]))
    lat_rad = math.asin(generator.uniform(*sines))
    west_deg = region["west_deg"]
    east_deg = region["east_deg"]
    lon_rad = math.radians(generator.uniform(west_deg, east_deg if east_deg > west_deg else east_deg + 360))
    altitude = math.exp(generator.uniform(*np.log(altitude_m)))
    off_nadir_rad, side_rad, roll_rad = np.radians(
        [generator.uniform(*off_nadir_deg), generator.uniform(0, 360), generator.uniform(0, 360)])
    sun_azimuth_deg = generator.uniform(0, 360)
    sun_elevation = generator.uniform(*sun_elevation_deg)
    return _Draw(lat_rad, lon_rad, altitude, off_nadir_rad, side_rad, roll_rad, sun_azimuth_deg, sun_elevation)


def _view_of(client: Client, draw: _Draw, detail: Optional[str]) -> Optional[Dict[str, Any]]:
    """Returns pose and Sun; None where the target's ground has no height."""
    lat_deg = math.degrees(draw.lat_rad)
    lon_deg = (math.degrees(draw.lon_rad) + 180) % 360 - 180
    ground_m = float(client.heights(lat_deg, lon_deg, detail=detail).height_m)
    if math.isnan(ground_m):
        return None
    up = zenith(draw.lat_rad, draw.lon_rad)
    east = np.array([-math.sin(draw.lon_rad), math.cos(draw.lon_rad), 0])
    north = np.cross(up, east)
    toward_camera = math.sin(draw.side_rad) * east + math.cos(draw.side_rad) * north
    camera_m = (MOON_RADIUS_M + ground_m) * up + draw.altitude_m * (up + math.tan(draw.off_nadir_rad) * toward_camera)
    pose = Pose.look_at(target_lat_deg=lat_deg, target_lon_deg=lon_deg, target_height_m=ground_m,
                        up=math.sin(draw.roll_rad) * east + math.cos(draw.roll_rad) * north, position_m=camera_m)
    sun = Sun.local(lat_deg=lat_deg, lon_deg=lon_deg, azimuth_deg=draw.sun_azimuth_deg,
                    elevation_deg=draw.sun_elevation_deg)
    return {"pose": pose, "sun": sun}


def _has_data(client: Client, request: AnyFrameRequest, view: Mapping[str, Any]) -> bool:
    """Tells whether a small frame of the view shows ground, and all of its ground has data."""
    lens: Dict[str, Any]
    if "camera" in request:
        lens = {"camera": _preview_camera(request["camera"])}
    else:
        lens = {"camera_preset": request["camera_preset"]}
    preview = {**lens, "pose": view["pose"], "products": ["depth"]}
    try:
        # Ignore the frame's warnings: they concern the small frame only.
        frame = Frame(client.encoded(preview, "application/x-npz"))
    except Refused as refused:
        # The service answers 422 for a camera below the ground.
        if refused.status != 422:
            raise
        return False
    return frame.meta["missing_fraction"] == 0 and frame.meta["hit_fraction"] > 0


def _preview_camera(camera: Mapping[str, Any]) -> Dict[str, Any]:
    """Returns the same lens with PREVIEW_PX pixels along the image's longer side."""
    scale = PREVIEW_PX / max(camera["width"], camera["height"])
    size = {name: max(1, round(scale * camera[name])) for name in ("width", "height")}
    scales = {name: size[name] / camera[name] for name in size}
    preview = {**camera, **size}
    for name, side in (("fx", "width"), ("fy", "height")):
        if name in camera:
            preview[name] = camera[name] * scales[side]
    for name, side in (("cx", "width"), ("cy", "height")):
        if name in camera:
            # Scale from the image's corner, which lies half a pixel before the centre of pixel 0.
            preview[name] = (camera[name] + 0.5) * scales[side] - 0.5
    if "pixel_pitch_um" in camera:
        preview["pixel_pitch_um"] = camera["pixel_pitch_um"] / scales["width"]
    return preview
