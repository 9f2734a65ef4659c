#!/usr/bin/env python3
"""Poses and trajectories of the Python client (api/clients/python): closed forms, and what the service makes of them.

Needs NumPy.
"""

import math
import os
import sys
import unittest
from datetime import datetime, timezone
from unittest import mock

import numpy as np

import harness
from harness import REPOSITORY, frame_request
from one_service import start, tearDownModule, url  # noqa: F401

sys.path.insert(0, os.path.join(REPOSITORY, "api", "clients", "python"))
from selenograph import Camera, Client, Pose, Sun, Trajectory  # noqa: E402
from selenograph.moon import position_of  # noqa: E402
from selenograph.rotations import matrix_of, quaternion_of  # noqa: E402

MOON_GM = 4.9028e12  # m^3 s^-2


def setUpModule():
    start()


def request_of(**parts):
    sun = Sun.local(lat_deg=-6.5, lon_deg=40, azimuth_deg=90, elevation_deg=15)
    return frame_request(("range", "image"), **{"sun": sun, **parts})


def turned_by(axis, angle_deg):
    """The matrix that turns a vector about an axis, by Rodrigues' formula: none of the client's code."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = math.radians(angle_deg)
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def looking_down(lat_deg, lon_deg, up_azimuth_deg=0.0):
    """camera_from_moon of a nadir camera as a matrix: rows right, down, boresight."""
    lat, lon, azimuth = map(math.radians, (lat_deg, lon_deg, up_azimuth_deg))
    zenith = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    east = np.array([-math.sin(lon), math.cos(lon), 0])
    up = math.cos(azimuth) * np.cross(zenith, east) + math.sin(azimuth) * east
    return np.array([np.cross(-zenith, up), -up, -zenith])


class Attitudes(unittest.TestCase):
    PLACE = {"lat_deg": -6.5, "lon_deg": 40.0, "height_m": 20000.0}

    def setUp(self):
        self.client = Client(url())
        self.addCleanup(self.client.close)

    def frame_of(self, pose):
        return self.client.frame(request_of(pose=pose))

    def resolved(self, **parts):
        """What the service makes of a request."""
        return self.client.frame(request_of(pose=Pose.nadir(**self.PLACE), **parts)).meta["request"]

    def matrix_of(self, pose):
        """What the service makes of a pose: camera_from_moon."""
        q = self.frame_of(pose).meta["request"]["pose"]["camera_from_moon"]
        return matrix_of(np.array([q[c] for c in "wxyz"]))

    def ways(self, matrix):
        """The same attitude in every form, made without the client. matrix: camera_from_moon."""
        angle = math.acos((np.trace(matrix) - 1) / 2)
        axis = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
        axis /= np.linalg.norm(axis)
        w, (x, y, z) = math.cos(angle / 2), axis * math.sin(angle / 2)
        sigma = axis * math.tan(angle / 4)
        # OpenGL's y is up and its z backward.
        opengl = np.diag([1, -1, -1]) @ matrix
        there, back = {"direction": "camera_from_moon", **self.PLACE}, {"direction": "moon_from_camera", **self.PLACE}
        return {
            "wxyz": Pose.from_quaternion([w, x, y, z], order="wxyz", **there),
            "xyzw": Pose.from_quaternion([x, y, z, w], order="xyzw", **there),
            "minus": Pose.from_quaternion([-x, -y, -z, -w], order="xyzw", **there),
            "inverse": Pose.from_quaternion([w, -x, -y, -z], order="wxyz", **back),
            "matrix": Pose.from_matrix(matrix, **there),
            "transposed": Pose.from_matrix(matrix.T, **back),
            "opengl": Pose.from_matrix(opengl, axes="opengl", **there),
            # The frame turns by -angle where its vectors' components turn by angle.
            "mrp": Pose.from_mrp(-sigma, **there),
            "mrp's inverse": Pose.from_mrp(sigma, **back),
            "mrp's shadow": Pose.from_mrp(sigma / (sigma @ sigma), **there),
        }

    def test_every_form_of_an_attitude_gives_the_same_frame(self):
        for matrix in (looking_down(-6.5, 40, 30), turned_by([1, 2, 3], 10) @ looking_down(-6.5, 40, 200),
                       turned_by([0, 1, 0], 25) @ looking_down(-6.4, 40.1)):
            ways = self.ways(matrix)
            right = self.frame_of(ways["matrix"])
            self.assertTrue(np.isfinite(right["range"]).any())
            for name, pose in ways.items():
                with self.subTest(name):
                    frame = self.frame_of(pose)
                    np.testing.assert_array_equal(frame["image"], right["image"])
                    np.testing.assert_allclose(frame["range"], right["range"], rtol=1e-12)
                    np.testing.assert_allclose(self.matrix_of(pose), matrix, atol=1e-14)

    def test_where_digits_allow_it_the_bytes_are_the_same(self):
        # x right = north, y down = -(zenith), z = east of 0 N 0 E: rows of 0 and 1, and a quaternion of halves.
        matrix = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
        place = {"position_m": [1767400.0, 0, 0], "direction": "camera_from_moon"}
        camera = Camera.pinhole(width=32, height=24, fov_deg=60)
        answers = set()
        for pose in (Pose.from_matrix(matrix, **place),
                     Pose.from_quaternion([0.5, -0.5, 0.5, -0.5], order="wxyz", **place),
                     Pose.from_quaternion([-0.5, 0.5, -0.5, 0.5], order="xyzw", **place),
                     Pose.from_matrix(matrix.T, **{**place, "direction": "moon_from_camera"})):
            answers.add(self.client.encoded({"camera": camera, "pose": pose, "products": ["range", "position"]},
                                            "application/x-npz").content)
        self.assertEqual(len(answers), 1)

    def test_nadir_and_look_at(self):
        for azimuth in (0, 30, 270):
            pose = Pose.nadir(**self.PLACE, up_azimuth_deg=azimuth)
            np.testing.assert_allclose(self.matrix_of(pose), looking_down(-6.5, 40, azimuth), atol=1e-12)
        position_m = position_of({"geodetic": self.PLACE})
        cartesian = Pose.nadir(position_m=position_m)
        np.testing.assert_allclose(self.matrix_of(cartesian), looking_down(-6.5, 40), atol=1e-12)
        # "zenith": the local vertical has no component to the right, and points up.
        target = {"target_lat_deg": -5.5, "target_lon_deg": 41.0}
        for place in (self.PLACE, {"position_m": position_m}):
            right, down, boresight = self.matrix_of(Pose.look_at(**place, **target, up="zenith"))
            zenith = position_m / np.linalg.norm(position_m)
            self.assertAlmostEqual(right @ zenith, 0, 12)
            self.assertLess(down @ zenith, 0)
            target_m = position_of({"geodetic": {"lat_deg": -5.5, "lon_deg": 41.0, "height_m": 0}})
            wanted = target_m - position_m
            np.testing.assert_allclose(boresight, wanted / np.linalg.norm(wanted), atol=1e-12)
        right, down, _ = self.matrix_of(Pose.look_at(**self.PLACE, **target, up=[1, 0, 0]))
        self.assertAlmostEqual(right[0], 0, 12)
        self.assertLess(down[0], 0)

    def test_quaternions_of_matrices_keep_their_digits(self):
        random = np.random.default_rng(1)
        for angle in [0, 1e-9, 90, 180 - 1e-6, 180, *random.uniform(0, 180, 50)]:
            matrix = turned_by(random.normal(size=3), angle)
            q = quaternion_of(matrix)
            self.assertLess(abs(np.linalg.norm(q) - 1), 1e-15)
            np.testing.assert_allclose(matrix_of(q), matrix, atol=3e-15)

    def test_errors_say_what_to_write(self):
        place, q = self.PLACE, [1, 0, 0, 0]
        for words, make in {
                "missing 2 required keyword-only arguments: 'order' and 'direction'":
                    lambda: Pose.from_quaternion(q, **place),
                "order='wxyz' or order='xyzw'":
                    lambda: Pose.from_quaternion(q, order="scalar first", direction="camera_from_moon", **place),
                "direction='camera_from_moon' or direction='moon_from_camera'":
                    lambda: Pose.from_quaternion(q, order="wxyz", direction="A2B", **place),
                "unit quaternion is needed. Modified Rodrigues parameters are for Pose.from_mrp":
                    lambda: Pose.from_quaternion([0.1, 0, 0, 0], order="wxyz", direction="camera_from_moon", **place),
                "Write position_m=.*or lat_deg=, lon_deg= and height_m=": lambda: Pose.nadir(lat_deg=0, lon_deg=0),
                "either position_m or lat_deg": lambda: Pose.nadir(position_m=[2e6, 0, 0], height_m=3),
                "kilometres": lambda: Pose.nadir(position_m=[1837.4, 0, 0]),
                "position_m is .*; 3 numbers": lambda: Pose.nadir(position_m="here"),
                "in MOON_PA_DE421 write position_m": lambda: Pose.nadir(**place, frame="MOON_PA_DE421"),
                "2e-06 from orthonormal|no rotation": lambda: Pose.from_matrix(
                    np.eye(3) * 1.00001, direction="camera_from_moon", **place),
                "axes=\"opengl\"": lambda: Pose.from_matrix(np.diag([1, 1, -1]), direction="camera_from_moon", **place),
                r"\[:3, :3\]": lambda: Pose.from_matrix(np.eye(4), direction="camera_from_moon", **place),
                "up='north' or up='zenith'": lambda: Pose.look_at(target_lat_deg=0, target_lon_deg=0, up="up", **place),
                "either fov_deg .horizontal": lambda: Camera.pinhole(width=3, height=3),
                "focal_length_mm and pixel_pitch_um": lambda: Camera.pinhole(width=3, height=3, focal_length_mm=35),
                "fx .and fy, cx, cy., in pixels": lambda: Camera.fisheye(width=3, height=3, fx=9, fov_deg=50),
                "no skew": lambda: Camera.from_opencv([[9, 1, 3], [0, 9, 3], [0, 0, 1]], width=8, height=8),
                "15 coefficients": lambda: Camera.from_opencv(np.diag([9.0, 9, 1]), [1] * 15, width=8, height=8),
                "5 coefficients; at most k1, k2, k3, k4": lambda: Camera.from_opencv(
                    np.diag([9.0, 9, 1]), [1] * 5, width=8, height=8, fisheye=True),
                "an H across it": lambda: Camera.from_cahvor([0, 0, 1], [0, 0, 4], [0, 9, 4], width=8, height=8),
                "tzinfo=timezone.utc": lambda: Sun.utc(datetime(2026, 11, 20))}.items():
            with self.assertRaisesRegex((ValueError, TypeError), words):
                make()

    def test_cameras_and_suns_are_the_services(self):
        k = [[100.0, 0, 31], [0, 110, 22.5], [0, 0, 1]]
        everything = [0.2, 0.01, 1e-3, 2e-3, 1e-4, 0.3, 0.02, 1e-4, 1e-3, 2e-4, -1e-3, 3e-4, 0.03, -0.02]
        self.assertEqual(Camera.from_opencv(k, everything[:5] + [0] * 9, width=64, height=48)["distortion"],
                         {"model": "brown_conrady", **dict(zip(("k1", "k2", "p1", "p2", "k3"), everything))})
        turn = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # the camera looks along x of a frame with z up
        wide, camera_from_frame = Camera.from_cahvor(
            turn @ [0, 0, 1], turn @ [90, 0, 31], turn @ [0.5, 91, 22], turn @ [0.01, 0, np.sqrt(1 - 1e-4)], [0, 0.1, 0],
            width=64, height=48, linearity=0)
        self.assertLess(np.abs(camera_from_frame - turn.T).max(), 1e-15)
        self.assertLess(np.abs(np.subtract(wide["cahvor"]["V"], [0.5, 91, 22])).max(), 1e-12)
        cameras = [Camera.from_opencv(k, [-0.1, 0.01, 1e-3, 2e-3, 1e-4], width=64, height=48), wide,
                   Camera.from_opencv(k, everything, width=64, height=48),
                   Camera.from_opencv(k, everything[:8], width=64, height=48),
                   Camera.from_opencv(k, [[0.01, 0.001, 0, 0]], width=64, height=48, fisheye=True),
                   Camera.from_opencv(k, None, width=64, height=48),
                   Camera.fisheye(width=64, height=48, fov_deg=150), Camera.pinhole(width=64, height=48, fx=90),
                   Camera.pinhole(width=64, height=48, focal_length_mm=8, pixel_pitch_um=5.5)]
        for camera in cameras:
            echoed = self.resolved(camera=camera)["camera"]
            for name, value in camera.items():
                if name in ("distortion", "cahvor"):
                    self.assertEqual({k: echoed[name][k] for k in value}, value)
                elif name == "focal_length_mm":
                    self.assertAlmostEqual(echoed["fx"], 8000 / 5.5, 9)
                elif name not in ("fov_deg", "pixel_pitch_um"):
                    self.assertEqual(echoed[name], value, (camera, echoed))
        when = datetime(2026, 11, 20, 12, 30, 15, 250000, tzinfo=timezone.utc)
        for sun in (Sun.direction([0, 1, 0.2], distance_au=0.99), Sun.subsolar(lat_deg=1.5, lon_deg=60),
                    Sun.utc("2026-11-20T12:30:15.25Z"), Sun.utc(when), Sun.utc(when, angular_radius_deg="sun")):
            self.assertIn("direction", self.resolved(sun=sun)["sun"])
        self.assertEqual(Sun.utc(when), {"utc": "2026-11-20T12:30:15.250000Z"})


OEM = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2026-11-01T00:00:00
ORIGINATOR = TEST

META_START
OBJECT_NAME = LANDER
OBJECT_ID = 2026-001A
CENTER_NAME = MOON
REF_FRAME = {frame}
TIME_SYSTEM = {system}
START_TIME = {start}
STOP_TIME = {stop}
{more}
META_STOP
COMMENT made up
{lines}
COVARIANCE_START
EPOCH = 2026-11-20T00:00:00
1.0
COVARIANCE_STOP
"""
AEM = """CCSDS_AEM_VERS = 1.0
CREATION_DATE = 2026-11-01T00:00:00
ORIGINATOR = TEST

META_START
OBJECT_NAME = LANDER
OBJECT_ID = 2026-001A
REF_FRAME_A = {a}
REF_FRAME_B = {b}
{more}
TIME_SYSTEM = UTC
ATTITUDE_TYPE = {kind}
META_STOP
DATA_START
{lines}
DATA_STOP
"""


