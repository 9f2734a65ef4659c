"""Persistent HTTP connections to one service: timeouts, retries, and answers that are errors."""

from __future__ import annotations

import datetime
import email.utils
import functools
import http.client
import io
import json
import os
import re
import socket
import ssl
import threading
import time
import urllib.parse
from typing import Any, Dict, List, NamedTuple, Optional

from .errors import Refused
from .version import __version__

MAX_TIMEOUT_S = 1e6  # sockets accept at most 24 days
READ_BYTES = 1 << 20  # size of the pieces in which a body is read
MIN_RETRY_WAIT_S = 0.05  # lower bound of the wait for "Retry-After: 0", which would be a busy loop
SERVICE_TIME_MS_PER_S = 950  # time given to the service per second left, so that its 504 arrives in time
ZIP_MAGIC = b"PK"  # first bytes of a ZIP archive, with which no JSON text begins
MAX_ERROR_TEXT_BYTES = 300  # length to which an answer without a problem document is quoted


class HttpAnswer(NamedTuple):
    """A complete answer."""

    status: int
    headers: http.client.HTTPMessage
    content: bytes


class Deadline:
    """The time by which a call ends, all of its tries and waits together."""

    def __init__(self, timeout_s: float) -> None:
        self.timeout_s = timeout_s
        self._end_s = time.monotonic() + timeout_s

    def remaining_s(self) -> float:
        """Returns the time left, above 0. Raises socket.timeout (TimeoutError from Python 3.10 on) when it is over."""
        remaining_s = self._end_s - time.monotonic()
        if remaining_s <= 0:
            raise socket.timeout()
        return remaining_s

    def allows_wait(self, wait_s: float) -> bool:
        """Tells whether a wait ends before the deadline."""
        return time.monotonic() + wait_s <= self._end_s


class Connections:
    """Connections to one service. Several threads may use them: idle ones are shared, each call takes one."""

    def __init__(self, url: str, token: Optional[str], timeout_s: float) -> None:
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f"{url!r} is no address; write for example http://127.0.0.1:8080")
        if parts.username is not None or parts.query or parts.fragment:
            raise ValueError("an address has neither a user nor a query; a proxy that asks for one gets token=")
        if not 0 < timeout_s <= MAX_TIMEOUT_S:
            raise ValueError(f"timeout_s is {timeout_s!r}; seconds above 0, and up to 1e6, are needed")
        self.url = url.rstrip("/")
        self.token = token
        self.timeout_s = float(timeout_s)
        self._host = parts.hostname
        self._port = parts.port
        self._path_prefix = parts.path.rstrip("/")
        self._tls = ssl.create_default_context() if parts.scheme == "https" else None
        self._headers = {"User-Agent": f"selenograph-python/{__version__}"}
        if token is not None:
            self._headers["Authorization"] = f"Bearer {token}"
        self._lock = threading.Lock()  # guards _idle
        self._idle: List[http.client.HTTPConnection] = []
        self._process_id = os.getpid()
        self._is_closed = False

    def __del__(self) -> None:
        for connection in getattr(self, "_idle", ()):
            connection.close()

    def close(self) -> None:
        """Closes the connections. Calls in other threads get their answers."""
        self._is_closed = True
        self._drop_idle()

    def unexpected(self, what: str) -> ConnectionError:
        """Returns the error for an answer that selenograph never gives."""
        return ConnectionError(f"{self.url} doesn't answer as selenograph does: {what}")

    def call(self, method: str, path: str, body: Optional[bytes], accept: str,
             region: Optional[str] = None) -> HttpAnswer:
        """Returns an answer that is no error, of the media type `accept`.

        Repeats the request when a busy service (429 or 503 with Retry-After) says so, and once after a lost connection:
        every call only reads.
        """
        deadline = Deadline(self.timeout_s)
        was_lost = False
        try:
            while True:
                connection = self._take_connection(deadline)
                try:
                    answer = self._exchange(connection, method, path, body, accept, region, deadline)
                except (ConnectionError, http.client.IncompleteRead) as error:
                    if was_lost:
                        raise ConnectionError(
                            f"{self.url} closed two connections before its answer was whole") from error
                    was_lost = True
                    # Drop the idle connections too: after a restart of the service all of them are dead.
                    self._drop_idle()
                    continue
                except http.client.HTTPException as error:
                    raise ConnectionError(f"{self.url} doesn't answer as HTTP does: {error!r}") from error
                self._check_version(answer)
                if 200 <= answer.status < 300:
                    self._check_media_type(answer, accept)
                    return answer
                wait_s = _retry_after_s(answer.headers) if answer.status in (429, 503) else None
                if wait_s is None or not deadline.allows_wait(wait_s):
                    raise _refusal(answer)
                time.sleep(max(wait_s, MIN_RETRY_WAIT_S))
        except socket.timeout:
            raise TimeoutError(f"no answer from {self.url} within timeout_s = {deadline.timeout_s:g} s") from None

    def _exchange(self, connection: http.client.HTTPConnection, method: str, path: str, body: Optional[bytes],
                  accept: str, region: Optional[str], deadline: Deadline) -> HttpAnswer:
        """Sends one request and reads its whole answer. Then the connection is idle; after an error it is closed."""
        try:
            remaining_s = deadline.remaining_s()
            connection.sock.settimeout(remaining_s)
            headers = self._headers_of(body, accept, region, remaining_s)
            connection.response_class = functools.partial(_TimedResponse, deadline)  # type: ignore[assignment]
            connection.request(method, self._path_prefix + path, body, headers)
            response = connection.getresponse()
            content = _read_body(response)
        except BaseException:
            connection.close()
            raise
        if response.will_close or self._is_closed:
            connection.close()
        else:
            with self._lock:
                self._idle.append(connection)
        return HttpAnswer(response.status, response.headers, content)

    def _headers_of(self, body: Optional[bytes], accept: str, region: Optional[str],
                    remaining_s: float) -> Dict[str, str]:
        headers = {**self._headers, "Accept": accept}
        if region is not None:
            headers["Selenograph-Region"] = region
        if body is not None:
            headers["Content-Type"] = "application/x-npz" if body.startswith(ZIP_MAGIC) else "application/json"
            headers["Request-Timeout-Ms"] = str(max(1, int(SERVICE_TIME_MS_PER_S * remaining_s)))
        return headers

    def _take_connection(self, deadline: Deadline) -> http.client.HTTPConnection:
        """Returns an idle connection, or a new one."""
        if self._process_id != os.getpid():
            # After a fork, drop the parent's connections: two processes must not share one. Closing affects this
            # process only.
            self._process_id = os.getpid()
            self._drop_idle()
        with self._lock:
            if self._idle:
                return self._idle.pop()
        timeout_s = deadline.remaining_s()
        connection = (http.client.HTTPSConnection(self._host, self._port, timeout=timeout_s, context=self._tls)
                      if self._tls else http.client.HTTPConnection(self._host, self._port, timeout=timeout_s))
        try:
            connection.connect()  # also sets TCP_NODELAY
        except socket.timeout:
            raise
        except ssl.SSLError as error:
            raise ConnectionError(f"{self.url}: no TLS connection: {error}") from error
        except OSError as error:
            raise ConnectionError(f"nothing answers at {self.url} ({error}): is the service running? It is started by "
                                  "`selenograph serve`, which prints its address") from error
        return connection

    def _drop_idle(self) -> None:
        with self._lock:
            idle = self._idle
            self._idle = []
        for connection in idle:
            connection.close()

    def _check_version(self, answer: HttpAnswer) -> None:
        """Raises ConnectionError for a service of another major version, in which members may mean something else.

        Services send "Server: selenograph/1.2.3". A proxy may hide it: then nothing is checked.
        """
        service = re.match(r"selenograph/(\d+)\.", answer.headers.get("Server", ""))
        if service and service[1] != __version__.split(".")[0]:
            raise ConnectionError(f"{self.url} is of version {service[1]}, but this client, {__version__}, works with "
                                  f"services of its own major version: install the client of version {service[1]}")

    def _check_media_type(self, answer: HttpAnswer, accept: str) -> None:
        """Raises ConnectionError for another media type than the one in `accept`: a proxy's login page, for example.

        A caller that accepts several media types reads the type from the headers.
        """
        media_type = answer.headers.get_content_type()
        if media_type != accept.lower() and not set("*,;") & set(accept):
            raise self.unexpected(f"with {media_type} where {accept} was asked for")


