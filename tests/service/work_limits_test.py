#!/usr/bin/env python3
"""Work that a request asks for ends with its deadline and with its client: sensors, lenses, verification, meshes."""

import copy
import os
import time

import harness
from harness import PRODUCTS, WithService, frame_request, tearDownModule

BAND = {"center_um": 0.65, "width_um": 0.3}
SENSOR = {
    "optics": {"f_number": 4.0, "point_spread": {"model": "none"}},
    "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.004, "gain_e_dn": 2.0},
}
# Room for a machine with other work; alone it is a third of this at most. ThreadSanitizer takes ten times as long.
LATE_S = 15 if "TSAN_OPTIONS" in os.environ else 1.5
SATELLITE = {"mesh": "satellite", "material": {"reflectance": {"model": "lambert"}},
             "pose": {"geodetic": {"lat_deg": 0.1, "lon_deg": 30.1, "height_m": 19990.0}, "upright": {"azimuth_deg": 0.0}}}


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "256")
    harness.assets()


def with_sensor(point_spread, f_number=4.0, pitch_um=5.5, motion=None, **changes):
    sensor = copy.deepcopy(SENSOR)
    sensor["optics"].update(f_number=f_number, point_spread=point_spread)
    sensor["detector"]["pixel_pitch_um"] = pitch_um
    if motion:
        sensor["motion"] = motion
    return frame_request(("image",), band=BAND, sensor=sensor, **changes)


LARGE = {"width": 4096, "height": 2048, "accuracy": {"max_error_px": 8}}
EVEN = {"model": "kernel", "kernel": [[1.0] * 65] * 65}
LENS = {"model": "pinhole", "width": 4096, "height": 2048, "fx": 900.0,
        "distortion": {"model": "brown_conrady", "k1": -0.21, "k2": 0.07, "k3": -0.01, "p1": 0.006, "p2": -0.004}}


class SmallMemoryTest(WithService):
    @classmethod
    def setUpClass(cls):
        harness.sample("fine", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "512")
        cls.service = harness.Service("--scene-mb", "16", dem="fine", cache="cache-fine")

    def test_refusals_name_members_of_their_own_request(self):
        """A map has no camera: what its refusal points at and advises is in a map's request."""
        area = {"projection": "orthographic", "center": {"lat_deg": 0.0, "lon_deg": 30.0}, "width_m": 2e5, "height_m": 2e5, "gsd_m": 2e5}
        asked = {"map": area, "products": ["height"], "accuracy": {"max_error_px": 0}}
        problem = self.problem(self.service.post("/v1/maps", asked), 422)
        self.assertEqual([e["pointer"] for e in problem["errors"]], ["/map/gsd_m"])
        self.assertIn("ask for a larger gsd_m or max_error_px", problem["detail"])
        high = {"geodetic": {"lat_deg": 0.0, "lon_deg": 30.0, "height_m": 2e5}, "nadir": {}}
        problem = self.problem(self.service.frame(frame_request(pose=high, accuracy={"max_error_px": 0})), 422)
        self.assertEqual([e["pointer"] for e in problem["errors"]], ["/accuracy/max_error_px"])


class WorkLimitsTest(WithService):
    @classmethod
    def setUpClass(cls):
        cls.options = ("--assets-dir", harness.path("assets"))
        super().setUpClass()

    def test_an_airy_disc_wider_than_its_kernel_is_refused(self):
        problem = self.problem(self.service.frame(with_sensor({"model": "airy"}, 1000.0, 1.0), "image/png"), 422)
        self.assertEqual([e["pointer"] for e in problem["errors"]],
                         ["/sensor/optics/f_number", "/sensor/detector/pixel_pitch_um", "/band"])
        self.assertIn("650", problem["errors"][0]["detail"])

    def late(self, ask, after_s, status=504):
        start = time.monotonic()
        self.problem(ask({"Request_Timeout_Ms": str(int(after_s * 1000))}), status)
        took = time.monotonic() - start
        self.assertLess(took, after_s + LATE_S)

    def test_deadlines_reach_everything(self):
        cases = {
            "kernel": (0.5, with_sensor(EVEN, **dict(LARGE, width=8192))),
            "motion": (1.0, with_sensor({"model": "none"}, motion={"angular_rate_deg_s": [1.0, 0, 0], "samples": 8}, **LARGE)),
            "lens": (1.5, frame_request(("range",), camera=LENS, accuracy={"max_error_px": 8})),
            # Memory that the system has not given before: the writer of the products waits for it.
            "products": (0.5, frame_request(PRODUCTS, 8192, 2048)),
            "samples": (1.5, frame_request(("radiance",), 1024, 1024, 36, visibility="raytrace")),
        }
        for name, (after_s, document) in cases.items():
            with self.subTest(name):
                self.late(lambda headers: self.service.frame(document, "application/x-npz" if name == "products" else "application/octet-stream", **headers), after_s)
        mertis = {"channels": 10000, "first_um": 1e-3, "last_um": 1e4, "temperatures_k": [300.0 + i for i in range(16)]}
        self.late(lambda headers: self.service.post("/v1/verify/mertis", mertis, **headers), 0.02)
        trip = {"center": {"lat_deg": 0.1, "lon_deg": 30.1}, "mode": "camera", "footprint_ratio": 0.1, "posts": 256}
        self.late(lambda headers: self.service.post("/v1/verify/roundtrip", trip, **headers), 0.2)

    def test_unreachable_deadlines_are_refused(self):
        hopeless = frame_request(("radiance",), 4096, 4096, 256, visibility="raytrace")
        hopeless["sun"]["angular_radius_deg"] = 0.27
        start = time.monotonic()
        problem = self.problem(self.service.frame(hopeless, Request_Timeout_Ms="30000"), 422)
        self.assertEqual([e["pointer"] for e in problem["errors"]], ["/camera"])
        self.assertRegex(problem["detail"], r"expected to take about \d+ s.*this service allows 600 s")
        problem = self.problem(self.service.frame(dict(hopeless, accuracy={"samples_per_pixel": 4}), Request_Timeout_Ms="3000"), 504)
        self.assertRegex(problem["detail"], r"expected to take about \d+ s")
        self.assertLess(time.monotonic() - start, 2.5)

    def test_a_client_that_left_costs_nothing_more(self):
        connection = self.service.start_frame(with_sensor(EVEN, **LARGE))
        self.service.wait_for("selenograph_frames_in_work", 1)
        time.sleep(1)
        connection.close()
        start = time.monotonic()
        self.service.wait_for("selenograph_frames_in_work", 0)
        self.assertLess(time.monotonic() - start, LATE_S)

    def test_numbers_that_leave_no_channel_are_named(self):
        for wrong, pointer in (({"first_um": 1e-20}, "/first_um"), ({"first_um": 7, "last_um": 7.000000001}, "/channels")):
            self.problem(self.service.post("/v1/verify/mertis", wrong), 422, pointer)

    def mesh_frame(self, name, **headers):
        return self.service.frame(frame_request(objects=[{**SATELLITE, "mesh": name}]), "application/x-npy", **headers)

    def write(self, name, content):
        harness.write(os.path.join("assets", "objects", name), content)

    # A mesh takes a second or so; a deadline ends it, and its process.
    def test_deadlines_reach_meshes(self):
        self.write("slow.obj", b"".join(b"v %d %d 0\n" % (i % 1000, i // 1000) for i in range(300000)) +
                   b"".join(b"f %d %d %d\n" % (i, i + 1, i + 1001) for i in range(1, 298000)))
        self.late(lambda headers: self.mesh_frame("slow", **headers), 0.3)


if __name__ == "__main__":
    harness.main()
