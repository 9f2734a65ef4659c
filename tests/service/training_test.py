#!/usr/bin/env python3
"""A network that is trained on a campaign's frames finds craters in frames that it has not seen: what
api/clients/python/training says, on a few small frames. Skipped without PyTorch (deploy/install-packages training).
"""

import importlib.util
import os
import re
import subprocess
import sys
import unittest

import harness
from harness import REPOSITORY, run, Service, tearDownModule

FOLDER = os.path.join(REPOSITORY, "api", "clients", "python", "training")
ASSETS = os.path.join(REPOSITORY, "deploy", "assets")
FRAMES = 80


def setUpModule():
    if importlib.util.find_spec("torch") is None:
        raise unittest.SkipTest("there is no PyTorch here")
    harness.set_up()


class Training(unittest.TestCase):
    def script(self, name, *options):
        done = subprocess.run([sys.executable, os.path.join(FOLDER, name), *options], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_it_finds_craters(self):
        dem = harness.sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
        service = Service("--assets-dir", ASSETS)
        manifest = harness.path("views.jsonl")
        self.script("views.py", f"http://{service.host}:{service.port}", manifest, "--count", str(FRAMES), "--side", "192",
                    "--region", "0.1", "0.12", "30.1", "30.12", "--altitude-m", "200", "600")
        service.expect_clean_stop()
        done = run("batch", manifest, "-o", harness.path("frames"), "--format", "webdataset", "--frames-per-tar", "30", "--dem", dem,
                   "--cache-dir", harness.path("cache"), "--assets-dir", ASSETS)
        self.assertEqual(done.returncode, 0, done.stderr)
        said = self.script("train.py", harness.path("frames"), "--epochs", "12", "--crop", "96", "--plot", harness.path("found.png"))
        print(said)
        self.assertIn(f"{FRAMES - FRAMES // 5} frames, 12 epochs", said)
        reached, chance = map(float, re.search(r"craters: intersection over union ([\d.]+); every pixel marked: ([\d.]+)", said).groups())
        self.assertGreater(reached, 1.5 * chance)
        self.assertGreater(os.path.getsize(harness.path("found.png")), 1e5)


if __name__ == "__main__":
    harness.main()