class _TimedResponse(http.client.HTTPResponse):
    """An answer whose head and body arrive by a deadline. A socket's own timeout starts anew with every byte."""

    def __init__(self, deadline: Deadline, sock: socket.socket, *arguments: Any, **options: Any) -> None:
        super().__init__(sock, *arguments, **options)
        self.fp = io.BufferedReader(_TimedReader(deadline, sock, self.fp.detach()))


class _TimedReader(io.RawIOBase):
    """Reads a socket until a deadline."""

    def __init__(self, deadline: Deadline, sock: socket.socket, reader: io.RawIOBase) -> None:
        self._deadline = deadline
        self._sock = sock
        self._reader = reader

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> Optional[int]:
        self._sock.settimeout(self._deadline.remaining_s())
        return self._reader.readinto(buffer)

    def close(self) -> None:
        self._reader.close()
        super().close()


def _read_body(response: http.client.HTTPResponse) -> bytes:
    pieces = []
    while True:
        piece = response.read(READ_BYTES)
        if not piece:
            break
        pieces.append(piece)
    # Check the length: a sized read returns the bytes there are, without an error when the body is cut short.
    if response.length:
        raise http.client.IncompleteRead(b"", response.length)
    return b"".join(pieces)


def _retry_after_s(headers: http.client.HTTPMessage) -> Optional[float]:
    """Returns the header Retry-After, seconds or a date, in seconds from now; None without one."""
    text = (headers.get("Retry-After") or "").strip()
    if re.fullmatch(r"\d+", text):
        return float(text)
    try:
        date = email.utils.parsedate_to_datetime(text)
    except (TypeError, ValueError):
        return None
    if date.tzinfo is None:
        date = date.replace(tzinfo=datetime.timezone.utc)
    return max(0.0, (date - datetime.datetime.now(datetime.timezone.utc)).total_seconds())


def _refusal(answer: HttpAnswer) -> Refused:
    """Returns the exception of an answer that is an error."""
    if answer.headers.get_content_type() == "application/problem+json":
        problem = _problem_of(answer.content)
        if problem is not None:
            return Refused(answer.status, problem)
    start = answer.content[:MAX_ERROR_TEXT_BYTES].decode("utf-8", "replace").strip()
    return Refused(answer.status, {}, answer.headers.get("Location") or start)


def _problem_of(content: bytes) -> Optional[Dict[str, Any]]:
    """Returns a problem document; None for a text that is none."""
    try:
        problem = json.loads(content)
    except ValueError:
        return None
    errors = problem.get("errors") or [] if isinstance(problem, dict) else None
    is_problem = isinstance(errors, list) and all(
        isinstance(error, dict) and isinstance(error.get("pointer", ""), str) for error in errors)
    return problem if is_problem else None
