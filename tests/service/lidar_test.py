#!/usr/bin/env python3
"""POST /v1/lidar over HTTP and `selenograph ask lidar`; arrays of /v1/rays and /v1/project both ways."""

import io
import json
import os
import sys

import numpy as np

import harness
from harness import arrays_of, path, Service, tearDownModule, WithService

sys.path.insert(0, os.path.join(harness.REPOSITORY, "api", "clients", "python"))
from selenograph import Client, Refused  # noqa: E402

INSTRUMENT = {"divergence_mrad": 2.0, "pulse_length_ns": 4.0, "wavelength_um": 1.064, "threshold": 5, "range_gate_m": [10, 5000],
              "dark_count_hz": 1e5,
              "receiver": {"signal": "photon_counting", "energy_j": 1e-6, "aperture_m": 0.1, "efficiency": 0.2}}
PLACE = {"lat_deg": 0.1, "lon_deg": 30.1}
NPZ = "application/x-npz"
ground_m = 0.0


def setUpModule():
    global ground_m
    harness.set_up()
    harness.sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    service = Service()
    ground_m = json.loads(service.ask("GET", "/v1/height?lat_deg=0.1&lon_deg=30.1")[2])["height_m"]
    service.expect_clean_stop()


def request(**changes):
    body = {"instrument": INSTRUMENT, "seed": 7, "detail": "landing",
            "pattern": {"scan": "flash", "columns": 24, "rows": 16, "fov_x_deg": 20},
            "pose": {"geodetic": {**PLACE, "height_m": ground_m + 100}, "nadir": {"up_azimuth_deg": 0}}}
    return {name: value for name, value in {**body, **changes}.items() if value is not None}


def npz(**arrays):
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


