#!/usr/bin/env python3
"""POST /v1/maps and `selenograph ask maps`: maps lie where GDAL says, and hold what rays, heights and closed forms say."""

import itertools
import json
import math
import os
import re
import resource
import unittest

import numpy as np
from osgeo import gdal, osr

import harness
from harness import Service, tearDownModule

gdal.UseExceptions()
osr.DontUseExceptions()  # which the former means, too, from GDAL 3.7 on: places beyond a disc are no error here

RADIUS_M = 1737400.0
PLANE = {"south_deg": 10.0, "west_deg": 10.0}  # a tile of 1 x 1 degree that rises to the north
PLANE_M_PER_DEG = 4000.0

# One of each projection, and where projections are known to break.
PLACES = {
    "equirectangular": {"projection": "equirectangular", "gsd_m": 100.0,
                        "bounds": {"south_deg": -6.6, "north_deg": -6.4, "west_deg": 39.9, "east_deg": 40.1}},
    "equirectangular, date line": {"projection": "equirectangular", "gsd_m": 100.0,
                                   "bounds": {"south_deg": 30.0, "north_deg": 30.2, "west_deg": 179.9, "east_deg": -179.9}},
    "equirectangular, about a place": {"projection": "equirectangular", "gsd_m": 100.0, "center": {"lat_deg": 60.0, "lon_deg": 180.0},
                                       "width_m": 6000.0, "height_m": 5000.0},
    "north pole": {"projection": "polar_stereographic", "gsd_m": 100.0, "center": {"lat_deg": 90.0, "lon_deg": 0.0},
                   "width_m": 6000.0, "height_m": 5000.0},
    "south pole": {"projection": "polar_stereographic", "gsd_m": 100.0, "center": {"lat_deg": -89.9, "lon_deg": 120.0},
                   "width_m": 8000.0, "height_m": 5000.0},
    "polar, date line": {"projection": "polar_stereographic", "gsd_m": 100.0, "center": {"lat_deg": 75.0, "lon_deg": 180.0},
                         "width_m": 6000.0, "height_m": 5000.0},
    "orthographic": {"projection": "orthographic", "gsd_m": 100.0, "center": {"lat_deg": 26.1, "lon_deg": 3.6},
                     "width_m": 6000.0, "height_m": 5000.0},
    "orthographic, date line": {"projection": "orthographic", "gsd_m": 100.0, "center": {"lat_deg": -50.0, "lon_deg": -180.0},
                                "width_m": 6000.0, "height_m": 5000.0},
    "orthographic, pole": {"projection": "orthographic", "gsd_m": 100.0, "center": {"lat_deg": -90.0, "lon_deg": 0.0},
                           "width_m": 6000.0, "height_m": 5000.0},
    "orthographic, pole, along 20 degrees": {"projection": "orthographic", "gsd_m": 100.0, "center": {"lat_deg": 90.0, "lon_deg": 20.0},
                                             "width_m": 6000.0, "height_m": 5000.0},
    "orthographic, south pole, along 200 degrees": {"projection": "orthographic", "gsd_m": 100.0,
                                                    "center": {"lat_deg": -90.0, "lon_deg": 200.0},
                                                    "width_m": 6000.0, "height_m": 5000.0},
    "orthographic, beside the pole": {"projection": "orthographic", "gsd_m": 100.0, "center": {"lat_deg": 89.9999, "lon_deg": 20.0},
                                      "width_m": 6000.0, "height_m": 5000.0},
}


def vector(lat_deg, lon_deg):
    lat, lon = np.broadcast_arrays(np.radians(lat_deg), np.radians(lon_deg))
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


def relief(lat_deg, lon_deg):
    """Smooth everywhere on the sphere; slopes up to 12 degrees."""
    p = vector(lat_deg, lon_deg)
    return 900 * np.sin(150 * p[..., 0]) * np.sin(170 * p[..., 1]) + 700 * np.sin(190 * p[..., 2])


