#!/usr/bin/env python3
"""POST /v1/limb over HTTP: a global DEM of constant height, whose limb has a formula."""

import json
import math
import os
import struct
import sys
import unittest

import numpy as np

import harness
from harness import Service, path

sys.path.insert(0, os.path.join(harness.REPOSITORY, "api", "clients", "python"))
from selenograph import Client  # noqa: E402

RADIUS_M, HEIGHT_M, RANGE_M = 1737400.0, 1500.0, 8.0e6
LABEL = """PDS_VERSION_ID = "PDS3"
MISSION_NAME = SELENE
^IMAGE = ("global.img", 1 <BYTES>)
OBJECT = IMAGE_MAP_PROJECTION
MAP_PROJECTION_TYPE = "SIMPLE CYLINDRICAL"
MAP_RESOLUTION = 1
MAXIMUM_LATITUDE = 90
MINIMUM_LATITUDE = -90
WESTERNMOST_LONGITUDE = 0
EASTERNMOST_LONGITUDE = 359
LINE_PROJECTION_OFFSET = 90
SAMPLE_PROJECTION_OFFSET = 0
END_OBJECT = IMAGE_MAP_PROJECTION
OBJECT = IMAGE
LINES = 181
LINE_SAMPLES = 360
SAMPLE_TYPE = PC_REAL
SAMPLE_BITS = 32
DUMMY = -99999
END_OBJECT = IMAGE
END
"""
HALF = math.sqrt(0.5)
ATTITUDE = {"position_m": [RANGE_M, 0.0, 0.0], "look_at": {"lat_deg": 0.0, "lon_deg": 0.0}}
APPROACH = {"camera": {"width": 1024, "height": 1024, "fov_deg": 30.0}, "pose": ATTITUDE, "points": 24}
service = None


def setUpModule():
    global service
    harness.set_up()
    os.makedirs(path("dem"))
    harness.write("dem/global.lbl", LABEL.replace("\n", "\r\n"))
    harness.write("dem/global.img", struct.pack("<f", HEIGHT_M) * (181 * 360))
    service = Service()


def tearDownModule():
    harness.tear_down()


def limb(**changes):
    document = {k: v for k, v in {**APPROACH, **changes}.items() if v is not None}
    status, _, body = service.post("/v1/limb", document)
    return status, json.loads(body)


