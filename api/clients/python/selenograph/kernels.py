"""Positions and the Moon's orientation from SPICE kernels."""

from __future__ import annotations

import datetime
import math
from typing import Any, Dict, Iterable, List, Optional, Union

import numpy as np

from .ccsds import METRES_PER_KM, Path
from .epochs import et_of
from .interpolation import Track
from .sun import Sun

When = Union[str, datetime.datetime]

# NAIF's codes of bodies and of orientations of the Moon.
BARYCENTRE = 0
SUN = 10
MOON = 301
EARTH = 399
# Of the bodies of the sky, in the order in which kernels are searched: planetary ephemerides have only the barycentres of
# the outer planets and their moons.
SKY_BODIES = {"sun": (SUN,), "earth": (EARTH,), "mercury": (199, 1), "venus": (299, 2), "mars": (499, 4),
              "jupiter": (599, 5), "saturn": (699, 6), "uranus": (799, 7), "neptune": (899, 8)}
MOON_FRAMES = {31006: "MOON_PA_DE421", 31008: "MOON_PA_DE440"}
J2000 = 1

# Angles in arcseconds by which MOON_ME (DE421's) is turned about z, y, x from each frame's principal axes: Williams et
# al. 2008 (JPL IOM 335-JW,DB,WF-20080314-001), Park et al. 2021 (AJ 161:105).
ME_ANGLES_ARCSEC = {"MOON_PA_DE421": (67.92, 78.56, 0.30), "MOON_PA_DE440": (67.8526, 78.6944, 0.2785)}

CHEBYSHEV = (2, 3)  # SPK types, which jplephem evaluates
LAGRANGE = (8, 9)
HERMITE = (12, 13)
EQUAL_STEPS = (8, 12)

AU_M = 149597870700.0
LIGHT_M_S = 299792458.0
JD_J2000 = 2451545.0
DAY_S = 86400.0
VELOCITY_STEP_S = 100.0  # velocities from differences: the Moon's to 1e-6 m/s


