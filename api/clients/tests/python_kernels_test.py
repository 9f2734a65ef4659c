#!/usr/bin/env python3
"""SPICE kernels in the Python client: against the polynomials that they hold, closed forms, astropy and the service.

Needs NumPy, jplephem and astropy (deploy/install-packages test); skipped without jplephem.
"""

import importlib.util
import json
import math
import os
import re
import subprocess
import sys
import unittest
import warnings
from unittest import mock

import numpy as np

import harness
import kernels as written
from harness import REPOSITORY
from one_service import start, tearDownModule, url  # noqa: F401

sys.path.insert(0, os.path.join(REPOSITORY, "api", "clients", "python"))
from selenograph import Camera, Client, Kernels, Pose, Trajectory  # noqa: E402
from selenograph.epochs import et_of  # noqa: E402
from selenograph.kernels import LIGHT_M_S, turned_axes  # noqa: E402
from selenograph.rotations import matrix_of  # noqa: E402

START = "2026-11-20T00:00:00Z"
ET = 848404869.18  # of START, to a hundredth of a second
AT = et_of(START)
SPAN = (ET - 4000, ET + 4000)
SPACECRAFT = -85
SIDEREAL_RAD_S = 2 * math.pi / (27.321661 * 86400)
ARCSEC = math.radians(1 / 3600)


def setUpModule():
    if not importlib.util.find_spec("jplephem"):
        raise unittest.SkipTest("no jplephem: deploy/install-packages test")
    start(terrain=("--ppd", "64"))


def cubic(*coefficients):
    """A polynomial of the hours since ET, by its vectors in km."""
    return lambda et: sum(np.array(c, float) * ((et - ET) / 3600) ** i for i, c in enumerate(coefficients))


def circle(et, radius_km=1837.4, period_s=7067.0):
    """A polar orbit, and its velocity."""
    n = 2 * math.pi / period_s
    u = n * (et - ET)
    first, second = np.array([0.6, 0.8, 0]), np.array([0, 0, 1.0])
    return (radius_km * (math.cos(u) * first + math.sin(u) * second),
            radius_km * n * (-math.sin(u) * first + math.cos(u) * second))


# Positions in km of a Solar System that moves uniformly, but for the Earth-Moon barycentre.
SUN_KM = cubic([1e6, -2e5, 3e5], [40, 10, -5])
BARYCENTRE_KM = cubic([8e7, 1.1e8, 5e7], [-9e4, 5e4, 2e4], [3, 2, 1])
MOON_KM = cubic([3e5, 2e5, 1e5], [-2000, 2500, 900])
EARTH_KM = cubic([-3700, -2400, -1200], [24, -30, -11])


def planets(name="planets.bsp", **changes):
    """A planetary ephemeris in the manner of DE440."""
    bodies = {10: (0, SUN_KM), 3: (0, BARYCENTRE_KM), 301: (3, MOON_KM), 399: (3, EARTH_KM)}
    return written.write_daf(harness.path(name), "SPK", [
        written.spk_chebyshev(body, center, function, *SPAN, **changes) for body, (center, function) in bodies.items()])


def lander(name="lander.bsp", target=SPACECRAFT, kind=13, degree=3):
    times = np.arange(SPAN[0], SPAN[1], 60.0)
    states = [np.concatenate(circle(t)) for t in times]
    return written.write_daf(harness.path(name), "SPK", [written.spk_states(target, 301, states, times, kind, degree)])


def angles(et):
    """The Moon's: phi (right ascension of the node), delta (inclination), w."""
    t = et - ET
    return np.array([-0.05 + 1e-9 * t, 0.42 - 2e-10 * t, 3e3 + SIDEREAL_RAD_S * t])


def orientation(name="moon.bpc", code=31008):
    return written.write_daf(harness.path(name), "PCK", [written.pck_moon(angles, *SPAN, code)])


def moon_axes(et):
    """The rows of moon_from_icrf by the pole and the ascending node: none of the client's code."""
    phi, delta, w = angles(et)
    pole = np.array([math.sin(delta) * math.sin(phi), -math.sin(delta) * math.cos(phi), math.cos(delta)])
    node = np.array([math.cos(phi), math.sin(phi), 0])
    x = math.cos(w) * node + math.sin(w) * np.cross(pole, node)
    return np.array([x, np.cross(pole, x), pole])


