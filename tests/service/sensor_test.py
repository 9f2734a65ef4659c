#!/usr/bin/env python3
"""The product `image` of a sensor, over HTTP: against radiance, against itself, against statistics."""

import copy
import io
import json
import os
import unittest

import numpy as np

import harness
from harness import frame_request

BAND = {"center_um": 0.65, "width_um": 0.3}
SENSOR = {
    "optics": {"f_number": 4.0, "point_spread": {"model": "none"}, "vignetting": {"model": "none"}},
    "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.004, "photon_noise": False,
                 "gain_e_dn": 2.0, "offset_dn": 60.0, "bit_depth": 16},
}


def setUpModule():
    harness.set_up()
    SensorTest.service = harness.service_with_assets()


def tearDownModule():
    harness.tear_down()


class SensorTest(unittest.TestCase):
    def frame(self, optics={}, detector={}, products=("image", "radiance"), **changes):
        sensor = copy.deepcopy(SENSOR)
        sensor["optics"].update(optics), sensor["detector"].update(detector)
        sensor.update({name: changes.pop(name) for name in ("seed", "frame") if name in changes})
        document = frame_request(products, **{"band": BAND, "sensor": sensor, **changes})
        status, headers, body = self.service.frame(document, "application/x-npz")
        self.assertEqual(status, 200, body[:500])
        arrays = np.load(io.BytesIO(body))
        frame = {name: arrays[name] for name in arrays.files if name != "meta.json"}
        frame["meta"], frame["bytes"] = json.loads(bytes(arrays["meta.json"])), body
        return frame

    # Eq. (8), gain and offset, pixel by pixel; of a narrow band, as the paper has it.
    def test_digital_numbers_are_equation_8(self):
        f = self.frame(band={"center_um": 0.65, "width_um": 0.002}, detector={"integration_time_s": 0.6})
        electrons = 0.6 * np.pi * 5.5e-6 ** 2 / (4 * 4.0 ** 2) * 0.4 * 0.65e-6 / (6.62607015e-34 * 299792458.0)
        expected = f["radiance"].astype(float) * electrons / 2 + 60
        self.assertEqual(f["image"].dtype, np.uint16)
        self.assertLess(np.abs(f["image"] - np.clip(expected, 0, 65535)).max(), 0.6)
        self.assertAlmostEqual(f["meta"]["full_scale_radiance_w_m2_sr"] * electrons / 2 + 60, 65535, delta=1)
        self.assertGreater(f["image"].max(), 1000)

    # A band's electrons are those of its ten parts: of sunlight, of the ground's own light and of both.
    def test_a_wide_band_counts_its_photons(self):
        cases = [((0.4, 0.9), {}), ((3.0, 5.0), {"surface": {"temperature_k": 350.0}}),
                 ((3.0, 5.0), {"surface": {"temperature_k": 250.0}})]
        for (first, last), changes in cases:
            with self.subTest(changes=changes):
                whole_band = {"center_um": (first + last) / 2, "width_um": last - first}
                first_look = self.frame(products=("image",), band=whole_band, detector={"gain_e_dn": 1e4, "offset_dn": 0.0},
                                        **changes)["image"]
                gain = 1e4 * max(float(first_look.max()), 0.01) / 50000

                def electrons(a, b):
                    band = {"center_um": (a + b) / 2, "width_um": b - a}
                    f = self.frame(products=("image",), band=band, detector={"gain_e_dn": gain, "offset_dn": 0.0}, **changes)
                    self.assertEqual(f["meta"]["exposure"]["saturated_fraction"], 0)
                    return f["image"].astype(float)
                whole = electrons(first, last)
                edges = np.linspace(first, last, 11)
                parts = sum(electrons(a, b) for a, b in zip(edges, edges[1:]))
                self.assertGreater(whole.max(), 5000)
                bright = whole > 0.2 * whole.max()
                self.assertLess(np.abs(parts[bright] / whole[bright] - 1).max(), 6 / (0.2 * whole.max()) + 2e-4)

    # Efficiency by wavelength: one that is the same everywhere is a number.
    def test_efficiency_by_wavelength(self):
        constant = self.frame()["image"]
        flat = self.frame(detector={"quantum_efficiency": [[0.3, 0.4], [1.1, 0.4]]})
        self.assertLessEqual(np.abs(constant.astype(int) - flat["image"]).max(), 1)
        echoed = flat["meta"]["request"]["sensor"]["detector"]
        self.assertEqual(echoed["quantum_efficiency"], [[0.3, 0.4], [1.1, 0.4]])
        half = self.frame(detector={"quantum_efficiency": [[0.3, 0.4], [0.65, 0.4]]})["image"].astype(float) - 60
        lit = constant > 5000
        self.assertTrue(np.all((half[lit] / (constant[lit] - 60.0) > 0.4) & (half[lit] / (constant[lit] - 60.0) < 0.6)))

    # Samples are spread one by one: an image of 4 x 4 samples is that of 16 frames of one sample, each spread beside.
    # What the mean of their radiance would be, spread as a whole, is blurred by a pixel more.
    def test_a_point_spread_is_of_samples(self):
        spread = {"point_spread": {"model": "gaussian", "sigma_px": 0.6}}
        images = {}
        for visibility in ("raytrace", "zbuffer"):
            f = self.frame(optics=spread, products=("image", "radiance"), visibility=visibility,
                           accuracy={"samples_per_pixel": 16})
            images[visibility] = f["image"].astype(float) - 60
            scale = np.median(images[visibility][f["radiance"] > 0] / f["radiance"][f["radiance"] > 0])
        self.assertLess(np.abs(images["raytrace"] - images["zbuffer"]).mean(), 2e-3 * images["zbuffer"].mean())
        kernel = np.array([[np.exp(-0.5 * (x / 0.6) ** 2) for x in np.linspace(i - 0.5, i + 0.5, 101)] for i in range(-3, 4)]).mean(1)
        kernel /= kernel.sum()
        blurred = f["radiance"].astype(float) * scale
        for axis in (0, 1):
            blurred = np.apply_along_axis(lambda line: np.convolve(line, kernel, "same"), axis, blurred)
        inner = (slice(4, -4), slice(4, -4))
        sharpness = lambda image: np.abs(np.diff(image[inner], axis=1)).sum()
        self.assertGreater(sharpness(images["zbuffer"]), 1.01 * sharpness(blurred))
        self.assertLess(np.abs(images["zbuffer"][inner].mean() / blurred[inner].mean() - 1), 0.01)

    def test_an_efficiency_beside_the_band_is_refused(self):
        sensor = copy.deepcopy(SENSOR)
        sensor["detector"]["quantum_efficiency"] = [[2.0, 0.4], [3.0, 0.4]]
        status, _, body = self.service.frame(frame_request(("image",), band=BAND, sensor=sensor))
        self.assertEqual(status, 422)
        self.assertEqual(json.loads(body)["errors"][0]["pointer"], "/sensor/detector/quantum_efficiency")

    def auto_exposed(self, fill, **detector):
        document = copy.deepcopy(SENSOR)
        del document["detector"]["integration_time_s"]
        document["detector"].update(detector)
        document["exposure"] = {"target_fill": fill}
        status, _, body = self.service.frame(frame_request(("image",), band=BAND, sensor=document), "application/x-npz")
        self.assertEqual(status, 200, body[:500])
        arrays = np.load(io.BytesIO(body))
        return arrays["image"], json.loads(bytes(arrays["meta.json"]))

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

    def test_the_exposure_aims_at_what_is_read_out(self):
        """Smear adds the same to each exposure, however short; where it alone is too much, a warning says so."""
        reached = 0
        for noise in ({}, {"photon_noise": True, "read_noise_e": 13.0, "prnu": 0.003}):
            for smear_s in (0.0, 1e-6, 1e-4, 1e-3, 1e-2):
                for fill in (0.3, 0.8, 1.0):
                    with self.subTest(noise=noise, smear_s=smear_s, fill=fill):
                        image, meta = self.auto_exposed(fill, smear_time_s=smear_s, dark_current_e_s=2e5, **noise)
                        self.assertEqual(meta["exposure"]["saturated_fraction"], (image == 65535).mean())
                        if any("smear alone" in w for w in meta["warnings"]):
                            self.assertEqual(meta["exposure"]["integration_time_s"], 1e-6)
                            self.assertGreater(self.fill_of(image, 65535 - 60), fill - 0.001)
                        else:
                            reached += 1
                            self.assertAlmostEqual(self.fill_of(image, 65535 - 60), fill, delta=0.015 if noise else 0.001)
        self.assertTrue(12 < reached < 30, reached)

    def test_saturation_is_counted_in_the_image(self):
        noise = {"photon_noise": True, "read_noise_e": 13.0, "prnu": 0.02, "dsnu_e": 40.0, "hot_fraction": 0.01, "hot_current_e_s": 1e9}
        for detector in ({}, {"smear_time_s": 1e-5}, noise, {"smear_time_s": 1e-5, **noise}):
            for time_s in (0.001, 0.01, 0.03):
                f = self.frame(detector={"integration_time_s": time_s, **detector})
                self.assertEqual(f["meta"]["exposure"]["saturated_fraction"], (f["image"] == 65535).mean(), (detector, time_s))
        full = self.frame(detector={"integration_time_s": 0.05, "full_well_e": 50000.0})
        self.assertAlmostEqual(full["meta"]["exposure"]["saturated_fraction"], (full["image"] >= 25060).mean(), delta=1e-3)
        self.assertGreater(full["meta"]["exposure"]["saturated_fraction"], 0.01)

    def test_saturation_and_darkness_are_warned_of(self):
        burnt = self.frame(detector={"integration_time_s": 0.5})["meta"]
        self.assertGreater(burnt["exposure"]["saturated_fraction"], 0.01)
        self.assertTrue(any("saturated" in w for w in burnt["warnings"]), burnt["warnings"])
        night = self.frame(sun={"local": {"lat_deg": 0.0, "lon_deg": 30.0, "azimuth_deg": 90.0, "elevation_deg": -30.0}})
        self.assertTrue(any("no signal" in w for w in night["meta"]["warnings"]), night["meta"]["warnings"])
        self.assertEqual(self.frame()["meta"]["warnings"], [])

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

    def test_eight_bits_are_bytes(self):
        f = self.frame(detector={"bit_depth": 8, "gain_e_dn": 40.0, "offset_dn": 5.0})
        self.assertEqual(f["image"].dtype, np.uint8)
        self.assertEqual(f["image"].min(), 5)

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

    def test_vignetting_dims_the_corners_alone(self):
        even, dim = self.frame(), self.frame(optics={"vignetting": {"model": "cos4"}})
        h, w = even["image"].shape
        request = frame_request()
        f = 0.5 * w / np.tan(np.radians(request["camera"]["fov_deg"] / 2))
        y, x = np.mgrid[:h, :w]
        cos2 = 1 / (1 + ((x - (w - 1) / 2) ** 2 + (y - (h - 1) / 2) ** 2) / f ** 2)
        self.assertLess(np.abs((even["image"] - 60.0) * cos2 ** 2 + 60 - dim["image"]).max(), 1.01)

    NOISY = {"photon_noise": True, "read_noise_e": 12.0, "prnu": 0.01, "dsnu_e": 4.0, "dark_current_e_s": 500.0,
             "full_well_e": 100000.0, "hot_fraction": 0.001, "hot_current_e_s": 1e6, "dead_fraction": 0.001}

    def test_the_same_request_has_the_same_bytes(self):
        one = self.frame(detector=self.NOISY, seed=5, frame=8)
        self.assertEqual(one["bytes"], self.frame(detector=self.NOISY, seed=5, frame=8)["bytes"])
        for other in (self.frame(detector=self.NOISY, seed=5, frame=9), self.frame(detector=self.NOISY, seed=6, frame=8)):
            self.assertTrue(np.array_equal(one["radiance"], other["radiance"]))
            self.assertLess((one["image"] == other["image"]).mean(), 0.2)

    def test_noise_has_the_variance_of_its_sources(self):
        noisy = {"photon_noise": True, "read_noise_e": 12.0}
        clean = self.frame()["image"].astype(float)
        frames = [self.frame(detector=noisy, frame=k, products=("image",))["image"] for k in range(24)]
        stack = np.array(frames, dtype=float)
        expected = ((clean - 60) * 2 + 144) / 4 + 1 / 12
        lit = clean > 200
        self.assertGreater(lit.mean(), 0.5)
        self.assertAlmostEqual((stack.var(axis=0, ddof=1)[lit] / expected[lit]).mean(), 1, 1)
        error = np.sqrt(expected[lit].mean() / (24 * lit.sum()))
        self.assertLess(abs((stack.mean(axis=0) - clean)[lit].mean()), 5 * error)

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
        document = frame_request(["image"], band=BAND, sensor=dict(
            SENSOR, detector=dict(SENSOR["detector"], **detector),
            motion={"angular_rate_deg_s": list(rate), "velocity_m_s": list(velocity), "samples": n}))
        status, _, body = self.service.frame(document, "application/x-npz")
        self.assertEqual(status, 200, body[:300])
        blurred = np.load(io.BytesIO(body))["image"].astype(float)
        moments = [self.frame(detector=detector, pose=at(((k + 0.5) / n - 0.5) * t))["image"].astype(float) for k in range(n)]
        self.assertLess(np.abs(blurred - np.mean(moments, axis=0)).max(), 1.01)
        self.assertGreater(np.abs(moments[0] - moments[-1]).max(), 100)
        at_rest = self.frame(detector=detector)["image"].astype(float)
        self.assertGreater(np.abs(blurred - at_rest).max(), 30)

    # Left out, the moments are as many as the longest streak has pixels; what is too few for it is said.
    def test_moments_follow_the_streak(self):
        def frame(**motion):
            document = frame_request(["image"], band=BAND, sensor=dict(
                SENSOR, detector=dict(SENSOR["detector"], integration_time_s=0.05, gain_e_dn=25.0), motion=motion))
            status, headers, body = self.service.frame(document, "application/x-npz")
            self.assertEqual(status, 200, body[:300])
            arrays = np.load(io.BytesIO(body))
            return arrays["image"], json.loads(bytes(arrays["meta.json"])), headers

        turn = [0.0, 0.0, 60.0]
        image, meta, headers = frame(angular_rate_deg_s=turn)
        camera = meta["request"]["camera"]
        corner = np.hypot(camera["width"] - 1, camera["height"] - 1) / 2
        streak, n = meta["motion"]["longest_streak_px"], meta["motion"]["samples"]
        self.assertLess(abs(streak - corner * np.radians(60 * 0.05)), 0.02 * streak)
        self.assertIn(n, (np.ceil(streak), np.ceil(streak) + 1))
        self.assertEqual(meta["warnings"], [])
        self.assertIn("ETag", headers)
        again, _, _ = frame(angular_rate_deg_s=turn, samples=n)
        self.assertTrue((image == again).all())
        _, meta, _ = frame(angular_rate_deg_s=turn, samples=1)
        self.assertEqual(len(meta["warnings"]), 1)
        self.assertIn("streak", meta["warnings"][0])

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

    def test_png_holds_the_digital_numbers(self):
        document = frame_request(["image"], band=BAND, sensor=SENSOR)
        status, headers, body = self.service.frame(document, "image/png")
        self.assertEqual(status, 200, body[:300])
        self.assertEqual(body[:8], b"\x89PNG\r\n\x1a\n")
        self.assertEqual(body[24], 16)  # bits


if __name__ == "__main__":
    unittest.main()
