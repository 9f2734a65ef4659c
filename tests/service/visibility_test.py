#!/usr/bin/env python3
"""Two ways to see, by request: the same frames, and the metadata says which it was."""

import json

import numpy as np

import harness
from harness import WithService, frame_request


def setUpModule():
    harness.set_up()
    harness.sample("dem", *harness.PLACE, "--ppd", "256")


def tearDownModule():
    harness.tear_down()


class Visibility(WithService):
    def frame(self, **members):
        low = {"local": {"lat_deg": 0.1, "lon_deg": 30.1, "azimuth_deg": 90.0, "elevation_deg": 4.0}}
        request = frame_request(["radiance", "depth", "position", "lit", "source"], 200, 150, sun=low, **members)
        f = self.service.arrays(request)
        return f, f["meta"], f["headers"]["ETag"]

    def test_the_same_frame(self):
        rays, rays_meta, rays_etag = self.frame(visibility="raytrace")
        drawn, drawn_meta, drawn_etag = self.frame(visibility="zbuffer")
        self.assertEqual((rays_meta["visibility"], drawn_meta["visibility"]), ("raytrace", "zbuffer"))
        self.assertEqual((rays_meta["request"]["visibility"], drawn_meta["request"]["visibility"]), ("raytrace", "zbuffer"))
        self.assertNotEqual(rays_etag, drawn_etag)
        for key in ("lod_error_px", "shadow_error_px", "triangles", "hit_fraction", "sources"):
            self.assertEqual(rays_meta[key], drawn_meta[key], key)
        self.assertGreater(np.mean(rays["lit"] == 0), 0.02, "there are shadows")
        self.assertGreater(np.mean(rays["lit"] == 1), 0.02, "and light")
        pixels = rays["depth"].size
        self.assertLess(np.sum(np.abs(rays["depth"] - drawn["depth"]) > 0.01), 0.001 * pixels)
        self.assertLess(np.sum(rays["lit"] != drawn["lit"]), 0.001 * pixels)
        self.assertLess(np.sum(rays["radiance"] != drawn["radiance"]), 0.001 * pixels)

    def test_the_same_bytes_again(self):
        request = frame_request(["radiance", "lit"], visibility="zbuffer")
        first = self.service.frame(request, "application/x-npz")[2]
        for _ in range(3):
            self.assertEqual(self.service.frame(request, "application/x-npz")[2], first)

    def test_auto_reports_its_choice(self):
        _, meta, _ = self.frame()
        self.assertEqual(meta["request"]["visibility"], "auto")
        self.assertEqual(meta["visibility"], "zbuffer")

    def test_auto_sees_a_tiny_image_of_much_terrain_by_rays(self):
        request = frame_request(["radiance"], 8, 8, accuracy={"max_error_px": 0.001})
        _, headers, _ = self.service.frame(request, "application/octet-stream")
        self.assertEqual(json.loads(headers["Selenograph-Meta"])["visibility"], "raytrace")

    def test_other_names_are_refused(self):
        self.problem(self.service.frame(frame_request(["radiance"], visibility="quick")), 422, "/visibility")


if __name__ == "__main__":
    harness.main()
