"""Position and attitude of a camera."""

from __future__ import annotations

from typing import Any, Dict, Optional, Union

import numpy as np

from .moon import direction_of
from .request_body import without_none
from .rotations import (DIRECTIONS, UNIT_QUATERNION_TOLERANCE, Vector, checked_word, finite_vector,
                        quaternion_of)

ORTHONORMAL_TOLERANCE = 1e-6  # largest error of the products of a matrix's rows
# A distance from the Moon's centre in this interval is in kilometres: in metres it would be deep inside the Moon.
MIN_MISTAKEN_M = 1500
MAX_MISTAKEN_M = 1e6


class Pose(dict):
    """The "pose" of a request: position and attitude of the camera.

    Each constructor takes the position as position_m=[x, y, z] (metres from the Moon's centre, MOON_ME or `frame`), or
    as lat_deg=, lon_deg= and height_m= (above the sphere of 1 737 400 m, MOON_ME). nadir() and look_at() also take
    height_above_ground_m= (above the terrain with the request's detail) in place of height_m.
    """

    @classmethod
    def nadir(cls, *, position_m: Optional[Vector] = None, lat_deg: Optional[float] = None,
              lon_deg: Optional[float] = None, height_m: Optional[float] = None,
              height_above_ground_m: Optional[float] = None, up_azimuth_deg: float = 0.0,
              tilt_deg: Optional[float] = None, azimuth_deg: Optional[float] = None, frame: str = "MOON_ME") -> Pose:
        """Looks at the Moon's centre, or tilted from there.

        up_azimuth_deg  compass azimuth, clockwise from north, of up in the image before the tilt
        tilt_deg        angle between boresight and nadir
        azimuth_deg     compass azimuth toward which the boresight is tilted; None: up_azimuth_deg
        """
        nadir = without_none(up_azimuth_deg=up_azimuth_deg, tilt_deg=tilt_deg, azimuth_deg=azimuth_deg)
        return cls({**_position(position_m, lat_deg, lon_deg, height_m, frame, height_above_ground_m),
                    "nadir": {name: float(value) for name, value in nadir.items()}})

    @classmethod
    def look_at(cls, *, target_lat_deg: float, target_lon_deg: float, target_height_m: float = 0.0,
                target_height_above_ground_m: Optional[float] = None, up: Union[str, Vector] = "north",
                position_m: Optional[Vector] = None, lat_deg: Optional[float] = None, lon_deg: Optional[float] = None,
                height_m: Optional[float] = None, height_above_ground_m: Optional[float] = None,
                frame: str = "MOON_ME") -> Pose:
        """Looks at a target, which then lies at (cx, cy).

        up: the direction that is up in the image: "north"; "zenith", away from the Moon's centre, which makes the
        horizon level; or a MOON_ME vector.
        """
        position = _position(position_m, lat_deg, lon_deg, height_m, frame, height_above_ground_m)
        if isinstance(up, str):
            checked_word(up, ("north", "zenith"), "up")
            if up == "zenith":
                # Send the zenith as a vector: older services do not know the word.
                if frame != "MOON_ME":
                    raise ValueError(f"up=\"zenith\" needs a place in MOON_ME, not in {frame}; write up=[x, y, z]")
                up = direction_of(position)
        height = ({"height_m": float(target_height_m)} if target_height_above_ground_m is None else
                  {"height_above_ground_m": float(target_height_above_ground_m)})
        target = {"lat_deg": float(target_lat_deg), "lon_deg": float(target_lon_deg), **height,
                  "up": up if isinstance(up, str) else finite_vector(up, 3, "up").tolist()}
        return cls({**position, "look_at": target})

    @classmethod
    def from_quaternion(cls, q: Vector, *, order: str, direction: str, position_m: Optional[Vector] = None,
                        lat_deg: Optional[float] = None, lon_deg: Optional[float] = None,
                        height_m: Optional[float] = None, axes: str = "opencv", frame: str = "MOON_ME") -> Pose:
        """Takes the attitude from a unit quaternion of four numbers (Hamilton's product, ij = k).

        order      "wxyz": scalar first, as Eigen's constructor, pyquaternion and SPICE have it;
                   "xyzw": scalar last, as ROS and SciPy's Rotation.as_quat() have it
        direction  "camera_from_moon": q v q* turns a vector in MOON_ME into camera axes;
                   "moon_from_camera": its inverse, the orientation of the camera in MOON_ME (as ROS and Blender
                   store orientations)
        axes       "opencv" (+x right, +y down, +z boresight) or "opengl" (+x right, +y up, -z boresight; Blender's)
        """
        checked_word(order, ("wxyz", "xyzw"), "order")
        wxyz = finite_vector(q, 4, "q")
        wxyz = wxyz if order == "wxyz" else wxyz[[3, 0, 1, 2]]
        length = float(np.linalg.norm(wxyz))
        if abs(length - 1) > UNIT_QUATERNION_TOLERANCE:
            raise ValueError(f"q has length {length:.6g}; a unit quaternion is needed. Modified Rodrigues parameters "
                             "are for Pose.from_mrp")
        return cls._with_attitude(wxyz / length, direction, axes, position_m, lat_deg, lon_deg, height_m, frame)

    @classmethod
    def from_matrix(cls, matrix: Any, *, direction: str, position_m: Optional[Vector] = None,
                    lat_deg: Optional[float] = None, lon_deg: Optional[float] = None, height_m: Optional[float] = None,
                    axes: str = "opencv", frame: str = "MOON_ME") -> Pose:
        """Takes the attitude from a 3 x 3 rotation matrix, rows first.

        direction  "camera_from_moon": matrix @ v_moon = v_camera. Its rows are the camera's axes in MOON_ME; the R of
                   OpenCV's solvePnP, and a direction cosine matrix [CM];
                   "moon_from_camera": its transpose. Its columns are the camera's axes in MOON_ME
        """
        m = np.asarray(matrix, float)
        if m.shape != (3, 3) or not np.isfinite(m).all():
            raise ValueError(f"matrix has the shape {m.shape}; 3 x 3 finite numbers are needed. Of a 4 x 4 pose take "
                             "[:3, :3] as the matrix")
        error = float(np.abs(m @ m.T - np.eye(3)).max())
        if error > ORTHONORMAL_TOLERANCE:
            raise ValueError(f"matrix is no rotation: its rows are {error:.2g} from orthonormal (1e-6 is allowed)")
        if np.linalg.det(m) < 0:
            raise ValueError("matrix mirrors (its determinant is -1): one of its axes points the wrong way. A camera "
                             "with +y up has -z as its boresight: axes=\"opengl\"")
        q = quaternion_of(m)
        return cls._with_attitude(q, direction, axes, position_m, lat_deg, lon_deg, height_m, frame)

    @classmethod
    def from_mrp(cls, sigma: Vector, *, direction: str, position_m: Optional[Vector] = None,
                 lat_deg: Optional[float] = None, lon_deg: Optional[float] = None, height_m: Optional[float] = None,
                 axes: str = "opencv", frame: str = "MOON_ME") -> Pose:
        """Takes the attitude from modified Rodrigues parameters, e tan(angle / 4).

        Their convention is that of Schaub and Junkins, which Basilisk uses: the matrix of sigma_CM, their [CM], turns
        vectors in M into C.

        direction  "camera_from_moon": sigma_CM, the camera's attitude relative to MOON_ME (as sigma_BN is the body's
                   relative to N); "moon_from_camera": sigma_MC
        """
        s = finite_vector(sigma, 3, "sigma")
        square = float(s @ s)
        # Negate sigma: [CM] rotates the frame, a quaternion's product rotates the vector.
        q = np.concatenate([[1 - square], -2 * s]) / (1 + square)
        return cls._with_attitude(q, direction, axes, position_m, lat_deg, lon_deg, height_m, frame)

    @classmethod
    def _with_attitude(cls, q: np.ndarray, direction: str, axes: str, position_m: Optional[Vector],
                       lat_deg: Optional[float], lon_deg: Optional[float], height_m: Optional[float],
                       frame: str) -> Pose:
        checked_word(direction, DIRECTIONS, "direction")
        checked_word(axes, ("opencv", "opengl"), "axes")
        position = _position(position_m, lat_deg, lon_deg, height_m, frame)
        positive_zeros = q + 0.0  # -0.0 + 0.0 is 0.0
        pose = cls({**position, direction: dict(zip("wxyz", positive_zeros.tolist()))})
        if axes != "opencv":
            pose["axes"] = axes
        return pose


