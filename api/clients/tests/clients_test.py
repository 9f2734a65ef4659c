#!/usr/bin/env python3
"""The clients in api/clients that aren't Python's: their examples against the real service, and faults of a fake one.

Their other calls: every_call_test.py. What needs Octave is skipped where that isn't installed. NumPy reads the service's own
answers.
"""

import io
import json
import re
import unittest
import zipfile

import numpy

import harness
from fake_service import FakeService
from one_service import SUN, OneService, setUpModule, tearDownModule  # noqa: F401
from programs import CPP_EXAMPLES, OCTAVE, run_cpp, run_octave, run_octave_function

PROBLEM = (422, {"Content-Type": "application/problem+json"}, json.dumps({
    "type": "urn:selenograph:problem:invalid_request", "title": "Invalid request", "status": 422, "detail": "a fault",
    "errors": [{"pointer": "/camera/width", "detail": "is negative"}]}).encode())
BUSY = (503, {"Content-Type": "application/problem+json", "Retry-After": "0"}, json.dumps({
    "type": "urn:selenograph:problem:busy", "title": "Busy", "status": 503, "detail": "come back"}).encode())


class Examples:
    """The same three examples in each language: each prints lines of words and numbers."""

    types = {"float32": "float32", "float64": "float64"}  # what the language calls them

    def run_example(self, name, *arguments):
        """Returns (exit status, standard output, standard error)."""
        raise NotImplementedError

    def lines(self, name):
        status, out, err = self.run_example(name, self.url())
        self.assertEqual(status, 0, err)
        return out.splitlines()

    def npz(self, request):
        """The service's own answer, by NumPy; and its ETag."""
        answer = self.service.arrays(request)
        return answer, answer["headers"]["ETag"]

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
        self.assertIn(f"level of detail error {frame['meta']['lod_error_m']:.17g} m", lines)

    def test_a_descent(self):
        found = re.findall(r"^frame (\d+): nearest ground (\S+) m, etag (\S+)$", "\n".join(self.lines("descent")), re.M)
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
        self.assertEqual(fake.requests[0][3], fake.requests[1][3])
        with FakeService(None, None, None, None) as fake:
            status, out, err = self.run_example("one_frame", fake.url)
        self.assertEqual(status, 1, out)
        self.assertEqual(len(fake.requests), 3)

    def test_an_answer_cut_off_is_an_error(self):
        status, headers, body = self.real_answer()
        with FakeService((status, headers, body[:-1000])) as fake:
            status, out, err = self.run_example("one_frame", fake.url)
        self.assertEqual((status, out), (1, ""), err)

    def test_a_service_of_another_major_version_is_an_error(self):
        status, headers, body = self.real_answer()
        for version, right in (("1.99.0", True), ("2.0.0", False)):
            with FakeService((status, {**headers, "Server": f"selenograph/{version}"}, body)) as fake:
                status_of_example, out, err = self.run_example("one_frame", fake.url)
            self.assertEqual(status_of_example == 0, right, err)
            self.assertEqual("selenograph/2.0.0" in err, not right, err)

    def test_a_token_is_sent(self):
        with FakeService(self.real_answer()) as fake:
            self.run_example("one_frame", fake.url, "secret")
        self.assertEqual(fake.requests[0][2].get("Authorization"), "Bearer secret")


@unittest.skipUnless(CPP_EXAMPLES, "SELENOGRAPH_CPP_EXAMPLES isn't set")
class Cpp(Examples, OneService):
    def run_example(self, name, *arguments):
        return run_cpp(name, *arguments)

    def test_connections_are_kept(self):
        answer = self.real_answer()
        with FakeService(*[answer] * 20) as fake:
            status, _, err = self.run_example("descent", fake.url)
        self.assertEqual(status, 0, err)
        self.assertEqual(len(fake.requests), 20)
        self.assertLessEqual(len({connection for connection, *_ in fake.requests}), 2)


