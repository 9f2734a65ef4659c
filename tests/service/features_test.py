#!/usr/bin/env python3
"""Craters as truth: POST /v1/features and `selenograph ask features` against the terrain, and against what frames see."""

import csv
import io
import json
import math
import os
import shutil
import stat
import time

import numpy as np

import harness
from harness import frame_request, run, sample, tearDownModule

LAT, LON = 0.1, 30.1
RADIUS_M = 1737400.0
METRES_PER_DEGREE = RADIUS_M * math.pi / 180
# Relief so low that it is none: ground without craters at the same levels as with them.
FLAT = {"hurst": 0.9, "deviation_m": 1e-9, "baseline_m": 10, "shortest_m": 8, "longest_m": 16}
LARGE = {"smallest_m": 16, "largest_m": 256}
PRESETS = {
    "rough": {"seed": 3, "craters": {"smallest_m": 2, "largest_m": 100}},
    "large": {"seed": 5, "craters": LARGE, "relief": FLAT},
    # One octave, so that one crater is all there is, where no other of it is near; far below the posts, which give up the
    # means of larger ones.
    "alone": {"seed": 7, "craters": {"smallest_m": 32, "largest_m": 64, "frequency": [{"per_m2": 0.01, "exponent": 2}]},
              "relief": FLAT},
    "none": {"relief": FLAT},
    "rocky": {"seed": 9, "craters": {"smallest_m": 4, "largest_m": 100}, "rocks": {
        "smallest_m": 0.25, "largest_m": 6, "frequency": [{"per_m2": 0.002, "exponent": 2.6607}]}},
    "stones": {"rocks": {"smallest_m": 1, "largest_m": 8, "on_ejecta": 1}},
    "sparse": {"craters": {"smallest_m": 1, "largest_m": 100, "frequency": [{"per_m2": 1e-12, "exponent": 2}]}},
}


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    os.makedirs(harness.path("assets", "details"))
    shutil.copy(os.path.join(harness.REPOSITORY, "deploy", "assets", "details", "landing.json"), harness.path("assets", "details"))
    for name, preset in PRESETS.items():
        harness.write(os.path.join("assets", "details", name + ".json"), preset)


def region(south, north, west, east):
    return {"south_deg": south, "north_deg": north, "west_deg": west, "east_deg": east}


def square(lat, lon, side_m):
    half = side_m / METRES_PER_DEGREE / 2
    return region(lat - half, lat + half, lon - half, lon + half)


def inside(crater, box):
    lon = crater["lon_deg"] + 360 * math.ceil((box["west_deg"] - crater["lon_deg"]) / 360)
    return box["south_deg"] <= crater["lat_deg"] <= box["north_deg"] and lon <= box["east_deg"]


class WithFeatures(harness.WithService):
    @classmethod
    def setUpClass(cls):
        cls.options = ("--assets-dir", harness.path("assets"))
        super().setUpClass()

    def answer(self, detail, box, **more):
        return self.ok_json(self.service.post("/v1/features", {"detail": detail, "region": box, **more}))

    def craters(self, detail, box, **more):
        return self.answer(detail, box, **more)["craters"]

    def heights(self, places, detail):
        points = [{"lat_deg": lat, "lon_deg": lon} for lat, lon in np.asarray(places).tolist()]
        return np.array([p["height_m"] for p in self.ok_json(
            self.service.post("/v1/heights", {"points": points, "detail": detail}))["points"]], dtype=float)


