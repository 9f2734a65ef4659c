"""Orbit and Attitude Ephemeris Messages of CCSDS (502.0, 504.0), as KVN text."""

from __future__ import annotations

import dataclasses
import os
from typing import Any, Dict, List, Optional, Union

import numpy as np

from .epochs import Epoch, parse_epoch, seconds_since
from .interpolation import Track, Turns
from .rotations import product

# Names of pose.frame by the REF_FRAME of files, which has the names of the service, SPICE or SANA.
FRAMES = {"MOON_ME": "MOON_ME", "MOON_ME_DE421": "MOON_ME", "MOON_ME_DE440_ME421": "MOON_ME",
          "MOON_PA_DE421": "MOON_PA_DE421", "MOON_PA421": "MOON_PA_DE421", "MOON_PA_DE440": "MOON_PA_DE440",
          "MOON_PA440": "MOON_PA_DE440", "ICRF": "ICRF"}
ICRF_NAMES = ("ICRF", "EME2000", "J2000")  # axes that differ by 0.02 arcseconds
METRES_PER_KM = 1e3
STATE_NUMBERS = 6  # numbers of a line in an OEM: position (km) and velocity (km/s)
MARKERS = {"META_START": "meta", "META_STOP": "data", "DATA_START": "data", "DATA_STOP": "data",
           "COVARIANCE_START": "covariance", "COVARIANCE_STOP": "data"}  # section that follows each line

Path = Union[str, os.PathLike]


@dataclasses.dataclass
class Segment:
    """Metadata and lines of data of one segment in an OEM or AEM."""

    path: str
    meta: Dict[str, str]
    epochs: List[Epoch] = dataclasses.field(default_factory=list)
    values: List[List[float]] = dataclasses.field(default_factory=list)

    def track(self, origin: Epoch) -> Track:
        """Returns the positions of an OEM, with times since `origin`."""
        method = self.meta.get("INTERPOLATION", "HERMITE").lower()
        degree = int(self.meta["INTERPOLATION_DEGREE"]) if "INTERPOLATION_DEGREE" in self.meta else None
        state = METRES_PER_KM * self._columns(STATE_NUMBERS)
        try:
            return Track(self._times_s(origin), state[:, :3], state[:, 3:], method, degree, *self._usable_s(origin))
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from None

    def turns(self, origin: Epoch, moon_frame: str, camera_from_body: np.ndarray) -> Turns:
        """Returns the attitudes of an AEM as camera_from_moon, with times since `origin`.

        moon_frame: the OEM's REF_FRAME. camera_from_body: quaternion.
        """
        meta = self.meta
        attitude_type = meta.get("ATTITUDE_TYPE", "missing").upper()
        if not attitude_type.startswith("QUATERNION"):
            raise ValueError(f"{self.path}: ATTITUDE_TYPE is {attitude_type}; QUATERNION is needed")
        frames = [meta.get(key, "").upper() for key in ("REF_FRAME_A", "REF_FRAME_B")]
        if (frames[0] == moon_frame.upper()) == (frames[1] == moon_frame.upper()):
            raise ValueError(f"{self.path}: REF_FRAME_A and REF_FRAME_B are {' and '.join(frames)}; one of them must "
                             f"be the OEM's REF_FRAME, {moon_frame}, and the other the spacecraft's")
        q = self._columns(4)
        if meta.get("QUATERNION_TYPE", "LAST").upper() == "LAST":
            q = q[:, [3, 0, 1, 2]]
        # The rotation that carries the axes of A into those of B (A2B, the only one of version 2) gives a vector's
        # components in A from those in B.
        is_moon_from_body = (frames[0] == moon_frame.upper()) == (meta.get("ATTITUDE_DIR", "A2B").upper() == "A2B")
        body_from_moon = q * [1, -1, -1, -1] if is_moon_from_body else q
        camera_from_moon = [product(camera_from_body, row) for row in body_from_moon]
        try:
            return Turns(self._times_s(origin), camera_from_moon, "camera_from_moon", *self._usable_s(origin))
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from None

    def _times_s(self, origin: Epoch) -> List[float]:
        return [seconds_since(origin, epoch) for epoch in self.epochs]

    def _usable_s(self, origin: Epoch) -> List[Optional[float]]:
        """Returns the first and the last time at which the segment may be used; None without a limit."""
        keys = ("USEABLE_START_TIME", "USEABLE_STOP_TIME")
        return [seconds_since(origin, parse_epoch(self.meta[key], f"{self.path}: {key}")) if key in self.meta else None
                for key in keys]

    def _columns(self, count: int) -> np.ndarray:
        """Returns the first `count` numbers of each line."""
        short = next((row for row in self.values if len(row) < count), None)
        if short is not None:
            raise ValueError(f"{self.path}: a line of data has {len(short)} numbers; {count} are needed")
        return np.array([row[:count] for row in self.values])


def read_kvn(path: Path, kind: str) -> List[Segment]:
    """Returns the segments of an "OEM" or "AEM"."""
    segments: List[Segment] = []
    section = "header"
    with open(path, encoding="utf-8-sig") as file:
        for number, line in enumerate(file, 1):
            line = line.strip()
            if not line or line.startswith("COMMENT"):
                continue
            if number == 1 and not line.startswith(f"CCSDS_{kind}_VERS"):
                raise ValueError(f"{path}: begins with {line[:40]!r}, not with CCSDS_{kind}_VERS; a text file (KVN) of "
                                 f"this kind is needed")
            if line == "META_START":
                segments.append(Segment(os.fspath(path), {}))
            if line in MARKERS:
                section = MARKERS[line]
            elif section == "meta" and "=" in line:
                key, value = line.split("=", 1)
                segments[-1].meta[key.strip()] = value.strip()
            elif section == "data" and segments:
                _append_data(segments[-1], line, f"{path}, line {number}")
    if not segments or not all(segment.epochs for segment in segments):
        raise ValueError(f"{path}: a segment (META_START) with lines of data is needed")
    return segments


def _append_data(segment: Segment, line: str, where: str) -> None:
    epoch, *numbers = line.split()
    segment.epochs.append(parse_epoch(epoch, where))
    try:
        segment.values.append([float(number) for number in numbers])
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def common_value(path: Any, segments: List[Segment], key: str) -> str:
    """Returns the value of a key, which must be the same in all segments; "missing" without one."""
    values = {segment.meta.get(key, "missing") for segment in segments}
    if len(values) > 1:
        raise ValueError(f"{path}: {key} is {' and '.join(sorted(values))}; all segments need the same")
    return values.pop()
