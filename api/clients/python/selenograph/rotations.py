"""Rotations. A quaternion is an array w, x, y, z; a_from_b rotates vectors of b into a: v_a = q v_b q*."""

from __future__ import annotations

import math
from typing import Any, Sequence, Tuple, Union

import numpy as np

Vector = Union[Sequence[float], np.ndarray]

DIRECTIONS = ("camera_from_moon", "moon_from_camera")  # members of a pose that are an attitude's quaternion
UNIT_QUATERNION_TOLERANCE = 1e-3  # largest error of a quaternion's length that the service accepts


def matrix_of(q: np.ndarray) -> np.ndarray:
    """Returns the rotation matrix of a unit quaternion."""
    w, x, y, z = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def quaternion_of(matrix: np.ndarray) -> np.ndarray:
    """Returns the unit quaternion of a rotation matrix (Shepperd 1978)."""
    # Take the largest component from the diagonal and the others from it, so that none loses its digits.
    m = matrix
    squares = np.array([1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2],
                        1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]])
    k = int(np.argmax(squares))
    q = np.array([[squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
                  [m[2, 1] - m[1, 2], squares[1], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]],
                  [m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], squares[2], m[2, 1] + m[1, 2]],
                  [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], squares[3]]][k])
    return q / np.linalg.norm(q)


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns Hamilton's product of two quaternions."""
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def slerp(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """Rotates from a (share 0) to b (share 1) at a constant rate, through the smaller angle."""
    if share <= 0:
        return a
    if share >= 1:
        return b
    b = b if a @ b >= 0 else -b
    # Compute the angle by its tangent: its cosine has no digits where a and b are close.
    angle = 2 * math.atan2(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b)))
    if angle < 1e-12:
        return a
    q = (math.sin((1 - share) * angle) * a + math.sin(share * angle) * b) / math.sin(angle)
    return q / np.linalg.norm(q)


def finite_vector(value: Any, size: int, name: str) -> np.ndarray:
    """Returns the argument `name` as an array of finite numbers."""
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {value!r}; {size} numbers are needed") from None
    if array.shape != (size,) or not np.isfinite(array).all():
        raise ValueError(f"{name} is {value!r}; {size} finite numbers are needed")
    return array


def checked_word(value: Any, words: Tuple[str, ...], name: str) -> str:
    """Returns the argument `name`, which must be one of the words."""
    if value not in words:
        raise ValueError(f"{name} is {value!r}; write " + " or ".join(f"{name}={word!r}" for word in words))
    return value
