#!/usr/bin/env python3
"""Objects and maps of the ground, over HTTP: what a client asks for by name is what the folder holds."""

import json
import os
import struct
import subprocess
import time
import unittest
import zlib

import numpy as np

import harness
from harness import frame_request, REPOSITORY, tearDownModule

SATELLITE = {"mesh": "satellite", "scale": 60,
             "pose": {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 19000}, "upright": {"azimuth_deg": 30}},
             "material": {"reflectance": {"model": "lambert", "rho": 0.3}},
             "part_materials": {"panel": {"reflectance": {"model": "blinn_phong", "rho": 0.4, "shininess": 100}}}}
WIDE = {"camera": {"width": 96, "height": 96, "fov_deg": 60}}


def asset(*parts):
    return harness.path("assets", *parts)


def setUpModule():
    harness.set_up()
    SceneTest.service = harness.service_with_assets()


def write_grey(path, rows):
    """An 8-bit grey PNG."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    height, width = rows.shape
    data = b"".join(b"\0" + row.astype(np.uint8).tobytes() for row in rows)
    with open(path, "wb") as f:
        f.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)) +
                chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b""))


class SceneTest(unittest.TestCase):
    def ask(self, products, accept="application/x-npz", **changes):
        status, headers, body = self.service.frame(frame_request(products, **changes), accept)
        self.assertEqual(status, 200, body[:500])
        return headers, body

    def frame(self, products, **changes):
        return self.service.arrays(frame_request(products, **changes))

    def refusal(self, **changes):
        status, _, body = self.service.frame(frame_request(["radiance"], **changes))
        self.assertEqual(status, 422, body[:300])
        errors = json.loads(body)["errors"]
        return [e["pointer"] for e in errors], " ".join(e["detail"] for e in errors)

    def unusable(self, **changes):
        status, _, body = self.service.frame(frame_request(["radiance"], **changes))
        self.assertEqual(status, 500, body[:300])
        problem = json.loads(body)
        self.assertTrue(problem["type"].endswith("asset_error"), problem)
        return problem["detail"]

    # --- objects

    def test_object_is_in_frame_and_metadata(self):
        f = self.frame(["radiance", "object_id", "source", "gsd", "range"], objects=[SATELLITE], **WIDE)
        on = f["object_id"] == 0
        self.assertTrue(set(np.unique(f["object_id"])) == {0, 65535})
        self.assertGreater(on.sum(), 100)
        self.assertTrue(np.all(f["source"][on] == 65535) and np.all(np.isnan(f["gsd"][on])))
        self.assertLess(np.nanmax(f["range"][on]), 1800)
        self.assertAlmostEqual(f["meta"]["object_fraction"], on.mean(), places=12)
        self.assertEqual(f["meta"]["objects"][0]["mesh"], "satellite")
        self.assertEqual(f["meta"]["objects"][0]["triangles"], 84)
        self.assertEqual(set(f["meta"]["objects"][0]["parts"]), {"body", "panel", "antenna"})

    # What a frame's pixels see of an object, rays meet; the ground behind it is hidden.
    def test_rays_and_landmarks_know_objects(self):
        f = self.frame(["object_id", "range", "position", "geodetic"], objects=[SATELLITE], **WIDE)
        pose = f["meta"]["request"]["pose"]
        on = np.argwhere(f["object_id"] == 0)[::37]
        eye = np.array(pose["position_m"])
        rays = [{"origin_m": list(eye), "direction": list(f["position"][y, x] - eye)} for y, x in on]
        status, _, body = self.service.post("/v1/rays", {"rays": rays, "objects": [SATELLITE]})
        self.assertEqual(status, 200, body[:300])
        for (y, x), hit in zip(on, json.loads(body)["rays"]):
            self.assertEqual(hit["object"], 0)
            self.assertAlmostEqual(hit["range_m"], f["range"][y, x], delta=1e-3)
        beyond = json.loads(self.service.post("/v1/rays", {"rays": rays})[2])["rays"]
        self.assertNotIn("object", beyond[0])
        self.assertGreater(beyond[0]["range_m"], f["range"][tuple(on[0])] + 1000)
        # From the ground that these rays end on, by the pixel of a frame without the object.
        ground = self.frame(["geodetic"], **WIDE)["geodetic"]
        points = [{"lat_deg": float(ground[y, x, 0]), "lon_deg": float(ground[y, x, 1])} for y, x in on]
        project = {"camera": WIDE["camera"], "pose": pose, "points": points}
        with_it = json.loads(self.service.post("/v1/project", project | {"objects": [SATELLITE]})[2])["points"]
        without = json.loads(self.service.post("/v1/project", project)[2])["points"]
        self.assertTrue(all(p["visible"] for p in without))
        self.assertFalse(any(p["visible"] for p in with_it))
        status, _, body = self.service.post("/v1/rays", {"rays": rays, "objects": [SATELLITE | {"mesh": "none-such"}]})
        self.assertEqual(status, 422)
        self.assertEqual(json.loads(body)["errors"][0]["pointer"], "/objects/0/mesh")

    def test_the_frames_etag_is_of_the_meshs_content(self):
        mesh = asset("objects", "plate.obj")
        plate = "v -5 -5 0\nv 5 -5 0\nv 5 5 0\nv -5 5 0\nf 1 2 3 4\n"
        objects = [SATELLITE | {"mesh": "plate", "part_materials": {}}]
        def etag(text):
            time.sleep(0.02)
            with open(mesh, "w") as f:
                f.write(text)
            return self.ask(["radiance"], objects=objects)[0]["etag"]
        first = etag(plate)
        self.assertEqual(etag(plate), first)
        self.assertNotEqual(etag(plate.replace("5 5 0", "5 6 0")), first)

    def test_the_documented_commands_make_pictures(self):
        for name in ("debris", "mapped"):
            picture = harness.path(name + ".png")
            done = subprocess.run([harness.BINARY, "ask", "frames",
                                   os.path.join(REPOSITORY, "deploy", "examples", name + "-request.json"), "-o", picture,
                                   "--assets-dir", os.path.join(REPOSITORY, "deploy", "assets"), "--dem", harness.path("dem"),
                                   "--cache-dir", harness.path("cache")], capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertGreater(os.path.getsize(picture), 1000)

    def test_wrong_objects_are_refused_by_their_member(self):
        self.assertIn("satellite", self.refusal(objects=[SATELLITE | {"mesh": "no-such"}])[1])
        self.assertEqual(self.refusal(objects=[SATELLITE | {"mesh": "../cameras/navigation-camera"}])[0], ["/objects/0/mesh"])
        pointers, detail = self.refusal(objects=[SATELLITE, SATELLITE | {"part_materials": {"wing": {}}}])
        self.assertEqual(pointers, ["/objects/1/part_materials"])
        self.assertIn("panel", detail)
        self.assertEqual(self.refusal(objects=[{k: v for k, v in SATELLITE.items() if k != "material"}])[0], ["/objects/0/material"])
        self.assertEqual(self.refusal(objects=[SATELLITE | {"scale": 0}])[0], ["/objects/0/scale"])
        self.assertEqual(self.refusal(objects=[SATELLITE | {"pose": {"position_m": [1, 2, 3]}}])[0], ["/objects/0/pose"])
        self.assertEqual(self.refusal(objects=[])[0], ["/objects"])
        self.assertEqual(self.refusal(objects=[SATELLITE] * 101)[0], ["/objects"])
        self.assertEqual(self.refusal(terrain=False)[0], ["/terrain"])
        self.assertEqual(self.refusal(terrain=False, objects=[SATELLITE], visibility="zbuffer")[0], ["/visibility"])
        self.assertEqual(self.refusal(objects=[SATELLITE | {"material": {"reflectance": {"model": "lambert"}, "albedo_maps": ["made-up-albedo"]}}])[0],
                         ["/objects/0/material/albedo_maps"])

    def test_a_damaged_mesh_is_the_operators_fault(self):
        with open(asset("objects", "damaged.ply"), "w") as f:
            f.write("ply\nformat ascii 1.0\nelement vertex 9\n")
        self.assertIn("damaged.ply", self.unusable(objects=[SATELLITE | {"mesh": "damaged", "part_materials": {}}]))

    # --- a measured point spread

    def test_a_kernels_file_is_the_kernel(self):
        def sensed(kernel):
            return {"band": {"center_um": 0.65, "width_um": 0.2}, "sensor": {
                "optics": {"f_number": 5.6, "point_spread": {"model": "kernel", "kernel": kernel}},
                "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.001, "gain_e_dn": 2, "bit_depth": 12}}}
        with open(asset("kernels", "made-up-coma.csv")) as f:
            rows = [[float(x) for x in line.split(",")] for line in f if not line.startswith("#")]
        named, given = self.frame(["image"], **sensed("made-up-coma")), self.frame(["image"], **sensed(rows))
        self.assertTrue(np.array_equal(named["image"], given["image"]))
        self.assertEqual(named["meta"], given["meta"])
        self.assertFalse(np.array_equal(named["image"], self.frame(["image"], **sensed([[1]]))["image"]))
        self.assertIn("made-up-coma", self.refusal(**sensed("no-such"))[1])
        for name, text in (("ragged", "1,2,3\n4,5,6\n7,8\n"), ("even", "1,2\n3,4\n"), ("negative", "-1\n"), ("dark", "0\n"), ("empty", "# none\n")):
            with open(asset("kernels", name + ".csv"), "w") as f:
                f.write(text)
            with self.subTest(name=name):
                self.assertEqual(set(self.refusal(**sensed(name))[0]), {"/sensor/optics/point_spread/kernel"})
        with open(asset("kernels", "words.csv"), "w") as f:
            f.write("1,2,3\n4,five,6\n7,8,9\n")
        self.assertIn("words.csv: line 2", self.unusable(**sensed("words")))

    # --- maps

    def test_a_map_of_bytes_without_a_scale_is_refused(self):
        write_grey(asset("maps", "bytes.png"), np.full((8, 8), 90))
        with open(asset("maps", "bytes.json"), "w") as f:
            json.dump({"file": "bytes.png", "extent": {"south_deg": -9, "north_deg": 9, "west_deg": 20, "east_deg": 40}}, f)
        for visibility in ("zbuffer", "raytrace"):
            pointers, text = self.refusal(visibility=visibility, surface={"albedo_maps": ["bytes"]})
            self.assertIn("bytes.png", text)
            self.assertIn("scale", text)
            self.assertIn("/surface/albedo_maps", pointers)

    def test_wrong_maps_are_refused(self):
        self.assertIn("made-up-albedo", self.refusal(surface={"albedo_maps": ["no-such"]})[1])
        self.assertEqual(self.refusal(surface={"albedo_maps": []})[0], ["/surface/albedo_maps"])
        self.assertEqual(self.refusal(surface={"albedo_maps": "made-up-albedo"})[0], ["/surface/albedo_maps"])
        self.assertEqual(self.refusal(surface={"reflectance": {"model": "hapke"}, "temperature_maps": ["made-up-albedo"]})[0],
                         ["/surface/temperature_maps"])

    def test_a_damaged_map_is_the_operators_fault(self):
        for name, text in (("vanished", '{"file": "nothing.tif"}'), ("misspelt", '{"file": "made-up-albedo.asc", "scales": 2}'),
                           ("nowhere", '{"file": "halves.png"}'), ("noise", "not JSON"), ("list", "[]"), ("fileless", "{}"),
                           ("inside-out", '{"file": "made-up-albedo.asc", "extent": {"south_deg": 5, "north_deg": 1, "west_deg": 0, "east_deg": 9}}')):
            write_grey(asset("maps", "halves.png"), np.zeros((4, 4)))
            with open(asset("maps", name + ".json"), "w") as f:
                f.write(text)
            with self.subTest(name=name):
                self.assertRegex(self.unusable(surface={"albedo_maps": [name]}), name + r"\.json|nothing\.tif|halves\.png")


if __name__ == "__main__":
    harness.main()
