#!/usr/bin/env python3
"""Accuracy by request: time budgets, aims for shadow edges, and the command that measures what they cost.

Python's standard library only.
"""

import csv
import json
import os
import re
import unittest

import harness
from harness import frame_request, meta_of, run, tearDownModule, WithService


def setUpModule():
    harness.set_up()
    harness.sample("dem", *harness.PLACE, "--ppd", "256")


def with_accuracy(**accuracy):
    return frame_request(["radiance"], accuracy=accuracy)


class Budgets(WithService):
    def chosen(self, budget_ms):
        """The metadata, and the header as numbers."""
        status, headers, body = self.service.frame(with_accuracy(budget_ms=budget_ms), "application/x-npz")
        self.assertEqual(status, 200, body[:300])
        said = {key: float(value) for key, value in re.findall(r"(\w+)=([0-9.e+-]+)", headers["Selenograph-Budget"])}
        return meta_of(body), said, headers["ETag"], body

    def test_chosen_settings_reproduce_the_frame(self):
        meta, _, etag, body = self.chosen(50)
        self.assertNotIn("budget_ms", meta["request"]["accuracy"])
        status, headers, again = self.service.frame(meta["request"], "application/x-npz")
        self.assertEqual(status, 200)
        self.assertEqual((headers["ETag"], again), (etag, body))
        self.assertNotIn("Selenograph-Budget", headers)

    def test_a_budget_and_what_it_chooses_exclude_each_other(self):
        for name, value in (("max_error_px", 1), ("samples_per_pixel", 4), ("max_shadow_error_px", 2)):
            status, _, body = self.service.frame(with_accuracy(budget_ms=20, **{name: value}))
            self.assertEqual(status, 422)
            errors = json.loads(body)["errors"]
            self.assertEqual([e["pointer"] for e in errors], ["/accuracy/budget_ms"])
            self.assertIn(name, errors[0]["detail"])
        for value in (0, -1, "20", None):
            status, _, body = self.service.frame(with_accuracy(budget_ms=value))
            self.assertEqual((status, json.loads(body)["errors"][0]["pointer"]), (422, "/accuracy/budget_ms"), value)

    def test_shadows_finer_on_demand(self):
        low = {"local": {"lat_deg": 0.1, "lon_deg": 30.1, "azimuth_deg": 90.0, "elevation_deg": 2.0}}
        triangles, bounds = [], []
        for aim in (1e6, 1):
            request = frame_request(["radiance"], sun=low, accuracy={"max_error_px": 2, "max_shadow_error_px": aim})
            meta = meta_of(self.service.frame(request, "application/x-npz")[2])
            triangles.append(meta["triangles"])
            bounds.append(meta["shadow_error_px"])
            self.assertLessEqual(meta["shadow_error_px"], aim)
        self.assertGreater(triangles[1], triangles[0])
        self.assertGreater(bounds[0], bounds[1])


