#!/usr/bin/env python3
"""Craters and relief below the posts: the same ground in frames, rays, heights and maps, named and never silent."""

import json
import os
import unittest

import numpy as np

import harness
from harness import frame_request, sample, tearDownModule

LAT, LON = 0.1, 30.1
PRESET = {"seed": 3, "craters": {"smallest_m": 2, "largest_m": 100},
          "relief": {"hurst": 0.9, "deviation_m": 0.2, "baseline_m": 10, "shortest_m": 2, "longest_m": 64}}


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    os.makedirs(harness.path("assets", "details"))
    write("rough", PRESET)
    write("bright", {**PRESET, "albedo_variation": 1})
    write("bad", {"craters": {"smallest_m": 20, "largest_m": 10}})
    write("large_rocks", {"rocks": {"smallest_m": 1, "largest_m": 1}})
    write("all_rocks", {"rocks": {"smallest_m": 0.1, "largest_m": 1, "frequency": [{"per_m2": 1, "exponent": 3}]}})
    # Its border runs through what the frames below see.
    write("patch", {**PRESET, "region": [[LAT - 0.05, LON - 0.05], [LAT - 0.05, LON], [LAT, LON + 0.0005],
                                         [LAT + 0.05, LON], [LAT + 0.05, LON - 0.05]]})
    write("crossed", {**PRESET, "region": [[0, 0], [1, 1], [0, 1], [1, 0]]})
    write("dense", {"craters": {"smallest_m": 2, "largest_m": 100, "frequency": [{"per_m2": 9, "exponent": 2}]}})


def write(name, preset):
    harness.write(os.path.join("assets", "details", name + ".json"), preset)


