"""Numbers of frames, so that each has its own noise."""

from __future__ import annotations

from typing import Any, Dict, Mapping

from .request_types import AnyFrameRequest


def numbered_sensors(request: AnyFrameRequest, number: int) -> Dict[str, Any]:
    """Returns the members of a frame of many that number its sensors: "sensor.frame" is `number` unless it is there."""
    changes = _numbered(request, number)
    cameras = request.get("cameras")
    if isinstance(cameras, Mapping):
        changes["cameras"] = {name: {**camera, **_numbered(camera, number)} for name, camera in cameras.items()}
    return changes


def _numbered(part: Mapping[str, Any], number: int) -> Dict[str, Any]:
    # The service ignores a number alone where the preset has no sensor.
    sensor = part.get("sensor", {} if "camera_preset" in part else None)
    return {} if sensor is None else {"sensor": {"frame": number, **sensor}}
