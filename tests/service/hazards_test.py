#!/usr/bin/env python3
"""Hazard maps: slope and roughness over a lander's footprint, rocks, limits; against brute force on the map's heights."""

import math
import os

import numpy as np

import harness
from harness import sample, tearDownModule

GSD_M, RADIUS_M = 0.25, 1737400.0
CENTER = {"lat_deg": 0.1, "lon_deg": 30.1}
ALL = ["height", "slope", "rock_height", "rock_cover", "roughness", "hazard"]
LIMITS = {"max_slope_deg": 6.0, "max_roughness_m": 0.25, "max_rock_height_m": 0.2, "max_rock_cover": 0.02}


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    Hazards.service = harness.Service("--assets-dir", harness.assets())


def area(width_m=25.0, height_m=20.0, gsd_m=GSD_M, center=CENTER):
    return {"projection": "equirectangular", "center": center, "width_m": width_m, "height_m": height_m, "gsd_m": gsd_m}


def request(footprint, products=ALL, **changes):
    return {"map": area(), "detail": "landing", "rocks": True, "footprint": footprint, "hazard": LIMITS, "products": list(products),
            "accuracy": {"max_error_px": 0.25}} | changes


def offsets_of(footprint, metres_per_px):
    """Pixels that are covered, and those that carry the lander: (n, 2) right and down."""
    n = int(footprint["diameter_m"] / metres_per_px) + 2
    x, y = np.meshgrid(np.arange(-n, n + 1), np.arange(-n, n + 1))
    half = footprint["diameter_m"] / 2 / metres_per_px
    inside = np.maximum(abs(x), abs(y)) <= half if footprint.get("shape") == "square" else np.hypot(x, y) <= half
    covered = np.stack([x[inside], y[inside]], 1)
    if footprint.get("shape") != "legs":
        return covered, covered
    legs = footprint.get("legs", 4)
    azimuths = np.radians(footprint.get("azimuth_deg", 0) + 360 / legs * np.arange(legs))
    return covered, np.rint(half * np.stack([np.sin(azimuths), -np.cos(azimuths)], 1)).astype(int)


def by_brute_force(f, footprint, at):
    """Slope, roughness, cover of rocks and highest rock about a pixel (column, row)."""
    column, row = at
    metres_per_px = GSD_M * (RADIUS_M + f["height"].mean()) / RADIUS_M
    covered, standing = offsets_of(footprint, metres_per_px)
    take = lambda array, offsets: array[row + offsets[:, 1], column + offsets[:, 0]]
    heights = take(f["height"], standing)
    equations = np.column_stack([np.ones(len(standing)), standing * metres_per_px])
    plane = np.linalg.lstsq(equations, heights - heights.mean(), rcond=None)[0]
    gradient = np.hypot(plane[1], plane[2])
    off = take(f["height"], covered) - heights.mean() - (plane[0] + covered * metres_per_px @ plane[1:])
    rocks = take(f["rock_height"], covered)
    return math.degrees(math.atan(gradient)), abs(off).max() / np.hypot(1, gradient), (rocks > 0).mean(), rocks.max()


