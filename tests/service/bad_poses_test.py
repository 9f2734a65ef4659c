#!/usr/bin/env python3
"""Poses, Suns and cameras at the ends of what numbers can be, against the real binary over HTTP.

Each is answered: 200 with a frame that makes sense, or 4xx with a JSON Pointer to the member at fault. Never 5xx, and the
service lives on.
"""

import io
import json
import math

import numpy as np

import harness
from harness import WithService, changed, frame_request

LAT, LON = 0.1, 30.1
DENORMAL = 5e-324


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "0", "--west-deg", "30", "--rows", "1", "--columns", "1", "--ppd", "256")


def tearDownModule():
    harness.tear_down()


def quaternion_down():
    """camera_from_moon of a camera that looks straight down at (LAT, LON), north up: rows are x right, y down, z ahead."""
    lat, lon = math.radians(LAT), math.radians(LON)
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    m = np.array([east, -np.cross(up, east), -up])
    # Of the eigenvectors of this matrix (Bar-Itzhack 2000) the one of the largest eigenvalue.
    k = np.array([[m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2], m[2, 1] - m[1, 2]],
                  [m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
                  [m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
                  [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], m[0, 0] + m[1, 1] + m[2, 2]]]) / 3
    x, y, z, w = np.linalg.eigh(k)[1][:, 3]
    return {"w": w, "x": x, "y": y, "z": z}


def request(products=("radiance",), **changes):
    return frame_request(products, width=16, height=12, **changes)


def pose(**attitude):
    return {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": 20000.0}, **attitude}


class Hard(WithService):
    def array(self, document, product):
        body = self.ok(self.service.frame(dict(document, products=[product]), "application/x-npy"), "application/x-npy")
        return np.load(io.BytesIO(body), allow_pickle=False)

    def answered(self, answer, pointer=None):
        """200, or a problem in 4xx that points into the request. Returns the status."""
        status, headers, body = answer
        self.assertTrue(status == 200 or 400 <= status < 500, (status, body[:300]))
        if status != 200:
            document = self.problem(answer, status, pointer)
            if status == 422:
                self.assertTrue(document["errors"], document)
                self.assertTrue(all(e["pointer"].startswith("/") and e["detail"] for e in document["errors"]), document)
        return status

    def tearDown(self):
        self.assertEqual(self.service.ask("GET", "/health/ready")[0], 200)

    def sends(self, text):
        return self.service.ask("POST", "/v1/frames", text.encode(), {"Content-Type": "application/json", "Accept": "*/*"})


FULL = request(["radiance", "position", "lit"],
               camera={"model": "pinhole", "width": 16, "height": 12, "fx": 20.0, "fy": 20.0, "cx": 7.5, "cy": 5.5,
                       "distortion": {"model": "brown_conrady", "k1": 0.0, "k2": 0.0, "k3": 0.0, "p1": 0.0, "p2": 0.0}},
               sun={"direction": [0.3, 0.8, 0.1], "distance_au": 1.0, "angular_radius_deg": 0.0},
               surface={"reflectance": {"model": "lunar", "lommel_seeliger_weight": 0.5, "rho": 0.12}},
               accuracy={"max_error_px": 0.5, "samples_per_pixel": 1},
               pose={"position_m": [1757400.0, 0.0, 0.0], "camera_from_moon": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}})


def numbers_of(document, path=()):
    if isinstance(document, dict):
        for key, value in document.items():
            yield from numbers_of(value, path + (key,))
    elif isinstance(document, list):
        for i, value in enumerate(document):
            yield from numbers_of(value, path + (i,))
    elif isinstance(document, (int, float)):
        yield path


class Numbers(Hard):
    def test_non_numbers_in_every_member(self):
        """NaN, infinities, null and what overflows a double, in the place of every number of a request."""
        self.assertEqual(self.answered(self.service.frame(FULL, "application/x-npz")), 200)
        paths = list(numbers_of(FULL))
        self.assertGreater(len(paths), 25)
        for path in paths:
            pointer = "/" + "/".join(map(str, path))
            text = json.dumps(changed(FULL, path, "here"))
            for literal, status in (("NaN", 400), ("Infinity", 400), ("-Infinity", 400), ("nan", 400), ("null", 422), ("1e999", 422),
                                    ("-1e999", 422), ('"NaN"', 422)):
                with self.subTest(pointer=pointer, literal=literal):
                    answer = self.sends(text.replace('"here"', literal))
                    self.problem(answer, status, pointer if status == 422 else None)

    def test_extreme_doubles_in_every_member(self):
        """Denormals and the largest doubles, of either sign, in the place of every number: a frame, or a pointer."""
        seen = {200: 0, 422: 0}
        for path in numbers_of(FULL):
            for value in (DENORMAL, -DENORMAL, 2.2250738585072014e-308, 1e-300, 1.7976931348623157e308, -1.7976931348623157e308, -0.0):
                with self.subTest(pointer=path, value=value):
                    status = self.answered(self.service.frame(changed(FULL, path, value), "application/x-npz"))
                    seen[status] += 1
        print("ends of double in every number: %d frames, %d refusals with a pointer" % (seen[200], seen[422]))
        self.assertGreater(seen[200], 50)
        self.assertGreater(seen[422], 50)

    def test_denormals_are_as_good_as_zero(self):
        whole = self.array(FULL, "radiance")
        for path in (("pose", "position_m", 1), ("pose", "camera_from_moon", "x"), ("camera", "distortion", "k1"),
                     ("camera", "distortion", "p2"), ("sun", "angular_radius_deg")):
            got = self.array(changed(FULL, path, DENORMAL), "radiance")
            np.testing.assert_array_equal(got, whole, str(path))


