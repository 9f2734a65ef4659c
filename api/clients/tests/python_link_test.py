#!/usr/bin/env python3
"""Frames over a faulty link (selenograph.Link): rates, and that the truth says what the arrays hold. Needs NumPy."""

import collections
import os
import sys
import unittest

import numpy as np

import harness
from harness import REPOSITORY

sys.path.insert(0, os.path.join(REPOSITORY, "api", "clients", "python"))
from selenograph import Link  # noqa: E402

RATES = {"lost": 0.05, "late": 0.08, "repeated": 0.03, "torn": 0.06, "frozen": 0.01}
COUNT = 20000


def frames(count=COUNT, rows=12):
    """Frames whose every pixel is their number."""
    for i in range(count):
        yield {"image": np.full((rows, 4), i), "range": np.full((rows, 4), float(i))}


class LinkTest(unittest.TestCase):
    def test_rates(self):
        began, arrived = collections.Counter(), collections.Counter()
        frozen = False
        for step in Link(7, **RATES).deliver(frames()):
            for arrival in step:
                arrived[arrival.number] += 1
                began[arrival.fault] += arrival.fault != "frozen" or not frozen
                frozen = arrival.fault == "frozen" if arrival.fault not in ("late", "repeated") else frozen
        began["lost"] = sum(arrived[i] == 0 for i in range(COUNT))
        not_frozen = 1 - 3 * RATES["frozen"]  # a frame that is frozen still has no other fault; three are, in the mean
        for fault, rate in RATES.items():
            expected = COUNT * rate * not_frozen
            self.assertLess(abs(began[fault] - expected), 5 * np.sqrt(expected) + 1, (fault, began[fault], expected))

    def test_the_truth_is_in_the_arrays(self):
        kinds, steps = set(), 0
        for step, arrivals in enumerate(Link(3, **RATES, late_steps=4).deliver(frames(3000))):
            steps += 1
            numbers = [arrival.number for arrival in arrivals]
            for arrival in arrivals:
                kinds.add(arrival.fault)
                for array in arrival.arrays.values():
                    rows = array[:, 0]
                    np.testing.assert_array_equal(rows[:arrival.tear_row], arrival.shows)
                    if arrival.tear_row is not None:
                        self.assertEqual(len(set(rows[arrival.tear_row:])), 1)
                        self.assertLess(rows[-1], arrival.number)
                delay = step - arrival.number
                self.assertTrue({"late": 1 <= delay <= 4, "repeated": delay == 1}.get(arrival.fault, delay == 0), arrival)
                self.assertEqual(arrival.shows < arrival.number, arrival.fault == "frozen")
            self.assertEqual(len(numbers), len(set(numbers)))
        self.assertEqual(kinds, {"", "late", "repeated", "torn", "frozen"})
        self.assertLessEqual(steps, 3004)

    def test_seed_and_number_decide(self):
        def history(seed, count):
            return [[(a.number, a.fault, a.shows, a.tear_row) for a in step] for step in Link(seed, **RATES).deliver(frames(count))]
        self.assertEqual(history(1, 500)[:500], history(1, 900)[:500])
        self.assertNotEqual(history(1, 500), history(2, 500))

    def test_a_perfect_link_and_a_loop(self):
        sent = []

        def source():
            for frame in frames(5):
                sent.append(frame)
                yield frame

        for i, (arrival,) in enumerate(Link(0).deliver(source())):
            self.assertEqual((arrival.number, arrival.fault, len(sent)), (i, "", i + 1))
            self.assertIs(arrival.arrays, sent[i])
        for wrong in ({"lost": 0.7, "late": 0.4}, {"torn": -0.1}, {"late_steps": 0}):
            with self.assertRaises(ValueError):
                Link(0, **wrong)


if __name__ == "__main__":
    harness.main()
