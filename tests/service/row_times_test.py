#!/usr/bin/env python3
"""Rows with times over HTTP: a strip of a line camera, its ground projected back into it, and what is refused by name."""

import json
import math
import unittest

import numpy as np

import harness
from harness import frame_request, sample

MOON_M = 1737400.0
WIDTH, ROWS = 32, 256
LINE_TIME_S = 0.05
# Northward over 0 N 30 E at 20 km; +x is west, +y north: the rows go on to the north.
POSE = {"geodetic": {"lat_deg": -0.2, "lon_deg": 30.1, "height_m": 20000.0}, "nadir": {"up_azimuth_deg": 180.0}}
VELOCITY = [0.0, 0.0, 1600.0]
TURN = [math.degrees(1600.0 / (MOON_M + 20000.0)), 0.0, 0.0]  # down stays down


def strip(**changes):
    request = frame_request(("geodetic", "lit", "depth"), width=WIDTH, height=ROWS, pose=POSE,
                            shutter={"line_time_s": LINE_TIME_S, "velocity_m_s": VELOCITY, "angular_rate_deg_s": TURN,
                                     "pushbroom": True})
    request.update(changes)
    return request


def poses_along(times_s):
    """The same way as poses at times."""
    speed = 1600.0 / (MOON_M + 20000.0)
    return [{"time_s": t, "pose": {"geodetic": {"lat_deg": -0.2 + math.degrees(speed * t), "lon_deg": 30.1, "height_m": 20000.0},
                                   "nadir": {"up_azimuth_deg": 180.0}}} for t in times_s]


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    RowTimes.service = harness.Service()


def tearDownModule():
    harness.tear_down()


