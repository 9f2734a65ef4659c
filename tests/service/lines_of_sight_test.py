#!/usr/bin/env python3
"""A camera by a table of lines of sight shows what the camera shows from which the table is taken."""

import json
import os
import struct
import unittest

import numpy as np
from osgeo import gdal

import harness
from harness import frame_request, tearDownModule

WIDTH, HEIGHT, STEP = 129, 97, 8
LENS = {"model": "pinhole", "width": WIDTH, "height": HEIGHT, "fx": 130.0, "fy": 131.0, "cx": 60.0, "cy": 50.0,
        "distortion": {"model": "brown_conrady", "k1": -0.21, "k2": 0.06, "p1": 0.003}}
TABLE = {"width": WIDTH, "height": HEIGHT, "lines_of_sight": "calibrated"}


def setUpModule():
    harness.set_up()
    LinesOfSightTest.service = harness.service_with_assets()


def write_table(name, directions):
    """Three float64 samples a pixel."""
    folder = os.path.join(harness.path("assets"), "lines_of_sight")
    os.makedirs(folder, exist_ok=True)
    rows, columns = directions.shape[:2]
    path = os.path.join(folder, name + ".tif")
    file = gdal.GetDriverByName("GTiff").Create(path, columns, rows, 3, gdal.GDT_Float64)
    for band in range(3):
        file.GetRasterBand(band + 1).WriteArray(directions[..., band])
    file.FlushCache()


def tiff_of_wide_tiles(tile_width, samples, stored_bytes=5000):
    """A TIFF of 4 x 4 pixels whose one tile is 16 rows of `tile_width` pixels of 32-bit floats, nearly all of them missing."""
    tags = {256: (4,), 257: (4,), 258: (32,) * samples, 259: (1,), 262: (1,), 277: (samples,), 322: (tile_width,), 323: (16,),
            324: (400,), 325: (stored_bytes,), 339: (3,) * samples}
    entries, lists = b"", b""
    for tag, values in sorted(tags.items()):
        content = struct.pack(f"<{len(values)}I", *values)
        if len(values) > 1:
            entries += struct.pack("<HHII", tag, 4, len(values), 10 + 12 * len(tags) + 4 + len(lists))
            lists += content
        else:
            entries += struct.pack("<HHI", tag, 4, 1) + content
    return (b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4) + lists).ljust(400, b"\0") + bytes(stored_bytes)


def lens_directions():
    """By fixed-point iteration of Brown's equations."""
    u, v = np.meshgrid(np.arange(0, WIDTH, STEP, dtype=float), np.arange(0, HEIGHT, STEP, dtype=float))
    xd, yd = (u - LENS["cx"]) / LENS["fx"], (v - LENS["cy"]) / LENS["fy"]
    k1, k2, p1 = (LENS["distortion"][k] for k in ("k1", "k2", "p1"))
    x, y = xd, yd
    for _ in range(200):
        r2 = x * x + y * y
        f = 1 + k1 * r2 + k2 * r2 * r2
        x, y = (xd - 2 * p1 * x * y) / f, (yd - p1 * (r2 + 2 * y * y)) / f
    return np.stack([x, y, np.ones_like(x)], -1)


class LinesOfSightTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        write_table("calibrated", lens_directions())

    def test_frames_are_the_lens_s(self):
        for visibility in ("raytrace", "zbuffer"):
            lens, table = (self.service.arrays(frame_request(("position", "gsd"), camera=camera, visibility=visibility))
                           for camera in (LENS, TABLE))
            apart_px = np.linalg.norm(lens["position"] - table["position"], axis=-1) / lens["gsd"]
            self.assertLess(np.nanmax(apart_px), 0.1)
            self.assertLess(np.nanmedian(apart_px), 0.002)
            self.assertEqual(table["meta"]["request"]["camera"]["lines_of_sight"], "calibrated")

    def test_refusals_name_the_member_or_the_file(self):
        mirrored = lens_directions() * [-1, 1, 1]
        write_table("mirrored", mirrored)
        for camera, said in ((TABLE | {"lines_of_sight": "none"}, "calibrated"),
                             (TABLE | {"lines_of_sight": "mirrored"}, "mirrored.tif"),
                             (TABLE | {"fov_deg": 40}, "lines_of_sight"), (TABLE | {"width": 1}, "/camera/width"),
                             (TABLE | {"model": "fisheye"}, "/camera/lines_of_sight")):
            status, _, body = self.service.frame(frame_request(camera=camera))
            self.assertGreaterEqual(status, 400, body[:200])
            self.assertIn(said, body.decode())

    @harness.of_memory
    def test_an_image_of_few_bytes_and_vast_tiles_takes_little_memory(self):
        """As a table of lines of sight, a map and a DEM: 5 KB whose tiles would take 5 GB."""
        folder = harness.path("assets")
        harness.write(os.path.join("assets", "lines_of_sight", "vast.tif"), tiff_of_wide_tiles(28_000_000, 3))
        harness.write(os.path.join("assets", "maps", "vast.tif"), tiff_of_wide_tiles(84_000_000, 1))
        harness.write(os.path.join("assets", "maps", "vast.json"), {
            "file": "vast.tif", "extent": {"south_deg": -90, "north_deg": 90, "west_deg": -180, "east_deg": 180}})
        self.assertLess(os.path.getsize(os.path.join(folder, "lines_of_sight", "vast.tif")), 6000)
        before_mb = self.service.resident_mb("VmHWM")
        for request in (frame_request(camera=TABLE | {"lines_of_sight": "vast"}),
                        frame_request(surface={"reflectance": {"model": "lambert"}, "albedo_maps": ["vast"]})):
            status, _, body = self.service.frame(request)
            self.assertEqual(status, 500, body[:300])
            self.assertIn(b"asset_error", body)
            self.assertIn(b"vast.tif: ", body)
        self.assertLess(self.service.resident_mb("VmHWM"), before_mb + 100)
        self.assertIn("vast.tif", harness.run("info", "--dem", os.path.join(folder, "maps", "vast.tif")).stderr)


if __name__ == "__main__":
    harness.main()
