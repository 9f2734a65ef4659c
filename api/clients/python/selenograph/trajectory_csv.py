"""Trajectories in CSV files."""

from __future__ import annotations

import csv
import datetime
import math
import os
from typing import Any, Dict, List, NamedTuple, Optional, Tuple, Union

import numpy as np

from .epochs import datetime_of, parse_epoch, seconds_since
from .moon import position_of
from .rotations import DIRECTIONS

TIME_COLUMNS = ("time_s", "utc")
POSITION_COLUMNS = ("x_m", "y_m", "z_m")
VELOCITY_COLUMNS = ("vx_m_s", "vy_m_s", "vz_m_s")
GEODETIC_COLUMNS = ("lat_deg", "lon_deg", "height_m")
ATTITUDE_COLUMNS = {direction: tuple(f"{direction}_{c}" for c in "wxyz") for direction in DIRECTIONS}
COLUMNS = {*TIME_COLUMNS, *POSITION_COLUMNS, *VELOCITY_COLUMNS, *GEODETIC_COLUMNS, "up_azimuth_deg",
           *(name for names in ATTITUDE_COLUMNS.values() for name in names)}
LIMITS = {"lat_deg": (-90, 90), "lon_deg": (-180, 360)}  # bounds of the service

Path = Union[str, os.PathLike]


class CsvTrajectory(NamedTuple):
    """The columns of a file, as arguments of Trajectory."""

    times_s: List[float]
    positions_m: np.ndarray
    velocities_m_s: Optional[np.ndarray]
    attitudes: Optional[np.ndarray]
    direction: Optional[str]
    up_azimuth_deg: Optional[np.ndarray]
    start: Optional[datetime.datetime]


def read_trajectory_csv(path: Path, frame: str) -> CsvTrajectory:
    """Reads a file with a line of column names. Trajectory.from_csv describes the columns."""
    columns, times = _read_columns(path)
    start = None
    if "utc" in columns:
        epochs = [parse_epoch(text, f"{path}: utc") for text in columns.pop("utc")]
        times = [seconds_since(epochs[0], epoch) for epoch in epochs]
        start = datetime_of(epochs[0])
    numbers = {name: np.array(values) for name, values in columns.items()}
    positions, velocities = _take_positions(path, numbers, frame)
    attitudes_by_direction = {direction: _take(path, numbers, names) for direction, names in ATTITUDE_COLUMNS.items()}
    directions = [direction for direction, attitudes in attitudes_by_direction.items() if attitudes is not None]
    azimuths = numbers.pop("up_azimuth_deg", None)
    if len(directions) + (azimuths is not None) != 1:
        raise ValueError(f"{path}: one attitude is needed: camera_from_moon_w, .._x, .._y, .._z, or "
                         "moon_from_camera_w, .., or up_azimuth_deg of a camera that looks at nadir")
    if numbers:
        raise ValueError(f"{path}: unknown column {', '.join(map(repr, numbers))}; there are "
                         f"{', '.join(sorted(COLUMNS))}")
    direction = directions[0] if directions else None
    attitudes = attitudes_by_direction[direction] if direction else None
    return CsvTrajectory(times, positions, velocities, attitudes, direction, azimuths, start)


def _take_positions(path: Path, numbers: Dict[str, np.ndarray],
                    frame: str) -> Tuple[np.ndarray, Optional[np.ndarray]]:
    """Removes the columns of positions and velocities from `numbers` and returns them, in metres and metres/second."""
    positions = _take(path, numbers, POSITION_COLUMNS)
    velocities = _take(path, numbers, VELOCITY_COLUMNS)
    geodetic = _take(path, numbers, GEODETIC_COLUMNS)
    if positions is not None and geodetic is None:
        return positions, velocities
    if positions is not None or geodetic is None:
        raise ValueError(f"{path}: write either x_m, y_m, z_m or lat_deg, lon_deg, height_m")
    if velocities is not None or frame != "MOON_ME":
        raise ValueError(f"{path}: velocities and other frames than MOON_ME go with x_m, y_m, z_m")
    return np.array([position_of({"geodetic": dict(zip(GEODETIC_COLUMNS, row))}) for row in geodetic]), None


def _take(path: Path, numbers: Dict[str, np.ndarray], names: Tuple[str, ...]) -> Optional[np.ndarray]:
    """Removes these columns from `numbers` and returns them side by side; None where there is none of them."""
    present = [name for name in names if name in numbers]
    if present and len(present) < len(names):
        raise ValueError(f"{path}: there is {', '.join(present)} but not "
                         f"{', '.join(name for name in names if name not in numbers)}")
    return np.stack([numbers.pop(name) for name in names], -1) if present else None


def _read_columns(path: Path) -> Tuple[Dict[str, List[Any]], List[float]]:
    """Returns the columns by name (utc as text, all others as numbers), and the column time_s."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        lines = [(number, line) for number, line in enumerate(file, 1) if line.strip() and not line.startswith("#")]
    rows = list(csv.reader(line for _, line in lines))
    if len(rows) < 2:
        raise ValueError(f"{path}: a line of names and at least one of numbers are needed")
    names = [name.strip() for name in rows[0]]
    _check_names(path, names)
    columns: Dict[str, List[Any]] = {name: [] for name in names}
    for (number, _), row in zip(lines[1:], rows[1:]):
        if len(row) != len(names):
            raise ValueError(f"{path}, line {number}: {len(row)} values for {len(names)} columns")
        for name, text in zip(names, row):
            columns[name].append(text if name == "utc" else _number(text, name, f"{path}, line {number}"))
    return columns, columns.pop("time_s", [])


def _check_names(path: Path, names: List[str]) -> None:
    if len(names) == 1 and ";" in names[0]:
        raise ValueError(f"{path}: columns are separated by semicolons; commas are needed, and points in numbers")
    if len(set(names)) < len(names):
        raise ValueError(f"{path}: two columns have the same name")
    if ("time_s" in names) == ("utc" in names):
        raise ValueError(f"{path}: one column with the time is needed, time_s or utc; there are {', '.join(names)}")


def _number(text: str, name: str, where: str) -> float:
    """Returns the finite number of the column `name`. `where` begins an error's text."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{where}: {name} is {text!r}, no number")
    lower, upper = LIMITS.get(name, (value, value))
    if not lower <= value <= upper:
        raise ValueError(f"{where}: {name} is {text}; {lower} to {upper} is needed")
    return value
