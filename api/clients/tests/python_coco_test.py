#!/usr/bin/env python3
"""COCO documents by the Python client, of made-up frames: run lengths, clipped rims, ids in a campaign's folder."""

import contextlib
import io
import json
import os
import sys
import tarfile
import tempfile
import unittest
import zipfile

import numpy as np

import harness

sys.path.insert(0, os.path.join(harness.REPOSITORY, "api", "clients", "python"))
import selenograph  # noqa: E402
from selenograph.coco import coco_image  # noqa: E402

HEIGHT, WIDTH = 6, 8


def decoded(segmentation):
    """As COCO's tools read run lengths: down the columns, outside and inside in turn."""
    flat = np.concatenate([np.full(n, i % 2 == 1) for i, n in enumerate(segmentation["counts"])])
    return flat.reshape(segmentation["size"][::-1]).T


def crater(mask_id, rim_px):
    return {"id": f"{mask_id:016x}", "lat_deg": 1.5, "rim_px": rim_px, "rim_visible": 0.5, "rim_ellipse": {},
            "center_px": None, "center_visible": False, "mask_id": mask_id}


def meta_of(craters=(), rocks=()):
    return {"software": {"name": "selenograph", "version": "1.2.3"}, "detail": {}, "request": {}, "craters": list(craters),
            "labelled_rocks": [{"mask_id": n, "id": f"{n:016x}", "diameter_m": 0.5 * n} for n in rocks]}


