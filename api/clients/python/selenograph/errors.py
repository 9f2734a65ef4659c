"""The exceptions and the warning that calls raise."""

from __future__ import annotations

import contextlib
import http.client
import struct
import sys
import types
import warnings
import zipfile
import zlib
from typing import Any, Dict, Iterable, Iterator, List, Optional


class Refused(Exception):
    """The service's answer was an error.

    status   HTTP status: 422 for a request that is impossible, 503 for a busy service, ...
    problem  the problem document (RFC 9457) as a dict: "type", "title", "detail", and "errors", a list of
             {"pointer": ..., "detail": ...} with a JSON Pointer to each member at fault; empty if the answer had none
    """

    def __init__(self, status: int, problem: Dict[str, Any], text: str = "") -> None:
        self.status = status
        self.problem = problem
        self._text = text  # text of an answer without a problem document
        errors = problem.get("errors") or []
        lines = [f"{status} {problem.get('title') or http.client.responses.get(status, 'unknown status')}"]
        # With a single error, the problem's detail repeats the error's.
        if problem.get("detail") and len(errors) != 1:
            lines[0] += f": {problem['detail']}"
        elif text and not problem:
            lines[0] += f": {text}"
        lines += [f"  {error.get('pointer') or 'the body'}: {error.get('detail')}" for error in errors]
        super().__init__("\n".join(lines))

    def __reduce__(self) -> Any:
        # Pickle all arguments: the exception's own method pickles the message only.
        return Refused, (self.status, self.problem, self._text)

    @property
    def pointers(self) -> List[str]:
        """JSON Pointers of the members at fault."""
        return [error["pointer"] for error in self.problem.get("errors") or [] if "pointer" in error]


class FrameWarning(UserWarning):
    """A frame, a map, rays or landmarks are probably not as intended: the service says why."""


@contextlib.contextmanager
def reading_answer() -> Iterator[None]:
    """Turns the errors of code that reads an answer into ConnectionError. Also serves as a decorator.

    Such an answer comes from another program than selenograph, or was cut off undetected.
    """
    try:
        yield
    except (ArithmeticError, AttributeError, EOFError, LookupError, RuntimeError, TypeError, ValueError, struct.error,
            zipfile.BadZipFile, zlib.error) as error:
        raise ConnectionError(f"the answer cannot be read as selenograph's: {error!r}") from error


def warn_caller(texts: Iterable[str]) -> None:
    """Warns of each text at the line outside this package that called it."""
    level = 1
    frame: Optional[types.FrameType] = sys._getframe()
    while frame is not None and frame.f_globals.get("__package__") == __package__:
        frame = frame.f_back
        level += 1
    for text in texts:
        warnings.warn(text, FrameWarning, stacklevel=level)
