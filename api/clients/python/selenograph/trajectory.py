"""Poses over time, from arrays or from files."""

from __future__ import annotations

import copy
import datetime
import math
from typing import Any, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple, Union

import numpy as np

from .ccsds import FRAMES, ICRF_NAMES, Path, Segment, common_value, read_kvn
from .epochs import Epoch, datetime_of, et_of, parse_epoch, utc_text
from .interpolation import Track, Turns, segment_at
from .kernels import Kernels, SpkTrack, When
from .moon import INERTIAL
from .noise import numbered_sensors
from .pose import Pose
from .request_types import AnyFrameRequest
from .rotations import Vector, product, quaternion_of
from .sun import Sun
from .trajectory_csv import read_trajectory_csv

NEED_SUN = {"image", "radiance", "angles", "lit", "irradiance"}  # products that need a request's "sun"

Azimuths = Tuple[np.ndarray, np.ndarray]  # times, and up_azimuth_deg at them without jumps at 360


class Trajectory:
    """Positions and attitudes over time; `at` gives the pose in between.

    times_s           rising, in seconds from `start` (or from any origin, without `start`)
    positions_m       (N, 3), MOON_ME or `frame`
    velocities_m_s    (N, 3); without them those of the parabola through each position and its neighbours
    attitudes         (N, 4) unit quaternions w, x, y, z in the direction `direction`; or, instead,
    up_azimuth_deg    of a camera that looks at nadir: a number or (N,), as in Pose.nadir
    start             the epoch of 0 s, a datetime with its time zone: then `requests` sets the Sun by it
    method, degree    of positions: "hermite" (cubic by default; from positions and velocities), "lagrange", "linear"

    Attitudes turn at a constant rate from one to the next, through the smaller angle (slerp).
    """

    times_s: np.ndarray  # times of the positions, where there is also an attitude
    _kernels: Optional[Kernels] = None  # of the Moon's orientation and the Sun

    def __init__(self, times_s: Vector, positions_m: Any, *, velocities_m_s: Any = None, attitudes: Any = None,
                 direction: Optional[str] = None, up_azimuth_deg: Any = None,
                 start: Optional[datetime.datetime] = None, frame: str = "MOON_ME", method: str = "hermite",
                 degree: Optional[int] = None) -> None:
        track = Track(times_s, positions_m, velocities_m_s, method, degree)
        if (attitudes is None) == (up_azimuth_deg is None):
            raise ValueError("write either attitudes (quaternions w, x, y, z; with direction=) or up_azimuth_deg (the "
                             "camera looks at nadir)")
        if attitudes is None:
            self._set_segments([track], [], _continuous_azimuths(track.times, up_azimuth_deg), start, frame)
            return
        if direction is None:
            raise ValueError('attitudes need a direction: "camera_from_moon" or "moon_from_camera"')
        self._set_segments([track], [Turns(times_s, attitudes, direction)], None, start, frame)

    def _set_segments(self, tracks: Sequence[Union[Track, SpkTrack]], turns: List[Turns], azimuths: Optional[Azimuths],
                      start: Optional[datetime.datetime], frame: str) -> None:
        """Sets all members. The camera has either turns or azimuths."""
        if start is not None and start.tzinfo is None:
            raise ValueError(f"start = {start!r} has no time zone; write datetime(..., tzinfo=timezone.utc)")
        self._tracks = tracks
        self._turns = turns
        self._azimuths = azimuths
        self.start = start
        self.frame = frame
        times = np.unique(np.concatenate([t.times[(t.times >= t.first) & (t.times <= t.last)] for t in tracks]))
        if turns:
            times = np.array([t for t in times if segment_at(turns, float(t))])
        if not len(times):
            raise ValueError("positions and attitudes have no time in common")
        self.times_s = times

    @classmethod
    def from_csv(cls, path: Path, *, frame: str = "MOON_ME") -> Trajectory:
        """Reads a file with a line of names, and commas. Columns, in any order:

        time_s, or utc (ISO 8601)
        x_m, y_m, z_m, and vx_m_s, vy_m_s, vz_m_s if known; or lat_deg, lon_deg, height_m
        camera_from_moon_w, .._x, .._y, .._z, or moon_from_camera_w, ...; or up_azimuth_deg: the camera looks at nadir
        """
        columns = read_trajectory_csv(path, frame)
        try:
            return cls(columns.times_s, columns.positions_m, velocities_m_s=columns.velocities_m_s,
                       attitudes=columns.attitudes, direction=columns.direction,
                       up_azimuth_deg=columns.up_azimuth_deg, start=columns.start, frame=frame)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    @classmethod
    def from_ccsds(cls, oem: Path, aem: Optional[Path] = None, *, up_azimuth_deg: Optional[float] = None,
                   camera_from_body: Any = None, frame: Optional[str] = None) -> Trajectory:
        """Reads an Orbit Ephemeris Message (CCSDS 502.0) and an Attitude Ephemeris Message (504.0), as KVN text.

        Positions are interpolated by the OEM's INTERPOLATION, or by cubic Hermite polynomials where it says none;
        attitudes by slerp. An AEM holds quaternions of frame B relative to A; one of the two is the OEM's REF_FRAME,
        the other the spacecraft's body. camera_from_body is the 3 x 3 matrix that turns body axes into camera axes
        (+x right, +y down, +z boresight); left out, body and camera are the same. Without an AEM the camera looks at
        nadir, with up_azimuth_deg.

        frame: name of the files' REF_FRAME in requests, where it is not MOON_ME, MOON_PA_DE421, MOON_PA_DE440 or ICRF;
        "J2000", of EME2000 say.
        """
        orbit = read_kvn(oem, "OEM")
        time_system = common_value(oem, orbit, "TIME_SYSTEM")
        file_frame = common_value(oem, orbit, "REF_FRAME")
        request_frame = _request_frame(oem, orbit, frame)
        epoch = min(segment.epochs[0] for segment in orbit)
        tracks = [segment.track(epoch) for segment in orbit]
        turns, azimuths = _attitudes(aem, up_azimuth_deg, camera_from_body, epoch, time_system, file_frame)
        start = datetime_of(epoch) if time_system.upper() == "UTC" else None
        trajectory = cls.__new__(cls)
        trajectory._set_segments(tracks, turns, azimuths, start, request_frame)
        if request_frame in INERTIAL and start is None:
            raise ValueError(f"{oem}: TIME_SYSTEM is {time_system}; with REF_FRAME {file_frame} UTC is needed, since "
                             "the Moon's rotation depends on it")
        return trajectory

    @classmethod
    def from_spk(cls, kernels: Kernels, spacecraft: int, *, start: When, stop: When, step_s: float,
                 aem: Optional[Path] = None, up_azimuth_deg: Optional[float] = None,
                 camera_from_body: Any = None) -> Trajectory:
        """Takes the positions of a spacecraft (NAIF's code) from SPICE kernels, in steps from `start` to `stop` in UTC.

        Positions between the steps are the kernels', too. Attitudes: see from_ccsds; the AEM's other frame than the
        body's is ICRF, EME2000 or J2000. With a PCK among the kernels, poses are in its frame of the Moon, without one
        in ICRF, which the service rotates by a model accurate to 0.01 degrees (300 m on the ground). With a PCK and a
        planetary ephemeris, `requests` takes the Sun from them.
        """
        if not 0 < step_s < math.inf:
            raise ValueError(f"step_s is {step_s:g}; seconds above 0 are needed")
        epoch = parse_epoch(start if isinstance(start, str) else utc_text(start), "start")
        duration_s = et_of(stop) - et_of(start)
        if duration_s < 0:
            raise ValueError(f"start is {start}, later than stop, {stop}")
        # Round generously: seconds since an epoch have six digits after the point.
        times = step_s * np.arange(math.floor(duration_s / step_s + 1e-6) + 1)
        track = SpkTrack(kernels, spacecraft, et_of(start), times)
        turns, azimuths = _attitudes(aem, up_azimuth_deg, camera_from_body, epoch, "UTC", "ICRF")
        trajectory = cls.__new__(cls)
        trajectory._set_segments([track], turns, azimuths, datetime_of(epoch), "ICRF")
        return trajectory.in_moon_frame(kernels) if kernels.moon_frame else trajectory

    def in_moon_frame(self, kernels: Kernels) -> Trajectory:
        """Returns the trajectory with its inertial poses turned by the Moon's orientation in a binary PCK.

        Where the kernels have the Sun and the Moon, `requests` takes the Sun from them.
        """
        if self.frame not in INERTIAL or self.start is None:
            raise ValueError(f"the trajectory is in {self.frame}; only one in {' or '.join(INERTIAL)} with epochs "
                             "needs the Moon's orientation")
        if kernels.moon_frame is None:
            raise ValueError("the kernels have no orientation of the Moon: add a binary PCK")
        turned = copy.copy(self)
        turned._kernels = kernels
        turned.frame = kernels.moon_frame
        return turned

    def __len__(self) -> int:
        return len(self.times_s)

    def __iter__(self) -> Iterator[Pose]:
        """Yields the poses at times_s."""
        return (self.at(t) for t in self.times_s)

    def position_m(self, time_s: float) -> np.ndarray:
        """Returns the position at a time, in `frame`."""
        track = segment_at(self._tracks, time_s)
        if track is None:
            raise ValueError(f"no position at {time_s:g} s; there are positions from {_spans(self._tracks)} s")
        position: np.ndarray = track.at(time_s)
        return position if self._kernels is None else self._kernels.moon_from_icrf(self._et_s(time_s)) @ position

    def at(self, time_s: float) -> Pose:
        """Returns the pose at a time, in seconds as in times_s. There is no extrapolation."""
        position = self.position_m(float(time_s))
        if self._azimuths is not None:
            pose = Pose.nadir(position_m=position, frame=self.frame,
                              up_azimuth_deg=math.remainder(float(np.interp(time_s, *self._azimuths)), 360))
        else:
            turns = segment_at(self._turns, float(time_s))
            if turns is None:
                raise ValueError(f"no attitude at {time_s:g} s; there are attitudes from {_spans(self._turns)} s")
            pose = Pose.from_quaternion(self._in_frame(turns, float(time_s)), order="wxyz", direction=turns.direction,
                                        position_m=position, frame=self.frame)
        if self.frame in INERTIAL:
            pose["utc"] = self.utc(time_s)
        return pose

    def _in_frame(self, turns: Turns, time_s: float) -> np.ndarray:
        """Returns the attitude at a time, turned into `frame`."""
        q = turns.at(time_s)
        if self._kernels is None:
            return q
        moon_from_icrf = quaternion_of(self._kernels.moon_from_icrf(self._et_s(time_s)))
        if turns.direction == "moon_from_camera":
            return product(moon_from_icrf, q)
        return product(q, moon_from_icrf * [1, -1, -1, -1])

    def _et_s(self, time_s: float) -> float:
        """Returns SPICE's Ephemeris Time of a time of a trajectory that has an epoch."""
        assert self.start is not None
        return et_of(self.start) + time_s

    def utc(self, time_s: float) -> str:
        """Returns the epoch of a time, for Sun.utc."""
        if self.start is None:
            raise ValueError("the trajectory has no epoch: its times are not UTC")
        return utc_text(self.start + datetime.timedelta(seconds=float(time_s)))

    def requests(self, request: AnyFrameRequest, times_s: Optional[Iterable[float]] = None) -> List[Dict[str, Any]]:
        """Returns `request` with the pose of each time (default: times_s).

        A sensor without a "frame" gets 0, 1, 2 .., so that each frame has its own noise. A request without "sun" gets
        the Sun of each epoch. Where the Sun is the kernels', a "sky" without an epoch gets each epoch and the kernels'
        states. The result is a list, so that frames() knows all poses ahead.
        """
        if "sun" not in request and self.start is None and set(request.get("products", ["radiance"])) & NEED_SUN:
            raise ValueError('the request has no "sun", and the trajectory no epoch to find it by; add one by Sun')
        requests = []
        for number, time_s in enumerate(self.times_s if times_s is None else times_s):
            changes: Dict[str, Any] = {"pose": self.at(time_s), **numbered_sensors(request, number)}
            if "sun" not in request and self.start is not None:
                utc = self.utc(time_s)
                if self._kernels is not None and self._kernels.has_sun:
                    changes["sun"] = self._kernels.sun(utc)
                    changes.update(_sky_by_kernels(request, self._kernels, utc))
                else:
                    changes["sun"] = Sun.utc(utc)
            requests.append({**request, **changes})
        return requests