@unittest.skipUnless(OCTAVE, "Octave isn't installed: apt-get install octave")
class Octave(Examples, OneService):
    types = {"float32": "single", "float64": "double"}

    def run_example(self, name, *arguments):
        return run_octave_function(name, *arguments)

    def test_a_map_and_what_the_headers_say(self):
        status, headers, body = self.real_answer()
        headers.update({"Selenograph-Echo": '{"n":1}', "Server-Timing": "parse;dur=0.5, load;dur=2"})
        with FakeService((status, headers, body)) as fake:
            status, out, err = run_octave(
                f"map = selenograph_map('{fake.url}', struct('map', struct('gsd_m', 40))); "
                "disp(jsonencode({size(map.geodetic), map.timing_ms, map.echo, map.etag, map.meta.software.name}))")
        self.assertEqual(status, 0, err)
        self.assertEqual(json.loads(out), [[240, 320, 3], {"parse": 0.5, "load": 2}, {"n": 1}, headers["ETag"], "selenograph"])
        self.assertEqual(fake.requests[0][1], "/v1/maps")
        self.assertEqual(json.loads(fake.requests[0][3]), {"map": {"gsd_m": 40}})

    def test_halves(self):
        halves = numpy.array([[1, -2, 65504, 2.0 ** -14], [2.0 ** -24, -0.0, -numpy.inf, numpy.nan]], numpy.float16)
        archive = io.BytesIO()
        numpy.savez(archive, range=halves)
        with FakeService((200, {}, archive.getvalue())) as fake:
            status, out, err = run_octave(
                f"frame = selenograph_frame('{fake.url}', struct('labels', true)); "
                "printf('%s\\n', class(frame.range)); "
                "printf('%.17g ', frame.range')")
        self.assertEqual(status, 0, err)
        said, values = out.splitlines()
        self.assertEqual(said, "single")
        numpy.testing.assert_array_equal([float(value) for value in values.split()], halves.ravel())

    def test_deflate_is_refused_before_it_is_asked(self):
        with FakeService() as fake:
            status, out, err = run_octave(
                "for cameras = {struct(), struct('left', struct('compression', 'deflate'))}, "
                "request = struct('cameras', cameras{1}); "
                "if isempty(fieldnames(cameras{1})), request = struct('compression', 'deflate'); end; "
                f"try, selenograph_frame('{fake.url}', request); catch e, disp([e.identifier ' ' e.message]); end; end")
        self.assertEqual(status, 0, err)
        self.assertEqual(out.splitlines(),
                         ['selenograph:argument "compression": "deflate" can\'t be read: leave it out'] * 2)
        self.assertEqual(fake.requests, [])

    def test_faults_of_poses_ahead_are_those_of_later_requests(self):
        def refusal(*pointers):
            errors = [{"pointer": p, "detail": "is wrong"} for p in pointers]
            return 422, {"Content-Type": "application/problem+json"}, json.dumps({
                "title": "t", "status": 422, "detail": "d", "errors": errors}).encode()

        frames = ("selenograph_frames('%s', {struct('pose', 0), struct('pose', 1), struct('pose', 2)}, "
                  "@(i, frame) disp(i))")
        frame = self.real_answer()
        with FakeService(refusal("/ahead/0", "/ahead/1/lat_deg"), frame, refusal("/ahead/0"), frame,
                         refusal("/pose")) as fake:
            status, out, err = run_octave(frames % fake.url)
        self.assertEqual((status, out.split()), (2, ["1", "2"]), err)
        self.assertIn("/pose: is wrong", err)
        self.assertEqual([json.loads(body) for *_, body in fake.requests],
                         [{"pose": 0, "ahead": [1, 2]}, {"pose": 0}, {"pose": 1, "ahead": [2]}, {"pose": 1},
                          {"pose": 2}])
        with FakeService(refusal("/ahead/0", "/pose")) as fake:
            status, out, err = run_octave(frames % fake.url)
        self.assertEqual((status, out, len(fake.requests)), (2, "", 1), err)

    def test_invalid_answers(self):
        cases = (
            ("selenograph:bad_answer", "selenograph_frame(url, struct('a', 1))", (200, {}, b"<html>")),
            ("selenograph:bad_answer", "selenograph_heights(url, 1, 2)", (200, {}, b"<html>")),
            ("selenograph:bad_answer", "selenograph_heights(url, 1, 2)", (200, {}, b'{"points": []}')),
            ("selenograph:refused: 502 without", "selenograph_heights(url, 1, 2)", (502, {}, b"<html>")),
            ("selenograph:refused: 503 Busy", "selenograph_datasets(selenograph_service(url, '', 50))",
             (503, {"Retry-After": "100"}, BUSY[2])),
            ("selenograph:refused: 422 Invalid request: a fault  /camera/width: is negative  /points/0 is number 10001",
             "selenograph_heights(url, zeros(1, 10001), zeros(1, 10001))",
             (200, {}, json.dumps({"points": [{}] * 10000}).encode())),
            ("selenograph:no_answer", "selenograph_datasets('http://127.0.0.1:1')", None),
            ("selenograph:no_answer", "selenograph_datasets(selenograph_service(url, '', 0))", None),
            ("selenograph:argument", "selenograph_service(url, ['a' 10 'b'])", None),
            ("selenograph:argument", "selenograph_rays(url, [1 2 3], [1 2])", None),
            ("selenograph:argument", "selenograph_pose([1 2 3], 'camera_from_moon_matrix', 2 * eye(3))", None))
        each = " ".join("try, %s; catch e, disp([e.identifier ': ' strrep(e.message, char(10), '')]); end;" % statement for _, statement, _ in cases)
        answers = [answer for _, _, answer in cases if answer] + [PROBLEM]
        with FakeService(*answers) as fake:
            status, out, err = run_octave(f"url = '{fake.url}'; {each}")
        self.assertEqual(status, 0, err)
        for (expected, statement, _), said in zip(cases, out.splitlines()):
            self.assertTrue(said.startswith(expected), f"{statement}: {said}")
        self.assertEqual(len(out.splitlines()), len(cases))


if __name__ == "__main__":
    harness.main()
