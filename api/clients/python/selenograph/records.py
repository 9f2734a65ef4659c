"""Record arrays from the service's answers."""

from __future__ import annotations

import math
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import numpy as np

from .errors import reading_answer

Fields = Sequence[Tuple[Any, ...]]  # (name, type) or (name, type, size), as in a NumPy dtype


@reading_answer()
def records_of_objects(objects: List[Dict[str, Any]], fields: Fields, shape: Tuple[int, ...]) -> np.recarray:
    """Returns JSON objects as a record array of the shape. Missing numbers are NaN, missing texts None."""
    records = np.zeros(len(objects), dtype=list(fields))
    for name, kind, *_ in fields:
        missing = math.nan if kind is float else None if kind is object else False
        for i, json_object in enumerate(objects):
            value = json_object.get(name)
            records[name][i] = missing if value is None else value
    return _shaped(records, shape)


@reading_answer()
def records_of_arrays(arrays: Mapping[str, Any], fields: Fields, shape: Tuple[int, ...]) -> np.recarray:
    """Returns arrays as a record array of the shape. Fields without an array are NaN."""
    records = np.zeros(math.prod(shape), dtype=list(fields))
    # Skip an empty list: nothing was requested, and there are no arrays.
    if len(records):
        for name, *_ in fields:
            records[name] = arrays.get(name, math.nan)
    return _shaped(records, shape)


def _shaped(records: np.ndarray, shape: Tuple[int, ...]) -> Any:
    """Returns the record array in the shape; for the shape () its only record."""
    return records.reshape(shape).view(np.recarray)[() if not shape else ...]
