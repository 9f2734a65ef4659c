#!/usr/bin/env python3
"""The clients in api/clients that aren't Python's: their examples against the real service, and faults of a fake one; and
the adapters for Basilisk and ROS.

SELENOGRAPH_CPP_EXAMPLES is the folder of the built C++ examples. What needs Octave or ROS (python3-rospy,
python3-sensor-msgs, python3-rosmaster) is skipped where that isn't installed. NumPy reads the service's own answers.
"""

import importlib.util
import json
import os
import queue
import re
import shutil
import socket
import subprocess
import sys
import types
import unittest

import numpy

import harness
from fake_service import FakeService
from harness import PATIENCE_S, REPOSITORY

CLIENTS = os.path.join(REPOSITORY, "api", "clients")
CPP_EXAMPLES = os.environ.get("SELENOGRAPH_CPP_EXAMPLES", "")
sys.path.insert(0, os.path.join(CLIENTS, "python"))
ROSMASTER = shutil.which("rosmaster") if importlib.util.find_spec("rospy") else None
OCTAVE = shutil.which("octave-cli") or shutil.which("octave")
PLACE = ("--south-deg", "-8", "--west-deg", "39", "--rows", "3", "--columns", "2", "--ppd", "256")  # what the examples fly over
SUN = {"subsolar": {"lat_deg": 0.0, "lon_deg": 100.0}}


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE)
    WithClients.service = harness.Service()


def tearDownModule():
    code = WithClients.service.stop()
    harness.tear_down()
    assert code == 0, f"exit status {code} after SIGTERM"


class WithClients(unittest.TestCase):
    """One service for all tests."""

    service = None

    def url(self):
        return "http://%s:%d" % (self.service.host, self.service.port)


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

    def alike(self, got, right, what):
        """The members that the client has are the service's, NaN and null alike."""
        self.assertEqual(len(got), len(right), what)
        for ours, its in zip(got, right):
            for name, value in ours.items():
                missing = "" if name == "source" else False if name in ("filled", "blended") else None
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
        archive = self.service.arrays({
            "map": {"projection": "equirectangular", "gsd_m": 500,
                    "bounds": {"south_deg": -7, "north_deg": -6, "west_deg": 39.5, "east_deg": 40.5}},
            "sun": SUN, "products": ["radiance", "height"]}, "/v1/maps")
        self.assertEqual(said["map"]["shape"], list(archive["height"].shape))
        self.assert_alike(said["map"]["height"], float(archive["height"][3, 5]), "map.height")
        self.assertEqual(said["map"]["hash"], archive["meta"]["content_hash"])

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

    def test_a_token_is_sent(self):
        with FakeService(self.real_answer()) as fake:
            self.run_example("one_frame", fake.url, "secret")
        self.assertEqual(fake.requests[0][2].get("Authorization"), "Bearer secret")


@unittest.skipUnless(CPP_EXAMPLES, "SELENOGRAPH_CPP_EXAMPLES isn't set")
class Cpp(Examples, WithClients):
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
        self.assertLessEqual(len({connection for connection, *_ in fake.requests}), 2)