class Orbit:
    """A circular orbit 100 km up, inclined; and an attitude that turns at a constant rate about a fixed axis."""

    RADIUS_M = 1837400.0
    RATE = math.sqrt(MOON_GM / RADIUS_M ** 3)
    AXIS, TURN_DEG_S = np.array([0.6, 0.0, 0.8]), 0.7

    @classmethod
    def state(cls, t):
        angle = cls.RATE * t + 0.3
        tilt = turned_by([1, 0, 0], 80)
        return (tilt @ (cls.RADIUS_M * np.array([math.cos(angle), math.sin(angle), 0])),
                tilt @ (cls.RADIUS_M * cls.RATE * np.array([-math.sin(angle), math.cos(angle), 0])))

    @classmethod
    def moon_from_body(cls, t):
        """Hamilton w, x, y, z."""
        half = math.radians(cls.TURN_DEG_S * t + 20) / 2
        return np.array([math.cos(half), *(math.sin(half) * cls.AXIS)])

    @staticmethod
    def epoch(t, day_of_year=False):
        seconds = 43200 + t  # of 2026-11-20
        date = "2026-324" if day_of_year else "2026-11-20"
        return f"{date}T{int(seconds // 3600):02d}:{int(seconds % 3600 // 60):02d}:{seconds % 60:012.9f}"

    @classmethod
    def oem(cls, times, more="", frame="MOON_ME", system="UTC", **words):
        lines = []
        for t in times:
            position, velocity = cls.state(t)
            lines.append(f"{cls.epoch(t, **words)} " + " ".join(f"{x / 1e3:.12f}" for x in (*position, *velocity)))
        return OEM.format(frame=frame, system=system, start=cls.epoch(times[0]), stop=cls.epoch(times[-1]), more=more,
                          lines="\n".join(lines))

    @classmethod
    def aem(cls, times, a="MOON_ME", b="SC_BODY_1", more="ATTITUDE_DIR = A2B\nQUATERNION_TYPE = LAST",
            kind="QUATERNION", columns=lambda q: [*q[1:], q[0]]):
        lines = [f"{cls.epoch(t)} " + " ".join(f"{x:.17f}" for x in columns(cls.moon_from_body(t))) for t in times]
        return AEM.format(a=a, b=b, more=more, kind=kind, lines="\n".join(lines))


