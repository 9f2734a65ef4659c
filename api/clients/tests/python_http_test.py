#!/usr/bin/env python3
"""The Python client (api/clients/python) and HTTP's mishaps, against a made-up server.

Needs NumPy.
"""

import contextlib
import gzip
import io
import json
import os
import shutil
import socket
import ssl
import subprocess
import sys
import threading
import time
import unittest
import warnings
import zipfile
from unittest import mock

import numpy as np

import harness
from fake_service import FakeService
from harness import REPOSITORY, frame_request, tearDownModule

sys.path.insert(0, os.path.join(REPOSITORY, "api", "clients", "python"))
import selenograph  # noqa: E402
from selenograph import Client, Pose, Refused  # noqa: E402
from selenograph.connections import Deadline  # noqa: E402
from selenograph.npz import read_npz  # noqa: E402
from selenograph.region import region_of  # noqa: E402


def setUpModule():
    harness.set_up()


def pose_at(step):
    return Pose.nadir(lat_deg=-6.5 + 0.02 * step, lon_deg=40.0, height_m=20000)


def request_at(step):
    return frame_request(pose=pose_at(step))


def npz(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


FINE = (200, {"Content-Type": "application/json"}, b'{"points": [{"height_m": 1.5}]}')
BUSY = (503, {"Content-Type": "application/problem+json", "Retry-After": "3"},
        b'{"title": "Busy", "status": 503, "detail": "come back"}')


class Mishaps(unittest.TestCase):
    @contextlib.contextmanager
    def asking(self, *script, slept=(), prefix="", **options):
        with FakeService(*script) as server, mock.patch("time.sleep") as sleep:
            with Client(server.url + prefix, **options) as client:
                yield client, server
            self.assertEqual([call.args[0] for call in sleep.call_args_list], list(slept))
            self.assertEqual(server.answers, [], "not all of the script was asked for")

    def test_retry_after_is_obeyed(self):
        unavailable = (429, {"Retry-After": "0"}, b"")
        with self.asking(BUSY, unavailable, FINE, slept=(3, 0.05)) as (client, server):
            self.assertEqual(client.heights(0, 0).height_m, 1.5)
            self.assertEqual(len(server.requests), 3)
            self.assertEqual(len({connection for connection, *_ in server.requests}), 1, "the connection is kept")

    def test_retry_after_beyond_the_time_allowed_is_a_refusal(self):
        with self.asking(BUSY, timeout_s=2) as (client, _):
            with self.assertRaisesRegex(Refused, "503 Busy: come back") as caught:
                client.heights(0, 0)
            self.assertEqual(caught.exception.status, 503)

    def test_a_date_in_retry_after(self):
        past = (503, {"Retry-After": "Fri, 31 Dec 1999 23:59:59 GMT"}, b"")
        with self.asking(past, FINE, slept=(0.05,)) as (client, _):
            self.assertEqual(client.heights(0, 0).height_m, 1.5)

    def test_503_without_retry_after_is_an_error(self):
        stopping = (503, {}, b"shutting down\n")
        with self.asking(stopping) as (client, _):
            with self.assertRaisesRegex(Refused, "503 Service Unavailable: shutting down") as caught:
                client.heights(0, 0)
            self.assertEqual(caught.exception.problem, {})

    def test_a_connection_closed_between_calls(self):
        with self.asking(FINE, None, FINE, FINE) as (client, server):
            self.assertEqual(client.heights(0, 0).height_m, 1.5)
            self.assertEqual(client.heights(0, 0).height_m, 1.5)  # lost, and asked again
            self.assertEqual(client.heights(0, 0).height_m, 1.5)
            connections = [connection for connection, *_ in server.requests]
            self.assertEqual(connections[0], connections[1])
            self.assertEqual(connections[2], connections[3])
            self.assertNotEqual(connections[1], connections[2])

    def test_all_kept_connections_are_given_up_together(self):
        with self.asking(None, FINE) as (client, _):
            connections = client._connections
            connections._idle = [connections._take_connection(Deadline(60)) for _ in range(2)]
            connections._idle[0].sock.shutdown(socket.SHUT_RDWR)  # as after a restart of the service
            self.assertEqual(client.heights(0, 0).height_m, 1.5)

    def test_an_answer_cut_short(self):
        cut = (200, {"Content-Type": "application/json", "Content-Length": "1000", "Connection": "close after"}, b"{")
        with self.asking(cut, FINE) as (client, _):
            self.assertEqual(client.heights(0, 0).height_m, 1.5)

    def test_pieces_that_say_the_same_warn_once(self):
        def piece(*texts):
            headers = {"Content-Type": "application/x-npz", "Selenograph-Warnings": json.dumps(texts)}
            return 200, headers, npz(hit=np.ones(2, bool), rock=np.zeros(2, np.uint64))
        with self.asking(piece("dark"), piece("dark", "red"), piece()) as (client, _):
            with mock.patch.object(selenograph.calls, "ROWS_AT_ONCE", 2), warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                self.assertTrue(client.rays(np.zeros(3), np.ones((6, 3))).hit.all())
        self.assertEqual([(w.category, str(w.message)) for w in caught],
                         [(selenograph.FrameWarning, text) for text in ("dark", "red")])

    def test_warnings_are_of_the_callers_line(self):
        """However many functions of the client lie between."""
        warned = {**FINE[1], "Selenograph-Warnings": '["dark"]'}
        outlines = b'{"points": [], "terminator": [], "craters": []}'
        for ask, body in ((lambda client: client.heights(0, 0), FINE[2]), (lambda client: client.limb({}, {}), outlines),
                          (lambda client: client.terminator({}, {}, {}), outlines),
                          (lambda client: client.features("", {}), outlines)):
            with self.asking((200, warned, body)) as (client, _), self.assertWarnsRegex(selenograph.FrameWarning, "dark") as caught:
                ask(client)
            self.assertEqual(caught.filename, __file__)

    def test_answers_that_are_not_the_services(self):
        """Of the proxy in front of it, or of another program."""
        json_type, page = {"Content-Type": "application/json"}, {"Content-Type": "text/html"}
        for words, headers, body in (("text/html where application/json", page, b"<html>Log in</html>"),
                                     ("text/plain where application/json", {}, b""),
                                     ("'null' is no JSON object", json_type, b"null"),
                                     (r"'\[\]' is no JSON object", json_type, b"[]"),
                                     ("'<html>' is no JSON object", json_type, b"<html>"),
                                     ("its 'points' is no list of objects", json_type, b"{}"),
                                     ("its 'points' is no list of objects", json_type, b'{"points": [null]}'),
                                     ("0 points of 1", json_type, b'{"points": []}')):
            with self.subTest(words), self.asking((200, headers, body)) as (client, server):
                with self.assertRaisesRegex(ConnectionError,
                                            f"{server.url} doesn't answer as selenograph does: .*{words}"):
                    client.heights(0, 0)
        for ask in (lambda client: client.frame(request_at(0)), lambda client: client.encoded(request_at(0)),
                    lambda client: client.datasets(), lambda client: client.sky({})):
            with self.asking((200, page, b"<html>Log in</html>")) as (client, _):
                self.assertRaisesRegex(ConnectionError, "with text/html where .* was asked for", ask, client)
        with self.asking((200, {"Content-Type": "image/png"}, b"png")) as (client, _):
            self.assertEqual(client.encoded(request_at(0), "image/*").media_type, "image/png")

    def test_answers_that_cannot_be_read(self):
        """Of the right type, but cut off by a proxy, say."""
        def answer(content, kind="application/x-npz", **headers):
            headers = {name.replace("_", "-"): text for name, text in headers.items()}
            return 200, {"Content-Type": kind, **headers}, content
        fine = npz(radiance=np.zeros((9, 9)))
        listed = io.BytesIO()
        with zipfile.ZipFile(listed, "w") as archive:
            archive.writestr("meta.json", "[1]")
        for content in (fine[:-30], b"", gzip.compress(fine), fine.replace(b"NUMPY", b"NUMPX"), listed.getvalue(),
                        fine.replace(b"(9, 9), ", b"(9, 99), "), fine.replace(b"'<f8'", b"'|O' ")):
            for ask in (lambda client: client.frame(request_at(0)), lambda client: next(client.frames([request_at(0)])),
                        lambda client: client.lidar({}), lambda client: client.rays(np.zeros(3), np.ones((2, 3)))):
                with self.subTest(content[:40]), self.asking(answer(content)) as (client, _):
                    self.assertRaisesRegex(ConnectionError, "cannot be read", ask, client)
        for ask, broken in (
                (lambda client: client.frame(request_at(0)), answer(fine, Selenograph_Echo="{")),
                (lambda client: client.heights(0, 0), (200, {**FINE[1], "Selenograph-Warnings": "x"}, FINE[2])),
                (lambda client: client.heights(0, 0), (200, FINE[1], FINE[2].replace(b"1.5", b'"x"'))),
                (lambda client: client.rays(np.zeros(3), np.ones((3, 3))), answer(npz(hit=np.ones(2, bool)))),
                (lambda client: client.project({}, {}, np.zeros((1, 2))), answer(npz(reason=np.array([99]))))):
            with self.asking(broken) as (client, _):
                self.assertRaisesRegex(ConnectionError, "cannot be read", ask, client)
        with self.asking(answer(fine, Server_Timing="a;dur=1;desc=x, b;dur=1e, c;dur=-, d;dur=2.5e1")) as (client, _):
            self.assertEqual(client.frame(request_at(0)).timing, {"a": 1, "d": 25})

    def test_the_command_line_keeps_no_file_that_cannot_be_read(self):
        request, out = harness.write("cut.json", request_at(0)), harness.path("cut.npz")
        cut = (200, {"Content-Type": "application/x-npz"}, npz(radiance=np.zeros((9, 9)))[:-30])
        with FakeService(cut) as server, contextlib.redirect_stderr(io.StringIO()) as errors:
            self.assertEqual(selenograph.main(["render", request, out, "--url", server.url]), 1)
        self.assertIn("cannot be read", errors.getvalue())
        self.assertFalse(os.path.exists(out))

    def test_a_service_of_another_major_version_is_an_error(self):
        status, headers, body = FINE
        for server in ("selenograph/1.0.0", "selenograph/1.99.3", "nginx/2.0", "selenograph"):
            with self.asking((status, {**headers, "Server": server}, body)) as (client, _):
                self.assertEqual(client.heights(0, 0).height_m, 1.5)
        for answer in (FINE, (422, *BUSY[1:])):
            with self.asking((answer[0], {**answer[1], "Server": "selenograph/2.0.0"}, answer[2])) as (client, _):
                with self.assertRaisesRegex(ConnectionError, "is of version 2, but this client, 1[.]"):
                    client.heights(0, 0)

    def test_problems_that_are_not_the_services(self):
        for errors in ('"abc"', "7", "[null]", '[{"pointer": 3}]'):
            with self.subTest(errors):
                body = f'{{"title": "No", "errors": {errors}}}'
                answer = (422, {"Content-Type": "application/problem+json"}, body.encode())
                with self.asking(answer) as (client, _), self.assertRaises(Refused) as caught:
                    client.heights(0, 0)
                self.assertEqual((caught.exception.pointers, caught.exception.problem), ([], {}))
                self.assertIn(body, str(caught.exception))

    def test_two_losses_are_an_error(self):
        with self.asking(None, None) as (client, _):
            with self.assertRaisesRegex(ConnectionError, "closed two connections"):
                client.heights(0, 0)

    def test_nothing_answers(self):
        with self.assertRaisesRegex(ConnectionError, "nothing answers at .*`selenograph serve`"):
            Client(f"http://127.0.0.1:{harness.free_port()}").datasets()

    def test_silence_is_a_timeout(self):
        with socket.create_server(("127.0.0.1", 0)) as silent:
            with self.assertRaisesRegex(TimeoutError, "timeout_s = 0.2 s"):
                Client(f"http://127.0.0.1:{silent.getsockname()[1]}", timeout_s=0.2).datasets()

    def test_an_answer_in_drops_is_a_timeout(self):
        """A client whose time is for each drop waits for all of them."""
        head = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"
        drops = 1000
        for name, start, drop in (("body", head + b"Content-Length: 1000\r\n\r\n", b" "),
                                  ("head", head + b"X-Long: ", b"x"),
                                  ("chunks", head + b"Transfer-Encoding: chunked\r\n\r\n", b"1\r\n \r\n")):
            with self.subTest(name), socket.create_server(("127.0.0.1", 0)) as slow:
                fallen = []

                def answer():
                    connection, _ = slow.accept()
                    with connection, contextlib.suppress(ConnectionError):
                        connection.recv(65536)
                        connection.sendall(start)
                        while len(fallen) < drops:
                            connection.sendall(drop)
                            fallen.append(drop)
                            time.sleep(0.01)
                thread = threading.Thread(target=answer)
                thread.start()
                with self.assertRaisesRegex(TimeoutError, "timeout_s = 0.2 s"):
                    Client(f"http://127.0.0.1:{slow.getsockname()[1]}", timeout_s=0.2).datasets()
                thread.join()
                self.assertLess(len(fallen), drops)

    def test_server_that_does_not_speak_http(self):
        with socket.create_server(("127.0.0.1", 0)) as other:
            def answer():
                connection, _ = other.accept()
                connection.sendall(b"220 mail.example ESMTP\r\n")
                connection.close()
            thread = threading.Thread(target=answer)
            thread.start()
            with self.assertRaisesRegex(ConnectionError, "doesn't answer as HTTP does"):
                Client(f"http://127.0.0.1:{other.getsockname()[1]}").datasets()
            thread.join()

    @unittest.skipUnless(shutil.which("openssl"), "openssl is not installed")
    def test_tls(self):
        key, certificate = harness.path("key.pem"), harness.path("certificate.pem")
        subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", key, "-out", certificate,
                        "-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1"], check=True,
                       stderr=subprocess.DEVNULL)
        with FakeService(FINE, None, FINE) as server:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(certificate, key)
            server.server.socket = context.wrap_socket(server.server.socket, server_side=True)
            address = server.url.replace("http", "https")
            with mock.patch.dict(os.environ, {"SSL_CERT_FILE": certificate}), Client(address) as client:
                self.assertEqual(client.heights(0, 0).height_m, 1.5)
                self.assertEqual(client.heights(0, 0).height_m, 1.5)  # after a loss
            with mock.patch.object(sys, "stderr", io.StringIO()):  # where the server complains
                with self.assertRaisesRegex(ConnectionError, "no TLS connection: .*certificate verify failed"):
                    Client(address).datasets()

    def test_region_of_a_request(self):
        for text, region in (  # client_test.cpp has the same
                ('{"pose":{"geodetic":{"lat_deg":0.1,"lon_deg":30.1,"height_m":20000}}}', '22-7'),
                ('{"pose":{"position_m":[1757400,0,0]}}', '22-0'),
                ('{"pose":{"position_m":[1757400,-0.1,-0.1]}}', '22-89'),
                ('{"pose":{"position_m":[0,0,1800000],"frame":"MOON_PA_DE440"}}', '44-0'),
                ('{"pose":{"geodetic":{"lat_deg":-90,"lon_deg":-180,"height_m":0}}}', '0-1'),
                ('{"pose":{"geodetic":{"lat_deg":90,"lon_deg":360,"height_m":0}}}', '44-0'),
                ('{"pose":{"geodetic":{"lat_deg":-60.5,"lon_deg":-1,"height_m":0}}}', '7-44'),
                ('{"pose":{"position_m":[1757400,0,0],"frame":"ICRF","look_at":{"lat_deg":0,"lon_deg":8.1}}}', '22-2'),
                ('{"cameras":{"a":{"pose":{"geodetic":{"lat_deg":0.1,"lon_deg":30.1}}},"b":{}}}', '22-7'),
                ('{"map":{"center":{"lat_deg":0.1,"lon_deg":30.1}}}', '22-7'),
                ('{"rays":[{"origin_m":[1757400,0,0]}]}', '22-0'),
                ('{"points":[{"lat_deg":0.1,"lon_deg":30.1}]}', '22-7'),
                ('{"camera":{},"pose":{"geodetic":{"lat_deg":0.1,"lon_deg":30.1}},'
                 '"points":[{"lat_deg":80,"lon_deg":0}]}', '22-7'),
                ('{"pose":{"position_m":[1757400,0,0],"frame":"ICRF"}}', ''),
                ('{"pose":{"position_m":[1757400,0,0],"frame":"J2000"}}', ''),
                ('{"pose":{"geodetic":{"lat_deg":-91,"lon_deg":0}}}', ''),
                ('{"pose":{"geodetic":"here"}}', ''),
                ('{"pose":{"position_m":[1,2]}}', ''),
                ('{"pose":7}', ''),
                ('{"points":[]}', ''),
                ('{}', '')):
            with self.subTest(text):
                self.assertEqual(region_of(json.loads(text)) or "", region)

    def test_headers_and_body_of_requests(self):
        with self.asking(FINE, FINE, prefix="/moon/", token="s3cret", timeout_s=20) as (client, server):  # as behind a proxy
            self.assertEqual((client.url, client.timeout_s), (server.url + "/moon", 20))
            client.heights(1, 2)
            client.datasets()
        (_, path, headers, body), (_, catalogue, _, nothing) = server.requests
        self.assertEqual((path, catalogue), ("/moon/v1/heights", "/moon/v1/datasets"))
        self.assertEqual(headers["Authorization"], "Bearer s3cret")
        self.assertEqual(headers["Selenograph-Region"], "22-0")
        self.assertEqual(headers["Content-Type"], "application/json")
        self.assertEqual(json.loads(body), {"points": [{"lat_deg": 1.0, "lon_deg": 2.0}]})
        self.assertTrue(10000 < int(headers["Request-Timeout-Ms"]) < 20000, headers)
        self.assertEqual(nothing, b"")
        self.assertEqual(Client("https://example.org:444/moon/").url, "https://example.org:444/moon")
        self.assertRaisesRegex(ValueError, "write for example http://", Client, "127.0.0.1:8080")
        for timeout_s in (0, float("inf")):
            self.assertRaisesRegex(ValueError, f"timeout_s is {timeout_s}", Client, "http://127.0.0.1", None, timeout_s)
        for address in ("http://user:word@127.0.0.1", "http://127.0.0.1/moon?a=b"):
            self.assertRaisesRegex(ValueError, "neither a user nor a query", Client, address)

    def test_ahead_echo_and_the_rest_of_the_headers(self):
        frame = (200, {"Content-Type": "application/x-npz", "ETag": '"abc"', "Selenograph-Echo": '{"tag":7}',
                       "Server-Timing": "parse;dur=0.25, cache;desc=\"x\", draw;desc=y;dur=2e1"},
                 npz(radiance=np.arange(6.0).reshape(2, 3)))
        own = {**request_at(3), "ahead": [pose_at(9)]}
        shutter = {name: value for name, value in request_at(4).items() if name != "pose"}
        requests = [request_at(0), request_at(1), request_at(2), own, shutter, request_at(5)]
        for in_flight in (1, 2):
            with self.asking(*[frame] * 6) as (client, server):
                got = list(client.frames(requests, in_flight=in_flight, ahead=2))
            self.assertLessEqual(len({connection for connection, *_ in server.requests}), in_flight)
            bodies = [json.loads(body) for *_, body in server.requests]
            bodies.sort(key=lambda body: json.dumps(body.get("pose", ""), default=str))
            ahead = {json.dumps(body.get("pose")): body.get("ahead") for body in bodies}
            self.assertEqual(ahead[json.dumps(pose_at(0))], [pose_at(1), pose_at(2)])
            self.assertEqual(ahead[json.dumps(pose_at(1))], [pose_at(2), pose_at(3)])
            self.assertEqual(ahead[json.dumps(pose_at(2))], [pose_at(3)])
            self.assertEqual(ahead[json.dumps(pose_at(3))], [pose_at(9)], "the request's own")
            self.assertEqual(ahead[json.dumps(None)], [pose_at(5)])
            self.assertIsNone(ahead[json.dumps(pose_at(5))])
            self.assertNotIn("ahead", requests[0], "requests are not changed")
            self.assertEqual((got[0].etag, got[0].echo), ('"abc"', {"tag": 7}))
            self.assertEqual(got[0].timing, {"parse": 0.25, "draw": 20.0})

    def test_nothing_is_taken_to_fill_ahead(self):
        frame = (200, {"Content-Type": "application/x-npz"}, npz(a=np.zeros(3)))
        for in_flight in (1, 2):
            with self.asking(*[frame] * 8) as (client, server):
                self.assertEqual(len(list(client.frames((request_at(step) for step in range(8)), in_flight, 3))), 8)
            self.assertEqual([json.loads(body).get("ahead") for *_, body in server.requests], [None] * 8)

    def test_deflated_and_column_major_members_are_read(self):
        file = io.BytesIO()
        np.savez_compressed(file, a=np.asfortranarray(np.arange(6).reshape(2, 3)), b=np.float32(4))
        arrays, meta = read_npz(file.getvalue())
        np.testing.assert_array_equal(arrays["a"], [[0, 1, 2], [3, 4, 5]])
        self.assertEqual((arrays["b"], meta), (4, {}))


if __name__ == "__main__":
    harness.main()
