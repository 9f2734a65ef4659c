#!/usr/bin/env python3
"""40 requests have the answers whose hashes are in same_bytes.json, whichever compiler and libraries the binary has.

A hash for each array and each member of a JSON answer, so that a failure names what differs. Left out: texts for readers, and
what says when and with which version an answer was made. Answers stay the same within a minor version (api/versions.md;
tests/unit/version_test.py locks the record of a release). After a change that is meant to alter answers, give the reason
in CHANGELOG.md:

    PYTHONPATH=tests/service SELENOGRAPH_BINARY=build/selenograph python3 tests/service/same_bytes_test.py --write

and once more on another Debian, without --write. tests/compare_binaries.py shows where two binaries differ.
"""

import hashlib
import io
import json
import os
import sys
import unittest
import zipfile
import zlib

import numpy as np

import harness

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.dirname(HERE))

import compare_binaries
import comparison_requests
from comparison_requests import ALL, NPZ, Request, frame, nadir, place, sun

RECORD = os.path.join(HERE, "same_bytes.json")
LISTED = (
    "nadir, all products, zbuffer", "nadir, all products, raytrace", "oblique, zbuffer", "limb, raytrace",
    "horizon from 2 m, zbuffer", "far, zbuffer", "pole, zbuffer", "pole, raytrace", "date line, zbuffer", "low Sun, raytrace",
    "penumbra, zbuffer", "lens, raytrace", "sub-pixel samples, raytrace", "attitude by quaternion",
    "reflectance: lunar-Lambert", "reflectance: Hapke", "band", "thermal band", "maps, zbuffer", "maps, samples",
    "objects, zbuffer", "objects, penumbra, raytrace", "sensor: all noise, motion, zbuffer",
    "sensor: Airy, vignetting by a table", "preset", "image of 16 bits", "PNG of 16 bits", "normal as application/x-npy",
    "rays", "project", "heights", "roundtrip, camera", "mertis")
# Texts, and what differs between machines: versions are hashes that contain times of files.
LEFT_OUT = {"software", "version", "content_hash", "warnings", "request", "title", "detail", "assumptions_of_the_defaults"}


def requests(service):
    by_name = {r.name: r for r in comparison_requests.all_requests(service)}
    yield from (by_name[name] for name in LISTED)
    low = nadir(3e3)
    yield frame("detail", ALL, pose=low, detail="landing", craters={})
    yield frame("detail, raytrace", ALL, pose=low, detail="highlands", visibility="raytrace")
    yield frame("indirect light", ["radiance"], indirect={"bounces": 1})
    headers = {"Content-Type": "application/json", "Accept": "application/json"}
    box = {"south_deg": -6.552, "north_deg": -6.548, "west_deg": 39.948, "east_deg": 39.952}
    yield Request("craters", "POST", "/v1/features", headers,
                  {"detail": "landing", "region": box, "kind": "craters", "smallest_m": 5})
    yield Request("rocks", "POST", "/v1/features", headers, {"detail": "landing", "region": box, "kind": "rocks", "smallest_m": 1})
    area = {"projection": "orthographic", "center": place(-6.55, 39.95), "width_m": 2e3, "height_m": 2e3, "gsd_m": 20}
    yield Request("map", "POST", "/v1/maps", {**headers, "Accept": NPZ},
                  {"map": area, "detail": "landing", "products": ["height", "slope", "radiance"], "sun": sun(15)})


def hash_of(data):
    return hashlib.sha256(data).hexdigest()[:12]


def hash_of_array(array):
    return hash_of(f"{array.dtype.str}{array.shape}".encode() + array.tobytes())


def without_texts(value):
    if isinstance(value, dict):
        return {name: without_texts(v) for name, v in value.items() if name not in LEFT_OUT}
    return [without_texts(v) for v in value] if isinstance(value, list) else value


def hashes_of_json(document):
    return {name: hash_of(json.dumps(value, sort_keys=True).encode()) for name, value in without_texts(document).items()}


def hashes_of(answer):
    """By array and member."""
    status, headers, body = answer
    kind = headers["Content-Type"]
    if status != 200:
        raise AssertionError(f"status {status}: {body[:500]}")
    if kind == NPZ:
        with zipfile.ZipFile(io.BytesIO(body)) as archive:
            hashes = {}
            for name in archive.namelist():
                if name.endswith(".npy"):
                    hashes[name[:-4]] = hash_of_array(np.load(io.BytesIO(archive.read(name))))
                else:
                    hashes |= hashes_of_json(json.loads(archive.read(name)))
            return hashes
    if kind == "application/json":
        return hashes_of_json(json.loads(body))
    if kind == "image/png":
        return {"pixels": hash_of(compare_binaries.png_without_text(body)[1])}
    return {"bytes": hash_of(body)}


def answers():
    harness.set_up()
    try:
        comparison_requests.write_files(harness.BINARY, comparison_requests.places(256))
        service = harness.Service("--assets-dir", harness.path("assets"))
        found = {request.name: hashes_of(request.ask(service)) for request in requests(service)}
        service.expect_clean_stop()
        return found
    finally:
        harness.tear_down()


class SameBytes(unittest.TestCase):
    @unittest.skipIf(harness.sanitized(), "compiled in another way, which no promise is about")
    def test_answers_have_the_recorded_hashes(self):
        with open(RECORD) as file:
            recorded = json.load(file)
        found = answers()
        self.assertEqual(list(found), list(recorded))
        for name, hashes in recorded.items():
            for part, expected in hashes.items():
                with self.subTest(request=name, part=part):
                    self.assertEqual(found[name].get(part), expected)


if __name__ == "__main__":
    if "--write" in sys.argv:
        lines = [f"{json.dumps(name)}: {json.dumps(hashes)}" for name, hashes in answers().items()]
        with open(RECORD, "w") as record:
            record.write("{\n" + ",\n".join(lines) + "\n}\n")
        sys.exit(0)
    harness.main()
