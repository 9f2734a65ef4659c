"""The header Selenograph-Region: the cell of the Moon that a request is about.

Cells are about 120 km wide: rows of 4 degrees of latitude, each divided into columns by its length. A proxy in front of
several nodes sends neighbouring views to the node that has their terrain in memory.
"""

from __future__ import annotations

import math
from typing import Any, Mapping, Optional, Tuple

from .moon import INERTIAL, lat_lon_of

REGION_DEG = 4.0  # height of a row of cells


def region_of(document: Any) -> Optional[str]:
    """Returns the row and column of a request's cell as "22-7"; None where the request names no place.

    Faults of the request are left for the service to report.
    """
    try:
        lat_deg, lon_deg = _location(document)
        row = min(math.floor((lat_deg + 90) / REGION_DEG), round(180 / REGION_DEG) - 1)
        middle_lat_rad = math.radians((row + 0.5) * REGION_DEG - 90)
        columns = max(1, round(360 / REGION_DEG * math.cos(middle_lat_rad)))
        return f"{row}-{math.floor(lon_deg % 360 / 360 * columns) % columns}" if row >= 0 else None
    except (ArithmeticError, AttributeError, IndexError, LookupError, TypeError, ValueError):
        return None


def _location(document: Any) -> Tuple[float, float]:
    """Returns latitude and longitude of the camera, map, ray or point. Raises LookupError and the like without one."""
    pose = document.get("pose")
    if pose is None and document.get("cameras"):
        pose = next(iter(document["cameras"].values()))["pose"]
    if pose is not None:
        if "geodetic" in pose:
            return _lat_lon(pose["geodetic"])
        if "position_m" in pose and pose.get("frame") not in INERTIAL:
            return lat_lon_of(pose["position_m"])
        return _lat_lon(pose["look_at"])
    if "map" in document:
        return _lat_lon(document["map"]["center"])
    if "rays" in document:
        return lat_lon_of(document["rays"][0]["origin_m"])
    return _lat_lon(document["places" if "places" in document else "points"][0])


def _lat_lon(location: Mapping[str, Any]) -> Tuple[float, float]:
    return float(location["lat_deg"]), float(location["lon_deg"])
