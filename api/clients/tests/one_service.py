"""What the tests of clients and adapters share: one service over the terrain that the examples fly over.

A test file imports setUpModule (or has its own, which calls start()) and tearDownModule, too, where unittest looks for them.
"""

import os
import unittest

import harness

CLIENTS = os.path.join(harness.REPOSITORY, "api", "clients")
PLACE = ("--south-deg", "-8", "--west-deg", "39", "--rows", "3", "--columns", "2", "--ppd", "256")
WITH_ASSETS = ("--assets-dir", os.path.join(harness.REPOSITORY, "deploy", "assets"))
SUN = {"subsolar": {"lat_deg": 0.0, "lon_deg": 100.0}}


def start(*options, terrain=PLACE):
    """Starts the service with these options over sample terrain."""
    harness.set_up()
    harness.sample("dem", *terrain)
    OneService.service = harness.Service(*options)


def setUpModule():
    start(*WITH_ASSETS)


def tearDownModule():
    try:
        OneService.service.expect_clean_stop()
    finally:
        harness.tear_down()


def url():
    return f"http://{OneService.service.host}:{OneService.service.port}"


class OneService(unittest.TestCase):
    """One service for all tests."""

    service = None

    def url(self):
        return url()
