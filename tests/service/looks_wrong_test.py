#!/usr/bin/env python3
"""Makes each symptom of api/looks-wrong.md, and checks what the page says of its metadata and its fix."""

import json
import os
import re
import unittest

import numpy as np
from osgeo import gdal

import harness
from harness import frame_request, REPOSITORY, Service, tearDownModule

gdal.UseExceptions()

LAT, LON = -0.5, 30.5
SENSOR = {"optics": {"f_number": 5.6}, "detector": {
    "pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "full_well_e": 13500, "read_noise_e": 13, "gain_e_dn": 3.4, "bit_depth": 12}}
BAND = {"center_um": 0.65, "width_um": 0.2}


def setUpModule():
    harness.set_up()
    harness.sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")


def nadir(height_m=20000.0, **members):
    return {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": height_m}, "nadir": {"up_azimuth_deg": 0.0, **members}}


def sun(elevation_deg=15.0, **place):
    return {"local": {"lat_deg": LAT, "lon_deg": LON, "azimuth_deg": 90.0, "elevation_deg": elevation_deg, **place}}


class LooksWrong(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.service = harness.service_with_assets()

    @classmethod
    def tearDownClass(cls):
        cls.service.expect_clean_stop()

    def frame(self, products=("image", "radiance"), service=None, **changes):
        f = (service or self.service).arrays(frame_request(products, **{"pose": nadir(), "sun": sun(), **changes}))
        return f, f["meta"]

    def warned(self, meta, text):
        self.assertTrue(any(text in warning for warning in meta["warnings"]), meta["warnings"])

    def test_every_row_has_a_test(self):
        with open(os.path.join(REPOSITORY, "api", "looks-wrong.md")) as file:
            rows = [line.split(" | ")[0].strip("| ") for line in file if line.startswith("| ")][1:]
        names = {name.removeprefix("test_it_is_") for name in dir(self) if name.startswith("test_it_is_")}
        self.assertEqual({re.sub(r"\W+", "_", row) for row in rows}, names)

    def test_it_is_black(self):
        f, meta = self.frame(sun=sun(-20))
        self.assertEqual(f["image"].max(), 0)
        self.assertLess(meta["view"]["sun"]["elevation_deg"], 0)
        self.warned(meta, "no signal")
        f, meta = self.frame(("image", "lit"), sun=sun(0.3), camera={"width": 8, "height": 8, "fov_deg": 0.05})
        self.assertEqual(f["lit"].max(), 0, "not behind terrain")
        self.assertGreater(meta["view"]["sun"]["elevation_deg"], 0)
        self.warned(meta, "no signal")

    def test_it_is_black_and_should_see_the_Moon(self):
        f, meta = self.frame(pose=nadir(tilt_deg=180, azimuth_deg=0))
        self.assertEqual((f["image"].max(), meta["hit_fraction"]), (0, 0))
        self.warned(meta, "would look at the Moon")

    def test_it_is_black_although_lit(self):
        f, meta = self.frame(image={"full_scale_radiance": 1e5})
        self.assertEqual(f["image"].max(), 0)
        self.assertGreater(meta["full_scale_radiance_w_m2_sr"], 100 * f["radiance"].max())
        f, _ = self.frame(image={"full_scale_radiance": "auto"})
        self.assertEqual(f["image"].max(), 255)

    def test_it_is_white(self):
        f, meta = self.frame(image={"full_scale_radiance": 1})
        self.assertGreater(np.mean(f["image"] == 255), 0.5)
        self.assertGreater(meta["saturated_fraction"], 0.01)
        self.warned(meta, "saturated")
        long = {**SENSOR, "detector": {**SENSOR["detector"], "integration_time_s": 1}}
        _, meta = self.frame(sensor=long, band=BAND)
        self.assertGreater(meta["exposure"]["saturated_fraction"], 0.5)
        chosen = {**SENSOR, "exposure": {"target_fill": 0.8}}
        _, meta = self.frame(sensor=chosen, band=BAND)
        self.assertLess(meta["exposure"]["saturated_fraction"], 0.01)

    def test_it_is_grainy(self):
        def drawn(samples):
            f, meta = self.frame(("radiance",), pose=nadir(2e5), camera={"width": 64, "height": 64, "fov_deg": 8},
                                 accuracy={"samples_per_pixel": samples})
            return f["radiance"], meta
        (one, meta), (sixteen, _), (mean, _) = drawn(1), drawn(16), drawn(256)
        self.assertLess(meta["view"]["post_px"], 1)
        self.assertLess(np.abs(sixteen - mean).mean(), 0.4 * np.abs(one - mean).mean())

    def test_it_is_noise_alone(self):
        night = sun(-20)
        metered = {**SENSOR, "exposure": {"target_fill": 0.5, "longest_s": 1e4, "metering": {"statistic": "mean"}}}
        f, meta = self.frame(sensor=metered, band=BAND, sun=night)
        self.assertEqual(meta["exposure"]["brightest_signal_e"], 0)
        self.assertGreater(f["image"].std(), 0)
        self.warned(meta, "no signal")
        _, meta = self.frame(sensor=metered, band=BAND, sun=night,
                             indirect={"earth": {"direction": [1.0, 0.0, 0.0]}}, surface={"preset": "moon"})
        self.assertGreater(meta["exposure"]["brightest_signal_e"], 100 * SENSOR["detector"]["read_noise_e"])
        short = {**SENSOR, "detector": {**SENSOR["detector"], "integration_time_s": 1e-7}}
        _, meta = self.frame(sensor=short, band=BAND)
        self.assertLess(meta["exposure"]["brightest_signal_e"], SENSOR["detector"]["read_noise_e"])
        self.warned(meta, "below the read noise")

    def test_it_is_shifted_by_half_a_pixel(self):
        camera = {"width": 64, "height": 48, "fx": 80.0, "fy": 80.0}
        right, _ = self.frame(("position",), camera={**camera, "cx": 31.5, "cy": 23.5})
        wrong, meta = self.frame(("position",), camera={**camera, "cx": 32.0, "cy": 24.0})
        self.assertEqual(meta["request"]["camera"]["cx"], 64 / 2)
        pixel_m = np.linalg.norm(np.diff(right["position"], axis=1), axis=2).mean()
        moved_m = np.linalg.norm(right["position"] - wrong["position"], axis=2).mean()
        self.assertAlmostEqual(moved_m / pixel_m, np.hypot(0.5, 0.5), delta=0.1)

    def test_it_is_upside_down(self):
        up, _ = self.frame()
        down, meta = self.frame(pose=nadir(up_azimuth_deg=180.0))
        self.assertAlmostEqual(meta["view"]["up_azimuth_deg"] % 360, 180, places=6)
        self.assertGreater(np.corrcoef(up["radiance"].ravel(), down["radiance"][::-1, ::-1].ravel())[0, 1], 0.9)

    def test_it_is_apparently_mirrored(self):
        f, meta = self.frame(("geodetic",))
        self.assertGreater(f["geodetic"][:, -1, 1].mean(), f["geodetic"][:, 0, 1].mean())
        corners = meta["view"]["corners"]
        self.assertGreater(corners[1]["lon_deg"], corners[0]["lon_deg"])

    def test_it_is_without_shadows(self):
        f, meta = self.frame(("lit",), sun=sun(5, lon_deg=LON - 60))
        self.assertGreater(f["lit"].mean(), 0.999)
        self.assertGreater(meta["view"]["sun"]["elevation_deg"], 60)
        f, meta = self.frame(("lit",), sun=sun(5))
        self.assertLess(f["lit"].mean(), 0.97)
        self.assertAlmostEqual(meta["view"]["sun"]["elevation_deg"], 5, delta=0.5)

    def test_it_is_cut_by_a_step(self):
        os.mkdir(harness.path("layers"))
        for name in os.listdir(harness.path("dem")):
            os.symlink(harness.path("dem", name), harness.path("layers", name))
        side = 256
        heights = self.service.arrays({"map": {"projection": "equirectangular", "gsd_m": 0.1 / side * np.radians(1) * 1737400,
                                               "bounds": {"south_deg": LAT - 0.05, "north_deg": LAT + 0.05, "west_deg": LON - 0.05,
                                                          "east_deg": LON + 0.05}}, "products": ["height"]}, "/v1/maps")["height"]
        raised = gdal.GetDriverByName("GTiff").Create(harness.path("layers", "raised.tif"), heights.shape[1], heights.shape[0], 1, gdal.GDT_Float32)
        raised.SetGeoTransform((LON - 0.05, 0.1 / heights.shape[1], 0, LAT + 0.05, 0, -0.1 / heights.shape[0]))
        raised.SetProjection('GEOGCS["Moon",DATUM["Moon",SPHEROID["Moon",1737400,0]],PRIMEM["Reference Meridian",0],UNIT["degree",0.0174532925199433]]')
        raised.GetRasterBand(1).WriteArray(heights + 300)
        raised.GetRasterBand(1).SetUnitType("m")
        raised = None
        layers = ("--dem", harness.path("layers"), "--cache-dir", harness.path("layers-cache"))
        told = json.loads(harness.run("info", "--json", "--borders", "8", *layers).stdout)
        self.assertAlmostEqual(told["borders"][0]["step_in_files"]["mean_m"], 300, delta=1)
        service = Service(dem=harness.path("layers"), cache="layers-cache-2")
        _, meta = self.frame(service=service)
        self.assertEqual(len(meta["sources"]), 2)
        service.expect_clean_stop()

    def test_it_is_blurred(self):
        def contrast(**changes):
            f, meta = self.frame(("radiance",), pose={"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_above_ground_m": 300},
                                                      "nadir": {}}, **changes)
            return np.abs(np.diff(f["radiance"], axis=1)).mean() / f["radiance"].mean(), meta
        blurred, meta = contrast()
        self.assertGreater(meta["view"]["post_px"], 8)
        self.warned(meta, "posts")
        self.assertGreater(contrast(detail="landing")[0], 5 * blurred)

    def test_it_is_too_dark_by_1_8(self):
        default, meta = self.frame()
        self.assertEqual(meta["request"]["surface"]["reflectance"]["rho"], 0.12)
        moon, _ = self.frame(surface={"preset": "moon"})
        self.assertAlmostEqual(moon["radiance"].mean() / default["radiance"].mean(), 1.8, delta=0.1)
        _, meta = self.frame(image={"full_scale_radiance": 20})
        self.warned(meta, "default reflectance")


if __name__ == "__main__":
    harness.main()
