#!/usr/bin/env python3
"""tests/verify/photographs.py: views fitted and measured on frames with a film's tone curve and grain, on real
photographs where the shared data are, and views written by deploy/photograph-view.

The comparisons are skipped where OpenCV or SciPy are missing (deploy/install-packages verify)."""

import csv
import json
import os
import subprocess
import sys
import unittest

import numpy as np

import harness
from harness import tearDownModule

try:
    import cv2  # noqa: F401
    import scipy  # noqa: F401
    MISSING = None
except ImportError as error:
    MISSING = f"{error}: deploy/install-packages verify"

SIZE = 256
PROGRAM = os.path.join(harness.REPOSITORY, "tests", "verify", "photographs.py")
CONVERTER = os.path.join(harness.REPOSITORY, "deploy", "photograph-view")
REQUEST = {
    "camera": {"model": "pinhole", "width": SIZE, "height": SIZE, "fx": 300.0, "fy": 300.0, "cx": 127.5, "cy": 127.5},
    "pose": {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 60000.0}, "nadir": {"up_azimuth_deg": 20.0}},
    "sun": {"local": {"lat_deg": 0.1, "lon_deg": 30.1, "azimuth_deg": 80.0, "elevation_deg": 12.0},
            "angular_radius_deg": "sun"},
    "surface": {"preset": "moon"},
}


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "256")


def dem(*folders):
    options = [word for folder in folders or (harness.path("dem"),) for word in ("--dem", folder)]
    return (*options, "--cache-dir", harness.path("cache"))


def compare(*options):
    """tests/verify/photographs.py, to its end."""
    return subprocess.run([sys.executable, PROGRAM, *options], capture_output=True, text=True,
                          timeout=harness.PATIENCE_S * 5)


def turned(matrix, x_rad, y_rad):
    """A camera turned by small angles about its own axes."""
    x, y = (np.array([[1, 0, 0], [0, np.cos(x_rad), -np.sin(x_rad)], [0, np.sin(x_rad), np.cos(x_rad)]]),
            np.array([[np.cos(y_rad), 0, np.sin(y_rad)], [0, 1, 0], [-np.sin(y_rad), 0, np.cos(y_rad)]]))
    return x @ y @ np.array(matrix)


def rows_of(folder):
    with open(os.path.join(folder, "photographs.csv"), newline="") as file:
        return {(row["photograph"], row["measure"]):
                {key: float(row[key]) for key in ("low", "high", "value", "wrong_sun")} for row in csv.DictReader(file)}


