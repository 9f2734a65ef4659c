#!/usr/bin/env python3
"""`map_error` of maps, rays, heights: the statistics of its errors, that all calls answer from one map, what the metadata
says, presets, faults."""

import json
import os

import numpy as np

import harness
from harness import REPOSITORY, Service, tearDownModule, WithService

PLACE = {"lat_deg": 0.0, "lon_deg": 30.0}
MAP = {"projection": "equirectangular", "center": PLACE, "width_m": 24000, "height_m": 24000, "gsd_m": 120}
SUN = {"local": {**PLACE, "azimuth_deg": 90.0, "elevation_deg": 40.0}}
PRESETS = ("kaguya-tc", "lola-polar-5m", "nac-dtm", "sldem2015")


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "256")


class MapErrors(WithService):
    @classmethod
    def setUpClass(cls):
        cls.folder = harness.assets()
        cls.service = Service("--assets-dir", cls.folder)

    def map(self, products=("height",), gsd_m=120, **more):
        request = {"map": {**MAP, "gsd_m": gsd_m}, "products": list(products), "accuracy": {"max_error_px": 0}, **more}
        return self.service.arrays(request, "/v1/maps")

    def heights(self, lat_deg, lon_deg, **more):
        points = [{"lat_deg": float(a), "lon_deg": float(b)} for a, b in zip(lat_deg, lon_deg)]
        return self.ok_json(self.service.post("/v1/heights", {"points": points, **more}))

    def places(self, count=200, seed=1):
        random = np.random.default_rng(seed)
        return random.uniform(-0.3, 0.3, count), random.uniform(29.7, 30.3, count)

    def test_a_layer_gives_the_deviation_by_place(self):
        """4 m in the east, 1 m in the west, 0 outside; 3 m are the most."""
        with open(os.path.join(self.folder, "maps", "errors.asc"), "w") as f:
            f.write("ncols 4\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 1 4 4\n1 1 4 4\n")
        with open(os.path.join(self.folder, "maps", "errors.json"), "w") as f:
            json.dump({"file": "errors.asc", "extent": {"south_deg": -0.25, "north_deg": 0.25, "west_deg": 29.6, "east_deg": 30.4}}, f)
        field = {"standard_deviation_m": 3.0, "correlation_length_m": 300.0}
        truth, whole, layered = (self.map(**error) for error in (
            {}, {"map_error": {"seed": 7, "height": [field]}}, {"map_error": {"seed": 7, "height": [field | {"layer": "errors"}]}}))
        error, at_most = layered["height"] - truth["height"], whole["height"] - truth["height"]
        degrees = (np.arange(200) - 99.5) * 120 / (np.radians(1) * 1737400)
        lat, lon = np.meshgrid(-degrees, 30 + degrees, indexing="ij")
        west, east, outside = (lon < 29.85) & (abs(lat) < 0.2), (lon > 30.15) & (abs(lat) < 0.2), abs(lat) > 0.38
        self.assertGreater(min(west.sum(), east.sum(), outside.sum()), 800)
        np.testing.assert_allclose(error[west], at_most[west] / 3, atol=2e-3)
        np.testing.assert_allclose(error[east], at_most[east], atol=2e-3)
        self.assertLess(np.abs(error[outside]).max(), 2e-3)
        self.assertEqual(layered["meta"]["map_error"]["height"][0]["layer"], "errors")
        slope = self.map(products=("slope",), map_error={"seed": 7, "height": [field | {"layer": "errors"}]})["slope"]
        self.assertFalse(np.isnan(slope).any())

    def test_maps_rays_and_heights_are_of_one_map(self):
        error = {"seed": 4, "height": [{"standard_deviation_m": 5.0, "correlation_length_m": 600.0}],
                 "about": {**PLACE, "height_m": -100.0}, "shift": {"north_m": 250.0, "east_m": -130.0}, "scale": 1.02,
                 "tilt": {"slope_deg": 0.1, "azimuth_deg": 30.0}}
        lat, lon = self.places(60)
        answer = self.heights(lat, lon, map_error=error)
        height_m = np.array([p["height_m"] for p in answer["points"]])
        up = np.stack([np.cos(np.radians(lat)) * np.cos(np.radians(lon)), np.cos(np.radians(lat)) * np.sin(np.radians(lon)),
                       np.sin(np.radians(lat))], axis=-1)
        rays = self.ok_json(self.service.post("/v1/rays", {
            "rays": [{"origin_m": (1757400 * u).tolist(), "direction": (-u).tolist()} for u in up], "map_error": error}))
        by_rays = np.array([20000 - r["range_m"] for r in rays["rays"]])
        self.assertLess(np.abs(by_rays - height_m).max(), 0.01)
        truth = np.array([p["height_m"] for p in self.heights(lat, lon)["points"]])
        self.assertGreater(np.abs(height_m - truth).std(), 5)
        for named in (answer["map_error"], rays["map_error"]):
            self.assertEqual(named["shift"], error["shift"])
            self.assertEqual(named["seed"], 4)

    def test_albedo_errors_have_their_statistics(self):
        flat = {"surface": {"reflectance": {"model": "lambert", "rho": 0.2}}, "sun": SUN}
        truth = self.map(("radiance", "albedo"), **flat)
        error = {"albedo": [{"standard_deviation": 0.06, "correlation_length_m": 500.0}]}
        wrong = self.map(("radiance", "albedo"), map_error=error, **flat)
        for product in ("radiance", "albedo"):
            seen = truth[product] > 0
            ratio = wrong[product][seen] / truth[product][seen] - 1
            self.assertLess(abs(ratio.std() - 0.06), 0.006, product)
            self.assertLess(abs(ratio.mean()), 0.009, product)

    def test_missing_craters(self):
        lat, lon = self.places(400)
        heights = {}
        for name, error in (("truth", None), ("all", {}), ("some", {"missing_craters_below_m": 33}),
                            ("fewer", {"missing_craters_below_m": 64}), ("none", {"missing_craters_below_m": 5000})):
            more = {} if error is None else {"map_error": error}
            answer = self.heights(lat, lon, detail="highlands", **more)
            heights[name] = np.array([p["height_m"] for p in answer["points"]])
        self.assertEqual(np.abs(heights["all"] - heights["truth"]).max(), 0)
        self.assertTrue(np.array_equal(heights["some"], heights["fewer"]))  # rounded up to a power of two
        differ = [(heights[name] - heights["truth"]).std() for name in ("some", "none")]
        self.assertGreater(differ[0], 0.01)
        self.assertGreater(differ[1], differ[0])

    def test_metadata_names_the_errors(self):
        error = {"preset": "sldem2015", "seed": 9, "resolution_m": 0}
        meta = self.map(map_error=error)["meta"]
        self.assertEqual(meta["map_error"]["preset"], "sldem2015")
        self.assertEqual(meta["map_error"]["seed"], 9)
        self.assertEqual(meta["map_error"]["resolution_m"], 0)
        self.assertEqual(meta["map_error"]["height"], [{"standard_deviation_m": 3.5, "correlation_length_m": 300}])
        self.assertIn("Icarus", meta["map_error"]["sources"]["resolution_m"])
        self.assertEqual(meta["request"]["map_error"]["preset"], "sldem2015")
        self.assertNotIn("map_error", self.map()["meta"])
        # The resolved request is a request for the same map.
        status, headers, body = self.service.post("/v1/maps", meta["request"], "application/x-npz")
        self.assertEqual(status, 200)
        self.assertEqual(harness.meta_of(body)["map_error"], meta["map_error"])

    def test_presets(self):
        folder = os.path.join(REPOSITORY, "deploy", "assets", "map_errors")
        self.assertEqual(sorted(os.listdir(folder)), [f"{name}.json" for name in PRESETS])
        for name in PRESETS:
            with open(os.path.join(folder, f"{name}.json")) as file:
                preset = json.load(file)
            self.assertEqual(set(preset["sources"]), {"resolution_m", "height.standard_deviation_m", "height.correlation_length_m"})
            lat, lon = self.places(20)
            answer = self.heights(lat, lon, map_error={"preset": name})
            self.assertEqual(answer["map_error"]["height"], preset["height"])
            self.assertEqual(answer["map_error"]["resolution_m"], preset["resolution_m"])

    def test_warnings(self):
        warnings = self.map(map_error={"seed": 3})["meta"]["warnings"]
        self.assertTrue(any("states no error" in w for w in warnings), warnings)
        warnings = self.map(map_error={"missing_craters_below_m": 30})["meta"]["warnings"]
        self.assertTrue(any("changes nothing" in w for w in warnings), warnings)

    def test_faults(self):
        for error, pointer in (
                ({"shift": {"east_m": 5}}, "/map_error/about"),
                ({"tilt": {"slope_deg": 0.1}}, "/map_error/about"),
                ({"scale": 2}, "/map_error/scale"),
                ({"height": [{"standard_deviation_m": -1, "correlation_length_m": 5}]}, "/map_error/height/0/standard_deviation_m"),
                ({"height": [{"standard_deviation_m": 1}]}, "/map_error/height/0/correlation_length_m"),
                ({"preset": "lola"}, "/map_error/preset"),
                ({"noise": 1}, "/map_error/noise"),
                (3, "/map_error")):
            self.problem(self.service.post("/v1/maps", {"map": MAP, "products": ["height"], "map_error": error}), 422, pointer)
            self.problem(self.service.post("/v1/heights", {"points": [PLACE], "map_error": error}), 422, pointer)
        self.problem(self.service.frame(harness.frame_request(map_error={})), 422, "/map_error")
        with open(os.path.join(self.folder, "map_errors", "broken.json"), "w") as file:
            json.dump({"height": [{"standard_deviation_m": "much", "correlation_length_m": 5}]}, file)
        problem = self.problem(self.service.post("/v1/heights", {"points": [PLACE], "map_error": {"preset": "broken"}}), 500)
        self.assertIn("map_errors/broken.json", problem["detail"])

    def test_etags_tell_maps_apart(self):
        request = {"map": MAP, "products": ["height"]}
        tags = {self.service.post("/v1/maps", dict(request, **more))[1]["ETag"] for more in (
            {}, {"map_error": {"height": [{"standard_deviation_m": 1, "correlation_length_m": 500}]}},
            {"map_error": {"seed": 1, "height": [{"standard_deviation_m": 1, "correlation_length_m": 500}]}})}
        self.assertEqual(len(tags), 3)


if __name__ == "__main__":
    harness.main()
