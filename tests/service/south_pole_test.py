#!/usr/bin/env python3
"""Runs the commands of engine/horizons/south_pole.md on the polar piece that it names, and checks what it says of them.

By default the map of a year has wider pixels, and of the descent's three frames the second is drawn, small; all as the
page has it in slow.south_pole.
"""

import csv
import json
import os
import re
import shlex
import subprocess
import unittest

import numpy as np
from osgeo import gdal

import harness
import readme_test
from harness import REPOSITORY, tearDownModule

gdal.UseExceptions()

PAGE = "engine/horizons/south_pole.md"
TERRAIN = "/data/pole.tif"  # as the page calls it
PIECE = "NPC_final_adj_5mpp_surf_piece_2km_2_1.tif"
SIDE_PX, MIDDLE = (320, slice(110, 210)) if harness.full_effort() else (96, slice(33, 63))


def setUpModule():
    if not harness.shared_data("real"):
        raise unittest.SkipTest(f"no shared data: {PAGE} needs real/{PIECE}")
    harness.set_up()
    os.symlink(os.path.join(REPOSITORY, "deploy"), harness.path("deploy"))
    os.mkdir(harness.path("build"))
    os.symlink(os.path.abspath(harness.BINARY), harness.path("build", "selenograph"))


def lighter(word):
    """A request of the page, or one with less work that shows the same."""
    name = os.path.basename(word)
    if harness.full_effort() or name not in ("descent.jsonl", "year.json"):
        return word
    with open(os.path.join(REPOSITORY, word)) as file:
        if name == "year.json":
            year = json.load(file)
            year["map"]["gsd_m"] = 50
            return harness.write(name, year)
        frame = json.loads(file.readlines()[1])
    frame["camera"].update(width=SIDE_PX, height=SIDE_PX)
    size = MIDDLE.stop - MIDDLE.start
    frame["sensor"]["exposure"]["metering"]["region"] = {"x": MIDDLE.start, "y": MIDDLE.start, "width": size, "height": size}
    return harness.write(name, json.dumps(frame))


class SouthPole(unittest.TestCase):
    def run_page(self):
        with open(os.path.join(REPOSITORY, PAGE)) as file:
            text = file.read().replace("\\\n", " ")
        commands = [line for block in re.findall(r"```sh\n(.*?)```", text, re.S) for line in block.splitlines()]
        environment = {**os.environ, "SELENOGRAPH_CACHE_DIR": harness.path("cache")}
        for command in commands:
            words = [os.path.join(harness.shared_data("real"), PIECE) if word == TERRAIN else lighter(word)
                     for word in shlex.split(command)]
            done = subprocess.run(words, cwd=harness.path(), env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                  text=True, timeout=harness.PATIENCE_S * 5)
            self.assertEqual(done.returncode, 0, f"{command}\n{done.stdout[-2000:]}")
        return text

    def test_a_season(self):
        text = self.run_page()
        said = {name: float(value) for value, name in re.findall(r"([\d.]+)<!-- (\w+) -->", text)}
        year = gdal.Open(harness.path("year.tif")).ReadAsArray()
        sun, earth, night, _, without_earth = year
        hours = 365 * 24
        measured = {"sun": sun.mean(), "brightest": sun.max(), "dark": 100 * np.mean(sun == 0),
                    "earth": earth.mean(), "unseen": 100 * np.mean(earth == 0)}
        for name, value in measured.items():
            self.assertAlmostEqual(said[name], value, delta=0.02 * said[name] + 0.006, msg=name)
        self.assertTrue(np.all((night >= hours - 24) == (sun == 0)))
        self.assertTrue(np.all(without_earth[earth == 0] >= hours - 24))
        # The floor of the crater, and the ground beside it.
        with open(harness.path("illumination.csv"), newline="") as file:
            rows = list(csv.reader(file))
        series = np.array([[float(value) for value in row[1:]] for row in rows[1:]])
        self.assertEqual(series[:, 0].max(), 0, "the floor of the crater is never lit")
        self.assertGreater(series[:, 2].max(), 0.99)
        self.assertGreater(os.path.getsize(harness.path("illumination.png")), 20000)
        # In the crater's shadow the light is that of its walls: frames metered there are not black.
        for name, dark in (("300m", True), *([("1000m", False), ("60m", True)] if harness.full_effort() else ())):
            with np.load(harness.path("descent", name + ".npz")) as frame:
                image, exposure = frame["image"].astype(float), json.loads(bytes(frame["meta.json"]))["exposure"]
            middle = image[MIDDLE, MIDDLE].mean() / 4095
            self.assertAlmostEqual(middle, 0.4 if dark else 0.01, delta=0.05 if dark else 0.01, msg=name)
            dark_e = 125 * exposure["integration_time_s"]  # of the preset
            self.assertLess(dark_e, 0.05 * 0.4 * 13500, name)

    def test_the_blocks_are_shell(self):
        self.assertEqual({language for language, _, _ in readme_test.blocks(PAGE)}, {"sh"})


if __name__ == "__main__":
    harness.main()
