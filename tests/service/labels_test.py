#!/usr/bin/env python3
"""Labels of frames: masks and their numbers in the metadata, and the COCO documents that the Python client makes of them, also
of a campaign's folder."""

import io
import json
import math
import os
import sys
import zipfile

import numpy as np

import harness
from harness import frame_request, sample, tearDownModule

CLIENT = os.path.join(harness.REPOSITORY, "api", "clients", "python")
sys.path.insert(0, CLIENT)
from selenograph import Answer, Frame, coco_of  # noqa: E402

LAT, LON = 0.1, 30.1
METRES_PER_DEGREE = 1737400.0 * math.pi / 180
PRESETS = {
    "rocky": {"seed": 9, "craters": {"smallest_m": 1, "largest_m": 100}, "rocks": {
        "smallest_m": 0.25, "largest_m": 6, "frequency": [{"per_m2": 0.004, "exponent": 2.6607}]}},
    "bare": {"seed": 9, "craters": {"smallest_m": 1, "largest_m": 100}},
    # On ground without relief.
    "large": {"seed": 5, "craters": {"smallest_m": 16, "largest_m": 256},
              "relief": {"hurst": 0.9, "deviation_m": 1e-9, "baseline_m": 10, "shortest_m": 8, "longest_m": 16}},
}
MASKS = ("crater_mask", "rock_mask")
CRATER, ROCK = 1, 2
DEM = ""


def setUpModule():
    global DEM
    harness.set_up()
    DEM = sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    os.makedirs(harness.path("assets", "details"))
    for name, preset in PRESETS.items():
        harness.write(os.path.join("assets", "details", name + ".json"), preset)


def members(body):
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        return {info.filename: archive.read(info) for info in archive.infolist()}


def array(content):
    return np.load(io.BytesIO(content))


def as_frame(body):
    return Frame(Answer(body, "application/x-npz", {}, None, None, None))


def polygon_mask(flat, width, height):
    """Pixels whose centres are within: a ray to the left crosses the border an odd number of times."""
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    points = np.reshape(flat, (-1, 2))
    inside = np.zeros((height, width), bool)
    for (ax, ay), (bx, by) in zip(points, np.roll(points, -1, axis=0)):
        if ay != by:
            inside ^= ((ay > y) != (by > y)) & (x >= ax + (y - ay) / (by - ay) * (bx - ax))
    return inside


def rock_mask(annotation):
    counts, size = annotation["segmentation"]["counts"], annotation["segmentation"]["size"]
    return np.concatenate([np.full(n, i % 2 == 1) for i, n in enumerate(counts)]).reshape(size[::-1]).T