def _position(position_m: Optional[Vector], lat_deg: Optional[float], lon_deg: Optional[float],
              height_m: Optional[float], frame: str,
              height_above_ground_m: Optional[float] = None) -> Dict[str, Any]:
    """Returns the members of a pose that are its position."""
    geodetic = without_none(lat_deg=lat_deg, lon_deg=lon_deg, height_m=height_m,
                            height_above_ground_m=height_above_ground_m)
    if position_m is None:
        if len(geodetic) > 3:
            raise ValueError("write either height_m or height_above_ground_m")
        if len(geodetic) < 3:
            raise ValueError("where is the camera? Write position_m=[x, y, z], or lat_deg=, lon_deg= and height_m=")
        if frame != "MOON_ME":
            raise ValueError(f"lat_deg, lon_deg and height_m are MOON_ME; in {frame} write position_m=[x, y, z]")
        return {"geodetic": {name: float(value) for name, value in geodetic.items()}}
    if geodetic:
        raise ValueError(f"write either position_m or lat_deg, lon_deg and height_m; got position_m and "
                         f"{', '.join(geodetic)}")
    position = finite_vector(position_m, 3, "position_m")
    distance_m = float(np.linalg.norm(position))
    if MIN_MISTAKEN_M < distance_m < MAX_MISTAKEN_M:
        raise ValueError(f"position_m is {distance_m:.6g} m from the Moon's centre, deep inside: kilometres? Metres "
                         "are needed")
    members: Dict[str, Any] = {"position_m": position.tolist()}
    if frame != "MOON_ME":
        members["frame"] = frame
    return members
