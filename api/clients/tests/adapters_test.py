#!/usr/bin/env python3
"""The adapters of api/clients for Basilisk and ROS 2, against the real service.

Debian has neither Basilisk nor ROS 2: stand-ins take their place, which hold the published definitions of their messages
and refuse what those do not have.
"""

import array
import contextlib
import dataclasses
import importlib.util
import io
import os
import pathlib
import re
import sys
import types
import unittest

import numpy

import harness
from fake_service import FakeService
from one_service import CLIENTS, SUN, OneService, setUpModule, tearDownModule  # noqa: F401

sys.path[:0] = [os.path.join(CLIENTS, "python"), os.path.join(CLIENTS, "ros")]
import selenograph  # noqa: E402
import selenograph_ros  # noqa: E402


def loaded(*path):
    """A Python file of api/clients as a module."""
    name = path[-1][:-len(".py")]
    spec = importlib.util.spec_from_file_location(name, os.path.join(CLIENTS, *path))
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses look
    spec.loader.exec_module(module)
    return module


def npz(**arrays):
    file = io.BytesIO()
    numpy.savez(file, **arrays)
    return file.getvalue()


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


@contextlib.contextmanager
def in_place(modules):
    """Modules by name, which are imported meanwhile."""
    before = {name: sys.modules.get(name) for name in modules}
    sys.modules.update(modules)
    try:
        yield
    finally:
        for name, module in before.items():
            if module:
                sys.modules[name] = module
            else:
                del sys.modules[name]


class Adapter(OneService):
    """Has the frame that the adapters' are compared with: the service's own, straight down."""

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


# Members as in AVSLab/basilisk, src/architecture/msgPayloadDefC/NAME.h, of the commits 0773ee82 and, of
# SpicePlanetStateMsgPayload, eea393e1 (branch develop). Of CameraConfigMsgPayload: those that the adapter has, too.
BASILISK = {
    "SCStatesMsgPayload": {
        "r_BN_N": "double[3]", "v_BN_N": "double[3]", "r_CN_N": "double[3]", "v_CN_N": "double[3]", "sigma_BN": "double[3]",
        "omega_BN_B": "double[3]", "omegaDot_BN_B": "double[3]", "TotalAccumDVBdy": "double[3]",
        "TotalAccumDV_BN_B": "double[3]", "TotalAccumDV_CN_N": "double[3]", "nonConservativeAccelpntB_B": "double[3]",
        "MRPSwitchCount": "uint64_t"},
    "SpicePlanetStateMsgPayload": {
        "J2000Current": "double", "PositionVector": "double[3]", "VelocityVector": "double[3]", "J20002Pfix": "double[3][3]",
        "J20002Pfix_dot": "double[3][3]", "computeOrient": "int", "PlanetName": "char[64]"},
    "CameraImageMsgPayload": {
        "timeTag": "uint64_t", "valid": "int", "cameraID": "int64_t", "imagePointer": "void*", "imageBufferLength": "int32_t",
        "imageType": "int8_t"},
    "CameraConfigMsgPayload": {"cameraID": "int64_t", "cameraPos_B": "double[3]", "sigma_CB": "double[3]"},
}
BITS = {"int": 32, "int8_t": 8, "int32_t": 32, "int64_t": 64, "uint64_t": 64}


def fits(value, kind):
    """Whether a Python number is one of C's integer type."""
    low, high = (0, 2 ** BITS[kind]) if kind[0] == "u" else (-(2 ** (BITS[kind] - 1)), 2 ** (BITS[kind] - 1))
    return type(value) is int and low <= value < high