class Answer(unittest.TestCase):
    def test_it_is_the_limb_of_a_higher_sphere(self):
        status, answer = limb()
        self.assertEqual(status, 200, answer)
        focal_px = 512 / math.tan(math.radians(15))
        radii_px = [focal_px * math.tan(math.asin(r / RANGE_M)) for r in (RADIUS_M + HEIGHT_M, RADIUS_M)]
        self.assertEqual(len(answer["points"]), 24)
        for i, point in enumerate(answer["points"]):
            angle = math.radians(15 * i)
            self.assertAlmostEqual(point["azimuth_deg"], 15 * i)
            self.assertAlmostEqual(point["x_px"], 511.5 + radii_px[0] * math.cos(angle), delta=0.01)
            self.assertAlmostEqual(point["y_px"], 511.5 + radii_px[0] * math.sin(angle), delta=0.01)
            self.assertAlmostEqual(point["sphere_x_px"], 511.5 + radii_px[1] * math.cos(angle), delta=1e-6)
            self.assertAlmostEqual(point["difference_px"], radii_px[0] - radii_px[1], delta=0.01)
            self.assertAlmostEqual(point["height_m"], HEIGHT_M, delta=0.1)
            self.assertAlmostEqual(np.linalg.norm(point["position_m"]), RADIUS_M + point["height_m"], delta=1e-3)
            self.assertTrue(point["in_frame"])
            self.assertNotIn("reason", point)

    def test_from_where_meridians_of_posts_lie_in_the_half_planes(self):
        for place in ({"lat_deg": -90.0, "lon_deg": 0.0}, {"lat_deg": 0.0, "lon_deg": 180.0}, {"lat_deg": -45.0, "lon_deg": 180.0}):
            for point in limb(pose={"geodetic": {**place, "height_m": RANGE_M}, "nadir": {}}, points=4)[1]["points"]:
                self.assertIsNotNone(point["position_m"], (place, point))
                self.assertAlmostEqual(point["height_m"], HEIGHT_M, delta=0.1)

    def test_npz_has_what_json_has(self):
        points = limb()[1]["points"]
        arrays = service.arrays(APPROACH, "/v1/limb")
        self.assertEqual(arrays["position_m"].tolist(), [p["position_m"] for p in points])
        self.assertEqual(arrays["in_frame"][:, 0].tolist(), [p["in_frame"] for p in points])
        for name in set(points[0]) - {"position_m", "in_frame"}:
            self.assertEqual(arrays[name][:, 0].tolist(), [p[name] for p in points], name)

    def test_the_terminator_is_the_limb_from_the_sun(self):
        sun = {"direction": [0.0, 1.0, 0.0]}
        answer = limb(sun=sun)[1]
        self.assertEqual(len(answer["points"]), 24)
        for i, point in enumerate(answer["terminator"]):
            angle = math.radians(15 * i)  # from north to east as the Sun sees it, which is toward -x
            place = (RADIUS_M + HEIGHT_M) * np.array([-math.sin(angle), 0, math.cos(angle)])
            # Between flat triangles the limb is where an edge is.
            self.assertLess(np.linalg.norm(np.array(point["position_m"]) - place), 400)
            self.assertAlmostEqual(np.linalg.norm(point["position_m"]), RADIUS_M + HEIGHT_M, delta=0.1)
            depth = RANGE_M - place[0]
            focal_px = 512 / math.tan(math.radians(15))
            self.assertAlmostEqual(point["y_px"], 511.5 - focal_px * place[2] / depth, delta=0.1)
            self.assertAlmostEqual(point["x_px"], 511.5, delta=0.1)
            self.assertTrue(point["in_frame"])
            near = -math.sin(angle) > RADIUS_M / RANGE_M
            self.assertEqual((point["visible"], point["sphere_visible"]), (near, near), i)
        arrays = service.arrays({**APPROACH, "sun": sun}, "/v1/limb")
        self.assertEqual(arrays["terminator_position_m"].tolist(), [p["position_m"] for p in answer["terminator"]])
        self.assertEqual(arrays["terminator_visible"][:, 0].tolist(), [p["visible"] for p in answer["terminator"]])
        self.assertNotIn("terminator", limb()[1])

    def test_the_python_client(self):
        sun = {"direction": [0.0, 1.0, 0.0]}
        answer = limb(sun=sun)[1]
        with Client(f"http://{service.host}:{service.port}") as client:
            what = {"camera": APPROACH["camera"], "pose": APPROACH["pose"], "points": 24}
            for found, points in ((client.limb(**what), answer["points"]),
                                  (client.terminator(**what, sun=sun), answer["terminator"])):
                self.assertEqual(set(found.dtype.names), set(points[0]) - {"reason"})
                for name in found.dtype.names:
                    np.testing.assert_array_equal(found[name], [p[name] for p in points], name)

    def test_what_the_camera_does_not_see(self):
        away = {"position_m": [RANGE_M, 0.0, 0.0], "camera_from_moon": {"w": HALF, "x": 0, "y": -HALF, "z": 0}}
        for point in limb(pose=away)[1]["points"]:
            self.assertEqual((point["x_px"], point["difference_px"], point["in_frame"]), (None, None, False))
            self.assertIn("behind the camera", point["reason"])
            self.assertAlmostEqual(point["height_m"], HEIGHT_M, delta=0.1)

    def test_an_epoch_for_icrf(self):
        pose = {"frame": "ICRF", "position_m": [RANGE_M, 0.0, 0.0],
                "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}}
        status, answer = limb(pose=pose)
        self.assertEqual(status, 422, answer)
        self.assertTrue(answer["errors"][0]["pointer"].startswith("/pose"), answer)
        self.assertEqual(limb(pose={**pose, "utc": "2026-11-25T00:00:00Z"})[0], 200)

    def test_what_is_wrong_is_said(self):
        below = {"geodetic": {"lat_deg": 0.0, "lon_deg": 0.0, "height_m": HEIGHT_M - 10}, "nadir": {}}
        for changes, pointer in (({"points": 2}, "/points"), ({"points": 10001}, "/points"),
                                 ({"camera": None}, "/camera"), ({"pose": None}, "/pose"),
                                 ({"azimuths": 3}, "/azimuths"), ({"detail": "nowhere"}, "/detail"),
                                 ({"pose": below}, "/pose")):
            status, answer = limb(**changes)
            self.assertEqual(status, 422, answer)
            self.assertIn(answer["errors"][0]["pointer"], (pointer, ""), answer)


if __name__ == "__main__":
    harness.main()
