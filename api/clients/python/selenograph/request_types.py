"""Types of requests, for editors and type checkers.

Each class lists the members of one request of the API document (/openapi.json). At run time requests are plain dicts,
which the service checks. python_types_test.py checks the members and their types against the document.
"""

from __future__ import annotations

from typing import Any, Mapping, Optional, Sequence, TypedDict, Union

Request = Mapping[str, Any]
Switch = Union[bool, Request]  # true, or an object of settings


class FrameRequest(TypedDict, total=False):
    """POST /v1/frames."""

    camera: Request
    camera_preset: str
    cameras: Mapping[str, Request]
    pose: Request
    shutter: Request
    sun: Request
    indirect: Request
    detail: Optional[str]
    surface: Request
    band: Request
    sky: Request
    atmosphere: Request
    objects: Sequence[Request]
    terrain: bool
    visibility: str
    accuracy: Request
    sensor: Request
    image: Request
    products: Sequence[str]
    flow_to: Request
    craters: Switch
    labels: bool
    truth: Request
    ahead: Sequence[Request]
    echo: Request
    compression: str


class MapError(TypedDict, total=False):
    """`map_error` of POST /v1/maps, /v1/rays and /v1/heights: how a lander's map differs from the terrain."""

    preset: str
    seed: int
    missing_craters_below_m: float
    resolution_m: float
    about: Request
    shift: Request
    scale: float
    tilt: Request
    height: Sequence[Request]
    albedo: Sequence[Request]


AnyMapError = Union[MapError, Request]


class MapRequest(TypedDict, total=False):
    """POST /v1/maps."""

    map: Request
    sun: Request
    indirect: Request
    detail: Optional[str]
    surface: Request
    map_error: AnyMapError
    band: Request
    view: Union[str, Request]
    accuracy: Request
    rocks: bool
    footprint: Request
    hazard: Request
    products: Sequence[str]


class LidarRequest(TypedDict, total=False):
    """POST /v1/lidar."""

    instrument: Request
    instrument_preset: str
    pulses: Sequence[Request]
    pattern: Request
    pose: Request
    motion: Request
    seed: int
    scan: int
    craters: Switch
    detail: Optional[str]
    surface: Request
    objects: Sequence[Request]


class SkyRequest(TypedDict, total=False):
    """POST /v1/sky."""

    camera: Request
    camera_preset: str
    pose: Request
    shutter: Request
    utc: str
    et_s: float
    sky: Request
    band: Request
    sensor: Request
    detail: Optional[str]
    objects: Sequence[Request]


class HorizonsRequest(TypedDict, total=False):
    """POST /v1/horizons."""

    map: Request
    places: Sequence[Request]
    detail: Optional[str]
    horizon: Request


class IlluminationRequest(HorizonsRequest, total=False):
    """POST /v1/illumination."""

    from_utc: str
    to_utc: str
    step_s: float


class Light(TypedDict, total=False):
    """Members of POST /v1/rays and /v1/project for irradiance."""

    indirect: Request
    surface: Request
    band: Request


class Region(TypedDict):
    """Bounds of an area; west may be greater than east, across the date line."""

    south_deg: float
    north_deg: float
    west_deg: float
    east_deg: float


# Each call also takes a dict whose members a type checker does not know.
AnyFrameRequest = Union[FrameRequest, Request]
AnyMapRequest = Union[MapRequest, Request]
AnyLidarRequest = Union[LidarRequest, Request]
AnySkyRequest = Union[SkyRequest, Request]
AnyHorizonsRequest = Union[HorizonsRequest, Request]
AnyIlluminationRequest = Union[IlluminationRequest, Request]
AnyLight = Union[Light, Request]
AnyRegion = Union[Region, Request]
