#!/usr/bin/env python3
"""Time delay and integration of a line camera: what moves with its charge stays sharp, what drifts is averaged."""

import json
import unittest

import numpy as np

import harness
from harness import frame_request, tearDownModule

WIDTH, HEIGHT, FOV_DEG, ALTITUDE_M, SPEED_M_S = 48, 160, 4.0, 20000.0, 1600.0
PLACE = {"lat_deg": 0.1, "lon_deg": 30.1}
EAST, NORTH = np.array([-np.sin(np.radians(30.1)), np.cos(np.radians(30.1)), 0]), np.array([0.0, 0, 1])
SENSOR = {"optics": {"f_number": 4.0}, "detector": {"pixel_pitch_um": 10.0, "quantum_efficiency": 0.5, "gain_e_dn": 2.0,
                                                   "integration_time_s": 0.002, "photon_noise": False, "bit_depth": 16}}


def setUpModule():
    harness.set_up()
    TdiTest.service = harness.service_with_assets()


class TdiTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        """The middle row looks at 0.17 N."""
        ground = json.loads(cls.service.post("/v1/heights", {"points": [PLACE | {"lat_deg": 0.17}]})[2])["points"][0]["height_m"]
        cls.line_m = (ALTITUDE_M - ground) * 2 * np.tan(np.radians(FOV_DEG / 2)) / WIDTH

    def frame(self, lines=1.0, across=0.0, stages=None, seconds=0.002, **tdi):
        """A strip toward north, along the camera's +y; the image moves by `lines` lines a line time, and by `across`."""
        line_s = lines * self.line_m / SPEED_M_S
        sensor = {"optics": SENSOR["optics"], "detector": SENSOR["detector"] | {"integration_time_s": seconds},
                  **({"tdi": {"stages": stages, **tdi}} if stages else {})}
        request = frame_request(
            ("image", "position"), width=WIDTH, height=HEIGHT, band={"center_um": 0.65, "width_um": 0.1}, sensor=sensor,
            surface={"preset": "moon"}, sun={"local": PLACE | {"azimuth_deg": 60.0, "elevation_deg": 5.0}}, shutter={"line_time_s": line_s, "pushbroom": True,
                                                 "velocity_m_s": (SPEED_M_S * NORTH + across * self.line_m / line_s * EAST).tolist()},
            pose={"geodetic": PLACE | {"height_m": ALTITUDE_M}, "nadir": {"up_azimuth_deg": 180}})
        request["camera"]["fov_deg"] = FOV_DEG
        return self.service.arrays(request)

    def test_what_moves_with_its_charge_is_sharp(self):
        plain, tdi = self.frame(), self.frame(stages=64)
        self.assertLess(tdi["meta"]["motion"]["longest_streak_px"], 1)
        np.testing.assert_array_equal(tdi["image"], plain["image"])
        np.testing.assert_array_equal(tdi["position"], plain["position"])

    def test_drift_along_the_lines_is_a_mean_over_rows(self):
        plain, tdi = self.frame(0.9), self.frame(0.9, stages=60)
        drift_px = tdi["meta"]["motion"]["longest_streak_px"]
        self.assertAlmostEqual(drift_px, 6, delta=0.7)
        self.assert_mean(plain["image"].astype(float), tdi["image"].astype(float), drift_px, axis=0)

    def test_drift_across_the_lines_is_a_mean_over_columns(self):
        plain, tdi = self.frame(across=0.1), self.frame(across=0.1, stages=60)
        self.assertAlmostEqual(tdi["meta"]["motion"]["longest_streak_px"], 6, delta=0.5)
        self.assert_mean(plain["image"].astype(float), tdi["image"].astype(float), 6, axis=1)

    def assert_mean(self, plain, blurred, length_px, axis):
        n = int(round(length_px)) | 1
        mean = np.apply_along_axis(lambda v: np.convolve(v, np.ones(n) / n, "same"), axis, plain)
        inside = (slice(n, -n), slice(n, -n))
        off, far = np.std((blurred - mean)[inside]), np.std((blurred - plain)[inside])
        self.assertGreater(far, 0.01 * plain.mean())
        self.assertLess(off, 0.25 * far)

    def test_charge_that_moves_against_the_image_is_said(self):
        meta = self.frame(stages=32, reversed=True)["meta"]
        self.assertGreater(meta["motion"]["longest_streak_px"], 60)
        self.assertTrue(any("tdi.reversed" in warning for warning in meta["warnings"]), meta["warnings"])

    def test_more_time_than_the_stages_have_is_said(self):
        meta = self.frame(stages=2, seconds=0.05)["meta"]
        self.assertTrue(any("longer than the stages" in warning for warning in meta["warnings"]), meta["warnings"])

    def test_it_is_of_a_pushbroom(self):
        request = frame_request(("image",), band={"center_um": 0.65, "width_um": 0.1}, sensor=SENSOR | {"tdi": {"stages": 8}})
        status, _, body = self.service.frame(request)
        self.assertEqual(status, 422, body[:300])
        self.assertIn("/sensor/tdi", body.decode())


if __name__ == "__main__":
    harness.main()
