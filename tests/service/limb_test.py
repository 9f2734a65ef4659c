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
from harness import path, Service, tearDownModule

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


def limb(**changes):
    document = {k: v for k, v in {**APPROACH, **changes}.items() if v is not None}
    status, _, body = service.post("/v1/limb", document)
    return status, json.loads(body)


class Answer(unittest.TestCase):

    def test_npz_has_what_json_has(self):
        points = limb()[1]["points"]
        arrays = service.arrays(APPROACH, "/v1/limb")
        self.assertEqual(arrays["position_m"].tolist(), [p["position_m"] for p in points])
        self.assertEqual(arrays["in_frame"][:, 0].tolist(), [p["in_frame"] for p in points])
        for name in set(points[0]) - {"position_m", "in_frame"}:
            self.assertEqual(arrays[name][:, 0].tolist(), [p[name] for p in points], name)

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
