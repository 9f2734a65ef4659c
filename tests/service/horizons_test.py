#!/usr/bin/env python3
"""POST /v1/horizons and /v1/illumination, and their commands: against closed forms and against the discs of maps."""

import csv
import datetime
import io
import json
import os
import unittest

import numpy as np
from osgeo import gdal

import harness
from harness import Service, tearDownModule

gdal.UseExceptions()

RADIUS_M = 1737400.0
PLACE = {"lat_deg": -6.5, "lon_deg": 40.0}
SIDE_M = 3200 if harness.full_effort() else 1600
EYES = 40 if harness.full_effort() else 16
AREA = {"projection": "orthographic", "center": PLACE, "width_m": SIDE_M, "height_m": SIDE_M, "gsd_m": 50}
HORIZON = {"azimuths": 720, "farthest_km": 60}


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "-8", "--west-deg", "39", "--rows", "2", "--columns", "2", "--ppd", "256")


class Horizons(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.service = Service()

    @classmethod
    def tearDownClass(cls):
        cls.service.expect_clean_stop()

    def ask(self, path, body, accept="application/json"):
        status, headers, content = self.service.post(path, body, accept)
        self.assertEqual((status, headers["Content-Type"]), (200, accept), content[:500])
        return json.loads(content) if accept == "application/json" else content

    def test_the_shares_are_those_of_discs(self):
        """Of the pixels of a map, low Suns in the west and the east: `lit` is by rays to the Sun's disc."""
        month = {"places": [PLACE], "from_utc": "2026-12-01T00:00:00Z", "to_utc": "2026-12-31T00:00:00Z", "step_s": 10800}
        rows = list(csv.reader(io.StringIO(self.ask("/v1/illumination", {**month, "horizon": HORIZON}, "text/csv").decode())))[1:]
        checked = 0
        for before, after in zip(rows, rows[1:]):
            if (float(before[1]) > 0) == (float(after[1]) > 0):
                continue  # neither rises nor sets there
            for utc in (before[0], after[0]):
                light = self.service.arrays({"map": AREA, "from_utc": utc, "to_utc": utc, "horizon": HORIZON}, "/v1/illumination")
                share = light["sun_mean"]
                if not 0.02 < share.mean() < 0.98:
                    continue
                lit = self.service.arrays({"map": AREA, "sun": {"utc": utc, "angular_radius_deg": "sun"}, "products": ["lit"],
                                           "accuracy": {"max_error_px": 0, "max_shadow_error_px": 0.05}}, "/v1/maps")["lit"]
                error = share - lit
                print(f"{utc}: share {share.mean():.3f}, mean error {error.mean():.4f}, mean absolute error {np.abs(error).mean():.4f}")
                self.assertLess(abs(error.mean()), 0.02, utc)
                self.assertLess(np.abs(error).mean(), 0.03, utc)
                checked += 1
        self.assertGreaterEqual(checked, 2)

    def shares_beside_discs(self, dem, centre, half_m, farthest_km, epochs):
        """Errors of the Sun's share in a year's series at 200 random places, at random epochs, and the shares `lit` of
        the disc there, by rays straight down as frames cast them."""
        random = np.random.default_rng(11)
        half_deg = np.degrees(half_m / RADIUS_M)
        places = [{"lat_deg": centre["lat_deg"] + half_deg * y,
                   "lon_deg": centre["lon_deg"] + half_deg / np.cos(np.radians(centre["lat_deg"])) * x}
                  for x, y in random.uniform(-1, 1, (200, 2))]
        start = datetime.datetime(2026, 12, 1)
        harness.write("series.json", {"places": places, "from_utc": f"{start.isoformat()}Z", "to_utc": "2027-12-01T00:00:00Z",
                                      "step_s": 3600, "horizon": {**HORIZON, "farthest_km": farthest_km}})
        done = harness.run("ask", "illumination", harness.path("series.json"), "-o", harness.path("series.npz"), "--dem", dem,
                           "--cache-dir", harness.path("cache"))
        self.assertEqual(done.returncode, 0, done.stderr)
        with np.load(harness.path("series.npz")) as archive:
            series = archive["sun"]
        lat, lon = np.radians([[place["lat_deg"], place["lon_deg"]] for place in places]).T
        up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
        rays = [{"origin_m": list((RADIUS_M + 20e3) * d), "direction": list(-d)} for d in up]
        service = Service(dem=dem)
        errors, shares = [], []
        for epoch in random.integers(0, len(series), epochs):
            utc = (start + datetime.timedelta(hours=int(epoch))).isoformat() + "Z"
            lit = service.arrays({"rays": rays, "sun": {"utc": utc, "angular_radius_deg": "sun", "limb_darkening": 0.6}}, "/v1/rays")["lit"]
            errors.append(series[epoch] - lit)
            shares.append(lit)
        service.expect_clean_stop()
        return np.array(errors), np.array(shares)

    def test_shares_at_random_places_and_epochs(self):
        """Near a pole, where the Sun stands on the horizon for hours, with the limb darkening of the series."""
        if not (real := harness.shared_data("real")):
            self.skipTest("no shared data")
        centre = {"lat_deg": -84.19055, "lon_deg": 86.58583}
        errors, shares = self.shares_beside_discs(os.path.join(real, "mesh_2km_5mpix.tif"), centre, 700, 3,
                                                  200 if harness.full_effort() else 40)
        partly = errors[(shares > 0) & (shares < 1)]
        print(f"mean absolute error {np.abs(errors).mean():.4f} of {errors.size} shares, {np.abs(partly).mean():.4f} of "
              f"{partly.size} partly lit; mean {errors.mean():.4f}, {partly.mean():.4f}")
        self.assertGreater(partly.size, 100)
        self.assertLess(np.abs(errors).mean(), 0.001)
        self.assertLess(np.abs(partly).mean(), 0.02)

    def test_a_tilted_map_tilts_its_horizon(self):
        body = {"places": [PLACE], "horizon": {"azimuths": 72, "farthest_km": 4}}
        error = {"about": PLACE, "tilt": {"slope_deg": 0.4, "azimuth_deg": 90}}
        true, tilted = (np.array(self.ask("/v1/horizons", {**body, **more})["places"][0]["elevation_deg"])
                        for more in ({}, {"map_error": error}))
        azimuth = np.radians(np.arange(72) * 5.0)
        self.assertLess(np.abs(tilted - true - 0.4 * np.sin(azimuth)).max(), 0.06)

    def on_the_wrong_side(self, service, places, horizon, offsets_deg, elevations_deg=None):
        """Shares of rays from the eyes that hit ground above the horizons found, or miss it below them, by offset.
        The horizons are those at the places unless they are given, as pixels of a map."""
        if elevations_deg is None:
            status, _, body = service.post("/v1/horizons", {"places": places, "horizon": horizon}, "application/json")
            self.assertEqual(status, 200, body[:300])
            elevations_deg = [found["elevation_deg"] for found in json.loads(body)["places"]]
        ground = [p["height_m"] for p in json.loads(service.post("/v1/heights", {"points": places})[2])["points"]]
        rays = []
        for place, found, height_m in zip(places, elevations_deg, ground):
            lat, lon = np.radians([place["lat_deg"], place["lon_deg"]])
            up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
            east = np.array([-np.sin(lon), np.cos(lon), 0])
            north = np.cross(up, east)
            origin = (RADIUS_M + height_m + horizon["height_above_ground_m"]) * up
            for k, elevation_deg in enumerate(found):
                azimuth = 2 * np.pi * k / len(found)
                level = np.cos(azimuth) * north + np.sin(azimuth) * east
                for elevation in np.radians(elevation_deg + offsets_deg):
                    rays.append({"origin_m": list(origin), "direction": list(np.cos(elevation) * level + np.sin(elevation) * up)})
        status, _, body = service.post("/v1/rays", {"rays": rays})
        self.assertEqual(status, 200, body[:300])
        hit = np.array([ray["hit"] for ray in json.loads(body)["rays"]]).reshape(-1, len(offsets_deg))
        wrong = (hit != (offsets_deg < 0)).mean(axis=0)
        print("share of rays on the wrong side, by offset:", dict(zip(offsets_deg.tolist(), wrong.round(4).tolist())))
        return wrong

    def beside_a_pole(self, horizon, offsets_deg):
        """Triangles there are narrower than cells, and up to two horizons in a thousand are too high."""
        harness.sample("south", "--south-deg", "-90", "--west-deg", "0", "--rows", "5", "--columns", "12", "--ppd", "128")
        service = Service(dem="south", cache="south")
        random = np.random.default_rng(99)
        for lat_deg in (-87.5, -89):
            places = [{"lat_deg": lat_deg + lat, "lon_deg": 5 + 40 * lon} for lat, lon in random.uniform(-0.05, 0.05, (60, 2))]
            wrong = self.on_the_wrong_side(service, places, {**horizon, "farthest_km": 20}, offsets_deg)
            self.assertEqual(wrong[0], 0)
            self.assertLess(wrong[:3].max(), 0.003)
        service.expect_clean_stop()

    def test_rays_pass_just_above_and_hit_just_below(self):
        """From eyes 2 m above places at random, by rays to the triangles that frames show. On this ground horizons are
        never too high, and too low where edges of triangles cross the relief's cells nearby."""
        random = np.random.default_rng(7)
        offsets_deg = np.array([-0.1, -0.015, -0.005, 0.005, 0.015, 0.03, 0.1])
        horizon = {**HORIZON, "azimuths": 16, "height_above_ground_m": 2}
        places = [{"lat_deg": lat, "lon_deg": lon} for lat, lon in zip(random.uniform(-7.5, -6.5, EYES), random.uniform(39.5, 40.5, EYES))]
        wrong = self.on_the_wrong_side(self.service, places, horizon, offsets_deg)
        self.assertEqual(wrong[:3].max(), 0)
        self.assertLess(wrong[4], 0.2)
        self.assertLess(wrong[6], 0.01)

        # Some of these eyes stand on crests between triangles, which cells of the horizons' relief round.
        on_crests = [{"lat_deg": -7 + lat, "lon_deg": 40 + lon} for lat, lon in np.random.default_rng(7).uniform(-0.02, 0.02, (EYES, 2))]
        self.assertEqual(self.on_the_wrong_side(self.service, on_crests, horizon, offsets_deg)[:3].max(), 0)

        if harness.full_effort():
            self.beside_a_pole(horizon, offsets_deg)
        if not (polar := harness.shared_data("real")):
            self.skipTest("no shared data")
        service = Service(dem=os.path.join(polar, "mesh_2km_5mpix.tif"), cache="polar")
        places = [{"lat_deg": -84.19055 + lat, "lon_deg": 86.58583 + lon}
                  for lat, lon in zip(random.uniform(-0.012, 0.012, EYES), random.uniform(-0.12, 0.12, EYES))]
        wrong = self.on_the_wrong_side(service, places, {**horizon, "farthest_km": 3}, offsets_deg)
        self.assertEqual(wrong[:3].max(), 0)
        self.assertLess(wrong[4], 0.05)
        self.assertLess(wrong[5], 0.01)

        # The same of a map's pixels, which march on a lattice: an orthographic map, whose positions are known.
        side, gsd_m, centre = 64, 10, {"lat_deg": -84.19055, "lon_deg": 86.58583}
        area = {"projection": "orthographic", "center": centre, "width_m": side * gsd_m, "height_m": side * gsd_m, "gsd_m": gsd_m}
        found = service.arrays({"map": area, "horizon": {**horizon, "farthest_km": 3}}, "/v1/horizons")["elevation_deg"]
        lat, lon = np.radians([centre["lat_deg"], centre["lon_deg"]])
        up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        east = np.array([-np.sin(lon), np.cos(lon), 0])
        places, elevations_deg = [], []
        for row, column in random.integers(0, side, (EYES, 2)):
            east_m, north_m = (column + 0.5 - side / 2) * gsd_m, (side / 2 - row - 0.5) * gsd_m
            x, y, z = east_m * east + north_m * np.cross(up, east) + np.sqrt(RADIUS_M**2 - east_m**2 - north_m**2) * up
            places.append({"lat_deg": float(np.degrees(np.arcsin(z / RADIUS_M))), "lon_deg": float(np.degrees(np.arctan2(y, x)))})
            elevations_deg.append(found[:, row, column].astype(float).tolist())
        wrong = self.on_the_wrong_side(service, places, horizon, offsets_deg, elevations_deg)
        self.assertLess(wrong[:3].max(), 0.01)
        self.assertLess(wrong[4], 0.05)
        self.assertLess(wrong[5], 0.01)
        service.expect_clean_stop()

    def test_maps_places_and_files_agree(self):
        """A pixel's horizon is that of its place; the GeoTIFF, which GDAL places, holds what the npz holds."""
        small = {"map": {**AREA, "width_m": 400, "height_m": 400, "gsd_m": 100}, "horizon": {**HORIZON, "azimuths": 36}}
        arrays = self.service.arrays(small, "/v1/horizons")
        elevation = arrays["elevation_deg"]
        self.assertEqual(elevation.shape, (36, 4, 4))
        self.assertEqual(list(arrays["azimuth_deg"][:3]), [0, 10, 20])
        harness.write("request.json", small)
        done = harness.run("ask", "horizons", harness.path("request.json"), "-o", harness.path("horizons.tif"), "--dem",
                           harness.path("dem"), "--cache-dir", harness.path("cache"))
        self.assertEqual(done.returncode, 0, done.stderr)
        image = gdal.Open(harness.path("horizons.tif"))
        np.testing.assert_array_equal(image.ReadAsArray(), elevation)
        self.assertEqual(image.GetRasterBand(4).GetDescription(), "horizon at azimuth 30")
        transform = image.GetGeoTransform()
        lat = PLACE["lat_deg"] + np.degrees((transform[3] - 150) / RADIUS_M)
        lon = PLACE["lon_deg"] + np.degrees((transform[0] + 150) / RADIUS_M / np.cos(np.radians(lat)))
        place = self.ask("/v1/horizons", {"places": [{"lat_deg": lat, "lon_deg": lon}], "horizon": small["horizon"]})["places"][0]
        # Reliefs have other centres: the heights are interpolated at other posts.
        np.testing.assert_allclose(place["elevation_deg"], elevation[:, 1, 1], atol=0.2)

    def test_a_large_map_in_tiles(self):
        """By two processes, the second of which was killed once: the mosaic is the map, and each tile a COG."""
        body = {"map": {**AREA, "width_m": 2000, "height_m": 1500, "gsd_m": 50}, "horizon": {**HORIZON, "azimuths": 36, "farthest_km": 5}}
        whole = self.service.arrays(body, "/v1/horizons")["elevation_deg"]
        request = harness.path("large.json")
        harness.write("large.json", body)

        def make(shard, text=request):
            return harness.run("ask", "horizons", text, "-o", harness.path("tiles"), "--tile-px", "16", "--shard", shard, "--dem",
                               harness.path("dem"), "--cache-dir", harness.path("cache"))

        first = make("0/2")
        self.assertEqual((first.returncode, first.stdout), (0, f"{harness.path('tiles')}: 3 tiles made, 0 existed\n"), first.stderr)
        self.assertIn("100%", first.stderr)
        self.assertFalse(os.path.exists(harness.path("tiles/map.vrt")))
        os.remove(harness.path("tiles/tile-00000-00002.tif"))
        self.assertIn("3 tiles made, 0 existed", make("1/2").stdout)
        self.assertIn("1 tiles made, 2 existed", make("0/2").stdout)
        mosaic = gdal.Open(harness.path("tiles/map.vrt"))
        self.assertEqual(mosaic.GetRasterBand(4).GetDescription(), "horizon at azimuth 30")
        joined = mosaic.ReadAsArray()
        self.assertEqual(joined.shape, whole.shape)
        # A tile has a relief of its own.
        self.assertLess(np.mean(np.abs(joined - whole) > 0.03), 0.05)
        self.assertLess(np.abs(np.mean(joined - whole)), 0.002)
        from osgeo_utils.samples import validate_cloud_optimized_geotiff as cog
        self.assertEqual(cog.validate(harness.path("tiles/tile-00001-00001.tif"))[1], [])
        harness.write("large.json", {**body, "horizon": {**body["horizon"], "azimuths": 18}})
        self.assertIn("tiles of another request", make("0/2").stderr)

    def test_series_and_statistics(self):
        body = {"places": [PLACE, {"lat_deg": -6.6, "lon_deg": 40.2}], "from_utc": "2026-11-20T00:00:00Z",
                "to_utc": "2027-01-18T00:00:00Z", "step_s": 7200, "horizon": {**HORIZON, "azimuths": 180}}
        answer = self.ask("/v1/illumination", body)
        self.assertEqual(answer["meta"]["epochs"], 709)
        rows = list(csv.reader(io.StringIO(self.ask("/v1/illumination", body, "text/csv").decode())))
        self.assertEqual(rows[0], ["utc", "sun_1", "earth_1", "sun_2", "earth_2"])
        self.assertEqual((rows[1][0], rows[-1][0], len(rows)), ("2026-11-20T00:00:00Z", "2027-01-18T00:00:00Z", 710))
        arrays = self.service.arrays(body, "/v1/illumination")
        for i, place in enumerate(answer["places"]):
            sun = np.array(place["sun"])
            np.testing.assert_allclose([float(row[1 + 2 * i]) for row in rows[1:]], sun, rtol=1e-5)
            np.testing.assert_array_equal(np.float32(sun), arrays["sun"][:, i])
            self.assertAlmostEqual(place["sun_mean"], sun.mean(), 5)
            self.assertLess(abs(place["sun_mean"] - 0.5), 0.1)  # two lunations, near the equator, less what rims hide
            runs = "".join("n" if share == 0 else "d" for share in sun).replace("d", " ").split()
            self.assertEqual(place["nights"], len(runs))
            self.assertEqual(place["longest_night_h"], 2 * max(map(len, runs)))
            self.assertGreater(place["longest_night_h"], 300)
            self.assertEqual(place["longest_without_earth_h"], 0)  # it stands high over 40 degrees east
            self.assertEqual(place["earth_mean"], 1)

    def test_refusals(self):
        valid = {"places": [PLACE], "from_utc": "2026-11-20T00:00:00Z", "to_utc": "2026-11-21T00:00:00Z"}
        for change, pointer in (({"to_utc": "2026-11-19T00:00:00Z"}, "/to_utc"), ({"from_utc": "November"}, "/from_utc"),
                                ({"step_s": 0.5}, "/step_s"), ({"step_s": 90.5}, "/step_s"), ({"map": AREA}, "/places"),
                                ({"horizon": {"azimuths": 7}}, "/horizon/azimuths")):
            status, _, body = self.service.post("/v1/illumination", {**valid, **change})
            self.assertEqual(status, 422, change)
            self.assertIn(pointer, [error["pointer"] for error in json.loads(body)["errors"]])
        self.assertEqual(self.service.post("/v1/illumination", valid, "image/tiff")[0], 406)
        void = self.ask("/v1/horizons", {"places": [{"lat_deg": 60, "lon_deg": 0}], "horizon": {"azimuths": 8, "farthest_km": 5}})
        self.assertEqual(void["places"][0]["elevation_deg"], [None] * 8)
        self.assertEqual(void["meta"]["missing_places"], 1)


if __name__ == "__main__":
    harness.main()