class RowTimes(unittest.TestCase):
    def frame(self, request):
        f = self.service.arrays(request)
        return f, f["meta"], f["headers"]

    def expect_closure(self, request):
        arrays, meta, _ = self.frame(request)
        self.assertEqual(meta["visibility"], "raytrace")
        ground = arrays["geodetic"]
        self.assertEqual(ground.shape, (ROWS, WIDTH, 3))
        self.assertGreater(np.ptp(ground[:, :, 0]), 0.6)  # degrees of latitude: 20 km of a strip whose line is 14 km wide
        rows, columns = np.mgrid[0:ROWS:5, 0:WIDTH:3]
        points = [{"lat_deg": g[0], "lon_deg": g[1], "height_m": g[2]} for g in ground[rows, columns].reshape(-1, 3)]
        body = {name: request[name] for name in ("camera", "pose", "shutter", "sun") if name in request}
        status, _, answer = self.service.post("/v1/project", dict(body, points=points))
        self.assertEqual(status, 200, answer[:500])
        for point, row, column in zip(json.loads(answer)["points"], rows.flat, columns.flat):
            self.assertTrue(point["in_frame"], point)
            self.assertAlmostEqual(point["x_px"], column, delta=0.01)
            self.assertAlmostEqual(point["y_px"], row, delta=0.01)
            self.assertAlmostEqual(point["time_s"], row * LINE_TIME_S, delta=0.01 * LINE_TIME_S)
        return arrays, meta

    def test_a_strip_closes_and_its_metadata_are_a_request(self):
        arrays, meta = self.expect_closure(strip())
        shutter = meta["request"]["shutter"]
        self.assertEqual(shutter["line_time_s"], LINE_TIME_S)
        self.assertTrue(shutter["pushbroom"])
        again, meta_again, _ = self.frame(dict(meta["request"]))
        self.assertEqual(meta_again, meta)
        for name in ("geodetic", "lit", "depth"):
            self.assertTrue(np.array_equal(arrays[name], again[name], equal_nan=True))

    def test_poses_at_times_see_the_same(self):
        by_rates, _ = self.expect_closure(strip())
        request = strip(shutter={"line_time_s": LINE_TIME_S, "poses": poses_along([0, 3, 7, 10, 13]), "pushbroom": True})
        del request["pose"]
        by_poses, meta = self.expect_closure(request)
        self.assertNotIn("pose", meta["request"])
        # A straight line rises above the orbit's arc: 100 m in 20 km.
        self.assertLess(np.abs(by_rates["geodetic"] - by_poses["geodetic"])[:, :, :2].max(), 0.01)

    def test_a_fast_turning_cameras_own_points_are_in_its_frame(self):
        """However fast it turns: each place that a pixel sees is found, where that pixel or another one sees it."""
        pose = {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 20000.0}, "nadir": {"up_azimuth_deg": 20.0}}
        worst = 0.0
        for name, rate, line_time_s, pushbroom, fov_deg in (
                ("roll", [0, 0, 60], 0.005, False, 40), ("roll", [0, 0, -60], 0.01, False, 40), ("roll", [0, 0, 60], 0.02, False, 40),
                ("roll", [0, 0, 60], 0.05, False, 60), ("pitch", [10, 0, 0], 0.01, False, 40), ("pitch", [-60, 0, 0], 0.005, False, 40),
                ("pitch", [60, 0, 0], 0.0104, False, 40), ("yaw", [0, 60, 0], 0.005, False, 40), ("mixed", [20, -30, 60], 0.01, False, 40),
                ("line", [0, 0, 60], 0.01, True, 40), ("line", [30, 0, 5], 0.01, True, 40), ("line", [3, 20, 60], 0.02, True, 40)):
            with self.subTest(turn=name, rate=rate, line_time_s=line_time_s):
                request = frame_request(("geodetic",), width=96, height=64, pose=pose, shutter={
                    "line_time_s": line_time_s, "angular_rate_deg_s": rate, "pushbroom": pushbroom})
                request["camera"]["fov_deg"] = fov_deg
                ground = self.frame(request)[0]["geodetic"]
                seen = np.isfinite(ground[:, :, 2])
                self.assertGreater(seen.sum(), 3000)
                points = [{"lat_deg": g[0], "lon_deg": g[1], "height_m": g[2]} for g in ground[seen]]
                status, _, answer = self.service.post("/v1/project", {
                    "camera": request["camera"], "pose": pose, "shutter": request["shutter"], "points": points})
                self.assertEqual(status, 200, answer[:500])
                found = json.loads(answer)["points"]
                self.assertEqual([p for p in found if not p["in_frame"]], [])
                own = np.argwhere(seen)[:, ::-1]
                apart = np.abs(np.array([[p["x_px"], p["y_px"]] for p in found]) - own).max(axis=1)
                # What is elsewhere is seen by several rows: that place's pixels see ground within one of them, too.
                several = apart > 0.01
                worst = max([worst, *apart[~several]])
                self.assertLess(several.mean(), 0.5)
                for p, g in zip(np.array(found)[several], ground[seen][several]):
                    x, y = int(np.clip(np.floor(p["x_px"]), 0, 94)), int(np.clip(np.floor(p["y_px"]), 0, 62))
                    around = ground[y:y + 2, x:x + 2, :2].reshape(-1, 2)
                    self.assertAlmostEqual(p["time_s"], line_time_s * p["y_px"], delta=1e-9)
                    self.assertLess(np.nanmin(np.linalg.norm(around - g[:2], axis=1)), 2 * self.pixel_deg(ground), p)
        print(f"\n  found within {worst:.1e} px", end=" ", flush=True)

    @staticmethod
    def pixel_deg(ground):
        """The widest gap between neighbours."""
        return max(np.nanmax(np.linalg.norm(np.diff(ground[:, :, :2], axis=axis), axis=2)) for axis in (0, 1))

    def test_what_no_row_sees_says_so(self):
        request = strip()
        body = {name: request[name] for name in ("camera", "pose", "shutter")}
        status, _, answer = self.service.post("/v1/project", dict(body, points=[{"lat_deg": -0.8, "lon_deg": 30.1}]))
        self.assertEqual(status, 200)
        point = json.loads(answer)["points"][0]
        self.assertFalse(point["in_frame"] or point["visible"])
        self.assertEqual([point[name] for name in ("x_px", "y_px", "range_m", "time_s")], [None] * 4)
        self.assertEqual(point["reason"], "seen by no row")

    def test_the_tag_is_another_one(self):
        at_rest = frame_request(visibility="raytrace")
        still = dict(at_rest, shutter={"line_time_s": 0.001, "velocity_m_s": [0, 0, 0]})
        (a, _, a_headers), (b, _, b_headers) = self.frame(at_rest), self.frame(still)
        self.assertTrue(np.array_equal(a["radiance"], b["radiance"]))
        self.assertNotEqual(a_headers["ETag"], b_headers["ETag"])

    def expect_refusal(self, pointer, request, call="/v1/frames"):
        status, _, body = self.service.post(call, request)
        self.assertEqual(status, 422, body[:500])
        self.assertIn(pointer, [error["pointer"] for error in json.loads(body)["errors"]])

    def test_refusals_name_the_member(self):
        shutter = strip()["shutter"]
        self.expect_refusal("/visibility", strip(visibility="zbuffer"))
        self.expect_refusal("/shutter/line_time_s", strip(shutter=dict(shutter, line_time_s=0)))
        self.expect_refusal("/pose", strip(shutter={"line_time_s": 1, "poses": poses_along([0, 300])}))
        self.expect_refusal("/shutter", strip(shutter=dict(shutter, velocity_m_s=[-3000, 0, 0])))
        late = strip(shutter={"line_time_s": LINE_TIME_S, "poses": poses_along([0, 3])})
        del late["pose"]
        self.expect_refusal("/shutter/poses", late)
        project = {name: strip()[name] for name in ("camera", "shutter")}
        self.expect_refusal("/pose", dict(project, points=[{"lat_deg": 0, "lon_deg": 30}]), "/v1/project")


if __name__ == "__main__":
    harness.main()