class Kernels:
    """SPICE kernels: positions from SPK files, the Moon's orientation from a binary PCK. Needs jplephem.

    Kernels("lander.bsp", "de440s.bsp", "moon_pa_de440_200625.bpc")

    SPK types 2, 3, 8, 9, 12 and 13 in J2000, PCK type 2. Where segments overlap, the last one of the last file counts,
    as in SPICE. Times et_s are Ephemeris Time, seconds of TDB since J2000.0; bodies are NAIF's codes.
    """

    def __init__(self, *paths: Path) -> None:
        try:
            import jplephem.pck  # type: ignore
            import jplephem.spk  # type: ignore
        except ImportError:
            raise ImportError("SPICE kernels are read by jplephem: apt-get install python3-jplephem, or "
                              "pip install jplephem") from None
        self._spk: List[Any] = []  # segments, those that count first in front
        self._pck: List[Any] = []
        self._tracks: Dict[int, Track] = {}
        self._open: List[Any] = []
        for path in paths:
            with open(path, "rb") as file:
                kind = file.read(8)
            if kind in (b"DAF/SPK ", b"NAIF/DAF"):
                self._open.append(jplephem.spk.SPK.open(path))
                self._spk = self._open[-1].segments[::-1] + self._spk
            elif kind == b"DAF/PCK ":
                self._open.append(jplephem.pck.PCK.open(path))
                segments = [s for s in self._open[-1].segments if s.body in MOON_FRAMES]
                self._pck = segments[::-1] + self._pck
                if not segments:
                    self.close()
                    raise ValueError(f"{path}: no orientation of the Moon; {' or '.join(MOON_FRAMES.values())} is "
                                     "needed")
            else:
                self.close()
                raise ValueError(f"{path}: begins with {kind!r}; an SPK or a binary PCK is needed")

    def __enter__(self) -> Kernels:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the files. Positions are not available afterwards."""
        for kernel in self._open:
            kernel.close()

    @property
    def moon_frame(self) -> Optional[str]:
        """The name of the orientation in requests, MOON_PA_DE440 or MOON_PA_DE421; None without a PCK."""
        return MOON_FRAMES[self._pck[0].body] if self._pck else None

    @property
    def has_sun(self) -> bool:
        """Whether there are the Sun and the Moon, as in a planetary ephemeris."""
        return {SUN, MOON} <= {segment.target for segment in self._spk}

    def position_m(self, body: int, et_s: float, center: int = MOON) -> np.ndarray:
        """Returns the position of a body relative to another one, ICRF, without light time."""
        of_body = self._offsets_km(body, et_s)
        of_center = self._offsets_km(center, et_s)
        common = next((origin for origin in of_body if origin in of_center), None)
        if common is None:
            raise ValueError(f"no kernel has the position of {body} relative to {center} at et_s = {et_s:.3f}; there "
                             f"are {self._spans() or 'none'}")
        return METRES_PER_KM * (of_body[common] - of_center[common])

    def apparent_m(self, body: int, et_s: float) -> np.ndarray:
        """Returns the position in which a body appears from the Moon's centre, ICRF: with light time and aberration.

        Its length is the distance that the light has come. Deflection by the Sun is left out.
        """
        offset = self._at_departure_m(body, et_s)
        distance = float(np.linalg.norm(offset))
        return distance * aberrated(offset / distance, self._velocity_m_s(MOON, et_s) / LIGHT_M_S)

    def moon_from_icrf(self, et_s: float) -> np.ndarray:
        """Returns the rotation matrix from ICRF into `moon_frame`."""
        of_frame = [s for s in self._pck if s.body == self._pck[0].body]
        segment = next((s for s in of_frame if s.initial_second <= et_s <= s.final_second), None)
        if segment is None:
            raise ValueError(f"no kernel has the Moon's orientation at et_s = {et_s:.3f}; a binary PCK is needed, such "
                             "as moon_pa_de440_200625.bpc")
        phi, delta, w = segment.compute(JD_J2000, et_s / DAY_S, derivative=False)
        return turned_axes(2, w) @ turned_axes(0, delta) @ turned_axes(2, phi)

    def moon_me_from_icrf(self, et_s: float) -> np.ndarray:
        """Returns the rotation matrix from ICRF into MOON_ME."""
        moon_from_icrf = self.moon_from_icrf(et_s)
        z, y, x = (-math.radians(angle / 3600) for angle in ME_ANGLES_ARCSEC[self.moon_frame or ""])
        return turned_axes(0, x) @ turned_axes(1, y) @ turned_axes(2, z) @ moon_from_icrf

    def sun(self, when: When) -> Sun:
        """Returns the "sun" of a request at an epoch: direction, distance and size. Needs a PCK."""
        et_s = et_of(when)
        offset = self.apparent_m(SUN, et_s)
        return Sun.direction(self.moon_me_from_icrf(et_s) @ offset, distance_au=float(np.linalg.norm(offset)) / AU_M,
                             angular_radius_deg="sun")

    def earth(self, when: When) -> Dict[str, Any]:
        """Returns the Earth at an epoch, as `indirect.earth` of a request. Needs a PCK."""
        et_s = et_of(when)
        offset = self.apparent_m(EARTH, et_s)
        direction = self.moon_me_from_icrf(et_s) @ offset / np.linalg.norm(offset)
        return {"direction": direction.tolist(), "distance_m": float(np.linalg.norm(offset))}

    def sky_states(self, when: When, bodies: Optional[Iterable[str]] = None) -> Dict[str, Dict[str, List[float]]]:
        """Returns the `sky.states` of a request at an epoch, which is to be the sky's: spkezr's with "LT", in metres.

        bodies: their names ("sun", "earth", "venus", ...); left out: all that the kernels have then. Needs no PCK.
        """
        et_s = et_of(when)
        states = {}
        for body in SKY_BODIES if bodies is None else bodies:
            code = self._sky_body(body, et_s, required=bodies is not None)
            if code is None:
                continue
            offset = self._at_departure_m(code, et_s)
            departure_s = et_s - float(np.linalg.norm(offset)) / LIGHT_M_S
            velocity = self._velocity_m_s(code, departure_s) - self._velocity_m_s(MOON, et_s)
            states[body] = {"position_m": offset.tolist(), "velocity_m_s": velocity.tolist()}
        return states

    def _sky_body(self, body: str, et_s: float, required: bool) -> Optional[int]:
        """Returns the code by which the kernels have a body of the sky, None without one."""
        if body not in SKY_BODIES:
            raise ValueError(f"{body!r} is not a body of the sky; there are {', '.join(SKY_BODIES)}")
        codes = SKY_BODIES[body]
        found = next((code for code in codes if BARYCENTRE in self._offsets_km(code, et_s)), None)
        if found is None and required:
            self.position_m(codes[-1], et_s, BARYCENTRE)  # reports what is missing
        return found

    def _at_departure_m(self, body: int, et_s: float) -> np.ndarray:
        """Returns a body's position when the light left that reaches the Moon's centre, from the Moon then, ICRF."""
        observer = self.position_m(MOON, et_s, BARYCENTRE)
        offset = self.position_m(body, et_s, BARYCENTRE) - observer
        for _ in range(3):
            light_time_s = float(np.linalg.norm(offset)) / LIGHT_M_S
            offset = self.position_m(body, et_s - light_time_s, BARYCENTRE) - observer
        return offset

    def _velocity_m_s(self, body: int, et_s: float) -> np.ndarray:
        """Returns a body's barycentric velocity, ICRF."""
        later = self.position_m(body, et_s + VELOCITY_STEP_S, BARYCENTRE)
        earlier = self.position_m(body, et_s - VELOCITY_STEP_S, BARYCENTRE)
        return (later - earlier) / (2 * VELOCITY_STEP_S)

    def _offsets_km(self, body: int, et_s: float) -> Dict[int, np.ndarray]:
        """Returns the body's position relative to itself, to its centre, to that one's centre, and so on."""
        offsets = {body: np.zeros(3)}
        offset = offsets[body]
        while True:
            segment = next((s for s in self._spk if s.target == body and s.start_second <= et_s <= s.end_second), None)
            if segment is None:
                return offsets
            body = segment.center
            offset = offset + self._segment_km(segment, et_s)
            offsets[body] = offset

    def _segment_km(self, segment: Any, et_s: float) -> np.ndarray:
        if segment.frame != J2000:
            raise ValueError(f"the segment of {segment.target} relative to {segment.center} is in frame "
                             f"{segment.frame}; {J2000} (J2000) is needed")
        if segment.data_type in CHEBYSHEV:
            return segment.compute(JD_J2000, et_s / DAY_S)[:3]
        if id(segment) not in self._tracks:
            self._tracks[id(segment)] = _track_of(segment)
        return self._tracks[id(segment)].at(et_s)

    def _spans(self) -> str:
        return ", ".join(f"{s.target} relative to {s.center} from {s.start_second:.3f} to {s.end_second:.3f}"
                         for s in self._spk)