class Payload:
    """A message of Basilisk with what was published of it, and nothing else. Arrays of double read as lists, as in
    Basilisk's Python."""

    def __init__(self, name, **values):
        super().__setattr__("name", name)
        for member, kind in BASILISK[name].items():
            shape = tuple(int(n) for n in re.findall(r"\[(\d+)\]", kind))
            value = "" if kind.startswith("char") else numpy.zeros(shape).tolist() if kind.startswith("double") else 0
            if member in values:
                value = numpy.asarray(values.pop(member), float)
                assert value.shape == shape, (name, member, value.shape)
                value = value.tolist()
            super().__setattr__(member, value)
        assert not values, (name, list(values))

    def __setattr__(self, member, value):
        raise AttributeError(f"{self.name}.{member} is another module's")


class BasiliskError(Exception):
    pass


def basilisk_stand_ins():
    """The parts of Basilisk that the adapter sees, as far as it sees them."""

    def reader(name):
        class Reader:
            message = None

            def subscribeTo(self, message):
                assert message.name == name, f"tried to subscribe {name} to {message.name}"
                self.message = message

            def isLinked(self):
                return self.message is not None

            def __call__(self):
                return self.message

        return Reader

    class SysModel:
        moduleID = 1

        def __init__(self):
            self.warnings = []
            self.bskLogger = types.SimpleNamespace(bskLog=self.log)

        def log(self, level, text):
            """As bskLog does since it raises errors in Python; the text is a format of printf, without values."""
            text = text % ()
            if level == "BSK_ERROR":
                raise BasiliskError(text)
            self.warnings.append(text)

    architecture = types.ModuleType("Basilisk.architecture")
    architecture.messaging = types.SimpleNamespace(SCStatesMsgReader=reader("SCStatesMsgPayload"),
                                                   SpicePlanetStateMsgReader=reader("SpicePlanetStateMsgPayload"))
    architecture.sysModel = types.SimpleNamespace(SysModel=SysModel)
    architecture.bskLogging = types.SimpleNamespace(BSK_ERROR="BSK_ERROR", BSK_WARNING="BSK_WARNING")
    return {"Basilisk": types.ModuleType("Basilisk"), "Basilisk.architecture": architecture}


