#!/usr/bin/env python3
"""The clients in api/clients that aren't Python's: their examples against the real service, and faults of a fake one.

SELENOGRAPH_CPP_EXAMPLES is the folder of the built C++ examples. What needs Octave is skipped where that isn't installed.
NumPy reads the service's own answers.
"""

import http.server
import io
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import unittest

import numpy

import harness
from harness import PATIENCE_S, REPOSITORY

CLIENTS = os.path.join(REPOSITORY, "api", "clients")
CPP_EXAMPLES = os.environ.get("SELENOGRAPH_CPP_EXAMPLES", "")
OCTAVE = shutil.which("octave-cli") or shutil.which("octave")
PLACE = ("--south-deg", "-8", "--west-deg", "39", "--rows", "3", "--columns", "2", "--ppd", "256")  # what the examples fly over
SUN = {"subsolar": {"lat_deg": 0.0, "lon_deg": 100.0}}


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE)


def tearDownModule():
    harness.tear_down()


class FakeService:
    """Answers from a list, one by one: (status, headers, body), or None for a connection that is dropped."""

    def __init__(self, *answers):
        self.answers = list(answers)
        self.requests = []
        self.connections = set()
        fake = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def do_POST(self):
                body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
                fake.requests.append((self.path, dict(self.headers), body))
                fake.connections.add(self.client_address)
                answer = fake.answers.pop(0) if fake.answers else (500, {}, b"")
                if answer is None:
                    self.close_connection = True
                    self.connection.shutdown(2)
                    return
                status, headers, content = answer
                self.send_response(status)
                for name, value in dict(headers, **{"Content-Length": str(len(content))}).items():
                    self.send_header(name, value)
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, *arguments):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        self.url = "http://127.0.0.1:%d" % self.server.server_address[1]
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.02,))
        self.thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.server.shutdown()
        self.thread.join()
        self.server.server_close()


PROBLEM = (422, {"Content-Type": "application/problem+json"}, json.dumps({
    "type": "urn:selenograph:problem:invalid_request", "title": "Invalid request", "status": 422, "detail": "a fault",
    "errors": [{"pointer": "/camera/width", "detail": "is negative"}]}).encode())
BUSY = (503, {"Content-Type": "application/problem+json", "Retry-After": "0"}, json.dumps({
    "type": "urn:selenograph:problem:busy", "title": "Busy", "status": 503, "detail": "come back"}).encode())


