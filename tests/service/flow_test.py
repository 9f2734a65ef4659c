#!/usr/bin/env python3
"""Optical flow: where each pixel's point is in another image of the same scene, and where it is hidden there."""

import math

import numpy as np

import harness
from harness import frame_request, sample, tearDownModule

WIDTH, HEIGHT, FOV_DEG = 96, 80, 40.0


OTHER = {"geodetic": {"lat_deg": 0.2, "lon_deg": 30.4, "height_m": 9000.0},
         "look_at": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 0.0, "up": "north"}}
# In shadow-free numbers: the finest posts are what rays meet, too.
FINEST = {"max_error_px": 0.0, "samples_per_pixel": 1}


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "512")
    Flow.service = harness.Service("--assets-dir", harness.assets())


class Flow(harness.unittest.TestCase):
    def frame(self, flow_to=OTHER, products=("position", "flow"), accuracy=FINEST, **changes):
        request = frame_request(products, width=WIDTH, height=HEIGHT, flow_to=flow_to, accuracy=accuracy, **changes)
        return self.service.arrays(request), request

    def camera_at(self, pose, **changes):
        """Position and attitude in MOON_ME, as the metadata of a frame from there have them."""
        frame = self.service.arrays(frame_request(("depth",), width=8, height=8, pose=pose, **changes))
        resolved = frame["meta"]["request"]["pose"]
        q = resolved["camera_from_moon"]
        return np.array(resolved["position_m"]), turned(q)

    def project(self, points, **changes):
        camera, points_of = frame_request()["camera"] | {"width": WIDTH, "height": HEIGHT}, []
        for lat, lon, height in points:
            points_of.append({"lat_deg": lat, "lon_deg": lon, "height_m": height})
        status, _, body = self.service.post("/v1/project", {"camera": camera, "points": points_of} | changes)
        self.assertEqual(status, 200, body[:500])
        return harness.json.loads(body)["points"]

    def test_hidden_where_a_ray_says_so(self):
        low = {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.5, "height_m": 1500.0}, "look_at": OTHER["look_at"]}
        frame, _ = self.frame(low)
        origin, _ = self.camera_at(low)
        way = frame["position"].reshape(-1, 3) - origin
        distance = np.linalg.norm(way, axis=1)
        rays = [{"origin_m": list(origin), "direction": list(w / d)} for w, d in zip(way, distance)]
        status, _, body = self.service.post("/v1/rays", {"rays": rays})
        self.assertEqual(status, 200, body[:500])
        met = np.array([hit["range_m"] for hit in harness.json.loads(body)["rays"]], dtype=float)
        hidden = ~(met > distance - 1e-3)
        self.assertGreater(hidden.mean(), 0.03)
        self.assertLess(hidden.mean(), 0.9)
        np.testing.assert_array_equal(np.isnan(frame["flow"][..., 0]).ravel(), hidden)

    def test_the_same_pose_moves_nothing(self):
        pose = frame_request()["pose"]
        frame, _ = self.frame(pose)
        self.assertFalse(np.isnan(frame["flow"]).any())
        self.assertLess(np.abs(frame["flow"]).max(), 1e-6)

    def test_objects_hide_and_are_followed(self):
        thing = {"mesh": "satellite", "scale": 200.0, "material": {}, "pose": {
            "geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 4000.0}, "upright": {"azimuth_deg": 30.0}}}
        with_it, _ = self.frame(products=("position", "flow", "object_id"), objects=[thing])
        without, _ = self.frame()
        on_it = with_it["object_id"] == 0
        self.assertTrue(np.isfinite(with_it["flow"][on_it, 0]).any())
        behind = np.isnan(with_it["flow"][..., 0]) & np.isfinite(without["flow"][..., 0]) & ~on_it
        self.assertTrue(behind.any())
        alone, _ = self.frame(products=("position", "flow", "object_id"), objects=[thing], terrain=False)
        np.testing.assert_array_equal(alone["flow"][on_it], with_it["flow"][on_it])

    def test_rows_of_a_rolling_shutter(self):
        shutter = {"line_time_s": 0.001, "velocity_m_s": [0.0, 1600.0, 0.0]}
        frame, _ = self.frame(products=("geodetic", "flow"), shutter=shutter)
        rows, columns = [5, 40, 70], [8, 50, 90]
        points = [frame["geodetic"][r, c] for r, c in zip(rows, columns)]
        landmarks = self.project(points, pose=OTHER, shutter=shutter)
        for r, c, landmark in zip(rows, columns, landmarks):
            if landmark["x_px"] is None or np.isnan(frame["flow"][r, c, 0]):
                continue
            self.assertAlmostEqual(c + frame["flow"][r, c, 0], landmark["x_px"], delta=1e-5)
            self.assertAlmostEqual(r + frame["flow"][r, c, 1], landmark["y_px"], delta=1e-5)

    def test_rocks_in_either_view(self):
        near = {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 0.0}, "nadir": {}}
        ground = harness.json.loads(self.service.post("/v1/heights", {"points": [{"lat_deg": 0.1, "lon_deg": 30.1}]})[2])
        height = ground["points"][0]["height_m"]
        near["geodetic"]["height_m"] = height + 60.0
        aside = {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.103, "height_m": height + 12.0},
                 "look_at": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": height, "up": "north"}}
        frame, _ = self.frame(aside, pose=near, detail="landing", accuracy={}, products=("position", "flow", "detail"))
        seen, on_rock = np.isfinite(frame["flow"][..., 0]), frame["detail"] == 3
        self.assertGreater(seen.mean(), 0.2)
        self.assertFalse(seen.all())
        self.assertTrue(seen[on_rock].any())
        self.assertFalse(seen[on_rock].all())  # sides that look away

    def test_files(self):
        for accept in ("application/x-npy", "image/x-exr", "image/tiff", "application/octet-stream"):
            self.assertEqual(self.service.post("/v1/frames", frame_request(("flow",), flow_to=OTHER), accept)[0], 200, accept)

    def test_refused(self):
        def member(**changes):
            status, _, body = self.service.post("/v1/frames", frame_request(("flow",), **changes), "application/x-npz")
            self.assertEqual(status, 422, body[:300])
            return harness.json.loads(body)["errors"][0]["pointer"]
        self.assertEqual(member(), "/flow_to")
        self.assertEqual(member(flow_to=OTHER, visibility="zbuffer"), "/visibility")
        buried = {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": -9000.0}, "nadir": {}}
        self.assertEqual(member(flow_to=buried), "/flow_to")


def turned(q):
    """The rotation matrix of a quaternion."""
    w, x, y, z = (q[k] for k in "wxyz")
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


if __name__ == "__main__":
    harness.main()
