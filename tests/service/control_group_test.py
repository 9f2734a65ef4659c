#!/usr/bin/env python3
"""In a control group with a memory limit, by default options: every request is answered, and the kernel kills nobody.

Needs a memory controller, of version 1 or 2, and the right to make groups: root's. Python's standard library only.
"""

import concurrent.futures
import os
import random
import unittest

import harness
from harness import PLACE, PRODUCTS, Service, frame_request, tearDownModule

SIDES_PX = ((4096, 2048), (2048, 2048), (1024, 1024), (512, 512))
AT_ONCE = 6
MEBI = 1 << 20


class ControlGroup:
    """A group of its own with a limit."""

    def __init__(self, limit_bytes):
        first = "/sys/fs/cgroup/memory" if os.path.isdir("/sys/fs/cgroup/memory") else "/sys/fs/cgroup"
        self.version = 1 if first.endswith("memory") else 2
        self.folder = os.path.join(first, f"selenograph-test-{os.getpid()}")
        try:
            os.mkdir(self.folder)
            self.set("memory.limit_in_bytes" if self.version == 1 else "memory.max", limit_bytes)
        except OSError as error:
            if os.path.isdir(self.folder):
                os.rmdir(self.folder)
            raise unittest.SkipTest(f"no control group for memory can be made here: {error}") from error

    def set(self, name, value):
        with open(os.path.join(self.folder, name), "w") as file:
            file.write(str(value))

    def enter(self):
        """For the process that calls it."""
        self.set("cgroup.procs", os.getpid())

    def killed(self):
        with open(os.path.join(self.folder, "memory.oom_control" if self.version == 1 else "memory.events")) as file:
            return next(int(line.split()[1]) for line in file if line.startswith("oom_kill "))

    def remove(self):
        os.rmdir(self.folder)


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE, "--ppd", "256")
    harness.assets()


def bodies_of(count):
    chosen = random.Random(1)
    bodies = [(frame_request(PRODUCTS, width=8192, height=2048), "application/x-npz")] * 3
    for _ in range(count):
        products = chosen.sample(PRODUCTS, chosen.randint(1, len(PRODUCTS)))
        accept = chosen.choice(["application/x-npz", "image/x-exr"]) if len(products) > 1 else "application/x-npy"
        width, height = chosen.choice(SIDES_PX)
        bodies.append((frame_request(products, width=width, height=height,
                                     visibility=chosen.choice(["zbuffer", "raytrace"]),
                                     samples=chosen.choice([1, 1, 4])), accept))
    chosen.shuffle(bodies)
    return bodies


class InAControlGroup(unittest.TestCase):
    def test_default_options(self):
        for limit_mb in (1024, 1536, 3072):
            with self.subTest(limit_mb=limit_mb):
                group = ControlGroup(limit_mb * MEBI)
                self.addCleanup(group.remove)
                service = Service("--assets-dir", harness.path("assets"), "--log-level", "info", limits=group.enter)
                self.addCleanup(harness.stop_all)
                self.assertIn(f"memory: {limit_mb // 4 * 3} MiB", service.log_text())
                with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
                    answers = list(pool.map(lambda r: service.frame(*r), bodies_of(40)))
                self.assertEqual(group.killed(), 0)
                self.assertIsNone(service.process.poll(), service.log_text()[-2000:])
                statuses = [status for status, _, _ in answers]
                print(f"\n  {limit_mb} MiB: {({s: statuses.count(s) for s in sorted(set(statuses))})}", end=" ", flush=True)
                for status, headers, body in answers:
                    self.assertIn(status, (200, 422, 503), body[:300])
                    if status == 503:
                        self.assertGreaterEqual(int(headers["Retry-After"]), 1)
                self.assertGreater(statuses.count(200), 0)
                self.assertEqual(service.frame(frame_request())[0], 200, "a small frame afterwards")
                self.assertEqual(service.stop(), 0)
                self.doCleanups()


if __name__ == "__main__":
    harness.main()
