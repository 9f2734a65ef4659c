#!/usr/bin/env python3
"""What frames say about their view: its place in words of the ground, what is probably wrong with it, and the echo."""

import json
import math
import unittest

import numpy as np

import harness
from harness import frame_request, sample, tearDownModule

MOON_M = 1737400.0
LAT, LON = -0.5, 30.5


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    View.service = harness.Service()


def nadir(lat_deg=LAT, lon_deg=LON, height_m=20000.0, up_azimuth_deg=0.0):
    return {"geodetic": {"lat_deg": lat_deg, "lon_deg": lon_deg, "height_m": height_m},
            "nadir": {"up_azimuth_deg": up_azimuth_deg}}


def looking(position_m, boresight, up):
    """camera_from_moon as a matrix: rows are the camera's axes."""
    z = np.asarray(boresight, float) / np.linalg.norm(boresight)
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    return {"position_m": list(position_m), "camera_from_moon_matrix": [x.tolist(), np.cross(z, x).tolist(), z.tolist()]}


def quaternion(matrix):
    """w, x, y, z of a rotation matrix whose trace isn't -1."""
    m = np.asarray(matrix)
    w = math.sqrt(max(0.0, 1 + np.trace(m))) / 2
    return [w, (m[2, 1] - m[1, 2]) / (4 * w), (m[0, 2] - m[2, 0]) / (4 * w), (m[1, 0] - m[0, 1]) / (4 * w)]


def cartesian(lat_deg, lon_deg, height_m):
    lat, lon = math.radians(lat_deg), math.radians(lon_deg)
    return (MOON_M + height_m) * np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])


