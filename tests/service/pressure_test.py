#!/usr/bin/env python3
"""Clients that read nothing, while others ask and while the service ends. Python's standard library only."""

import http.client
import json
import socket
import time
import unittest

import harness
from harness import PATIENCE_S, PLACE, Service, frame_request, long_frame

FRAME_HEADERS = {"Content-Type": "application/json", "Accept": "application/octet-stream"}


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE, "--ppd", "256")


def tearDownModule():
    harness.tear_down()


def connect(service, source="127.0.0.1"):
    return http.client.HTTPConnection(service.host, service.port, timeout=PATIENCE_S, source_address=(source, 0))


def post(service, connection, request):
    connection.request("POST", "/v1/frames", json.dumps(request).encode(), FRAME_HEADERS)
    answer = connection.getresponse()
    return answer.status, answer.headers, answer.read()


def slow_reader(service, request, buffer=4096):
    """Has asked, and reads nothing."""
    s = socket.socket()
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
    s.connect((service.host, service.port))
    s.settimeout(PATIENCE_S)
    body = json.dumps(request).encode()
    s.sendall(b"POST /v1/frames HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nAccept: application/octet-stream\r\n"
              b"Content-Length: %d\r\n\r\n" % len(body) + body)
    return s


class UnreadAnswers(unittest.TestCase):
    """Clients that have asked and read nothing hold memory for a time, and no slot: small frames pass them."""

    def test_a_small_frame_is_answered_before_any_unread_answer_ends(self):
        service = Service("--log-level", "warning", "--max-frames", "2", "--max-waiting", "256", "--memory-mb", "1100",
                          "--cache-mb", "64", "--scene-mb", "64", "--mesh-mb", "16")
        capacity = service.metric("selenograph_request_memory_capacity_bytes")
        large = frame_request(["position"], width=764, height=764)  # 14 MB
        readers = [slow_reader(service, large) for _ in range(66)]
        # Until no more of them fit: they wait for memory, without a slot.
        harness.wait_until(lambda: service.metric("selenograph_frames_waiting") > 0 and
                           service.metric("selenograph_frames_in_work") == 0, "full memory")
        self.assertGreater(service.metric("selenograph_request_memory_bytes"), 0.7 * capacity)
        # By their own client, by another one, and again: each while all answers are unread.
        for source in ("127.0.0.1", "127.0.0.2", "127.0.0.1"):
            connection = connect(service, source)
            self.assertEqual(post(service, connection, frame_request(width=32, height=32))[0], 200)
            connection.close()
            service.wait_for("selenograph_http_connections", 66 + 1)  # none of them has ended
        self.assertGreater(service.metric("selenograph_frames_waiting"), 0)
        for reader in readers:
            reader.close()
        service.wait_for("selenograph_request_memory_bytes", 0)
        self.assertEqual(service.stop(), 0)


class End(unittest.TestCase):
    SHUTDOWN_S = 3

    def ends_in_time(self, service):
        start = time.monotonic()
        service.process.terminate()
        code = service.process.wait(PATIENCE_S)
        took = time.monotonic() - start
        print(f"\n  {took:.2f} s", end=" ", flush=True)
        self.assertLess(took, self.SHUTDOWN_S + 1)
        self.assertEqual(code, 0)
        service.close()
        return took

    def test_slow_readers_half_sent_bodies_and_long_frames(self):
        service = Service("--shutdown-s", str(self.SHUTDOWN_S), "--max-frames", "2", "--max-image-pixels", "16000000")
        reader = slow_reader(service, frame_request(["position"], width=1500, height=1500))
        reader.recv(1000)
        silent = socket.create_connection((service.host, service.port))
        silent.sendall(b"POST /v1/frames HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 500\r\n\r\n{")
        frames = [service.start_frame(long_frame()) for _ in range(4)]
        service.wait_for("selenograph_frames_waiting", 2)
        took = self.ends_in_time(service)
        self.assertGreater(took, self.SHUTDOWN_S - 1.2, "what runs is given its time")
        for connection in (reader, silent, *frames):
            connection.close()


if __name__ == "__main__":
    harness.main()