class Lidar(WithService):
    options = ("--assets-dir", os.path.join(harness.REPOSITORY, "deploy", "assets"), "--max-lidar-rays", "200000")

    def ask_npz(self, where, body, accept=NPZ):
        return self.service.ask("POST", where, body, {"Content-Type": NPZ, "Accept": accept})

    def test_a_scan_and_its_truth(self):
        answer = self.service.arrays(request(), "/v1/lidar")
        beams = 24 * 16
        self.assertEqual(answer["meta"]["shape"], [16, 24])
        for name in ("range_m", "true_range_m", "intensity", "count", "velocity_m_s", "object", "rock"):
            self.assertEqual(answer[name].shape, (beams,), name)
        self.assertEqual(answer["direction"].shape, (beams, 3))
        self.assertTrue(((answer["true_range_m"] > 80) & (answer["true_range_m"] < 130)).all())
        found = (answer["count"] > 0) & ~answer["false_alarm"]
        self.assertGreater(found.mean(), 0.95)
        error = (answer["range_m"] - answer["true_range_m"])[found]
        several = answer["true_count"][found] > 1
        # The strongest that was counted may be another than the strongest.
        sigma = answer["true_width_m"][found] / np.sqrt(answer["true_intensity"][found])
        self.assertAlmostEqual(np.std((error / sigma)[~several]), 1, delta=0.15)
        self.assertTrue((answer["velocity_m_s"][found] == 0).all())

    def test_craters_are_those_of_features(self):
        scan = self.service.arrays(request(craters={"smallest_m": 2}), "/v1/lidar")
        self.assertNotIn("crater", self.service.arrays(request(), "/v1/lidar"))
        region = {"south_deg": 0.096, "north_deg": 0.104, "west_deg": 30.096, "east_deg": 30.104}
        listed = self.ok_json(self.service.post("/v1/features", {"detail": "landing", "region": region, "smallest_m": 2},
                                                "application/json"))["craters"]
        self.assertGreater(np.count_nonzero(scan["crater"]), 20)
        ups = np.array([[np.cos(np.radians(c["lat_deg"])) * np.cos(np.radians(c["lon_deg"])),
                         np.cos(np.radians(c["lat_deg"])) * np.sin(np.radians(c["lon_deg"])),
                         np.sin(np.radians(c["lat_deg"]))] for c in listed])
        radii = np.array([c["diameter_m"] / 2 for c in listed])
        places = scan["origin_m"] + scan["true_range_m"][:, None] * scan["direction"]
        compared = 0
        for place, crater in zip(places, scan["crater"]):
            away = np.linalg.norm(place / np.linalg.norm(place) - ups, axis=1) * 1737400 - radii
            if (np.abs(away) < 0.3 * radii).any():
                continue  # where a rim may be, which is no circle
            compared += 1
            inside = np.flatnonzero(away < 0)
            smallest = listed[inside[radii[inside].argmin()]]["id"] if len(inside) else None
            self.assertEqual(f"{crater:016x}" if crater else None, smallest)
        self.assertGreater(compared, 50)

    def test_json_has_what_npz_has(self):
        small = request(pattern={"scan": "cone", "beams": 5, "half_angle_deg": 8}, motion={"velocity_m_s": [0, 0, -3]})
        arrays = self.service.arrays(small, "/v1/lidar")
        answer = self.ok_json(self.service.post("/v1/lidar", small, "application/json"))
        self.assertEqual(len(answer["returns"]), 5)
        for i, beam in enumerate(answer["returns"]):
            self.assertEqual(set(beam), set(arrays) - {"meta", "headers", "body"})
            self.assertEqual(beam["range_m"], arrays["range_m"][i])
            self.assertEqual(beam["direction"], arrays["direction"][i].tolist())
            self.assertEqual(beam["rock"], f"{arrays['rock'][i]:016x}" if arrays["rock"][i] else None)
        long = request(pattern={"scan": "flash", "columns": 1000, "rows": 101, "fov_x_deg": 20},
                       instrument=dict(INSTRUMENT, sub_rays=1))
        self.problem(self.service.post("/v1/lidar", long, "application/json"), 406)

    def test_pulses_as_arrays_are_those_of_a_list(self):
        directions = np.random.default_rng(1).normal([0, 0, 10], 1, (50, 3))
        times = np.linspace(0, 1, 50)
        motion = {"velocity_m_s": [1, 2, 3], "angular_rate_deg_s": [0, 1, 0]}
        document = request(pattern=None, motion=motion)
        listed = dict(document, pulses=[{"direction": d.tolist(), "time_s": t} for d, t in zip(directions, times)])
        by_list = self.service.arrays(listed, "/v1/lidar")
        body = npz(direction=directions, time_s=times, request=json.dumps(document))
        by_arrays = arrays_of(self.ok(self.ask_npz("/v1/lidar", body), NPZ))
        for name in ("range_m", "true_range_m", "direction", "time_s", "true_velocity_m_s"):
            np.testing.assert_array_equal(by_list[name], by_arrays[name], name)

    def test_the_presets_scan(self):
        for name, height_m in (("flash", 300), ("doppler", 1000), ("altimeter", 50000), ("landing-altimeter", 15000),
                               ("landing-altimeter", 1000), ("landing-altimeter", 3)):
            pose = {"geodetic": {**PLACE, "height_m": ground_m + height_m}, "nadir": {}}
            document = request(instrument=None, instrument_preset=name, pattern=None, pose=pose, detail=None)
            if name == "flash":
                document["pattern"] = {"scan": "flash", "columns": 32, "rows": 32, "fov_x_deg": 20}
            answer = self.service.arrays(document, "/v1/lidar")
            self.assertGreater((answer["count"] > 0).mean(), 0.95, name)
            self.assertEqual(answer["meta"]["warnings"], [], name)

    def test_a_scan_that_measures_nothing_says_so(self):
        far = dict(INSTRUMENT, range_gate_m=[500, 5000], dark_count_hz=0)
        (warning,) = self.service.arrays(request(instrument=far), "/v1/lidar")["meta"]["warnings"]
        self.assertIn("range_gate_m, 500 to 5000 m", warning)
        away = {"geodetic": {**PLACE, "height_m": ground_m + 100}, "look_at": {**PLACE, "height_m": ground_m + 1000}}
        answer = self.ok_json(self.service.post("/v1/lidar", request(pose=away), "application/json"))
        self.assertIn("no beam meets a surface", answer["meta"]["warnings"][0])

    def test_bad_instruments_are_told_by_their_member(self):
        huge = {"scan": "flash", "columns": 40000, "rows": 25000, "fov_x_deg": 20}
        self.problem(self.service.post("/v1/lidar", request(pattern=huge)), 422, "/pattern")
        own = dict(INSTRUMENT, pattern=huge)
        self.problem(self.service.post("/v1/lidar", request(pattern=None, instrument=own)), 422, "/instrument/pattern")
        self.problem(self.service.post("/v1/lidar", request(pattern=None)), 422, "/pattern")
        self.problem(self.service.post("/v1/lidar", request(instrument=None)), 422)
        self.problem(self.service.post("/v1/lidar", request(instrument_preset="none")), 422, "/instrument_preset")
        below = {"geodetic": {**PLACE, "height_m": ground_m - 50}, "nadir": {}}
        self.problem(self.service.post("/v1/lidar", request(pose=below)), 422, "/pose")
        dip = [(0, 100), (1, -50), (2, 100)]
        motion = {"poses": [{"time_s": t, "pose": {"geodetic": {**PLACE, "height_m": ground_m + above_m}, "nadir": {}}}
                            for t, above_m in dip]}
        buried = request(pose=None, motion=motion, pattern={"scan": "cone", "beams": 9, "half_angle_deg": 2, "rate_hz": 4})
        self.assertIn("after 0.5 s", self.problem(self.service.post("/v1/lidar", buried), 422, "/motion/poses")["detail"])
        short = request(pose=None, motion={"poses": [{"time_s": t, "pose": request()["pose"]} for t in (0, 0.5)]},
                        pattern={"scan": "cone", "beams": 3, "half_angle_deg": 5, "rate_hz": 1})
        self.problem(self.service.post("/v1/lidar", short), 422, "/motion/poses")

    def test_the_python_client(self):
        with Client(f"http://{self.service.host}:{self.service.port}") as client:
            scan = client.lidar(request())
            self.assertEqual(scan.shape, (16, 24))
            self.assertEqual(scan["direction"].shape, (16, 24, 3))
            np.testing.assert_array_equal(scan["range_m"].ravel(), self.service.arrays(request(), "/v1/lidar")["range_m"])
            on_ground = np.linalg.norm(scan.points_m("true_range_m"), axis=-1) - 1737400
            self.assertTrue((np.abs(on_ground - ground_m) < 20).all())
            few = client.lidar(request(pattern=None), directions=[[[0, 0, 1], [0.1, 0, 1]]], times_s=0.5)
            self.assertEqual(few["range_m"].shape, (1, 2))
            self.assertEqual(few["time_s"].tolist(), [[0.5, 0.5]])
            with self.assertRaises(Refused) as caught:
                client.lidar(request(pattern=None), directions=[[0, 0, 0]])
            self.assertEqual(caught.exception.pointers, ["/direction/0"])