def write_dem(path, south_deg, west_deg, rows, columns, posts_per_degree, height):
    """A GeoTIFF of posts at the pixels' centres."""
    os.makedirs(os.path.dirname(path), exist_ok=True)
    lat = south_deg + (rows - 0.5 - np.arange(rows)) / posts_per_degree
    lon = west_deg + (0.5 + np.arange(columns)) / posts_per_degree
    moon = osr.SpatialReference()
    moon.SetGeogCS("Moon", "Moon", "Moon", RADIUS_M, 0)
    file = gdal.GetDriverByName("GTiff").Create(path, columns, rows, 1, gdal.GDT_Float32)
    file.SetProjection(moon.ExportToWkt())
    file.SetGeoTransform([west_deg, 1 / posts_per_degree, 0, south_deg + rows / posts_per_degree, 0, -1 / posts_per_degree])
    file.GetRasterBand(1).WriteArray(np.broadcast_to(height(lat[:, None], lon[None, :]), (rows, columns)).astype(np.float32))
    file.FlushCache()


def setUpModule():
    harness.set_up()
    write_dem(harness.path("level", "global.tif"), -90, -180, 360, 720, 2, lambda lat, lon: 0 * lat * lon)
    write_dem(harness.path("level", "plane.tif"), PLANE["south_deg"], PLANE["west_deg"], 128, 128, 128,
              lambda lat, lon: PLANE_M_PER_DEG * (lat - PLANE["south_deg"]) + 0 * lon)
    write_dem(harness.path("region", "tile.tif"), 15, 95, 40, 40, 4, lambda lat, lon: 0 * lat * lon)
    write_dem(harness.path("relief", "global.tif"), -90, -180, 1440, 2880, 8, relief)


def npz(body):
    arrays = harness.arrays_of(body)
    return arrays, arrays["meta"]


class Tiff:
    """A GeoTIFF as any program of GDAL's sees it."""

    names = itertools.count()

    def __init__(self, body):
        path = f"/vsimem/maps-test-{next(self.names)}.tif"
        gdal.FileFromMemBuffer(path, body)
        self.file = gdal.Open(path)
        self.transform = self.file.GetGeoTransform()
        self.srs = self.file.GetSpatialRef()
        self.bands = {}
        for i in range(self.file.RasterCount):
            band = self.file.GetRasterBand(i + 1)
            self.bands[band.GetDescription()] = band.ReadAsArray()

    def band(self, name):
        return next(self.file.GetRasterBand(i + 1) for i in range(self.file.RasterCount)
                    if self.file.GetRasterBand(i + 1).GetDescription() == name)

    def lat_lon(self):
        """Of all pixels' centres, height x width each; infinite where GDAL finds no Moon."""
        columns, rows = np.meshgrid(np.arange(self.file.RasterXSize) + 0.5, np.arange(self.file.RasterYSize) + 0.5)
        return lat_lon(self.transform, self.srs, columns, rows)


def lat_lon(transform, srs, columns, rows):
    geographic = srs.CloneGeogCS()
    for system in (srs, geographic):
        system.SetAxisMappingStrategy(osr.OAMS_TRADITIONAL_GIS_ORDER)
    x, y = transform[0] + columns * transform[1] + rows * transform[2], transform[3] + columns * transform[4] + rows * transform[5]
    places = np.array(osr.CoordinateTransformation(srs, geographic).TransformPoints(np.stack([x.ravel(), y.ravel()], axis=1).tolist()))
    return places[:, 1].reshape(x.shape), places[:, 0].reshape(x.shape)


def map_request(area, *products, **more):
    return {"map": area, "products": list(products), **more}


