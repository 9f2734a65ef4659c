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

    def test_the_tag_is_another_one(self):
        at_rest = frame_request(visibility="raytrace")
        still = dict(at_rest, shutter={"line_time_s": 0.001, "velocity_m_s": [0, 0, 0]})
        (a, _, a_headers), (b, _, b_headers) = self.frame(at_rest), self.frame(still)
        self.assertTrue(np.array_equal(a["radiance"], b["radiance"]))
        self.assertNotEqual(a_headers["ETag"], b_headers["ETag"])


if __name__ == "__main__":
    harness.main()
