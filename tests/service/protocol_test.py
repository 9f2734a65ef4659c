#!/usr/bin/env python3
"""HTTP as it must be read: one request, one answer, whatever is sent. Python's standard library only."""

import json
import re
import socket
import struct
import threading
import time
import unittest

import harness
from harness import PATIENCE_S, PLACE, Service, long_frame


SERVICE = None


def setUpModule():
    global SERVICE
    harness.set_up()
    harness.sample("dem", *PLACE, "--ppd", "256")
    SERVICE = Service("--max-frames", "1", "--max-image-pixels", "16000000", "--deadline-s", "3600", "--log-level", "warning")


def tearDownModule():
    try:
        SERVICE.expect_clean_stop()
    finally:
        harness.tear_down()


class WithTheService(unittest.TestCase):
    def setUp(self):
        self.service = SERVICE


HEIGHTS = json.dumps({"points": [{"lat_deg": 0.1, "lon_deg": 30.1}]}).encode()


def statuses(answer):
    return [int(status) for status in re.findall(rb"HTTP/1\.1 (\d{3}) ", answer)]


class Heads(WithTheService):
    def test_a_body_is_asked_for(self):
        with socket.create_connection((self.service.host, self.service.port), timeout=PATIENCE_S) as s:
            s.sendall(b"POST /v1/heights HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nExpect: 100-continue\r\n"
                      b"Connection: close\r\nContent-Length: %d\r\n\r\n" % len(HEIGHTS))
            self.assertEqual(s.recv(1000), b"HTTP/1.1 100 Continue\r\n\r\n")
            s.sendall(HEIGHTS)
            self.assertEqual(statuses(read_all(s)), [200])


class HeightInTheQueue(WithTheService):
    def test_it_waits_for_a_place(self):
        holder = self.service.start_frame(long_frame())
        self.service.wait_for("selenograph_frames_in_work", 1)
        for method in ("GET", "HEAD"):
            status = self.service.ask(method, "/v1/height?lat_deg=0&lon_deg=30", headers={"Request-Timeout-Ms": "200"})[0]
            self.assertEqual(status, 504, method)
        holder.close()
        self.service.wait_for("selenograph_frames_in_work", 0)
        for method in ("GET", "HEAD"):
            self.assertEqual(self.service.ask(method, "/v1/height?lat_deg=0&lon_deg=30")[0], 200)


def read_all(s):
    received = b""
    while got := s.recv(1 << 16):
        received += got
    return received


class Departures(WithTheService):
    version = "1.1"

    def send(self, request):
        body = json.dumps(request).encode()
        s = socket.create_connection((self.service.host, self.service.port), timeout=PATIENCE_S)
        s.sendall(f"POST /v1/frames HTTP/{self.version}\r\nHost: localhost\r\nContent-Type: application/json\r\nAccept: application/x-npy\r\n"
                  f"Content-Length: {len(body)}\r\n\r\n".encode() + body)
        return s

    def test_pipelined_requests_are_all_answered(self):
        request = b"GET /v1/height?lat_deg=0&lon_deg=30 HTTP/1.1\r\nHost: localhost\r\n"
        answer = self.service.raw((request + b"\r\n") * 4 + request + b"Connection: close\r\n\r\n")
        self.assertEqual(statuses(answer), [200] * 5)

    def leaves(self, how):
        s = self.send(long_frame())
        self.service.wait_for("selenograph_frames_in_work", 1)
        start = time.monotonic()
        how(s)
        self.service.wait_for("selenograph_frames_in_work", 0)
        s.close()
        return time.monotonic() - start

    def test_so_is_one_that_resets(self):
        def reset(s):
            s.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            s.close()
        self.assertLess(self.leaves(reset), 3)

    def test_so_is_one_that_closes_its_half(self):
        for version in ("1.1", "1.0"):
            self.version = version
            self.assertLess(self.leaves(lambda s: s.shutdown(socket.SHUT_WR)), 3)


class Pipelining(WithTheService):
    @harness.of_memory
    def test_a_client_that_never_pauses_is_not_kept_in_memory(self):
        batch = b"GET /health/live HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 7900 + b"\r\n\r\n"
        before = self.service.resident_mb()
        with socket.create_connection((self.service.host, self.service.port), timeout=PATIENCE_S) as s:
            def read():
                try:
                    while s.recv(1 << 20):
                        pass
                except OSError:
                    pass
            reader = threading.Thread(target=read)
            reader.start()
            sent = 0
            while sent < 40e6:
                s.sendall(batch * 64)
                sent += len(batch) * 64
            grown = self.service.resident_mb() - before
            s.shutdown(socket.SHUT_RDWR)
            reader.join()
        print(f"\n  {sent / 1e6:.0f} MB sent, resident memory grew by {grown:.0f} MB", end=" ", flush=True)
        self.assertLess(grown, 10)


if __name__ == "__main__":
    harness.main()
