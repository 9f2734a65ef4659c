#!/usr/bin/env python3
"""A tile that is rewritten in place under the running service, while it is asked.

What is answered under one ETag has the same bytes, whenever it was asked for; what can't be answered says which tile has
changed; nothing of the change is left when the original is back. Python's standard library only.
"""

import json
import os
import shutil
import threading
import unittest

import harness
from harness import Service, frame_request

TILE = "DTM_MAP_01_N01E030N00E031SC"
PIECE = 1 << 14  # bytes of one write


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "0", "--west-deg", "30", "--rows", "1", "--columns", "2", "--ppd", "256")


def tearDownModule():
    harness.tear_down()


def image(name="dem"):
    return harness.path(name, TILE + ".img")


def requests():
    """Frames of places on the tile, from near and far."""
    for i in range(12):
        request = frame_request(("radiance", "range"))
        request["pose"]["geodetic"] = {"lat_deg": 0.1 + 0.07 * i, "lon_deg": 30.1 + 0.07 * ((5 * i) % 12), "height_m": 4000.0 * (1 + i % 3)}
        yield request


def copy_onto(content, path):
    """As cp does: empty first."""
    with open(path, "wb") as file:
        file.write(content)


def write_in_place(content, path):
    """As rsync --inplace does: piece by piece, the size stays."""
    with open(path, "r+b", buffering=0) as file:
        for first in range(0, len(content), PIECE):
            file.write(content[first:first + PIECE])


class RewrittenTile(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.requests = list(requests())
        with open(image(), "rb") as file:
            cls.original = file.read()
        cls.other = bytes(b ^ (2 * (i & 1)) for i, b in enumerate(cls.original))  # heights of 2 m more or less
        service = Service(cache="clean")
        cls.clean = cls.answers(service)
        assert [a[0] for a in cls.clean] == [200] * len(cls.requests), cls.clean
        assert service.stop() == 0

    @classmethod
    def answers(cls, service):
        found = []
        for request in cls.requests:
            status, headers, body = service.frame(request, "application/x-npz")
            found.append((status, headers.get("ETag"), body))
        return found

    def setUp(self):
        self.before = os.stat(image())

    def tearDown(self):
        self.put_back()
        shutil.rmtree(harness.path("cache"), ignore_errors=True)

    def put_back(self):
        copy_onto(self.original, image())
        os.utime(image(), ns=(self.before.st_atime_ns, self.before.st_mtime_ns))

    def assert_clean_or_refused(self, answers):
        """Returns how many were refused."""
        refused = 0
        for (status, etag, body), (_, clean_etag, clean) in zip(answers, self.clean):
            if status == 200:
                self.assertEqual(etag, clean_etag)
                self.assertTrue(body == clean, "other bytes under the same ETag")
                continue
            refused += 1
            self.assertEqual(status, 500, body[:300])
            problem = json.loads(body)
            self.assertEqual(problem["type"], "urn:selenograph:problem:terrain_data_error")
            self.assertIn(TILE, problem["detail"])
            self.assertIsNone(etag)
        return refused

    def test_while_it_is_asked(self):
        for write in (write_in_place, copy_onto):
            with self.subTest(write.__name__):
                self.put_back()
                shutil.rmtree(harness.path("cache"), ignore_errors=True)
                service = Service("--cache-mb", "16")
                self.assert_clean_or_refused([self.answer(service, 0)])  # opens the tile
                over = threading.Event()

                def rewrite():
                    while not over.is_set():
                        write(self.other, image())
                        write(self.original, image())

                writer = threading.Thread(target=rewrite)
                writer.start()
                try:
                    during = self.answers(service) + self.answers(service)
                finally:
                    over.set()
                    writer.join()
                self.assert_clean_or_refused(during[:len(self.clean)])
                self.assert_clean_or_refused(during[len(self.clean):])
                write(self.other, image())
                after = self.answers(service)
                self.assertGreater(self.assert_clean_or_refused(after), 0)
                self.assertTrue(any("put the original back" in a[2].decode() for a in after if a[0] == 500))
                self.put_back()
                self.assertEqual(self.assert_clean_or_refused(self.answers(service)), 0)
                self.assertEqual(service.stop(), 0)
                service = Service()
                self.assertEqual(self.assert_clean_or_refused(self.answers(service)), 0)
                self.assertEqual(service.stop(), 0)

    def answer(self, service, i):
        status, headers, body = service.frame(self.requests[i], "application/x-npz")
        return status, headers.get("ETag"), body


if __name__ == "__main__":
    harness.main()
