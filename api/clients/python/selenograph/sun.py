"""Direction, distance and size of the Sun."""

from __future__ import annotations

import datetime
from typing import Any, Union

from .epochs import utc_text
from .rotations import Vector, finite_vector


class Sun(dict):
    """The "sun" of a request. Each constructor also takes:

    distance_au         scales irradiance by 1/r^2; left out: 1, or the ephemeris' with utc
    angular_radius_deg  0: a point Sun, hard shadows; "sun": penumbra, by the distance; left out: 0, or "sun" with utc
    """

    @classmethod
    def direction(cls, vector: Vector, **more: Any) -> Sun:
        """Takes a MOON_ME vector toward the Sun (against the direction of its light), of any length."""
        return cls(direction=finite_vector(vector, 3, "vector").tolist(), **more)

    @classmethod
    def subsolar(cls, *, lat_deg: float, lon_deg: float, **more: Any) -> Sun:
        """Takes the point that has the Sun in its zenith."""
        return cls(subsolar={"lat_deg": float(lat_deg), "lon_deg": float(lon_deg)}, **more)

    @classmethod
    def local(cls, *, lat_deg: float, lon_deg: float, azimuth_deg: float, elevation_deg: float, **more: Any) -> Sun:
        """Takes the Sun's azimuth, clockwise from north, and elevation above the local horizontal at a point."""
        return cls(local={"lat_deg": float(lat_deg), "lon_deg": float(lon_deg), "azimuth_deg": float(azimuth_deg),
                          "elevation_deg": float(elevation_deg)}, **more)

    @classmethod
    def utc(cls, when: Union[str, datetime.datetime], **more: Any) -> Sun:
        """Takes an epoch: ISO 8601, e.g. "2026-11-20T00:00:00Z", or a datetime with its time zone."""
        return cls(utc=when if isinstance(when, str) else utc_text(when), **more)

    @classmethod
    def et(cls, et_s: float, **more: Any) -> Sun:
        """Takes SPICE's Ephemeris Time: seconds of TDB since J2000.0, as str2et gives them."""
        return cls(et_s=float(et_s), **more)
