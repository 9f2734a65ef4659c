#!/usr/bin/env python3
"""The log: requests never wait for it, and a log of JSON lines has nothing else. Python's standard library only."""

import json
import os
import subprocess
import tempfile
import unittest

import harness
from harness import Service, frame_request, tearDownModule

MAP = {"map": {"projection": "equirectangular", "bounds": {"south_deg": 0, "north_deg": 0.1, "west_deg": 30, "east_deg": 30.1},
               "gsd_m": 1000}, "products": ["height"]}
HANG_S = 60


def setUpModule():
    harness.set_up()
    harness.sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")


def full_pipe():
    """Both ends of a pipe that has no room left."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    try:
        while True:
            os.write(writing, bytes(4096))
    except BlockingIOError:
        os.set_blocking(writing, True)
    return reading, writing


def ask(service, path, request, accept):
    body = json.dumps(request).encode()
    connection = service.connect(HANG_S)
    status, _, answer = service.ask("POST", path, body, {"Content-Type": "application/json", "Accept": accept}, connection)
    connection.close()
    assert status == 200, (status, answer[:500])


def ask_for_tiffs(service, frames):
    """GDAL's TIFF driver replaces libtiff's handlers of errors when it is first used: here by a map between two frames."""
    frame = frame_request(("radiance",), 16, 16)
    ask(service, "/v1/frames", frame, "image/tiff")
    ask(service, "/v1/maps", MAP, "image/tiff")
    for _ in range(frames):
        ask(service, "/v1/frames", frame, "image/tiff")


class Log(unittest.TestCase):
    def test_requests_do_not_wait_for_a_reader(self):
        reading, writing = full_pipe()
        with open(writing, "wb", buffering=0) as log:
            service = Service("--max-frames", "2", log=log)
            try:
                ask_for_tiffs(service, 200)
            finally:
                service.kill()
        os.close(reading)

    def test_json_logs_are_json(self):
        with tempfile.TemporaryFile() as log:
            service = Service("--log-format", "json", log=os.fdopen(os.dup(log.fileno()), "wb"))
            ask_for_tiffs(service, 3)
            self.assertEqual(service.stop(), 0)
            log.seek(0)
            lines = [json.loads(line) for line in log.read().decode().splitlines()]
        self.assertEqual(sum(line.get("target") == "/v1/frames" for line in lines), 4)
        self.assertEqual([line for line in lines if line["level"] not in ("info", "debug")], [])

    def test_errors_of_the_start_are_json(self):
        for options, words in ((("--memory-mb", "100"), "--memory-mb 100 is too little"), (("--dem", "/nowhere"), "/nowhere")):
            done = subprocess.run([harness.BINARY, "serve", "--port", "0", "--cache-dir", harness.path("cache"), "--log-format", "json",
                                   *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=HANG_S)
            self.assertEqual(done.returncode, 1)
            lines = [json.loads(line) for line in done.stderr.splitlines()]
            self.assertEqual(lines[-1]["level"], "critical")
            self.assertIn(words, lines[-1]["message"])


if __name__ == "__main__":
    harness.main()
