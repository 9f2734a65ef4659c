#!/usr/bin/env python3
"""MERTIS by command and over HTTP: the same numbers, and those of equations (3), (9) and (12)."""

import json
import os
import subprocess
import unittest

import numpy as np

import harness
from harness import tearDownModule

INSTRUMENT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "deploy", "assets", "instruments", "mertis.json")


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "0", "--west-deg", "0", "--rows", "1", "--columns", "1", "--ppd", "16")


def rows_of(*options):
    folder = harness.path("mertis")
    subprocess.run([harness.BINARY, "verify", "mertis", "-o", folder, *options], check=True, stdout=subprocess.DEVNULL)
    with open(os.path.join(folder, "mertis.json")) as file:
        return [{"temperature_k": spectrum["temperature_k"], **channel} for spectrum in json.load(file)["spectra"]
                for channel in spectrum["channels"]]


class MertisTest(unittest.TestCase):
    def test_the_command_gives_the_equations(self):
        rows = rows_of()
        self.assertEqual(len(rows), 160)
        columns = {name: np.array([r[name] for r in rows]) for name in rows[0]}
        w, t = columns["center_um"] * 1e-6, columns["temperature_k"]
        h, c, k = 6.62607015e-34, 299792458.0, 1.380649e-23
        planck = 2 * h * c * c / w ** 5 / np.expm1(h * c / (w * k * t)) * 1e-6
        self.assertTrue(np.allclose(columns["radiance_w_m2_sr_um"], planck, rtol=1e-7))
        flux = np.pi / 4 * 35e-6 ** 2 / 2 ** 2 * 0.3 * planck * 0.0875
        self.assertTrue(np.allclose(columns["flux_w"], flux, rtol=1e-6))
        self.assertTrue(np.allclose(columns["signal_to_noise"], flux / 1e-12, rtol=1e-6))
        self.assertLess(np.abs(columns["width_error"]).max(), 1e-4)

    def test_the_file_is_what_is_built_in(self):
        self.assertEqual(rows_of(), rows_of("--instrument", INSTRUMENT))

    def test_http_gives_the_same(self):
        service = harness.Service()
        with open(INSTRUMENT) as file:
            for document in ({}, json.load(file)):
                status, _, body = service.post("/v1/verify/mertis", document)
                self.assertEqual(status, 200, body[:300])
                answer = json.loads(body)
                rows_of()
                with open(harness.path("mertis", "mertis.json")) as written:
                    self.assertEqual(json.load(written), answer)
                self.assertGreaterEqual(len(answer["assumptions_of_the_defaults"]), 5)
                asked = [(s["temperature_k"], c) for s in answer["spectra"] for c in s["channels"]]
                for (kelvin, channel), row in zip(asked, rows_of(), strict=True):
                    self.assertEqual(kelvin, float(row["temperature_k"]))
                    self.assertAlmostEqual(channel["signal_to_noise"] / float(row["signal_to_noise"]), 1, 7)
        for wrong, pointer in (({"channels": 0}, "/channels"), ({"first_um": 15.0}, "/last_um"), ({"nep": 1}, "/nep"),
                               ({"efficiency": [[8.0, 0.1], [7.0, 0.1]]}, "/efficiency/1"), ({"temperatures_k": []}, "/temperatures_k")):
            status, _, body = service.post("/v1/verify/mertis", wrong)
            self.assertEqual(status, 422)
            self.assertEqual([e["pointer"] for e in json.loads(body)["errors"]], [pointer])

    def test_a_file_with_a_fault_is_named(self):
        path = harness.path("broken.json")
        with open(path, "w") as file:
            file.write('{"channels": -1}')
        done = subprocess.run([harness.BINARY, "verify", "mertis", "-o", harness.path("x"), "--instrument", path],
                              capture_output=True, text=True)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("broken.json", done.stderr)
        self.assertIn("/channels", done.stderr)


if __name__ == "__main__":
    harness.main()