@unittest.skipIf(MISSING, MISSING)
class Photographs(unittest.TestCase):
    """A "photograph" that the engine made: its view is known, its tone curve and grain are ours."""

    @classmethod
    def setUpClass(cls):
        cls.service = harness.Service()
        arrays = cls.service.arrays({**REQUEST, "products": ["radiance"], "accuracy": {"samples_per_pixel": 4}})
        radiance, meta = arrays["radiance"].astype(float), arrays["meta"]
        film = 255 * np.minimum(1, radiance / np.quantile(radiance, 0.995)) ** 0.6
        film += np.random.default_rng(1).normal(0, 2, film.shape)
        cls.images = harness.path("images")
        os.makedirs(cls.images)
        np.save(os.path.join(cls.images, "made.npy"), np.clip(np.round(film), 0, 255).astype(np.uint8))
        w, x, y, z = (meta["request"]["pose"]["camera_from_moon"][key] for key in "wxyz")
        cls.position_m = meta["request"]["pose"]["position_m"]
        cls.true = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                             [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                             [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])

    def view(self, matrix, **more):
        pose = {"position_m": self.position_m, "camera_from_moon_matrix": np.asarray(matrix).tolist()}
        return {"made": {"image": "made.npy", "request": {**REQUEST, "pose": pose}, **more}}

    def verify(self, views, *options, name="out"):
        folder = harness.path(name)
        return folder, compare("--images", self.images, "--views", harness.write("views.json", views), "-o", folder,
                               *options, *dem())

    def test_the_true_view_is_within_all_bounds_and_a_wrong_sun_within_none(self):
        folder, done = self.verify(self.view(self.true))
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        rows = rows_of(folder)
        self.assertEqual([measure.split(",")[0].split(" ")[0] for _, measure in rows],
                         ["ties", "tone", "tone", "shadow", "shadow", "shadow"])
        for measure, row in rows.items():
            self.assertTrue(row["low"] <= row["value"] <= row["high"], (measure, row))
            self.assertFalse(row["low"] <= row["wrong_sun"] <= row["high"], (measure, row))
        self.assertLess(rows["made", "ties held out, RMS, px"]["value"], 0.1)
        self.assertGreater(rows["made", "tone"]["value"], 0.98)
        for panel in ("photograph", "frame", "difference", "shadows"):
            self.assertTrue(os.path.isfile(os.path.join(folder, f"made.{panel}.png")), panel)

    def test_a_shifted_picture_misses_its_bounds(self):
        image = np.load(os.path.join(self.images, "made.npy"))
        np.save(os.path.join(self.images, "shifted.npy"), np.roll(image, 1, axis=1))
        folder, done = self.verify({"made": {**self.view(self.true)["made"], "image": "shifted.npy"}})
        self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
        self.assertAlmostEqual(rows_of(folder)["made", "ties held out, RMS, px"]["value"], 1, delta=0.1)
        self.assertIn("beyond its bound: made: ties held out", done.stdout)

    def test_the_fit_finds_a_view_that_is_off_by_pixels(self):
        """By 4 pixels to the right and 3 down: turns of 4/300 and 3/300."""
        off = self.view(turned(self.true, -3 / 300, 4 / 300), free=[])
        folder, done = self.verify(off)
        self.assertEqual(done.returncode, 1, done.stdout)
        self.assertGreater(rows_of(folder)["made", "ties held out, RMS, px"]["value"], 3)
        folder, done = self.verify(off, "--fit", name="fit")
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(os.path.join(folder, "views.json")) as file:
            fitted = json.load(file)["made"]
        self.assertGreater(fitted["tie_points"], 30)
        self.assertLess(fitted["residual_px_rms"], 0.1)
        left = np.array(fitted["request"]["pose"]["camera_from_moon_matrix"]) @ self.true.T
        self.assertLess(300 * np.abs([left[0, 2], left[1, 2]]).max(), 0.05)  # px at the image's middle
        self.assertLess(128 * abs(left[0, 1]), 0.1)  # px at its borders, by roll

    def test_radiance_keeps_its_scale(self):
        request = {**self.view(self.true)["made"]["request"], "band": {"center_um": 0.6, "width_um": 0.2}}
        radiance = self.service.arrays({**request, "products": ["radiance"]})["radiance"]
        np.save(os.path.join(self.images, "strip.npy"), 1.1 * radiance[100:104] / 0.2)
        camera = {**request["camera"], "height": 4, "cy": 127.5 - 100}
        views = {"strip": {"image": "strip.npy", "unit": "W m-2 sr-1 um-1", "request": {**request, "camera": camera}}}
        folder, done = self.verify(views)
        rows = rows_of(folder)
        self.assertEqual(list(rows), [("strip", "radiance, photograph / frame")])
        self.assertAlmostEqual(rows["strip", "radiance, photograph / frame"]["value"], 1.1, delta=0.02)

    def test_what_is_wrong_is_named(self):
        view = self.view(self.true)["made"]
        far = {**view["request"], "pose": {"geodetic": {"lat_deg": 40, "lon_deg": 30, "height_m": 60000}, "nadir": {}}}
        small = {**view["request"], "camera": {**REQUEST["camera"], "width": 200}}
        holed = np.load(os.path.join(self.images, "made.npy")).astype(float)
        holed[10, 10] = np.nan
        np.save(os.path.join(self.images, "holed.npy"), holed)
        for views, words in (({}, "a view per photograph"), ({"a": {"image": "made.npy"}}, 'needs "image"'),
                             ({"a": {**view, "images": 1}}, "unknown member images"),
                             ({"a": {**view, "free": ["zoom"]}}, '"free" must list'),
                             ({"a": {**view, "request": small}}, "has 200 x 256 pixels, the image 256 x 256"),
                             ({"a": {**view, "request": {**view["request"], "suns": 1}}}, "/suns"),
                             ({"a": {**view, "image": "none.png"}}, "none.png"),
                             ({"a": {**view, "unit": "DN"}}, '"unit"'),
                             ({"a": {**view, "image": "holed.npy"}}, "pixels without a value"),
                             ({"a": {**view, "request": far}}, "a: no terrain in 100 % of the image")):
            _, done = self.verify(views)
            self.assertEqual(done.returncode, 2, (words, done.stdout))
            self.assertIn(words, done.stderr)

    def test_real_photographs(self):
        images, hadley, albedo = (harness.shared_data(name) for name in ("resolved", "hadley", "albedo"))
        if not (images and hadley and albedo):
            self.skipTest("the shared data are not here: resolved, hadley, albedo")
        os.makedirs(harness.path("assets", "maps"), exist_ok=True)
        harness.write("assets/maps/moonkit.json", {
            "file": os.path.abspath(os.path.join(albedo, "lunar_surface.jpg")), "bands": [1],
            "extent": {"south_deg": -90, "north_deg": 90, "west_deg": -180, "east_deg": 180},
            "scale": 0.0010066072, "offset": 0.171122995, "exponent": 2.8, "quantity": "radiance_factor",
            "incidence_deg": 60, "emission_deg": 0, "phase_deg": 60, "wavelength_um": 0.665})
        with open(os.path.join(harness.REPOSITORY, "engine", "verify", "photographs.json")) as file:
            views = {name: view for name, view in json.load(file).items()
                     if name in harness.share(("AS15-M-0414", "AS15-M-1134"), 2)}
        folder = harness.path("real")
        done = compare("--images", images, "--views", harness.write("real.json", views), "-o", folder, "--assets-dir",
                       harness.path("assets"), *dem(hadley))
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        with open(os.path.join(harness.REPOSITORY, "engine", "verify", "photographs.md")) as file:
            page = file.read()
        for line in done.stdout.splitlines():
            if line.startswith("| "):
                self.assertIn(line, page)