class View(unittest.TestCase):
    def ask(self, pose, products=("radiance", "geodetic"), **changes):
        request = frame_request(products, pose=pose, **changes)
        f = self.service.arrays(request)
        return f, f["meta"], f["headers"]

    def test_the_places_are_those_that_the_pixels_see(self):
        for tilt in (0.0, 30.0):
            for changes in ({}, {"visibility": "raytrace"}, {"samples": 4}):
                there = cartesian(LAT, LON, 20000.0)
                up = there / np.linalg.norm(there)
                north = np.array([0, 0, 1.0]) - up[2] * up
                boresight = -math.cos(math.radians(tilt)) * up + math.sin(math.radians(tilt)) * north / np.linalg.norm(north)
                pose = looking(there, boresight, north)
                # An odd size: the boresight is the middle pixel's centre.
                arrays, meta, _ = self.ask(pose, width=65, height=49, **changes)
                view, ground = meta["view"], arrays["geodetic"]
                middle = ground[24, 32]
                with self.subTest(tilt=tilt, **changes):
                    self.assertAlmostEqual(view["off_nadir_deg"], tilt, 9)
                    self.assertAlmostEqual(view["lat_deg"], middle[0], 9)
                    self.assertAlmostEqual(view["lon_deg"], middle[1], 9)
                    self.assertAlmostEqual(view["height_m"], middle[2], 4)
                    self.assertAlmostEqual((view["up_azimuth_deg"] + 180) % 360, 180, 1)
                    for corner, pixel in zip(view["corners"], ((0, 0), (0, 64), (48, 64), (48, 0))):
                        self.assertAlmostEqual(corner["lat_deg"], ground[pixel][0], 9)
                        self.assertAlmostEqual(corner["lon_deg"], ground[pixel][1], 9)
                    self.assertEqual(meta["warnings"], [])

    def test_without_geometry_the_places_are_the_same(self):
        views = [self.ask(nadir(), products, samples=samples)[1]["view"]
                 for products, samples in ((("radiance",), 1), (("radiance",), 4), (("geodetic", "lit"), 1))]
        for view in views[1:]:
            for name in ("lat_deg", "lon_deg"):
                self.assertAlmostEqual(view[name], views[0][name], 6)
            self.assertAlmostEqual(view["height_m"], views[0]["height_m"], 4)
            self.assertAlmostEqual(view["post_px"], views[0]["post_px"], 6)

    def test_azimuths_and_sizes_follow_their_definitions(self):
        sun = {"local": {"lat_deg": LAT, "lon_deg": LON, "azimuth_deg": 80.0, "elevation_deg": 15.0}}
        for up in (0.0, 90.0, 215.0):
            _, meta, _ = self.ask(nadir(up_azimuth_deg=up), sun=sun)
            view = meta["view"]
            self.assertAlmostEqual(view["off_nadir_deg"], 0, 6)
            self.assertAlmostEqual((view["up_azimuth_deg"] - up + 180) % 360, 180, 6)
            self.assertTrue(0 <= view["up_azimuth_deg"] < 360)
            self.assertAlmostEqual(view["sun"]["azimuth_deg"], 80, 2)
            self.assertAlmostEqual(view["sun"]["elevation_deg"], 15, 2)
            # Posts of 1/256 degree, a pixel's angle at the boresight.
            camera = meta["request"]["camera"]
            post_m = math.radians(1 / 256) * MOON_M
            self.assertAlmostEqual(view["post_px"], post_m * camera["fx"] / (20000.0 - view["height_m"]), 3)

    def test_a_crop_beside_the_boresight_has_corners_alone(self):
        camera = {"width": 64, "height": 48, "fx": 100.0, "cx": 200.0, "cy": 24.0}
        _, meta, _ = self.ask(nadir(), camera=camera)
        view = meta["view"]
        self.assertIsNone(view["lat_deg"])
        self.assertIsNone(view["up_azimuth_deg"])
        self.assertTrue(all(view["corners"]))

    def warned(self, pose, **changes):
        _, meta, _ = self.ask(pose, **changes)
        return " | ".join(meta["warnings"])

    def test_usual_mistakes_are_named(self):
        there = cartesian(LAT, LON, 20000.0)
        # South up: the inverse of this attitude looks away from the Moon.
        right = looking(there, -there, np.array([0, 0, -1.0]))
        matrix = np.array(right["camera_from_moon_matrix"])
        self.assertEqual(self.warned(right), "")
        position = right["position_m"]
        w, x, y, z = quaternion(matrix)

        def given(a, b, c, d, name="camera_from_moon"):
            return {"position_m": position, name: {"w": a, "x": b, "y": c, "z": d}}

        self.assertEqual(self.warned(given(w, x, y, z)), "")
        self.assertIn("inverse", self.warned(given(w, -x, -y, -z)))
        self.assertIn("inverse", self.warned(given(w, x, y, z, "moon_from_camera")))
        opengl = np.diag([1.0, -1.0, -1.0]) @ matrix
        self.assertIn("OpenGL", self.warned({"position_m": position, "camera_from_moon_matrix": opengl.tolist()}))
        self.assertIn("order x, y, z, w", self.warned(given(x, y, z, w)))
        self.assertIn("order w, x, y, z", self.warned(given(z, w, x, y)))
        # In millimetres the camera is farther away than the Moon's disc is large.
        self.assertIn("lengths are metres", self.warned({**right, "position_m": (1000 * there).tolist()}))

    def test_latitude_and_longitude_in_each_others_place(self):
        said = self.warned(nadir(lat_deg=LON, lon_deg=LAT))
        self.assertIn("without data", said)
        self.assertIn("are they swapped?", said)

    def test_radians_and_kilometres(self):
        self.assertIn("are they in radians?", self.warned(nadir(lat_deg=math.radians(LAT), lon_deg=math.radians(LON))))
        there = cartesian(LAT, LON, 20000.0)
        request = frame_request(["radiance"])
        request["pose"] = {"position_m": (there / 1000).tolist(), "nadir": {}}
        status, _, body = self.service.frame(request, "application/x-npz")
        self.assertEqual(status, 422)
        self.assertIn("are lengths in kilometres?", body.decode())

    def test_all_attitudes_that_see_the_moon_are_named(self):
        there = cartesian(LAT, LON, 20000.0)
        matrix = np.array(looking(there, -there, np.array([0, 0, -1.0]))["camera_from_moon_matrix"])
        opengl = np.diag([1.0, -1.0, -1.0]) @ matrix
        said = self.warned({"position_m": there.tolist(), "camera_from_moon_matrix": opengl.tolist()})
        first, *others = said.split(" Or: ")
        self.assertIn("OpenGL", first)
        self.assertTrue(others, said)
        self.assertRegex(first, r"[.?]$")

    def test_what_is_known_where_there_is_no_data(self):
        away = nadir(LAT + 20, LON, -20000.0)
        status, _, body = self.service.post("/v1/frames", frame_request(("radiance",), pose=away))
        self.assertEqual(status, 422, body)
        self.assertIn("-20000.000 m above the sphere; there are no data, but no ground of the Moon is below -12000.000 m",
                      json.loads(body)["detail"])
        camera = {"width": 64, "height": 64, "fov_deg": 30.0}
        sun = {"local": {"lat_deg": LAT, "lon_deg": LON + 5, "azimuth_deg": 0.0, "elevation_deg": 60.0}}
        points = [{"lat_deg": LAT, "lon_deg": LON + 5, "height_m": 9000.0}, {"lat_deg": LAT, "lon_deg": LON + 5}]
        status, _, body = self.service.post("/v1/project", {"camera": camera, "pose": nadir(LAT, LON + 5), "sun": sun, "points": points})
        self.assertEqual(status, 200, body)
        high, unknown = json.loads(body)["points"]
        self.assertEqual((high["visible"], high["lit"]), (True, 1.0))
        self.assertEqual((unknown["height_m"], unknown["lit"]), (None, None))

    def test_the_inverse_of_an_attitude_that_sees_the_limb(self):
        """A boresight in the sky and some ground in the image: the inverse is named where it clearly sees more ground."""
        there = cartesian(LAT, LON, 20000.0)
        up = there / np.linalg.norm(there)
        north = np.array([0, 0, 1.0]) - up[2] * up
        north /= np.linalg.norm(north)
        west = np.cross(up, north)
        for roll_deg, tilt_deg, named in ((30, 0, True), (60, 30, True), (180, 15, True), (60, 60, True),  # 2.4 times as much
                                          (210, 60, False), (150, 75, False), (30, 75, False)):  # 1.8 times or less
            roll, tilt = np.radians(roll_deg), np.radians(tilt_deg)
            boresight = -np.cos(tilt) * up + np.sin(tilt) * north
            right = looking(there, boresight, np.cos(roll) * (np.cos(tilt) * north + np.sin(tilt) * up) + np.sin(roll) * west)
            wrong = {"position_m": right["position_m"], "moon_from_camera_matrix": right["camera_from_moon_matrix"]}
            shares, texts = [], []
            for pose in (right, wrong):
                _, meta, _ = self.ask(pose, ("radiance",), camera={"width": 64, "height": 64, "fov_deg": 90.0})
                shares.append(meta["hit_fraction"] + meta["missing_fraction"])
                texts.append([w for w in meta["warnings"] if "the boresight is in the sky" in w])
            with self.subTest(roll_deg=roll_deg, tilt_deg=tilt_deg, shares=shares):
                self.assertTrue(0.05 < shares[1] < 0.6)
                self.assertIsNone(meta["view"]["sphere"], "the boresight is to be in the sky")
                self.assertEqual(texts[0], [], "the right attitude looks at the ground")
                self.assertEqual(len(texts[1]), int(named))
                if named:
                    self.assertIn("the inverse attitude would see the ground: is it the inverse", texts[1][0])

    def test_texts_of_warnings_are_constant(self):
        """Frames of a loop with the same trouble have the same text, so that it can be told once; numbers are data."""
        for changes in ([{"pose": nadir(lat_deg=lat, lon_deg=lon)} for lat, lon in ((LON, LAT), (LON + 0.1, LAT))],  # no data
                        [{"pose": nadir(), "sun": {"local": {"lat_deg": LAT, "lon_deg": LON, "azimuth_deg": 80.0,
                                                             "elevation_deg": up}}} for up in (-12.0, -15.0)],
                        [{"pose": looking(cartesian(LAT, LON, h), cartesian(LAT, LON + lon, 0), [0, 0, 1])}
                         for h, lon in ((20000.0, 0.0), (25000.0, 3.0))],  # away from the Moon
                        [{"pose": nadir(height_m=h)} for h in (800.0, 700.0)],
                        [{"pose": nadir(), "image": {"full_scale_radiance": s}} for s in (0.5, 0.6)],
                        [{"pose": nadir(), "band": {"center_um": c, "width_um": 100.0}} for c in (550.0, 650.0)]):
            texts = [self.ask(products=("image", "radiance"), **one)[1]["warnings"] for one in changes]
            self.assertTrue(texts[0], changes)
            self.assertEqual(texts[0], texts[1])

    def test_the_default_reflectance_in_absolute_units(self):
        band = {"band": {"center_um": 0.55, "width_um": 0.1}}
        full_scale = {"products": ("image",), "image": {"full_scale_radiance": 1000.0}}
        for changes, named in (({}, False), (band, True), (full_scale, True), (full_scale | {"surface": {"preset": "moon"}}, False),
                               (band | {"surface": {"reflectance": {"model": "lambert", "rho": 0.1}}}, False),
                               (band | {"products": ("geodetic",)}, False)):
            with self.subTest(**changes):
                self.assertEqual("the default reflectance" in self.warned(nadir(), **changes), named)

    def test_a_lens_that_images_little(self):
        """A circle of view of 63 pixels in radius, in 256 x 256; a polynomial that folds at 0.4 focal lengths; sound ones."""
        square = {"width": 256, "height": 256}
        folded = {"model": "brown_conrady", "k1": -2.0}
        for camera, words in ((square | {"model": "fisheye", "fx": 20.0}, "what the fisheye images"),
                              (square | {"model": "pinhole", "fov_deg": 90.0, "distortion": folded}, "a fold of the lens distortion"),
                              (square | {"model": "fisheye", "fov_deg": 180.0}, ""),
                              (square | {"model": "pinhole", "fov_deg": 20.0, "distortion": folded}, "")):
            warned = self.warned(nadir(), camera=camera)
            with self.subTest(**camera):
                self.assertIn(words, warned)
                self.assertEqual("most of the image is beyond" in warned, bool(words), warned)

    def test_posts_wider_than_eight_pixels(self):
        self.assertIn("pixels wide", self.warned(nadir(height_m=800.0)))
        self.assertNotIn("metres", self.warned(nadir(height_m=800.0)))
        low = {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_above_ground_m": 0.8}, "nadir": {}}  # km
        self.assertIn("heights are metres", self.warned(low))

    def test_an_image_too_wide_for_a_pinhole(self):
        for f, words in ((1.5, "spans 171 degrees"), (20.0, "")):
            warned = self.warned(nadir(), camera={"width": 40, "height": 30, "fx": f, "fy": f})
            self.assertIn(words, warned)
            self.assertEqual("image spans" in warned, bool(words), warned)


if __name__ == "__main__":
    harness.main()
