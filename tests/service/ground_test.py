#!/usr/bin/env python3
"""`selenograph verify ground`: its files, its bounds, its words."""

import csv
import json
import os
import unittest

import harness
from harness import run

ASSETS = os.path.join(harness.REPOSITORY, "deploy", "assets")


def setUpModule():
    harness.set_up()


def tearDownModule():
    harness.tear_down()


def rows_of(folder, name):
    with open(os.path.join(folder, name), newline="") as file:
        return list(csv.DictReader(file))


class Ground(unittest.TestCase):
    def test_a_mare(self):
        folder = harness.path("mare")
        done = run("verify", "ground", "--detail", "mare", "-o", folder, "--assets-dir", ASSETS)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        slopes = rows_of(folder, "slopes.csv")
        self.assertEqual(list(slopes[0])[:6],
                         ["baseline_m", "rms_deg", "median_deg", "hurst", "craters_share", "relief_share"])
        at_17_m = next(row for row in slopes if row["baseline_m"] == "17")
        self.assertAlmostEqual(float(at_17_m["published_median_deg"]), 2.0)
        self.assertAlmostEqual(float(at_17_m["median_deg"]), 2.0, delta=0.4)
        craters = rows_of(folder, "craters.csv")
        self.assertEqual(list(craters[0]), ["diameter_m", "law", "listed", "visible", "depth_over_diameter"])
        for row in craters:
            if 2 <= float(row["diameter_m"]) < 50:
                self.assertAlmostEqual(float(row["visible"]) / float(row["law"]), 1, delta=0.2, msg=row)
        self.assertIn("| mare: baseline, m |", done.stdout)
        albedo = rows_of(folder, "albedo.csv")
        self.assertEqual([row["pixel_m"] for row in albedo], ["0.25", "1", "10"])
        for row in albedo:
            self.assertAlmostEqual(float(row["mean"]), 1, delta=0.03)

    def test_beyond_its_bounds(self):
        """A preset that is rougher than what it names is told so, row by row."""
        os.makedirs(harness.path("assets", "details"))
        with open(os.path.join(ASSETS, "details", "mare.json")) as file:
            preset = json.load(file)
        preset["relief"]["deviation_m"] *= 4
        harness.write(os.path.join("assets", "details", "rough.json"), preset)
        done = run("verify", "ground", "--detail", "rough", "-o", harness.path("rough"), "--places", "10",
                   "--assets-dir", harness.path("assets"))
        self.assertEqual(done.returncode, 1)
        self.assertIn("beyond its bound: median slope over 17 m", done.stdout)

    def test_no_such_detail(self):
        done = run("verify", "ground", "--detail", "none", "-o", harness.path("none"), "--assets-dir", ASSETS)
        self.assertEqual(done.returncode, 1)
        self.assertIn("details/none.json", done.stderr)
        self.assertFalse(os.path.exists(harness.path("none")))


if __name__ == "__main__":
    harness.main()
