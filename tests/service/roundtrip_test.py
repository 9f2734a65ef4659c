#!/usr/bin/env python3
"""The DEM round trip on the command line: the same figures as over HTTP, rasters, refusals that point.

What the figures must be is tests/hard/round_trip_test.cpp's matter. Python's standard library only.
"""

import json
import os
import unittest

import harness
from harness import Service, tearDownModule

PLACE = ("--south-deg", "25", "--west-deg", "2", "--rows", "2", "--columns", "2", "--ppd", "256")
CENTER = {"lat_deg": 26.1322, "lon_deg": 3.6339}
CALL = "/v1/verify/roundtrip"
EXACT = {"center": CENTER, "posts": 100}


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE)


def ask(service, body, accept="application/json"):
    headers = {"Content-Type": "application/json", "Accept": accept}
    return service.ask("POST", CALL, json.dumps(body).encode(), headers)


class OnTheCommandLine(unittest.TestCase):
    def verify(self, *options, center="26.1322,3.6339", output="out"):
        return harness.run("verify", "roundtrip", "--dem", harness.path("dem"), "--cache-dir", harness.path("cache"),
                           "--center", center, "--posts", "100", "-o", harness.path(output), *options)

    def test_both_modes_are_written_and_are_the_services(self):
        done = self.verify()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("posts compared", done.stdout)
        service = Service()
        for mode in ("exact", "camera"):
            folder = harness.path("out", mode)
            self.assertEqual(sorted(os.listdir(folder)), ["difference.tif", "extracted.tif", "statistics.json"])
            with open(os.path.join(folder, "statistics.json")) as file:
                written = json.load(file)
            self.assertEqual(json.loads(ask(service, dict(EXACT, mode=mode))[2]), written)
        self.assertEqual(service.stop(), 0)

    def test_invalid_options(self):
        for center, options, status, words in (("95,3", (), None, "latitude and longitude"),
                                               ("26.1 3.6", (), None, "latitude and longitude"),
                                               ("26.1,3.6", ("--mode", "nearly"), None, "--mode"),
                                               ("-60,100", (), 1, "no tile holds")):
            done = self.verify(*options, center=center)
            self.assertEqual(done.returncode, status or done.returncode)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(words, done.stderr + done.stdout)
        done = self.verify(output=harness.write("file", ""))
        self.assertEqual(done.returncode, 1)
        self.assertIn(harness.path("file"), done.stderr)
        self.assertNotIn("mode exact", done.stderr)  # refused before it is measured


if __name__ == "__main__":
    harness.main()
