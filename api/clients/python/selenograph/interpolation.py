"""Positions and attitudes between the times of a trajectory."""

from __future__ import annotations

from typing import Any, Optional, Sequence

import numpy as np

from .rotations import DIRECTIONS, UNIT_QUATERNION_TOLERANCE, checked_word, slerp

DEFAULT_DEGREES = {"hermite": 3, "lagrange": 5, "linear": 1}  # degree of the polynomials by method


class Track:
    """Positions over time: one segment of a trajectory.

    first, last: the times between which it may be used, in seconds.
    """

    def __init__(self, times_s: Any, positions_m: Any, velocities_m_s: Any, method: str, degree: Optional[int],
                 first: Optional[float] = None, last: Optional[float] = None) -> None:
        self.times = rising_times(times_s)
        self.positions = _rows(positions_m, len(self.times), 3, "positions_m")
        checked_word(method, ("hermite", "lagrange", "linear"), "method")
        self.nodes = _node_count(method, degree, len(self.times))
        self.velocities = self._velocities(velocities_m_s) if method == "hermite" else None
        self.first = _later(first, self.times[0])
        self.last = _earlier(last, self.times[-1])

    def _velocities(self, velocities_m_s: Any) -> Optional[np.ndarray]:
        """Returns the velocities, by default those of the parabolas through three neighbouring positions."""
        if velocities_m_s is not None:
            return _rows(velocities_m_s, len(self.times), 3, "velocities_m_s")
        if len(self.times) == 1:
            return None
        return np.gradient(self.positions, self.times, axis=0, edge_order=2 if len(self.times) > 2 else 1)

    def at(self, time_s: float) -> np.ndarray:
        """Returns the position of the polynomial through the nearest nodes, in Newton's form."""
        k = int(np.searchsorted(self.times, time_s))
        if k < len(self.times) and self.times[k] == time_s:
            return self.positions[k].copy()
        if self.nodes % 2 and k > 0 and (k == len(self.times) or 2 * time_s < self.times[k - 1] + self.times[k]):
            k -= 1  # an odd number of nodes lies around the nearest one
        start = min(max(k - self.nodes // 2, 0), len(self.times) - self.nodes)
        nearest = slice(start, start + self.nodes)
        # Take each node twice where velocities are given: the first differences of a pair are its velocity.
        repeats = 1 if self.velocities is None else 2
        x = np.repeat(self.times[nearest] - time_s, repeats)
        # Subtract a near position: the differences keep their digits.
        origin = self.positions[start + self.nodes // 2]
        column = np.repeat(self.positions[nearest] - origin, repeats, axis=0)
        coefficients = [column[0]]
        for level in range(1, len(x)):
            gap = (x[level:] - x[:-level])[:, None]
            difference = column[1:] - column[:-1]
            if level == 1 and self.velocities is not None:
                slopes = np.repeat(self.velocities[nearest], 2, axis=0)[:-1]
                column = np.where(gap == 0, slopes, difference / np.where(gap == 0, 1, gap))
            else:
                column = difference / gap
            coefficients.append(column[0])
        value = coefficients[-1]
        for coefficient, node in zip(coefficients[-2::-1], x[len(x) - 2::-1]):
            value = coefficient - node * value
        return origin + value


class Turns:
    """Attitudes over time: one segment of a trajectory.

    first, last: the times between which it may be used, in seconds.
    """

    def __init__(self, times_s: Any, attitudes: Any, direction: str, first: Optional[float] = None,
                 last: Optional[float] = None) -> None:
        self.times = rising_times(times_s)
        self.direction = checked_word(direction, DIRECTIONS, "direction")
        attitudes = _rows(attitudes, len(self.times), 4, "attitudes")
        lengths = np.linalg.norm(attitudes, axis=1)
        errors = np.abs(lengths - 1)
        if errors.max() > UNIT_QUATERNION_TOLERANCE:
            worst = int(errors.argmax())
            raise ValueError(f"attitude {worst} has length {lengths[worst]:.6g}; unit quaternions are needed")
        self.attitudes = attitudes / lengths[:, None]
        self.first = _later(first, self.times[0])
        self.last = _earlier(last, self.times[-1])

    def at(self, time_s: float) -> np.ndarray:
        """Returns the quaternion between the two neighbouring attitudes, by slerp."""
        k = int(np.clip(np.searchsorted(self.times, time_s), 1, max(1, len(self.times) - 1)))
        if len(self.times) == 1:
            return self.attitudes[0]
        share = (time_s - self.times[k - 1]) / (self.times[k] - self.times[k - 1])
        return slerp(self.attitudes[k - 1], self.attitudes[k], float(share))


def segment_at(segments: Sequence[Any], time_s: float) -> Any:
    """Returns the first Track or Turns that may be used at a time; None without one."""
    return next((s for s in segments if s.first <= time_s <= s.last), None)


def rising_times(times_s: Any) -> np.ndarray:
    """Returns the times as an array. They must rise."""
    times = np.asarray(times_s, float)
    if times.ndim != 1 or not len(times) or not np.isfinite(times).all():
        raise ValueError("times are needed: one row of finite numbers")
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        raise ValueError(f"times must rise; number {late[0] + 1} (from 0), {times[late[0] + 1]:.9g} s, does not")
    return times


def _node_count(method: str, degree: Optional[int], time_count: int) -> int:
    """Returns the number of nodes of a polynomial, between 2 and the number of times."""
    if method == "linear":
        degree = DEFAULT_DEGREES[method]
    coefficients = (degree or DEFAULT_DEGREES[method]) + 1
    # Each node of a Hermite polynomial fixes two coefficients.
    nodes = (coefficients + 1) // 2 if method == "hermite" else coefficients
    return min(max(nodes, 2), time_count)


def _later(usable_from: Optional[float], first_time: float) -> float:
    return float(first_time) if usable_from is None else max(usable_from, float(first_time))


def _earlier(usable_until: Optional[float], last_time: float) -> float:
    return float(last_time) if usable_until is None else min(usable_until, float(last_time))


def _rows(values: Any, count: int, size: int, name: str) -> np.ndarray:
    rows = np.asarray(values, float)
    if rows.shape != (count, size) or not np.isfinite(rows).all():
        raise ValueError(f"{name} have the shape {rows.shape}; ({count}, {size}) finite numbers are needed")
    return rows