class Converter(unittest.TestCase):
    def converted(self, command, text, *options):
        source = harness.write("input", text)
        out = harness.path("converted.json")
        if os.path.exists(out):
            os.remove(out)
        done = subprocess.run([CONVERTER, command, source, "--name", "a", "--image", "a.cub", *options, "-o", out],
                              capture_output=True, text=True)
        if done.returncode != 0:
            return done, None
        with open(out) as file:
            return done, json.load(file)["a"]

    # Camera axes of the test: neither along the body's nor along the pixels', as in ISIS.
    PIXELS = [(1, 1), (404, 1), (1, 404), (404, 404), (202.5, 202.5)]

    def campt(self, moved_km=0.0, pixels=PIXELS):
        """Groups as Isis::campt writes them (USGS-Astrogeology/ISIS3, isis/src/base/apps/campt), with half a turn
        between ISIS' camera axes and the image's."""
        rotation = turned(turned(np.eye(3), 2.9, 0.3), 0.1, -0.7)
        isis_axes = np.diag([-1.0, -1.0, 1.0])
        text = ""
        for k, (sample, line) in enumerate(pixels):
            look = np.array([(sample - 1 - 200) / 268, (line - 1 - 203) / 270, 1])
            look /= np.linalg.norm(look)
            body, camera = rotation.T @ look, isis_axes @ look
            vector = lambda v: f"({v[0]:.14f}, {v[1]:.14f},\n                                {v[2]:.14f})"
            text += (f"Group = GroundPoint\n  Filename                   = /data/AS15-M-0414.cub\n"
                     f"  Sample                     = {sample}\n  Line                       = {line}\n"
                     f"  PixelValue                 = 118.0\n\n  # Spacecraft Information\n"
                     f"  SpacecraftPosition         = ({1651.4 + k * moved_km}, 98.2,\n      803.8) <km>\n"
                     f"  SpacecraftAzimuth          = 90.0 <DEGREE>\n\n  # Sun Information\n"
                     f"  SunPosition                = (30000000.0, 148000000.0, 600000.0) <km>\n"
                     f"  SolarDistance              = 1.0095 <AU>\n"
                     f"  LookDirectionBodyFixed     = {vector(body)}\n  LookDirectionJ2000         = (1.0, 0.0, 0.0)\n"
                     f"  LookDirectionCamera        = {vector(camera)}\nEnd_Group\n")
        return text + "End\n", rotation

    def test_campt(self):
        text, rotation = self.campt()
        done, view = self.converted("campt", text, "--size", "404", "404")
        self.assertEqual(done.returncode, 0, done.stderr)
        camera = view["request"]["camera"]
        for member, value in {"fx": 268, "fy": 270, "cx": 200, "cy": 203, "width": 404, "height": 404}.items():
            self.assertAlmostEqual(camera[member], value, delta=1e-6)
        np.testing.assert_allclose(view["request"]["pose"]["camera_from_moon_matrix"], rotation, atol=1e-9)
        np.testing.assert_allclose(view["request"]["pose"]["position_m"], [1651400, 98200, 803800])
        sun = np.array([30000000.0, 148000000.0, 600000.0])
        np.testing.assert_allclose(view["request"]["sun"]["direction"], sun / np.linalg.norm(sun))
        self.assertAlmostEqual(view["request"]["sun"]["distance_au"], np.linalg.norm(sun) * 1000 / 149597870700.0)

    def test_a_pose_from_spice(self):
        facts = {"frame": "MOON_ME", "camera": {"model": "pinhole", "width": 8, "height": 8, "fov_deg": 40},
                 "position_km": [1800, 0, 0], "camera_from_body": np.eye(3).tolist(), "sun_km": [0, 1.5e8, 0]}
        done, view = self.converted("pose", json.dumps(facts))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(view["request"]["pose"],
                         {"position_m": [1.8e6, 0, 0], "camera_from_moon_matrix": np.eye(3).tolist()})
        for change, words in (({"frame": "IAU_MOON"}, "must be MOON_ME"), ({"sun_km": None}, None)):
            wrong = {key: value for key, value in {**facts, **change}.items() if value is not None}
            done, _ = self.converted("pose", json.dumps(wrong))
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(words or 'no "sun_km"', done.stderr)

    def test_points_that_give_no_camera(self):
        text, _ = self.campt()
        for wrong, words in ((self.campt(moved_km=0.1)[0], "not a framing camera"),
                             (self.campt(pixels=[(1, 1), (2, 2), (3, 3)])[0], "lie on a line"),
                             ("Group = Other\nEnd_Group\n", "0 groups GroundPoint"),
                             (text.replace("(30000000.0, 148000000.0, 600000.0) <km>", "(NULL, NULL, NULL)"),
                              "not numbers")):
            done, _ = self.converted("campt", wrong, "--size", "404", "404")
            self.assertNotEqual(done.returncode, 0, words)
            self.assertIn(words, done.stderr)


if __name__ == "__main__":
    harness.main()