class Examples:
    """The same three examples in each language: each prints lines of words and numbers."""

    types = {"float32": "float32", "float64": "float64"}  # what the language calls them
    last_places = 0  # by which the language misreads numbers in JSON

    def run_example(self, name, *arguments):
        """Returns (exit status, standard output, standard error)."""
        raise NotImplementedError

    def lines(self, name):
        status, out, err = self.run_example(name, self.url())
        self.assertEqual(status, 0, err)
        return out.splitlines()

    def url(self):
        return "http://%s:%d" % (self.service.host, self.service.port)

    def npz(self, request):
        """The service's own answer, by NumPy; and its ETag."""
        status, headers, body = self.service.frame(request, "application/x-npz")
        self.assertEqual(status, 200, body[:300])
        return numpy.load(io.BytesIO(body)), headers["ETag"].strip('"')

    def a_frame(self):
        return {"camera": {"width": 320, "height": 240, "fov_deg": 50},
                "pose": {"geodetic": {"lat_deg": -6.5, "lon_deg": 40.0, "height_m": 30000.0}, "nadir": {"up_azimuth_deg": 0}},
                "sun": SUN, "products": ["radiance", "range", "geodetic", "lit"]}

    def test_one_frame(self):
        lines = self.lines("one_frame")
        frame, etag = self.npz(self.a_frame())
        for product, shape, numbers in (("radiance", "240 x 320 x 1", "float32"), ("range", "240 x 320 x 1", "float64"),
                                        ("geodetic", "240 x 320 x 3", "float64"), ("lit", "240 x 320 x 1", "float32")):
            self.assertIn(f"{product}: {shape} {self.types[numbers]}", lines)
        said = {line.split()[0]: line.split()[1] for line in lines if ":" not in line}
        self.assertEqual(numpy.float32(said["radiance"]), frame["radiance"][120, 160])
        self.assertEqual(float(said["range"]), frame["range"][120, 160])
        self.assertEqual(float(said["latitude"]), frame["geodetic"][120, 160, 0])
        self.assertEqual(said["etag"], etag)
        meta = json.loads(frame["meta.json"])
        self.assertIn(f"level of detail error {meta['lod_error_m']:.17g} m", lines)

    def test_a_descent(self):
        found = re.findall(r"^frame (\d+): nearest ground (\S+) m, etag (\w+)$", "\n".join(self.lines("descent")), re.M)
        self.assertEqual([int(index) for index, _, _ in found], list(range(20)))
        for index in (0, 7, 19):
            left = 1 - index / 20
            frame, etag = self.npz({
                "camera": {"width": 160, "height": 120, "fov_deg": 60},
                "pose": {"geodetic": {"lat_deg": -6.5 - 0.5 * left, "lon_deg": 40.0, "height_m": 2000 + 28000 * left},
                         "look_at": {"lat_deg": -6.5, "lon_deg": 40.0}},
                "sun": SUN, "products": ["radiance", "range"]})
            self.assertEqual(float(found[index][1]), numpy.nanmin(frame["range"]))
            self.assertEqual(found[index][2], etag)

    def test_a_lidar_line(self):
        found = re.findall(r"^shot (\d+): range (\S+) m$", "\n".join(self.lines("lidar_line")), re.M)
        self.assertEqual([int(index) for index, _ in found], list(range(50)))
        heights = json.loads(self.service.post("/v1/heights", {
            "points": [{"lat_deg": -7 + 0.02 * i, "lon_deg": 40.0} for i in range(50)]})[2])["points"]
        for i in range(50):  # straight down: the range is what is left of 15 km
            self.assertAlmostEqual(float(found[i][1]), 15000 - heights[i]["height_m"], delta=1e-6)

    def alike(self, got, right, what):
        """The members that the client has are the service's, NaN and null alike."""
        self.assertEqual(len(got), len(right), what)
        for ours, its in zip(got, right):
            for name, value in ours.items():
                missing = "" if name == "source" else False if name == "filled" else None
                if isinstance(value, list) and its.get(name) is None:
                    value = None if all(x is None for x in value) else value
                self.assert_alike(value, its.get(name, missing), f"{what}.{name}")

    def assert_alike(self, ours, its, what):
        if isinstance(ours, list) and isinstance(its, list):
            self.assertEqual(len(ours), len(its), what)
            for i, (a, b) in enumerate(zip(ours, its)):
                self.assert_alike(a, b, f"{what}[{i}]")
        elif self.last_places and isinstance(ours, float) and isinstance(its, float):
            self.assertAlmostEqual(ours, its, delta=self.last_places * sys.float_info.epsilon * abs(its), msg=what)
        else:
            self.assertEqual(ours, its, what)

    def test_every_other_call(self):
        status, out, err = self.run_example("every_call", self.url())
        self.assertEqual(status, 0, err)
        said = json.loads(out)
        request = self.a_frame()
        points = [{"lat_deg": -6.5, "lon_deg": 40.0}, {"lat_deg": -6.6, "lon_deg": 40.1, "height_m": 500.0},
                  {"lat_deg": 30.0, "lon_deg": 100.0}]
        rays = [{"origin_m": [1345000, 1130000, -200000], "direction": [-1345, -1130, 199]},
                {"origin_m": [1800000, 0, 0], "direction": [1, 0, 0]}]

        def right(path, body):
            return json.loads(self.service.post(path, body)[2])

        self.alike(said["heights"], right("/v1/heights", {"points": [points[0], points[2]]})["points"], "heights")
        self.assertIsNone(said["heights"][1]["height_m"])
        self.alike(said["project"], right("/v1/project", {
            "camera": request["camera"], "pose": request["pose"], "sun": SUN, "points": points})["points"], "project")
        self.alike(said["rays"], right("/v1/rays", {"rays": rays, "sun": SUN})["rays"], "rays")
        self.assertEqual([ray["hit"] for ray in said["rays"]], [True, False])
        self.assertEqual(said["datasets"], 6)
        self.assertEqual(len(said["attitudes"]), 7)
        for way, q in said["attitudes"].items():
            for key, value in dict(w=0.8, x=0.2, y=-0.4, z=0.4).items():
                self.assertAlmostEqual(q[key], value, delta=1e-14, msg=way)
        picture = self.service.frame(dict(request, products=["image"]), "image/png")
        self.assertEqual(said["picture"], {"type": "image/png", "bytes": len(picture[2])})

    def test_a_refusal_names_the_member(self):
        with FakeService(PROBLEM) as fake:
            status, out, err = self.run_example("one_frame", fake.url)
        self.assertEqual((status, out), (2, ""), err)
        for words in ("422", "Invalid request", "/camera/width", "is negative"):
            self.assertIn(words, err)

    def real_answer(self):
        status, headers, body = self.service.frame(self.a_frame(), "application/x-npz")
        self.assertEqual(status, 200)
        return 200, {"Content-Type": headers["Content-Type"], "ETag": headers["ETag"]}, body

    def test_a_busy_service_is_asked_again(self):
        with FakeService(BUSY, BUSY, self.real_answer()) as fake:
            status, out, err = self.run_example("one_frame", fake.url)
        self.assertEqual(status, 0, err)
        self.assertEqual(len(fake.requests), 3)

    def test_a_dropped_connection_is_asked_again(self):
        with FakeService(None, self.real_answer()) as fake:
            status, out, err = self.run_example("one_frame", fake.url)
        self.assertEqual(status, 0, err)
        self.assertEqual(len(fake.requests), 2)
        self.assertEqual(fake.requests[0][2], fake.requests[1][2])
        with FakeService(None, None, None, None) as fake:
            status, out, err = self.run_example("one_frame", fake.url)
        self.assertEqual(status, 1, out)
        self.assertEqual(len(fake.requests), 3)

    def test_an_answer_cut_off_is_an_error(self):
        status, headers, body = self.real_answer()
        with FakeService((status, headers, body[:-1000])) as fake:
            status, out, err = self.run_example("one_frame", fake.url)
        self.assertEqual((status, out), (1, ""), err)

    def test_a_token_is_sent(self):
        with FakeService(self.real_answer()) as fake:
            self.run_example("one_frame", fake.url, "secret")
        self.assertEqual(fake.requests[0][1].get("Authorization"), "Bearer secret")


