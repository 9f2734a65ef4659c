#!/usr/bin/env python3
"""The Moon in absolute units: frames of the preset, maps of radiance factors, tests/verify/moon.py, real
images.

The last two are skipped without SciPy (deploy/install-packages verify)."""

import csv
import json
import os
import subprocess
import sys
import unittest

import numpy as np

import harness
from harness import frame_request, tearDownModule

try:
    import scipy  # noqa: F401
    MISSING = None
except ImportError as error:
    MISSING = f"{error}: deploy/install-packages verify"

PROGRAM = os.path.join(harness.REPOSITORY, "tests", "verify", "moon.py")
BAND = {"center_um": 0.675, "width_um": 0.02}


def setUpModule():
    harness.set_up()
    MoonTest.service = harness.service_with_assets()


def moon_kit():
    """An assets folder with the map of the CGI Moon Kit, from the shared data."""
    os.makedirs(harness.path("moon-assets", "maps"), exist_ok=True)
    harness.write("moon-assets/maps/kit.json", {
        "file": os.path.abspath(os.path.join(harness.shared_data("albedo"), "lunar_surface.jpg")), "bands": [1],
        "extent": {"south_deg": -90, "north_deg": 90, "west_deg": -180, "east_deg": 180},
        "scale": 0.24 / 255 / 0.935, "offset": 0.16 / 0.935, "exponent": 2.8, "quantity": "radiance_factor",
        "incidence_deg": 60, "emission_deg": 0, "phase_deg": 60, "wavelength_um": 0.665})
    return harness.path("moon-assets")


class MoonTest(unittest.TestCase):
    def frame(self, products=("radiance", "angles", "lit"), **changes):
        return self.service.arrays(frame_request(list(products), **changes))

    def refusal(self, **changes):
        status, _, body = self.service.frame(frame_request(["radiance"], **changes))
        self.assertEqual(status, 422, body[:300])
        return [(e["pointer"], e["detail"]) for e in json.loads(body)["errors"]]

    def test_a_resolved_request_gives_the_same_frame(self):
        for preset in ("moon", "moon-mare", "sato2014"):
            first = self.frame(surface={"preset": preset}, band=BAND)
            second = self.service.arrays(first["meta"]["request"])
            self.assertTrue(np.array_equal(first["radiance"], second["radiance"]), preset)

    def test_what_is_extrapolated_is_said(self):
        far = self.frame(surface={"preset": "moon"}, band={"center_um": 3.5, "width_um": 0.5})["meta"]
        self.assertTrue(any("beyond 0.35 to 2.5 um" in w for w in far["warnings"]), far["warnings"])
        self.assertAlmostEqual(far["reflectance"]["extrapolated_sunlight"], 1)
        back = self.frame(surface={"preset": "moon"}, band=BAND, sun={"local": {
            "lat_deg": 0.5, "lon_deg": 30.0, "azimuth_deg": 90, "elevation_deg": 89.9}})["meta"]
        self.assertLess(back["reflectance"]["phase_deg"][0], 2)
        self.assertTrue(any("phase angles in view" in w for w in back["warnings"]), back["warnings"])

    def test_wavelengths_that_sato_did_not_measure_are_said(self):
        for preset, band, words in (("sato2014", {"center_um": 1.0, "width_um": 0.1}, "band's center is beyond 0.321"),
                                    ("sato2014-mare", None, "without a band"),
                                    ("moon-mare", {"center_um": 1.0, "width_um": 0.1}, "ratio to the mean Moon"),
                                    ("sato2014", BAND, None), ("moon-highlands", BAND, None),
                                    ("moon", {"center_um": 1.0, "width_um": 0.1}, None)):
            changes = {"surface": {"preset": preset}, **({"band": band} if band else {})}
            warnings = self.frame(**changes)["meta"]["warnings"]
            said = [w for w in warnings if "Sato" in w]
            self.assertEqual(len(said), 1 if words else 0, (preset, band, warnings))
            if words:
                self.assertIn(words, said[0])

    def test_maps_that_do_not_fit_are_refused_by_name(self):
        (pointer, detail), = self.refusal(surface={"preset": "moon", "albedo_maps": ["made-up-albedo"]})
        self.assertEqual(pointer, "/surface/albedo_maps")
        self.assertIn("maps/made-up-albedo.json", detail)
        self.assertIn("radiance_factor", detail)