class SpkTrack:
    """Positions of a spacecraft about the Moon as a segment of a trajectory, ICRF; times since `start_et_s`."""

    def __init__(self, kernels: Kernels, spacecraft: int, start_et_s: float, times_s: np.ndarray) -> None:
        self.times = times_s
        self.first = float(times_s[0])
        self.last = float(times_s[-1])
        self._kernels = kernels
        self._spacecraft = spacecraft
        self._start_et_s = start_et_s
        for time_s in (self.first, self.last):
            self.at(time_s)  # missing kernels are reported here

    def at(self, time_s: float) -> np.ndarray:
        """Returns the position in metres."""
        return self._kernels.position_m(self._spacecraft, self._start_et_s + time_s)


def turned_axes(axis: int, angle_rad: float) -> np.ndarray:
    """Returns the matrix of a vector's components after the axes have turned about one of them, as SPICE's rotate."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    matrix = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j] = s
    matrix[j, i] = -s
    return matrix


def aberrated(direction: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Returns the unit vector toward a source for a moving observer, whose velocity is in units of light's.

    Explanatory Supplement to the Astronomical Almanac (2013), equation 7.40.
    """
    inverse_gamma = math.sqrt(1 - float(velocity @ velocity))
    along = float(direction @ velocity)
    return (inverse_gamma * direction + (1 + along / (1 + inverse_gamma)) * velocity) / (1 + along)


def _track_of(segment: Any) -> Track:
    """Returns the states of a segment in km, by SPK Required Reading (NAIF), types 8, 9, 12 and 13."""
    if segment.data_type not in LAGRANGE + HERMITE:
        raise ValueError(f"the segment of {segment.target} relative to {segment.center} has the SPK type "
                         f"{segment.data_type}; {', '.join(map(str, CHEBYSHEV + LAGRANGE + HERMITE))} can be read")
    data = segment.daf.map_array(segment.start_i, segment.end_i)
    count = int(data[-1])
    states = data[:6 * count].reshape(count, 6)
    if segment.data_type in EQUAL_STEPS:
        times = data[-4] + data[-3] * np.arange(count)
    else:
        times = data[6 * count:7 * count]
    # The last number but one is the degree of Lagrange's polynomials, or the number of Hermite's nodes less one.
    is_lagrange = segment.data_type in LAGRANGE
    method, degree = ("lagrange", int(data[-2])) if is_lagrange else ("hermite", 2 * int(data[-2]) + 1)
    return Track(times, states[:, :3], states[:, 3:], method, degree, segment.start_second, segment.end_second)
