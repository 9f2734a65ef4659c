"""What the service has for a proxy in front: request ids, tokens' names, the access log in JSON lines."""

import json
import re
import socket
import time
import unittest

import harness
from harness import PATIENCE_S, Service, frame_request, long_frame, tearDownModule

MEMBERS = {"time", "level", "request_id", "token", "client", "method", "target", "status", "error", "request_bytes", "bytes",
           "duration_ms", "queued_ms", "work_ms", "stages_ms"}


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "1", "--columns", "1", "--ppd", "64")


class AccessLog(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.service = Service("--log-format", "json", "--max-frames", "1", "--max-image-pixels", "16000000")

    @classmethod
    def tearDownClass(cls):
        cls.service.expect_clean_stop()

    def lines(self):
        return [json.loads(line) for line in self.service.log_text().rpartition("\n")[0].splitlines()]  # the last may grow

    def line_of(self, request_id):
        def found():
            return [line for line in self.lines() if line.get("request_id") == request_id]

        harness.wait_until(found, request_id)  # written by a thread of its own, after the answer
        line, = found()
        self.assertEqual(set(line), MEMBERS)
        return line

    def test_a_frame(self):
        body = json.dumps(frame_request()).encode()
        status, headers, answer = self.service.ask("POST", "/v1/frames?x=%22y", body,
                                                   {"Content-Type": "application/json", "X-Request-Id": "frame-1",
                                                    "Selenograph-Token": "flight-team"})
        self.assertEqual(status, 200)
        self.assertEqual(headers["X-Request-Id"], "frame-1")
        line = self.line_of("frame-1")
        self.assertEqual((line["method"], line["target"], line["status"]), ("POST", "/v1/frames?x=%22y", 200))
        self.assertEqual((line["token"], line["client"], line["error"]), ("flight-team", "127.0.0.1", None))
        self.assertEqual((line["request_bytes"], line["bytes"]), (len(body), len(answer)))
        stages = {name: float(ms) for name, ms in re.findall(r"(\w+);dur=([0-9.]+)", headers["Server-Timing"])}
        self.assertIn("visibility", stages)
        self.assertEqual(line["stages_ms"], stages)
        self.assertAlmostEqual(line["queued_ms"], stages["queue"], delta=0.01)
        self.assertGreater(line["work_ms"], stages["visibility"])
        self.assertLessEqual(line["queued_ms"] + line["work_ms"], line["duration_ms"])
        self.assertRegex(line["time"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")

    def test_waiting_is_not_work(self):
        first = self.service.start_frame(long_frame())
        self.service.wait_for("selenograph_frames_in_work", 1)
        status, _, _ = self.service.ask("GET", "/v1/height?lat_deg=0&lon_deg=29.5", headers={
            "X-Request-Id": "waits", "Request-Timeout-Ms": "300"})
        first.close()
        self.assertEqual(status, 504)
        line = self.line_of("waits")
        self.assertGreaterEqual(line["queued_ms"], 250)
        self.assertLess(line["work_ms"], line["queued_ms"])
        self.assertEqual(line["error"], "deadline_exceeded")

    def test_ids_are_taken_or_made(self):
        ids = set()
        for given, same in (("a", True), ("A.b_c-9", True), ("x" * 64, True), ("x" * 65, False), ("two words", False),
                            ('quo"ted', False), ("\xe9", False), ("", False), (None, False)):
            headers = {} if given is None else {"X-Request-Id": given}
            for path, status in (("/v1/datasets", 200), ("/nothing", 404), ("/health/live", 200), ("/metrics", 200), ("/", 200)):
                got, answer, _ = self.service.ask("GET", path, headers=headers)
                self.assertEqual(got, status)
                self.assertEqual(answer["X-Request-Id"] == given, same, (given, path))
                self.assertRegex(answer["X-Request-Id"], r"^[A-Za-z0-9._-]{1,64}$")
                if not same:
                    ids.add(answer["X-Request-Id"])
        self.assertEqual(len(ids), 30, "each has its own")

    def test_refusals_have_ids_too(self):
        for sent in (b"GET / HTTP/1.1\r\n\r\n", b"PUT / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
                     b"POST /v1/heights HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999\r\n\r\n",
                     b"GET /" + b"x" * 3000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n", b"GET /%zz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
                     b"POST /v1/heights HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n"):
            answer = self.service.raw(sent)
            found = re.search(rb"\r\nX-Request-Id: ([A-Za-z0-9._-]+)\r\n", answer)
            self.assertTrue(found, answer[:300])
            self.assertGreaterEqual(self.line_of(found[1].decode())["status"], 400)
        answer = self.service.raw(b"POST /v1/heights HTTP/1.1\r\nHost: localhost\r\nX-Request-Id: mine\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n")
        self.assertIn(b"\r\nX-Request-Id: mine\r\n", answer)


class Turns(unittest.TestCase):
    def test_tokens_are_clients_of_their_own(self):
        """Behind one address, who asks for much does not keep others out of the queue."""
        service = Service("--log-format", "json", "--max-frames", "1", "--max-waiting", "3", "--max-image-pixels", "16000000")
        asked = []
        try:
            def start(token, request):
                connection = service.connect()
                asked.append(connection)
                connection.request("POST", "/v1/frames", json.dumps(request).encode(),
                                   {"Content-Type": "application/json", "Accept": "application/x-npy", "Selenograph-Token": token})
                return connection
            start("greedy", long_frame())
            service.wait_for("selenograph_frames_in_work", 1)
            start("greedy", long_frame())
            service.wait_for("selenograph_frames_waiting", 1)
            start("greedy", long_frame())
            service.wait_for("selenograph_frames_waiting", 2)
            newest = start("greedy", long_frame())
            answer = newest.getresponse()
            self.assertEqual(answer.status, 503, "a place remains for others")
            answer.read()
            modest = start("modest", frame_request())
            service.wait_for("selenograph_frames_waiting", 3)
            for connection in asked[:3]:
                connection.close()
            self.assertEqual(modest.getresponse().status, 200)
        finally:
            for connection in asked:
                connection.close()
            service.expect_clean_stop()

    def test_who_is_not_trusted_has_no_token(self):
        """From another address than loopback: this machine's own one."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
            try:
                s.connect(("192.0.2.1", 9))
            except OSError:
                self.skipTest("this machine has no other address than loopback")
            address = s.getsockname()[0]
        for options, token in (((), None), (("--trusted-proxy", address), "by-proxy"), (("--trusted-proxy", "192.0.2.7"), None)):
            service = Service("--log-format", "json", "--host", address, *options)
            service.ask("GET", "/v1/datasets", headers={"X-Request-Id": "who", "Selenograph-Token": "by-proxy"})
            service.process.terminate()
            self.assertEqual(service.process.wait(PATIENCE_S), 0)
            lines = [json.loads(line) for line in service.log_text().splitlines()]
            [line] = [line for line in lines if line.get("request_id") == "who"]
            self.assertEqual((line["token"], line["client"]), (token, address), options)
            service.close()


if __name__ == "__main__":
    harness.main()