class Maps(harness.WithService):
    """Of the Moon without relief, but for a plane that rises to the north."""

    @classmethod
    def setUpClass(cls):
        # The plane as it is, to its border.
        cls.service = Service("--max-map-pixels", "300000", "--blend-posts", "0", dem="level", cache="cache-level")

    def map(self, request, accept="application/x-npz", **headers):
        return self.ok(self.service.post("/v1/maps", request, accept, **headers), accept)

    def test_gdal_places_pixels_where_they_are(self):
        """The normal of level ground is the direction from the Moon's centre, to float's 0.1 m."""
        for name, area in PLACES.items():
            with self.subTest(name):
                tiff = Tiff(self.map(map_request(area, "normal"), "image/tiff"))
                normal = np.stack([tiff.bands["normal." + axis] for axis in "xyz"], axis=-1)
                self.assertTrue(np.isfinite(normal).all())
                lat, lon = tiff.lat_lon()
                off_px = np.linalg.norm(np.cross(normal, vector(lat, lon)), axis=-1) * RADIUS_M / area["gsd_m"]
                self.assertLess(off_px.max(), 0.01)
                if area["projection"] != "polar_stereographic" and "pole" not in name:
                    self.assertTrue((lat[0] > lat[-1]).all(), "row 0 is in the north")
                self.assertAlmostEqual(tiff.transform[1], area["gsd_m"])
                self.assertAlmostEqual(tiff.transform[5], -area["gsd_m"])

    def test_coarse_triangles_lower_no_heights(self):
        """A triangle's plane lies below level ground, by 0.07 m between posts 1 km apart; a map's heights do not."""
        for gsd_m in (400, 700, 1000, 4000, 20000):
            area = {"projection": "equirectangular", "gsd_m": gsd_m,
                    "bounds": {"south_deg": 20, "north_deg": 26, "west_deg": 40, "east_deg": 46}}
            with self.subTest(gsd_m):
                arrays, meta = npz(self.map(map_request(area, "height")))
                np.testing.assert_allclose(arrays["height"], 0, rtol=0, atol=1e-6)
                if gsd_m >= 1000:
                    self.assertGreater(meta["post_spacing_m"]["max"], 900, "the triangles were not coarse")

    def test_npz_says_the_same_as_the_geotiff(self):
        for name, area in PLACES.items():
            with self.subTest(name):
                request = map_request(area, "height", "normal", "slope", "source")
                tiff = Tiff(self.map(request, "image/tiff"))
                arrays, meta = npz(self.map(request))
                self.assertEqual(list(meta["grid"]["geotransform"]), list(tiff.transform))
                srs = osr.SpatialReference()
                srs.SetFromUserInput(meta["grid"]["wkt"])
                columns, rows = np.array([[0.5, 3.5]]), np.array([[0.5, 7.5]])
                np.testing.assert_allclose(lat_lon(tiff.transform, srs, columns, rows), lat_lon(tiff.transform, tiff.srs, columns, rows),
                                           rtol=0, atol=1e-12)
                np.testing.assert_array_equal(arrays["height"], tiff.bands["height"])
                np.testing.assert_array_equal(arrays["slope"], tiff.bands["slope"])
                np.testing.assert_array_equal(arrays["normal"][..., 2], tiff.bands["normal.z"])
                np.testing.assert_array_equal(arrays["source"], tiff.bands["source"])
                self.assertEqual(tiff.band("height").GetUnitType(), "m")
                self.assertTrue(math.isnan(tiff.band("height").GetNoDataValue()))
                self.assertEqual(json.loads(tiff.file.GetMetadataItem("SELENOGRAPH"))["grid"], meta["grid"])
                self.assertEqual((meta["grid"]["height"], meta["grid"]["width"]), arrays["height"].shape)

    def test_a_map_of_less_than_a_pixel_is_warned_of(self):
        for width_m, warned in ((0.2, True), (100.0, False)):
            area = {"projection": "orthographic", "center": {"lat_deg": 26.1, "lon_deg": 3.6}, "gsd_m": 100.0, "width_m": width_m, "height_m": 300.0}
            answer = self.service.arrays({"map": area, "products": ["height"]}, "/v1/maps")
            self.assertEqual(answer["height"].shape, (3, 1))
            self.assertEqual(any("less than gsd_m" in text for text in answer["meta"]["warnings"]), warned)

    def test_slope_of_an_inclined_plane(self):
        """r = R + a phi: the slope's tangent is a / r."""
        area = {"projection": "equirectangular", "gsd_m": 250.0, "bounds": {
            "south_deg": 10.2, "north_deg": 10.8, "west_deg": 10.2, "east_deg": 10.8}}
        arrays, _ = npz(self.map(map_request(area, "slope", "height", "source")))
        lat, _ = Tiff(self.map(map_request(area, "height"), "image/tiff")).lat_lon()
        np.testing.assert_allclose(arrays["height"], PLANE_M_PER_DEG * (lat - PLANE["south_deg"]), rtol=0, atol=0.5)
        slope = np.degrees(np.arctan(PLANE_M_PER_DEG * 180 / math.pi / (RADIUS_M + arrays["height"])))
        np.testing.assert_allclose(arrays["slope"], slope, rtol=0, atol=0.02)
        level, _ = npz(self.map(map_request(PLACES["orthographic"], "slope")))
        self.assertLess(level["slope"].max(), 1e-4)

    def test_png(self):
        area = {"projection": "equirectangular", "gsd_m": 250.0, "bounds": {
            "south_deg": 10.2, "north_deg": 10.8, "west_deg": 10.2, "east_deg": 10.8}}
        arrays, _ = npz(self.map(map_request(area, "height")))
        body = self.map(map_request(area, "height"), "image/png")
        gdal.FileFromMemBuffer("/vsimem/maps-test.png", body)
        png = gdal.Open("/vsimem/maps-test.png")
        scale = json.loads(png.GetMetadataItem("selenograph"))["png_scale"]
        numbers = png.ReadAsArray().astype(float)
        height = scale["value_of_1"] + (numbers - 1) / 65534 * (scale["value_of_65535"] - scale["value_of_1"])
        np.testing.assert_allclose(height, arrays["height"], rtol=0, atol=0.51 * np.ptp(arrays["height"]) / 65534)
        self.assertEqual((numbers.min(), numbers.max()), (1, 65535))

    def test_etag(self):
        request = map_request(PLACES["orthographic"], "height")
        status, headers, body = self.service.post("/v1/maps", request, "image/tiff")
        self.assertEqual(status, 200)
        self.assertEqual(self.service.post("/v1/maps", request, "image/tiff", If_None_Match=headers["ETag"])[0], 304)
        self.assertEqual(self.service.post("/v1/maps", request, "application/x-npz", If_None_Match=headers["ETag"])[0], 200)
        resolved = json.loads(Tiff(body).file.GetMetadataItem("SELENOGRAPH"))["request"]
        again = self.service.post("/v1/maps", resolved, "image/tiff")
        self.assertEqual((again[1]["ETag"], again[2]), (headers["ETag"], body))