class Cameras(Hard):
    def test_below_the_ground(self):
        for height in (-50000.0, -12000.0, -3000.0):
            with self.subTest(height=height):
                document = request(pose={"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": height}, "nadir": {}})
                self.problem(self.service.frame(document), 422, "/pose")
        for position in ([0.0, 0.0, 0.0], [DENORMAL, 0.0, 0.0], [1e-300, -1e-300, 0.0], [1000.0, 0.0, 0.0], [0.0, 0.0, 1700000.0]):
            with self.subTest(position=position):
                document = request(pose={"position_m": position, "camera_from_moon": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}})
                self.problem(self.service.frame(document), 422, "/pose")
                document["pose"] = {"position_m": position, "nadir": {}}
                self.assertEqual(self.answered(self.service.frame(document)), 422)

    def test_far_away(self):
        for far in (4e8, 1.5e11, 1e12):
            with self.subTest(far=far):
                document = request(pose={"position_m": [far, 1.0, 1.0], "nadir": {}})
                self.assertEqual(self.array(document, "depth").shape, (12, 16))
        self.problem(self.service.frame(request(pose={"position_m": [1e13, 0.0, 0.0], "nadir": {}})), 422, "/pose/position_m/0")

    def test_fields_of_view(self):
        """Which way a pixel looks follows from the field of view, at any."""
        for fov in (1e-6, 0.01, 1.0, 170.0, 179.0, 179.999):
            with self.subTest(fov=fov):
                document = request(camera={"width": 17, "height": 13, "fov_deg": fov})
                depth, reach = self.array(document, "depth"), self.array(document, "range")
                hit = np.isfinite(depth)
                self.assertTrue(hit[6, 8], "the ground below the camera")
                if fov <= 1:
                    self.assertTrue(hit.all())
                focal = 8.5 / math.tan(math.radians(fov / 2))
                x, y = (np.arange(17) - 8) / focal, (np.arange(13) - 6) / focal
                stretch = np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
                # The image is 17 / focal wide in slopes; rounding of its corners is what its middle is off by.
                np.testing.assert_allclose(reach[hit] / depth[hit], stretch[hit], rtol=1e-12 + 1e-15 * 17 / focal)
        for fov in (0.0, -1.0, 180.0, 360.0, DENORMAL, 1e-300):
            with self.subTest(fov=fov):
                self.problem(self.service.frame(request(camera={"width": 16, "height": 12, "fov_deg": fov})), 422, "/camera/fov_deg")

    def test_lenses_that_fold(self):
        for name, value in (("k1", -1e6), ("k1", 1e6), ("k2", -0.5), ("k3", 1e6), ("p1", 0.5), ("p2", -1e6)):
            with self.subTest(coefficient=name, value=value):
                lens = {"model": "brown_conrady", name: value}
                document = request(camera={"width": 16, "height": 12, "fov_deg": 80.0, "distortion": lens})
                position, radiance = self.array(document, "position"), self.array(document, "radiance")
                masked = np.isnan(position[..., 0])
                self.assertTrue(np.all(radiance[masked] == 0))
                self.assertTrue(np.all(np.isfinite(radiance) & (radiance >= 0)))
                self.assertTrue(np.all(np.isfinite(position[~masked])))


