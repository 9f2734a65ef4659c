#!/usr/bin/env python3
"""SOAK_REQUESTS mixed requests (300 unless the environment says otherwise) for frames of up to SOAK_PIXELS (64) a side,
a quarter of them hostile.

Each well-formed request gets exactly one complete answer, the same every time; each hostile one is refused with the status of
its fault or loses its connection; nothing grows. Python's standard library only.
"""

import collections
import concurrent.futures
import hashlib
import http.client
import json
import os
import random
import socket
import statistics
import struct
import sys
import threading
import time
import types
import unittest

import harness
from harness import Service, frame_request, tearDownModule
from mixture import PLACE, Mixture

REQUESTS = int(os.environ.get("SOAK_REQUESTS", "300"))
PIXELS = int(os.environ.get("SOAK_PIXELS", "64"))  # a side of a frame, at most
CLIENTS = 4
DIFFERENT = 150  # well-formed requests, sent again and again
HOSTILE = 0.25
BUDGET_MB = 32
MEMORY_MB = 1536  # for everything: frames with detail on the ground take a few hundred
MEBI = 1 << 20
MOST_FILES = 72  # 32 idle tiles, open twice each, and maps
IDLE_S = 5  # before a connection without requests is closed
LONG = 5000  # requests from which on a trend of memory shows


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE)
    harness.assets()


def raw(method, path, headers, body):
    """A request's bytes."""
    lines = [f"{method} {path} HTTP/1.1", "Host: localhost"] + [f"{name}: {value}" for name, value in headers.items()]
    if body is not None:
        lines.append(f"Content-Length: {len(body)}")
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + (body or b"")


def json_post(document, path="/v1/frames"):
    return raw("POST", path, {"Content-Type": "application/json"}, json.dumps(document).encode())


