#!/usr/bin/env python3
"""A tile that is rewritten in place under the running service, while it is asked.

What is answered under one ETag has the same bytes, whenever it was asked for; what can't be answered says which tile has
changed. After a restart, nothing is left of what the tile was before.
"""

import json
import os
import shutil
import threading
import unittest

import numpy as np

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

    def setUp(self):
        self.before = os.stat(image())

    def tearDown(self):
        self.write(self.original)
        for cache in ("cache", "clean"):
            shutil.rmtree(harness.path(cache), ignore_errors=True)

    def write(self, content):
        """With the time of modification that the tile had at first."""
        copy_onto(content, image())
        os.utime(image(), ns=(self.before.st_atime_ns, self.before.st_mtime_ns))

    def answer(self, service, i):
        status, headers, body = service.frame(self.requests[i], "application/x-npz")
        return status, headers.get("ETag"), body

    def answers(self, service):
        return [self.answer(service, i) for i in range(len(self.requests))]

    def answers_of(self, *options, cache):
        """By a service of its own, which answers all of them."""
        service = Service(*options, cache=cache)
        found = self.answers(service)
        self.assertEqual(service.stop(), 0)
        self.assertEqual([status for status, _, _ in found], [200] * len(self.requests))
        return found

    def clean_answers(self):
        shutil.rmtree(harness.path("clean"), ignore_errors=True)
        return self.answers_of(cache="clean")

    def assert_clean_or_refused(self, answers, clean):
        """Returns how many were refused."""
        refused = 0
        for (status, etag, body), (_, clean_etag, clean_body) in zip(answers, clean):
            if status == 200:
                self.assertEqual(etag, clean_etag)
                self.assertTrue(body == clean_body, "other bytes under the same ETag")
                continue
            refused += 1
            self.assertEqual(status, 500, body[:300])
            problem = json.loads(body)
            self.assertEqual(problem["type"], "urn:selenograph:problem:terrain_data_error")
            self.assertIn(TILE, problem["detail"])
            self.assertIsNone(etag)
        return refused

    def assert_same_arrays(self, answers, others):
        for (_, _, body), (_, _, other) in zip(answers, others):
            mine, theirs = harness.arrays_of(body), harness.arrays_of(other)
            for product in ("radiance", "range"):
                np.testing.assert_array_equal(mine[product], theirs[product])

    def test_while_it_is_asked(self):
        for write in (write_in_place, copy_onto):
            with self.subTest(write.__name__):
                self.write(self.original)
                shutil.rmtree(harness.path("cache"), ignore_errors=True)
                clean = self.clean_answers()
                service = Service("--cache-mb", "16")
                self.assertEqual(self.assert_clean_or_refused([self.answer(service, 0)], clean), 0)  # opens the tile
                over = threading.Event()

                def rewrite():
                    while not over.is_set():
                        write(self.other, image())
                        write(self.original, image())

                writer = threading.Thread(target=rewrite)
                writer.start()
                try:
                    during = [self.answers(service), self.answers(service)]
                finally:
                    over.set()
                    writer.join()
                for answers in during:
                    self.assert_clean_or_refused(answers, clean)
                write(self.other, image())
                after = self.answers(service)
                self.assertGreater(self.assert_clean_or_refused(after, clean), 0)
                self.assertTrue(any("start again" in body.decode() for status, _, body in after if status == 500))
                self.write(self.original)
                self.assert_clean_or_refused(self.answers(service), clean)
                self.assertEqual(service.stop(), 0)
                self.assert_same_arrays(self.answers_of(cache="cache"), clean)

    def test_repaired_between_two_starts(self):
        """Other posts in a file of the same size and time: nothing that was kept of the old ones is used."""
        damaged = self.answers_of(cache="cache")
        self.write(self.other)
        repaired = self.answers_of(cache="cache")
        self.assert_same_arrays(repaired, self.clean_answers())
        for (_, etag, _), (_, old_etag, _) in zip(repaired, damaged):
            self.assertNotEqual(etag, old_etag)
        pairs = [[harness.arrays_of(body)["range"] for _, _, body in pair] for pair in zip(repaired, damaged)]
        self.assertTrue(all((a != b).any() for a, b in pairs), "the frames do not show the repair")


if __name__ == "__main__":
    harness.main()
