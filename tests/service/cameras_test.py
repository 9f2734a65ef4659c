#!/usr/bin/env python3
"""Several cameras at one instant: each has the bytes that it has alone, and refusals name the camera."""

import json


import harness
from harness import frame_request, sample, tearDownModule


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")


def without(request, *members):
    return {k: v for k, v in request.items() if k not in members}


class Cameras(harness.WithService):
    wide = frame_request(("radiance", "depth"), width=64, height=40)
    narrow = {"camera": {"width": 32, "height": 24, "fov_deg": 10.0}, "products": ["lit"],
              "pose": {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 20000.0},
                       "look_at": {"lat_deg": 0.3, "lon_deg": 30.2}}}

    def request(self, **changes):
        both = without(self.wide, "camera", "products")
        both["cameras"] = {"wide": {"camera": self.wide["camera"], "products": self.wide["products"]},
                           "narrow": self.narrow}
        return {**both, **changes}

    def arrays(self, request):
        f = self.service.arrays(request)
        return f, f["headers"]

    def test_each_camera_has_the_arrays_and_metadata_that_it_has_alone(self):
        together, headers = self.arrays(self.request())
        self.assertEqual({name for name in together if "/" in name}, {"narrow/lit", "wide/depth", "wide/radiance"})
        meta = together["meta"]
        self.assertEqual(f'"{meta["content_hash"]}"', headers["ETag"])
        for name, request in (("wide", self.wide), ("narrow", {**self.wide, **self.narrow})):
            alone, _ = self.arrays(request)
            for product in request["products"]:
                self.assertEqual(together[f"{name}/{product}"].tobytes(), alone[product].tobytes())
            self.assertEqual(meta["cameras"][name], alone["meta"])

    def test_same_request_same_bytes_and_304(self):
        first = self.service.frame(self.request(), "application/x-npz")
        second = self.service.frame(self.request(echo={"t": 1}), "*/*")
        self.assertEqual(first[2], second[2])
        self.assertEqual(json.loads(second[1]["Selenograph-Echo"]), {"t": 1})
        known = self.service.frame(self.request(echo={"t": 1}), "application/x-npz", **{"If-None-Match": first[1]["ETag"]})
        self.assertEqual((known[0], json.loads(known[1]["Selenograph-Echo"])), (304, {"t": 1}))
        moved = self.request()
        moved["cameras"]["narrow"] = {**self.narrow, "products": ["lit", "range"]}
        self.assertEqual(self.service.frame(moved, "*/*", **{"If-None-Match": first[1]["ETag"]})[0], 200)

    def test_refusals_name_the_camera(self):
        def pointer(at, changes=None, **camera):
            request = self.request(**(changes or {}))
            request["cameras"]["narrow"] = {**self.narrow, **camera}
            self.problem(self.service.frame(request), 422, at)

        pointer("/cameras/narrow/camera/fov_deg", camera={"width": 32, "height": 24, "fov_deg": 190.0})
        pointer("/cameras/narrow/produces", produces=["lit"])
        pointer("/cameras/narrow/echo", echo={})
        pointer("/sun/local/azimuth_deg", {"sun": {"local": {"lat_deg": 0, "lon_deg": 30, "azimuth_deg": 900,
                                                             "elevation_deg": 15}}})
        underground = {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": -9000.0}, "nadir": {}}
        pointer("/cameras/narrow/pose", pose=underground)
        for wrong in ({}, [], {"a b": self.narrow}, {"x/y": self.narrow}, {str(i): self.narrow for i in range(17)}):
            self.problem(self.service.frame(self.request(cameras=wrong)), 422, "/cameras")
        self.problem(self.service.frame(self.request(cameras={"a": 1})), 422, "/cameras/a")
        nested = self.request()
        nested["cameras"]["wide"]["cameras"] = {"b": {}}
        self.problem(self.service.frame(nested), 422, "/cameras/wide/cameras")
        self.problem(self.service.frame(self.request(), "image/png"), 406)


if __name__ == "__main__":
    harness.main()