@unittest.skipUnless(CPP_EXAMPLES, "SELENOGRAPH_CPP_EXAMPLES isn't set")
class Cpp(Examples, harness.WithService):
    def run_example(self, name, *arguments):
        done = subprocess.run([os.path.join(CPP_EXAMPLES, name), *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              text=True, timeout=PATIENCE_S)
        return done.returncode, done.stdout, done.stderr

    def test_connections_are_kept(self):
        answer = self.real_answer()
        with FakeService(*[answer] * 20) as fake:
            status, _, err = self.run_example("descent", fake.url)
        self.assertEqual(status, 0, err)
        self.assertEqual(len(fake.requests), 20)
        self.assertLessEqual(len(fake.connections), 2)


@unittest.skipUnless(OCTAVE, "Octave isn't installed: apt-get install octave")
class Octave(Examples, harness.WithService):
    types = {"float32": "single", "float64": "double"}
    last_places = 2

    def run_example(self, name, *arguments):
        paths = [os.path.join(CLIENTS, "matlab"), os.path.join(CLIENTS, "matlab", "examples"),
                 os.path.join(REPOSITORY, "tests", "service")]
        words = ["'%s'" % word for word in paths + list(arguments)]
        script = ("addpath(%s); try, %s(%s); catch e, fputs(stderr, [e.identifier ': ' e.message]); "
                  "exit(1 + strcmp(e.identifier, 'selenograph:refused')); end; exit(0);"
                  % (", ".join(words[:3]), name, ", ".join(words[3:])))
        done = subprocess.run([OCTAVE, "--no-gui", "--norc", "--quiet", "--eval", script], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
        return done.returncode, done.stdout, done.stderr


if __name__ == "__main__":
    harness.main()