class Wire:
    """One connection, byte by byte."""

    def __init__(self, service):
        self.socket = socket.create_connection((service.host, service.port), timeout=harness.PATIENCE_S)
        self.incoming = self.socket.makefile("rb")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.incoming.close()
        self.socket.close()

    def send(self, data):
        """Whether all of it was taken: a server may answer and close before."""
        try:
            self.socket.sendall(data)
            return True
        except (BrokenPipeError, ConnectionResetError):
            return False

    def answer(self):
        """One complete answer (status, body), or None when the connection has ended."""
        try:
            line = self.incoming.readline()
            if not line:
                return None
            headers = http.client.parse_headers(self.incoming)
            length = int(headers["Content-Length"])
            body = self.incoming.read(length)
        except ConnectionResetError:
            return None
        if len(body) != length:
            raise AssertionError(f"{len(body)} of {length} bytes: {line!r}")
        return int(line.split()[1]), body

    def ended(self):
        """True when nothing but the end comes."""
        try:
            return self.incoming.read(1) == b""
        except ConnectionResetError:
            return True

    def reset(self):
        """Leaves with a reset instead of a goodbye."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.__exit__()


# What a hostile client sends, and the statuses of which it gets one. Where the server closes, nothing may follow.
# name: (bytes, statuses, whether the connection ends with the answer)
def frame(**changes):
    return frame_request(width=16, height=16, **changes)


CAMERA = frame()["camera"]
REFUSED = {
    "not json": (raw("POST", "/v1/frames", {"Content-Type": "application/json"}, b'{"camera": '), 400, False),
    "deep json": (raw("POST", "/v1/rays", {"Content-Type": "application/json"}, b"[" * 5000), 400, False),
    "not utf-8": (raw("POST", "/v1/frames", {"Content-Type": "application/json"}, b'{"\xff\xfe": 1}'), 400, False),
    "wrong types": (json_post(frame(pose=[1, "a", None], sun=7)), 422, False),
    "unknown members": (json_post(frame(**{"x" * 60: 1, "prodcts": []})), 422, False),
    "too many pixels": (json_post(frame(camera=dict(CAMERA, width=8192, height=8192))), 422, False),
    "too wide": (json_post(frame(camera=dict(CAMERA, width=10**9))), 422, False),
    "below ground": (json_post(frame(pose={"geodetic": {"lat_deg": 0, "lon_deg": 30, "height_m": -40000}, "nadir": {}})), 422, False),
    "too many rays": (json_post({"rays": [0] * 100001}, "/v1/rays"), 422, False),
    "other type": (raw("POST", "/v1/frames", {"Content-Type": "text/plain"}, b"{}"), 415, False),
    "no such form": (raw("POST", "/v1/frames", {"Content-Type": "application/json", "Accept": "image/gif"},
                         json.dumps(frame()).encode()), 406, False),
    "no such place": (raw("GET", "/v2/frames", {}, None), 404, False),
    "wrong method": (raw("DELETE", "/v1/frames", {}, None), 405, False),
    "huge header": (raw("GET", "/v1/datasets", {"X": "y" * 20000}, None), 400, True),
    "many headers": (raw("GET", "/v1/datasets", {f"X-{i}": i for i in range(3000)}, None), 400, True),
    "long target": (raw("GET", "/" + "a" * 9000, {}, None), 414, True),
    "announced too large": (raw("POST", "/v1/frames", {"Content-Type": "application/json", "Content-Length": 10**12}, None), 413, True),
    "bad chunk": (raw("POST", "/v1/frames", {"Transfer-Encoding": "chunked"}, None) + b"zz\r\n{}\r\n", 400, True),
    "endless chunks": (raw("POST", "/v1/frames", {"Transfer-Encoding": "chunked"}, None) + b"80000\r\n" + b" " * 0x80000 + b"\r\n", 413, True),
    "no http": (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", 400, True),
    "truncated body": (raw("POST", "/v1/frames", {"Content-Type": "application/json"}, b"x" * 900)[:-500], 400, True),
}


class Soak(unittest.TestCase):
    def setUp(self):
        self.service = Service("--assets-dir", harness.path("assets"), "--cache-mb", str(BUDGET_MB), "--scene-mb", str(BUDGET_MB), "--mesh-mb", str(BUDGET_MB), "--memory-mb", str(MEMORY_MB),
                               "--idle-timeout-s", str(IDLE_S), "--max-waiting", "64", "--max-body-kb", "600", "--log-level", "error")
        mixture = Mixture(seed=2, most_pixels_a_side=PIXELS)
        self.wellformed = [mixture.next() for _ in range(DIFFERENT)]
        self.first = {}  # digest of the first answer to each
        self.lock = threading.Lock()
        self.faults = []
        self.counts = {}

    def count(self, kind, fault=None):
        with self.lock:
            self.counts[kind] = self.counts.get(kind, 0) + 1
            if fault:
                self.faults.append((kind, fault))

    def judge(self, i, status, body):
        """A well-formed request's answer: whole, 200, and the same as ever."""
        digest = hashlib.sha256(body).digest()
        with self.lock:
            same = self.first.setdefault(i, digest) == digest
        self.count("well-formed", None if status == 200 and same else (self.wellformed[i], status, body[:200], same))

    # --- what a client does; each answers once it is sure of the outcome ---

    def ordinary(self, client):
        i = client.random.randrange(DIFFERENT)
        method, path, headers, body = self.wellformed[i]
        if time.monotonic() - client.used > IDLE_S / 2:
            client.connection.close()  # the service may have closed it, or be about to: the request opens it again
        status, _, content = self.service.ask(method, path, body, headers, client.connection)
        client.used = time.monotonic()
        self.judge(i, status, content)

    def pipelined(self, client):
        chosen = [client.random.randrange(DIFFERENT) for _ in range(5)]
        with Wire(self.service) as wire:
            wire.send(b"".join(raw(*self.wellformed[i]) for i in chosen))
            for i in chosen:
                self.judge(i, *(wire.answer() or (0, b"")))

    def refused(self, client):
        name = client.random.choice(list(REFUSED))
        data, status, ends = REFUSED[name]
        with Wire(self.service) as wire:
            wire.send(data)
            if name == "endless chunks":
                wire.send(b"80000\r\n" + b" " * 0x80000)
            if name == "truncated body":
                wire.socket.shutdown(socket.SHUT_WR)
            answer = wire.answer()
            fault = None
            if answer is None:
                fault = None if ends else "no answer"
            elif answer[0] != status or json.loads(answer[1])["status"] != status:
                fault = answer
            elif ends and not wire.ended():
                fault = "more after the answer"
            elif not ends:  # the connection is as good as new
                wire.send(raw("GET", "/health/live", {}, None))
                fault = None if (wire.answer() or [0])[0] == 200 else "unusable after a refusal"
        self.count(name, fault)

    def slow(self, client):
        """A head or a body that dribbles in, and of which the end never comes."""
        whole = json_post(frame())
        data = whole[:client.random.choice([10, 60, len(whole) - 20])]
        with Wire(self.service) as wire:
            for i in range(0, len(data), max(1, len(data) // 4)):
                if not wire.send(data[i:i + max(1, len(data) // 4)]):
                    break
                time.sleep(0.1)
        self.count("slow")

    def abrupt(self, client):
        """Leaves at any point: before, within and after the request, with the answer unread."""
        data = json_post(frame_request(["position"], width=200, height=200, samples=4))
        wire = Wire(self.service)
        wire.send(data[:client.random.choice([0, 30, len(data) - 5, len(data), len(data)])])
        time.sleep(client.random.choice([0, 0.001, 0.01]))
        wire.reset()
        self.count("abrupt")

    def client(self, seed):
        client = types.SimpleNamespace()
        client.random = random.Random(seed)
        client.connection, client.used = self.service.connect(), time.monotonic()
        while sum(self.counts.values()) < REQUESTS and len(self.faults) < 10:
            hostile = client.random.random() < HOSTILE
            act = client.random.choices([self.refused, self.abrupt, self.slow], [80, 15, 5])[0] if hostile else \
                client.random.choices([self.ordinary, self.pipelined], [19, 1])[0]
            try:
                act(client)
            except Exception as error:  # a complete answer was owed
                self.count(act.__name__, repr(error))
                client.connection.close()
        client.connection.close()

    # --- what the process holds ---

    def descriptors(self):
        """What is open, and how often: files by name, other things (sockets, pipes) by kind."""
        folder = f"/proc/{self.service.process.pid}/fd"
        names = collections.Counter()
        for number in os.listdir(folder):
            try:
                name = os.readlink(f"{folder}/{number}")
            except FileNotFoundError:  # closed since
                continue
            names[name if name.startswith("/") else name.split(":")[0]] += 1
        return names

    def watch(self, clients):
        """(requests done, resident MiB, terrain cache MiB, scenes MiB), now and then."""
        rows = []
        while not all(client.done() for client in clients):
            time.sleep(0.2)
            rows.append((sum(self.counts.values()), self.service.resident_mb(), self.service.metric("selenograph_terrain_cache_bytes") / MEBI,
                         self.service.metric("selenograph_scene_bytes") / MEBI))
        return rows

    def test_soak(self):
        descriptors = self.descriptors()
        began = time.monotonic()
        with concurrent.futures.ThreadPoolExecutor(CLIENTS) as pool:
            clients = [pool.submit(self.client, seed) for seed in range(CLIENTS)]
            rows = self.watch(clients)
            for client in clients:
                client.result()
        took = time.monotonic() - began
        done, resident, terrain, scenes = zip(*rows)
        print(f"\n  {sum(self.counts.values())} requests in {took:.0f} s, {self.counts['well-formed']} of them well-formed; resident MiB at "
              f"tenths: {[round(resident[len(rows) * k // 10]) for k in range(10)]}, most {max(resident):.0f}; at most in terrain cache "
              f"{max(terrain):.1f} and scenes {max(scenes):.1f} of {BUDGET_MB} each", end=" ", flush=True)
        self.assertEqual(self.faults, [])
        self.assertGreaterEqual(sum(self.counts.values()), REQUESTS)

        # Those who left are noticed, nothing is left in work, and no descriptor stays open.
        for gauge in ("selenograph_frames_in_work", "selenograph_frames_waiting"):
            self.service.wait_for(gauge, 0)
        self.service.wait_for("selenograph_http_connections", 1)  # the question's own
        now = self.descriptors()
        self.assertLessEqual(now["socket"], descriptors["socket"] + 1)  # the one that asks for metrics
        self.assertLessEqual(now["pipe"], descriptors["pipe"])
        # A tile may be kept open for each thread that reads it: a dataset of GDAL's, and a file of its own for posts.
        threads = len(os.listdir(f"/proc/{self.service.process.pid}/task"))
        self.assertLessEqual(max(count for name, count in now.items() if name.startswith("/")), 2 * threads)
        self.assertLessEqual(sum(now.values()), sum(descriptors.values()) + 1 + MOST_FILES, now)
        self.assertLessEqual(max(terrain), 1.1 * BUDGET_MB)
        self.assertLessEqual(max(scenes), 1.1 * BUDGET_MB)
        self.assertLessEqual(max(resident), 1.15 * MEMORY_MB)
        if REQUESTS >= LONG:
            # As in memory_test: the allocator's wandering, which an added 60 KiB a request would exceed.
            middle = [r for n, r in zip(done, resident) if REQUESTS // 4 <= n < REQUESTS * 5 // 8]
            late = [r for n, r in zip(done, resident) if n >= REQUESTS * 5 // 8]
            self.assertLessEqual(statistics.median(late), 1.1 * statistics.median(middle))
        self.assertEqual(self.service.stop(), 0)


if __name__ == "__main__":
    if REQUESTS < 1:
        sys.exit("SOAK_REQUESTS must be a number above 0")
    harness.main()
