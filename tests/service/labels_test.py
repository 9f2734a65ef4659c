#!/usr/bin/env python3
"""Labels of frames: masks and COCO annotations in an .npz, and a shard's as one document by `selenograph batch --coco`."""

import glob
import importlib.util
import io
import json
import os
import sys
import tarfile
import types
import unittest.mock
import zipfile

import numpy as np

import harness
from harness import frame_request, run, sample

TRAINING = os.path.join(harness.REPOSITORY, "api", "clients", "python", "training", "frames.py")
LAT, LON = 0.1, 30.1
ROCKY = {"seed": 9, "craters": {"smallest_m": 1, "largest_m": 100}, "rocks": {
    "smallest_m": 0.25, "largest_m": 6, "frequency": [{"per_m2": 0.004, "exponent": 2.6607}]}}
BARE = {"seed": 9, "craters": {"smallest_m": 1, "largest_m": 100}}
MASKS = ("crater_mask", "rock_mask")
DEM = ""


def setUpModule():
    global DEM
    harness.set_up()
    DEM = sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    os.makedirs(harness.path("assets", "details"))
    for name, preset in (("rocky", ROCKY), ("bare", BARE)):
        harness.write(os.path.join("assets", "details", name + ".json"), preset)


def tearDownModule():
    harness.tear_down()


def members(body):
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        return {info.filename: archive.read(info) for info in archive.infolist()}