def camera_from_moon(pose):
    direction, = set(pose) & {"camera_from_moon", "moon_from_camera"}
    matrix = matrix_of(np.array([pose[direction][c] for c in "wxyz"]))
    return matrix if direction == "camera_from_moon" else matrix.T


class Trajectories(unittest.TestCase):
    def worst_m(self, trajectory, times):
        return max(np.linalg.norm(trajectory.position_m(t) - Orbit.state(t)[0]) for t in times)

    def test_a_circular_orbit_is_met_within_a_millimetre(self):
        inside = np.linspace(0, 600, 997)
        for step_s, more in ((10, ""), (10, "INTERPOLATION = HERMITE\nINTERPOLATION_DEGREE = 3"),
                             (60, "INTERPOLATION = HERMITE\nINTERPOLATION_DEGREE = 7"),
                             (60, "INTERPOLATION = LAGRANGE\nINTERPOLATION_DEGREE = 8"),
                             (30, "INTERPOLATION = Lagrange\nINTERPOLATION_DEGREE = 7")):
            oem = harness.write("orbit.oem", Orbit.oem(np.arange(0, 601, step_s), more))
            trajectory = Trajectory.from_ccsds(oem, up_azimuth_deg=0)
            self.assertLess(self.worst_m(trajectory, inside), 1e-3, more)
            self.assertEqual(len(trajectory), 600 // step_s + 1)
            self.assertRaisesRegex(ValueError, "no position at 600.1 s; .* from 0 to 600 s", trajectory.at, 600.1)
        # Linear, as the file says: the sagitta of the chord, r (1 - cos(angle / 2)).
        oem = harness.write("orbit.oem", Orbit.oem([0, 100], "INTERPOLATION = LINEAR"))
        sagitta_m = Orbit.RADIUS_M * (1 - math.cos(50 * Orbit.RATE))
        self.assertAlmostEqual(self.worst_m(Trajectory.from_ccsds(oem, up_azimuth_deg=0), [50]), sagitta_m, 6)

    def test_positions_at_the_nodes_and_of_polynomials_are_exact(self):
        times = np.array([0, 1, 3, 4.5, 7, 8])
        cubic = np.stack([times ** 3 - 2 * times, 5 - times ** 2, 3e6 + times], -1)
        slopes = np.stack([3 * times ** 2 - 2, -2 * times, np.ones(6)], -1)
        inside = np.linspace(0, 8, 81)
        wanted = np.stack([inside ** 3 - 2 * inside, 5 - inside ** 2, 3e6 + inside], -1)
        for options in ({"velocities_m_s": slopes}, {"method": "lagrange", "degree": 3}):
            trajectory = Trajectory(times, cubic, up_azimuth_deg=0, **options)
            np.testing.assert_allclose([trajectory.position_m(t) for t in inside], wanted, rtol=1e-15, atol=1e-9)
            np.testing.assert_array_equal([trajectory.position_m(t) for t in times], cubic)
        # Without velocities those of parabolas: a parabola is exact.
        trajectory = Trajectory(times, cubic[:, [1, 1, 2]], up_azimuth_deg=0)
        got = [trajectory.position_m(t) for t in inside]
        np.testing.assert_allclose(got, wanted[:, [1, 1, 2]], rtol=1e-15, atol=1e-9)

    def test_interpolation_uses_the_nearest_nodes(self):
        times = np.arange(10.0)
        random = np.random.default_rng(3)
        positions, velocities = random.normal(size=(2, 10, 3))
        for options, reach in (({"method": "lagrange", "degree": 3}, 2), ({"degree": 7}, 2), ({"degree": 3}, 1),
                               ({"method": "linear"}, 1)):
            for t in (0.5, 4.5, 8.5):
                first = min(max(int(t) + 1 - reach, 0), 10 - 2 * reach)
                for k in range(10):
                    moved = positions + (np.arange(10) == k)[:, None]
                    here, there = (Trajectory(times, p, velocities_m_s=velocities, up_azimuth_deg=0, **options)
                                   for p in (positions, moved))
                    same = np.array_equal(here.position_m(t), there.position_m(t))
                    self.assertEqual(same, not first <= k < first + 2 * reach, (options, t, k))

    def test_segments_and_the_times_they_may_be_used_at(self):
        first = Orbit.oem(np.arange(0, 121, 10), f"USEABLE_STOP_TIME = {Orbit.epoch(100)}")
        second = Orbit.oem(np.arange(80, 301, 10), f"USEABLE_START_TIME = {Orbit.epoch(100)}", day_of_year=True)
        oem = harness.write("two.oem", first + second[second.index("META_START"):])
        trajectory = Trajectory.from_ccsds(oem, up_azimuth_deg=0)
        self.assertLess(self.worst_m(trajectory, np.linspace(0, 300, 500)), 1e-3)
        self.assertEqual(trajectory.times_s.tolist(), list(range(0, 301, 10)))

    def test_slerp_is_exact(self):
        times = np.arange(0, 301, 50)  # 35 degrees a step
        oem = harness.write("orbit.oem", Orbit.oem(np.arange(0, 301, 10)))
        body = {True: "SC_BODY_1", False: "MOON_ME"}
        files = {
            "A2B": Orbit.aem(times),
            "version 2": Orbit.aem(times, more=""),
            "first": Orbit.aem(times, more="ATTITUDE_DIR = A2B\nQUATERNION_TYPE = FIRST", columns=list),
            "B2A": Orbit.aem(times, body[True], body[False], "ATTITUDE_DIR = B2A\nQUATERNION_TYPE = LAST"),
            "body first": Orbit.aem(times, body[True], body[False], columns=lambda q: [*-q[1:], q[0]]),
            "with rates": Orbit.aem(times, kind="QUATERNION/RATE", columns=lambda q: [*q[1:], q[0], 1, 2, 3]),
            "signs": Orbit.aem(times, columns=lambda q: np.array([*q[1:], q[0]]) * np.sign(math.sin(1e6 * q[1])))}
        for name, text in files.items():
            with self.subTest(name):
                trajectory = Trajectory.from_ccsds(oem, harness.write("attitude.aem", text))
                for t in np.linspace(0, 300, 77):
                    right = turned_by(Orbit.AXIS, Orbit.TURN_DEG_S * t + 20).T
                    np.testing.assert_allclose(camera_from_moon(trajectory.at(t)), right, atol=3e-15)
        mounting = turned_by([1, 1, 0], 90)
        trajectory = Trajectory.from_ccsds(oem, harness.write("attitude.aem", files["A2B"]), camera_from_body=mounting)
        right = mounting @ turned_by(Orbit.AXIS, Orbit.TURN_DEG_S * 123 + 20).T
        np.testing.assert_allclose(camera_from_moon(trajectory.at(123)), right, atol=3e-15)

    def test_poses_only_where_there_is_an_attitude(self):
        oem = harness.write("orbit.oem", Orbit.oem(np.arange(0, 301, 10)))
        aem = harness.write("attitude.aem", Orbit.aem([100, 150, 205]))
        trajectory = Trajectory.from_ccsds(oem, aem)
        self.assertEqual(trajectory.times_s.tolist(), list(range(100, 201, 10)))
        self.assertEqual(len(list(trajectory)), 11)
        self.assertRaisesRegex(ValueError, "no attitude at 99 s", trajectory.at, 99)

    def test_invalid_files(self):
        fine = Orbit.oem([0, 10])
        attitude = Orbit.aem([0, 10])
        for words, oem, aem in (
                ("REF_FRAME is EME2000; the service knows ICRF, MOON_ME", fine.replace("MOON_ME", "EME2000"), None),
                ("CENTER_NAME is EARTH; MOON", fine.replace("= MOON\n", "= EARTH\n"), None),
                ("begins with '<oem", "<oem/>", None),
                ("line 17: 'yesterday' is no epoch", fine.replace(Orbit.epoch(10) + " ", "yesterday "), None),
                ("method is 'spline'", fine.replace("COMMENT", "COMMENT"), "spline"),
                ("times must rise", Orbit.oem([0, 10, 10]), None),
                ("with REF_FRAME ICRF UTC is needed", Orbit.oem([0, 10], frame="ICRF", system="TDB"), None),
                ("with REF_FRAME EME2000 UTC is needed", Orbit.oem([0, 10], frame="EME2000", system="TDB"), "J2000"),
                ("ATTITUDE_TYPE is EULER_ANGLE; QUATERNION", fine,
                 attitude.replace("= QUATERNION\n", "= EULER_ANGLE\n")),
                ("one of them must be the OEM's REF_FRAME", fine, attitude.replace("MOON_ME", "MOON_PA_DE421")),
                ("TIME_SYSTEM is TDB and UTC", Orbit.oem([0, 10], system="TDB"), attitude),
                ("no time in common", fine, Orbit.aem([20, 30])),
                ("attitude 0 has length", fine, Orbit.aem([0, 10], columns=lambda q: [0.1, 0, 0, 0]))):
            if aem == "spline":
                oem, aem = oem.replace("META_STOP", "INTERPOLATION = SPLINE\nMETA_STOP"), None
            oem = harness.write("bad.oem", oem)
            how = {"up_azimuth_deg": 0} if aem is None else {"aem": harness.write("bad.aem", aem)}
            if aem == "J2000":
                how = {"up_azimuth_deg": 0, "frame": aem}
            with self.subTest(words), self.assertRaisesRegex(ValueError, "(?s)" + words):
                Trajectory.from_ccsds(oem, **how)
        self.assertRaisesRegex(ValueError, "either aem= .* or up_azimuth_deg=", Trajectory.from_ccsds, oem)

    def test_epochs(self):
        oem = harness.write("orbit.oem", Orbit.oem(np.arange(0, 61, 10)))
        trajectory = Trajectory.from_ccsds(oem, up_azimuth_deg=0)
        self.assertEqual(trajectory.utc(1.5), "2026-11-20T12:00:01.500000Z")
        request, = trajectory.requests({"products": ["radiance"]}, [20])
        self.assertEqual(request["sun"], {"utc": "2026-11-20T12:00:20Z"})
        kept, = trajectory.requests({"sun": {"direction": [1, 0, 0]}}, [20])
        self.assertEqual(kept["sun"], {"direction": [1, 0, 0]})
        other = Trajectory.from_ccsds(harness.write("tdb.oem", Orbit.oem([0, 10], system="TDB")), up_azimuth_deg=0)
        self.assertRaisesRegex(ValueError, 'no "sun"', other.requests, {})
        self.assertRaisesRegex(ValueError, 'no "sun"', other.requests, {"products": ["irradiance"]})
        self.assertNotIn("sun", other.requests({"products": ["range"]})[0])
        inertial = Trajectory.from_ccsds(harness.write("icrf.oem", Orbit.oem([0, 10], frame="ICRF")), up_azimuth_deg=0)
        pose = inertial.at(5)
        self.assertEqual((pose["frame"], pose["utc"]), ("ICRF", "2026-11-20T12:00:05Z"))
        inertial = Trajectory.from_ccsds(harness.write("eme2000.oem", Orbit.oem([0, 10], frame="EME2000")),
                                         up_azimuth_deg=0, frame="J2000")
        pose = inertial.at(5)
        self.assertEqual((pose["frame"], pose["utc"]), ("J2000", "2026-11-20T12:00:05Z"))

    def test_each_frame_has_noise_of_its_own(self):
        trajectory = Trajectory.from_ccsds(harness.write("noise.oem", Orbit.oem([0, 10, 20])), up_azimuth_deg=0)

        def sensors(*times_s, **request):
            return [made.get("sensor") for made in trajectory.requests(request, list(times_s) or None)]
        detector = {"detector": {"gain_e_dn": 2.0}}
        self.assertEqual(sensors(sensor=detector), [{"frame": n, **detector} for n in range(3)])
        self.assertEqual(sensors(5, 7, camera_preset="x"), [{"frame": 0}, {"frame": 1}])
        self.assertEqual(sensors(5, 7, camera_preset="x", sensor={"seed": 4, "frame": 9}), [{"seed": 4, "frame": 9}] * 2)
        self.assertEqual(sensors(), [None] * 3)
        rig = {"left": {"camera_preset": "x"}, "right": {"sensor": detector}, "up": {"pose": 1}}
        last = trajectory.requests({"cameras": rig})[2]
        self.assertEqual(last["cameras"], {"left": {"camera_preset": "x", "sensor": {"frame": 2}},
                                           "right": {"sensor": {"frame": 2, **detector}}, "up": {"pose": 1}})
        self.assertNotIn("sensor", last)

    def test_service_rotates_inertial_orbits(self):
        with Client(url()) as client:
            oem = harness.write("icrf.oem", Orbit.oem(np.arange(0, 61, 10), frame="ICRF"))
            aem = harness.write("icrf.aem", Orbit.aem([0, 60], a="ICRF"))
            request, = Trajectory.from_ccsds(oem, aem).requests({"camera": Camera.pinhole(width=8, height=8, fov_deg=9),
                                                                 "products": ["range"]}, [30])
            pose = client.frame(request).meta["request"]["pose"]
        # The same turn for position and attitude: where the camera is in its own axes doesn't change.
        right = camera_from_moon(request["pose"]) @ request["pose"]["position_m"]
        np.testing.assert_allclose(camera_from_moon(pose) @ pose["position_m"], right, atol=1e-6)
        self.assertGreater(np.linalg.norm(np.subtract(pose["position_m"], request["pose"]["position_m"])), 1e5)

    def test_inertial_poses_have_epochs_of_their_own(self):
        """Not that of a Sun which stands still: the Moon would have turned by another angle."""
        start = datetime(2026, 11, 20, tzinfo=timezone.utc)
        common = {"camera": Camera.pinhole(width=8, height=8, fov_deg=9), "products": ["range"],
                  "sun": Sun.utc("2026-11-25T00:00:00Z")}
        with Client(url()) as client:
            places = []
            for frame in ("ICRF", "J2000"):
                trajectory = Trajectory([0, 7200], [[1.9e6, 0, 0], [1.9e6, 4e5, 0]], up_azimuth_deg=0, start=start,
                                        frame=frame)
                request, = trajectory.requests(common, [3600])
                places.append(client.frame(request).meta["request"]["pose"]["position_m"])
        np.testing.assert_array_equal(*places)

    def csv(self, *lines):
        return harness.write("trajectory.csv", "\n".join(lines) + "\n")

    def test_csv(self):
        rows = ["\ufefftime_s, x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,moon_from_camera_w,moon_from_camera_x,"
                "moon_from_camera_y,moon_from_camera_z", "# a comment"]
        for t in range(0, 101, 10):
            position, velocity = Orbit.state(t)
            rows.append(",".join(repr(float(x)) for x in (t, *position, *velocity, *Orbit.moon_from_body(t))))
        trajectory = Trajectory.from_csv(self.csv(*rows, ""))
        self.assertLess(self.worst_m(trajectory, np.linspace(0, 100, 99)), 1e-3)
        right = turned_by(Orbit.AXIS, Orbit.TURN_DEG_S * 33 + 20).T
        np.testing.assert_allclose(camera_from_moon(trajectory.at(33)), right, atol=3e-15)

        trajectory = Trajectory.from_csv(self.csv("lat_deg,lon_deg,height_m,utc,up_azimuth_deg",
                                                  "-6.5,40,20000,2026-11-20 00:00:00,350",
                                                  "-6.4,40,20000,2026-11-20T00:00:10.5,10"))
        self.assertEqual(trajectory.times_s.tolist(), [0, 10.5])
        pose = trajectory.at(5.25)
        self.assertAlmostEqual(pose["nadir"]["up_azimuth_deg"], 0, 12)
        self.assertEqual([trajectory.at(t)["nadir"]["up_azimuth_deg"] for t in (0, 10.5)], [-10, 10])
        lat = math.asin(pose["position_m"][2] / np.linalg.norm(pose["position_m"]))
        self.assertAlmostEqual(math.degrees(lat), -6.45, 6)
        self.assertEqual(trajectory.utc(10.5), "2026-11-20T00:00:10.500000Z")

    def test_azimuths_go_the_shorter_way_round(self):
        """Without np.unwrap's period, which is new in NumPy 1.21."""
        azimuths = [10, 350, -350, 180, 0, 725]
        with mock.patch.object(np, "unwrap", None):
            trajectory = Trajectory(range(6), [[2e6, t, 0] for t in range(6)], up_azimuth_deg=azimuths)
        wanted = [10, 0, -10, 0, 10, 95, 180, 90, 0, 2.5, 5]
        self.assertEqual([trajectory.at(t / 2)["nadir"]["up_azimuth_deg"] for t in range(11)], wanted)

    def test_invalid_csv(self):
        place = "lat_deg,lon_deg,height_m"
        for words, lines in {
                "semicolons": ("time_s;x_m;y_m", "1;2;3"),
                "time_s or utc; there are t, lat_deg": (f"t,{place}", "1,2,3,4"),
                "line 3: lon_deg is 'x', no number": (f"time_s,{place},up_azimuth_deg", "0,1,2,3,0", "1,1,x,3,0"),
                "line 3: height_m is 'nan', no number": (f"time_s,{place},up_azimuth_deg", "0,1,2,3,0", "1,1,2,nan,0"),
                "line 2: lat_deg is 140; -90 to 90 is needed": (f"time_s,{place},up_azimuth_deg", "0,140,0,3,0"),
                "line 2: lon_deg is 361; -180 to 360": (f"time_s,{place},up_azimuth_deg", "0,9,361,3,0"),
                "line 2: 2 values for 5 columns": (f"time_s,{place},up_azimuth_deg", "0,1"),
                "there is x_m, y_m but not z_m": ("time_s,x_m,y_m", "1,2,3"),
                "one attitude is needed: camera_from_moon_w": (f"time_s,{place}", "0,1,2,3"),
                "unknown column 'qw'; there are camera_from": (f"time_s,{place},up_azimuth_deg,qw", "0,1,2,3,0,1"),
                "times must rise": (f"time_s,{place},up_azimuth_deg", "0,1,2,3,0", "0,1,2,3,0"),
                "length 2": (f"time_s,{place}," + ",".join(f"camera_from_moon_{c}" for c in "wxyz"), "0,1,2,3,2,0,0,0"),
                "a line of names and at least one of numbers": ("time_s",)}.items():
            with self.subTest(words), self.assertRaisesRegex(ValueError, "trajectory.csv.*" + words):
                Trajectory.from_csv(self.csv(*lines))


if __name__ == "__main__":
    harness.main()