def _sky_by_kernels(request: AnyFrameRequest, kernels: Kernels, utc: str) -> Dict[str, Any]:
    """Returns the "sky" of a request at an epoch, empty without one or where it has an epoch of its own."""
    sky = request.get("sky")
    if sky is None or "utc" in sky or "et_s" in sky:
        return {}
    used = {"sun": sky.get("sun"), "earth": True}
    states = {body: state for body, state in kernels.sky_states(utc).items() if used.get(body, sky.get("planets"))}
    return {"sky": {"states": states, **sky, "utc": utc}}


def _continuous_azimuths(times: np.ndarray, up_azimuth_deg: Any) -> Azimuths:
    """Returns azimuths that turn by at most 180 degrees from each time to the next."""
    azimuths = np.broadcast_to(np.asarray(up_azimuth_deg, float), times.shape)
    # numpy.unwrap knows degrees from NumPy 1.21 on only.
    revolutions = np.cumsum(np.round(np.diff(azimuths, prepend=azimuths[:1]) / 360))
    return times, azimuths - 360 * revolutions


def _request_frame(oem: Path, orbit: List[Segment], frame: Optional[str]) -> str:
    """Returns the pose.frame of an orbit about the Moon: `frame`, or by its REF_FRAME."""
    file_frame = common_value(oem, orbit, "REF_FRAME")
    request_frame = frame or FRAMES.get(file_frame.upper())
    if request_frame is None:
        raise ValueError(f"{oem}: REF_FRAME is {file_frame}; the service knows "
                         f"{', '.join(sorted(set(FRAMES.values())))}. If it is one of them by another name, write "
                         "frame=")
    center = common_value(oem, orbit, "CENTER_NAME")
    if center.upper() not in ("MOON", "LUNA"):
        raise ValueError(f"{oem}: CENTER_NAME is {center}; MOON is needed")
    return request_frame


