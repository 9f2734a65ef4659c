#!/usr/bin/env python3
"""Equations (1) to (4), (10), (11) of SENSOR++ pixel by pixel, over HTTP: every product against every other."""

import json
import os
import unittest

import numpy as np

import harness
from harness import frame_request, tearDownModule

PRODUCTS = ["radiance", "angles", "lit"]


def setUpModule():
    harness.set_up()
    RadiometryTest.service = harness.service_with_assets()


class RadiometryTest(unittest.TestCase):
    def frame(self, **changes):
        products = changes.pop("products", PRODUCTS)
        return self.service.arrays(frame_request(products, **changes))

    def refusal(self, **changes):
        status, _, body = self.service.frame(frame_request(["radiance"], **changes))
        self.assertEqual(status, 422, body[:300])
        return [e["pointer"] for e in json.loads(body)["errors"]]

    def test_both_algorithms_agree_on_roughness(self):
        both = [self.frame(surface={"reflectance": {"model": "hapke"}}, visibility=v) for v in ("zbuffer", "raytrace")]
        same = both[0]["lit"] == both[1]["lit"]
        self.assertGreater(same.mean(), 0.999)
        self.assertLess(np.abs(both[0]["radiance"] - both[1]["radiance"])[same].max(), 1e-5)

    def test_light_in_shadow_has_a_bound_by_the_height_of_the_sun(self):
        for elevation_deg, bound in ((1.9, None), (2.1, 0.8), (4.9, 0.8), (5.1, 0.88)):
            low = {"local": {"lat_deg": 0.1, "lon_deg": 30.1, "azimuth_deg": 90.0, "elevation_deg": elevation_deg}}
            f = self.frame(products=["irradiance"], sun=low, indirect={"terrain": True})
            self.assertEqual(f["meta"]["indirect"]["shadow_light_at_least"], bound, elevation_deg)

    def test_rays_and_landmarks_have_the_irradiance_of_frames(self):
        for radius_deg in (0.0, 0.27):
            with self.subTest(radius_deg=radius_deg):
                self.check_rays_and_landmarks(frame_request()["sun"] | {"angular_radius_deg": radius_deg})

    def check_rays_and_landmarks(self, sun):
        light = {"sun": sun, "surface": {"preset": "moon-mare"}, "band": {"center_um": 0.65, "width_um": 0.1},
                 "indirect": {"terrain": True, "earth": {"sub_earth": {"lat_deg": 5, "lon_deg": 0}}, "spacing_px": 0.5}}
        f = self.frame(products=["radiance", "position", "geodetic", "irradiance"], **light)
        rows, columns = (g.ravel() for g in np.mgrid[8:f["position"].shape[0]:16, 8:f["position"].shape[1]:16])
        places = f["position"][rows, columns].astype(float)
        up = places / np.linalg.norm(places, axis=1, keepdims=True)
        rays = [{"origin_m": o, "direction": d} for o, d in zip((places + 100 * up).tolist(), (-up).tolist())]
        status, _, body = self.service.post("/v1/rays", {"rays": rays, **light})
        self.assertEqual(status, 200, body[:300])
        met = np.array([r["irradiance"] for r in json.loads(body)["rays"]])
        seen = f["irradiance"][rows, columns].astype(float)
        sunlight = f["meta"]["solar_irradiance"]["value_w_m2"]
        bounds = f["meta"]["indirect"]
        self.assertTrue(0 < bounds["ground_view"] < 1 and 0.02 < bounds["albedo"] < 0.2, bounds)
        self.assertAlmostEqual(bounds["further_bounces_at_most"] * (1 - bounds["albedo"] * bounds["ground_view"]),
                               bounds["albedo"] * bounds["ground_view"])
        self.assertLess(np.median(np.abs(met - seen)[:, 0]), 2e-3 * sunlight)
        for k, name in ((1, "terrain"), (2, "Earth")):
            self.assertGreater(seen[:, k].mean(), 0, name)
            self.assertLess(np.abs(met[:, k] - seen[:, k]).mean(), 0.03 * seen[:, k].mean(), name)
        points = [{"lat_deg": g[0], "lon_deg": g[1]} for g in f["geodetic"][rows, columns].astype(float).tolist()]
        request = frame_request()
        status, _, body = self.service.post(
            "/v1/project", {"camera": request["camera"], "pose": request["pose"], "points": points, **light})
        self.assertEqual(status, 200, body[:300])
        landmarks = np.array([p["irradiance"] for p in json.loads(body)["points"]])
        self.assertLess(np.abs(landmarks - met)[:, 1].mean(), 0.01 * met[:, 1].mean())
        status, _, body = self.service.post("/v1/rays", {"rays": rays[:1], "indirect": {"terrain": True}})
        self.assertEqual((status, [e["pointer"] for e in json.loads(body)["errors"]]), (422, ["/sun"]))
        _, _, body = self.service.post("/v1/rays", {"rays": rays[:1], "sun": light["sun"]})
        self.assertNotIn("irradiance", json.loads(body)["rays"][0])

    def test_light_from_terrain_knows_the_albedo_of_hapkes_model(self):
        def received(bounces=1, **surface):
            return self.frame(products=["irradiance"], surface=surface,
                              indirect={"terrain": True, "bounces": bounces})["irradiance"][..., 1].astype(float)

        by_model = {w: received(reflectance={"model": "hapke", "w": w}) for w in (0.0, 0.05, 0.1)}
        self.assertEqual(by_model[0.0].max(), 0)
        # Nearly proportional: next to nothing is scattered twice.
        self.assertGreater(by_model[0.1].mean(), 2 * by_model[0.05].mean())
        self.assertLess(by_model[0.1].mean(), 2.2 * by_model[0.05].mean())
        # Of a map that says all of it, the model's own doesn't matter.
        for bounces in (1, 2):
            mapped = [received(bounces, reflectance={"model": "hapke", "w": w}, albedo_maps=["everywhere"])
                      for w in (0.1, 0.6)]
            np.testing.assert_array_equal(*mapped)

    def test_the_earth_shines_from_any_height(self):
        dark = {"local": {"lat_deg": 0.1, "lon_deg": 30.1, "azimuth_deg": 90.0, "elevation_deg": -60.0}}
        overhead = {"earth": {"sub_earth": {"lat_deg": 0.1, "lon_deg": 30.1}}}
        found = []
        for height_m in (20e3, 200e3, 2000e3):
            pose = {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": height_m}, "nadir": {}}
            camera = {"width": 64, "height": 64, "fov_deg": 10}
            f = self.frame(products=["irradiance", "depth"], sun=dark, indirect=overhead, pose=pose, camera=camera)
            seen = np.isfinite(f["depth"])
            self.assertGreater(f["irradiance"][seen][:, 2].min(), 0)
            found.append(f["irradiance"][seen][:, 2].mean())
        for value in found[1:]:
            self.assertLess(abs(value / found[0] - 1), 0.03, found)

    def test_rows_of_a_strip_have_the_radiance_that_each_sees(self):
        request = frame_request(width=32, height=128, surface={"preset": "moon"},
                                band={"center_um": 0.65, "width_um": 0.1},
                                pose={"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 5000},
                                      "nadir": {"up_azimuth_deg": 180}})
        request["camera"]["fov_deg"] = 5
        line_s, velocity = 0.05, np.array([0.0, 0.0, 1600.0])
        shutter = {"line_time_s": line_s, "velocity_m_s": velocity.tolist(), "pushbroom": True}

        def from_terrain(**changes):
            plain = self.service.arrays(request | changes)
            lit = self.service.arrays(request | changes | {"indirect": {"terrain": True}})
            return lit["radiance"].astype(float) - plain["radiance"], plain["meta"]["request"]["pose"]

        strip, pose = from_terrain(shutter=shutter)
        for row in (0, 40, 90, 127):
            place = (np.array(pose["position_m"]) + row * line_s * velocity).tolist()
            still, _ = from_terrain(camera=request["camera"] | {"height": 1}, visibility="raytrace",
                                    pose=pose | {"position_m": place})
            self.assertGreater(still.mean(), 1e-4)
            np.testing.assert_allclose(strip[row], still[0], rtol=0.03, atol=5e-6)

    def test_further_bounces_add_light_within_the_bound(self):
        low = {"local": {"lat_deg": 0.1, "lon_deg": 30.1, "azimuth_deg": 90.0, "elevation_deg": 8.0}}
        frames = [self.frame(products=["irradiance"], sun=low, surface={"reflectance": {"model": "lambert", "rho": 0.5}},
                             indirect={"terrain": True, "bounces": n}) for n in (1, 2, 3)]
        least = 0.001 * np.nanmean(frames[0]["irradiance"][..., 1])
        for fewer, more in zip(frames, frames[1:]):
            added = (more["irradiance"] - fewer["irradiance"])[..., 1].astype(float)
            bounds = [f["meta"]["indirect"] for f in (fewer, more)]
            self.assertGreater(np.nanmean(added), least)
            least *= 0.001
            self.assertLess(np.nanmax(added), bounds[0]["further_bounces_at_most"] * np.nanmax(fewer["irradiance"][..., 1]))
            self.assertTrue((more["irradiance"][..., ::2] == fewer["irradiance"][..., ::2]).all())
            self.assertAlmostEqual(bounds[1]["further_bounces_at_most"],
                                   bounds[0]["further_bounces_at_most"] * bounds[0]["albedo"] * bounds[0]["ground_view"])

    # Eq. (3): everything warm emits, in the Sun or not; with sub-pixel samples and the Sun's disc, too.
    def test_a_warm_surface_emits_in_the_shadow_as_well(self):
        emitted = 0.88 * 5.670374419e-8 * 310 ** 4 / np.pi
        for visibility in ("zbuffer", "raytrace"):
            for radius, samples in ((0.0, 1), (0.0, 4), (0.27, 1)):
                with self.subTest(visibility=visibility, radius=radius, samples=samples):
                    sun = dict(frame_request()["sun"], angular_radius_deg=radius)
                    cold, warm = (self.frame(surface={"temperature_k": t}, visibility=visibility, samples=samples, sun=sun)
                                  for t in (0.0, 310.0))
                    self.assertGreater((cold["radiance"] == 0).mean(), 0.02, "some shadow")
                    # both in float
                    self.assertLess(np.abs(warm["radiance"] - cold["radiance"] - emitted).max(), 3e-5)
                    self.assertEqual(warm["meta"]["radiance_terms"], ["direct", "emitted"])
        lit_or_not = warm["radiance"][cold["radiance"] == 0]
        self.assertLess(np.abs(lit_or_not - emitted).max(), 1e-5)

    # Eq. (1) with all of its terms.
    def test_an_atmosphere(self):
        band = {"center_um": 0.55, "width_um": 0.1}
        plain = self.frame(band=band)
        hazy = self.frame(band=band, atmosphere={"name": "made-up-clear-sky"}, surface={"temperature_k": 290.0})
        self.assertEqual(hazy["meta"]["radiance_terms"], ["direct", "indirect", "scattered", "emitted", "thermal_path"])
        rows = np.loadtxt(harness.path("assets", "atmospheres", "made-up-clear-sky.csv"), delimiter=",", skiprows=9)
        w = np.linspace(0.5, 0.6, 20001)
        tau, sun, indirect, scattered = (np.interp(w, rows[:, 0], rows[:, k]) for k in (1, 2, 3, 4))
        direct, base = np.trapz(tau * sun, w), np.trapz(indirect + scattered, w)  # nothing thermal in the visible
        self.assertAlmostEqual(hazy["meta"]["solar_irradiance"]["value_w_m2"] / direct, 1, 6)
        expected = plain["radiance"] * (direct / plain["meta"]["solar_irradiance"]["value_w_m2"]) + base
        self.assertTrue(np.allclose(hazy["radiance"], expected, rtol=2e-6))

    def test_atmospheres_are_named_by_the_operator(self):
        band = {"center_um": 0.55, "width_um": 0.1}
        for name in ("none-such", "../atmospheres/made-up-clear-sky", "/etc/passwd", "", "."):
            self.assertEqual(self.refusal(band=band, atmosphere={"name": name}), ["/atmosphere/name"], name)
        self.assertEqual(self.refusal(atmosphere={"name": "made-up-clear-sky"}), ["/atmosphere"])
        self.assertEqual(self.refusal(band={"center_um": 20.0, "width_um": 1.0}, atmosphere={"name": "made-up-clear-sky"}),
                         ["/atmosphere"])

    # The table is part of what the ETag stands for, and a broken one is said to be.
    def test_a_table_that_changes(self):
        path = os.path.join(harness.path("assets"), "atmospheres", "changing.csv")
        table = ["wavelength_um,transmittance,e_sun_w_m2_um,l_ind_w_m2_sr_um,l_sc_w_m2_sr_um,l_th_w_m2_sr_um",
                 "0.4,0.5,1000,1,1,0", "0.8,0.5,1000,1,1,0"]
        asked = dict(band={"center_um": 0.55, "width_um": 0.1}, atmosphere={"name": "changing"})
        tags, brightest = [], []
        for scattered in ("1", "7"):
            with open(path, "w") as file:
                file.write("\n".join(table).replace(",1,0", f",{scattered},0") + "\n")
            os.utime(path, ns=(len(tags) + 1, len(tags) + 1))
            frame = self.frame(**asked)
            tags.append(frame["headers"]["ETag"]), brightest.append(float(frame["radiance"].min()))
        self.assertNotEqual(tags[0], tags[1])
        self.assertAlmostEqual(brightest[1] - brightest[0], 0.6, 5)
        with open(path, "w") as file:
            file.write(table[0] + "\n0.4,2,1000,1,1,0\n")
        status, _, body = self.service.frame(frame_request(["radiance"], **asked))
        self.assertEqual(status, 500)
        self.assertIn("changing.csv: line 2", json.loads(body)["detail"])
        self.assertTrue(json.loads(body)["type"].endswith(":asset_error"))


if __name__ == "__main__":
    harness.main()
