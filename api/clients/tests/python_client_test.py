#!/usr/bin/env python3
"""The Python client (api/clients/python): each method against the real binary. python_http_test.py: HTTP's mishaps.

Needs NumPy.
"""

import ast
import asyncio
import collections
import contextlib
import datetime
import glob
import importlib.util
import io
import json
import math
import multiprocessing
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import unittest
import warnings
from unittest import mock

import numpy as np

try:
    import cv2
except ImportError:
    cv2 = None

import harness
from harness import BINARY, PATIENCE_S, REPOSITORY, Service, frame_request
from one_service import WITH_ASSETS, OneService, start, tearDownModule, url  # noqa: F401

FOLDER = os.path.join(REPOSITORY, "api", "clients", "python")
sys.path.insert(0, FOLDER)
import selenograph  # noqa: E402
from selenograph import AsyncClient, Client, Pose, Refused, Sun, Trajectory  # noqa: E402
from selenograph.moon import position_of  # noqa: E402


def setUpModule():
    start("--max-rays", "20000", *WITH_ASSETS)


def pose_at(step):
    return Pose.nadir(lat_deg=-6.5 + 0.02 * step, lon_deg=40.0, height_m=20000)


def request_at(step, products=("radiance", "range"), **changes):
    sun = Sun.local(lat_deg=-6.5, lon_deg=40, azimuth_deg=90, elevation_deg=15)
    return frame_request(products, **{"pose": pose_at(step), "sun": sun, **changes})


class WithClient(unittest.TestCase):
    def setUp(self):
        self.client = Client(url())
        self.addCleanup(self.client.close)

    def same(self, a, b):
        self.assertEqual(list(a), list(b))
        for product in a:
            np.testing.assert_array_equal(a[product], b[product])
        self.assertEqual(a.meta, b.meta)
        self.assertEqual(a.etag, b.etag)