class Detail(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.service = harness.Service("--assets-dir", harness.path("assets"))
        cls.ground = cls.heights([(LAT, LON)])[0]
        cls.detailed = cls.heights([(LAT, LON)], "rough")[0]

    @classmethod
    def tearDownClass(cls):
        cls.service.expect_clean_stop()

    @classmethod
    def heights(cls, places, detail=None):
        points = [{"lat_deg": lat, "lon_deg": lon} for lat, lon in places]
        status, _, body = cls.service.post("/v1/heights", {"points": points, "detail": detail})
        assert status == 200, body
        return [point["height_m"] for point in json.loads(body)["points"]]

    def request(self, products, height_m=300.0, **changes):
        pose = {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": self.ground + height_m},
                "nadir": {"up_azimuth_deg": 0}}
        return frame_request(products, width=96, height=96, **{"pose": pose, "detail": "rough", **changes})

    def arrays(self, request):
        f = self.service.arrays(request)
        return f, f["meta"], f["headers"]

    def test_off_unless_asked_for(self):
        plain = self.service.frame(self.request(("radiance",), detail=None))
        without = self.request(("radiance",))
        del without["detail"]
        self.assertEqual(plain[2], self.service.frame(without)[2])
        _, meta, _ = self.arrays(self.request(("radiance", "gsd"), detail=None))
        self.assertNotIn("detail", meta)
        self.assertNotIn("detail", meta["request"])

    def test_heights_above_the_ground_are_those_of_heights(self):
        """On ground with detail and without, for position and target, in frames and landmarks."""
        place, target = {"lat_deg": LAT, "lon_deg": LON}, {"lat_deg": LAT + 0.002, "lon_deg": LON}
        for detail in (None, "rough"):
            _, _, body = self.service.post("/v1/heights", {"points": [place, target], "detail": detail})
            ground, ahead = (p["height_m"] for p in json.loads(body)["points"])
            above = {"geodetic": {**place, "height_above_ground_m": 50}, "look_at": {**target, "height_above_ground_m": 2}}
            absolute = {"geodetic": {**place, "height_m": ground + 50}, "look_at": {**target, "height_m": ahead + 2}}
            by_ground, by_sphere = (self.arrays(self.request(("radiance", "range"), pose=pose, detail=detail))
                                    for pose in (above, absolute))
            self.assertEqual(by_ground[0]["body"], by_sphere[0]["body"])
            self.assertEqual(by_ground[1]["request"]["pose"], by_sphere[1]["request"]["pose"])
            camera = {"model": "pinhole", "width": 96, "height": 96, "fov_deg": 40}
            landmarks = [self.service.post("/v1/project", {"pose": pose, "camera": camera, "points": [target], "detail": detail})
                         for pose in (above, absolute)]
            self.assertEqual(landmarks[0][0], 200, landmarks[0][2][:300])
            self.assertEqual(landmarks[0][2], landmarks[1][2])

    def test_from_orbit_and_to_the_horizon(self):
        """What leaves out a crater may err by its depth: asked to be less than a pixel, that was more than fits."""
        horizon = {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": self.detailed + 5},
                   "look_at": {"lat_deg": LAT + 0.001, "lon_deg": LON, "height_m": self.detailed, "up": "zenith"}}
        camera = {"width": 512, "height": 512, "fov_deg": 60.0}
        for view in ({"height_m": 1e5}, {"pose": horizon}):
            for aim in (None, 0.5):
                accuracy = {} if aim is None else {"max_detail_error_px": aim}
                _, meta, _ = self.arrays(self.request(("radiance",), camera=camera, accuracy=accuracy, **view))
                self.assertLessEqual(meta["detail_error_px"], meta["lod_error_px"])
                reached = [w for w in meta["warnings"] if w.startswith("max_detail_error_px was relaxed (detail_limit_px)")]
                self.assertEqual(meta["detail_limit_px"] > (aim or 4), bool(reached))
                self.assertEqual(bool(reached), "pose" in view and aim is not None, meta["warnings"])

    def test_the_aim_for_detail_is_a_bound(self):
        triangles = []
        for aim in (16, 2, 0.5):
            arrays, meta, _ = self.arrays(self.request(("range", "position"), height_m=3000.0,
                                                       accuracy={"max_detail_error_px": aim}))
            triangles.append(meta["triangles"])
            self.assertLessEqual(meta["detail_error_px"], aim)
            lat, lon = np.radians([LAT, LON])
            up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
            eye = (1737400.0 + self.ground + 3000) * up
            rays = [{"origin_m": list(eye), "direction": list(d)}
                    for d in ((arrays["position"] - eye) / arrays["range"][..., None])[::8, ::8].reshape(-1, 3)]
            status, _, body = self.service.post("/v1/rays", {"rays": rays, "detail": "rough"})
            self.assertEqual(status, 200, body[:300])
            error = np.array([h["range_m"] for h in json.loads(body)["rays"]]) - arrays["range"][::8, ::8].ravel()
            # Of directions 20 degrees off nadir at most, on slopes that are not steep.
            self.assertLess(np.abs(error).max(), 1.2 * meta["lod_error_m"] + 1e-3, aim)
        self.assertLess(triangles[0], triangles[1])
        self.assertLess(triangles[1], triangles[2])

    def test_detail_product(self):
        dem, crater, relief = 0, 1, 2
        plain, _, _ = self.arrays(self.request(("detail", "geodetic"), detail=None))
        self.assertEqual(set(np.unique(plain["detail"])), {dem})
        shown, _, _ = self.arrays(self.request(("detail", "geodetic"), accuracy={"max_error_px": 0}))
        self.assertEqual(set(np.unique(shown["detail"])), {crater, relief})
        places = shown["geodetic"].reshape(-1, 3)[::17]
        added = places[:, 2] - np.array(self.heights([(p[0], p[1]) for p in places]))
        of_crater = shown["detail"].reshape(-1)[::17] == crater
        # Inside rims are hollows.
        self.assertLess(added[of_crater].mean(), added[~of_crater].mean() - 0.5 * added.std())

    def test_both_algorithms_see_the_same(self):
        products = ("position", "lit", "gsd", "radiance", "detail")
        for sun in (8.0, 40.0):
            light = {"local": {"lat_deg": LAT, "lon_deg": LON, "azimuth_deg": 80.0, "elevation_deg": sun}}
            drawn, _, _ = self.arrays(self.request(products, visibility="zbuffer", sun=light))
            traced, _, _ = self.arrays(self.request(products, visibility="raytrace", sun=light))
            np.testing.assert_allclose(drawn["position"], traced["position"], rtol=0, atol=1e-5)
            np.testing.assert_array_equal(drawn["gsd"], traced["gsd"])
            self.assertLess((drawn["detail"] != traced["detail"]).mean(), 1e-4)
            self.assertLess((drawn["lit"] != traced["lit"]).mean(), 1e-3)

    def test_young_craters_are_bright(self):
        """In frames by both algorithms; the ground is the same, and so is the mean albedo."""
        rho = 0.1
        surface = {"reflectance": {"model": "lommel_seeliger", "rho": rho}}
        products = ("radiance", "albedo", "angles", "lit", "position", "detail")
        changes = {"height_m": 3000.0, "surface": surface, "detail": "bright"}
        plain, _, _ = self.arrays(self.request(products, **{**changes, "detail": "rough"}))
        self.assertEqual(set(np.unique(plain["albedo"])), {np.float32(rho)})
        drawn, _, _ = self.arrays(self.request(products, **changes))
        for same in ("position", "angles", "lit", "detail"):
            np.testing.assert_array_equal(drawn[same], plain[same])
        self.assertGreater(drawn["albedo"].max(), 1.3 * rho)
        self.assertAlmostEqual(drawn["albedo"].mean() / rho, 1, delta=0.03)
        lit = plain["lit"] == 1
        np.testing.assert_allclose(drawn["radiance"][lit] / plain["radiance"][lit], drawn["albedo"][lit] / rho, rtol=1e-5)
        without_truth, _, _ = self.arrays(self.request(("radiance",), **changes))  # by the short way of the z-buffer
        np.testing.assert_allclose(without_truth["radiance"], drawn["radiance"], rtol=1e-5)
        traced, _, _ = self.arrays(self.request(products, visibility="raytrace", **changes))
        np.testing.assert_allclose(traced["albedo"], drawn["albedo"], rtol=0, atol=1e-5)
        for surface in ({"reflectance": {"model": "hapke"}}, {"reflectance": {"model": "lunar_lambert", "rho": rho}},
                        {"preset": "moon"}):
            with self.subTest(surface):
                other = {**changes, "surface": surface}
                truth, _, _ = self.arrays(self.request(("radiance", "albedo"), **other))
                short, _, _ = self.arrays(self.request(("radiance",), **other))
                np.testing.assert_allclose(short["radiance"], truth["radiance"], rtol=1e-5)
                dull, _, _ = self.arrays(self.request(("radiance", "albedo"), **{**other, "detail": "rough"}))
                brighter = truth["albedo"] > 1.2 * dull["albedo"]
                self.assertTrue((truth["radiance"][brighter & lit] > 1.1 * dull["radiance"][brighter & lit]).all())

    def test_bright_ground_echoes_more(self):
        receiver = {"signal": "photon_counting", "energy_j": 1e-3, "aperture_m": 0.1, "efficiency": 0.2}
        scan = {"instrument": {"divergence_mrad": 0.5, "pulse_length_ns": 4.0, "wavelength_um": 1.064, "threshold": 5,
                               "range_gate_m": [10, 5000], "receiver": receiver},
                "pattern": {"scan": "flash", "columns": 24, "rows": 24, "fov_x_deg": 20},
                "pose": {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": self.ground + 2000.0},
                         "nadir": {"up_azimuth_deg": 0}}}
        dull, bright = (self.service.arrays({**scan, "detail": name}, "/v1/lidar") for name in ("rough", "bright"))
        np.testing.assert_allclose(dull["true_range_m"], bright["true_range_m"], rtol=0, atol=0.01)
        ratio = bright["true_intensity"] / dull["true_intensity"]
        self.assertGreater(ratio.max(), 1.15)
        self.assertAlmostEqual(ratio.mean(), 1, delta=0.05)

    def test_bright_ground_of_maps_and_lists(self):
        area = {"projection": "orthographic", "center": {"lat_deg": LAT, "lon_deg": LON}, "width_m": 600.0,
                "height_m": 600.0, "gsd_m": 2.0}
        arrays = self.service.arrays({"map": area, "products": ["albedo"], "detail": "bright",
                                      "surface": {"reflectance": {"model": "lommel_seeliger", "rho": 0.1}}}, "/v1/maps")
        status, _, body = self.service.post("/v1/features", {
            "kind": "craters", "detail": "bright", "smallest_m": 8,
            "region": {"south_deg": LAT - 0.009, "north_deg": LAT + 0.009, "west_deg": LON - 0.009,
                       "east_deg": LON + 0.009}})
        self.assertEqual(status, 200, body[:500])
        craters = json.loads(body)["craters"]
        self.assertTrue(all(c["brightness"] == 1 for c in craters if c["age_Ma"] > 1000))
        bright = [c for c in craters if c["brightness"] > 1.2 and c["diameter_m"] > 12]
        self.assertTrue(bright)
        metres_per_degree = 1737400 * np.pi / 180
        for crater in bright:
            column = int(150 + (crater["lon_deg"] - LON) * metres_per_degree / 2)
            row = int(150 - (crater["lat_deg"] - LAT) * metres_per_degree / 2)
            self.assertGreater(arrays["albedo"][row, column], 0.1 * (1 + 0.5 * (crater["brightness"] - 1)), crater)

    def test_frames_heights_rays_and_maps_have_one_ground(self):
        for preset in ("rough", "patch"):
            with self.subTest(preset):
                self.check_one_ground(preset)

    def check_one_ground(self, preset):
        exact = self.request(("geodetic",), accuracy={"max_error_px": 0}, detail=preset)
        arrays, meta, _ = self.arrays(exact)
        self.assertEqual(meta["lod_error_m"], 0)
        places = arrays["geodetic"].reshape(-1, 3)[::97]
        heights = np.array(self.heights([(p[0], p[1]) for p in places], preset))
        np.testing.assert_allclose(heights, places[:, 2], rtol=0, atol=1e-6)
        plain = np.array(self.heights([(p[0], p[1]) for p in places]))
        self.assertGreater(np.abs(heights - plain).max(), 0.1)

        up = [np.array([np.cos(np.radians(p[0])) * np.cos(np.radians(p[1])),
                        np.cos(np.radians(p[0])) * np.sin(np.radians(p[1])), np.sin(np.radians(p[0]))]) for p in places]
        rays = [{"origin_m": ((1737400.0 + 5000) * u).tolist(), "direction": (-u).tolist()} for u in up]
        status, _, body = self.service.post("/v1/rays", {"rays": rays, "detail": preset})
        self.assertEqual(status, 200, body[:500])
        ranges = np.array([ray["range_m"] for ray in json.loads(body)["rays"]])
        np.testing.assert_allclose(5000 - ranges, heights, rtol=0, atol=1e-6)
        # Coarser posts are near the finest ones, and are these where no posts are as close as asked for.
        for spacing_m, least_m, most_m in ((1e-3, 0, 0), (2.0, 1e-3, 2.0)):
            body = self.service.post("/v1/rays", {"rays": rays, "detail": preset, "min_post_spacing_m": spacing_m})[2]
            apart_m = np.abs(np.array([ray["range_m"] for ray in json.loads(body)["rays"]]) - ranges).max()
            self.assertGreaterEqual(apart_m, least_m)
            self.assertLessEqual(apart_m, most_m)

        area = {"projection": "orthographic", "center": {"lat_deg": LAT, "lon_deg": LON}, "width_m": 40.0,
                "height_m": 40.0, "gsd_m": 2.0}
        request = {"map": area, "products": ["height"], "accuracy": {"max_error_px": 0}, "detail": preset}
        self.assertAlmostEqual(self.service.arrays(request, "/v1/maps")["height"].mean(), self.detailed, delta=10)

    def test_views_from_close_by_to_the_horizon_take_rays(self):
        """The shadow map's cells are of one size: most samples of such a view would be in a few."""
        camera = {"model": "pinhole", "width": 720, "height": 720, "fov_deg": 50.0}
        low = {"local": {"lat_deg": LAT, "lon_deg": LON, "azimuth_deg": 75.0, "elevation_deg": 5.0}}
        for height_m, expected in ((2, "raytrace"), (1500, "zbuffer")):
            pose = {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_above_ground_m": height_m},
                    "nadir": {"up_azimuth_deg": 0.0, "tilt_deg": 75.0, "azimuth_deg": 0.0}}
            _, meta, _ = self.arrays(self.request(("radiance",), camera=camera, pose=pose, sun=low))
            self.assertEqual(meta["visibility"], expected, height_m)

    def test_another_preset_under_the_name_is_another_frame(self):
        write("changing", PRESET)
        request = self.request(("radiance",), detail="changing")
        first = self.service.frame(request)
        self.assertEqual(self.service.frame(request)[2], first[2])
        write("changing", {**PRESET, "seed": 12345})
        second = self.service.frame(request)
        self.assertNotEqual(first[1]["ETag"], second[1]["ETag"])
        self.assertNotEqual(first[2], second[2])
        again = harness.Service("--assets-dir", harness.path("assets"), cache="other")
        try:
            self.assertEqual(again.frame(request)[2], second[2])
        finally:
            again.expect_clean_stop()

    def test_refusals(self):
        answer = self.service.frame(self.request(("radiance",), detail="none"))
        self.assertEqual(answer[0], 422)
        error = json.loads(answer[2])["errors"][0]
        self.assertEqual(error["pointer"], "/detail")
        self.assertIn("rough", error["detail"])
        for name, member in (("bad", "/craters/smallest_m"), ("crossed", "/region"), ("dense", "/craters/frequency"),
                             ("large_rocks", "/rocks/smallest_m"), ("all_rocks", "/rocks/frequency")):
            answer = self.service.frame(self.request(("radiance",), detail=name))
            self.assertGreaterEqual(answer[0], 400)
            self.assertIn(name + ".json", json.loads(answer[2])["detail"])
            self.assertIn(member, json.loads(answer[2])["detail"])
        self.assertEqual(self.service.frame(self.request(("radiance",), detail=3))[0], 422)


if __name__ == "__main__":
    harness.main()