def npz_of(meta, **arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("meta.json", json.dumps(meta))
    return file.getvalue()


class Annotations(unittest.TestCase):
    def test_rocks_decode_to_their_pixels(self):
        draws = np.random.default_rng(1)
        for largest in (1, 3, 40):
            mask = draws.integers(0, largest + 1, (HEIGHT, WIDTH)).astype(np.uint16)
            numbers = sorted(set(mask.ravel().tolist()) - {0})
            image, annotations = coco_image(meta_of(rocks=numbers), mask, 7, "a.npz")
            self.assertEqual(image, {"id": 7, "width": WIDTH, "height": HEIGHT, "file_name": "a.npz"})
            self.assertEqual([a["id"] for a in annotations], numbers)
            for a in annotations:
                expected = mask == a["id"]
                np.testing.assert_array_equal(decoded(a["segmentation"]), expected)
                self.assertEqual(a["area"], expected.sum())
                y, x = np.nonzero(expected)
                self.assertEqual(a["bbox"], [x.min(), y.min(), x.max() + 1 - x.min(), y.max() + 1 - y.min()])
                self.assertEqual((a["category_id"], a["image_id"], a["rock_id"]), (2, 7, f"{a['id']:016x}"))
                self.assertEqual(a["diameter_m"], 0.5 * a["id"])

    def test_a_run_down_two_columns(self):
        mask = np.zeros((HEIGHT, WIDTH), np.uint16)
        mask[HEIGHT - 1, 2] = mask[0, 3] = 1
        (a,) = coco_image(meta_of(rocks=[1]), mask, 1, "")[1]
        self.assertEqual(a["bbox"], [2, 0, 2, HEIGHT])
        self.assertEqual(a["segmentation"]["counts"], [3 * HEIGHT - 1, 2, (WIDTH - 3) * HEIGHT - 1])
        whole = coco_image(meta_of(rocks=[1]), np.ones_like(mask), 1, "")[1][0]
        self.assertEqual((whole["bbox"], whole["segmentation"]["counts"]), ([0, 0, WIDTH, HEIGHT], [0, HEIGHT * WIDTH]))

    def test_rims_end_at_the_borders(self):
        """Pixels' centres are at whole numbers in the metadata, half a pixel beyond in COCO."""
        inside = [[0.5, 0.5], [2.5, 0.5], [2.5, 3.5], [0.5, 3.5]]
        corner = [[5.5, 4.5], [9.5, 4.5], [9.5, 9.5], [5.5, 9.5]]
        hidden = [[-5, 0], [-3, 0], [-3, 2]]
        around = [[-50, -50], [50, -50], [50, 50], [-50, 50]]
        craters = [crater(1, around), crater(0, hidden), crater(2, inside), crater(3, corner)]
        craters[2]["center_px"] = [1.5, 2.0004]
        annotations = coco_image(meta_of(craters), np.zeros((HEIGHT, WIDTH), np.uint16), 1, "")[1]
        self.assertEqual([(a["id"], a["crater_id"], a["category_id"]) for a in annotations],
                         [(n, f"{n:016x}", 1) for n in (1, 2, 3)])
        self.assertEqual([a["bbox"] for a in annotations], [[0, 0, WIDTH, HEIGHT], [1, 1, 2, 3], [6, 5, 2, 1]])
        self.assertEqual([a["area"] for a in annotations], [WIDTH * HEIGHT, 6, 2])
        self.assertEqual(annotations[1]["segmentation"], [[1, 1, 3, 1, 3, 4, 1, 4]])
        self.assertEqual([a["center"] for a in annotations], [None, [2, 2.5], None])
        self.assertEqual(annotations[1]["lat_deg"], 1.5)
        self.assertFalse({"mask_id", "rim_px", "rim_ellipse", "center_px"} & set(annotations[1]))

    def test_none(self):
        self.assertEqual(coco_image(meta_of(), np.zeros((HEIGHT, WIDTH), np.uint16), 1, "")[1], [])


class Folder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.output = os.path.join(self.folder, "coco.json")
        mask = np.zeros((HEIGHT, WIDTH), np.uint16)
        mask[1, 1], mask[2, 2] = 1, 2
        self.labelled = npz_of(meta_of(rocks=[1, 2]), rock_mask=mask)
        self.plain = npz_of({}, image=mask)

    def write(self, name, content):
        with open(os.path.join(self.folder, name), "wb") as file:
            file.write(content)
        return os.path.join(self.folder, name)

    def command(self, *options):
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = selenograph.main(["coco", self.folder, "-o", self.output, *options])
        return status, out.getvalue(), err.getvalue()

    def document(self):
        with open(self.output) as file:
            return json.load(file)

    def test_ids_follow_from_the_manifest(self):
        lines = ['{"name": "b"}', "", "no JSON", "{}", '{"name": "plain"}', '{"name": "in.tar"}']
        manifest = self.write("m.jsonl", "\n".join(lines).encode())
        for name in ("b.npz", "000004.npz", "unknown.npz"):
            self.write(name, self.labelled)
        self.write("plain.npz", self.plain)
        with tarfile.open(os.path.join(self.folder, "frames-000000.tar"), "w") as tar:
            member = tarfile.TarInfo("in.tar.npz")
            member.size = len(self.labelled)
            tar.addfile(member, io.BytesIO(self.labelled))
        status, out, _ = self.command("--manifest", manifest)
        self.assertEqual((status, out.splitlines()[0]), (0, f"{self.output}: 6 annotations of 3 frames"))
        self.assertIn("2 frames are left out", out)
        document = self.document()
        self.assertEqual(sorted((i["id"], i["file_name"], i.get("tar")) for i in document["images"]),
                         [(1, "b.npz", None), (4, "000004.npz", None), (6, "in.tar.npz", "frames-000000.tar")])
        self.assertEqual(sorted((a["image_id"], a["mask_id"], a["id"]) for a in document["annotations"]),
                         [(n, k, 65536 * n + k) for n in (1, 4, 6) for k in (1, 2)])
        self.assertEqual([c["name"] for c in document["categories"]], ["crater", "rock"])

    def test_without_a_manifest_images_are_counted(self):
        self.write("b.npz", self.labelled)
        self.write("a.npz", self.labelled)
        self.assertEqual(self.command()[0], 0)
        self.assertEqual([(i["id"], i["file_name"]) for i in self.document()["images"]], [(1, "a.npz"), (2, "b.npz")])

    def test_a_folder_without_labels(self):
        self.write("plain.npz", self.plain)
        self.assertEqual(self.command()[0], 0)
        self.assertEqual((self.document()["images"], self.document()["annotations"]), ([], []))

    def test_a_damaged_frame_leaves_the_document_as_it_was(self):
        self.write("a.npz", self.labelled)
        self.write("coco.json", b"{}")
        for damaged in (self.labelled[:-100], b"", self.labelled.replace(b"meta.json", b"meta.jsox")):
            self.write("b.npz", damaged)
            status, _, err = self.command()
            self.assertEqual(status, 1)
            self.assertIn("b.npz is damaged", err)
            self.assertEqual(self.document(), {})
            self.assertEqual(sorted(os.listdir(self.folder)), ["a.npz", "b.npz", "coco.json"])


if __name__ == "__main__":
    harness.main()
