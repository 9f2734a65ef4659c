"""Calls of the service with JSON or arrays. Long lists are sent in pieces."""

from __future__ import annotations

import http.client
import json
from typing import Any, Dict, List, Optional

import numpy as np

from .answers import Answer, stage_timing
from .connections import Connections
from .errors import Refused, reading_answer, warn_caller
from .npz import read_npz
from .region import region_of
from .request_body import json_body, npz_body

# Rays or points of one request. The service's default limits are 100 000 rays and 4 MiB of text, which is less. Each
# answer depends on its own ray alone, so that pieces give the same answers.
POINTS_AT_ONCE = 10000
ROWS_AT_ONCE = 65536  # rows of arrays in one request


class Calls:
    """Calls of one service: what `Client` sends, and what comes back."""

    def __init__(self, connections: Connections) -> None:
        self.connections = connections

    def document(self, path: str, request: Any = None) -> Dict[str, Any]:
        """Returns the JSON object of a GET or, with a request, of a POST, and warns of the answer's warnings."""
        method, body, region = ("GET", None, None) if request is None else (
            "POST", json_body(request), region_of(request))
        answer = self.connections.call(method, path, body, "application/json", region)
        document = self._document(answer.content)
        warn_caller(warnings_of(answer.headers))
        return document

    def post_encoded(self, path: str, document: Any, media_type: str) -> Answer:
        """Returns a frame or map in the media type."""
        answer = self.connections.call("POST", path, json_body(document), media_type, region_of(document))
        headers = answer.headers
        with reading_answer():
            echo = json.loads(headers.get("Selenograph-Echo", "null"))
        return Answer(answer.content, headers.get_content_type(), stage_timing(headers.get("Server-Timing")),
                      headers.get("ETag"), echo, headers)

    def post_objects(self, path: str, document: Any, name: str, region: Optional[str] = None) -> List[Dict[str, Any]]:
        """Returns the list `name` of an answer in JSON, and warns of the answer's warnings."""
        answer = self.connections.call("POST", path, json_body(document), "application/json", region)
        found = self._document(answer.content).get(name)
        if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
            raise self.connections.unexpected(f"its {name!r} is no list of objects")
        warn_caller(warnings_of(answer.headers))
        return found

    def post_list(self, path: str, name: str, items: List[Any], common: Dict[str, Any]) -> List[Dict[str, Any]]:
        """Returns the list `name` of the answers to requests with the list `name`, in pieces."""
        answers: List[Dict[str, Any]] = []
        for start in range(0, len(items), POINTS_AT_ONCE):
            piece = items[start:start + POINTS_AT_ONCE]
            document = {**common, name: piece}
            try:
                found = self.post_objects(path, document, name, region_of(document))
            except Refused as refused:
                if not start:
                    raise
                raise Refused(refused.status, _pointers_shifted(refused.problem, f"/{name}/", start)) from None
            if len(found) != len(piece):
                raise self.connections.unexpected(f"{len(found)} {name} of {len(piece)}")
            answers += found
        return answers

    def post_arrays(self, path: str, arrays: Dict[str, np.ndarray], common: Dict[str, Any]) -> Dict[str, Any]:
        """Returns the answer's arrays, in pieces. The request's arrays have equally many rows."""
        pieces: List[Dict[str, np.ndarray]] = []
        texts: Dict[str, None] = {}  # the pieces' warnings, each text once, in order
        for start in range(0, len(next(iter(arrays.values()))), ROWS_AT_ONCE):
            rows = {name: array[start:start + ROWS_AT_ONCE] for name, array in arrays.items()}
            located = {"rays": [{"origin_m": rows["origin_m"][0]}]} if "origin_m" in rows else common
            try:
                answer = self.connections.call("POST", path, npz_body(common, rows), "application/x-npz",
                                               region_of(located))
            except Refused as refused:
                if not start:
                    raise
                problem = refused.problem
                for name in arrays:
                    problem = _pointers_shifted(problem, f"/{name}/", start)
                raise Refused(refused.status, problem) from None
            with reading_answer():
                pieces.append(read_npz(answer.content)[0])
            texts.update(dict.fromkeys(warnings_of(answer.headers)))
        warn_caller(texts)
        with reading_answer():
            return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]} if pieces else {}

    def _document(self, content: bytes) -> Dict[str, Any]:
        try:
            document = json.loads(content)
        except ValueError:
            document = None
        if not isinstance(document, dict):
            raise self.connections.unexpected(f"{content[:60]!r} is no JSON object")
        return document


@reading_answer()
def warnings_of(headers: http.client.HTTPMessage) -> List[str]:
    """Returns the texts of the header Selenograph-Warnings."""
    return [str(text) for text in json.loads(headers.get("Selenograph-Warnings", "[]"))]


def _pointers_shifted(problem: Dict[str, Any], prefix: str, by: int) -> Dict[str, Any]:
    """Returns the problem of a piece of a list, with the pointers of the whole list."""
    def shifted(pointer: str) -> str:
        head, slash, tail = pointer[len(prefix):].partition("/")
        return f"{prefix}{int(head) + by}{slash}{tail}" if pointer.startswith(prefix) and head.isdigit() else pointer

    errors = [dict(error, pointer=shifted(error.get("pointer", ""))) for error in problem.get("errors") or []]
    return {**problem, "errors": errors, "detail": f"of the items from {by} on: {problem.get('detail')}"}
