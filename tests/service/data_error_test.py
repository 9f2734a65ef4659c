#!/usr/bin/env python3
"""DEM files that are damaged, or vanish, before the service starts and under it.

Where --on-data-error is `fail` the answer names the file; where it is `fall-through` the layer below answers, with a warning
that names the file. Never a crash, and never zeros that nothing explains. Python's standard library and NumPy only.
"""

import contextlib
import itertools
import json
import os
import shutil
import unittest

import numpy as np

import harness
from harness import frame_request, PLACE, Service, tearDownModule

PRODUCTS = ("radiance", "range", "source")
PLACES = {"lat_deg": 0.1, "lon_deg": 30.1}  # on the tile that is damaged, as is what frame_request() looks at
HEIGHT = "/v1/height?lat_deg=0.1&lon_deg=30.1"
HIT = "DTM_MAP_01_N01E030N00E031SC"


def setUpModule():
    harness.set_up()
    harness.sample("fine", *PLACE, "--ppd", "256")
    # The layer below: another landscape under other names, so that nobody can mistake one for the other.
    rename(harness.sample("coarse", *PLACE, "--ppd", "64", "--seed", "99"), "DTM_MAP", "DTM_LOW")


def rename(folder, old, new):
    for name in os.listdir(folder):
        path = os.path.join(folder, name)
        if name.endswith(".lbl"):
            with open(path, "rb") as file:
                label = file.read().replace(old.encode(), new.encode())
            with open(path, "wb") as file:
                file.write(label)
        os.rename(path, os.path.join(folder, name.replace(old, new)))


