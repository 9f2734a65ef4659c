"""Results of calls: frames, maps and scans."""

from __future__ import annotations

import dataclasses
import http.client
import re
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple

import numpy as np

from .errors import reading_answer, warn_caller
from .npz import read_npz


@dataclasses.dataclass(frozen=True)
class Answer:
    """A frame or map as the service sent it, and what its headers say."""

    content: bytes
    media_type: str
    timing: Dict[str, float]  # milliseconds by stage
    etag: Optional[str]  # header ETag with its quotes; None for a frame with an unusable DEM file
    echo: Optional[Dict[str, Any]]  # the request's "echo"
    headers: http.client.HTTPMessage


class Frame(Mapping[str, np.ndarray]):
    """The products of a frame or map: `frame["radiance"]` is a NumPy array, row 0 on top.

    meta      metadata: the resolved request, the DEM tiles used, bounds on errors, warnings, content hash
    timing    milliseconds by stage, from the header Server-Timing; "total" is the whole request
    etag      the header ETag, with its quotes; None for a frame whose bytes must not be cached
    echo      the request's "echo", from the header Selenograph-Echo; None without
    warnings  texts of the metadata's warnings, empty for a frame that is in order; with several cameras each text
              begins with its camera's name
    """

    @reading_answer()
    def __init__(self, answer: Answer) -> None:
        self._arrays, texts = read_npz(answer.content)
        self.meta: Dict[str, Any] = texts.get("meta", {})
        self.timing = answer.timing
        self.etag = answer.etag
        self.echo = answer.echo
        self.warnings: List[str] = list(self.meta.get("warnings") or [])
        for name, camera in self.meta.get("cameras", {}).items():
            self.warnings += [f"{name}: {text}" for text in camera.get("warnings") or []]

    def __getitem__(self, product: str) -> np.ndarray:
        try:
            return self._arrays[product]
        except KeyError:
            raise KeyError(f"{product!r}: the frame has {', '.join(self._arrays)}; name it in the request's "
                           "\"products\"") from None

    def __contains__(self, product: object) -> bool:
        return product in self._arrays

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __repr__(self) -> str:
        products = ", ".join(f"{name}: {a.dtype} {'x'.join(map(str, a.shape))}" for name, a in self._arrays.items())
        return f"<selenograph.Frame {products}>"


def with_warnings(frame: Frame) -> Frame:
    """Returns the frame, and warns of its warnings."""
    warn_caller(frame.warnings)
    return frame


class Scan(Mapping[str, np.ndarray]):
    """A lidar's scan: `scan["range_m"]` is a NumPy array. Its metadata is `meta`."""

    @reading_answer()
    def __init__(self, content: bytes, shape: Optional[Tuple[int, ...]] = None) -> None:
        arrays, texts = read_npz(content)
        self.meta: Dict[str, Any] = texts.get("meta", {})
        self.shape = tuple(self.meta["shape"]) if shape is None else shape
        self._arrays = {name: a.reshape(self.shape + a.shape[1:]) for name, a in arrays.items()}

    def points_m(self, ranges: str = "range_m") -> np.ndarray:
        """Returns the points on the beams' axes at these ranges, MOON_ME.

        ranges: the name of measured (range_m, first_m, last_m) or true ranges.
        """
        return self["origin_m"] + self[ranges][..., None] * self["direction"]

    def __getitem__(self, name: str) -> np.ndarray:
        return self._arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __repr__(self) -> str:
        return f"<selenograph.Scan {'x'.join(map(str, self.shape))}: {', '.join(self._arrays)}>"


def stage_timing(header: Optional[str]) -> Dict[str, float]:
    """Returns milliseconds by stage from the header Server-Timing."""
    # Skip durations that are no numbers: a proxy may add entries of any kind.
    found = re.findall(r"([^\s;,]+)\s*;(?:[^,]*;)?\s*dur=(\d+\.?\d*(?:[eE][+-]?\d+)?)(?![^\s;,])", header or "")
    return {name: float(duration) for name, duration in found}