def _attitudes(aem: Optional[Path], up_azimuth_deg: Optional[float], camera_from_body: Any, epoch: Epoch,
               time_system: str, frame: str) -> Tuple[List[Turns], Optional[Azimuths]]:
    """Returns the attitudes of an AEM with times since `epoch`, or the azimuth of a camera that looks at nadir.

    time_system, frame: those of the positions. Positions in ICRF go with an AEM's ICRF, EME2000 or J2000.
    """
    if (aem is None) == (up_azimuth_deg is None):
        raise ValueError("write either aem= (attitudes) or up_azimuth_deg= (the camera looks at nadir)")
    if aem is None:
        if camera_from_body is not None:
            raise ValueError("camera_from_body goes with aem=: without attitudes the camera looks at nadir")
        return [], (np.zeros(1), np.array([float(up_azimuth_deg or 0)]))
    segments = read_kvn(aem, "AEM")
    attitude_time_system = common_value(aem, segments, "TIME_SYSTEM")
    if attitude_time_system != time_system:
        raise ValueError(f"{aem}: TIME_SYSTEM is {time_system} and {attitude_time_system}; positions and attitudes "
                         "need the same")
    mounting = _mounting(camera_from_body)
    turns = []
    for segment in segments:
        frames = [segment.meta.get(key, "").upper() for key in ("REF_FRAME_A", "REF_FRAME_B")]
        alike = ICRF_NAMES if frame.upper() in ICRF_NAMES else (frame,)
        turns.append(segment.turns(epoch, next((name for name in alike if name in frames), frame), mounting))
    return turns, None


def _mounting(camera_from_body: Any) -> np.ndarray:
    """Returns the quaternion of the matrix camera_from_body; the identity without a matrix."""
    if camera_from_body is None:
        return np.array([1.0, 0, 0, 0])
    q = Pose.from_matrix(camera_from_body, direction="camera_from_moon", position_m=[0, 0, 0])["camera_from_moon"]
    return np.array([q[c] for c in "wxyz"])


def _spans(segments: Iterable[Any]) -> str:
    return ", ".join(f"{s.first:g} to {s.last:g}" for s in segments)