class WithKernels(unittest.TestCase):
    def kernels(self, *paths):
        opened = Kernels(*paths)
        self.addCleanup(opened.close)
        return opened


class Epochs(unittest.TestCase):
    def test_ephemeris_time_is_astropys(self):
        from astropy.time import Time
        for utc in ("1973-01-01T00:00:00", "1998-12-31T23:59:59", "1999-01-01T00:00:00", "2016-12-31T23:59:59.5",
                    "2017-01-01T00:00:00", "2026-11-20T06:00:00", "2026-324T00:00:00.123456"):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                tdb = Time(utc.replace("-324", ":324").replace("T", ":" if "324" in utc else "T"), scale="utc").tdb
            self.assertAlmostEqual(et_of(utc), ((tdb.jd1 - 2451545) + tdb.jd2) * 86400, delta=4e-5, msg=utc)
        self.assertAlmostEqual(et_of("2000-01-01T12:00:00"), 64.183927, 6)  # SPICE's str2et
        with self.assertRaisesRegex(ValueError, "before 1973"):
            et_of("1972-06-01T00:00:00")


class Positions(WithKernels):
    TIMES = (*SPAN, ET, ET + 1234.5, ET - 3999.999)

    def test_chebyshev_polynomials(self):
        for changes in ({}, {"kind": 3}, {"records": 1, "degree": 4}):
            kernels = self.kernels(planets(**changes))
            for et in self.TIMES:
                np.testing.assert_allclose(kernels.position_m(10, et), 1e3 * (SUN_KM(et) - BARYCENTRE_KM(et) - MOON_KM(et)),
                                           rtol=1e-12)
                np.testing.assert_allclose(kernels.position_m(399, et), 1e3 * (EARTH_KM(et) - MOON_KM(et)), rtol=1e-12)
                np.testing.assert_allclose(kernels.position_m(301, et, 399), 1e3 * (MOON_KM(et) - EARTH_KM(et)), rtol=1e-12)

    def test_either_order_of_bytes(self):
        segments = [written.spk_chebyshev(SPACECRAFT, 301, MOON_KM, *SPAN),
                    written.spk_states(-86, 301, [[*MOON_KM(t), 0, 0, 0] for t in SPAN], SPAN, 9, 1)]
        kernels = self.kernels(written.write_daf(harness.path("big.bsp"), "SPK", segments, big_endian=True))
        for body in (SPACECRAFT, -86):
            np.testing.assert_allclose(kernels.position_m(body, ET), 1e3 * MOON_KM(ET), rtol=1e-12)

    def test_interpolated_states(self):
        """A polynomial of the type's degree is reproduced, at equal and unequal steps and near the ends."""
        quintic = np.random.default_rng(1).normal(size=(6, 3)) * [[1800], [300], [40], [5], [1], [1]]
        position, velocity = cubic(*quintic), cubic(*(quintic[1:] * np.arange(1, 6)[:, None] / 3600))
        equal = np.linspace(SPAN[0], SPAN[1], 250)
        unequal = equal + 10 * np.sin(np.arange(250))
        for kind, degree, times in ((8, 5, equal), (9, 5, unequal), (9, 6, unequal), (12, 2, equal), (13, 2, unequal),
                                    (13, 3, unequal)):
            states = [[*position(t), *velocity(t)] for t in times]
            path = written.write_daf(harness.path("states.bsp"), "SPK",
                                     [written.spk_states(SPACECRAFT, 301, states, times, kind, degree)])
            kernels = self.kernels(path)
            for et in (times[0], times[-1], times[0] + 1, times[-1] - 1, ET, ET + 1234.5):
                # Seconds since J2000 have 1.2e-7 s to the digit, in which the body moves by 0.1 mm.
                np.testing.assert_allclose(kernels.position_m(SPACECRAFT, et), 1e3 * position(et), rtol=0, atol=1e-3,
                                           err_msg=f"type {kind}, degree {degree}")

    def test_an_odd_number_of_nodes_lies_around_the_nearest(self):
        times = np.arange(0, 7.0)
        states = np.zeros((7, 6))
        states[:, 0] = [0, 0, 0, 0, 1, 0, 0]
        for et, expected in ((2.4, 0), (2.6, -0.12)):  # Lagrange's parabola through the nodes around 2, around 3
            path = written.write_daf(harness.path("odd.bsp"), "SPK", [written.spk_states(-1, 301, states, times, 9, 2)])
            self.assertAlmostEqual(self.kernels(path).position_m(-1, et)[0], 1e3 * expected, 9)

    def test_the_last_segment_counts(self):
        first = written.spk_chebyshev(SPACECRAFT, 301, cubic([1, 0, 0]), *SPAN)
        later = written.spk_chebyshev(SPACECRAFT, 301, cubic([2, 0, 0]), ET, SPAN[1])
        other = written.write_daf(harness.path("other.bsp"), "SPK", [written.spk_chebyshev(
            SPACECRAFT, 301, cubic([3, 0, 0]), ET + 100, SPAN[1])])
        kernels = self.kernels(written.write_daf(harness.path("two.bsp"), "SPK", [first, later]), other)
        found = [kernels.position_m(SPACECRAFT, et)[0] for et in (ET - 10, ET + 10, ET + 200)]
        np.testing.assert_allclose(found, [1000, 2000, 3000], rtol=1e-12)

    def test_faults_say_what_is_there(self):
        from_earth = written.write_daf(harness.path("relative.bsp"), "SPK", [
            written.spk_chebyshev(SPACECRAFT, 399, MOON_KM, *SPAN)])
        odd = written.write_daf(harness.path("type1.bsp"), "SPK", [
            written.spk_states(-1, 301, np.zeros((2, 6)), SPAN, 1, 1),
            written.spk_chebyshev(-2, 301, MOON_KM, *SPAN, frame=17)])
        text = harness.write("kernel.tls", "KPL/LSK\n")
        for words, act in {
                "position of -85 relative to 301.*-85 relative to 399 from": lambda: self.kernels(from_earth).position_m(
                    SPACECRAFT, ET),
                "no kernel has the position of 10 .*none": lambda: self.kernels().position_m(10, ET),
                "SPK type 1; 2, 3, 8": lambda: self.kernels(odd).position_m(-1, ET),
                r"in frame 17; 1 \(J2000\)": lambda: self.kernels(odd).position_m(-2, ET),
                "kernel.tls: begins with b'KPL/LSK": lambda: self.kernels(text),
                "orientation at et_s.*binary PCK": lambda: self.kernels(planets()).sun(START),
                "no orientation of the Moon": lambda: self.kernels(orientation("earth.bpc", 3000)),
                "relative to 301 at et_s": lambda: Trajectory.from_spk(
                    self.kernels(lander()), SPACECRAFT, start="2026-11-21T00:00:00Z", stop="2026-11-21T00:01:00Z", step_s=10,
                    up_azimuth_deg=0),
                "in MOON_ME; only one in ICRF or J2000": lambda: Trajectory(
                    [0], [[2e6, 0, 0]], up_azimuth_deg=0).in_moon_frame(self.kernels(orientation()))}.items():
            with self.assertRaisesRegex(ValueError, words):
                act()
        with mock.patch.dict(sys.modules, {"jplephem.spk": None}), self.assertRaisesRegex(ImportError, "python3-jplephem"):
            self.kernels()