def scenario_stand_ins(PN, sun_N):
    """The parts of Basilisk that the scenario sees besides: a simulation that calls each model at its task's rate, a
    spacecraft on a circle with a constant rate, and bodies whose states are given."""
    simulation, utilities = types.ModuleType("Basilisk.simulation"), types.ModuleType("Basilisk.utilities")

    class SimBaseClass:
        def __init__(self):
            self.tasks, self.models, self.stop = [], [], None

        def CreateNewProcess(self, name):
            return types.SimpleNamespace(addTask=self.tasks.append)

        def CreateNewTask(self, name, rate):
            return (name, rate)

        def AddModelToTask(self, task, model, priority=-1):
            rate, = [rate for name, rate in self.tasks if name == task]
            self.models.append((self.tasks.index((task, rate)), -priority, rate, model))

        def InitializeSimulation(self):
            self.models.sort(key=lambda entry: entry[:2])
            for *_, model in self.models:
                model.Reset(0)
            self.next = 0

        def ConfigureStopTime(self, time):
            assert type(time) is int
            self.stop = time

        def ExecuteSimulation(self):
            while self.next <= self.stop:
                for *_, rate, model in self.models:
                    if self.next % rate == 0:
                        model.UpdateState(self.next)
                self.next += min(rate for _, rate in self.tasks)

    class Spacecraft:
        def __init__(self):
            self.hub = types.SimpleNamespace()
            self.scStateOutMsg = types.SimpleNamespace(name="SCStatesMsgPayload")

        def Reset(self, time):
            assert numpy.allclose(self.hub.IHubPntBc_B, 100 * numpy.eye(3)) and self.mu
            self.r, self.v = numpy.array(self.hub.r_CN_NInit), numpy.array(self.hub.v_CN_NInit)
            speed = numpy.linalg.norm(self.v)
            assert abs(speed ** 2 * numpy.linalg.norm(self.r) / self.mu - 1) < 1e-9 and abs(self.r @ self.v) < 1

        def UpdateState(self, time):
            s = numpy.array(self.hub.sigma_BNInit)
            BN = rotation(s, -4 * numpy.arctan(numpy.linalg.norm(s)))
            rate_N = numpy.cross(self.r, self.v) / (self.r @ self.r)
            numpy.testing.assert_allclose(BN.T @ self.hub.omega_BN_BInit, rate_N, atol=1e-12)
            turn = rotation(rate_N, numpy.linalg.norm(rate_N) * time * 1e-9)
            vars(self.scStateOutMsg).update(vars(Payload("SCStatesMsgPayload", r_BN_N=turn @ self.r,
                                                         sigma_BN=mrp_of(BN @ turn.T))))

    class gravBodyFactory:
        mu = 4902.8e9

        def createMoon(self):
            self.moon = types.SimpleNamespace(mu=self.mu)
            return self.moon

        def createSun(self):
            return types.SimpleNamespace()

        def createSpiceInterface(self, path, time, spiceKernelFileNames, spicePlanetFrames):
            assert path.endswith("/") and self.moon.isCentralBody and spicePlanetFrames == ["MOON_ME", "IAU_SUN"]
            return types.SimpleNamespace(Reset=lambda time: None, UpdateState=lambda time: None, planetStateOutMsgs=[
                Payload("SpicePlanetStateMsgPayload", J20002Pfix=PN),
                Payload("SpicePlanetStateMsgPayload", PositionVector=sun_N, J20002Pfix=numpy.eye(3))])

        def addBodiesTo(self, craft):
            craft.mu = self.mu

    simulation.spacecraft = types.SimpleNamespace(Spacecraft=Spacecraft)
    utilities.RigidBodyKinematics = types.SimpleNamespace(C2MRP=mrp_of)
    utilities.SimulationBaseClass = types.SimpleNamespace(SimBaseClass=SimBaseClass)
    utilities.macros = types.SimpleNamespace(sec2nano=lambda s: int(s * 1e9), min2nano=lambda m: int(m * 60e9))
    utilities.simIncludeGravBody = types.SimpleNamespace(gravBodyFactory=gravBodyFactory)
    return {"Basilisk.simulation": simulation, "Basilisk.utilities": utilities}