class Regional(harness.WithService):
    """Level ground of 10 x 10 degrees, nothing around it."""

    @classmethod
    def setUpClass(cls):
        cls.service = Service(dem="region", cache="cache-region")

    def map(self, area):
        request = map_request(area, "height", "lit", "radiance", "source", sun={"direction": [0, 1, 0]})
        body = self.ok(self.service.post("/v1/maps", request, "application/x-npz"), "application/x-npz")
        tiff = Tiff(self.ok(self.service.post("/v1/maps", request, "image/tiff"), "image/tiff"))
        return *npz(body), tiff

    def check(self, area, shape, moon):
        """`moon`: what pixels are on it, as is said of their coordinates; data is where GDAL says that the tile is."""
        arrays, meta, tiff = self.map(area)
        lat, lon = tiff.lat_lon()
        lon = np.mod(np.where(moon, lon, 0), 360)
        data = moon & (lat > 15) & (lat < 25) & (lon > 95) & (lon < 105)
        self.assertEqual(data.shape, shape)
        self.assertGreater(data.sum(), 3)
        for product in ("height", "lit", "radiance"):
            np.testing.assert_array_equal(np.isfinite(arrays[product]), data)
        np.testing.assert_array_equal(arrays["source"] != 65535, data)
        np.testing.assert_array_equal(np.isnan(tiff.bands["source"]), ~data)
        self.assertAlmostEqual(meta["hit_fraction"], data.mean())
        self.assertAlmostEqual(meta["missing_fraction"], moon.mean() - data.mean())

    def test_a_whole_disc(self):
        gsd = 40000.0
        disc = {"projection": "orthographic", "center": {"lat_deg": 20.0, "lon_deg": 150.0}, "width_m": 4e6, "height_m": 4e6, "gsd_m": gsd}
        x, y = np.meshgrid(-2e6 + gsd * (np.arange(100) + 0.5), 2e6 - gsd * (np.arange(100) + 0.5))
        self.check(disc, (100, 100), np.hypot(x, y) <= RADIUS_M)

    def test_the_whole_moon(self):
        for west, east in ((-180, 180), (0, 360)):
            globe = {"projection": "equirectangular", "gsd_m": math.pi * RADIUS_M / 80,
                     "bounds": {"south_deg": -90, "north_deg": 90, "west_deg": west, "east_deg": east}}
            self.check(globe, (80, 160), np.ones((80, 160), bool))

    def test_beyond_a_pole(self):
        area = {"projection": "equirectangular", "gsd_m": 60000.0, "center": {"lat_deg": 40.0, "lon_deg": 100.0},
                "width_m": 2.4e6, "height_m": 3.6e6}
        y = 40.0 + np.degrees((1.8e6 - 60000 * (np.arange(60) + 0.5)) / RADIUS_M)
        self.check(area, (60, 40), np.broadcast_to(y[:, None] <= 90, (60, 40)))


