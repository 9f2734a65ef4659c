"""The Moon's reference sphere and its frames."""

from __future__ import annotations

import math
from typing import Any, Mapping, Tuple

import numpy as np

MOON_RADIUS_M = 1737400.0  # radius of the sphere that heights refer to
INERTIAL = ("ICRF", "J2000")  # frames in which the Moon rotates: their poses need an epoch


def zenith(lat_rad: float, lon_rad: float) -> np.ndarray:
    """Returns the unit vector from the Moon's centre through a place, MOON_ME."""
    return np.array([math.cos(lat_rad) * math.cos(lon_rad), math.cos(lat_rad) * math.sin(lon_rad), math.sin(lat_rad)])


def position_of(position: Mapping[str, Any]) -> np.ndarray:
    """Returns the vector from the Moon's centre, in metres, of a pose's `position_m` or `geodetic`."""
    if "position_m" in position:
        return np.asarray(position["position_m"], float)
    if "height_m" not in position["geodetic"]:
        raise ValueError("only the service knows the ground below height_above_ground_m: write height_m")
    return (MOON_RADIUS_M + position["geodetic"]["height_m"]) * direction_of(position)


def direction_of(position: Mapping[str, Any]) -> np.ndarray:
    """Returns a vector from the Moon's centre toward a pose's `position_m` or `geodetic`."""
    if "position_m" in position:
        return np.asarray(position["position_m"], float)
    geodetic = position["geodetic"]
    return zenith(math.radians(geodetic["lat_deg"]), math.radians(geodetic["lon_deg"]))


def lat_lon_of(position_m: Any) -> Tuple[float, float]:
    """Returns latitude and longitude, in degrees, of a vector from the Moon's centre."""
    x, y, z = (float(c) for c in position_m)
    return math.degrees(math.atan2(z, math.hypot(x, y))), math.degrees(math.atan2(y, x))
