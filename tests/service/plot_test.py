#!/usr/bin/env python3
"""deploy/plot draws what the three verify commands write, and says what is wrong with any other folder."""

import json
import os
import shutil
import subprocess
import unittest
import xml.etree.ElementTree

import numpy as np
import PIL.Image

import harness
from harness import tearDownModule

PLOT = os.path.join(harness.REPOSITORY, "deploy", "plot")


def setUpModule():
    harness.set_up()
    harness.sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "64")


def plot(folder, *options):
    return subprocess.run([PLOT, *options, folder], capture_output=True, text=True, timeout=harness.PATIENCE_S)


class PlotTest(unittest.TestCase):
    def verify(self, what, *options):
        folder = harness.path(what)
        if not os.path.isdir(folder):
            done = harness.run("verify", what, *options, "-o", folder)
            self.assertEqual(done.returncode, 0, done.stderr)
        return folder

    def round_trip(self):
        return self.verify("roundtrip", "--dem", harness.path("dem"), "--cache-dir", harness.path("cache"),
                           "--center", "0.5,29.5", "--posts", "40")

    def drawn(self, folder, *names):
        """The pictures as arrays, after checks that all must pass."""
        done = plot(folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(done.stdout.split(), [os.path.join(folder, name) for name in names])
        pictures = []
        for name in names:
            with PIL.Image.open(os.path.join(folder, name)) as image:
                pictures.append(np.asarray(image.convert("RGB"), np.int16))
            height, width, _ = pictures[-1].shape
            self.assertEqual(width, 1520, name)
            self.assertTrue(600 < height < 1000, (name, height))
            # Something in each third, and mostly paper.
            for third in np.array_split(pictures[-1], 3, axis=1):
                self.assertGreater((third.min(2) < 128).mean(), 0.005, name)
            self.assertGreater((pictures[-1].min(2) > 240).mean(), 0.3, name)
        return pictures

    def test_round_trip_has_both_signs(self):
        exact, camera = self.drawn(self.round_trip(), "exact/difference.png", "camera/difference.png")
        self.assertFalse(np.array_equal(exact, camera))
        red, blue = camera[..., 0] - camera[..., 2] > 80, camera[..., 2] - camera[..., 0] > 80
        self.assertGreater(red.mean(), 0.003)
        self.assertGreater(blue.mean(), 0.003)

    def test_accuracy_has_a_colour_for_each_scene(self):
        folder = self.verify("accuracy", "--dem", harness.path("dem"), "--center", "0.1,30.1", "--size-px", "32",
                             "--repetitions", "1", "--reference-samples", "4", "--cache-dir", harness.path("cache"),
                             "--log-level", "error")
        picture, = self.drawn(folder, "accuracy.png")
        for colour in ((0, 0x72, 0xB2), (0xD5, 0x5E, 0), (0, 0x9E, 0x73), (0xCC, 0x79, 0xA7)):
            self.assertGreater((np.abs(picture - colour).max(2) < 8).sum(), 200, colour)

    def test_mertis_in_every_format(self):
        folder = self.verify("mertis")
        self.drawn(folder, "mertis.png")
        self.assertEqual(plot(folder, "--format", "svg").returncode, 0)
        with open(os.path.join(folder, "mertis.svg"), "rb") as file:
            first = file.read()
        texts = "".join(xml.etree.ElementTree.fromstring(first).itertext())
        for words in ("blackbody of 350 K", "wavelength, µm", "signal-to-noise ratio"):
            self.assertIn(words, texts)
        self.assertEqual(plot(folder, "--format", "svg").returncode, 0)
        with open(os.path.join(folder, "mertis.svg"), "rb") as file:
            self.assertEqual(file.read(), first)
        self.assertEqual(plot(folder, "--format", "pdf").returncode, 0)
        with open(os.path.join(folder, "mertis.pdf"), "rb") as file:
            self.assertEqual(file.read(5), b"%PDF-")

    def refused(self, folder, words):
        done = plot(folder)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertNotIn("Traceback", done.stderr)
        last = done.stderr.splitlines()[-1]  # before it Matplotlib may tell that it looks for fonts
        self.assertTrue(last.startswith(f"deploy/plot: {folder}: "), done.stderr)
        self.assertIn(words, last)

    def test_illumination_draws_the_series(self):
        folder = harness.path("season")
        os.makedirs(folder)
        places = [{"lat_deg": 0.5, "lon_deg": 29.5}, {"lat_deg": 0.6, "lon_deg": 29.2}]
        request = {"places": places, "from_utc": "2026-11-20T00:00:00Z", "to_utc": "2027-01-20T00:00:00Z", "step_s": 14400,
                   "horizon": {"azimuths": 36, "farthest_km": 20}}
        with open(os.path.join(folder, "request.json"), "w") as file:
            json.dump(request, file)
        done = harness.run("ask", "illumination", os.path.join(folder, "request.json"), "-o",
                           os.path.join(folder, "illumination.csv"), "--dem", harness.path("dem"), "--cache-dir", harness.path("cache"))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.drawn(folder, "illumination.png")

    def test_invalid_results_are_refused(self):
        self.refused(harness.path("nowhere"), "no such folder")
        self.refused(harness.path("dem"), "nothing that `selenograph verify` or `ask illumination` writes")
        source = os.path.join(self.round_trip(), "camera")
        broken = harness.path("broken")
        os.mkdir(broken)
        for name in ("statistics.json", "difference.tif"):
            shutil.copy(os.path.join(source, name), broken)
        with open(os.path.join(broken, "statistics.json")) as file:
            facts = json.load(file)
        for change, words in (({"window": dict(facts["window"], rows=7)}, "not of the same run"),
                              ({"histogram": {}}, "'to_m' is missing")):
            with open(os.path.join(broken, "statistics.json"), "w") as file:
                json.dump(dict(facts, **change), file)
            self.refused(broken, words)
        with open(os.path.join(broken, "statistics.json"), "w") as file:
            file.write("{")
        self.refused(broken, "Expecting")
        shutil.copy(os.path.join(source, "statistics.json"), broken)
        with open(os.path.join(broken, "difference.tif"), "wb") as file:
            file.write(b"no TIFF")
        self.refused(broken, "cannot identify image file")
        os.mkdir(harness.path("list"))
        harness.write("list/mertis.json", [])
        self.refused(harness.path("list"), "not of the form that `selenograph verify` writes")


if __name__ == "__main__":
    harness.main()