class Arrays(WithService):
    options = Lidar.options
    ask_npz = Lidar.ask_npz

    def rays(self):
        position = np.array(self.service.arrays(request(), "/v1/lidar")["origin_m"][0])
        rng = np.random.default_rng(2)
        return position, -position / np.linalg.norm(position) + rng.normal(0, 0.1, (6, 7, 3))

    def test_rays_both_ways(self):
        origin, directions = self.rays()
        sun = {"local": {**PLACE, "azimuth_deg": 90, "elevation_deg": 20}}
        rest = {"detail": "landing", "sun": sun}
        answer = arrays_of(self.ok(self.ask_npz("/v1/rays", npz(origin_m=origin, direction=directions, request=json.dumps(rest))), NPZ))
        self.assertEqual((answer["range_m"].shape, answer["normal"].shape, answer["hit"].dtype), ((6, 7), (6, 7, 3), np.dtype(bool)))
        listed = [{"origin_m": origin.tolist(), "direction": d.tolist()} for d in directions.reshape(-1, 3)]
        by_list = self.ok_json(self.service.post("/v1/rays", {**rest, "rays": listed}, "application/json"))["rays"]
        for name in ("range_m", "position_m", "normal", "lit"):
            np.testing.assert_array_equal(answer[name].reshape(42, *answer[name].shape[2:]), [ray[name] for ray in by_list], name)
        self.assertEqual([f"{rock:016x}" if rock else None for rock in answer["rock"].ravel()], [ray.get("rock") for ray in by_list])
        # A list in, arrays out; deflated arrays in, a list out.
        out = self.service.arrays({**rest, "rays": listed}, "/v1/rays")
        np.testing.assert_array_equal(out["range_m"], answer["range_m"].ravel())
        file = io.BytesIO()
        np.savez_compressed(file, origin_m=origin[None], direction=np.asfortranarray(directions.astype("f4")), request=json.dumps(rest))
        deflated = self.ok_json(self.ask_npz("/v1/rays", file.getvalue(), "application/json"))["rays"]
        np.testing.assert_allclose([ray["range_m"] for ray in deflated], answer["range_m"].ravel(), atol=0.01)

    def test_landmarks_both_ways(self):
        rest = {"camera": {"width": 64, "height": 64, "fov_deg": 30.0}, "pose": request()["pose"]}
        points = np.array([[0.1, 30.1, np.nan], [0.1001, 30.1, ground_m], [0.1, 30.1, ground_m + 500], [60, 0, np.nan]])
        answer = arrays_of(self.ok(self.ask_npz("/v1/project", npz(points=points, request=json.dumps(rest))), NPZ))
        listed = [dict(zip(("lat_deg", "lon_deg", "height_m"), p if np.isfinite(p[2]) else p[:2])) for p in points.tolist()]
        by_list = self.ok_json(self.service.post("/v1/project", {**rest, "points": listed}, "application/json"))["points"]
        for name in ("x_px", "y_px", "range_m", "in_frame", "visible"):
            np.testing.assert_array_equal(answer[name], np.array([p[name] for p in by_list], answer[name].dtype), name)
        self.assertEqual(answer["reason"].tolist(), [0, 0, 3, 1])


if __name__ == "__main__":
    harness.main()
