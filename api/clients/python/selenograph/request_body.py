"""The body of a request: JSON, or an NPZ archive with JSON and arrays."""

from __future__ import annotations

import collections.abc
import datetime
import json
import math
import os
from typing import Any, Dict, Iterable, Mapping, Optional, Tuple

import numpy as np

from .epochs import utc_text
from .npz import write_npz


def without_none(**members: Any) -> Dict[str, Any]:
    """Returns the members that are not None."""
    return {name: value for name, value in members.items() if value is not None}


def json_body(document: Any) -> bytes:
    """Returns the JSON text of a request."""
    if not isinstance(document, collections.abc.Mapping):
        raise TypeError(f"a request is a dict, not {type(document).__name__}; json.loads makes one of a text")
    try:
        return json.dumps(document, default=_plain, allow_nan=False, separators=(",", ":")).encode()
    except ValueError:
        fault = _first_not_finite(document)
        if fault is None:
            raise
        raise ValueError(f"a request holds finite numbers only: {fault}") from None


def npz_body(document: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> bytes:
    """Returns a request with arrays in place of lists."""
    return write_npz(json_body(document), arrays)


def _plain(value: Any) -> Any:
    """Converts NumPy's numbers and arrays, mappings, epochs and paths to what JSON has."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, collections.abc.Mapping):
        return dict(value)
    if isinstance(value, datetime.datetime):
        return utc_text(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"{type(value).__name__} cannot be part of a request: {value!r}")


def _first_not_finite(value: Any, pointer: str = "") -> Optional[str]:
    """Returns the JSON Pointer and the value of the first number that is NaN or infinite."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, float):
        return None if math.isfinite(value) else f"{pointer} is {value}"
    items: Iterable[Tuple[Any, Any]] = ()
    if isinstance(value, collections.abc.Mapping):
        items = value.items()
    elif isinstance(value, (list, tuple)):
        items = enumerate(value)
    return next(filter(None, (_first_not_finite(v, f"{pointer}/{k}") for k, v in items)), None)
