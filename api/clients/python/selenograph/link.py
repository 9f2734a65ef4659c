"""Frames as a faulty link delivers them, with the truth of what happened to each."""

from __future__ import annotations

import dataclasses
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Tuple

import numpy as np

FAULTS = ("lost", "late", "repeated", "torn", "frozen")


@dataclasses.dataclass(frozen=True)
class Arrival:
    """A frame as it arrives.

    arrays   product to array; those of the frame that was sent, unless it is torn or frozen
    number   of the frame that it says it is, from 0
    fault    truth: "" or the fault that it has: "late", "repeated", "torn", "frozen"
    shows    truth: number of the frame whose pixels it has; of a torn one, above the tear
    tear_row truth: first row of a torn frame that the frame before it has; None: not torn
    """

    arrays: Mapping[str, np.ndarray]
    number: int
    fault: str
    shows: int
    tear_row: Optional[int] = None


class Link:
    """Loses, delays, repeats, tears and freezes frames at given rates, as a function of seed and frame number.

    lost      the frame never arrives
    late      it arrives 1 to `late_steps` steps later, after the frames of that step
    repeated  it arrives again one step later
    torn      from a random row on it has the rows of the frame before
    frozen    for 1 to `frozen_steps` frames it has the pixels of the frame before, under its own number

    Each rate is the probability that a frame begins to have that fault; together at most 1.
    """

    def __init__(self, seed: int, *, lost: float = 0, late: float = 0, repeated: float = 0, torn: float = 0,
                 frozen: float = 0, late_steps: int = 3, frozen_steps: int = 5) -> None:
        self._rates = (lost, late, repeated, torn, frozen)
        if min(self._rates) < 0 or sum(self._rates) > 1:
            raise ValueError("rates are probabilities, together at most 1")
        if late_steps < 1 or frozen_steps < 1:
            raise ValueError("late_steps and frozen_steps are at least 1")
        self._seed, self._late_steps, self._frozen_steps = seed, late_steps, frozen_steps

    def deliver(self, frames: Iterable[Mapping[str, np.ndarray]]) -> Iterator[List[Arrival]]:
        """Yields what arrives in each step: a step for each frame sent, then steps until nothing is under way.

        A frame is taken from `frames` when its step is asked for, so that a loop may depend on what arrived before.
        """
        under_way: Dict[int, List[Arrival]] = {}  # by the step of arrival
        before: Tuple[int, Optional[Mapping[str, np.ndarray]]] = (-1, None)  # pixels that the link sent last
        frozen_until = number = -1
        for number, frame in enumerate(frames):
            fault, random = self._fault_of(number)
            if number < frozen_until:
                fault = "frozen"
            elif fault == "frozen":
                frozen_until = number + int(random.integers(1, self._frozen_steps + 1))
            arrivals, before = self._send(number, frame, fault, random, before, under_way)
            yield arrivals + under_way.pop(number, [])
        while under_way:
            number += 1
            yield under_way.pop(number, [])

    def _fault_of(self, number: int) -> Tuple[str, np.random.Generator]:
        """Returns the fault that begins with a frame, and random numbers for its size."""
        random = np.random.default_rng([self._seed, number])
        drawn, limit = random.random(), 0.0
        for name, rate in zip(FAULTS, self._rates):
            limit += rate
            if drawn < limit:
                return name, random
        return "", random

    def _send(self, number: int, frame: Mapping[str, np.ndarray], fault: str, random: np.random.Generator,
              before: Any, under_way: Dict[int, List[Arrival]]) -> Tuple[List[Arrival], Any]:
        """Returns what arrives at once, and the pixels that the next frame has before it."""
        here = (number, frame)
        if fault in ("torn", "frozen") and before[1] is None:
            fault = ""  # nothing was sent before the first frame
        if fault == "frozen":
            return [Arrival(before[1], number, fault, before[0])], before
        if fault == "torn":
            rows = min(array.shape[0] for array in frame.values())
            row = int(random.integers(1, rows)) if rows > 1 else 0
            return [Arrival(_torn(frame, before[1], row / rows), number, fault, number, row)], here
        arrival = Arrival(frame, number, fault, number)
        if fault == "late":
            step = number + int(random.integers(1, self._late_steps + 1))
            under_way.setdefault(step, []).append(arrival)
            return [], here
        if fault == "repeated":
            under_way.setdefault(number + 1, []).append(arrival)
            return [dataclasses.replace(arrival, fault="")], here
        return ([] if fault == "lost" else [arrival]), here


def _torn(frame: Mapping[str, np.ndarray], before: Mapping[str, np.ndarray], share: float) -> Dict[str, np.ndarray]:
    """Returns a frame's arrays with the rows of the one before from a share of the height on."""
    out = {}
    for name, array in frame.items():
        row = round(share * array.shape[0])
        old = before.get(name)
        out[name] = array
        if old is not None and old.shape == array.shape:
            out[name] = np.concatenate((array[:row], old[row:]))
    return out
