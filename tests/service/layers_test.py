#!/usr/bin/env python3
"""Layers of different resolution under the real service: the coarser one bent over a band, offsets, caches, and files that are no DEM."""

import json
import os
import shutil
import struct
import unittest

from osgeo import gdal, osr

import harness
from harness import frame_request, path, run, Service, tearDownModule

BIAS_M = 40
SITE = "DTM_MAP_01_N01E030N00E031SC"


def setUpModule():
    harness.set_up()
    # A landing site's tile of 512 posts a degree, 40 m too high, over nine tiles of 64.
    coarse = harness.sample("coarse", "--south-deg", "-1", "--west-deg", "29", "--rows", "3", "--columns", "3", "--ppd", "64")
    site = harness.sample("site", "--south-deg", "0", "--west-deg", "30", "--rows", "1", "--columns", "1", "--ppd", "512")
    image = os.path.join(site, SITE + ".img")
    with open(image, "rb") as f:
        posts = f.read()
    heights = struct.unpack(f">{len(posts) // 2}h", posts)
    with open(image, "wb") as f:
        f.write(struct.pack(f">{len(heights)}h", *(h + BIAS_M for h in heights)))
    both = path("dem")
    shutil.copytree(coarse, os.path.join(both, "coarse"))
    os.makedirs(os.path.join(both, "site"))
    for end in (".img", ".lbl"):
        shutil.copy(os.path.join(site, SITE + end), os.path.join(both, "site", "site" + end))
    label = os.path.join(both, "site", "site.lbl")
    with open(label, newline="") as f:
        text = f.read()
    with open(label, "w", newline="") as f:
        f.write(text.replace(SITE, "site"))


def write_image(name):
    """A grey image of the whole Moon as a GeoTIFF of bytes."""
    image = gdal.GetDriverByName("GTiff").Create(name, 8, 4, 1, gdal.GDT_Byte)
    image.SetGeoTransform((-180, 45, 0, 90, 0, -45))
    image.SetProjection(osr.SpatialReference('GEOGCS["Moon",DATUM["Moon",SPHEROID["Moon",1737400,0]],PRIMEM["Greenwich",0],'
                                             'UNIT["degree",0.0174532925199433]]').ExportToWkt())
    image.GetRasterBand(1).WriteRaster(0, 0, 8, 4, bytes(range(32)))


def along(service):
    """Heights from outside of the site's western border to its middle."""
    points = [{"lat_deg": 0.5, "lon_deg": 29.95 + k / 1000} for k in range(500)]
    status, _, body = service.post("/v1/heights", {"points": points})
    assert status == 200, body
    return json.loads(body)["points"]


