"""Projection and image size of a camera."""

from __future__ import annotations

from typing import Any, Dict, Mapping, Optional, Tuple

import numpy as np

from .request_body import without_none
from .rotations import Vector

# distCoeffs of cv2.calibrateCamera, in its order.
OPENCV_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")


class Camera(dict):
    """The "camera" of a request: projection and image size."""

    @classmethod
    def pinhole(cls, *, width: int, height: int, fov_deg: Optional[float] = None, fx: Optional[float] = None,
                fy: Optional[float] = None, cx: Optional[float] = None, cy: Optional[float] = None,
                focal_length_mm: Optional[float] = None, pixel_pitch_um: Optional[float] = None,
                distortion: Optional[Mapping[str, Any]] = None) -> Camera:
        """Makes a pinhole camera of `width` x `height` pixels.

        fov_deg          horizontal, full angle (not vertical, not half); or
        fx               in pixels, with fy, cx, cy (default: fx, (width - 1) / 2, (height - 1) / 2); or
        focal_length_mm  with pixel_pitch_um
        distortion       {"k1": .., "k2": .., "k3": .., "p1": .., "p2": ..}; with "model": "opencv" also "k4" to "k6",
                         "s1" to "s4", "tau_x_deg" and "tau_y_deg"
        """
        lens = None if distortion is None else {"model": "brown_conrady", **distortion}
        return cls._with_scale("pinhole", width, height, lens, fov_deg, without_none(fx=fx, fy=fy, cx=cx, cy=cy),
                               without_none(focal_length_mm=focal_length_mm, pixel_pitch_um=pixel_pitch_um))

    @classmethod
    def fisheye(cls, *, width: int, height: int, fov_deg: Optional[float] = None, fx: Optional[float] = None,
                fy: Optional[float] = None, cx: Optional[float] = None, cy: Optional[float] = None,
                focal_length_mm: Optional[float] = None, pixel_pitch_um: Optional[float] = None,
                distortion: Optional[Mapping[str, Any]] = None) -> Camera:
        """Makes an equidistant fisheye (radius = f theta); with distortion {"k1": .., .. "k4": ..} OpenCV's fisheye."""
        lens = None if distortion is None else {"model": "kannala_brandt", **distortion}
        return cls._with_scale("fisheye", width, height, lens, fov_deg, without_none(fx=fx, fy=fy, cx=cx, cy=cy),
                               without_none(focal_length_mm=focal_length_mm, pixel_pitch_um=pixel_pitch_um))

    @classmethod
    def from_opencv(cls, matrix: Any, distortion: Any = (), *, width: int, height: int,
                    fisheye: bool = False) -> Camera:
        """Makes a camera from OpenCV's camera matrix and distortion coefficients.

        The coefficients are in OpenCV's order: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tau_x, tau_y]]]],
        or k1..k4 of cv2.fisheye. Pixels count as in OpenCV, so that nothing is shifted.
        """
        m = np.asarray(matrix, float)
        if m.shape != (3, 3) or abs(m[0, 1]) > 0 or m[1, 0] or tuple(m[2]) != (0, 0, 1):
            raise ValueError(f"matrix is {m.tolist()}; [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] is needed (no skew)")
        values = [] if distortion is None else np.asarray(distortion, float).ravel().tolist()
        names = ("k1", "k2", "k3", "k4") if fisheye else OPENCV_COEFFICIENTS
        if any(values[len(names):]):
            raise ValueError(f"distortion has {len(values)} coefficients; at most {', '.join(names)} can be used")
        make = cls.fisheye if fisheye else cls.pinhole
        lens: Optional[Dict[str, Any]] = dict(zip(names, values)) if any(values) else None
        if lens and not fisheye and any(values[5:]):
            lens["model"] = "opencv"
            for axis in "xy":  # OpenCV's angles are in radians
                lens[f"tau_{axis}_deg"] = float(np.degrees(lens.pop(f"tau_{axis}", 0.0)))
        elif lens and not fisheye:
            lens = dict(list(lens.items())[:5])
        return make(width=width, height=height, fx=m[0, 0], fy=m[1, 1], cx=m[0, 2], cy=m[1, 2], distortion=lens)

    @classmethod
    def from_cahvor(cls, a: Vector, h: Vector, v: Vector, o: Optional[Vector] = None, r: Vector = (0, 0, 0), *,
                    width: int, height: int, linearity: float = 1.0) -> Tuple[Camera, np.ndarray]:
        """Makes a camera from the vectors of CAHV, CAHVOR or CAHVORE in any frame, such as a rover's.

        Returns the camera and the matrix camera_from_frame, which rotates vectors of that frame into the camera's axes:
        +z is A, +x is H without its share of A. The camera is at C. linearity: 1, or that of CAHVORE's type: 0 for
        type 2, its parameter for type 3. E is left out: lines of sight start in C.
        """
        vectors = {name: np.asarray(vector, float) for name, vector in zip("AHVO", (a, h, v, a if o is None else o))}
        axis, horizontal = vectors["A"], vectors["H"]
        across = horizontal - (horizontal @ axis) * axis
        if not abs(np.linalg.norm(axis) - 1) < 1e-3 or not np.linalg.norm(across) > 0:
            raise ValueError(f"A is {axis.tolist()}, H is {horizontal.tolist()}; a unit vector A and an H across it are "
                             "needed")
        x = across / np.linalg.norm(across)
        z = axis / np.linalg.norm(axis)
        camera_from_frame = np.array([x, np.cross(z, x), z])
        cahvor: Dict[str, Any] = {name: (camera_from_frame @ vector).tolist() for name, vector in vectors.items()}
        cahvor.update({"R": np.asarray(r, float).tolist(), "linearity": float(linearity)})
        return cls(model="pinhole", width=int(width), height=int(height), cahvor=cahvor), camera_from_frame

    @classmethod
    def _with_scale(cls, model: str, width: int, height: int, distortion: Optional[Mapping[str, Any]],
                    fov_deg: Optional[float], pixels: Dict[str, float], lengths: Dict[str, float]) -> Camera:
        """Checks that exactly one of field of view, focal length in pixels and focal length in mm is given."""
        scales = [scale for scale in (without_none(fov_deg=fov_deg), pixels, lengths) if scale]
        if len(scales) != 1 or len(lengths) == 1:
            raise ValueError("write either fov_deg (horizontal, full angle) or fx (and fy, cx, cy), in pixels, or "
                             "focal_length_mm and pixel_pitch_um")
        camera = cls(model=model, width=int(width), height=int(height),
                     **{name: float(value) for name, value in scales[0].items()})
        if distortion is not None:
            camera["distortion"] = dict(distortion)
        return camera