class Frames(WithClient):
    def test_a_frame_is_a_mapping(self):
        products = ("radiance", "range", "position", "image", "source")
        frame = self.client.frame(request_at(0, products))
        status, headers, body = OneService.service.frame(request_at(0, products), "application/x-npz")
        self.assertEqual(status, 200)
        right = np.load(io.BytesIO(body))
        self.assertEqual(set(frame), set(products))
        self.assertEqual(len(frame), len(products))
        for product in products:
            np.testing.assert_array_equal(frame[product], right[product])
            self.assertEqual(frame[product].dtype, right[product].dtype)
            self.assertTrue(frame[product].flags.writeable and frame[product].flags.aligned)
        self.assertEqual(frame.meta, json.loads(bytes(right["meta.json"])))
        self.assertEqual(frame.etag, headers["ETag"])
        self.assertEqual(frame.warnings, [])
        self.assertIn("visibility", frame.timing)
        self.assertGreater(frame.timing["encode"], 0)
        with self.assertRaisesRegex(KeyError, "depth.*the frame has image, radiance"):
            frame["depth"]

    def test_echo(self):
        echo = {"tag": "2026-11-20T00:00:00Z", "frame": 7, "camera": {"name": "Kamera 1, vorn"}}
        frame = self.client.frame(request_at(0, echo=echo))
        self.assertEqual(frame.echo, echo)
        self.assertEqual(frame.etag, self.client.frame(request_at(0)).etag)
        self.assertIsNone(self.client.frame(request_at(0)).echo)

    def test_files(self):
        png = self.client.encoded(request_at(0, ["image"]))
        self.assertEqual((png.media_type, png.content[:4]), ("image/png", b"\x89PNG"))
        tiff = self.client.encoded(request_at(0, ["range"]), "image/tiff")
        self.assertEqual((tiff.media_type, tiff.content[:2]), ("image/tiff", b"II"))

    def test_numpy_in_requests(self):
        plain = self.client.frame(request_at(0, camera={"width": 48, "height": 40, "fov_deg": 40.0}))
        camera = {"width": np.int32(48), "height": np.uint8(40), "fov_deg": np.float32(40)}
        request = request_at(0, np.array(["radiance", "range"]), camera=camera)
        request["products"] = np.array(request["products"])
        self.same(self.client.frame(request), plain)
        with self.assertRaisesRegex(ValueError, "/pose/position_m/1 is nan"):
            self.client.frame(request_at(0, pose={"position_m": np.array([2e6, math.nan, 0]), "nadir": {}}))
        with self.assertRaisesRegex(ValueError, r"datetime\(2026, 11, 20.* has no time zone"):
            self.client.frame(request_at(0, sun={"utc": datetime.datetime(2026, 11, 20)}))
        with self.assertRaisesRegex(TypeError, "a request is a dict, not str; json.loads"):
            self.client.frame(json.dumps(request_at(0)))
        with self.assertRaisesRegex(TypeError, "set cannot be part of a request"):
            self.client.frame(request_at(0, pose={"nadir"}))

    def test_a_refusal_lists_its_pointers(self):
        with self.assertRaises(Refused) as caught:
            self.client.frame(request_at(0, camera={"width": 48, "fovdeg": 40}))
        refused = caught.exception
        self.assertEqual(refused.status, 422)
        self.assertEqual(refused.problem["type"], "urn:selenograph:problem:invalid_request")
        self.assertEqual(set(refused.pointers), {error["pointer"] for error in refused.problem["errors"]})
        self.assertIn('/camera/fovdeg: unknown member; did you mean "fov_deg"?', str(refused))
        self.assertIn("/camera/height: is required", str(refused))

    def test_processes_may_share_a_client(self):
        right = self.client.frame(request_at(0))  # from here on a connection is kept
        for method in ("fork", "spawn"):
            with multiprocessing.get_context(method).Pool(2) as pool:
                for frame in pool.map(self.client.frame, [request_at(0)] * 4):
                    self.same(frame, right)
                with self.assertRaises(Refused) as caught:
                    pool.map(self.client.frame, [{}])
                self.assertIn("/camera", caught.exception.pointers)
                self.assertIn("/camera: is required", str(caught.exception))
        forked = os.fork()
        if not forked:
            try:
                os._exit(0 if self.client.frame(request_at(0)).etag == right.etag else 1)
            finally:
                os._exit(2)
        self.same(self.client.frame(request_at(0)), right)
        self.assertEqual(os.waitpid(forked, 0)[1], 0)

    def test_warnings_are_pythons(self):
        dark = request_at(0, sun=Sun.local(lat_deg=-6.5, lon_deg=40, azimuth_deg=90, elevation_deg=-40))
        with self.assertWarnsRegex(selenograph.FrameWarning, "no signal") as caught:
            frame = self.client.frame(dark)
        self.assertEqual(caught.filename, __file__)
        self.assertRegex("".join(frame.warnings), "no signal")
        with self.assertWarns(selenograph.FrameWarning) as caught:
            list(self.client.frames([dark]))
        self.assertEqual(caught.filename, __file__)

    def test_rays_and_landmarks_warn(self):
        request, here = request_at(0), [[-6.5, 40]]
        for utc, warned in ("2025-03-14T06:59:00Z", 1), ("2025-03-14T10:05:00Z", 0):  # a total eclipse, and after it
            for ask in (lambda: self.client.rays([3e6, 0, 0], [-1, 0, 0], sun={"utc": utc}),
                        lambda: self.client.project(request["camera"], request["pose"], here, sun={"utc": utc})):
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always", selenograph.FrameWarning)
                    ask()
                self.assertEqual([w.filename for w in caught], [__file__] * warned)
                self.assertTrue(all("the Earth covers the Sun" in str(w.message) for w in caught))

    def test_the_sky_warns(self):
        inertial = {"frame": "ICRF", "utc": "2026-11-25T01:00:00Z", "position_m": [2e6, 9e6, 5e5],
                    "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}}
        request = {"camera": {"width": 64, "height": 64, "fov_deg": 10}, "pose": inertial,
                   "utc": "2026-11-25T00:00:00Z", "sky": {"earth": True}}
        with self.assertWarnsRegex(selenograph.FrameWarning, "the epoch of a pose in ICRF") as caught:
            self.client.sky(request)
        self.assertEqual(caught.filename, __file__)

    def test_warnings_of_several_cameras(self):
        nowhere = {"pose": Pose.nadir(lat_deg=50, lon_deg=100, height_m=20000)}
        with self.assertWarnsRegex(selenograph.FrameWarning, "^back: .* without data"):
            frame = self.client.frame(request_at(0, cameras={"front": {}, "back": nowhere}))
        self.assertEqual(set(frame), {"front/radiance", "front/range", "back/radiance", "back/range"})
        self.assertEqual(frame.warnings, [f"back: {text}" for text in frame.meta["cameras"]["back"]["warnings"]])

    def test_labels(self):
        ground_m = float(self.client.heights(-6.5, 40, detail="landing").height_m)
        low = request_at(0, ["image"], detail="landing", labels=True,
                         pose=Pose.nadir(lat_deg=-6.5, lon_deg=40, height_m=ground_m + 200))
        frame = self.client.frame(low)
        document = selenograph.coco_of(frame, "low.png")
        height, width = frame["image"].shape
        self.assertEqual(document["images"], [{"id": 1, "width": width, "height": height, "file_name": "low.png"}])
        numbers = {annotation["id"] for annotation in document["annotations"]}
        seen = set(np.union1d(frame["crater_mask"], frame["rock_mask"]).tolist()) - {0}
        self.assertTrue(seen and seen <= numbers, seen - numbers)
        both = self.client.frame({**low, "cameras": {"left": {}, "plain": {"labels": False}}})
        self.assertEqual(selenograph.coco_of(both, camera="left")["annotations"], document["annotations"])
        for unlabelled, camera in ((both, "plain"), (self.client.frame(request_at(0)), "")):
            with self.assertRaisesRegex(KeyError, "rock_mask"):
                selenograph.coco_of(unlabelled, camera=camera)

    def test_a_loop_is_warned_once(self):
        """Texts are constant: Python's own filter shows the same trouble of many frames once."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("default", selenograph.FrameWarning)
            for elevation_deg in (-40, -41, -42):
                sun = Sun.local(lat_deg=-6.5, lon_deg=40, azimuth_deg=90, elevation_deg=elevation_deg)
                self.client.frame(request_at(0, sun=sun))
        self.assertEqual(len([w for w in caught if w.category is selenograph.FrameWarning]), 1)


class InOrder(WithClient):
    COUNT = 9

    @classmethod
    def setUpClass(cls):
        with Client(url()) as client:
            cls.alone = [client.frame(request_at(step)) for step in range(cls.COUNT)]

    def all_right(self, frames, count=COUNT):
        got = list(frames)
        self.assertEqual(len(got), count)
        for frame, right in zip(got, self.alone):
            self.same(frame, right)

    def test_any_number_in_flight_gives_the_frames_in_order(self):
        requests = [request_at(step) for step in range(self.COUNT)]
        for in_flight, ahead in ((1, 0), (1, 4), (2, 4), (5, 64)):
            with self.subTest(in_flight=in_flight, ahead=ahead):
                self.all_right(self.client.frames(requests, in_flight, ahead))
                self.all_right(self.client.frames(iter(requests), in_flight, ahead))
                self.all_right(self.client.frames(collections.deque(requests), in_flight, ahead))
        self.assertEqual(list(self.client.frames([])), [])
        self.assertEqual(list(self.client.frames(iter([]))), [])

    def test_an_iterable_is_taken_lazily(self):
        taken = []

        def requests():
            for step in range(1000):
                taken.append(step)
                yield request_at(step % self.COUNT)

        for in_flight in (1, 2, 4):
            taken.clear()
            frames = self.client.frames(requests(), in_flight)
            self.assertEqual(taken, [])
            for i in range(3):
                self.same(next(frames), self.alone[i])
                self.assertLessEqual(len(taken), i + in_flight)
            frames.close()
            self.assertLessEqual(len(taken), 2 + in_flight)

    def test_requests_may_depend_on_the_frames_so_far(self):
        for in_flight in (1, 2, 3):
            seen, known = [], []

            def requests():
                for step in range(self.COUNT):
                    known.append(len(seen))
                    yield request_at(step)

            for frame in self.client.frames(requests(), in_flight):
                seen.append(frame)
            self.all_right(seen)
            self.assertTrue(all(n > step - in_flight for step, n in enumerate(known)), known)

    def test_errors_are_raised_in_order(self):
        requests = [request_at(0), request_at(1), request_at(2, products=["nonsense"]), request_at(3)]
        below = request_at(2, pose=Pose.nadir(lat_deg=-6.5, lon_deg=40, height_m=-9000))
        bad_pose = request_at(2, pose={"nadir": {}})  # a fault in "ahead" of those before, too
        for bad in (requests[2], below, bad_pose):
            for in_flight in (1, 2, 3):
                requests[2] = bad
                frames = self.client.frames(requests, in_flight)
                self.same(next(frames), self.alone[0])
                self.same(next(frames), self.alone[1])
                with self.assertRaises(Refused) as caught:
                    next(frames)
                self.assertTrue(caught.exception.pointers[0].startswith(("/pose", "/products")), caught.exception)
                self.assertRaises(StopIteration, next, frames)

    def test_errors_of_the_iterable_are_raised_in_order(self):
        def requests():
            yield request_at(0)
            yield request_at(1)
            raise RuntimeError("the simulator stopped")
        for in_flight in (1, 3):
            frames = self.client.frames(requests(), in_flight)
            self.same(next(frames), self.alone[0])
            self.same(next(frames), self.alone[1])
            self.assertRaisesRegex(RuntimeError, "the simulator stopped", next, frames)

    def test_invalid_arguments(self):
        self.assertRaisesRegex(ValueError, "in_flight is 0", self.client.frames, [], 0)
        self.assertRaisesRegex(ValueError, "ahead is 65", self.client.frames, [], 2, 65)
        self.assertRaisesRegex(TypeError, r"for one there is frame\(\)", self.client.frames, request_at(0))


class Points(WithClient):
    def test_rays_hit_what_the_frame_sees(self):
        frame = self.client.frame(request_at(0, ["range", "position", "lit", "normal"], accuracy={"max_error_px": 0}))
        camera_m = np.array(frame.meta["request"]["pose"]["position_m"])
        towards = frame["position"] - camera_m
        hits = self.client.rays(camera_m, towards, sun=request_at(0)["sun"])
        self.assertEqual(hits.shape, frame["range"].shape)
        self.assertTrue(hits.hit.all())
        np.testing.assert_allclose(hits.range_m, frame["range"], atol=1e-5)
        np.testing.assert_allclose(hits.position_m, frame["position"], atol=1e-5)
        self.assertGreater((hits["lit"] == frame["lit"]).mean(), 0.99)
        away = self.client.rays(camera_m, [camera_m, -camera_m])
        self.assertEqual(away.hit.tolist(), [False, True])
        self.assertTrue(math.isnan(away.range_m[0]) and np.isnan(away.lit).all())
        one = self.client.rays(camera_m, -camera_m)
        self.assertEqual(one.shape, ())
        self.assertEqual(float(one.range_m), away.range_m[1])
        self.assertRaisesRegex(ValueError, r"arrays of \(..., 3\)", self.client.rays, [1, 2], [3, 4])

    def test_no_points_give_empty_arrays(self):
        request, none = request_at(0), np.zeros((0, 3))
        rays = self.client.rays(none, none, sun=request["sun"])
        self.assertEqual((rays.shape, rays.position_m.shape, rays.rock.dtype), ((0,), (0, 3), np.uint64))
        self.assertEqual(self.client.rays(np.zeros(3), np.zeros((4, 0, 3))).shape, (4, 0))
        self.assertEqual(self.client.project(request["camera"], request["pose"], none).in_frame.shape, (0,))
        self.assertEqual(self.client.heights([], []).height_m.shape, (0,))

    def test_projected_points_are_where_the_frame_has_them(self):
        request = request_at(0, ["geodetic"], accuracy={"max_error_px": 0})
        frame = self.client.frame(request)
        points = self.client.project(request["camera"], request["pose"], frame["geodetic"], sun=request["sun"])
        rows, columns = np.indices(points.shape)
        np.testing.assert_allclose(points.x_px, columns, atol=1e-6)
        np.testing.assert_allclose(points.y_px, rows, atol=1e-6)
        self.assertTrue(points.in_frame.all())
        self.assertGreater(points.visible.mean(), 0.99)
        self.assertTrue(np.isfinite(points.lit).all())
        on_terrain = self.client.project(request["camera"], request["pose"], frame["geodetic"][..., :2])
        np.testing.assert_allclose(on_terrain.height_m, frame["geodetic"][..., 2], atol=1e-5)
        as_json = [{"lat_deg": -6.5, "lon_deg": 40}, {"lat_deg": -6.5, "lon_deg": 40, "height_m": 5000}]
        as_array = [[-6.5, 40, math.nan], [-6.5, 40, 5000]]
        np.testing.assert_array_equal(*(self.client.project(request["camera"], request["pose"], some).range_m
                                        for some in (as_json, as_array)))
        with self.assertRaisesRegex(ValueError, "points have lat_deg, lon_deg and height_m, not 'hight_m'"):
            self.client.project(request["camera"], request["pose"], [{**as_json[0], "hight_m": 5000}])
        mixed = self.client.project(request["camera"], request["pose"], [[-6.5, 40, math.nan], [-6.5, 40, 50000]])
        self.assertEqual(mixed.reason.tolist(), [None, "behind the camera"])
        self.assertTrue(math.isnan(mixed.x_px[1]))

    def test_heights(self):
        lat, lon = np.meshgrid([-6.5, -6.4, 50.0], [40.0, 40.25], indexing="ij")
        heights = self.client.heights(lat, lon)
        self.assertEqual(heights.shape, (3, 2))
        for i in np.ndindex(2, 2):
            _, _, body = OneService.service.ask("GET", f"/v1/height?lat_deg={lat[i]}&lon_deg={lon[i]}")
            right = json.loads(body)
            self.assertEqual({name: heights[name][i] for name in right}, right)
        self.assertTrue(np.isnan(heights.height_m[2]).all())
        self.assertEqual(heights.reason[2, 0], "no dataset covers this place")
        self.assertEqual(float(self.client.heights(-6.5, 40).height_m), heights.height_m[0, 0])

    def test_the_ground_with_detail(self):
        lat, lon = np.meshgrid(np.linspace(-6.501, -6.499, 9), np.linspace(39.999, 40.001, 9), indexing="ij")
        plain, detailed = (self.client.heights(lat, lon, detail=name).height_m for name in (None, "landing"))
        self.assertGreater(np.abs(detailed - plain).max(), 0.1)
        self.assertLess(np.abs(detailed - plain).max(), 50)
        down = -np.array([np.cos(np.radians(lat)) * np.cos(np.radians(lon)),
                          np.cos(np.radians(lat)) * np.sin(np.radians(lon)), np.sin(np.radians(lat))]).transpose(1, 2, 0)
        rays = self.client.rays(-1747400 * down, down, detail="landing")
        # All but rocks and the soil against them.
        apart_m = np.abs(rays.range_m - (10000 - detailed))
        self.assertLessEqual((apart_m > 1e-6).sum(), 4)
        self.assertLess(apart_m.max(), 1)
        region = {"south_deg": -6.502, "north_deg": -6.498, "west_deg": 39.998, "east_deg": 40.002}
        craters = self.client.features("landing", region, smallest_m=5)
        self.assertGreater(len(craters), 10)
        self.assertTrue((np.diff(craters.diameter_m) <= 0).all() and craters.diameter_m.min() >= 5)
        self.assertTrue((craters.depth_m > 0).all() and (np.abs(craters.lat_deg + 6.5) <= 0.002).all())
        np.testing.assert_array_equal(craters.depth_over_diameter, craters.depth_m / craters.diameter_m)
        self.assertTrue((craters.visibility > 0).all() and craters.depth_over_diameter.min() >= 0.02)
        every = self.client.features("landing", region, smallest_m=5, min_depth_over_diameter=0)
        self.assertLessEqual(set(craters.id), set(every.id))
        rocks = self.client.features("landing", region, kind="rocks", smallest_m=0.5)
        self.assertGreater(len(rocks), 0)
        self.assertEqual(len(self.client.features("landing", region, kind="rocks", smallest_m=1e4)), 0)
        self.assertEqual(len(set(rocks.id)), len(rocks))

    def test_more_points_than_a_request_holds(self):
        count = 2 * selenograph.POINTS_AT_ONCE + 7  # more than --max-rays
        lat = np.linspace(-7, -6, count)
        heights = self.client.heights(lat, 40.0)
        self.assertEqual(heights.shape, (count,))
        np.testing.assert_array_equal(heights.lat_deg, lat)
        np.testing.assert_array_equal(heights.height_m[::5000], self.client.heights(lat[::5000], 40.0).height_m)
        lat[selenograph.POINTS_AT_ONCE + 3] = 91
        with self.assertRaises(Refused) as caught:
            self.client.heights(lat, 40.0)
        self.assertEqual(caught.exception.pointers, [f"/points/{selenograph.POINTS_AT_ONCE + 3}/lat_deg"])
        self.assertEqual(self.client.heights([], []).shape, (0,))


class RandomViews(WithClient):
    def test_poses_suns_and_data(self):
        request = {**frame_request(width=40, height=30), "detail": None}
        request = {name: value for name, value in request.items() if name not in ("pose", "sun", "detail")}
        region = {"south_deg": -6.9, "north_deg": -6.1, "west_deg": 39.6, "east_deg": 40.4}
        asked = dict(region=region, altitude_m=(3000, 20000), off_nadir_deg=(10, 50), sun_elevation_deg=(8, 40), seed=5)
        views = list(selenograph.random_views(self.client, request, 12, **asked))
        again = list(selenograph.random_views(self.client, request, 12, **asked))
        self.assertEqual(json.dumps(views), json.dumps(again))
        self.assertEqual([view["name"] for view in views], [f"{i:06d}" for i in range(12)])
        noisy = selenograph.random_views(self.client, {**request, "sensor": {"seed": 1}}, 2, **asked)
        self.assertEqual([view["sensor"] for view in noisy], [{"frame": 0, "seed": 1}, {"frame": 1, "seed": 1}])
        for view in views:
            frame = self.client.frame({**{k: v for k, v in view.items() if k != "name"},
                                       "products": ["geodetic", "angles", "range"]})
            lat_deg, lon_deg, height_m = frame["geodetic"][15, 20]
            self.assertTrue(region["south_deg"] - 0.1 < lat_deg < region["north_deg"] + 0.1, lat_deg)
            self.assertTrue(region["west_deg"] - 0.1 < lon_deg < region["east_deg"] + 0.1, lon_deg)
            target = view["pose"]["look_at"]
            camera = np.array(view["pose"]["position_m"])
            up = position_of({"geodetic": {"lat_deg": target["lat_deg"], "lon_deg": target["lon_deg"],
                                            "height_m": target["height_m"]}})
            way = camera - up
            up = up / np.linalg.norm(up)
            self.assertTrue(3000 <= way @ up <= 20000.001)
            off_nadir_deg = math.degrees(math.acos(way @ up / np.linalg.norm(way)))
            self.assertTrue(9.99 <= off_nadir_deg <= 50.01, off_nadir_deg)
            self.assertTrue(8 <= view["sun"]["local"]["elevation_deg"] <= 40)
            self.assertEqual(frame.meta["missing_fraction"], 0)
        with self.assertRaisesRegex(ValueError, "without data"):
            nowhere = {"south_deg": 50, "north_deg": 51, "west_deg": 100, "east_deg": 101}
            list(selenograph.random_views(self.client, request, 2, **{**asked, "region": nowhere}))
        with self.assertRaisesRegex(ValueError, "off_nadir_deg"):
            list(selenograph.random_views(self.client, request, 1, **{**asked, "off_nadir_deg": (0, 90)}))

    def test_a_lens_sees_the_same_in_any_words(self):
        """At the border of the terrain, where the middle of an image has data and its rim has not."""
        asked = dict(region={"south_deg": -5.3, "north_deg": -5.1, "west_deg": 39.8, "east_deg": 40.2},
                     altitude_m=(8000, 12000), seed=2)
        lenses = ({"fov_deg": 2 * math.degrees(math.atan(0.5))}, {"fx": 256}, {"fx": 256, "fy": 256, "cx": 127.5},
                  {"focal_length_mm": 10, "pixel_pitch_um": 10000 / 256})
        size = {"width": 256, "height": 256}
        views = [list(selenograph.random_views(self.client, {"camera": {**size, **lens}}, 4, **asked))
                 for lens in lenses]
        for lens, some in zip(lenses, views):
            self.assertEqual([view["pose"] for view in some], [view["pose"] for view in views[0]], lens)
            for view in some:
                frame = self.client.frame({"camera": view["camera"], "pose": view["pose"], "products": ["depth"]})
                self.assertEqual(frame.meta["missing_fraction"], 0)

    def test_a_camera_preset(self):
        asked = dict(region={"south_deg": -6.9, "north_deg": -6.1, "west_deg": 39.6, "east_deg": 40.4},
                     altitude_m=(3000, 20000))
        view, = selenograph.random_views(self.client, {"camera_preset": "navigation-camera"}, 1, **asked)
        frame = self.client.frame({"camera_preset": "navigation-camera", "pose": view["pose"], "products": ["depth"]})
        self.assertEqual(frame.meta["missing_fraction"], 0)
        with self.assertRaisesRegex(ValueError, 'neither "camera" nor "camera_preset"'):
            next(selenograph.random_views(self.client, {"cameras": {"left": {}}}, 1, **asked))


class Maps(WithClient):
    def test_a_map(self):
        bounds = {"south_deg": -6.6, "north_deg": -6.4, "west_deg": 40.0, "east_deg": 40.3}
        request = {"map": {"projection": "equirectangular", "bounds": bounds, "gsd_m": 200}, "products": ["height", "lit"],
                   "sun": request_at(0)["sun"]}
        picture = self.client.map(request)
        self.assertEqual(set(picture), {"height", "lit"})
        rows, columns = picture["height"].shape
        self.assertTrue(25 < rows < 35 and 40 < columns < 50, (rows, columns))  # 6.1 km by 9.1 km
        # Row 0 in the north.
        northern = self.client.heights(-6.4, 40.15).height_m
        southern = self.client.heights(-6.6, 40.15).height_m
        middle = picture["height"][:, columns // 2]
        self.assertLess(abs(middle[0] - northern), abs(middle[0] - southern))
        self.assertTrue(picture.etag and picture.meta["request"])
        self.assertIn("geotransform", json.dumps(picture.meta))
        tiff = self.client.encoded({**request, "products": ["height"]}, "image/tiff")
        self.assertEqual(tiff.media_type, "image/tiff")


    def test_horizons_and_the_light_above_them(self):
        places = {"places": [{"lat_deg": -6.5, "lon_deg": 40}, {"lat_deg": -6.4, "lon_deg": 40.1}],
                  "horizon": {"azimuths": 16, "farthest_km": 5}}
        found = self.client.horizons(places)
        self.assertEqual(found["elevation_deg"].shape, (16, 2))
        self.assertEqual(found.meta["request"]["horizon"]["farthest_km"], 5)
        light = self.client.illumination({**places, "from_utc": "2026-11-20T00:00:00Z", "to_utc": "2026-11-21T00:00:00Z"})
        self.assertEqual(light["sun"].shape, (25, 2))
        np.testing.assert_allclose(light["sun_mean"], light["sun"].mean(axis=0), atol=1e-6)


class Async(unittest.TestCase):
    def run_with_client(self, work):
        async def all_of_it():
            async with AsyncClient(url()) as client:
                return await work(client)
        return asyncio.run(all_of_it())

    def test_methods_are_the_clients(self):
        here = {name for name, member in vars(Client).items() if callable(member) and not name.startswith("_")}
        self.assertEqual({name for name in vars(AsyncClient) if not name.startswith("_")}, here)

    def test_calls(self):
        async def work(client):
            with Client(url()) as plain:
                frame, heights, catalogue, answer = await asyncio.gather(
                    client.frame(request_at(0)), client.heights([-6.5], [40]), client.datasets(),
                    client.encoded(request_at(0), "application/x-npz"))
                self.assertEqual(frame.etag, plain.frame(request_at(0)).etag)
                self.assertEqual(heights, plain.heights([-6.5], [40]))
                self.assertEqual(catalogue, plain.datasets())
                self.assertEqual(answer.content, plain.encoded(request_at(0), "application/x-npz").content)
                rays = await client.rays([3e6, 0, 0], [-1, 0.0, 0], sun=request_at(0)["sun"])
                self.assertFalse(rays.hit)
                request = request_at(0)
                points = await client.project(request["camera"], request["pose"], [[-6.5, 40]])
                self.assertTrue(points.in_frame[0])
                with self.assertRaises(Refused):
                    await client.frame({})
        self.run_with_client(work)

    def test_frames_of_any_iterable_in_order(self):
        async def work(client):
            etags = [(await client.frame(request_at(step))).etag for step in range(6)]
            requests = [request_at(step) for step in range(6)]

            async def later():
                for request in requests:
                    await asyncio.sleep(0)
                    self.assertIs(threading.current_thread(), threading.main_thread())
                    yield request

            for in_flight in (1, 3):
                for some in (requests, iter(requests), later()):
                    got = [frame.etag async for frame in client.frames(some, in_flight)]
                    self.assertEqual(got, etags)
        self.run_with_client(work)

    def test_leaving_early_leaves_nothing_behind(self):
        async def work(client):
            async def for_ever():
                step = 0
                while True:
                    yield request_at(step % 5)
                    step += 1
            frames = client.frames(for_ever())
            async for _ in frames:
                break
            await frames.aclose()
        self.run_with_client(work)


class TheService(WithClient):
    def test_a_service_that_closes_silent_connections(self):
        service = Service("--idle-timeout-s", "0.1", cache="impatient")
        with Client(f"http://{service.host}:{service.port}") as client:
            client.datasets()
            connection, = client._connections._idle
            # The service's FIN: nothing to read, and no more to come.
            connection.sock.settimeout(PATIENCE_S)
            self.assertEqual(connection.sock.recv(1, socket.MSG_PEEK), b"")
            self.assertEqual(len(client.datasets()["datasets"]), 6)
        self.assertEqual(service.stop(), 0)

    def test_a_service_without_a_place_is_asked_again(self):
        service = Service("--max-frames", "1", "--max-waiting", "0", "--max-image-pixels", "16000000", "--deadline-s",
                          "3600", cache="busy")
        holding = service.start_frame(harness.long_frame() | {"pose": pose_at(0)})
        service.wait_for("selenograph_frames_in_work", 1)
        waits = []

        def let_go(wait_s):
            waits.append(wait_s)
            holding.close()

        with mock.patch("time.sleep", let_go):
            with Client(f"http://{service.host}:{service.port}", timeout_s=10000) as client:
                # The place is free some time after the connection was closed: more refusals may follow.
                self.assertIn("range", client.frame(request_at(0)))
        self.assertGreater(waits[0], 0)
        service.kill()


def python(*arguments, **options):
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **options.pop("environment", {})}
    return subprocess.run([sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          timeout=5 * PATIENCE_S, env=environment, **options)


class CommandLine(unittest.TestCase):
    def setUp(self):
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(harness.path())

    def command(self, *arguments):
        """(exit status, standard output, standard error); in this process, where starting one takes longer."""
        out, errors = io.StringIO(), io.StringIO()
        with mock.patch.dict(os.environ, {"SELENOGRAPH_URL": url()}):
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
                return selenograph.main(arguments), out.getvalue(), errors.getvalue()

    def test_module_is_executable(self):
        done = python("-m", "selenograph", "render", "-", "stdin.png", input=json.dumps(request_at(0, ["image"])),
                      environment={"PYTHONPATH": FOLDER, "SELENOGRAPH_URL": url()})
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        with open("stdin.png", "rb") as file:
            self.assertEqual(file.read(4), b"\x89PNG")
        done = python("-m", "selenograph", environment={"PYTHONPATH": FOLDER})
        self.assertEqual(done.returncode, 2)
        self.assertIn("usage: python3 -m selenograph", done.stderr)

    def test_render(self):
        request = request_at(0, ["image"])
        harness.write("request.json", request)
        for name, accept in (("out.npz", "application/x-npz"), ("out.png", "image/png"), ("out.tif", "image/tiff"),
                             ("out.npy", "application/x-npy")):
            code, said, _ = self.command("render", "request.json", name)
            self.assertEqual(code, 0)
            with open(name, "rb") as file:
                content = file.read()
            self.assertEqual(content, OneService.service.frame(request, accept)[2], name)
            self.assertRegex(said, rf"^{name}: {len(content)} bytes; ms: .*(visibility|touch|nothing)")

    def test_warnings_are_printed(self):
        border = Pose.nadir(lat_deg=-4.9, lon_deg=40, height_m=9e4)
        harness.write("border.json", request_at(0, ["image"], pose=border))
        code, _, errors = self.command("render", "border.json", "border.png")
        self.assertEqual(code, 0)
        self.assertRegex(errors, r"border.png: warning: [\d.]+ % of the pixels look at the Moon where there is no data")
        dark = Sun.local(lat_deg=-6.5, lon_deg=40, azimuth_deg=90, elevation_deg=-40)
        harness.write("dark.json", request_at(0, ["image"], sun=dark))
        self.assertIn("dark.npz: warning: no signal", self.command("render", "dark.json", "dark.npz")[2])

    def test_errors_print_one_message_and_leave_no_file(self):
        harness.write("broken.json", "{")
        harness.write("bad.json", request_at(0, ["range"], camera={}))
        for arguments, words in ((("render", "broken.json", "no.npz"), "broken.json: no JSON"),
                                 (("render", "bad.json", "no.npz"), "422.*\n  /camera/width: is required"),
                                 (("render", "bad.json", "no.bmp"), "no.bmp: the suffix says the format"),
                                 (("render", "missing.json", "no.npz"), "missing.json"),
                                 (("render", "bad.json", "no.npz", "--url", "moon"), "write for example http://"),
                                 (("watch", "missing.csv", "--out", "no"), "missing.csv")):
            code, _, errors = self.command(*arguments)
            self.assertEqual(code, 1)
            self.assertRegex(errors, "^selenograph: .*" + words)
        self.assertEqual([name for name in os.listdir() if name.startswith("no")], [])

    def test_watch(self):
        harness.write("watched.csv", "time_s,lat_deg,lon_deg,height_m,up_azimuth_deg\n"
                "0,-6.5,40,20000,0\n1,-6.48,40,20000,0\n2,-6.46,40,20000,0\n")
        code, said, errors = self.command("watch", "watched.csv", "--out", "frames", "--step-s", "0.5")
        self.assertEqual(code, 0, errors)
        self.assertIn("30 degrees high", errors)
        lines = said.splitlines()
        self.assertEqual(len(lines), 5)
        for i, line in enumerate(lines):
            self.assertRegex(line, rf"^frames/{i:05d}.npz  t = {i / 2:.3f} s  ms: ")
            frame = np.load(f"frames/{i:05d}.npz")
            self.assertEqual(frame["radiance"].shape, (512, 512))
            self.assertGreater(frame["radiance"].max(), 0)

        common = request_at(0, ["image"])
        harness.write("common.json", common)
        code, _, errors = self.command("watch", "watched.csv", "--out", "pictures", "--request", "common.json",
                                       "--format", "png")
        self.assertEqual((code, errors), (0, ""))
        self.assertEqual(sorted(os.listdir("pictures")), [f"{i:05d}.png" for i in range(3)])
        pose = Trajectory.from_csv("watched.csv").at(0)
        with open("pictures/00000.png", "rb") as file:
            self.assertEqual(file.read(), OneService.service.frame({**common, "pose": pose}, "image/png")[2])

    def test_steps_end_with_the_trajectory(self):
        """Where the quotient or the product of floating-point numbers lies an ulp beside a whole number of steps."""
        harness.write("small.json", request_at(0, ["range"]))
        for end_s, step_s, count in ((0.3, "0.1", 4), (0.7, "0.1", 8), (0.25, "0.1", 3), (0.2, "1", 1)):
            harness.write("steps.csv", "time_s,lat_deg,lon_deg,height_m,up_azimuth_deg\n"
                          f"0,-6.5,40,20000,0\n{end_s},-6.48,40,20000,0\n")
            code, said, errors = self.command("watch", "steps.csv", "--out", "steps", "--request", "small.json",
                                              "--step-s", step_s)
            self.assertEqual((code, errors), (0, ""))
            self.assertEqual(len(said.splitlines()), count)
        for step_s in ("-1", "0", "nan", "inf"):
            code, said, errors = self.command("watch", "steps.csv", "--out", "steps", "--step-s", step_s)
            self.assertEqual((code, said), (1, ""))
            self.assertRegex(errors, f"--step-s is {step_s}; seconds above 0 are needed")

    def test_watch_an_oem(self):
        lines = [f"2026-11-20T12:00:{t:02d} 1336 1121 {-199 + 0.16 * t} 0 0 0.16" for t in (0, 10, 20, 30)]
        harness.write("track.oem", "CCSDS_OEM_VERS = 2.0\nMETA_START\nCENTER_NAME = MOON\nREF_FRAME = MOON_ME\n"
                "TIME_SYSTEM = UTC\nMETA_STOP\n" + "\n".join(lines) + "\n")
        code, _, errors = self.command("watch", "track.oem", "--out", "track")
        self.assertEqual(code, 0, errors)
        meta = json.loads(bytes(np.load("track/00003.npz")["meta.json"]))
        self.assertIn("sun", meta["request"])
        self.assertAlmostEqual(meta["request"]["pose"]["position_m"][2], -199000 + 4800, 6)


class Examples(unittest.TestCase):
    def lines(self, name, *arguments):
        # The terrain is coarser here than quickstart's: the service may warn of that.
        done = python(os.path.join(FOLDER, "examples", name), url(), *arguments, cwd=harness.path(),
                      environment={"PYTHONWARNINGS": "ignore::UserWarning"})
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return done.stdout.splitlines()

    def test_one_frame(self):
        radiance, ground, lit, detail, took = self.lines("one_frame.py", "one.npz")
        self.assertRegex(radiance, r"^radiance up to \d+\.\d W m-2 sr-1$")
        near, far = map(float, re.findall(r"[\d.]+", ground))
        self.assertTrue(38 < near < far < 120, ground)
        self.assertTrue(50 < float(lit.split()[0]) < 100, lit)
        self.assertIn("level of detail within", detail)
        self.assertRegex(took, r"^visibility took \d+\.\d ms$")
        self.assertEqual(set(np.load(harness.path("one.npz"))), {"radiance", "range", "lit"})

    def test_descent(self):
        lines = self.lines("descent.py")
        self.assertEqual(len(lines), 20)
        ranges = [float(re.search(r"([\d.]+) m to the site", line)[1]) for line in lines]
        self.assertEqual(ranges, sorted(ranges, reverse=True))
        self.assertTrue(35000 < ranges[0] < 50000 and 2000 < ranges[-1] < 5000, ranges)

    def test_lidar_line(self):
        *shots, last = self.lines("lidar_line.py")
        self.assertEqual(len(shots), 20)
        for shot in shots:
            lat, range_m, height_m = map(float, re.findall(r"-?\d+\.\d+", shot))
            self.assertAlmostEqual(range_m + height_m, 15000, 2)
            _, _, body = OneService.service.ask("GET", f"/v1/height?lat_deg={lat}&lon_deg=40")
            self.assertLess(abs(json.loads(body)["height_m"] - height_m), 3)  # four digits of a latitude: 3 m
        self.assertIn("200 of 200 shots returned", last)


class FromSpice(unittest.TestCase):
    """examples/from_spice.py: a camera 20 km above 6.5 S 40 E that looks straight down, north up; the Sun 30 degrees high."""

    def setUp(self):
        lat, lon = math.radians(-6.5), math.radians(40)
        up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
        east = np.array([-math.sin(lon), math.cos(lon), 0])
        self.camera_from_moon = np.array([east, np.cross(east, up), -up])  # rows: right, down, boresight
        self.position_km = (1737.4 + 20) * up
        self.sun_km = 0.99 * 149597870.7 * (0.5 * up + math.sqrt(0.75) * east)

    def check(self, *path):
        done = python(os.path.join(FOLDER, "examples", "from_spice.py"), self.kernel, "LANDER", "CAMERA", "2026-11-20T06:00:00",
                      url(), "spice.png", cwd=harness.path(),
                      environment={"PYTHONWARNINGS": "ignore::UserWarning", "PYTHONPATH": os.pathsep.join(path)})
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        boresight, sun = done.stdout.splitlines()
        lat, lon = map(float, re.findall(r"-?\d+\.\d+", boresight))
        self.assertAlmostEqual(lat, -6.5, 3)
        self.assertAlmostEqual(lon, 40, 3)
        self.assertAlmostEqual(float(re.search(r"[\d.]+", sun)[0]), 30, delta=0.02)
        with open(harness.path("spice.png"), "rb") as file:
            self.assertTrue(file.read().startswith(b"\x89PNG"))

    def test_what_it_makes_of_spices_answers(self):
        """By a stand-in with the four functions that the example calls."""
        self.kernel = "kernels.tm"
        os.makedirs(harness.path("stand-in"), exist_ok=True)
        harness.write("stand-in/spiceypy.py", f"""
def furnsh(kernel): assert kernel == "kernels.tm"
def str2et(utc): return {{"2026-11-20T06:00:00": 848426469.18}}[utc]
def spkpos(target, et, frame, correction, observer):
    assert (et, frame, observer) == (848426469.18, "MOON_ME", "MOON")
    return {{("LANDER", "NONE"): {self.position_km.tolist()}, ("SUN", "LT+S"): {self.sun_km.tolist()}}}[target, correction], 0.0
def pxform(source, target, et):
    assert (source, target) == ("MOON_ME", "CAMERA")
    return {self.camera_from_moon.tolist()}
""")
        self.check(harness.path("stand-in"))

    @unittest.skipUnless(importlib.util.find_spec("spiceypy"), "spiceypy is not installed")
    def test_it_reads_kernels(self):
        import spiceypy

        numbers = lambda m: " ".join(f"{x:.15g}" for x in np.ravel(m))  # noqa: E731
        lines = ["KPL/FK", "\\begindata", "NAIF_BODY_NAME += 'LANDER'", "NAIF_BODY_CODE += -99999"]
        # A matrix turns the frame's vectors into J2000 and is listed by columns: those of the inverse are these rows.
        for name, code, centre, matrix in (("MOON_ME", 1400001, 301, np.eye(3)), ("CAMERA", 1400002, -99999, self.camera_from_moon)):
            lines += [f"FRAME_{name} = {code}", f"FRAME_{code}_NAME = '{name}'", f"FRAME_{code}_CLASS = 4",
                      f"FRAME_{code}_CLASS_ID = {code}", f"FRAME_{code}_CENTER = {centre}", f"TKFRAME_{code}_RELATIVE = 'J2000'",
                      f"TKFRAME_{code}_SPEC = 'MATRIX'", f"TKFRAME_{code}_MATRIX = ("]
            lines += [numbers(row) for row in matrix] + [")"]
        harness.write("frames.tf", "\n".join([*lines, "\\begintext", ""]))
        harness.write("leap.tls", "\n".join([
            "KPL/LSK", "\\begindata", "DELTET/DELTA_T_A = 32.184", "DELTET/K = 1.657D-3", "DELTET/EB = 1.671D-2",
            "DELTET/M = ( 6.239996 1.99096871D-7 )", "DELTET/DELTA_AT = ( 37, @2017-JAN-1 )", "\\begintext", ""]))
        handle = spiceypy.spkopn(harness.path("all.bsp"), "test", 0)
        for body, centre, place_km in ((301, 0, np.zeros(3)), (10, 0, self.sun_km), (-99999, 301, self.position_km)):
            states = [[*place_km, 0, 0, 0]] * 2
            spiceypy.spkw08(handle, body, centre, "J2000", 8e8, 9e8, str(body), 1, 2, states, 8e8, 1e8)
        spiceypy.spkcls(handle)
        names = ", ".join(f"'{harness.path(name)}'" for name in ("leap.tls", "frames.tf", "all.bsp"))
        self.kernel = harness.write("kernels.tm", f"KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ( {names} )\n\\begintext\n")
        self.check()


class FromOpenCv(unittest.TestCase):
    @unittest.skipUnless(cv2, "python3-opencv is not installed")
    def test_the_pages_block_agrees_with_opencv(self):
        with open(os.path.join(FOLDER, "geometry.md")) as file:
            block, cahvor, _ = re.findall(r"^```python\n(.*?)^```", file.read(), re.M | re.S)
        page = {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", selenograph.FrameWarning)
            exec(block.replace("http://127.0.0.1:8080", url()), page)
        position = page["frame"]["position"]
        rows, columns = np.mgrid[20:500:60, 20:500:60]
        points = position[rows, columns].reshape(-1, 3)
        self.assertTrue(np.isfinite(points).all())
        pixels, _ = cv2.projectPoints(points, page["rvec"], page["tvec"], page["camera_matrix"], page["dist_coeffs"])
        np.testing.assert_allclose(pixels[:, 0, 0], columns.ravel(), atol=2e-3)
        np.testing.assert_allclose(pixels[:, 0, 1], rows.ravel(), atol=2e-3)
        exec(cahvor, page)  # its numbers: python_trajectory_test.py; the third block runs in python_kernels_test.py
        self.assertIn("cahvor", page["camera"])


class Readme(unittest.TestCase):
    def test_its_python_runs(self):
        blocks = []
        for page in ("README.md", "loops.md"):
            with open(os.path.join(FOLDER, page)) as file:
                blocks += re.findall(r"^```python\n(.*?)^```", file.read(), re.M | re.S)
        self.assertGreater(len(blocks), 2)
        said = io.StringIO()
        here = os.getcwd()
        self.addCleanup(os.chdir, here)
        os.chdir(harness.path())
        namespace = {"__name__": "readme"}
        with contextlib.redirect_stdout(said), warnings.catch_warnings():
            warnings.simplefilter("ignore", selenograph.FrameWarning)  # the terrain is coarser here than quickstart's
            for block in blocks:
                exec(block.replace("http://127.0.0.1:8080", url()), namespace)
        namespace["client"].close()
        arrivals = said.getvalue().splitlines()[1:-6]  # those over the faulty link, of 8 frames
        self.assertTrue(all(re.match(r"[0-7] (intact|late|repeated|torn|frozen) ", line) for line in arrivals), arrivals)
        self.assertGreater(len(arrivals), 3)
        self.assertLess(namespace["state"]["height_m"], 5000)

    def test_a_campaign_is_planned(self):
        """deploy/examples/flights.py of deploy/campaigns/campaigns.md with fewer flights, three frames and a map of it."""
        with open(os.path.join(REPOSITORY, "deploy", "examples", "flights.py")) as file:
            program = file.read()
        self.addCleanup(os.chdir, os.getcwd())
        os.makedirs(harness.path("campaign"))
        os.chdir(harness.path("campaign"))
        plan = {}
        exec(program.replace("http://127.0.0.1:8080", url()).replace("FLIGHTS = 200", "FLIGHTS = 2"), plan)
        plan["client"].close()
        with open("flights.jsonl") as file:
            lines = [json.loads(line) for line in file]
        self.assertEqual([line["name"] for line in lines], ["000-0", "000-1", "000-2", "001-0", "001-1", "001-2"])
        harness.write("campaign/three.jsonl", "".join(json.dumps(line) + "\n" for line in lines[:3]))
        options = ["--dem", harness.path("dem"), "--cache-dir", harness.path("cache"), "--assets-dir",
                   os.path.join(REPOSITORY, "deploy", "assets")]
        for command in (["batch", "three.jsonl", "-o", "frames"], ["ask", "maps", "maps/001.json", "-o", "maps/001.npz"]):
            done = harness.run(*command, *options)
            self.assertEqual(done.returncode, 0, done.stderr)
        for line in lines[:3]:
            with open(f"frames/{line['name']}.npz", "rb") as file:
                frame = harness.arrays_of(file.read())
            region = line["sensor"]["exposure"]["metering"]["region"]
            rows, columns = (slice(region[c], region[c] + region[size]) for c, size in (("y", "height"), ("x", "width")))
            # The metered mean is half of the largest number; the site, in the middle of the region, is where it looks.
            self.assertAlmostEqual(frame["image"][rows, columns].mean() / 4095, 0.5, delta=0.02)
            x, y, z = frame["position"][rows, columns][24, 24]
            self.assertAlmostEqual(math.degrees(math.asin(z / math.hypot(x, y, z))), -6.5, delta=0.002)
            self.assertEqual(frame["meta"]["request"]["camera"]["cahvor"]["R"], [0, -0.05, 0.01])
            self.assertLess(frame["meta"]["exposure"]["integration_time_s"], 0.01)
        with open("maps/001.npz", "rb") as file:
            self.assertEqual(harness.arrays_of(file.read())["meta"]["request"]["map_error"]["seed"], 1)

    def test_its_links_and_those_of_the_conventions_lead_somewhere(self):
        clients = os.path.dirname(FOLDER)
        for page in ("README.md", "conventions.md", os.path.join("python", "README.md"),
                     os.path.join("python", "loops.md"), os.path.join("python", "geometry.md")):
            with open(os.path.join(clients, page)) as file:
                links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", file.read())
            for link in (link for link in links if not link.startswith("https://")):
                self.assertTrue(os.path.exists(os.path.join(clients, os.path.dirname(page), link)), (page, link))

    def test_the_frames_of_the_conventions_differ(self):
        pictures = os.path.join(os.path.dirname(FOLDER), "pictures")
        copied = harness.path("pictures-again")
        os.makedirs(os.path.join(copied, "pictures"))
        shutil.copy(os.path.join(pictures, "wrong_attitudes.py"), os.path.join(copied, "pictures"))
        done = python(os.path.join(copied, "pictures", "wrong_attitudes.py"), url(), environment={"PYTHONPATH": FOLDER})
        self.assertEqual(done.returncode, 0, done.stderr)
        drawn = set()
        for name in ("right", "conjugate", "xyzw", "opengl"):
            self.assertLess(os.path.getsize(os.path.join(pictures, f"{name}.png")), 60000)
            with open(os.path.join(copied, "pictures", f"{name}.png"), "rb") as file:
                drawn.add(file.read())
        self.assertEqual(len(drawn), 4)


class Package(unittest.TestCase):
    def test_public_names(self):
        """Those of `import *`, and those that the guides and other programs import by name."""
        starred = {}
        exec("from selenograph import *", starred)
        self.assertEqual(sorted(set(starred) - {"__builtins__"}), [
            "Answer", "Arrival", "AsyncClient", "Camera", "Client", "Frame", "FrameWarning", "Kernels", "Link", "Pose",
            "Refused", "Scan", "Sun", "Trajectory", "coco_of", "random_views", "write_coco"])
        for name in ("DEFAULT_URL", "DIRECTIONS", "FRAMES", "INERTIAL", "MEDIA_TYPES", "MOON_RADIUS_M", "MOST_AHEAD",
                     "NEED_SUN", "POINTS_AT_ONCE", "REASONS", "REGION_DEG", "ROWS_AT_ONCE", "Request", "Vector",
                     "__version__", "main"):
            self.assertTrue(hasattr(selenograph, name), name)

    def test_it_is_python_3_9(self):
        package = glob.glob(os.path.join(FOLDER, "selenograph", "*.py"))
        examples = glob.glob(os.path.join(FOLDER, "examples", "*.py"))
        self.assertGreater(len(package), 20)
        self.assertEqual(len(examples), 5)
        for source in package + examples:
            with open(source, encoding="utf-8") as file:
                tree = ast.parse(file.read(), feature_version=(3, 9))
            self.assertTrue(ast.get_docstring(tree), source)
        with self.assertRaises(SyntaxError):  # the parser does look at the version
            ast.parse("match x:\n  case 1: pass", feature_version=(3, 9))

    def test_it_is_the_services_version(self):
        said = subprocess.run([BINARY, "--version"], check=True, capture_output=True, text=True).stdout
        self.assertIn(selenograph.__version__, said.split())


if __name__ == "__main__":
    harness.main()
