#!/usr/bin/env python3
"""Fewer pixels of the products that describe what is seen, and positions as float32: slices of the whole frame's."""


import numpy as np

import harness
from harness import frame_request, sample, tearDownModule

TRUTH = ("depth", "range", "position", "geodetic", "normal", "angles", "lit", "gsd", "source", "object_id", "detail")
WIDTH, HEIGHT = 70, 45


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")


class TruthGrid(harness.WithService):
    region = {"x": 5, "y": 3, "width": 41, "height": 20}

    def arrays(self, **changes):
        request = frame_request(("radiance",) + TRUTH, width=WIDTH, height=HEIGHT, **changes)
        f = self.service.arrays(request)
        return f, f["headers"]

    def compare(self, truth, rows, columns, **changes):
        whole, _ = self.arrays(**changes)
        some, headers = self.arrays(truth=truth, **changes)
        for product in TRUTH:
            self.assertEqual(some[product].tobytes(), np.ascontiguousarray(whole[product][rows, columns]).tobytes(),
                             product)
        self.assertEqual(some["radiance"].tobytes(), whole["radiance"].tobytes())
        meta, of_whole = some["meta"], whole["meta"]
        self.assertEqual(meta["sources"], of_whole["sources"])
        self.assertEqual(meta["view"], of_whole["view"])
        self.assertNotEqual(meta["content_hash"], of_whole["content_hash"])
        self.assertTrue((whole["lit"][rows, columns] > 0).any())
        return headers

    def test_both_algorithms_samples_and_a_disc(self):
        rows, columns = slice(3, 23, 4), slice(5, 46, 4)
        truth = {"region": self.region, "every_px": 4}
        for visibility in ("zbuffer", "raytrace"):
            for samples in (1, 4):
                self.compare(truth, rows, columns, visibility=visibility, samples=samples)
        disc = {"local": {"lat_deg": 0.1, "lon_deg": 30.1, "azimuth_deg": 90.0, "elevation_deg": 15.0},
                "angular_radius_deg": 2.0}
        self.compare(truth, rows, columns, visibility="zbuffer", sun=disc)
        self.compare({"every_px": 7}, slice(0, None, 7), slice(0, None, 7))
        self.compare({"region": self.region}, slice(3, 23), slice(5, 46))
        self.compare({"region": {"x": 69, "y": 44, "width": 1, "height": 1}, "every_px": 9}, slice(44, 45),
                     slice(69, 70))

    def test_distances_of_fewer_bits(self):
        whole, _ = self.arrays()
        for kind, dtype in (("float32", np.float32), ("float16", np.float16)):
            some, _ = self.arrays(truth={"distance_type": kind, "every_px": 3})
            for product in ("depth", "range"):
                self.assertEqual(some[product].dtype, dtype)
                with np.errstate(over="ignore"):
                    np.testing.assert_array_equal(some[product], whole[product][::3, ::3].astype(dtype))
            self.assertEqual(some["position"].dtype, np.float64)
        self.assertNotEqual(some["meta"]["content_hash"], whole["meta"]["content_hash"])
        request = frame_request(("depth",), truth={"distance_type": "float16"})
        for accept in ("application/x-npy", "image/x-exr", "image/tiff", "application/octet-stream"):
            self.assertEqual(self.service.frame(request, accept)[0], 200, accept)

    def test_a_sensor_renders_a_margin_that_the_arrays_know_nothing_of(self):
        sensor = {"band": {"center_um": 0.55, "width_um": 0.1}, "sensor": {
            "optics": {"f_number": 4.0, "point_spread": {"model": "gaussian", "sigma_px": 1.5},
                       "vignetting": {"model": "none"}},
            "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.004,
                         "gain_e_dn": 2.0, "offset_dn": 60.0, "bit_depth": 16}}}
        request = frame_request(("image", "depth", "position"), width=WIDTH, height=HEIGHT, **sensor)
        thinned = {**request, "truth": {"region": self.region, "every_px": 3}}
        whole, some = map(self.service.arrays, (request, thinned))
        self.assertEqual(some["image"].tobytes(), whole["image"].tobytes())
        for product in ("depth", "position"):
            self.assertTrue(np.array_equal(some[product], whole[product][3:23:3, 5:46:3]), product)

    def test_positions_relative_to_an_origin(self):
        whole, _ = self.arrays()
        middle = whole["position"][HEIGHT // 2, WIDTH // 2].round()
        near, _ = self.arrays(truth={"position_origin_m": middle.tolist()})
        self.assertEqual(near["position"].dtype, np.float32)
        expected = (whole["position"] - middle).astype(np.float32)
        self.assertEqual(near["position"].tobytes(), expected.tobytes())
        self.assertEqual(near["geodetic"].tobytes(), whole["geodetic"].tobytes())
        body = self.service.frame(frame_request(("position",), truth={"position_origin_m": middle.tolist()}),
                                  "application/octet-stream")
        self.assertEqual(body[1]["Selenograph-Dtype"], "<f4")

    def test_one_product_alone_and_formats(self):
        request = frame_request(("depth",), width=WIDTH, height=HEIGHT, truth={"region": self.region, "every_px": 2})
        self.assertEqual(self.service.frame(request, "application/octet-stream")[1]["Selenograph-Shape"], "10,21")
        self.assertEqual(self.service.frame(request, "image/x-exr")[0], 200)
        request["products"] = ["depth", "radiance"]
        self.problem(self.service.frame(request, "image/x-exr"), 422, "/truth")
        self.assertEqual(self.service.frame({**request, "truth": {}}, "image/x-exr")[0], 200)

    def test_no_part_of_frames_that_have_no_such_product(self):
        request = frame_request(("radiance",))
        with_truth = {**request, "truth": {"every_px": 2}}
        plain, other = self.service.frame(request), self.service.frame(with_truth)
        self.assertEqual((plain[1]["ETag"], plain[2]), (other[1]["ETag"], other[2]))

    def test_refusals(self):
        def refused(truth, pointer):
            self.problem(self.service.frame(frame_request(("depth",), width=WIDTH, height=HEIGHT, truth=truth)), 422,
                         pointer)

        refused({"region": {**self.region, "width": 66}}, "/truth/region/width")
        refused({"region": {**self.region, "height": 43}}, "/truth/region/height")
        refused({"region": {**self.region, "x": -1}}, "/truth/region/x")
        refused({"region": {"x": 0}}, "/truth/region/y")
        refused({"every_px": 0}, "/truth/every_px")
        refused({"every": 2}, "/truth/every")
        refused({"position_origin_m": [0, 0]}, "/truth/position_origin_m")


if __name__ == "__main__":
    harness.main()
