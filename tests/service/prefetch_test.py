#!/usr/bin/env python3
"""What the next frames need is made before they ask for it, and no answer knows.

Python's standard library only.
"""

import harness
from harness import frame_request, Service, tearDownModule

STEP_DEG = 0.02  # 600 m: each frame needs some other blocks


def setUpModule():
    harness.set_up()
    harness.sample("dem", *harness.PLACE)


def pose(step):
    return {"geodetic": {"lat_deg": STEP_DEG * step, "lon_deg": 30.0, "height_m": 8000.0}, "nadir": {}}


def request_at(step, **changes):
    return frame_request(("radiance", "range"), 160, 120, pose=pose(step), **changes)


class Flight(harness.WithService):
    def wait_until(self, service, name, least):
        harness.wait_until(lambda: service.metric(name) >= least, lambda: f"{name} is {service.metric(name)}, not {least}")

    def answer(self, service, request):
        status, headers, body = service.frame(request, "application/x-npz")
        self.assertEqual(status, 200, body[:300])
        return headers["ETag"], body

    def test_poses_ahead_are_prepared_and_change_nothing(self):
        plain = Service(cache="plain")
        right = [self.answer(plain, request_at(step)) for step in (0, 5, 9)]
        self.assertEqual(plain.stop(), 0)

        service = Service(cache="ahead")
        self.assertEqual(self.answer(service, request_at(0, ahead=[pose(5), pose(9)])), right[0])
        self.wait_until(service, "selenograph_prefetched_scenes_total", 2)
        self.assertEqual(self.answer(service, request_at(5, ahead=[pose(9)])), right[1])
        self.assertEqual(self.answer(service, request_at(9)), right[2])
        self.assertGreaterEqual(service.metric("selenograph_prefetched_scenes_used_total"), 2)
        self.assertEqual(service.metric("selenograph_prefetched_scenes_wasted_total"), 0)
        self.assertEqual(service.stop(), 0)

    def test_faults_point_at_their_member(self):
        service = self.service
        self.problem(service.frame(request_at(0, ahead=[])), 422, "/ahead")
        self.problem(service.frame(request_at(0, ahead=[pose(1)] * 65)), 422, "/ahead")
        self.problem(service.frame(request_at(0, ahead=[pose(1), {"nadir": {}}])), 422, "/ahead/1")
        self.problem(service.frame(request_at(0, ahead=pose(1))), 422, "/ahead")
        # Where no camera can be is no fault of this frame.
        below = {"geodetic": {"lat_deg": 0, "lon_deg": 30, "height_m": -9000}, "nadir": {}}
        self.answer(service, request_at(0, ahead=[below]))


if __name__ == "__main__":
    harness.main()