class Basilisk(Adapter):
    def setUp(self):
        super().setUp()
        self.client = selenograph.Client(self.url())
        self.addCleanup(self.client.close)
        with in_place(basilisk_stand_ins()):
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
        model.scStateInMsg.subscribeTo(Payload(
            "SCStatesMsgPayload", r_BN_N=moon_N + PN.T @ place - BN.T @ r_CB_B, sigma_BN=mrp_of(BN)))
        model.moonInMsg.subscribeTo(Payload("SpicePlanetStateMsgPayload", PositionVector=moon_N, J20002Pfix=PN))
        model.sunInMsg.subscribeTo(Payload(
            "SpicePlanetStateMsgPayload",
            PositionVector=moon_N + 149597870700.0 * PN.T @ [numpy.cos(lon), numpy.sin(lon), 0]))
        return model

    def test_the_image_of_a_state(self):
        model = self.camera()
        model.Reset(0)
        self.assertEqual(model.imageOutMsg().valid, 0)
        model.UpdateState(5000000000)
        out = model.imageOutMsg()
        self.assertEqual(model.warnings, [])
        self.assertEqual((out.timeTag, out.valid, out.cameraID), (5000000000, 1, 7))
        self.assertEqual(model.imageOutMsg.timeWritten(), 5000000000)
        self.assertEqual(out.image.shape, (48, 64))
        self.assertEqual(out.imageBufferLength, out.image.nbytes)
        # 3e8 m in double are known to 6e-8 m.
        numpy.testing.assert_allclose(out.frame["range"], self.right["range"], rtol=0, atol=1e-4)
        self.assertLess(numpy.mean(out.image != self.right["image"]), 0.01)
        self.assertGreater(len(numpy.unique(out.image)), 5)

    def test_the_scenario(self):
        """At minute 0 straight down on the terrain at 6.5 S 40 E; a minute later the orbit has gone on by 3.2 degrees."""
        start = numpy.array([0.3, -0.9, -0.3]) / numpy.linalg.norm([0.3, -0.9, -0.3])  # in N, as in the scenario
        lat, lon = numpy.radians([-6.5, 40.0])
        place = numpy.array([numpy.cos(lat) * numpy.cos(lon), numpy.cos(lat) * numpy.sin(lon), numpy.sin(lat)])
        axis = numpy.cross(start, place)
        PN = rotation(axis, numpy.arcsin(numpy.linalg.norm(axis)) if start @ place > 0 else
                      numpy.pi - numpy.arcsin(numpy.linalg.norm(axis)))
        modules = {**basilisk_stand_ins(), **scenario_stand_ins(PN, 149597870700.0 * numpy.array([-0.5, -0.8, -0.33]))}
        with in_place({**modules, "selenograph_camera": self.module}):
            scenario = loaded("basilisk", "scenario_lunar_orbit.py")
            folder = pathlib.Path(harness.path("orbit"))
            folder.mkdir()
            taken = scenario.run(self.client, "kernels", 1, folder)
        self.assertEqual([message.valid for message in taken], [1, 1])
        views = [message.frame.meta["view"] for message in taken]
        self.assertAlmostEqual(views[0]["lat_deg"], -6.5, delta=1e-6)
        self.assertAlmostEqual(views[0]["lon_deg"], 40.0, delta=1e-6)
        self.assertEqual(taken[0].image.shape, (512, 512))
        self.assertGreater(numpy.nanmean(taken[0].frame["lit"]), 0.9)
        positions = [numpy.array(message.frame.meta["request"]["pose"]["position_m"]) for message in taken]
        turned = numpy.arccos(positions[0] @ positions[1] / numpy.prod(numpy.linalg.norm(positions, axis=1)))
        self.assertAlmostEqual(numpy.degrees(turned), numpy.degrees(numpy.sqrt(4902.8e9 / 1837.4e3 ** 3) * 60), delta=1e-6)
        self.assertLess(views[1]["off_nadir_deg"], 1e-3)
        self.assertEqual(numpy.load(folder / "frame-000.npy").tolist(), taken[0].image.tolist())

    def test_refusals_give_no_image(self):
        model = self.camera(height_m=-5000.0)
        model.UpdateState(1)
        self.assertEqual((model.imageOutMsg().valid, model.imageOutMsg().image), (0, None))
        self.assertEqual(len(model.warnings), 1)
        self.assertIn("/pose", model.warnings[0])

    def test_answers_that_are_no_frame_are_logged(self):
        model = self.camera()
        for content in (b"cut off", npz(a=numpy.zeros(1))):
            answer = (200, {"Content-Type": "application/x-npz"}, content)
            with FakeService(answer) as fake, selenograph.Client(fake.url) as model.client:
                model.UpdateState(1)
            self.assertEqual(model.imageOutMsg().valid, 0)
        self.assertEqual(len(model.warnings), 2, model.warnings)

    def test_a_text_with_a_percent_sign(self):
        """It reaches the log as it is."""
        model = self.camera()
        answer = (400, {"Content-Type": "application/problem+json"}, b'{"title": "100 %s of the sky", "status": 400}')
        with FakeService(answer) as fake, selenograph.Client(fake.url) as model.client:
            model.UpdateState(1)
        self.assertIn("100 %s of the sky", model.warnings[0])

    def test_unlinked_messages_are_reported(self):
        model = self.module.SelenographCamera(self.client, self.request)
        with self.assertRaisesRegex(BasiliskError, "not linked: scStateInMsg, moonInMsg, sunInMsg"):
            model.Reset(0)
        with self.assertRaises(ValueError):
            self.module.SelenographCamera(self.client, {"products": ["range"]})
        with self.assertRaisesRegex(ValueError, "cameras"):
            self.module.SelenographCamera(self.client, {**self.request, "cameras": {"left": {}}})

    def test_the_published_image(self):
        """The members of CameraImageMsgPayload, of their types, with the array in place of the pointer."""
        published = dict(BASILISK["CameraImageMsgPayload"])
        del published["imagePointer"]
        members = [field.name for field in dataclasses.fields(self.module.Image)]
        self.assertEqual(sorted(members), sorted([*published, "image", "frame"]))
        model = self.camera()
        for image in (self.module.Image(), (model.UpdateState(2 ** 63), model.imageOutMsg())[1]):
            for member, kind in published.items():
                self.assertTrue(fits(getattr(image, member), kind), f"{member}: {getattr(image, member)!r} is no {kind}")
        self.assertEqual((image.valid, image.imageType, image.imageBufferLength), (1, 1, 48 * 64))

    def test_the_published_camera(self):
        """sigma_CB and cameraID mean what they do in CameraConfigMsgPayload; r_CB_B is its cameraPos_B."""
        published = BASILISK["CameraConfigMsgPayload"]
        model = self.module.SelenographCamera(self.client, self.request)
        for member, name in (("sigma_CB", "sigma_CB"), ("cameraPos_B", "r_CB_B")):
            self.assertEqual(f"double[{len(getattr(model, name))}]", published[member])
        self.assertTrue(fits(model.cameraID, published["cameraID"]))