class Rocks(WithFeatures):
    def test_a_detail_without_rocks_is_warned_of(self):
        without = next(name for name, preset in PRESETS.items() if "rocks" not in preset)
        for detail, count in ((without, 1), ("stones", 0)):
            status, headers, body = self.service.post("/v1/features", {"detail": detail, "region": square(LAT, LON, 50), "kind": "rocks"})
            self.assertEqual(status, 200, body)
            self.assertEqual("the detail has none" in headers.get("Selenograph-Warnings", ""), bool(count), headers)

    def test_what_is_answered(self):
        box = square(LAT, LON, 400)
        answer = self.answer("stones", box, kind="rocks")
        rocks = answer["rocks"]
        self.assertNotIn("craters", answer)
        self.assertEqual(answer["smallest_m"], 1)
        expected = 400 ** 2 * 0.0003 * (1 - 8 ** -2.482)
        self.assertLess(abs(len(rocks) - expected), 5 * math.sqrt(expected))
        self.assertEqual(len({r["id"] for r in rocks}), len(rocks))
        diameters = [r["diameter_m"] for r in rocks]
        self.assertEqual(diameters, sorted(diameters, reverse=True))
        self.assertTrue(all(1 <= d <= 8 for d in diameters) and all(inside(r, box) and r["age_Ma"] >= 0 for r in rocks))
        np.testing.assert_allclose([r["height_m"] for r in rocks],
                                   self.heights([(r["lat_deg"], r["lon_deg"]) for r in rocks], "stones"), rtol=0, atol=0.02)
        body = {"detail": "stones", "region": box, "kind": "rocks"}
        table = list(csv.reader(io.StringIO(self.ok(self.service.post("/v1/features", body, "text/csv"), "text/csv").decode())))
        self.assertEqual(table[0], list(rocks[0]))
        self.assertEqual([[line[0]] + [float(x) for x in line[1:]] for line in table[1:]], [list(r.values()) for r in rocks])
        self.assertEqual(self.answer("rough", box, kind="rocks")["rocks"], [])
        self.assertEqual(self.answer("stones", square(40, 100, 400), kind="rocks")["rocks"], [])

    def test_refusals(self):
        body = {"detail": "rocky", "region": region(-1, 1, 29, 31), "kind": "rocks"}
        problem = self.problem(self.service.post("/v1/features", body), 422, "/region")
        self.assertIn("rocks of at least 0.25 m", problem["errors"][0]["detail"])
        self.problem(self.service.post("/v1/features", {**body, "kind": "pebbles"}), 422, "/kind")


class Features(WithFeatures):
    def test_what_is_answered(self):
        box = square(LAT, LON, 1000)
        answer = self.answer("rough", box, smallest_m=8, min_depth_over_diameter=0)
        self.assertEqual(answer["detail"]["name"], "rough")
        self.assertRegex(answer["detail"]["version"], "^[0-9a-f]{16}$")
        self.assertEqual(answer["region"], box)
        self.assertEqual((answer["smallest_m"], answer["min_depth_over_diameter"]), (8, 0))
        craters = answer["craters"]
        # Equilibrium: 10^-1.1 D^-2 per m^2 above D, of a million m^2.
        expected = 1e6 * 10 ** -1.1 * (8 ** -2 - 100 ** -2)
        self.assertLess(abs(len(craters) - expected), 5 * math.sqrt(expected) + 0.05 * expected)
        diameters = [c["diameter_m"] for c in craters]
        self.assertEqual(diameters, sorted(diameters, reverse=True))
        self.assertGreaterEqual(diameters[-1], 8)
        self.assertEqual(len({c["id"] for c in craters}), len(craters))
        for crater in craters:
            self.assertRegex(crater["id"], "^[0-9a-f]{16}$")
            self.assertTrue(inside(crater, box))
            self.assertLess(0, crater["depth_m"])
            self.assertLess(crater["depth_m"], 0.3 * crater["diameter_m"])
            self.assertTrue(0 <= crater["age_Ma"] <= 3500 and 0 <= crater["rim_share"] <= 1)
            self.assertEqual(crater["depth_over_diameter"], crater["depth_m"] / crater["diameter_m"])
        places = [(c["lat_deg"], c["lon_deg"]) for c in craters]
        np.testing.assert_allclose([c["height_m"] for c in craters], self.heights(places, None), rtol=0, atol=1e-9)
        # Without smallest_m the same and more.
        more = {c["id"]: c for c in self.craters("rough", square(LAT, LON, 1000), min_depth_over_diameter=0)}
        self.assertLess(min(c["diameter_m"] for c in more.values()), 2.1)
        for crater in craters:
            self.assertEqual(more[crater["id"]], crater)
        # Those that are recognised as craters, unless it is asked for others.
        for least, asked in ((0.02, {}), (0.08, {"min_depth_over_diameter": 0.08})):
            answer = self.answer("rough", box, smallest_m=8, **asked)
            self.assertEqual(answer["min_depth_over_diameter"], least)
            self.assertEqual(answer["craters"], [c for c in craters if c["depth_over_diameter"] >= least])

    def test_nothing_where_there_is_no_data(self):
        self.assertEqual(self.craters("large", square(40, 100, 5000)), [])
        # Across the data's border: on its side alone.
        craters = self.craters("large", region(-0.5, -0.4, 28.98, 29.02))
        self.assertGreater(min(c["lon_deg"] for c in craters), 29 - 0.005)
        self.assertLess(min(c["lon_deg"] for c in craters), 29.005)

    def test_poles_and_date_line_are_no_error(self):
        for box in (region(89, 90, -180, 180), region(-90, -89.5, 0, 360), region(-0.1, 0.1, 179.9, -179.9),
                    region(-0.1, 0.1, 179.9, 180.1), region(-90, 90, 0, 0.001)):
            self.assertEqual(self.craters("large", box, smallest_m=100), [])
        east = self.answer("large", region(-0.1, 0.1, 179.9, -179.9), smallest_m=100)["region"]["east_deg"]
        self.assertAlmostEqual(east, 180.1)

    def test_refusals(self):
        def refused(pointer, words="", **body):
            problem = self.problem(self.service.post("/v1/features", body), 422, pointer)
            said = " ".join(e["detail"] for e in problem["errors"] if e["pointer"] == pointer)
            self.assertIn(words, said)
            return said
        box = square(LAT, LON, 1000)
        refused("/detail", "is required", region=box)
        refused("/detail", "rough", detail="nowhere", region=box)
        refused("/detail", detail=None, region=box)
        refused("/region", "is required", detail="rough")
        refused("/min_depth_over_diameter", "rocks", detail="rough", region=box, kind="rocks", min_depth_over_diameter=0.1)
        # Too many: what it says is enough is.
        wide = square(LAT, LON, 20000)
        said = refused("/region", "smaller region", detail="rough", region=wide)
        enough = float(said.split("smallest_m of ")[1].split()[0])
        number = len(self.craters("rough", wide, smallest_m=enough, min_depth_over_diameter=0))
        self.assertTrue(80000 < number < 100500, number)
        # Few craters, but no end of places to look for them.
        refused("/region", "too large", detail="sparse", region=region(-60, 60, -180, 180))
        self.problem(self.service.post("/v1/features", {"detail": "rough", "region": box}, "image/png"), 406)

    def test_a_deadline_ends_it(self):
        for kind, smallest in (("rocks", 0.7), ("craters", 3)):
            body = {"detail": "landing", "region": region(89.95, 90, -180, 180), "kind": kind, "smallest_m": smallest}
            start = time.monotonic()
            self.problem(self.service.post("/v1/features", body, Request_Timeout_Ms="50"), 504)
            self.assertLess(time.monotonic() - start, 5)  # it goes on for longer where nothing looks at the clock