@unittest.skipIf(MISSING, MISSING)
class Comparison(unittest.TestCase):
    def compare(self, *options, status=0):
        folder = harness.path("moon")
        less = () if harness.full_effort() else ("--phases-of-table",)
        done = subprocess.run([sys.executable, PROGRAM, "-o", folder, *less, *options], capture_output=True, text=True,
                              timeout=harness.PATIENCE_S * 5)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return folder, done

    def discs(self, folder):
        """The rows of disc.csv, after checks of those of the sphere."""
        with open(os.path.join(folder, "disc.csv")) as file:
            rows = list(csv.DictReader(file))
        self.assertEqual(list(rows[0])[:6], ["preset", "wavelength_um", "phase_deg", "reflectance", "rolo", "lime"])
        moon = [row for row in rows if row["preset"] == "moon" and row["lime"] and row["ground"] == "sphere" and
                0.4399 < float(row["wavelength_um"]) < 1.6401 and float(row["phase_deg"]) >= 5]
        self.assertGreater(len(moon), 100)
        worst = max(abs(float(row["reflectance"]) / float(row["lime"]) - 1) for row in moon)
        self.assertLess(worst, 0.002)
        with open(os.path.join(folder, "moon.md")) as file:
            self.assertRegex(file.read(), r"\| moon \| 0.999 to 1.000 \| 1.000 \|")  # 2 degrees: LIME's end
        return rows

    def test_what_is_missing_is_named(self):
        dem = ("--dem", harness.path("dem"), "--cache-dir", harness.path("cache"), "--size-px", "32")
        os.makedirs(harness.path("no-views"))
        harness.write("no-views/views.json", {})
        for options, words in ((("--images", harness.path("no-views")), "need --dem"),
                               (("--albedo-maps", "kit"), "need --dem"), (("--detail", "mare"), "needs --center"),
                               ((*dem, "--center", "60,-100"), "--center 60,-100: there is no terrain"),
                               ((*dem, "--center", "60"), "--center 60: must be"),
                               ((*dem, "--images", harness.path("no-views")), "names no image")):
            _, done = self.compare(*options, status=2)
            self.assertIn(words, done.stderr, options)

    def test_bounds_fail_on_a_wrong_preset_and_a_control_within_them(self):
        sys.path.insert(0, os.path.dirname(PROGRAM))
        import moon
        row = {"wavelength_um": 0.675, "phase_deg": 30, "lime": 0.0673, "ground": "sphere"}
        right, mare = {**row, "reflectance": 0.0673}, {**row, "reflectance": 0.0459}
        rows = [{**right, "preset": "moon"}, {**mare, "preset": "moon-mare"}]
        self.assertEqual(moon.violations(rows, [], []), [])
        self.assertIn("of LIME", *moon.violations([{**mare, "preset": "moon"}], [], []))
        self.assertIn("must not be", *moon.violations([{**right, "preset": "moon-mare"}], [], []))
        image = {"image": "a", "channel": "VIS006", "correlation": 0.997, "scale": 1, "limb_px": 0}
        self.assertEqual(moon.violations([], [image], [0.9]), [])
        for change, control, words in (({}, 0.996, "moved by a pixel"), ({"correlation": np.nan}, 0.9, "correlation"),
                                       ({"scale": 1.2}, 0.9, "scale"), ({"limb_px": -0.2}, 0.9, "limb")):
            self.assertIn(words, *moon.violations([], [{**image, **change}], [control]))

    def test_the_disc_is_limes_and_real_images_are_like_frames(self):
        if not all(map(harness.shared_data, ("images", "albedo", "global"))):
            self.discs(self.compare()[0])
            self.skipTest("the images of the Moon are not beside the project (shared/data/images)")
        folder, _ = self.compare("--dem", harness.shared_data("global"), "--assets-dir", moon_kit(), "--albedo-maps",
                                 "kit", "--size-px", "32", "--images", harness.shared_data("images"), "--cache-dir",
                                 harness.path("cache"))
        rows = self.discs(folder)
        with open(os.path.join(folder, "images.csv")) as file:
            images = list(csv.DictReader(file))
        self.assertEqual(len(images), 9)
        for row in images:
            visible = row["channel"] != "NIR016"
            self.assertGreater(float(row["correlation"]), 0.995 if visible else 0.985, row)
            self.assertLess(abs(float(row["scale"]) - 1), 0.1, row)
        for channel in ("VIS006", "VIS008", "NIR016"):
            scales = [float(row["scale"]) for row in images if row["channel"] == channel]
            self.assertLess(max(scales) / min(scales), 1.02, channel)
        # Waxing and waning together, as LIME's own.
        sums = {}
        for row in rows:
            if row["ground"] == "terrain":
                at = sums.setdefault((row["wavelength_um"], abs(float(row["phase_deg"]))), [0, 0])
                at[0] += float(row["reflectance"])
                at[1] += float(row["lime"])
        self.assertEqual(len(sums), 9)
        for at, (ours, lime) in sums.items():
            self.assertLess(abs(ours / lime - 1), 0.03, at)


if __name__ == "__main__":
    harness.main()