class Directions(WithKernels):
    def test_light_time_and_aberration(self):
        """A source and an observer in uniform motion: the light cone's equation, and a boost of its 4-vector."""
        observer, source = cubic([1e8, 5e7, 2e7], [-8e4, 6e4, 3e4]), cubic([1e6, -2e5, 3e5], [40, 10, -5])
        path = written.write_daf(harness.path("uniform.bsp"), "SPK", [
            written.spk_chebyshev(301, 0, observer, *SPAN), written.spk_chebyshev(10, 0, source, *SPAN)])
        r = 1e3 * (source(ET) - observer(ET))
        v = 1e3 * (source(ET + 3600) - source(ET)) / 3600  # of the source
        a, b, c = LIGHT_M_S ** 2 - v @ v, 2 * (r @ v), -(r @ r)
        light_time = (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a)
        seen = r - v * light_time
        beta = 1e3 * (observer(ET + 3600) - observer(ET)) / 3600 / LIGHT_M_S
        gamma = 1 / math.sqrt(1 - beta @ beta)
        n = seen / np.linalg.norm(seen)
        # The photon's momentum is (1, -n); in the observer's frame -n' along beta is gamma (-n.b + |b|), across it as it was.
        along = beta / np.linalg.norm(beta)
        boosted = n - (n @ along) * along + gamma * (n @ along + np.linalg.norm(beta)) * along
        got = self.kernels(path).apparent_m(10, ET)
        self.assertAlmostEqual(np.linalg.norm(got) / np.linalg.norm(seen), 1, 13)
        np.testing.assert_allclose(got / np.linalg.norm(got), boosted / np.linalg.norm(boosted), atol=2e-12)
        self.assertGreater(np.linalg.norm(got / np.linalg.norm(got) - n), 10 * ARCSEC)

    def test_the_moons_axes(self):
        kernels = self.kernels(orientation())
        self.assertEqual(kernels.moon_frame, "MOON_PA_DE440")
        for et in (*SPAN, ET, ET + 1234.5):
            np.testing.assert_allclose(kernels.moon_from_icrf(et), moon_axes(et), atol=1e-11)
        # The last file's frame is that of all poses, also where only another one covers the time.
        later = written.write_daf(harness.path("later.bpc"), "PCK", [written.pck_moon(angles, ET, SPAN[1], 31006)])
        both = self.kernels(orientation(), later)
        self.assertEqual(both.moon_frame, "MOON_PA_DE421")
        with self.assertRaisesRegex(ValueError, "no kernel has the Moon's orientation"):
            both.moon_from_icrf(ET - 10)

    def test_the_mean_earth_frame_is_the_services(self):
        for code, frame in ((31008, "MOON_PA_DE440"), (31006, "MOON_PA_DE421")):
            kernels = self.kernels(orientation(f"{code}.bpc", code))
            self.assertEqual(kernels.moon_frame, frame)
            me_from_pa = kernels.moon_me_from_icrf(ET) @ kernels.moon_from_icrf(ET).T
            position = np.array([1.35e6, 1.13e6, -2e5])
            with Client(url()) as client, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                view = client.frame({"camera": Camera.pinhole(width=4, height=4, fov_deg=50), "products": ["range"],
                                     "pose": Pose.nadir(position_m=position, frame=frame)}).meta["request"]["pose"]
            x, y, z = me_from_pa @ position
            np.testing.assert_allclose(view["position_m"], [x, y, z], atol=1e-6)

    def test_sun_and_earth_are_the_services(self):
        """Kernels fitted to astropy's ephemeris, ERFA's as the service's: directions in ICRF."""
        from astropy.coordinates import get_body_barycentric
        from astropy.time import Time

        camera_m = np.array([0, 0, 3e6])

        def barycentric(body):
            # The camera stands for the Moon's centre: what it sees has other light times.
            offset_km = 1e-3 * camera_m if body == "moon" else 0
            return lambda et: offset_km + get_body_barycentric(
                body, Time(2451545, et / 86400, format="jd", scale="tdb"), "builtin").xyz.to_value("km")

        path = written.write_daf(harness.path("astropy.bsp"), "SPK", [
            written.spk_chebyshev(code, 0, barycentric(body), *SPAN, records=1, degree=6)
            for body, code in (("sun", 10), ("moon", 301), ("earth", 399))])
        with Client(url()) as client:
            sky = client.sky({"camera": {"model": "fisheye", "width": 512, "height": 512, "fov_deg": 350}, "utc": START,
                              "pose": {"frame": "ICRF", "position_m": camera_m.tolist(),
                                       "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}},
                              "sky": {"sun": True, "earth": True}})
        found = dict(zip(sky.id, sky.direction_icrf))
        self.assertEqual(set(found), {"sun", "earth"})
        for code, name in ((10, "sun"), (399, "earth")):
            offset = self.kernels(path).apparent_m(code, et_of(START))
            error = np.linalg.norm(np.cross(offset / np.linalg.norm(offset), found[name]))
            self.assertLess(error, 0.001 * ARCSEC, name)


class Skies(WithKernels):
    """An ephemeris of its own: astropy's, with each body 0.4 % of its distance aside. None of the client's code or the
    service's theories finds where bodies appear."""

    BODIES = {"sun": 10, "earth": 399, "mercury": 199, "venus": 299, "mars": 4, "jupiter": 599, "saturn": 6, "uranus": 7,
              "neptune": 899}
    POSITION_M, VELOCITY_M_S = np.array([1.1e6, -1.4e6, 0.9e6]), np.array([900.0, 1100.0, -600.0])  # ICRF
    LIGHT_SPAN = (ET - 20000, ET + 1000)  # Neptune's light takes four hours

    @classmethod
    def setUpClass(cls):
        from astropy.coordinates import get_body_barycentric
        from astropy.time import Time

        def of_astropy(body, et):
            return 1e3 * get_body_barycentric(body, Time(2451545, et / 86400, format="jd", scale="tdb"),
                                              "builtin").xyz.to_value("km")

        def aside(body):
            away = of_astropy(body, AT) - of_astropy("moon", AT)
            return 0.004 * np.linalg.norm(away) * np.cross(away, [0.3, 0.5, 0.8]) / np.linalg.norm(np.cross(away, [0.3, 0.5, 0.8]))

        cls.m = {body: lambda et, body=body, aside_m=aside(body): of_astropy(body, et) + aside_m for body in cls.BODIES}
        cls.m["moon"] = lambda et: of_astropy("moon", et)

    def ephemeris(self, name="sky.bsp", without=()):
        codes = {**self.BODIES, "moon": 301}
        return written.write_daf(harness.path(name), "SPK", [
            written.spk_chebyshev(codes[body], 0, lambda et, f=f: 1e-3 * f(et), *self.LIGHT_SPAN)
            for body, f in self.m.items() if body not in without])

    def apparent(self, body):
        """Light time and aberration from the camera, the Sun's deflection: Explanatory Supplement (2013), 7.40, 7.63."""
        eye = self.m["moon"](AT) + self.POSITION_M
        seconds = 0.0
        for _ in range(6):
            way = self.m[body](AT - seconds) - eye
            seconds = np.linalg.norm(way) / LIGHT_M_S
        n = way / np.linalg.norm(way)
        if body not in ("sun", "earth"):
            from_sun = eye - self.sun_m(AT)
            e, q = from_sun / np.linalg.norm(from_sun), way + eye - self.sun_m(AT - seconds)
            q = q / np.linalg.norm(q)
            n = n + 2 * 1476.625 / np.linalg.norm(from_sun) / (1 + q @ e) * ((n @ q) * e - (e @ n) * q)
        beta = ((self.m["moon"](AT + 100) - self.m["moon"](AT - 100)) / 200 + self.VELOCITY_M_S) / LIGHT_M_S
        seen = math.sqrt(1 - beta @ beta) * n + (1 + n @ beta / (1 + math.sqrt(1 - beta @ beta))) * beta
        return seen / np.linalg.norm(seen)

    def sun_m(self, et):
        """The Sun whose mass deflects: the service's, not the one that is set aside."""
        return self.m["sun"](et) - (self.m["sun"](AT) - self.plain_sun_m)

    def request(self, **sky):
        return {"camera": {"model": "fisheye", "width": 512, "height": 512, "fov_deg": 350}, "utc": START,
                "pose": {"frame": "ICRF", "position_m": self.POSITION_M.tolist(),
                         "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}},
                "sky": {"sun": True, "earth": True, "planets": True, "velocity_m_s": self.VELOCITY_M_S.tolist(),
                        "velocity_frame": "ICRF", **sky}}

    def asked(self, **sky):
        with Client(url()) as client:
            answer = client.sky(self.request(**sky))
        return dict(zip(answer.id, answer.direction_icrf))

    def test_the_sky_is_the_kernels_to_a_milliarcsecond(self):
        from astropy.coordinates import get_body_barycentric
        from astropy.time import Time
        self.plain_sun_m = 1e3 * get_body_barycentric(
            "sun", Time(2451545, AT / 86400, format="jd", scale="tdb"), "builtin").xyz.to_value("km")
        states = self.kernels(self.ephemeris()).sky_states(START)
        self.assertEqual(set(states), set(self.BODIES))
        found, plain = self.asked(states=states), self.asked()
        for body in self.BODIES:
            expected = self.apparent(body)
            error = np.linalg.norm(np.cross(expected, found[body])) / ARCSEC
            self.assertLess(error, 0.001, body)
            self.assertGreater(np.linalg.norm(np.cross(expected, plain[body])) / ARCSEC, 800, body)

    def test_bodies_without_a_state_have_the_services_theory(self):
        kernels = self.kernels(self.ephemeris("few.bsp", without=("venus", "earth")))
        states = kernels.sky_states(START)
        self.assertEqual(set(self.BODIES) - set(states), {"venus", "earth"})
        found, plain = self.asked(states=states), self.asked()
        for body in self.BODIES:
            self.assertEqual((found[body] == plain[body]).all(), body in ("venus", "earth"), body)
        self.assertEqual(set(kernels.sky_states(START, ["mars"])), {"mars"})
        for bodies, words in ((["venus"], "no kernel has the position of 2 relative to 0"), (["pluto"], "'pluto' is not a body")):
            with self.assertRaisesRegex(ValueError, words):
                kernels.sky_states(START, bodies)

    def test_trajectories_bring_the_sky(self):
        kernels = self.kernels(lander(), self.ephemeris(), orientation())
        trajectory = Trajectory.from_spk(kernels, SPACECRAFT, start=START, stop="2026-11-20T00:01:00Z", step_s=60,
                                         up_azimuth_deg=0)
        for request in trajectory.requests({"sky": {"planets": True}}):
            self.assertEqual(request["sky"]["states"], {
                body: state for body, state in kernels.sky_states(request["sky"]["utc"]).items() if body != "sun"})
        self.assertEqual(set(trajectory.requests({"sky": {"sun": True}})[0]["sky"]["states"]), {"sun", "earth"})
        self.assertEqual(trajectory.requests({"sky": {"utc": START}})[0]["sky"], {"utc": START})


class Trajectories(WithKernels):
    SPAN = {"start": START, "stop": "2026-11-20T00:10:00Z", "step_s": 60}

    def test_without_an_orientation(self):
        trajectory = Trajectory.from_spk(self.kernels(lander()), SPACECRAFT, up_azimuth_deg=0, **self.SPAN)
        self.assertEqual((trajectory.frame, list(trajectory.times_s)), ("ICRF", list(range(0, 601, 60))))
        for request in trajectory.requests({}, [0, 95.25]):
            pose = request["pose"]
            self.assertEqual((pose["frame"], pose["utc"], request["sun"]), ("ICRF", request["sun"]["utc"], {"utc": pose["utc"]}))
            position, _ = circle(et_of(pose["utc"]))
            np.testing.assert_allclose(pose["position_m"], 1e3 * position, atol=0.02)  # seven nodes of a circle, a minute apart

    def test_with_an_orientation_and_planets(self):
        kernels = self.kernels(lander(), planets(), orientation())
        trajectory = Trajectory.from_spk(kernels, SPACECRAFT, up_azimuth_deg=0, **self.SPAN)
        request = trajectory.requests({}, [95.25])[0]
        et = et_of(START) + 95.25
        self.assertEqual(request["pose"]["frame"], "MOON_PA_DE440")
        self.assertNotIn("utc", request["pose"])
        np.testing.assert_allclose(request["pose"]["position_m"], moon_axes(et) @ (1e3 * circle(et)[0]), atol=0.02)
        offset = kernels.moon_me_from_icrf(et) @ kernels.apparent_m(10, et)
        np.testing.assert_allclose(request["sun"]["direction"], offset, rtol=1e-12)
        self.assertAlmostEqual(request["sun"]["distance_au"], np.linalg.norm(offset) / 149597870700, 12)
        earth = kernels.earth(trajectory.utc(95.25))
        np.testing.assert_allclose(
            kernels.moon_me_from_icrf(et).T @ earth["direction"] * earth["distance_m"], 1e3 * (EARTH_KM(et) - MOON_KM(et)),
            atol=4e-4 * earth["distance_m"])  # aberration of 20 arcseconds, light time
        with Client(url()) as client, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            view = client.frame({**request, "camera": Camera.pinhole(width=4, height=4, fov_deg=50), "products": ["range"],
                                 "indirect": {"earth": earth}}).meta
        self.assertEqual(view["request"]["sun"]["angular_radius_deg"] > 0.2, True)

    def aem(self, name, frame):
        """Two attitudes of a body whose camera looks along its z, turned by 90 degrees in 600 s about z."""
        half = math.sqrt(0.5)
        return harness.write(f"{name}.aem", f"""CCSDS_AEM_VERS = 1.0
META_START
REF_FRAME_A = {frame}
REF_FRAME_B = SC_BODY_1
ATTITUDE_DIR = A2B
TIME_SYSTEM = UTC
ATTITUDE_TYPE = QUATERNION
QUATERNION_TYPE = LAST
META_STOP
DATA_START
2026-11-20T00:00:00.000 0 0 0 1
2026-11-20T00:10:00.000 0 0 {half} {half}
DATA_STOP
""")

    def test_attitudes_are_turned_with_the_positions(self):
        for frame in ("ICRF", "EME2000"):
            aem = self.aem(frame, frame)
            inertial = Trajectory.from_spk(self.kernels(lander()), SPACECRAFT, aem=aem, **self.SPAN)
            fixed = Trajectory.from_spk(self.kernels(lander(), orientation()), SPACECRAFT, aem=aem, **self.SPAN)
            again = inertial.in_moon_frame(self.kernels(orientation()))
            for time_s in (0, 200, 600):
                q = [pose["camera_from_moon"] for pose in (inertial.at(time_s), fixed.at(time_s), again.at(time_s))]
                of_icrf, of_moon, of_again = (matrix_of(np.array([part[c] for c in "wxyz"])) for part in q)
                np.testing.assert_allclose(of_moon @ moon_axes(et_of(START) + time_s), of_icrf, atol=1e-11)
                np.testing.assert_allclose(of_again, of_moon, atol=1e-14)
                np.testing.assert_allclose(of_icrf, turned_axes(2, math.radians(0.15 * time_s)), atol=1e-12)

    def test_the_page(self):
        """geometry.md's block, with kernels of these names."""
        with open(os.path.join(REPOSITORY, "api", "clients", "python", "geometry.md")) as file:
            block = re.findall(r"^```python\n(.*?)^```", file.read(), re.M | re.S)[-1]
        lander("lander.bsp")
        planets("de440s.bsp")
        orientation("moon_pa_de440_200625.bpc")
        os.rename(self.aem("page", "ICRF"), harness.path("attitude.aem"))
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(harness.path())
        page = {}
        exec(block, page)
        self.addCleanup(page["kernels"].close)
        self.assertEqual(len(page["requests"]), 601)
        self.assertLess(abs(np.linalg.norm(page["requests"][300]["pose"]["position_m"]) - 1837400), 0.1)
        self.assertGreater(page["requests"][0]["indirect"]["earth"]["distance_m"], 3e8)

    def command(self, name, *more):
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-m", "selenograph", name, lander(), "--kernel", planets(), "--kernel",
             orientation(), "--spacecraft", str(SPACECRAFT), "--start", START, "--stop", self.SPAN["stop"], "--step-s", "300",
             *more], capture_output=True, text=True, timeout=harness.PATIENCE_S,
            env={**os.environ, "PYTHONPATH": os.path.join(REPOSITORY, "api", "clients", "python")})
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_the_commands(self):
        out = harness.path("watched")
        self.command("watch", "--out", out, "--url", url())
        self.assertEqual(sorted(os.listdir(out)), ["00000.npz", "00001.npz", "00002.npz"])
        for i in range(3):
            with open(os.path.join(out, f"0000{i}.npz"), "rb") as file:
                pose = harness.meta_of(file.read())["request"]["pose"]
            self.assertAlmostEqual(np.linalg.norm(pose["position_m"]), 1837400, delta=0.1)
        lines = self.command("manifest").splitlines()
        self.assertEqual(len(lines), 3)
        for i, line in enumerate(lines):
            et, pose = et_of(START) + 300 * i, json.loads(line)["pose"]
            self.assertEqual(pose["frame"], "MOON_PA_DE440")
            np.testing.assert_allclose(pose["position_m"], moon_axes(et) @ (1e3 * circle(et)[0]), atol=0.02)


if __name__ == "__main__":
    harness.main()
