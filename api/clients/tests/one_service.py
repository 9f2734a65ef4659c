"""What the tests of clients in other languages and of adapters share: one service over the terrain that the examples fly over.

A test file imports setUpModule and tearDownModule, too, where unittest looks for them.
"""

import os
import unittest

import harness

CLIENTS = os.path.join(harness.REPOSITORY, "api", "clients")
PLACE = ("--south-deg", "-8", "--west-deg", "39", "--rows", "3", "--columns", "2", "--ppd", "256")
SUN = {"subsolar": {"lat_deg": 0.0, "lon_deg": 100.0}}


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE)
    OneService.service = harness.Service("--assets-dir", os.path.join(harness.REPOSITORY, "deploy", "assets"))


def tearDownModule():
    code = OneService.service.stop()
    harness.tear_down()
    assert code == 0, f"exit status {code} after SIGTERM"


class OneService(unittest.TestCase):
    """One service for all tests."""

    service = None

    def url(self):
        return "http://%s:%d" % (self.service.host, self.service.port)