@unittest.skipUnless(OCTAVE, "Octave isn't installed: apt-get install octave")
class Octave(Examples, WithClients):
    types = {"float32": "single", "float64": "double"}
    last_places = 2

    def run_example(self, name, *arguments):
        return self.run_octave("%s(%s)" % (name, ", ".join("'%s'" % word for word in arguments)))

    def run_octave(self, statement):
        paths = [os.path.join(CLIENTS, "matlab"), os.path.join(CLIENTS, "matlab", "examples"),
                 os.path.join(CLIENTS, "tests")]
        script = ("addpath('%s'); try, %s; catch e, fputs(stderr, [e.identifier ': ' e.message]); "
                  "exit(1 + strcmp(e.identifier, 'selenograph:refused')); end; exit(0);" % ("', '".join(paths), statement))
        done = subprocess.run([OCTAVE, "--no-gui", "--norc", "--quiet", "--eval", script], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
        return done.returncode, done.stdout, done.stderr


    def test_a_map_and_what_the_headers_say(self):
        status, headers, body = self.real_answer()
        headers.update({"Selenograph-Echo": '{"n":1}', "Server-Timing": "parse;dur=0.5, load;dur=2"})
        with FakeService((status, headers, body)) as fake:
            status, out, err = self.run_octave(
                f"map = selenograph_map('{fake.url}', struct('map', struct('gsd_m', 40))); "
                "disp(jsonencode({size(map.geodetic), map.timing_ms, map.echo, map.etag, map.meta.software.name}))")
        self.assertEqual(status, 0, err)
        self.assertEqual(json.loads(out), [[240, 320, 3], {"parse": 0.5, "load": 2}, {"n": 1}, headers["ETag"], "selenograph"])
        self.assertEqual(fake.requests[0][1], "/v1/maps")
        self.assertEqual(json.loads(fake.requests[0][3]), {"map": {"gsd_m": 40}})

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
            status, out, err = self.run_octave(f"url = '{fake.url}'; {each}")
        self.assertEqual(status, 0, err)
        for (expected, statement, _), said in zip(cases, out.splitlines()):
            self.assertTrue(said.startswith(expected), f"{statement}: {said}")
        self.assertEqual(len(out.splitlines()), len(cases))


def loaded(*path):
    """A Python file of api/clients as a module."""
    name = path[-1][:-len(".py")]
    spec = importlib.util.spec_from_file_location(name, os.path.join(CLIENTS, *path))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses look
    spec.loader.exec_module(module)
    return module


def basilisk_stand_ins():
    """The parts of Basilisk that the adapter sees, as far as it sees them."""

    class Reader:
        def __init__(self):
            self.message = None

        def subscribeTo(self, message):
            self.message = message

        def isLinked(self):
            return self.message is not None

        def __call__(self):
            return self.message

    class SysModel:
        moduleID = 1

        def __init__(self):
            self.errors = []
            self.bskLogger = types.SimpleNamespace(bskLog=lambda level, text: self.errors.append(text))

    architecture = types.ModuleType("Basilisk.architecture")
    architecture.messaging = types.SimpleNamespace(SCStatesMsgReader=Reader, SpicePlanetStateMsgReader=Reader)
    architecture.sysModel = types.SimpleNamespace(SysModel=SysModel)
    architecture.bskLogging = types.SimpleNamespace(BSK_ERROR="error")
    return {"Basilisk": types.ModuleType("Basilisk"), "Basilisk.architecture": architecture}


def rotation(axis, angle):
    """The matrix that turns vectors, by Rodrigues' formula."""
    k = numpy.array(axis, float) / numpy.linalg.norm(axis)
    cross = numpy.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return numpy.eye(3) + numpy.sin(angle) * cross + (1 - numpy.cos(angle)) * cross @ cross


def mrp_of(matrix):
    """Modified Rodrigues parameters of a direction cosine matrix (Schaub and Junkins)."""
    zeta = numpy.sqrt(numpy.trace(matrix) + 1)
    axis = [matrix[1, 2] - matrix[2, 1], matrix[2, 0] - matrix[0, 2], matrix[0, 1] - matrix[1, 0]]
    return numpy.array(axis) / (zeta * (zeta + 2))


class Adapter(WithClients):
    """What the adapters are compared with: a frame of the service's own, straight down."""

    def setUp(self):
        self.request = {"camera": {"width": 64, "height": 48, "fov_deg": 40, "distortion": {"k1": -0.05, "p1": 1e-3}},
                        "products": ["image", "range"]}
        self.right = self.npz({"pose": {"geodetic": {"lat_deg": -6.5, "lon_deg": 40.0, "height_m": 30000.0}, "nadir": {}},
                               "sun": SUN})
        resolved = self.right["meta"]["request"]
        self.position_m = numpy.array(resolved["pose"]["position_m"])
        self.quaternion = [resolved["pose"]["camera_from_moon"][key] for key in "wxyz"]

    def npz(self, rest):
        return self.service.arrays(dict(self.request, **rest))


class Basilisk(Adapter):
    def setUp(self):
        super().setUp()
        import selenograph
        sys.modules.update(basilisk_stand_ins())
        self.client = selenograph.Client(self.url())
        self.addCleanup(self.client.close)
        self.module = loaded("basilisk", "selenograph_camera.py")

    def camera(self, height_m=30000.0):
        """A spacecraft in an inertial frame that has nothing in common with the Moon's, with a camera askew and off its
        centre, such that the camera is where `right` was taken, or above or below."""
        w, x, y, z = self.quaternion
        camera_from_moon = rotation([x, y, z], 2 * numpy.arctan2(numpy.linalg.norm([x, y, z]), w))
        PN, CB = rotation([1, 2, 3], 0.7), rotation([-3, 1, 1], 0.4)
        moon_N = numpy.array([3.0e8, -1.2e8, 2.0e7])
        r_CB_B = numpy.array([1.5, -0.3, 0.7])
        BN = CB.T @ camera_from_moon @ PN
        radius_m = numpy.linalg.norm(self.position_m)
        place = self.position_m * (1 + (height_m - 30000.0) / radius_m)
        lon = numpy.radians(100.0)
        model = self.module.SelenographCamera(self.client, self.request)
        model.sigma_CB, model.r_CB_B, model.cameraID = mrp_of(CB), r_CB_B, 7
        model.scStateInMsg.subscribeTo(types.SimpleNamespace(
            r_BN_N=moon_N + PN.T @ place - BN.T @ r_CB_B, sigma_BN=mrp_of(BN)))
        model.moonInMsg.subscribeTo(types.SimpleNamespace(PositionVector=moon_N, J20002Pfix=PN))
        model.sunInMsg.subscribeTo(types.SimpleNamespace(
            PositionVector=moon_N + 149597870700.0 * PN.T @ [numpy.cos(lon), numpy.sin(lon), 0]))
        return model

    def test_the_image_of_a_state(self):
        model = self.camera()
        model.Reset(0)
        self.assertEqual(model.imageOutMsg().valid, 0)
        model.UpdateState(5000000000)
        out = model.imageOutMsg()
        self.assertEqual(model.errors, [])
        self.assertEqual((out.timeTag, out.valid, out.cameraID), (5000000000, 1, 7))
        self.assertEqual(model.imageOutMsg.timeWritten(), 5000000000)
        self.assertEqual(out.image.shape, (48, 64))
        self.assertEqual(out.imageBufferLength, out.image.nbytes)
        # 3e8 m in double are known to 6e-8 m.
        numpy.testing.assert_allclose(out.frame["range"], self.right["range"], rtol=0, atol=1e-4)
        self.assertLess(numpy.mean(out.image != self.right["image"]), 0.01)
        self.assertGreater(len(numpy.unique(out.image)), 5)

    def test_refusals_give_no_image(self):
        model = self.camera(height_m=-5000.0)
        model.UpdateState(1)
        self.assertEqual((model.imageOutMsg().valid, model.imageOutMsg().image), (0, None))
        self.assertEqual(len(model.errors), 1)
        self.assertIn("/pose", model.errors[0])

    def test_unlinked_messages_are_reported(self):
        model = self.module.SelenographCamera(self.client, self.request)
        model.Reset(0)
        self.assertEqual(len(model.errors), 3)
        with self.assertRaises(ValueError):
            self.module.SelenographCamera(self.client, {"products": ["range"]})


class RosConversions(Adapter):
    """What needs no ROS."""

    def test_a_fisheye_and_a_sun_at_the_stamp(self):
        node = loaded("ros", "selenograph_node.py")
        info = types.SimpleNamespace()
        node.fill_camera_info(info, {"model": "fisheye", "width": 8, "height": 6, "fx": 5.0, "fy": 4.0, "cx": 3.5, "cy": 2.5,
                                     "distortion": {"k1": 0.1, "k4": 0.4}})
        self.assertEqual((info.distortion_model, info.D), ("equidistant", [0.1, 0.0, 0.0, 0.4]))
        self.assertEqual(info.K, [5.0, 0, 3.5, 0, 4.0, 2.5, 0, 0, 1])
        image = types.SimpleNamespace()
        node.fill_image(image, numpy.arange(12, dtype=numpy.float32).reshape(2, 2, 3))
        self.assertEqual((image.encoding, image.step, image.height, image.width), ("32FC3", 24, 2, 2))
        w, x, y, z = self.quaternion
        pose = types.SimpleNamespace(position=types.SimpleNamespace(**dict(zip("xyz", self.position_m))),
                                     orientation=types.SimpleNamespace(w=w, x=-x, y=-y, z=-z))
        stamp = types.SimpleNamespace(secs=1795132800, nsecs=250000000)
        message = types.SimpleNamespace(pose=pose, header=types.SimpleNamespace(stamp=stamp))
        request = node.request_of(message, self.request)
        self.assertEqual(request["sun"], {"utc": "2026-11-20T00:00:00.250000000Z"})
        numpy.testing.assert_allclose(self.npz(dict(request))["range"], self.right["range"], rtol=0, atol=1e-6)


@unittest.skipUnless(ROSMASTER, "ROS isn't installed: apt-get install python3-rospy python3-sensor-msgs python3-rosmaster")
class Ros(Adapter):
    """A ROS master, the node and a subscriber, each for real."""

    def start(self, *command):
        name = harness.path(os.path.basename(command[0]) + ".log")
        with open(name, "w") as log:
            process = subprocess.Popen(command, stdout=log, stderr=log)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        process.log_name = name
        return process

    def said(self, process):
        with open(process.log_name, errors="replace") as log:
            return log.read()

    def serves(self, process, port):
        self.assertIsNone(process.poll(), self.said(process))
        with socket.socket() as s:
            return s.connect_ex(("127.0.0.1", port)) == 0

    def test_images_of_poses(self):
        port = harness.free_port()
        os.environ.update(ROS_MASTER_URI=f"http://127.0.0.1:{port}", ROS_IP="127.0.0.1", ROS_HOME=harness.path("ros"),
                          ROS_LOG_DIR=harness.path("ros", "log"),
                          PYTHONPATH=os.pathsep.join([os.path.join(CLIENTS, "python"), os.environ.get("PYTHONPATH", "")]))
        master = self.start(ROSMASTER, "--core", "-p", str(port))
        harness.wait_until(lambda: self.serves(master, port), lambda: self.said(master))
        harness.write("ros-request.json", dict(self.request, sun=SUN))
        node = self.start(sys.executable, os.path.join(CLIENTS, "ros", "selenograph_node.py"), f"_url:={self.url()}",
                          "_request:=" + harness.path("ros-request.json"), "pose:=truth")
        import geometry_msgs.msg
        import rospy
        import sensor_msgs.msg

        rospy.init_node("clients_test", disable_signals=True)
        self.addCleanup(rospy.signal_shutdown, "the test is over")
        images, infos = queue.Queue(), queue.Queue()
        rospy.Subscriber("image_raw", sensor_msgs.msg.Image, images.put)
        rospy.Subscriber("camera_info", sensor_msgs.msg.CameraInfo, infos.put)
        poses = rospy.Publisher("truth", geometry_msgs.msg.PoseStamped, queue_size=10)
        message = geometry_msgs.msg.PoseStamped()
        w, x, y, z = self.quaternion
        q = message.pose.orientation
        q.w, q.x, q.y, q.z = w, -x, -y, -z  # moon_from_camera

        def publish(secs, moon_frame="moon_me", scale=1.0):
            message.header.stamp = rospy.Time(secs, 5)
            message.header.frame_id = moon_frame
            p = message.pose.position
            p.x, p.y, p.z = scale * self.position_m
            poses.publish(message)

        def following(answers):
            answer = answers.get(timeout=PATIENCE_S)
            return answer if answer.header.stamp.secs != 1 else following(answers)

        # What is sent before all are connected is lost.
        def connected():
            self.assertIsNone(node.poll(), self.said(node))
            publish(1)
            return not (images.empty() or infos.empty())

        harness.wait_until(connected, lambda: self.said(node))
        publish(100)
        publish(101, moon_frame="map")
        publish(102, scale=0.98)
        publish(103)
        # 101 is in a frame that isn't the Moon's, 102 is below the ground.
        for secs in (100, 103):
            image, info = following(images), following(infos)
            for header in (image.header, info.header):
                self.assertEqual((header.stamp.secs, header.stamp.nsecs, header.frame_id), (secs, 5, "camera_optical"))
            self.assertEqual((image.encoding, image.height, image.width, image.step), ("mono8", 48, 64, 64))
            values = numpy.frombuffer(image.data, numpy.uint8).reshape(48, 64)
            self.assertLess(numpy.mean(values != self.right["image"]), 0.01)
            self.assertEqual((info.height, info.width, info.distortion_model), (48, 64, "plumb_bob"))
            self.assertEqual(info.D, (-0.05, 0.0, 1e-3, 0.0, 0.0))
            self.assertAlmostEqual(info.K[0], 32 / numpy.tan(numpy.radians(20)), places=9)
            self.assertEqual(info.K[2:6:3], (31.5, 23.5))
        self.assertTrue(images.empty())
        self.assertIn("pose in frame 'map'", self.said(node))
        self.assertIn("no image of the pose at 102", self.said(node))


if __name__ == "__main__":
    harness.main()