class OfRelief(harness.WithService):
    """Against /v1/heights, /v1/rays and /v1/project."""

    @classmethod
    def setUpClass(cls):
        cls.service = Service(dem="relief", cache="cache-relief")

    def map(self, request, accept="application/x-npz"):
        return self.ok(self.service.post("/v1/maps", request, accept), accept)

    def sampled(self, area, *products, **more):
        """Some pixels: latitude, longitude by GDAL, and each product's values there."""
        tiff = Tiff(self.map(map_request(area, *products, accuracy={"max_error_px": 0}, **more), "image/tiff"))
        lat, lon = tiff.lat_lon()
        some = np.random.default_rng(1).choice(lat.size, 200, replace=False)
        return lat.ravel()[some], lon.ravel()[some], {name: values.ravel()[some] for name, values in tiff.bands.items()}

    def test_a_map_of_heights_is_a_dem(self):
        """Read back, it has the heights that it was made of, to what `info --resampling` says."""
        for name, area in PLACES.items():
            if not harness.full_effort() and name not in ("equirectangular", "south pole"):
                continue
            with self.subTest(name):
                folder = harness.path("read back", name)
                os.makedirs(folder)
                with open(os.path.join(folder, "map.tif"), "wb") as f:
                    f.write(self.map(map_request(area, "height", accuracy={"max_error_px": 0}), "image/tiff"))
                told = harness.run("info", "--dem", folder, "--cache-dir", folder + " cache", "--resampling", "2000")
                self.assertEqual(told.returncode, 0, told.stderr)
                if area["projection"] != "equirectangular":
                    self.assertIn(f"GTiff, {area['projection']}, ", told.stdout)
                found = re.search(r"mesh against (\d+) of its posts: rms ([\d.]+) m, worst ([\d.]+) m", told.stdout)
                self.assertTrue(found, told.stdout)
                self.assertGreater(int(found[1]), 1900)
                self.assertLess(float(found[3]), 0.3)  # of slopes up to 20 m from post to post
                as_json = harness.run("info", "--json", "--dem", folder, "--cache-dir", folder + " cache", "--resampling", "2000")
                (resampled,) = json.loads(as_json.stdout)["resampling"]
                self.assertEqual((resampled["name"], resampled["posts"]), ("map", int(found[1])))
                self.assertAlmostEqual(resampled["rms_m"], float(found[2]), delta=6e-4)
                self.assertAlmostEqual(resampled["worst_m"], float(found[3]), delta=6e-4)
                lat, lon, map_ = self.sampled(area, "height")
                service = Service(dem=folder, cache="cache " + name)
                places = [{"lat_deg": a, "lon_deg": b} for a, b in zip(lat, lon)]
                heights = self.ok_json(service.post("/v1/heights", {"points": places}))["points"]
                self.assertEqual(service.stop(), 0)
                off = np.abs(np.array([p["height_m"] for p in heights]) - map_["height"])
                # Of other posts than those compared: the same spread, and no worse than the worst that is allowed.
                self.assertLess(np.sqrt((off ** 2).mean()), 1.5 * float(found[2]) + 1e-3)
                self.assertLess(off.max(), 0.3)

    def test_lit_and_normal_are_those_of_rays(self):
        seen = set()
        cases = (("south pole", 0), ("polar, date line", 0.2666), ("equirectangular", 0), ("orthographic", 0.2666))
        for name, disc in cases if harness.full_effort() else cases[:2]:
            with self.subTest(name):
                area = dict(PLACES[name])
                if "center" in area:
                    area.update(gsd_m=400.0, width_m=24000.0, height_m=20000.0)
                lat, lon = (a.ravel()[a.size // 2] for a in Tiff(self.map(map_request(area, "height"), "image/tiff")).lat_lon())
                sun = {"local": {"lat_deg": lat, "lon_deg": lon, "azimuth_deg": 70.0, "elevation_deg": 3.0},
                       "angular_radius_deg": disc}
                lat, lon, map_ = self.sampled(area, "lit", "normal", "height", sun=sun)
                up = vector(lat, lon)
                rays = [{"origin_m": (d * (RADIUS_M + 20000)).tolist(), "direction": (-d).tolist()} for d in up]
                hits = self.ok_json(self.service.post("/v1/rays", {"rays": rays, "sun": sun}))["rays"]
                position = np.array([h["position_m"] for h in hits])
                np.testing.assert_allclose(up * (RADIUS_M + map_["height"])[:, None], position, rtol=0, atol=0.01)
                np.testing.assert_allclose(np.stack([map_["normal." + axis] for axis in "xyz"], axis=-1),
                                           [h["normal"] for h in hits], rtol=0, atol=1e-6)
                lit = np.array([h["lit"] for h in hits])
                wrong = np.abs(map_["lit"] - lit) > (0.02 if disc else 0)
                self.assertLessEqual(wrong.sum(), 1)  # grazing
                seen |= {"dark" if x == 0 else "lit" if x == 1 else "between" for x in lit}
        self.assertEqual(seen, {"dark", "lit", "between"})

    def test_terrain_hides_ground_from_a_viewer(self):
        area = {**PLACES["orthographic"], "width_m": 60000, "height_m": 50000, "gsd_m": 500.0}
        lat, lon = area["center"]["lat_deg"], area["center"]["lon_deg"]
        up = vector(lat, lon)
        east = np.array([-math.sin(math.radians(lon)), math.cos(math.radians(lon)), 0.0])
        viewer = math.sin(math.radians(2)) * up + math.cos(math.radians(2)) * east
        request = map_request(area, "radiance", "lit", "height", sun={"direction": (up + east).tolist()},
                              view={"direction": viewer.tolist()}, accuracy={"max_error_px": 0})
        tiff = Tiff(self.map(request, "image/tiff"))
        # As the Sun's light doesn't come from there to what is hidden.
        from_there = Tiff(self.map(map_request(area, "lit", sun={"direction": viewer.tolist()}, accuracy={"max_error_px": 0}),
                                   "image/tiff"))
        hidden = np.isnan(tiff.bands["radiance"])
        self.assertTrue(np.isfinite(tiff.bands["height"]).all())
        self.assertTrue(np.isfinite(tiff.bands["lit"]).all())
        self.assertGreater(hidden.mean(), 0.05)
        self.assertLess(hidden.mean(), 0.9)
        differing = (hidden != (from_there.bands["lit"] == 0)).mean()  # but where the smooth normal faces away, the facet not
        self.assertLess(differing, 0.02)
        self.assertEqual((hidden & (from_there.bands["lit"] == 1)).sum(), 0)


class CommandLine(unittest.TestCase):
    def command(self, request, *options, dem="relief", **more):
        path = harness.path("request.json")
        with open(path, "w") as f:
            json.dump(request, f)
        return harness.run("ask", "maps", path, "--dem", harness.path(dem), "--cache-dir", harness.path("cache-" + dem),
                           "--log-level", "warning", *options, **more)

    def test_the_services_bytes(self):
        request = map_request(PLACES["orthographic"], "height", "source")
        service = Service(dem="relief", cache="cache-relief")
        for extension, media_type in ((".tif", "image/tiff"), (".npz", "application/x-npz")):
            output = harness.path("map" + extension)
            done = self.command(request, "-o", output)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("100%", done.stderr)
            with open(output, "rb") as f:
                self.assertEqual(f.read(), service.post("/v1/maps", request, media_type)[2])
        self.assertEqual(service.stop(), 0)

    def test_what_cannot_be_written(self):
        request = map_request(PLACES["orthographic"], "height")
        os.makedirs(harness.path("folder.tif"))
        limits = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))  # noqa: E731
        for output, reason, options in ((harness.path("nowhere", "x.tif"), "No such file or directory", {}),
                                        (harness.path("folder.tif"), "Is a directory", {}),
                                        (harness.path("small.tif"), "File too large", {"preexec_fn": limits})):
            done = self.command(request, "-o", output, **options)
            self.assertEqual(done.returncode, 1)
            self.assertIn(f"error: {output}: cannot be written: {reason}\n", done.stderr)
            self.assertNotIn("Internal", done.stderr)
            self.assertFalse([name for name in os.listdir(harness.path()) if ".part-" in name])

    def test_tiles(self):
        """Windows of the map: the same heights, where the whole map has them."""
        service = Service(dem="relief", cache="cache-relief")
        for name in ("equirectangular, date line", "south pole", "orthographic"):
            request = map_request(PLACES[name], "height", "source", accuracy={"max_error_px": 0})
            whole = Tiff(service.post("/v1/maps", request, "image/tiff")[2])
            folder = harness.path("tiles-" + name)
            done = self.command(request, "-o", folder, "--tile-px", "40")
            self.assertEqual(done.returncode, 0, done.stderr)
            joined = gdal.Open(os.path.join(folder, "map.vrt"))
            np.testing.assert_allclose(joined.GetGeoTransform(), whole.file.GetGeoTransform(), rtol=1e-12)
            for band, (product, expected) in enumerate(whole.bands.items(), 1):
                self.assertEqual(joined.GetRasterBand(band).GetDescription(), product)
                np.testing.assert_array_equal(joined.GetRasterBand(band).ReadAsArray(), expected, err_msg=f"{name} {product}")
        self.assertEqual(service.stop(), 0)

    def test_what_one_map_says(self):
        border = {"projection": "orthographic", "gsd_m": 1000.0, "center": {"lat_deg": 15.0, "lon_deg": 100.0},
                  "width_m": 60000.0, "height_m": 50000.0}
        request = map_request(border, "lit", "radiance", sun={"utc": "2025-03-14T06:50:00Z"})
        for options in ((), ("--tile-px", "30")):
            done = self.command(request, "-o", harness.path("border" + "".join(options) + ".tif"), *options, dem="region")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(done.stdout.count("the Earth covers the Sun"), 1)
            self.assertRegex(done.stdout, r"a share of [0-9.]+ of the pixels is without data")

    def test_refusals(self):
        request = map_request(PLACES["orthographic"], "height")
        beyond = {"x_px": 0, "y_px": 10**4, "width_px": 1, "height_px": 1}
        for change, options, why in (({}, ("-o", harness.path("a.jpg")), "must end in one of .npz, .tif, .tiff, .png for maps"),
                                     ({"map": {**request["map"], "window": beyond}}, ("-o", harness.path("a.tif")), "/map/window"),
                                     ({"map": {**request["map"], "window": beyond}}, ("-o", harness.path("a"), "--tile-px", "64"),
                                      "window"),
                                     ({"map": {**request["map"], "gsd_m": -1}}, ("-o", harness.path("a"), "--tile-px", "64"),
                                      "/map/gsd_m")):
            with self.subTest(why):
                done = self.command({**request, **change}, *options)
                self.assertEqual(done.returncode, 1)
                self.assertIn(why, done.stderr)
                self.assertFalse(os.path.exists(harness.path("a.tif")))
        rays = harness.write("rays.json", {"rays": [{"origin_m": [2e6, 0, 0], "direction": [-1, 0, 0]}]})
        done = harness.run("ask", "rays", rays, "-o", harness.path("a"), "--tile-px", "64", "--dem", harness.path("relief"),
                           "--cache-dir", harness.path("cache-relief"))
        self.assertEqual(done.returncode, 1)
        self.assertIn('--tile-px: the request has no "map"', done.stderr)


if __name__ == "__main__":
    harness.main()