class VerifyAccuracy(unittest.TestCase):
    def measured(self, name, size_px, *options, within=1):
        output = harness.path(name)
        done = run("verify", "accuracy", "--dem", harness.path("dem"), "--center", "0.1,30.1", "--size-px", str(size_px),
                   "--repetitions", "1", "--reference-samples", "16", "--cache-dir", harness.path("cache"), "--log-level", "error",
                   "-o", output, *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(sorted(os.listdir(output)), ["accuracy.csv", "accuracy.json"])
        with open(os.path.join(output, "accuracy.csv"), newline="") as file:
            rows = list(csv.DictReader(file))
        for row in rows:
            self.assertGreater(float(row["time_ratio"]), 0)
            self.assertGreaterEqual(float(row["within_lod_error_px"]), within, row)
            self.assertGreaterEqual(float(row["within_lod_error_p99_px"]), min(within, 0.99), row)
            self.assertLessEqual(float(row["lod_error_p99_px"]), float(row["lod_error_px"]), row)
        self.assertEqual({row["visibility"] for row in rows}, {"raytrace", "zbuffer"})
        return output, rows

    def test_with_detail(self):
        _, rows = self.measured("touchdown", 48, "--scenes", "touchdown", "--detail", "mare", "--assets-dir",
                                os.path.join(harness.REPOSITORY, "deploy", "assets"),
                                within=0.998)  # the bound is the mesh's: soil beside rocks is none
        self.assertEqual({row["scene"] for row in rows}, {"touchdown"})
        self.assertEqual({row["max_detail_error_px"] for row in rows}, {"4", "2", "1"})
        # The finest posts are the truth.
        finest = [row for row in rows if row["max_error_px"] == "0"]
        self.assertTrue(finest)
        for row in finest:
            self.assertLess(float(row["geometric_median_m"]), 1e-6)
            self.assertLess(float(row["geometric_worst_m"]), 0.2)  # soil that is banked against a rock
        done = run("verify", "accuracy", "--dem", harness.path("dem"), "--cache-dir", harness.path("cache"), "--detail", "nothing",
                   "-o", harness.path("nowhere"))
        self.assertEqual(done.returncode, 1)
        self.assertIn("details/nothing.json", done.stderr)

    def measured_request(self, name, document, *options, refused=False):
        done = run("verify", "accuracy", "--request", "-", "--repetitions", "1", "--reference-samples", "16", "--dem", harness.path("dem"),
                   "--cache-dir", harness.path("cache"), "--log-level", "error", "-o", harness.path(name), *options, input=json.dumps(document))
        if refused:
            self.assertEqual(done.returncode, 1)
            return done.stderr
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("<- as requested", done.stdout)
        with open(harness.path(name, "accuracy.csv"), newline="") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual({row["scene"] for row in rows}, {"request"})
        return rows

    def test_a_frame_of_ones_own(self):
        """Its own camera, Sun, object and accuracy: the row of that accuracy has what the frame itself says."""
        os.makedirs(harness.path("assets", "objects"), exist_ok=True)
        with open(harness.path("assets", "objects", "mast.obj"), "w") as file:
            file.write("v -200 -200 0\nv 200 -200 0\nv 0 200 0\nv 0 0 2000\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
        assets = ("--assets-dir", harness.path("assets"))
        mast = {"mesh": "mast", "pose": {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 0.0}, "upright": {}}, "material": {"reflectance": {}}}
        lens = dict(frame_request()["camera"], distortion={"model": "opencv", "k1": -0.1})
        accuracy = {"max_error_px": 3, "max_shadow_error_px": 8}
        document = frame_request(["radiance"], accuracy=accuracy, camera=lens, objects=[mast])
        rows = self.measured_request("own", document, *assets)
        own = [row for row in rows if row["max_error_px"] == "3"]
        self.assertEqual([(row["visibility"], row["max_shadow_error_px"]) for row in own], [("auto", "8")])
        service = harness.Service(*assets)
        said = meta_of(service.frame(document, "application/x-npz")[2])
        service.expect_clean_stop()
        for row in own:
            self.assertAlmostEqual(float(row["lod_error_px"]) / said["lod_error_px"], 1, delta=1e-6)
            self.assertAlmostEqual(float(row["shadow_error_px"]) / said["shadow_error_px"], 1, delta=1e-6)
            self.assertEqual(float(row["within_lod_error_px"]), 1)  # the object is not ground
            self.assertGreater(float(row["wrong_shadow_flags"]), 0)

    def test_a_fisheye_of_ones_own(self):
        fisheye = {"model": "fisheye", "width": 48, "height": 48, "fx": 20, "fy": 20, "cx": 23.5, "cy": 23.5}
        rows = self.measured_request("fisheye", frame_request(["radiance"], camera=fisheye, visibility="raytrace"))
        self.assertEqual({row["visibility"] for row in rows}, {"raytrace"})
        self.assertTrue(all(float(row["within_lod_error_px"]) == 1 for row in rows))

    def test_an_unmeasurable_frame_is_refused(self):
        rolling = {"line_time_s": 1e-3, "velocity_m_s": [0, 0, 100]}
        sunless = frame_request(["range"])
        del sunless["sun"]
        for document, word in ((frame_request(shutter=rolling), "/shutter"), (sunless, "/sun"), (frame_request(camera=None), "/camera"),
                               (frame_request(terrain=False, accuracy={}), "/terrain"), ([], "object"),
                               (frame_request(accuracy={"budget_ms": 50}), "/accuracy/budget_ms")):
            problem = self.measured_request("refused", document, refused=True)
            self.assertIn(word, problem)
            self.assertIn("-: ", problem)
            self.assertFalse(os.path.exists(harness.path("refused")))

    def test_a_scene_that_is_not_there_is_refused(self):
        for options, words in ((("--scenes", "polar"), "--polar-center"), (("--scenes", "nadir,touchdown"), "--detail")):
            done = run("verify", "accuracy", "--dem", harness.path("dem"), "--center", "0.1,30.1", "--size-px", "32",
                       "--cache-dir", harness.path("cache"), "--log-level", "error", "-o", harness.path("refused"), *options)
            self.assertEqual(done.returncode, 1, done.stdout)
            self.assertIn(words, done.stderr)
            self.assertNotIn("%", done.stderr)
            self.assertFalse(os.path.exists(harness.path("refused")))

    def test_every_scene_is_measured(self):
        """By default two, since plot_test draws all; the polar one has no place here."""
        scenes = ["nadir", "oblique", "limb", "descent"] if harness.full_effort() else ["nadir", "limb"]
        output, rows = self.measured("accuracy", 64, *(() if harness.full_effort() else ("--scenes", ",".join(scenes))))
        self.assertEqual({row["scene"] for row in rows}, set(scenes))
        for method in ("raytrace", "zbuffer"):
            self.check_nadir([row for row in rows if (row["scene"], row["visibility"]) == ("nadir", method)])
        with open(os.path.join(output, "accuracy.json")) as file:
            facts = json.load(file)
        self.assertEqual([scene["name"] for scene in facts["scenes"]], scenes)
        self.assertEqual(facts["default"], {"max_error_px": 0.5, "max_detail_error_px": 4, "max_shadow_error_px": 16, "samples_per_pixel": 1})

    def check_nadir(self, rows):
        nadir = {(row["max_error_px"], row["samples_per_pixel"]): row for row in rows}
        coarse, finest, smooth = nadir["4", "1"], nadir["0", "1"], nadir["0", "16"]
        self.assertEqual(float(finest["wrong_shadow_flags"]), 0)
        self.assertLess(float(finest["geometric_worst_m"]), 1e-6)
        self.assertGreater(float(coarse["geometric_worst_m"]), 1)
        self.assertGreater(float(coarse["wrong_shadow_flags"]), 0)
        self.assertLess(int(float(coarse["triangles"])), int(float(finest["triangles"])))
        # 16 samples are the reference's own: what is left is nothing, or a shadow flag that the two ways disagree on.
        self.assertLessEqual(float(smooth["radiance_rms"]), 0 if smooth["visibility"] == "raytrace" else 1e-3)
        self.assertGreater(float(finest["radiance_rms"]), 0.005)


if __name__ == "__main__":
    harness.main()
