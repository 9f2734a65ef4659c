#!/usr/bin/env python3
"""Many clients, slow ones, and the end of the service: who is served, and until when. Python's standard library only."""

import concurrent.futures
import http.client
import json
import os
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


class ManyClients(unittest.TestCase):
    def obeys(self, service, source):
        """One request, asked again after Retry-After until it is answered; returns the seconds that took."""
        start = time.monotonic()
        while True:
            connection = connect(service, source)
            status, headers, _ = post(service, connection, frame_request())
            connection.close()
            if status == 200:
                return time.monotonic() - start
            assert status == 503, status
            time.sleep(int(headers["Retry-After"]))

    def test_200_at_once_are_all_served(self):
        for options in ((), ("--max-waiting", "16")):
            service = Service("--log-level", "warning", *options)
            self.obeys(service, "127.0.0.1")  # terrain is in memory
            with concurrent.futures.ThreadPoolExecutor(200) as pool:
                times = list(pool.map(lambda _: self.obeys(service, "127.0.0.1"), range(200)))
            print(f"\n  {options}: the last of 200 was served after {max(times):.1f} s", end=" ", flush=True)
            self.assertLess(max(times), 40)
            self.assertEqual(service.stop(), 0)

    def test_one_address_does_not_starve_another(self):
        service = Service("--log-level", "warning", "--max-frames", "1", "--max-image-pixels", "16000000")
        single = connect(service, "127.0.0.2")
        request = frame_request(width=100, height=100)
        alone = min(self.timed(service, single, request) for _ in range(3))
        end = time.monotonic() + 6

        def hog(_):
            connection = connect(service, "127.0.0.1")
            served = 0
            while time.monotonic() < end:
                served += post(service, connection, request)[0] == 200
            connection.close()
            return served

        with concurrent.futures.ThreadPoolExecutor(200) as pool:
            hogs = [pool.submit(hog, i) for i in range(200)]
            time.sleep(1)
            beside = []
            while time.monotonic() < end - 1:
                beside.append(self.timed(service, single, request))
            served = sum(h.result() for h in hogs)
        single.close()
        print(f"\n  {alone * 1e3:.0f} ms alone, {max(beside) * 1e3:.0f} ms at most beside 200 others, of which {served} were served",
              end=" ", flush=True)
        self.assertGreater(len(beside), 3)
        self.assertGreaterEqual(served, 200)
        self.assertLess(sorted(beside)[len(beside) // 2], 20 * alone + 0.2)
        self.assertEqual(service.stop(), 0)

    def timed(self, service, connection, request):
        start = time.monotonic()
        self.assertEqual(post(service, connection, request)[0], 200)
        return time.monotonic() - start


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

    def test_a_slow_reader_that_does_read(self):
        service = Service("--shutdown-s", str(self.SHUTDOWN_S))
        reader = slow_reader(service, frame_request(["position"], width=1500, height=1500))
        reader.recv(1000)
        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            def read():
                try:
                    while reader.recv(8000):
                        time.sleep(0.1)
                except OSError:
                    pass
            reading = pool.submit(read)
            self.ends_in_time(service)
            reading.result()
        reader.close()

    def test_what_is_done_in_time_is_delivered(self):
        service = Service("--shutdown-s", "60")
        reader = slow_reader(service, frame_request(["position"], width=1500, height=1500), buffer=1 << 18)
        received = reader.recv(1000)
        service.process.terminate()
        time.sleep(0.5)
        self.assertIsNone(service.process.poll())
        while got := reader.recv(1 << 20):
            received += got
        self.assertEqual(len(received) - received.index(b"\r\n\r\n") - 4, 1500 * 1500 * 24)
        self.assertEqual(service.process.wait(PATIENCE_S), 0)
        reader.close()
        service.close()


class Log(unittest.TestCase):
    def test_a_log_that_nobody_reads_blocks_nothing(self):
        unread, log = os.pipe()
        service = Service(log=open(log, "wb"))
        # Lines of 300 bytes, over the pipe's 64 KiB and the log's own memory.
        connection = service.connect()
        for _ in range(12000):
            service.ask("GET", "/nothing?" + "x" * 200, connection=connection)
        connection.close()
        self.assertGreater(service.metric("selenograph_log_dropped_total"), 0)
        start = time.monotonic()
        self.assertEqual(service.stop(), 0)
        self.assertLess(time.monotonic() - start, 5)
        os.close(unread)


if __name__ == "__main__":
    harness.main()
