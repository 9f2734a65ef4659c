#!/usr/bin/env python3
"""The product `image` of a sensor, over HTTP: against radiance, against itself, against statistics."""

import copy
import json
import os
import unittest

import numpy as np

import harness
from harness import frame_request, tearDownModule

BAND = {"center_um": 0.65, "width_um": 0.3}
GROUND = {"reflectance": {"model": "lunar", "rho": 0.121}}  # not the default, of which frames by a sensor warn
SENSOR = {
    "optics": {"f_number": 4.0, "point_spread": {"model": "none"}, "vignetting": {"model": "none"}},
    "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.004, "photon_noise": False,
                 "gain_e_dn": 2.0, "offset_dn": 60.0, "bit_depth": 16},
}


def setUpModule():
    harness.set_up()
    SensorTest.service = harness.service_with_assets()


class SensorTest(unittest.TestCase):
    def frame(self, optics={}, detector={}, products=("image", "radiance"), **changes):
        sensor = copy.deepcopy(SENSOR)
        sensor["optics"].update(optics), sensor["detector"].update(detector)
        sensor.update({name: changes.pop(name) for name in ("seed", "frame") if name in changes})
        document = frame_request(products, **{"band": BAND, "sensor": sensor, "surface": GROUND, **changes})
        return self.service.arrays(document)

    # Eq. (8), gain and offset, pixel by pixel; of a narrow band, as the paper has it.
    def test_digital_numbers_are_equation_8(self):
        f = self.frame(band={"center_um": 0.65, "width_um": 0.002}, detector={"integration_time_s": 0.6})
        electrons = 0.6 * np.pi * 5.5e-6 ** 2 / (4 * 4.0 ** 2) * 0.4 * 0.65e-6 / (6.62607015e-34 * 299792458.0)
        expected = f["radiance"].astype(float) * electrons / 2 + 60
        self.assertEqual(f["image"].dtype, np.uint16)
        self.assertLess(np.abs(f["image"] - np.clip(expected, 0, 65535)).max(), 0.6)
        self.assertAlmostEqual(f["meta"]["full_scale_radiance_w_m2_sr"] * electrons / 2 + 60, 65535, delta=1)
        self.assertGreater(f["image"].max(), 1000)

    def test_metadata_are_of_the_bands_radiance_however_light_is_counted(self):
        """What glows is drawn again in photons. At 300 K nothing does that this band sees."""
        efficiency = [[0.5, 0.0], [0.65, 0.0], [0.7, 0.9], [0.8, 0.9]]
        surface = {"reflectance": {"model": "lambert", "rho": 0.1}}
        cold, warm = (self.frame(detector={"quantum_efficiency": efficiency}, surface=surface | {"temperature_k": t})
                      for t in (0.0, 300.0))
        self.assertLessEqual(np.abs(warm["image"].astype(int) - cold["image"]).max(), 1)
        for f in (cold, warm):
            brightest_e = 2 * (f["image"].max() - 60.0)
            self.assertAlmostEqual(f["meta"]["exposure"]["brightest_signal_e"] / brightest_e, 1, 3)
            full_scale = (65535 - 60) * f["radiance"].max() / (f["image"].max() - 60.0)
            self.assertAlmostEqual(f["meta"]["full_scale_radiance_w_m2_sr"] / full_scale, 1, 3)

    def test_sunlight_beside_moonlight_is_counted_in_its_own_spectrum(self):
        """The Moon is redder than the Sun: an object is as bright over any ground."""
        wide = {"center_um": 1.2, "width_um": 1.6}
        detector = {"quantum_efficiency": [[0.35, 0.9], [0.6, 0.6], [1.0, 0.2], [2.1, 0.05]], "gain_e_dn": 2.0,
                    "offset_dn": 0.0}
        place = {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 5000}}
        object = {"mesh": "satellite", "scale": 5.0, "pose": place | {"upright": {}},
                 "material": {"reflectance": {"model": "lambert", "rho": 0.1}}}
        above = {"geodetic": place["geodetic"] | {"height_m": 5100}, "nadir": {"up_azimuth_deg": 0.0}}
        camera = {"model": "pinhole", "width": 32, "height": 32, "fov_deg": 10.0}
        products = ["image", "radiance", "object_id"]
        lambert, moon = (self.frame(detector=detector, products=products, band=wide, surface=surface, objects=[object],
                                    pose=above, camera=camera)
                         for surface in ({"reflectance": {"model": "lambert", "rho": 0.12}}, {"preset": "moon"}))
        on = (lambert["object_id"] != 65535) & (lambert["radiance"] > 0)
        self.assertGreater(on.sum(), 50)
        np.testing.assert_array_equal(lambert["radiance"][on], moon["radiance"][on])
        self.assertGreater(lambert["image"][on].max(), 5000)
        self.assertLess(lambert["image"][on].max(), 65535)
        self.assertLessEqual(abs(lambert["image"][on] - moon["image"][on].astype(float)).max(), 5)

    def test_an_efficiency_beside_the_band_is_refused(self):
        sensor = copy.deepcopy(SENSOR)
        sensor["detector"]["quantum_efficiency"] = [[2.0, 0.4], [3.0, 0.4]]
        status, _, body = self.service.frame(frame_request(("image",), band=BAND, sensor=sensor))
        self.assertEqual(status, 422)
        self.assertEqual(json.loads(body)["errors"][0]["pointer"], "/sensor/detector/quantum_efficiency")

    def auto_exposed(self, fill, exposure={}, **detector):
        document = copy.deepcopy(SENSOR)
        del document["detector"]["integration_time_s"]
        document["detector"].update(detector)
        document["exposure"] = {"target_fill": fill, **exposure}
        f = self.service.arrays(frame_request(("image",), band=BAND, sensor=document, surface=GROUND))
        return f["image"], f["meta"]

    def fill_of(self, image, full):
        """What all but the brightest thousandth of the pixels stay within."""
        return (np.sort(image, axis=None)[-1 - image.size // 1000] - 60) / full

    def test_the_frame_chooses_its_integration_time(self):
        for detector, full in (({}, 65535 - 60), ({"full_well_e": 50000.0}, 25000)):
            image, meta = self.auto_exposed(0.6, **detector)
            self.assertAlmostEqual(self.fill_of(image, full), 0.6, delta=0.001)
            time_s = meta["exposure"]["integration_time_s"]
            given = self.frame(products=("image",), detector={"integration_time_s": time_s, **detector})
            self.assertTrue(np.array_equal(given["image"], image), "another time than it says")
            self.assertEqual(meta["warnings"], [])
        self.assertEqual(meta["request"]["sensor"]["exposure"]["target_fill"], 0.6)

    def test_metering_by_a_region(self):
        region = {"x": 4, "y": 6, "width": 20, "height": 10}
        for metering, statistic in (({"statistic": "mean"}, np.mean), ({"percentile": 50.0}, lambda pixels: np.sort(pixels, axis=None)[99])):
            image, meta = self.auto_exposed(0.3, {"metering": {"region": region, **metering}})
            self.assertAlmostEqual(float(statistic(image[6:16, 4:24].astype(float)) - 60) / (65535 - 60), 0.3, delta=0.002)
            self.assertEqual(meta["warnings"], [])
        _, meta = self.auto_exposed(0.3, {"longest_s": 1e-5})
        self.assertIn("exposure.longest_s limits the integration time", meta["warnings"][0])
        for wrong, pointer in (({"region": {**region, "width": 4000}}, "region/width"), ({"statistic": "mean", "percentile": 50}, "percentile")):
            with self.assertRaisesRegex(AssertionError, "/sensor/exposure/metering/" + pointer):
                self.auto_exposed(0.3, {"metering": wrong})

    def test_the_exposure_counts_the_offset(self):
        detector = {"offset_dn": 1000.0, "bit_depth": 12, "gain_e_dn": 10.0}
        for fill in (0.25, 0.5, 1.0):
            image, _ = self.auto_exposed(fill, **detector)
            self.assertAlmostEqual(np.sort(image, axis=None)[-1 - image.size // 1000] / 4095, fill, delta=0.0003)
        # Full at 9000 electrons, which is less: 900 DN above the offset.
        image, _ = self.auto_exposed(0.5, full_well_e=9000.0, **detector)
        self.assertAlmostEqual(np.sort(image, axis=None)[-1 - image.size // 1000], 1450, delta=1)
        with self.assertRaisesRegex(AssertionError, "/sensor/exposure/target_fill.*no light is left"):
            self.auto_exposed(0.24, **detector)

    def test_saturation_and_darkness_are_warned_of(self):
        burnt = self.frame(detector={"integration_time_s": 0.5})["meta"]
        self.assertGreater(burnt["exposure"]["saturated_fraction"], 0.01)
        self.assertTrue(any("saturated" in w for w in burnt["warnings"]), burnt["warnings"])
        night = self.frame(sun={"local": {"lat_deg": 0.0, "lon_deg": 30.0, "azimuth_deg": 90.0, "elevation_deg": -30.0}})
        self.assertTrue(any("no signal" in w for w in night["meta"]["warnings"]), night["meta"]["warnings"])
        self.assertEqual(self.frame()["meta"]["warnings"], [])

    def test_a_signal_below_the_noise_is_warned_of(self):
        """Nanometres as micrometres, metres as micrometres: an image of noise alone."""
        noise = {"read_noise_e": 10.0}
        good = self.frame(detector=noise)["meta"]
        self.assertEqual(good["warnings"], [])
        self.assertGreater(good["exposure"]["brightest_signal_e"], 100)
        pitch_um = SENSOR["detector"]["pixel_pitch_um"]
        for detector in ({"pixel_pitch_um": pitch_um * 1e-6}, {"integration_time_s": 1e-9}):
            meta = self.frame(detector={**noise, **detector})["meta"]
            self.assertRegex("".join(meta["warnings"]), "the signal is below the read noise.*pixel pitch")
        # At the limit: of pixels of a tenth of the side, a hundredth of the electrons.
        limit_e = good["exposure"]["brightest_signal_e"] / 100
        for read_noise_e, warned in ((1.01 * limit_e, True), (0.99 * limit_e, False)):
            meta = self.frame(detector={"pixel_pitch_um": pitch_um / 10, "read_noise_e": read_noise_e, "gain_e_dn": 1e-3})["meta"]
            self.assertAlmostEqual(meta["exposure"]["brightest_signal_e"] / limit_e, 1, 6)
            self.assertEqual(any("below the read noise" in w for w in meta["warnings"]), warned, meta["warnings"])
        nanometres = self.frame(detector=noise, band={"center_um": 550.0, "width_um": 100.0})["meta"]["warnings"]
        self.assertTrue(any("read noise" in w for w in nanometres) and any("nanometres" in w for w in nanometres), nanometres)

    def test_two_times_or_none_are_refused(self):
        for detector, exposure in (({"integration_time_s": 0.01}, {"target_fill": 0.5}), ({}, None)):
            sensor = copy.deepcopy(SENSOR)
            del sensor["detector"]["integration_time_s"]
            sensor["detector"].update(detector)
            if exposure:
                sensor["exposure"] = exposure
            status, _, body = self.service.frame(frame_request(("image",), band=BAND, sensor=sensor))
            self.assertEqual(status, 422)
            self.assertEqual(json.loads(body)["errors"][0]["pointer"],
                             "/sensor/exposure" if exposure else "/sensor/detector/integration_time_s")

    # Light from outside of the image: the border is that of a larger image.
    def test_point_spread_knows_what_is_beyond_the_border(self):
        spread = {"point_spread": {"model": "gaussian", "sigma_px": 2.0}}
        request = frame_request()
        small = self.frame(optics=spread, products=("image", "radiance", "position", "lit"))
        w, h = request["camera"]["width"], request["camera"]["height"]
        fx = 0.5 * w / np.tan(np.radians(request["camera"]["fov_deg"] / 2))
        large_camera = {"width": w + 40, "height": h + 40, "fx": fx, "fy": fx, "cx": (w + 39) / 2, "cy": (h + 39) / 2}
        large = self.frame(optics=spread, products=("image", "radiance", "position", "lit"), camera=large_camera)
        inner = (slice(20, -20), slice(20, -20))
        for product in ("radiance", "position", "lit"):
            self.assertEqual(small[product].shape[:2], (h, w))
        self.assertTrue(np.allclose(small["position"], large["position"][inner], atol=1e-6))
        difference = small["image"].astype(int) - large["image"][inner]
        # Both choose their terrain by themselves: a few pixels see another level of detail.
        self.assertLess(np.mean(np.abs(difference) > 2), 0.02)
        self.assertEqual(small["meta"]["point_spread"]["margin_px"], 9)
        sharp = self.frame()
        self.assertLess(small["image"].std(), sharp["image"].std())
        self.assertAlmostEqual(small["image"].mean() / sharp["image"].mean(), 1, 1)

    def test_stray_light_is_scattered_and_described(self):
        law = {"b0_sr": 2.0, "shoulder": 0.01, "slope": -1.8, "sun_within_deg": 80}
        sharp, scattered = self.frame(), self.frame(optics={"stray_light": law})
        share = scattered["meta"]["stray_light"]["scattered_fraction"]
        by_hand = np.pi * 2.0 * 0.01 ** 2 / 0.1 * ((1 + 1e4) ** 0.1 - 1)
        self.assertAlmostEqual(share, by_hand, delta=1e-9)
        light = [f["image"].astype(float) - 60 for f in (sharp, scattered)]
        self.assertTrue(np.all(light[1] >= np.floor((1 - share) * light[0]) - 1))
        self.assertGreater(light[1].sum(), (1 - share) * light[0].sum())
        self.assertEqual(scattered["meta"]["request"]["sensor"]["optics"]["stray_light"], law)
        self.assertNotIn("stray_light", sharp["meta"])
        fisheye = {"model": "fisheye", "width": 64, "height": 64, "fov_deg": 180}
        for changes, optics, pointer in (({}, {**law, "b0_sr": 9e5}, "/sensor/optics/stray_light/b0_sr"),
                                         ({}, {**law, "slope": 1}, "/sensor/optics/stray_light/slope"),
                                         ({"camera": fisheye}, law, "/sensor/optics/stray_light")):
            sensor = copy.deepcopy(SENSOR)
            sensor["optics"]["stray_light"] = optics
            status, _, body = self.service.frame(frame_request(("image",), band=BAND, sensor=sensor, **changes))
            self.assertEqual((status, json.loads(body)["errors"][0]["pointer"]), (422, pointer), body)

    # The z-buffer draws four samples of a pixel at once, which the point spread takes one by one.
    def test_both_visibilities_give_one_image_of_samples(self):
        spread = dict(SENSOR, optics={"f_number": 4.0, "point_spread": {"model": "gaussian", "sigma_px": 0.7}})
        for samples in (4, 16):
            drawn, cast = (self.service.arrays(frame_request(["image"], samples=samples, band=BAND, surface=GROUND, sensor=spread,
                                                             visibility=visibility))["image"].astype(int)
                           for visibility in ("zbuffer", "raytrace"))
            self.assertGreater(drawn.std(), 1000)
            self.assertLessEqual(np.abs(drawn - cast).max(), 1)

    # The mean of frames at the moments between, of which a client can ask for each by itself.
    def test_motion_is_the_mean_of_moments(self):
        still = self.frame(products=("image", "radiance"))
        pose = still["meta"]["request"]["pose"]
        q = np.array([pose["camera_from_moon"][k] for k in "wxyz"])
        rate, velocity, t, n = np.array([3.0, -20.0, 40.0]), np.array([400.0, 900.0, -1500.0]), 0.05, 4

        def at(seconds):
            turn = np.radians(rate) * seconds
            angle = np.linalg.norm(turn)
            w, v = np.cos(angle / 2), -np.sin(angle / 2) * turn / angle
            product = np.append(w * q[0] - v @ q[1:], w * q[1:] + q[0] * v + np.cross(v, q[1:]))
            return {"frame": "MOON_ME", "position_m": list(np.array(pose["position_m"]) + velocity * seconds), "axes": "opencv",
                    "camera_from_moon": dict(zip("wxyz", product / np.linalg.norm(product)))}

        detector = {"integration_time_s": t, "gain_e_dn": 25.0}
        document = frame_request(["image"], band=BAND, surface=GROUND, sensor=dict(
            SENSOR, detector=dict(SENSOR["detector"], **detector),
            motion={"angular_rate_deg_s": list(rate), "velocity_m_s": list(velocity), "samples": n}))
        blurred = self.service.arrays(document)["image"].astype(float)
        moments = [self.frame(detector=detector, pose=at(((k + 0.5) / n - 0.5) * t))["image"].astype(float) for k in range(n)]
        self.assertLess(np.abs(blurred - np.mean(moments, axis=0)).max(), 1.01)
        self.assertGreater(np.abs(moments[0] - moments[-1]).max(), 100)
        at_rest = self.frame(detector=detector)["image"].astype(float)
        self.assertGreater(np.abs(blurred - at_rest).max(), 30)

    # A file that users copy and edit; a request may change any member of it.
    def test_presets(self):
        path = os.path.join(harness.path("assets"), "cameras")
        with open(os.path.join(path, "navigation-camera.json")) as file:
            preset = json.load(file)
        del preset["description"]
        request = frame_request(["image"])
        del request["camera"]
        tags = []
        for changes in ({"camera_preset": "navigation-camera"}, preset,
                        {"camera_preset": "navigation-camera", "sensor": {"detector": {"integration_time_s": 0.002}, "frame": 4}},
                        dict(preset, sensor=dict(preset["sensor"], frame=4, detector=dict(preset["sensor"]["detector"], integration_time_s=0.002)))):
            status, headers, body = self.service.frame(dict(request, **changes), "image/png")
            self.assertEqual(status, 200, body[:300])
            tags.append((headers["ETag"], body))
        self.assertEqual(tags[0], tags[1])
        self.assertEqual(tags[2], tags[3])
        self.assertNotEqual(tags[0], tags[2])
        with open(os.path.join(path, "bare.json"), "w") as file:
            json.dump({"camera": preset["camera"]}, file)
        bare = dict(request, camera_preset="bare", image={"bit_depth": 8})
        answers = [self.service.frame(dict(bare, **numbered), "image/png")[::2] for numbered in ({}, {"sensor": {"frame": 7}})]
        self.assertEqual(answers[0][0], 200)
        self.assertEqual(answers[0], answers[1])  # no sensor has noise to number
        status, _, body = self.service.frame(dict(bare, sensor={"frame": 7, "detector": {"gain_e_dn": 2.0}}))
        self.assertEqual(status, 422)

        status, _, body = self.service.frame(dict(request, camera_preset="none-such"))
        self.assertEqual((status, [e["pointer"] for e in json.loads(body)["errors"]]), (422, ["/camera_preset"]))
        self.assertIn("navigation-camera", json.loads(body)["detail"])
        for text, said in (('{"sensor": {"optics": {"f_number": 0}}}', "/sensor"), ("[]", "object"), ("{", "parse error"),
                           ('{"pose": {}}', "pose")):
            with open(os.path.join(path, "broken.json"), "w") as file:
                file.write(text)
            status, _, body = self.service.frame(dict(request, camera_preset="broken"))
            self.assertEqual(status, 500, text)
            self.assertIn("broken.json", json.loads(body)["detail"])
            self.assertIn(said, json.loads(body)["detail"])


if __name__ == "__main__":
    harness.main()