def diameter_px(outline):
    x, y = np.asarray(outline).T
    return math.sqrt(2 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / math.pi)


class InFrames(WithFeatures):
    """`craters` of a frame's request."""

    WIDTH, HEIGHT = 320, 240

    def frame(self, height_m=4000.0, **changes):
        ground = self.heights([(LAT, LON)], None)[0]
        pose = {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": ground + height_m}, "nadir": {"up_azimuth_deg": 30.0}}
        return frame_request(**{"width": self.WIDTH, "height": self.HEIGHT, "pose": pose, "detail": "large", "craters": True,
                                **changes})

    def meta(self, request):
        return self.service.arrays(request)["meta"]

    def test_choices(self):
        every = self.meta(self.frame(craters={"min_depth_over_diameter": 0, "smallest_px": 4}))["craters"]
        deep = self.meta(self.frame(craters={"min_depth_over_diameter": 0.1}))["craters"]
        self.assertTrue(0 < len(deep) < len(every))
        self.assertEqual(deep, [c for c in every if c["depth_over_diameter"] >= 0.1])
        large = self.meta(self.frame(craters={"min_depth_over_diameter": 0, "smallest_px": 20}))["craters"]
        self.assertEqual([c["id"] for c in large], [c["id"] for c in every if diameter_px(c["rim_px"]) >= 20])
        self.assertEqual(self.meta(self.frame(craters={}))["request"]["craters"],
                         {"smallest_px": 4, "min_depth_over_diameter": 0.02})

    def test_answers_without_room(self):
        """A header has not room for them: where it says that the metadata are."""
        request = self.frame(products=["range"])
        status, headers, _ = self.service.post("/v1/frames", request, "application/x-npy")
        self.assertEqual(status, 200)
        short = json.loads(headers["Selenograph-Meta"])
        self.assertEqual(short["craters"], [])
        whole = json.loads(self.service.ask("GET", short["metadata_at"])[2])
        self.assertEqual(len(whole["craters"]), short["craters_omitted"])
        self.assertEqual(whole["craters"], self.meta(request)["craters"])

    def test_several_cameras(self):
        request = self.frame()
        camera = request.pop("camera")
        del request["craters"]
        meta = self.meta({**request, "cameras": {"labelled": {"camera": camera, "craters": True}, "plain": {"camera": camera}}})
        self.assertEqual(meta["cameras"]["labelled"]["craters"], self.meta(self.frame())["craters"])
        self.assertNotIn("craters", meta["cameras"]["plain"])

    def test_refusals(self):
        def refused(pointer, words="", **changes):
            request = {k: v for k, v in self.frame(**changes).items() if v is not None}
            problem = self.problem(self.service.frame(request, "*/*"), 422, pointer)
            self.assertIn(words, " ".join(e["detail"] for e in problem["errors"]))
        refused("/craters", "detail", detail=None)
        refused("/craters", "object", craters=3)
        refused("/craters/smallest_px", craters={"smallest_px": 0.5})
        refused("/craters/min_depth_over_diameter", craters={"min_depth_over_diameter": 2})
        refused("/craters/least", craters={"least": 1})
        self.service.arrays({k: v for k, v in self.frame(craters=False).items() if k != "detail"})

    def test_a_campaign_labels_its_frames(self):
        """`batch` needs no more than the member: in .npz and in .png."""
        request = self.frame(products=["image"])
        expected = self.meta(request)["craters"]
        manifest = harness.write("labelled.jsonl", json.dumps({"name": "one", **request}) + "\n")
        for form in ("png", "npz"):
            done = run("batch", manifest, "-o", harness.path("labelled-" + form), "--format", form, "--dem", harness.path("dem"),
                       "--cache-dir", harness.path("cache"), "--assets-dir", harness.path("assets"))
            self.assertEqual(done.returncode, 0, done.stderr)
            with open(harness.path("labelled-" + form, "one." + form), "rb") as file:
                body = file.read()
            text = harness.meta_of(body) if form == "npz" else self.text_of_png(body)
            self.assertEqual(text["craters"], expected)

    @staticmethod
    def text_of_png(body):
        at = 8
        while at < len(body):
            size, kind = int.from_bytes(body[at:at + 4], "big"), body[at + 4:at + 8]
            if kind == b"tEXt" and body[at + 8:].startswith(b"selenograph\0"):
                return json.loads(body[at + 20:at + 8 + size])
            at += size + 12
        raise AssertionError("no metadata")


class CommandLine(WithFeatures):
    def features(self, *options, **others):
        return run("ask", "features", "--dem", harness.path("dem"), "--cache-dir", harness.path("cache"), "--assets-dir",
                   harness.path("assets"), *options, **others)

    def test_csv(self):
        request = {"detail": "large", "region": square(LAT, LON, 3000), "smallest_m": 20}
        expected = self.service.post("/v1/features", request, "text/csv")[2].decode()
        done = self.features(harness.write("region.json", request), "-o", harness.path("craters.csv"))
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(harness.path("craters.csv"), newline="") as file:
            self.assertEqual(file.read(), expected)
        self.assertIn(f"{len(expected)} bytes", done.stdout)
        done = self.features("-", "-o", "-", input=json.dumps(request))
        self.assertEqual(done.stdout, self.service.post("/v1/features", request)[2].decode())

    def test_what_is_written_through(self):
        """A pipe stays one, and a link stays what it is: there or not, its file is written."""
        request = harness.write("through.json", {"detail": "large", "region": square(LAT, LON, 1000)})
        expected = self.service.post("/v1/features", {"detail": "large", "region": square(LAT, LON, 1000)}, "text/csv")[2].decode()
        pipe, link, target = (harness.path(name) for name in ("pipe.csv", "link.csv", "target.csv"))
        os.mkfifo(pipe)
        reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
        self.assertEqual(self.features(request, "-o", pipe).returncode, 0)
        with open(reading) as file:
            self.assertEqual(file.read(), expected)
        self.assertTrue(stat.S_ISFIFO(os.stat(pipe).st_mode))
        os.symlink("second.csv", harness.path("first.csv"))
        for name, written in (("target.csv", target), ("first.csv", harness.path("second.csv"))):
            os.symlink(name, link)
            if name == "target.csv":
                harness.write(name, "old")
            self.assertEqual(self.features(request, "-o", link).returncode, 0)
            self.assertEqual(os.readlink(link), name)
            self.assertFalse(os.path.islink(written))
            with open(written) as file:
                self.assertEqual(file.read(), expected)
            os.remove(link)
        os.symlink("round.csv", harness.path("round.csv"))
        done = self.features(request, "-o", harness.path("round.csv"))
        self.assertEqual(done.returncode, 1)
        self.assertIn("round.csv: cannot be written: ", done.stderr)
        self.assertTrue(os.path.islink(harness.path("round.csv")))


if __name__ == "__main__":
    harness.main()