def truncate(folder):
    image = os.path.join(folder, HIT + ".img")
    os.truncate(image, os.path.getsize(image) // 3)


def empty(folder):
    os.truncate(os.path.join(folder, HIT + ".img"), 0)


def remove_image(folder):
    os.remove(os.path.join(folder, HIT + ".img"))


def remove_both(folder):
    remove_image(folder)
    os.remove(os.path.join(folder, HIT + ".lbl"))


def replace_by_folder(folder):
    remove_image(folder)
    os.mkdir(os.path.join(folder, HIT + ".img"))


def garble_label(folder):
    with open(os.path.join(folder, HIT + ".lbl"), "r+b") as file:
        file.write(b"\xff\x00garbage" * 40)


def empty_label(folder):
    os.truncate(os.path.join(folder, HIT + ".lbl"), 0)


def overwrite(folder):
    """Same length and other posts: only its time of change tells."""
    image = os.path.join(folder, HIT + ".img")
    size, before = os.path.getsize(image), os.stat(image)
    with open(image, "wb") as file:
        file.write(bytes(size))
    os.utime(image, ns=(before.st_atime_ns, before.st_mtime_ns + 1_000_000_000))


UNDER_THE_SERVICE = (truncate, empty, remove_image, remove_both, replace_by_folder, garble_label, empty_label, overwrite)
# Not here: a tile without any trace of it is no tile, and one with other posts is that tile.
BEFORE_THE_START = (truncate, empty, remove_image, replace_by_folder, garble_label, empty_label)


def damages(functions, first):
    """Each damage with one or with two layers, in turn, beginning with `first`; by full effort with both."""
    for i, (damage, layers) in enumerate(itertools.product(functions, (1, 2))):
        if harness.full_effort() or layers == 1 + (i // 2 + first - 1) % 2:
            yield damage, layers


class DataErrors(unittest.TestCase):
    @contextlib.contextmanager
    def terrain(self, layers):
        """A copy of the tiles to damage, with the layer below or without it, and no pyramid yet."""
        folder = shutil.copytree(harness.path("fine"), harness.path("dem"))
        if layers == 2:
            shutil.copytree(harness.path("coarse"), os.path.join(folder, "below"))
        try:
            yield folder
        finally:
            shutil.rmtree(folder)
            shutil.rmtree(harness.path("cache"), ignore_errors=True)

    def start(self, policy):
        return Service("--on-data-error", policy, "--log-level", "warning")

    def calls(self, service):
        """Everything that stands on the damaged tile."""
        ray = {"origin_m": [1521000.0, 880000.0, 3067.0], "direction": [-0.8651, -0.5015, -0.0017]}
        frame = frame_request(PRODUCTS)
        project = {"camera": frame["camera"], "pose": frame["pose"], "points": [PLACES]}
        yield "frames", service.frame(frame, "application/x-npz")
        yield "rays", service.post("/v1/rays", {"rays": [ray]})
        yield "project", service.post("/v1/project", project)
        yield "heights", service.post("/v1/heights", {"points": [PLACES]})
        yield "height", service.ask("GET", HEIGHT)

    def assert_problem(self, name, answer):
        status, headers, body = answer
        self.assertEqual(status, 500, f"{name}: {body[:300]}")
        self.assertEqual(headers["Content-Type"], "application/problem+json", name)
        document = json.loads(body)
        self.assertEqual(document["type"], "urn:selenograph:problem:terrain_data_error", name)
        self.assertIn(HIT, document["detail"], name)
        self.assertNotIn("ETag", headers, name)

    def assert_alive(self, service):
        self.assertEqual(service.ask("GET", "/health/ready")[0], 200)
        self.assertEqual(service.stop(), 0)

    def frame(self, service):
        f = service.arrays(frame_request(PRODUCTS))
        return f["headers"], f["meta"], f

    def below(self):
        """What the layer below gives where it has the place for itself."""
        with self.terrain(2) as folder:
            remove_both(folder)
            service = self.start("fail")
            arrays = self.frame(service)[2]
            height = json.loads(service.ask("GET", HEIGHT)[2])
            self.assert_alive(service)
        return arrays, height

    def test_fail_under_the_service(self):
        for damage, layers in damages(UNDER_THE_SERVICE, 1):
            with self.subTest(damage=damage.__name__, layers=layers), self.terrain(layers) as folder:
                service = self.start("fail")
                damage(folder)
                for name, answer in self.calls(service):
                    self.assert_problem(name, answer)
                self.assertIn(HIT, service.log_text())
                self.assert_alive(service)

    def test_fail_before_the_start(self):
        for damage, layers in damages(BEFORE_THE_START, 2):
            with self.subTest(damage=damage.__name__, layers=layers), self.terrain(layers) as folder:
                damage(folder)
                try:
                    service = self.start("fail")
                except RuntimeError as refusal:  # it need not start; then it says why
                    self.assertIn(HIT, str(refusal))
                    continue
                for name, answer in self.calls(service):
                    self.assert_problem(name, answer)
                self.assert_alive(service)

    def test_fall_through_under_the_service(self):
        below = self.below()
        for damage, layers in damages(UNDER_THE_SERVICE, 2):
            with self.subTest(damage=damage.__name__, layers=layers), self.terrain(layers) as folder:
                service = self.start("fall-through")
                damage(folder)
                self.assert_fallen_through(service, below if layers == 2 else None)
                self.assert_alive(service)

    def test_fall_through_before_the_start(self):
        below = self.below()
        for damage, layers in damages(BEFORE_THE_START, 1):
            with self.subTest(damage=damage.__name__, layers=layers), self.terrain(layers) as folder:
                damage(folder)
                service = self.start("fall-through")
                self.assert_fallen_through(service, below if layers == 2 else None)
                self.assert_alive(service)

    def test_cached_answers_remain(self):
        """The pyramid holds what was read; it does not go stale because the tile vanishes later."""
        with self.terrain(1) as folder:
            service = self.start("fail")
            _, _, before = self.frame(service)
            remove_both(folder)
            _, meta, after = self.frame(service)
            self.assertEqual(meta["warnings"], [])
            self.assert_same(after, before)
            self.assert_alive(service)

    def test_fall_through_is_not_cached(self):
        """The tile comes back as it was and the service starts again: nothing of the layer below may be left in the pyramid."""
        with self.terrain(2) as folder:
            service = self.start("fail")
            _, _, sound = self.frame(service)
            self.assert_alive(service)
            shutil.rmtree(harness.path("cache"))
            service = self.start("fall-through")
            with self.taken_away(folder):
                self.frame(service)
            self.assert_alive(service)
            for policy in ("fall-through", "fail"):
                service = self.start(policy)
                _, meta, again = self.frame(service)
                self.assertEqual(meta["warnings"], [], policy)
                self.assert_same(again, sound, policy)
                self.assert_alive(service)

    @contextlib.contextmanager
    def taken_away(self, folder):
        """As a disk that is not mounted for a while: no file's time of change is another one."""
        away = folder + ".away"
        os.rename(folder, away)
        os.mkdir(folder)
        for name in os.listdir(away):
            if name != HIT + ".img":
                os.symlink(os.path.join(away, name), os.path.join(folder, name))
        yield
        shutil.rmtree(folder)
        os.rename(away, folder)

    def assert_same(self, got, wanted, what=""):
        for name in PRODUCTS:
            np.testing.assert_array_equal(got[name], wanted[name], err_msg=f"{what} {name}")

    def assert_fallen_through(self, service, below):
        headers, meta, arrays = self.frame(service)
        self.assertTrue(any(HIT in warning for warning in meta["warnings"]), meta["warnings"])
        self.assertNotIn("ETag", headers)  # the bytes are not those of the sound tile
        self.assertGreaterEqual(service.metric("selenograph_terrain_warnings"), 1)
        self.assertNotIn(HIT, [source["name"] for source in meta["sources"]])
        height = json.loads(service.ask("GET", HEIGHT)[2])
        if below:
            self.assertEqual(meta["missing_fraction"], 0)
            for name in ("radiance", "range"):
                np.testing.assert_array_equal(arrays[name], below[0][name], err_msg=name)
            self.assertEqual(height, below[1])
        else:
            missed = np.isnan(arrays["range"])
            self.assertGreater(missed.mean(), 0.3)  # the frame looks at this tile and a little beyond
            self.assertAlmostEqual(missed.mean(), meta["missing_fraction"], delta=1e-9)
            self.assertTrue(np.all(arrays["source"][missed] == 65535))
            self.assertIsNone(height["height_m"])
            self.assertTrue(height["reason"])
        for name, (status, _, body) in self.calls(service):
            self.assertEqual(status, 200, (name, body[:300]))


if __name__ == "__main__":
    harness.main()
