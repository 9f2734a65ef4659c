"""Answers to many requests, in order: one at a time, or several in flight."""

from __future__ import annotations

import collections.abc
import threading
from typing import Any, Callable, Dict, Iterable, List, Optional, Sequence, Tuple, Union

from .errors import Refused
from .request_types import Request

MAX_AHEAD = 64  # upper bound of the poses in a request's "ahead"

Ask = Callable[[Request], Any]
Result = Tuple[Any, Optional[BaseException]]  # an answer, or an error


def answers_in_order(requests: Iterable[Request], in_flight: int, ahead: int, ask: Ask) -> AnswersInOrder:
    """Returns an iterator over `ask(request)` of each request; its stop() ends the work early.

    Each request without "ahead" gets the poses of the `ahead` requests after it, if `requests` is a sequence.
    """
    if in_flight < 1 or int(in_flight) != in_flight:
        raise ValueError(f"in_flight is {in_flight!r}; a whole number from 1 on is needed")
    if not 0 <= ahead <= MAX_AHEAD or int(ahead) != ahead:
        raise ValueError(f"ahead is {ahead!r}; a whole number from 0 to {MAX_AHEAD} is needed")
    if isinstance(requests, collections.abc.Mapping):
        raise TypeError("frames takes several requests, e.g. a list of them; for one there is frame()")
    asker = _AskerAhead(requests, int(ahead), ask)
    if in_flight == 1:
        return OneAtATime(requests, asker)
    return Pipeline(requests, int(in_flight), asker)


class _AskerAhead:
    """Asks with the poses of the requests to come, where they are known."""

    def __init__(self, requests: Iterable[Request], ahead: int, ask: Ask) -> None:
        self._sequence: Sequence[Request] = requests if isinstance(requests, collections.abc.Sequence) else ()
        self._ahead = ahead
        self._ask = ask

    def answer(self, number: int, request: Request) -> Any:
        """Returns the answer to request `number`."""
        poses = self._poses_after(number)
        if not poses or "ahead" in request:
            return self._ask(request)
        try:
            return self._ask({**request, "ahead": poses})
        except Refused as refused:
            if not refused.pointers or not all(pointer.split("/")[1:2] == ["ahead"] for pointer in refused.pointers):
                raise
        # Ask without "ahead": a faulty pose in it is the fault of the later request that it comes from.
        return self._ask(request)

    def _poses_after(self, number: int) -> List[Any]:
        """Returns the poses after request `number`, up to the first request without one (with several cameras)."""
        poses: List[Any] = []
        # Index one by one: a deque has no slices, and a list may grow meanwhile.
        for next_number in range(number + 1, min(number + 1 + self._ahead, len(self._sequence))):
            request = self._sequence[next_number]
            if not isinstance(request, collections.abc.Mapping) or "pose" not in request:
                break
            poses.append(request["pose"])
        return poses


class OneAtATime:
    """One request at a time. The next one is taken from the iterable after the loop has processed the last answer."""

    def __init__(self, requests: Iterable[Request], asker: _AskerAhead) -> None:
        self._requests = enumerate(requests)
        self._asker = asker

    def __iter__(self) -> OneAtATime:
        return self

    def __next__(self) -> Any:
        number, request = next(self._requests)
        return self._asker.answer(number, request)

    def stop(self) -> None:
        """Does nothing: no request is in flight between two answers."""


class Pipeline:
    """Several requests in flight: as many threads each take a request, ask, and store the answer for the loop."""

    def __init__(self, requests: Iterable[Request], in_flight: int, asker: _AskerAhead) -> None:
        self._requests = iter(requests)
        self._in_flight = in_flight
        self._asker = asker
        self._taking = threading.Lock()  # held while the iterable is asked for a request, which may take for ever
        self._changed = threading.Condition()  # guards the members below
        self._taken_count = 0
        self._results: Dict[int, Result] = {}
        self._awaited = -1  # number of the answer that the loop waits for
        self._end: Optional[int] = None  # number of requests, once the iterable is exhausted
        self._is_started = False
        self._is_stopped = False

    def __iter__(self) -> Pipeline:
        return self

    def __next__(self) -> Any:
        self._start()
        with self._changed:
            # Release a further request only now: until it came back, the loop may have changed what requests are made
            # from.
            self._awaited += 1
            number = self._awaited
            self._changed.notify_all()
            self._changed.wait_for(lambda: number in self._results or self._is_stopped or number == self._end)
            if number not in self._results:
                raise StopIteration
            answer, error = self._results.pop(number)
        if error is not None:
            self.stop()
            raise error
        return answer

    def stop(self) -> None:
        """Stops taking requests. Requests in flight end by themselves, and their answers are dropped."""
        with self._changed:
            self._is_stopped = True
            self._changed.notify_all()

    def _start(self) -> None:
        if self._is_started:
            return
        self._is_started = True
        for _ in range(self._in_flight):
            # Daemon threads do not keep a program alive that ends.
            threading.Thread(target=self._answer_requests, name="selenograph frames", daemon=True).start()

    def _answer_requests(self) -> None:
        """Runs in each thread: answers requests until the iterable ends or stop() is called."""
        while True:
            taken = self._take_request()
            if taken is None:
                return
            number, request = taken
            self._store(number, self._result(number, request))

    def _take_request(self) -> Optional[Tuple[int, Request]]:
        """Returns the next request and its number once the loop is ready for it; None at the end."""
        with self._taking:
            with self._changed:
                number = self._taken_count
                self._changed.wait_for(lambda: self._is_stopped or number < self._awaited + self._in_flight)
                if self._is_stopped or self._end is not None:
                    return None
            try:
                request = next(self._requests)
            except BaseException as error:
                with self._changed:
                    self._end = number
                    # Hand the iterable's own error to the loop.
                    if not isinstance(error, StopIteration):
                        self._results[number] = None, error
                    self._changed.notify_all()
                return None
            self._taken_count += 1
            return number, request

    def _result(self, number: int, request: Request) -> Result:
        try:
            return self._asker.answer(number, request), None
        except BaseException as error:
            return None, error

    def _store(self, number: int, result: Result) -> None:
        with self._changed:
            self._results[number] = result
            self._changed.notify_all()


AnswersInOrder = Union[OneAtATime, Pipeline]