class Blending(unittest.TestCase):
    def test_frames_report_bending(self):
        with_band, without = Service(cache="cache-band"), Service("--blend-posts", "0", cache="cache-none")
        frame = frame_request(products=("source", "geodetic"))
        frame["pose"]["geodetic"] = {"lat_deg": 0.5, "lon_deg": 29.95, "height_m": 20000.0}
        metas, tags = [], []
        for service in (with_band, without):
            _, headers, body = service.frame(frame, "application/x-npz")
            metas.append(harness.meta_of(body))
            tags.append(headers["ETag"])
        self.assertNotEqual(tags[0], tags[1])
        self.assertGreater(metas[0]["blended_fraction"], 0.3)
        self.assertEqual(metas[1]["blended_fraction"], 0)

    def test_an_old_cache_is_noticed_and_replaced(self):
        for attempt, options in enumerate((("--blend-posts", "0"), (), ("--layer-offset", "site=-40"), ())):
            used = Service(*options, cache="cache-shared")
            fresh = Service(*options, cache=f"cache-fresh-{attempt}")
            self.assertEqual(along(used), along(fresh), options)
            log = used.log_text()
            used.stop(), fresh.stop()
            if attempt > 0:
                self.assertIn("pyramid was made from other sources; it is made again", log)

    def test_an_offset_is_fitted_and_reported(self):
        service = Service("--layer-offset", "site=fit", cache="cache-fit")
        datasets = json.loads(service.ask("GET", "/v1/datasets")[2])
        offset = {d["name"]: d["offset_m"] for d in datasets["datasets"]}
        self.assertAlmostEqual(offset["site"], -BIAS_M, delta=8)  # the layers' own relief differs along the border
        self.assertEqual(set(offset.values()), {0, offset["site"]})
        self.assertEqual(datasets["blend_posts"], 16)
        self.assertIn("the median of", service.log_text())
        service.stop()

    def test_info_reports_the_steps(self):
        done = run("info", "--json", "--dem", path("dem"), "--cache-dir", path("cache-info"))
        self.assertEqual(done.returncode, 0, done.stderr)
        (border,) = json.loads(done.stdout)["borders"]
        self.assertEqual(border["names"], ["site"])
        self.assertGreater(border["posts"], 100)
        self.assertAlmostEqual(border["step_in_files"]["mean_m"], BIAS_M, delta=8)
        self.assertGreater(border["step_in_files"]["rms_m"], border["step_in_files"]["mean_m"])
        self.assertEqual(border["bent_by"], border["step_in_files"])
        text = run("info", "--dem", path("dem"), "--cache-dir", path("cache-info")).stdout
        self.assertIn("border of site over", text)
        self.assertIn("step in the files: mean", text)


class NoDem(unittest.TestCase):
    def setUp(self):
        self.folder = path("with-image")
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(path("dem", "site"), self.folder)
        self.image = os.path.join(self.folder, "ortho.tif")
        write_image(self.image)

    def test_an_orthoimage_in_a_folder_is_a_warning(self):
        service = Service(cache="cache-image", dem="with-image")
        log = service.log_text()
        self.assertEqual(log.count("ortho.tif"), 1, log)
        self.assertEqual(service.ask("GET", "/v1/height?lat_deg=0.5&lon_deg=30.5")[0], 200)
        (problem,) = json.loads(service.ask("GET", "/v1/datasets")[2])["problems"]
        self.assertEqual(problem["path"], self.image)
        self.assertIn("not heights", problem["what"])
        self.assertIn("ortho.tif", run("info", "--dem", self.folder, "--cache-dir", path("cache-image")).stdout)

    def test_strict_makes_it_an_error(self):
        for command in ("info", "ingest"):
            done = run(command, "--strict", "--dem", self.folder, "--cache-dir", path("cache-image"))
            self.assertEqual(done.returncode, 1, done.stdout)
            self.assertIn("ortho.tif", done.stderr)

    def test_side_layers_are_reported_and_no_heights(self):
        for end in ("_effres", "_err"):
            shutil.copy(self.image, os.path.join(self.folder, f"site{end}.tif"))
        os.remove(self.image)
        done = run("info", "--json", "--dem", self.folder, "--cache-dir", path("cache-side"))
        found = json.loads(done.stdout)
        self.assertEqual(sorted((os.path.basename(s["path"]), s["kind"]) for s in found["side_layers"]),
                         [("site_effres.tif", "effective resolution"), ("site_err.tif", "error of heights")])
        self.assertEqual([d["name"] for d in found["datasets"]], ["site"])
        self.assertEqual(found["problems"], [])
        self.assertEqual(run("info", "--strict", "--dem", self.folder, "--cache-dir", path("cache-side")).returncode, 0)
        named = run("info", "--dem", os.path.join(self.folder, "site_err.tif"), "--cache-dir", path("cache-side"))
        self.assertEqual(named.returncode, 1)
        self.assertIn("side layer", named.stderr)
        self.assertIn("describe its band", named.stderr)
        log = Service(cache="cache-side", dem="with-image").log_text()
        self.assertIn("site_err.tif: side layer (error of heights)", log)


if __name__ == "__main__":
    harness.main()
