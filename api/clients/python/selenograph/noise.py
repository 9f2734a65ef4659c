"""Noise of its own for each of many frames."""

from __future__ import annotations

from typing import Any, Dict

from .request_types import AnyFrameRequest


def numbered_sensor(request: AnyFrameRequest, number: int) -> Dict[str, Any]:
    """Returns the "sensor" of a frame of many, with `number` as its "frame" unless it has one; empty without a sensor.

    Frames of one number have the same noise. A "camera_preset" is taken to have a sensor.
    """
    sensor = request.get("sensor", {} if "camera_preset" in request else None)
    return {} if sensor is None else {"sensor": {"frame": number, **sensor}}
