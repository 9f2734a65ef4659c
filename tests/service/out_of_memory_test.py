#!/usr/bin/env python3
"""More work than there is memory: every request is answered, and the service lives. Python's standard library only."""

import concurrent.futures
import random
import resource
import unittest

import harness
from harness import PLACE, PRODUCTS, Service, frame_request, tearDownModule

GIBI = 1 << 30
AT_ONCE = 4


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE, "--ppd", "256")


@harness.of_memory
class OutOfMemory(unittest.TestCase):
    def start(self, gibibytes, *options):
        limit = int(gibibytes * GIBI)
        # More than the process may have: nothing is refused before it is tried. The stacks of threads take addresses.
        service = Service("--log-level", "error", "--max-frames", str(AT_ONCE), "--memory-mb", "8192", "--max-connections", "16",
                          *options,
                          limits=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)))
        self.assertEqual(service.frame(frame_request())[0], 200)
        return service

    def ask_at_once(self, service, requests):
        """Each (request, accept) is answered, and the service lives; returns how often there was which status."""
        with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
            answers = list(pool.map(lambda r: service.frame(*r), requests))
        self.assertIsNone(service.process.poll(), service.log_text())
        for status, headers, body in answers:
            self.assertIn(status, (200, 500, 503), body[:300])
            if status != 200:
                self.assertEqual(headers["Content-Type"], "application/problem+json")
                self.assertIn(b'"status":', body)
            if status == 503:
                self.assertGreaterEqual(int(headers["Retry-After"]), 1)
        self.assertEqual(service.frame(frame_request())[0], 200, "a small frame afterwards")
        self.assertEqual(service.stop(), 0)
        statuses = [status for status, _, _ in answers]
        return {status: statuses.count(status) for status in sorted(set(statuses))}

    def test_the_largest_frames(self):
        large = frame_request(PRODUCTS, width=8192, height=2048)
        for gibibytes in (1.5, 2, 3) if harness.full_effort() else (2,):
            with self.subTest(gibibytes=gibibytes):
                statuses = self.ask_at_once(self.start(gibibytes), [(large, "application/x-npz")] * AT_ONCE)
                print(f"\n  {gibibytes} GiB: {statuses}", end=" ", flush=True)

    def test_frames_of_all_sizes(self):
        """What is refused where depends on what the others hold: allocations of every size fail."""
        chosen = random.Random(1)
        requests = []
        for _ in range(30):
            products = chosen.sample(PRODUCTS, chosen.randint(1, len(PRODUCTS)))
            accept = chosen.choice(["application/x-npz", "image/x-exr"]) if len(products) > 1 else "application/x-npy"
            width, height = chosen.choice([(4096, 2048), (2048, 2048), (1024, 1024), (512, 512)])
            requests.append((frame_request(products, width=width, height=height,
                                           visibility=chosen.choice(["zbuffer", "raytrace"])), accept))
        statuses = self.ask_at_once(self.start(1.2, "--cache-mb", "64", "--scene-mb", "64"), requests)
        print(f"\n  1.2 GiB: {statuses}", end=" ", flush=True)


if __name__ == "__main__":
    harness.main()