class RosConversions(Adapter):
    """The conversions need no ROS."""

    def test_a_fisheye_and_a_sun_at_the_stamp(self):
        info = selenograph_ros.camera_info_members({"model": "fisheye", "width": 8, "height": 6, "fx": 5, "fy": 4.0, "cx": 3.5,
                                                    "cy": 2.5, "distortion": {"k1": 0.1, "k4": 0.4}})
        self.assertEqual((info["distortion_model"], info["d"]), ("equidistant", [0.1, 0.0, 0.0, 0.4]))
        self.assertEqual(info["k"], [5.0, 0, 3.5, 0, 4.0, 2.5, 0, 0, 1])
        rational = {"model": "opencv", "k1": 0.1, "p2": 0.2, "k6": 0.3}
        info = selenograph_ros.camera_info_members({"model": "pinhole", "width": 8, "height": 6, "fx": 5, "fy": 4.0, "cx": 3.5,
                                                    "cy": 2.5, "distortion": rational})
        self.assertEqual((info["distortion_model"], info["d"]),
                         ("rational_polynomial", [0.1, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.3]))
        self.assertIsNone(selenograph_ros.unfit_member({"camera": {"distortion": rational}}))
        self.assertEqual(selenograph_ros.unfit_member({"camera": {"distortion": {**rational, "s2": 0.1}}}), "camera.distortion.s2")
        self.assertEqual(selenograph_ros.unfit_member({"camera": {"cahvor": {}}}), "camera.cahvor")
        image = selenograph_ros.image_members(numpy.arange(12, dtype=numpy.float32).reshape(2, 2, 3))
        self.assertEqual([image[name] for name in ("encoding", "step", "height", "width")], ["32FC3", 24, 2, 2])
        w, x, y, z = self.quaternion
        pose = types.SimpleNamespace(position=types.SimpleNamespace(**dict(zip("xyz", self.position_m))),
                                     orientation=types.SimpleNamespace(w=w, x=-x, y=-y, z=-z))
        request = selenograph_ros.request_of(types.SimpleNamespace(pose=pose), 1795132800, 250000000, self.request)
        self.assertEqual(request["sun"], {"utc": "2026-11-20T00:00:00.250000000Z"})
        numpy.testing.assert_allclose(self.npz(dict(request))["range"], self.right["range"], rtol=0, atol=1e-6)

    def test_what_the_nodes_publish(self):
        """Colour, 16 bits and depth."""
        for kind, shape, encoding in (("uint8", (2, 3), "mono8"), ("uint16", (2, 3), "mono16"), ("float64", (2, 3), "64FC1")):
            values = numpy.arange(6).reshape(shape).astype(kind)
            image = selenograph_ros.image_members(values.astype(values.dtype.newbyteorder(">")))
            self.assertEqual((image["encoding"], image["is_bigendian"]), (encoding, 0))
            read = numpy.frombuffer(image["data"], values.dtype.newbyteorder("<")).reshape(shape)
            self.assertEqual(read.tolist(), values.tolist())
            self.assertEqual(image["step"] * image["height"], len(image["data"]))

    def test_a_depth_image_is_float32_unless_the_request_says_otherwise(self):
        parameters = {"url": self.url(), "request": harness.path("ros-depth.json"), "product": "depth"}
        for truth, kind in ((None, "float32"), ({"every_px": 1}, "float32"), ({"distance_type": "float64"}, "float64")):
            harness.write("ros-depth.json", dict(self.request, **({"truth": truth} if truth else {})))
            renderer = selenograph_ros.Renderer(lambda name, *default: parameters.get(name, *default), self.fail)
            renderer.client.close()
            self.assertEqual(renderer.request["truth"], {**(truth or {}), "distance_type": kind})

    def test_requests_whose_arrays_are_no_image_of_a_camera(self):
        """Of fewer pixels than CameraInfo has, of a type that Image has not, or by the names of several cameras."""
        parameters = {"url": self.url(), "request": harness.path("ros-unfit.json")}

        def renderer(**more):
            harness.write("ros-unfit.json", dict(self.request, **more))
            return selenograph_ros.Renderer(lambda name, *default: parameters.get(name, *default), self.fail)

        region = {"x": 8, "y": 8, "width": 16, "height": 12}
        for name, more in (("cameras", {"cameras": {"left": {}}}), ("truth.region", {"truth": {"region": region}}),
                           ("truth.every_px", {"truth": {"every_px": 4}}),
                           ("truth.distance_type", {"truth": {"distance_type": "float16"}})):
            with self.assertRaisesRegex(ValueError, f"ros-unfit.json: .* leave out {name}$"):
                renderer(**more)
        renderer(truth={"every_px": 1, "distance_type": "float32"}).client.close()


