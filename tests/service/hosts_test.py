#!/usr/bin/env python3
"""Whom requests may be addressed to and which pages may ask: Host and Origin over raw sockets, against a real service on
loopback, on every address, and with the operator's names. Python's standard library only."""

import json
import os
import re
import socket
import unittest

import harness
from harness import PATIENCE_S, PLACE, tearDownModule


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE, "--ppd", "64")


class Asking(harness.WithService):
    def ask(self, host, *lines, path="/v1/datasets", method="GET", version="1.1", address=None):
        """(status, headers as text, body); host None: no Host."""
        head = [f"{method} {path} HTTP/{version}", *([f"Host: {host}"] if host is not None else []), *lines, "Connection: close"]
        with socket.create_connection((address or "127.0.0.1", self.service.port), timeout=PATIENCE_S) as s:
            s.sendall("\r\n".join(head).encode("latin-1") + b"\r\n\r\n")
            received = b""
            while piece := s.recv(65536):
                received += piece
        headers, _, body = received.partition(b"\r\n\r\n")
        return int(headers.split()[1]), headers.decode("latin-1"), body

    def refused(self, answer, status, code):
        got, headers, body = answer
        self.assertEqual(got, status, (headers, body[:300]))
        self.assertIn("Content-Type: application/problem+json", headers)
        self.assertRegex(headers, r"\r\nX-Request-Id: \S+")
        self.assertNotIn("Access-Control", headers)
        problem = json.loads(body)
        self.assertEqual((problem["type"], problem["status"]), (f"urn:selenograph:problem:{code}", status))
        return problem["detail"]


class OnLoopback(Asking):
    def test_rebound_names_are_refused(self):
        evil = f"evil.example:{self.service.port}"
        for path in ("/", "/docs", "/v1/datasets", "/openapi.json", "/v1/height?lat_deg=0&lon_deg=30", "/metrics", "/health/live",
                     "/nothing"):
            detail = self.refused(self.ask(evil, f"Origin: http://{evil}", path=path), 421, "misdirected_request")
            self.assertIn('"evil.example"', detail)
            self.assertIn("--allowed-host", detail)
        for method in ("POST", "PUT", "OPTIONS"):
            self.refused(self.ask(evil, "Content-Length: 0", path="/v1/frames", method=method), 421, "misdirected_request")
        status, headers, body = self.ask(evil, method="HEAD")
        self.assertEqual((status, body), (421, b""))
        self.assertGreater(int(re.search(r"Content-Length: (\d+)", headers)[1]), 100)

    def test_a_refused_body_is_not_read(self):
        for host, origin, status in (("evil.example", "", 421), ("localhost", "Origin: http://evil.example\r\n", 403)):
            with socket.create_connection(("127.0.0.1", self.service.port), timeout=PATIENCE_S) as s:
                s.sendall(f"POST /v1/frames HTTP/1.1\r\nHost: {host}\r\n{origin}Content-Type: application/json\r\n"
                          f"Content-Length: 1000\r\nExpect: 100-continue\r\n\r\n".encode())
                self.assertTrue(s.recv(100).startswith(f"HTTP/1.1 {status} ".encode()))

    def test_what_follows_on_the_connection_is_not_answered(self):
        answer = self.service.raw(b"GET /v1/datasets HTTP/1.1\r\nHost: evil.example\r\n\r\n"
                                  b"GET /v1/datasets HTTP/1.1\r\nHost: localhost\r\n\r\n")
        self.assertEqual(re.findall(rb"HTTP/1\.1 (\d{3}) ", answer), [b"421"])

    def test_foreign_pages(self):
        own = f"http://localhost:{self.service.port}"
        host = own.removeprefix("http://")
        self.assertEqual(self.ask(host, f"Origin: {own}")[0], 200)
        for origin in ("http://evil.example", "https://localhost", "http://localhost:1", "null", "file://", f"{own}/",
                       f"http://127.0.0.1:{self.service.port}"):
            detail = self.refused(self.ask(host, f"Origin: {origin}"), 403, "foreign_origin")
            self.assertIn(f'"{origin}"', detail)
            self.assertIn("--allowed-host", detail)
        # A preflight: of its own pages as of any method that the path does not have, without CORS; of others, refused.
        asked = ("Access-Control-Request-Method: POST", "Access-Control-Request-Headers: content-type")
        status, headers, _ = self.ask(host, f"Origin: {own}", *asked, path="/v1/frames", method="OPTIONS")
        self.assertEqual(status, 405)
        self.assertNotIn("Access-Control", headers)
        self.refused(self.ask(host, "Origin: http://evil.example", *asked, path="/v1/frames", method="OPTIONS"), 403, "foreign_origin")


class OnEveryAddress(Asking):
    options = ("--host", "0.0.0.0")

    def test_addresses_of_other_interfaces_are_refused(self):
        self.assertEqual(self.ask("127.0.0.2", address="127.0.0.2")[0], 200)
        self.refused(self.ask("127.0.0.2"), 421, "misdirected_request")


class OnEveryAddressOfBothKinds(Asking):
    options = ("--host", "::")

    @classmethod
    def setUpClass(cls):
        if not socket.has_ipv6 or not os.path.exists("/proc/net/if_inet6"):
            raise unittest.SkipTest("no IPv6 here")
        super().setUpClass()

    def test_both_kinds(self):
        self.assertEqual(self.ask("[::1]", address="::1")[0], 200)
        self.assertEqual(self.ask("127.0.0.2", address="127.0.0.2")[0], 200, "an IPv4 address at an IPv6 socket")
        self.refused(self.ask("evil.example", address="::1"), 421, "misdirected_request")


class WithNames(Asking):
    options = ("--allowed-host", "moon.example", "--allowed-host", "viewer.example", "10.9.8.7")

    def test_names(self):
        for host in ("moon.example", "Moon.Example.:443", "viewer.example", "10.9.8.7:80", "localhost"):
            self.assertEqual(self.ask(host)[0], 200, host)
        self.refused(self.ask("a.moon.example"), 421, "misdirected_request")


if __name__ == "__main__":
    harness.main()