class Labels(harness.WithService):
    @classmethod
    def setUpClass(cls):
        cls.options = ("--assets-dir", harness.path("assets"))
        super().setUpClass()
        body = cls.service.post("/v1/heights", {"points": [{"lat_deg": LAT, "lon_deg": LON}], "detail": "rocky"})[2]
        cls.ground_m = json.loads(body)["points"][0]["height_m"]

    def request(self, height_m=60.0, east_m=0.0, **changes):
        pose = {"geodetic": {"lat_deg": LAT, "lon_deg": LON + east_m / 30323, "height_m": self.ground_m + height_m},
                "nadir": {"up_azimuth_deg": 30.0}}
        request = frame_request(width=160, height=120, products=["image", "detail"])
        request.update({"pose": pose, "detail": "rocky", "camera": {"width": 160, "height": 120, "fov_deg": 45.0},
                        "labels": True, "craters": {"smallest_px": 3}, **changes})
        return {name: value for name, value in request.items() if value is not None}

    def frame(self, request, media_type="*/*"):
        return members(self.body(request, media_type))

    def body(self, request, media_type="*/*"):
        return self.ok(self.service.frame(request, media_type), "application/x-npz")

    def check(self, request, camera=""):
        """The annotations against the masks, the metadata and the format."""
        frame = as_frame(self.body(request))
        coco = coco_of(frame, camera=camera)
        self.assertEqual(set(coco), {"info", "licenses", "images", "categories", "annotations"})
        prefix, meta = (f"{camera}/", frame.meta["cameras"][camera]) if camera else ("", frame.meta)
        masks = {name: frame[prefix + name] for name in MASKS}
        height, width = masks["rock_mask"].shape
        self.assertEqual(coco["images"], [{"id": 1, "width": width, "height": height, "file_name": "frame.npz"}])
        self.assertEqual(coco["info"]["request"], meta["request"])
        expected = {name: np.zeros((height, width), np.uint16) for name in MASKS}
        for annotation in coco["annotations"]:
            self.assertEqual((annotation["image_id"], annotation["iscrowd"]), (1, 0))
            if annotation["category_id"] == ROCK:
                mask = rock_mask(annotation)
                y, x = np.nonzero(mask)
                self.assertEqual(annotation["bbox"], [x.min(), y.min(), x.max() + 1 - x.min(), y.max() + 1 - y.min()])
                self.assertEqual(annotation["area"], mask.sum())
                expected["rock_mask"][mask] = annotation["id"]
            else:
                (flat,) = annotation["segmentation"]
                expected["crater_mask"][polygon_mask(flat, width, height)] = annotation["id"]
                x, y = np.reshape(flat, (-1, 2)).T
                self.assertTrue(0 <= min(x) and max(x) <= width and 0 <= min(y) and max(y) <= height)
                np.testing.assert_allclose(annotation["bbox"], [x.min(), y.min(), np.ptp(x), np.ptp(y)], rtol=0, atol=2e-3)
                area = abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
                self.assertTrue(area > 0 and abs(annotation["area"] - area) < 1e-2)
        self.assertEqual({mask.dtype for mask in masks.values()}, {np.dtype(np.uint16)})
        np.testing.assert_array_equal(masks["rock_mask"], expected["rock_mask"])
        # Rims in the metadata are rounded to 0.001 px: where they are clipped, a pixel may fall on the other side.
        self.assertLess(np.count_nonzero(masks["crater_mask"] != expected["crater_mask"]), 3)
        # One annotation for each label, with its crater or rock.
        self.assertEqual([a["id"] for a in coco["annotations"]], list(range(1, len(coco["annotations"]) + 1)))
        listed = {c["mask_id"]: c["id"] for c in meta["craters"] + meta["labelled_rocks"] if c["mask_id"]}
        self.assertEqual({a["id"]: a.get("crater_id", a.get("rock_id")) for a in coco["annotations"]}, listed)
        return coco, masks, frame

    def test_masks_are_the_annotations(self):
        coco, masks, frame = self.check(self.request())
        counts = [sum(a["category_id"] == k for a in coco["annotations"]) for k in (CRATER, ROCK)]
        self.assertGreater(min(counts), 10, counts)
        # Rocks of fewer pixels than the least are rocks without a label.
        seen = frame["detail"] == 3
        self.assertTrue((masks["rock_mask"] > 0)[~seen].sum() == 0 and 0.3 * seen.sum() < (masks["rock_mask"] > 0).sum())
        # Craters are those of the list without labels, which has no numbers.
        plain = as_frame(self.body(self.request(labels=None), "application/x-npz"))
        self.assertNotIn("labelled_rocks", plain.meta)
        self.assertEqual([{k: v for k, v in c.items() if k != "mask_id"} for c in frame.meta["craters"]], plain.meta["craters"])
        self.assertEqual(frame.meta["craters_cut_off"], plain.meta["craters_cut_off"])

    def test_small_rocks_are_all_that_is_seen(self):
        coco, masks, frame = self.check(self.request(craters={"smallest_px": 1}))
        np.testing.assert_array_equal(masks["rock_mask"] > 0, frame["detail"] == 3)
        rocks = [a for a in coco["annotations"] if a["category_id"] == ROCK]
        half_deg = 90 / METRES_PER_DEGREE
        region = {"south_deg": LAT - half_deg, "north_deg": LAT + half_deg, "west_deg": LON - half_deg, "east_deg": LON + half_deg}
        answer = self.service.post("/v1/features", {"detail": "rocky", "region": region, "kind": "rocks"})[2]
        listed = {rock["id"]: rock for rock in json.loads(answer)["rocks"]}
        for a in rocks:
            for name in ("lat_deg", "lon_deg", "height_m", "diameter_m", "age_Ma"):
                self.assertAlmostEqual(a[name], listed[a["rock_id"]][name], delta=1e-9 * max(1, abs(a[name])))
        larger = [a for a in self.check(self.request(craters={"smallest_px": 4}))[0]["annotations"] if a["category_id"] == ROCK]
        self.assertEqual([a["rock_id"] for a in larger], [a["rock_id"] for a in rocks if 4 * a["area"] >= math.pi * 4**2])

    def test_none(self):
        coco, masks, _ = self.check(self.request(detail="bare", craters={"smallest_px": 5000}))
        self.assertEqual(coco["annotations"], [])
        self.assertEqual([mask.max() for mask in masks.values()], [0, 0])

    def test_boxes_hold_the_ground_within_the_rim(self):
        """The pixels whose ground lies within the listed diameter fill the box, above and at a slant."""
        height_m = self.ground_m + 4000
        above = {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": height_m}, "nadir": {"up_azimuth_deg": 30.0}}
        slant = {"geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": height_m - 2500},
                 "look_at": {"lat_deg": LAT + 0.08, "lon_deg": LON + 0.03, "up": "zenith"}}
        camera = {"width": 320, "height": 240, "fov_deg": 40.0,
                  "distortion": {"model": "brown_conrady", "k1": -0.1, "k2": 0.02, "p1": 0.001}}
        fisheye = {"model": "fisheye", "width": 128, "height": 128, "fov_deg": 120.0}
        low = {**above, "geodetic": {**above["geodetic"], "height_m": height_m - 3200}}
        rolling = {"shutter": {"line_time_s": 0.001, "velocity_m_s": [0, 0, 1500]}}
        for pose, lens, more in ((above, camera, {}), (slant, camera, {}), (low, fisheye, {}), (above, camera, rolling)):
            coco, _, frame = self.check(self.request(pose=pose, camera=lens, detail="large", products=["geodetic"],
                                                     craters={"smallest_px": 5}, **more))
            lat, lon = np.moveaxis(frame["geodetic"][..., :2], -1, 0)
            checked = 0
            for a in coco["annotations"]:
                left, top, width, height = a["bbox"]
                whole = left > 0 and top > 0 and left + width < lens["width"] and top + height < lens["height"]
                if not whole or a["rim_visible"] < 1:
                    continue
                away_deg = np.hypot(lat - a["lat_deg"], (lon - a["lon_deg"]) * math.cos(math.radians(a["lat_deg"])))
                y, x = np.nonzero(away_deg * METRES_PER_DEGREE <= a["diameter_m"] / 2)
                seen = [x.min(), y.min(), x.max() + 1, y.max() + 1]
                self.assertLess(np.abs(np.subtract(seen, [left, top, left + width, top + height])).max(), 1.5, a)
                self.assertLess(abs(a["area"] - len(x)), 0.5 * (width + height) + 2, a)
                checked += 1
            self.assertGreater(checked, 5)

    def test_they_change_no_product_and_are_of_all_pixels(self):
        plain = self.frame(self.request(labels=None, craters=None), "application/x-npz")
        labelled = self.frame(self.request())
        for name in ("image.npy", "detail.npy"):
            self.assertEqual(labelled[name], plain[name])
        thinned = self.frame(self.request(truth={"every_px": 4}))
        self.assertEqual(array(thinned["detail.npy"]).shape, (30, 40))
        for name in ("image.npy", "crater_mask.npy", "rock_mask.npy"):
            self.assertEqual(thinned[name], labelled[name])
        sensor = {"optics": {"f_number": 5.6, "point_spread": {"model": "gaussian", "sigma_px": 1.5}},
                  "detector": {"pixel_pitch_um": 5.5, "integration_time_s": 0.002, "quantum_efficiency": 0.4, "gain_e_dn": 3.4}}
        self.check(self.request(sensor=sensor, band={"center_um": 0.6, "width_um": 0.1}))
        coco, masks, _ = self.check(self.request(detail="bare"))
        self.assertEqual(masks["rock_mask"].max(), 0)
        self.assertGreater(len(coco["annotations"]), 10)

    def test_other_cameras(self):
        self.check(self.request(camera={"model": "fisheye", "width": 96, "height": 96, "fov_deg": 120.0}))
        self.check(self.request(shutter={"line_time_s": 0.001, "velocity_m_s": [0, 0, 50]}))
        request = self.request()
        camera = request.pop("camera")
        both = {**request, "cameras": {"near": {"camera": camera}, "plain": {"camera": camera, "labels": False}}}
        coco, _, frame = self.check(both, "near")
        self.assertEqual(coco, coco_of(as_frame(self.body(self.request()))))
        self.assertNotIn("plain/rock_mask", frame)
        self.assertFalse("labelled_rocks" in frame.meta["cameras"]["plain"])

    def test_compression(self):
        stored, packed = (self.ok(self.service.frame(self.request(**more), "*/*"), "application/x-npz")
                          for more in ({}, {"compression": "deflate"}))
        self.assertLess(len(packed), 0.5 * len(stored))
        before, after = members(stored), members(packed)
        self.assertEqual(list(before), list(after))
        for name in before:
            if name != "meta.json":
                self.assertEqual(before[name], after[name])
        again = self.ok(self.service.frame(self.request(compression="deflate"), "*/*"), "application/x-npz")
        self.assertEqual(again, packed)

    def test_they_ask_for_an_npz(self):
        for changes in ({"products": ["image"]}, {"products": ["image"], "labels": None, "craters": None, "compression": "deflate"}):
            for accept in ("*/*", "image/png, application/x-npz;q=0.1"):
                status, headers, _ = self.service.frame(self.request(**changes), accept)
                self.assertEqual((status, headers["Content-Type"]), (200, "application/x-npz"))

    def test_refusals(self):
        for pointer, media_type, changes in (
                ("/labels", "*/*", {"detail": None, "craters": None}),
                ("/labels", "image/x-exr", {}),
                ("/labels", "application/x-npy", {"products": ["detail"]}),
                ("/compression", "image/png", {"labels": False, "craters": None, "products": ["image"], "compression": "deflate"}),
                ("/compression", "*/*", {"compression": "zstd"})):
            self.problem(self.service.frame(self.request(**changes), media_type), 422, pointer)

if __name__ == "__main__":
    harness.main()