# Members as in ros2/common_interfaces, sensor_msgs/msg and geometry_msgs/msg (CameraInfo.msg of commit 27b84d39, Image.msg of
# 22012ae1), std_msgs/msg/Header.msg and ros2/rcl_interfaces, builtin_interfaces/msg/Time.msg. ../ros/README.md says where
# each was read.
ROS2 = {
    "Time": {"sec": "int32", "nanosec": "uint32"},
    "Header": {"stamp": "Time", "frame_id": "string"},
    "Point": {"x": "float64", "y": "float64", "z": "float64"},
    "Quaternion": {"x": "float64", "y": "float64", "z": "float64", "w": "float64"},
    "Pose": {"position": "Point", "orientation": "Quaternion"},
    "PoseStamped": {"header": "Header", "pose": "Pose"},
    "RegionOfInterest": {"x_offset": "uint32", "y_offset": "uint32", "height": "uint32", "width": "uint32",
                         "do_rectify": "bool"},
    "Image": {"header": "Header", "height": "uint32", "width": "uint32", "encoding": "string", "is_bigendian": "uint8",
              "step": "uint32", "data": "uint8[]"},
    "CameraInfo": {"header": "Header", "height": "uint32", "width": "uint32", "distortion_model": "string", "d": "float64[]",
                   "k": "float64[9]", "r": "float64[9]", "p": "float64[12]", "binning_x": "uint32", "binning_y": "uint32",
                   "roi": "RegionOfInterest"},
}