class Hazards(harness.unittest.TestCase):
    def map(self, document):
        return self.service.arrays(document, "/v1/maps")

    def compare(self, footprint):
        f = self.map(request(footprint))
        height, width = f["height"].shape
        margin = int(footprint["diameter_m"] / GSD_M) + 2
        worst = np.zeros(3)
        for row in range(margin, height - margin, 7):
            for column in range(margin, width - margin, 5):
                slope, roughness, cover, highest = by_brute_force(f, footprint, (column, row))
                worst = np.maximum(worst, abs(np.array([slope - f["slope"][row, column], roughness - f["roughness"][row, column],
                                                        cover - f["rock_cover"][row, column]])))
                hazard = (slope > 6.0) + 2 * (roughness > 0.25) + 4 * (highest > 0.2) + 8 * (cover > 0.02)
                near = min(abs(slope - 6.0) / 0.01, abs(roughness - 0.25) / 1e-4, abs(highest - 0.2) / 1e-6) < 1
                self.assertTrue(near or hazard == f["hazard"][row, column], (hazard, f["hazard"][row, column]))
        self.assertLess(worst[0], 0.002)
        self.assertLess(worst[1], 1e-4)
        self.assertLess(worst[2], 1e-6)
        self.assertGreater(len(np.unique(f["hazard"])), 2)
        # The mask alone needs no more of the roughness than what exceeds its limit.
        np.testing.assert_array_equal(f["hazard"], self.map(request(footprint, ["hazard"]))["hazard"])

    def test_a_disc(self):
        self.compare({"diameter_m": 3.0})

    def test_a_square(self):
        self.compare({"shape": "square", "diameter_m": 2.5})

    def test_legs(self):
        self.compare({"shape": "legs", "diameter_m": 4.0, "legs": 3, "azimuth_deg": 20.0})

    def beside_the_pole(self):
        if not os.path.exists(harness.path("polar")):
            sample("polar", "--south-deg", "-90", "--west-deg", "-10", "--rows", "1", "--columns", "100", "--ppd", "32")
        service = harness.Service(cache=harness.path("polar_cache"), dem=harness.path("polar"))
        self.addCleanup(service.stop)
        return service

    def test_beside_a_pole_north_turns_from_pixel_to_pixel(self):
        """A footprint is turned by the meridian of its own middle, not by that of a square of pixels."""
        gsd_m, sixth = 100.0, 7
        service = self.beside_the_pole()
        footprint = {"shape": "legs", "diameter_m": 11 * gsd_m, "legs": 4, "azimuth_deg": 0.0}

        def around(lat_deg, lon_deg, pixels):
            side_m = pixels * gsd_m
            return service.arrays({"products": ["slope", "height"], "footprint": footprint, "map": {
                "projection": "polar_stereographic", "center": {"lat_deg": lat_deg, "lon_deg": lon_deg}, "width_m": side_m,
                "height_m": side_m, "gsd_m": gsd_m}}, "/v1/maps")

        whole = around(-89.5, 40.0, 127)
        left, across, _, top, _, down = whole["meta"]["grid"]["geotransform"]
        x_m, y_m = left + across * (sixth + 1.5), top + down * (sixth + 1.5)
        away_deg = 2 * math.degrees(math.atan(math.hypot(x_m, y_m) / (2 * RADIUS_M)))
        piece = around(away_deg - 90, math.degrees(math.atan2(x_m, y_m)), 15)
        other_left, _, _, other_top, _, _ = piece["meta"]["grid"]["geotransform"]
        row, column = round((other_top - top) / down), round((other_left - left) / across)
        self.assertGreaterEqual(min(row, column), 0)
        same = whole["height"][row:row + 15, column:column + 15]
        self.assertLess(abs(same - piece["height"]).max(), 1e-3)
        self.assertLess(abs(whole["slope"][row:row + 15, column:column + 15] - piece["slope"]).max(), 0.02)

    def test_a_map_ends_nowhere(self):
        """At its border it has what a wider map has there."""
        footprint = {"diameter_m": 3.0}
        small, wide = self.map(request(footprint)), self.map(request(footprint, map=area(35.0, 30.0)))
        for product in ALL:
            rows, columns = small[product].shape
            inner = wide[product][20:20 + rows, 20:20 + columns]
            self.assertTrue(np.isfinite(small[product]).all())
            self.assertLess(np.quantile(abs(inner.astype(float) - small[product]), 0.999), 0.02, product)

    def test_rocks_are_those_listed(self):
        half_deg = math.degrees(15.0 / RADIUS_M)
        region = {"south_deg": 0.1 - half_deg, "north_deg": 0.1 + half_deg, "west_deg": 30.1 - half_deg, "east_deg": 30.1 + half_deg}
        status, _, body = self.service.post("/v1/features", {"detail": "landing", "kind": "rocks", "region": region, "smallest_m": 0.04})
        self.assertEqual(status, 200, body[:300])
        rocks = harness.json.loads(body)["rocks"]
        gsd_m = 0.1
        f = self.map(request({"diameter_m": 3.0}, ["height", "rock_height"], map=area(20.0, 20.0, gsd_m)))
        bare = self.map({"map": area(20.0, 20.0, gsd_m), "detail": "landing", "products": ["height"], "accuracy": {"max_error_px": 0.25}})
        size = f["height"].shape[0]
        places = np.array([[r["lon_deg"] - 30.1, 0.1 - r["lat_deg"]] for r in rocks])
        places = np.radians(places) * RADIUS_M / gsd_m + (size - 1) / 2
        diameters = np.array([r["diameter_m"] for r in rocks]) / gsd_m
        self.assertGreater(len(rocks), 10)
        on_rock = f["rock_height"] > 0
        rows, columns = np.nonzero(on_rock)
        for row, column in zip(rows, columns):
            apart = np.hypot(places[:, 0] - column, places[:, 1] - row)
            self.assertTrue((apart < 0.8 * diameters + 1).any(), (row, column))
        inside = (abs(places - size / 2) < size / 2 - 2).all(1) & (diameters >= 3)
        self.assertGreater(inside.sum(), 3)
        for x, y in np.rint(places[inside]).astype(int):
            self.assertTrue(on_rock[y, x], (x, y))
        raised = f["height"] - bare["height"]
        self.assertLess(abs(raised - f["rock_height"])[on_rock].max(), 2e-3)
        self.assertGreater(raised.min(), -2e-3)

    def test_a_hazard_where_there_is_no_data_is_unknown(self):
        f = self.map(request({"diameter_m": 300.0}, ["slope", "hazard"], rocks=False, detail=None, hazard={"max_slope_deg": 3.0},
                             map=area(6000.0, 6000.0, 50.0, {"lat_deg": 0.95, "lon_deg": 30.1})))
        self.assertTrue(np.isnan(f["slope"]).any())
        np.testing.assert_array_equal(np.isnan(f["slope"]), f["hazard"] == 65535)
        self.assertTrue((f["hazard"] == 1).any() and (f["hazard"] == 0).any())

    def test_a_detail_without_rocks_is_warned_of(self):
        for detail, count in (("mare", 1), ("landing", 0)):
            f = self.service.arrays({"map": area(5, 5), "detail": detail, "rocks": True, "products": ["rock_height"]}, "/v1/maps")
            said = [w for w in f["meta"]["warnings"] if "the detail has none" in w]
            self.assertEqual(len(said), count, f["meta"]["warnings"])

    def test_the_picture(self):
        """Of the README: SELENOGRAPH_WRITE_DOCUMENTS=1 writes it. Roughness is found by other arithmetic for a few of its pixels."""
        gsd_m, size, disc = 0.1, 1000 if os.environ.get("SELENOGRAPH_WRITE_DOCUMENTS") else 240, {"diameter_m": 8.0}
        document = request(disc, ["radiance", *ALL], map=area(size * gsd_m, size * gsd_m, gsd_m), accuracy={}, sun={
            "local": {**CENTER, "azimuth_deg": 90.0, "elevation_deg": 25.0}},
            hazard={"max_slope_deg": 10.0, "max_roughness_m": 0.4, "max_rock_height_m": 0.3})
        f = self.map(document)
        covered, _ = offsets_of(disc, gsd_m * (RADIUS_M + f["height"].mean()) / RADIUS_M)
        for row, column in ((60, 60), (119, 150), (170, 99)):
            plane = np.linalg.lstsq(np.column_stack([np.ones(len(covered)), covered]),
                                    f["height"][row + covered[:, 1], column + covered[:, 0]], rcond=None)[0]
            off = f["height"][row + covered[:, 1], column + covered[:, 0]] - plane[0] - covered @ plane[1:]
            tilt = np.hypot(1, np.hypot(*plane[1:]) / gsd_m)
            self.assertAlmostEqual(abs(off).max() / tilt, f["roughness"][row, column], delta=1e-4)
        if size < 1000:
            return
        import cv2
        shown = [f["radiance"] / 30, f["slope"] / 20, f["roughness"] / 0.6, f["hazard"] / 7]
        four = [np.clip(255 * array, 0, 255).astype(np.uint8)[::2, ::2] for array in shown]
        cv2.imwrite(os.path.join(harness.REPOSITORY, "engine", "hazard", "hazards.png"),
                    np.vstack([np.hstack(four[:2]), np.hstack(four[2:])]))

    def test_refused(self):
        def member(document):
            document = {name: value for name, value in document.items() if value is not None}
            status, _, body = self.service.post("/v1/maps", document)
            self.assertEqual(status, 422, body[:300])
            return harness.json.loads(body)["errors"][0]["pointer"]
        disc = {"diameter_m": 3.0}
        self.assertEqual(member(request(None, ["roughness"])), "/footprint")
        self.assertEqual(member(request(disc, ["hazard"], hazard=None)), "/hazard")
        self.assertEqual(member(request(disc, ["rock_cover"], rocks=False, hazard=None)), "/rocks")
        self.assertEqual(member(request(disc, ["slope"], detail=None)), "/rocks")
        self.assertEqual(member(request({"diameter_m": 0.5}, ["slope"])), "/footprint/diameter_m")
        self.assertEqual(member(request({"diameter_m": 3000.0}, ["slope"])), "/footprint/diameter_m")
        self.assertEqual(member(request({"diameter_m": -3.0}, ["slope"])), "/footprint/diameter_m")
        self.assertEqual(member(request({"diameter_m": 3.0, "legs": 4}, ["slope"])), "/footprint/legs")
        self.assertEqual(member(request(disc, ["hazard"], hazard={})), "/hazard/max_slope_deg")
        sideways = {"direction": [1.0, 0.5, 0.0]}
        self.assertEqual(member(request(disc, ["slope"], view=sideways)), "/view")


if __name__ == "__main__":
    harness.main()