def array(content):
    return np.load(io.BytesIO(content))


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
        return members(self.ok(self.service.frame(request, media_type), "application/x-npz"))

    def check(self, found, prefix=""):
        """Masks against the annotations; the document."""
        coco = json.loads(found[prefix + "coco.json"])
        (image,) = coco["images"]
        width, height = image["width"], image["height"]
        masks = {name: array(found[f"{prefix}{name}.npy"]) for name in MASKS}
        expected = {name: np.zeros((height, width), np.uint16) for name in MASKS}
        kinds = {category["id"]: category["name"] for category in coco["categories"]}
        for annotation in coco["annotations"]:
            if kinds[annotation["category_id"]] == "rock":
                expected["rock_mask"][rock_mask(annotation)] = annotation["id"]
            else:
                (flat,) = annotation["segmentation"]
                expected["crater_mask"][polygon_mask(flat, width, height)] = annotation["id"]
        for name in MASKS:
            self.assertEqual(masks[name].dtype, np.uint16)
            np.testing.assert_array_equal(masks[name], expected[name])
        return coco, masks

    def test_masks_are_the_annotations(self):
        found = self.frame(self.request())
        coco, masks = self.check(found)
        counts = [sum(a["category_id"] == k for a in coco["annotations"]) for k in (1, 2)]
        self.assertGreater(min(counts), 10, counts)
        # Rocks of fewer pixels than the least are rocks without a label.
        seen = array(found["detail.npy"]) == 3
        self.assertTrue((masks["rock_mask"] > 0)[~seen].sum() == 0 and 0.3 * seen.sum() < (masks["rock_mask"] > 0).sum())
        self.assertNotIn("craters", json.loads(found["meta.json"]))  # the metadata need not repeat them

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
        self.check(self.frame(self.request(sensor=sensor, band={"center_um": 0.6, "width_um": 0.1})))
        coco, masks = self.check(self.frame(self.request(detail="bare")))
        self.assertEqual(masks["rock_mask"].max(), 0)
        self.assertGreater(len(coco["annotations"]), 10)

    def test_training_has_images_of_their_own_bit_depth(self):
        spec = importlib.util.spec_from_file_location("frames", TRAINING)
        torch, frames = types.ModuleType("torch"), importlib.util.module_from_spec(spec)
        # What is used of it, so that PyTorch needn't be here.
        torch.from_numpy, torch.utils = np.asarray, types.SimpleNamespace(data=types.SimpleNamespace(Dataset=object))
        with unittest.mock.patch.dict(sys.modules, torch=torch):
            spec.loader.exec_module(frames)
        detector = {"pixel_pitch_um": 5.5, "integration_time_s": 10, "quantum_efficiency": 0.4, "gain_e_dn": 3.4}
        light = {"sensor": {"optics": {"f_number": 5.6}, "detector": detector}, "band": {"center_um": 0.6, "width_um": 0.1}}
        for name, changes in (("image8", {}), ("image16", {"image": {"bit_depth": 16}}),
                              *((f"sensor{bits}", {**light, "sensor": {**light["sensor"], "detector": {
                                  **detector, "bit_depth": bits}}}) for bits in (8, 10, 12, 16))):
            os.makedirs(harness.path(name))
            found = self.ok(self.service.frame(self.request(**changes), "application/x-npz"), "application/x-npz")
            with open(harness.path(name, "a.npz"), "wb") as file:
                file.write(found)
            (item,) = frames.LabelledFrames(harness.path(name))
            self.assertEqual((item["image"].shape, item["image"].dtype, item["image"].max()), ((1, 120, 160), np.float32, 1))

    def test_other_cameras(self):
        self.check(self.frame(self.request(camera={"model": "fisheye", "width": 96, "height": 96, "fov_deg": 120.0})))
        self.check(self.frame(self.request(shutter={"line_time_s": 0.001, "velocity_m_s": [0, 0, 50]})))
        request = self.request()
        camera = request.pop("camera")
        both = {**request, "cameras": {"near": {"camera": camera}, "plain": {"camera": camera, "labels": False}}}
        found = self.frame(both)
        self.check(found, "near/")
        self.assertNotIn("plain/coco.json", found)
        self.assertEqual(found["near/crater_mask.npy"], self.frame(self.request())["crater_mask.npy"])

    def test_compression(self):
        stored, packed = (self.ok(self.service.frame(self.request(**more), "*/*"), "application/x-npz")
                          for more in ({}, {"compression": "deflate"}))
        self.assertLess(len(packed), 0.5 * len(stored))
        before, after = members(stored), members(packed)
        self.assertEqual(list(before), list(after))
        for name in before:
            if name != "meta.json" and name != "coco.json":
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

    def test_a_document_of_a_shard(self):
        requests = [{**self.request(east_m=30.0 * i, compression="deflate" if i % 2 else None, products=["image"]),
                     "name": f"view-{i}"} for i in range(7)]
        requests[3].pop("labels")
        requests[5]["camera"] = {"width": -1}  # never a frame
        manifest = harness.path("labels.jsonl")
        with open(manifest, "w") as file:
            file.writelines(json.dumps(request) + "\n" for request in requests)
        expected = {}
        for number, request in enumerate(requests, 1):
            if number not in (4, 6):
                expected[number] = json.loads(self.frame({k: v for k, v in request.items() if k != "name"})["coco.json"])
        texts = {}
        for form, options in (("npz", ()), ("webdataset", ("--frames-per-tar", "3"))):
            folder = harness.path("labels-" + form)
            listed, ids = {}, []
            for shard in ("0/2", "1/2"):
                for again in range(2):  # a second time nothing is rendered
                    done = run("batch", manifest, "-o", folder, "--format", form, *options, "--shard", shard, "--coco", "--dem", DEM,
                               "--assets-dir", harness.path("assets"), "--cache-dir", harness.path("cache"))
                    self.assertIn(done.returncode, (0, 2), done.stderr)
                    path = os.path.join(folder, f"coco-0000{shard[0]}-of-00002.json")
                    with open(path) as file:
                        text = file.read()
                    self.assertEqual(texts.setdefault(path, text), text)
                document = json.loads(text)
                ids += [a["id"] for a in document["annotations"]]
                for image in document["images"]:
                    mine = [a for a in document["annotations"] if a["image_id"] == image["id"]]
                    self.assertEqual([a["id"] for a in mine], [65536 * image["id"] + a["mask_id"] for a in mine])
                    own = [{**a, "id": a["mask_id"], "image_id": 1} for a in mine]
                    for annotation in own:
                        del annotation["mask_id"]
                    self.assertEqual(own, expected[image["id"]]["annotations"])
                    self.assertEqual(image["file_name"], f"view-{image['id'] - 1}.npz")
                    listed[image["id"]] = image
                    if form == "webdataset":
                        with tarfile.open(os.path.join(folder, image["tar"])) as tar:
                            self.assertIn(image["file_name"], tar.getnames())
                self.assertEqual(document["categories"], expected[1]["categories"])
            self.assertEqual(set(listed), set(expected))
            self.assertEqual(len(ids), len(set(ids)))
            self.assertEqual(glob.glob(os.path.join(folder, "*.part")), [])
            verified = run("batch", "verify", manifest, "-o", folder)
            self.assertEqual(verified.returncode, 2, verified.stdout)  # the bad line alone
            self.assertIn("6 frames done, 0 not done, 1 bad lines", verified.stdout)
        refused = run("batch", manifest, "-o", harness.path("png"), "--format", "png", "--coco", "--dem", DEM)
        self.assertIn("--coco", refused.stderr)
        self.assertFalse(os.path.exists(harness.path("png")))


if __name__ == "__main__":
    harness.main()