class Ros2Message:
    """A message of ROS 2, whose members take what rosidl_generator_py's setters take."""

    def __init__(self, **values):
        assert set(values) <= set(self.members), f"Invalid arguments passed to constructor: {sorted(values)}"
        for member, kind in self.members.items():
            scalars = {"string": "", "float64": 0.0, "bool": False}
            size = re.search(r"\[(\d*)\]", kind)
            value = ([0.0] * int(size[1] or 0) if size else ROS2_CLASSES[kind]() if kind in ROS2 else scalars.get(kind, 0))
            if (type(self).__name__, member) == ("Quaternion", "w"):
                value = 1.0  # the only default that the definitions have
            setattr(self, member, values.get(member, value))

    def __setattr__(self, member, value):
        kind = self.members[member]
        what = f"The {member!r} field of {type(self).__name__} is {kind}, not {value!r:.60}"
        if kind in ROS2:
            assert isinstance(value, ROS2_CLASSES[kind]), what
        elif kind == "uint8[]":  # others are taken after a look at each element
            assert isinstance(value, array.array) and value.typecode == "B" or len(value) == 0, what
        elif kind.startswith("float64["):
            assert isinstance(value, (list, tuple)) and all(isinstance(v, float) for v in value), what
            assert kind in ("float64[]", f"float64[{len(value)}]"), what
        elif "int" in kind:
            bits = int(kind.split("int")[1])
            assert isinstance(value, int) and (0 <= value < 2 ** bits if kind[0] == "u" else abs(value) < 2 ** (bits - 1)), what
        else:
            assert isinstance(value, {"string": str, "float64": float, "bool": bool}[kind]), what
        super().__setattr__(member, value)


ROS2_CLASSES = {name: type(name, (Ros2Message,), {"members": members}) for name, members in ROS2.items()}


class Rclpy:
    """Stand-ins for rclpy and its messages: a node with the parameters of a command line, which is spun over poses until
    somebody ends it."""

    def __init__(self, parameters, poses):
        self.published, self.errors, self.calls = [], [], []
        stand_in = self

        class Node:
            def __init__(self, name):
                self.callbacks = {}
                stand_in.calls.append(f"node {name}")

            def declare_parameter(self, name, default):
                value = parameters.get(name, default)
                assert type(value) is type(default), f"parameter {name} is {value!r}"  # InvalidParameterTypeException
                return types.SimpleNamespace(value=value)

            def create_publisher(self, kind, topic, depth):
                def publish(message):
                    assert isinstance(message, kind)
                    stand_in.published.append((topic, message))

                stand_in.calls.append(f"publisher {topic} {depth}")
                return types.SimpleNamespace(publish=publish)

            def create_subscription(self, kind, topic, callback, depth):
                assert kind is ROS2_CLASSES["PoseStamped"]
                stand_in.calls.append(f"subscription {topic} {depth}")
                self.callbacks[topic] = callback
                return object()

            def get_logger(self):
                return types.SimpleNamespace(error=stand_in.errors.append)

            def destroy_node(self):
                stand_in.calls.append("destroy_node")

        def spin(node):
            for pose in poses:
                node.callbacks["pose"](pose)
            raise KeyboardInterrupt

        def module(name, **members):
            made = types.ModuleType(name)
            made.__dict__.update(members)
            return made

        self.modules = {
            "rclpy": module("rclpy", init=lambda: self.calls.append("init"), spin=spin,
                            try_shutdown=lambda: self.calls.append("try_shutdown")),
            "rclpy.node": module("rclpy.node", Node=Node),
            "rclpy.executors": module("rclpy.executors", ExternalShutdownException=InterruptedError),
            **{package: types.ModuleType(package) for package in ("sensor_msgs", "geometry_msgs")},
            "sensor_msgs.msg": module("sensor_msgs.msg", Image=ROS2_CLASSES["Image"], CameraInfo=ROS2_CLASSES["CameraInfo"]),
            "geometry_msgs.msg": module("geometry_msgs.msg", PoseStamped=ROS2_CLASSES["PoseStamped"]),
        }

    def run(self):
        """The node's main()."""
        with in_place(self.modules):
            loaded("ros", "selenograph_ros2_node.py").main()