class Attitudes(Hard):
    def test_lengths(self):
        """Within 1e-3 of one a quaternion is normalised: the frame is the same. Any other is refused."""
        q = quaternion_down()
        exact = self.array(request(pose=pose(camera_from_moon=q)), "position")
        for way in ("camera_from_moon", "moon_from_camera"):
            for length in (0.9990001, 0.9995, 1 - 1e-9, 1 + 1e-9, 1.0005, 1.0009999):
                with self.subTest(way=way, length=length):
                    sign = 1 if way == "camera_from_moon" else -1
                    scaled = {k: v * length * (1 if k == "w" else sign) for k, v in q.items()}
                    got = self.array(request(pose=pose(**{way: scaled})), "position")
                    np.testing.assert_allclose(got, exact, atol=1e-6)
            for length in (0.0, DENORMAL, 1e-300, 1e-160, 0.5, 0.9989, 1.0011, 2.0, 1e160, 1e300):
                with self.subTest(way=way, length=length):
                    scaled = {k: v * length for k, v in q.items()}
                    self.problem(self.service.frame(request(pose=pose(**{way: scaled}))), 422, "/pose/" + way)

    def test_up_vectors(self):
        target = {"lat_deg": LAT + 0.1, "lon_deg": LON}
        expected = self.array(request(pose=pose(look_at=dict(target, up=[0.0, 0.0, 1.0]))), "position")
        for scale in (DENORMAL, 1e-300, 1e300, 1.7976931348623157e308):
            got = self.array(request(pose=pose(look_at=dict(target, up=[0.0, 0.0, scale]))), "position")
            np.testing.assert_array_equal(got, expected, str(scale))
        self.problem(self.service.frame(request(pose=pose(look_at=dict(target, up=[0.0, 0.0, 0.0])))), 422, "/pose/look_at/up")


class Suns(Hard):
    def test_any_length(self):
        """Powers of two give the same bytes; other factors round each component once: 1e-7 of radiance and no more."""
        for direction in ([1.0, 0.0, 0.0], [0.3, 0.8, -0.1], [0.75, 0.625, 0.015625]):
            expected = self.array(request(sun={"direction": direction}), "radiance")
            self.assertGreater(expected.max(), 0)
            for scale in (2.0**-1000, 2.0**-60, 2.0**60, 2.0**1000):
                got = self.array(request(sun={"direction": [c * scale for c in direction]}), "radiance")
                np.testing.assert_array_equal(got, expected, f"{direction} {scale}")
            for scale in (1e-300, 1e-30, 1e30, 1e300):
                got = self.array(request(sun={"direction": [c * scale for c in direction]}), "radiance")
                np.testing.assert_allclose(got, expected, rtol=1e-6, err_msg=f"{direction} {scale}")

    def test_denormal(self):
        along = self.array(request(sun={"direction": [1.0, 0.0, 0.0]}), "radiance")
        for length in (DENORMAL, 1e-310):
            got = self.array(request(sun={"direction": [length, 0.0, -0.0]}), "radiance")
            np.testing.assert_array_equal(got, along)

    def test_zero(self):
        for zero in ([0, 0, 0], [0.0, -0.0, 0.0], [1e-400, 0.0, 0.0]):
            self.problem(self.service.frame(request(sun={"direction": zero})), 422, "/sun/direction")

    def test_below_the_horizon_all_is_dark(self):
        for elevation in (-20.0, -89.9, -90.0):
            document = request(sun={"local": {"lat_deg": LAT, "lon_deg": LON, "azimuth_deg": 90.0, "elevation_deg": elevation}})
            self.assertEqual(self.array(document, "radiance").max(), 0)
            lit = self.array(document, "lit")
            self.assertTrue(np.all(lit[np.isfinite(lit)] == 0))

    def test_rays_accept_vectors_of_any_length(self):
        ray = {"origin_m": [1757400.0 * math.cos(math.radians(LON)), 1757400.0 * math.sin(math.radians(LON)), 3000.0],
               "direction": [-math.cos(math.radians(LON)), -math.sin(math.radians(LON)), 0.0]}
        first = self.ok_json(self.service.post("/v1/rays", {"rays": [ray], "sun": {"direction": [1.0, 1.0, 0.0]}}))
        for scale in (1e-300, DENORMAL, 1e300):
            scaled = dict(ray, direction=[c * scale if scale != DENORMAL else c * 1e-310 for c in ray["direction"]])
            got = self.ok_json(self.service.post("/v1/rays", {"rays": [scaled], "sun": {"direction": [scale, scale, 0.0]}}))
            self.assertEqual(got["rays"][0]["hit"], first["rays"][0]["hit"])
            self.assertAlmostEqual(got["rays"][0]["range_m"], first["rays"][0]["range_m"], delta=1e-6)
            self.assertEqual(got["rays"][0]["lit"], first["rays"][0]["lit"])
        zero = dict(ray, direction=[0.0, 0.0, 0.0])
        self.problem(self.service.post("/v1/rays", {"rays": [zero]}), 422, "/rays/0/direction")
        self.problem(self.service.post("/v1/rays", {"rays": [ray], "sun": {"direction": [0, 0, 0]}}), 422, "/sun/direction")
        for origin in ([0.0, 0.0, 0.0], [DENORMAL, 0.0, 0.0], [1e12, 0.0, 0.0]):
            status = self.answered(self.service.post("/v1/rays", {"rays": [dict(ray, origin_m=origin)]}))
            self.assertEqual(status, 200)


if __name__ == "__main__":
    harness.main()