class Ros2(Adapter):
    def pose(self, sec, frame_id="moon_me", scale=1.0):
        w, x, y, z = self.quaternion  # the message has moon_from_camera
        made = {name: ROS2_CLASSES[name] for name in ROS2}
        position = made["Point"](**dict(zip("xyz", (scale * self.position_m).tolist())))
        return made["PoseStamped"](
            header=made["Header"](stamp=made["Time"](sec=sec, nanosec=5), frame_id=frame_id),
            pose=made["Pose"](position=position, orientation=made["Quaternion"](w=w, x=-x, y=-y, z=-z)))

    def parameters(self, **more):
        harness.write("ros2-request.json", dict(self.request, sun=SUN))
        return {"url": self.url(), "request": harness.path("ros2-request.json"), **more}

    def test_images_of_poses(self):
        ros = Rclpy(self.parameters(queue_size=7),
                    [self.pose(100), self.pose(101, frame_id="map"), self.pose(102, scale=0.98), self.pose(103)])
        ros.run()
        self.assertEqual(ros.calls, ["init", "node selenograph", "publisher image_raw 7", "publisher camera_info 7",
                                     "subscription pose 7", "destroy_node", "try_shutdown"])
        self.assertEqual([(topic, message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id)
                          for topic, message in ros.published],
                         [(topic, sec, 5, "camera_optical") for sec in (100, 103) for topic in ("camera_info", "image_raw")])
        info, image = ros.published[0][1], ros.published[1][1]
        self.assertEqual((image.encoding, image.height, image.width, image.step), ("mono8", 48, 64, 64))
        values = numpy.frombuffer(image.data, numpy.uint8).reshape(48, 64)
        self.assertLess(numpy.mean(values != self.right["image"]), 0.01)
        self.assertEqual((info.height, info.width, info.distortion_model), (48, 64, "plumb_bob"))
        self.assertEqual(info.d, [-0.05, 0.0, 1e-3, 0.0, 0.0])
        self.assertAlmostEqual(info.k[0], 32 / numpy.tan(numpy.radians(20)), places=9)
        self.assertEqual(info.p[2:7:4], [31.5, 23.5])
        self.assertEqual(len(ros.errors), 2, ros.errors)
        self.assertIn("pose in frame 'map'", ros.errors[0])
        self.assertIn("no image of the pose at 102.000000005: ", ros.errors[1])

    def test_a_depth_image(self):
        ros = Rclpy(self.parameters(product="range", camera_frame="lidar"), [self.pose(1)])
        ros.run()
        self.assertEqual(ros.errors, [])
        _, image = ros.published[1]
        self.assertEqual((image.encoding, image.step, image.header.frame_id), ("32FC1", 256, "lidar"))
        values = numpy.frombuffer(image.data, "<f4").reshape(48, 64)
        numpy.testing.assert_allclose(values, self.right["range"], rtol=1e-7, atol=0)

    def test_answers_that_are_no_frame_are_logged(self):
        for content in (b"cut off", npz(a=numpy.zeros(1))):
            with FakeService((200, {"Content-Type": "application/x-npz"}, content)) as fake:
                ros = Rclpy(self.parameters(url=fake.url), [self.pose(1)])
                ros.run()
            self.assertEqual((len(ros.errors), ros.published), (1, []))
            self.assertIn("no image of the pose at 1.000000005: ", ros.errors[0])

    def test_parameters_that_have_to_be_set(self):
        for name in ("url", "request"):
            parameters = self.parameters()
            del parameters[name]
            with self.assertRaisesRegex(ValueError, f"the parameter {name} is not set"):
                Rclpy(parameters, []).run()


if __name__ == "__main__":
    harness.main()
