#!/usr/bin/env python3
"""Each client calls every endpoint of the API document and returns what the service says.

The service counts the calls: an endpoint that is new in api/v1.openapi.json fails here until each client calls it. The
programs are ../cpp/every_call.cpp and every_call.m; what needs Octave is skipped where that isn't installed.
"""

import json
import os
import re
import sys
import unittest

import numpy

import harness
from harness import REPOSITORY
from one_service import CLIENTS, SUN, OneService, setUpModule, tearDownModule  # noqa: F401
from programs import CPP_EXAMPLES, OCTAVE, run_cpp, run_octave_function

sys.path.insert(0, os.path.join(CLIENTS, "python"))
from selenograph import Client  # noqa: E402

CAMERA = {"width": 320, "height": 240, "fov_deg": 50}
POSE = {"geodetic": {"lat_deg": -6.5, "lon_deg": 40.0, "height_m": 30000.0}, "nadir": {"up_azimuth_deg": 0}}
MAP = {"map": {"projection": "equirectangular", "gsd_m": 500,
               "bounds": {"south_deg": -7, "north_deg": -6, "west_deg": 39.5, "east_deg": 40.5}},
       "sun": SUN, "products": ["radiance", "height"]}

# Requests that the programs read, by path. Lists have two elements: Octave's JSON has no list of one.
PLACES = [{"lat_deg": -6.5, "lon_deg": 40.0}, {"lat_deg": -6.4, "lon_deg": 40.1}]
ABOVE = {"geodetic": {"lat_deg": -6.5, "lon_deg": 40.0, "height_m": 5000.0}, "nadir": {"up_azimuth_deg": 0}}
FAR_ABOVE = {"geodetic": {"lat_deg": -6.5, "lon_deg": 40.0, "height_m": 4e6}, "nadir": {"up_azimuth_deg": 0}}
WIDE = {"width": 64, "height": 64, "fov_deg": 60}
HORIZON = {"azimuths": 8, "farthest_km": 20}
REQUESTS = {
    # Its metadata are too long for a header.
    "/v1/frames": {"camera": {"width": 4, "height": 4, "fov_deg": 50}, "pose": ABOVE, "products": ["range"],
                   "band": {"response": [[0.4 + 0.0005 * i, 1.0 - 0.0001 * i] for i in range(900)]}},
    "/v1/lidar": {"instrument_preset": "flash", "pose": ABOVE, "seed": 1,
                  "pulses": [{"direction": [0, 0, 1]}, {"direction": [0.1, 0, 1]}]},
    "/v1/limb": {"camera": WIDE, "pose": FAR_ABOVE, "points": 5, "sun": SUN},
    "/v1/horizons": {"places": PLACES, "horizon": HORIZON},
    "/v1/illumination": {"places": PLACES, "horizon": HORIZON, "from_utc": "2026-11-20T00:00:00Z",
                         "to_utc": "2026-11-21T00:00:00Z", "step_s": 7200},
    "/v1/sky": {"camera": WIDE, "pose": FAR_ABOVE, "utc": "2026-11-20T00:00:00Z", "sky": {"stars": True, "planets": True}},
    "/v1/features": {"detail": "landing", "smallest_m": 20,
                     "region": {"south_deg": -6.51, "north_deg": -6.5, "west_deg": 40.0, "east_deg": 40.01}},
    "/v1/verify/roundtrip": {"center": PLACES[0], "posts": 16},
    "/v1/verify/mertis": {"temperatures_k": [300, 400]},
}
HEIGHT = "/v1/height?lat_deg=-6.5&lon_deg=40"
# What is compared of documents.
EXCERPTS = {
    "/v1/frames": lambda meta: [len(meta["request"]["band"]["response"]), meta["sources"][0]["name"]],
    "/v1/sky": lambda answer: [[o["id"], *map(float, o["direction"])] for o in answer["objects"]],
    "/v1/features": lambda answer: [[c["id"], c["lat_deg"], c["diameter_m"]] for c in answer["craters"]],
    "/v1/verify/roundtrip": lambda answer: [answer["counts"]["compared"], answer["height_m"]],
    "/v1/verify/mertis": lambda answer: [channel["signal_to_noise"] for channel in answer["spectra"][1]["channels"]],
    HEIGHT: lambda answer: answer["height_m"],
    "/openapi.json": lambda answer: answer["info"]["version"],
}


def endpoints():
    """The document's operations as (path, method), without those of monitors, which answer with plain text."""
    with open(os.path.join(REPOSITORY, "api", "v1.openapi.json")) as file:
        paths = json.load(file)["paths"]
    return {(path, method.upper()) for path, operations in paths.items() for method, operation in operations.items()
            if set(operation["responses"]["200"]["content"]) != {"text/plain"}}


class Calls:
    """Requests of one client, and the service's own answers to them."""

    last_places = 0  # by which the language misreads numbers in JSON

    def setUp(self):
        self.before = self.counts()

    def counts(self):
        """How many requests of each endpoint have had a good answer."""
        text = self.service.ask("GET", "/metrics")[2].decode()
        found = re.findall(r'^selenograph_http_requests_total\{route="(.+)",method="(.+)",status="200"\} (\d+)$', text, re.M)
        return {(route, method): int(count) for route, method, count in found}

    def assert_all_endpoints_called(self):
        called = {endpoint for endpoint, count in self.counts().items() if count > self.before.get(endpoint, 0)}
        self.assertGreater(len(endpoints()), 15)
        self.assertEqual(endpoints() - called, set(), "this client does not call")

    def document(self, path, request=None):
        """The service's own answer, as JSON."""
        status, _, body = (self.service.ask("GET", path) if request is None else
                           self.service.post(path, request, "application/json"))
        self.assertEqual(status, 200, body[:500])
        return json.loads(body)

    def assert_answers(self, said):
        """`said`: by path, arrays as flat lists by their names, or documents."""
        self.assertEqual(set(said), set(REQUESTS) | set(EXCERPTS))
        for path, answer in said.items():
            if path in EXCERPTS:
                its = (self.service.arrays(REQUESTS[path])["meta"] if path == "/v1/frames" else
                       self.document(path, REQUESTS.get(path)))
                self.assert_alike(EXCERPTS[path](answer), EXCERPTS[path](its), path)
                continue
            arrays = self.service.arrays(REQUESTS[path], path)
            for name, values in answer.items():
                its = arrays[name].ravel()
                self.assertGreater(its.size, 1, (path, name))
                its = [str(x) if its.dtype == numpy.uint64 else None if x != x else x for x in its.tolist()]
                self.assert_alike(values, its, f"{path} {name}")

    def assert_alike(self, ours, its, what):
        if isinstance(ours, list) and isinstance(its, list):
            self.assertEqual(len(ours), len(its), what)
            for i, (a, b) in enumerate(zip(ours, its)):
                self.assert_alike(a, b, f"{what}[{i}]")
        elif self.last_places and isinstance(ours, float) and isinstance(its, float):
            self.assertAlmostEqual(ours, its, delta=self.last_places * sys.float_info.epsilon * abs(its), msg=what)
        else:
            self.assertEqual(ours, its, what)


class Programs(Calls):
    """A program makes all calls, and prints the answers as JSON."""

    def run_every_call(self, *arguments):
        """Returns (exit status, standard output, standard error)."""
        raise NotImplementedError

    def alike(self, got, right, what):
        """The members that the client has are the service's, NaN and null alike."""
        self.assertEqual(len(got), len(right), what)
        for ours, its in zip(got, right):
            for name, value in ours.items():
                missing = "" if name == "source" else False if name in ("filled", "blended") else None
                if isinstance(value, list) and its.get(name) is None:
                    value = None if all(x is None for x in value) else value
                self.assert_alike(value, its.get(name, missing), f"{what}.{name}")

    def test_every_call(self):
        status, out, err = self.run_every_call(self.url(), harness.write("requests.json", REQUESTS))
        self.assertEqual(status, 0, err)
        self.assert_all_endpoints_called()
        said = json.loads(out)
        self.assert_answers(said["by_path"])
        self.check_points(said)
        self.check_attitudes(said)
        self.check_pictures(said)

    def check_points(self, said):
        points = [{"lat_deg": -6.5, "lon_deg": 40.0}, {"lat_deg": -6.6, "lon_deg": 40.1, "height_m": 500.0},
                  {"lat_deg": 30.0, "lon_deg": 100.0}]
        rays = [{"origin_m": [1345000, 1130000, -200000], "direction": [-1345, -1130, 199]},
                {"origin_m": [1800000, 0, 0], "direction": [1, 0, 0]}]
        self.alike(said["heights"], self.document("/v1/heights", {"points": [points[0], points[2]]})["points"], "heights")
        self.assertIsNone(said["heights"][1]["height_m"])
        self.alike(said["project"], self.document("/v1/project", {
            "camera": CAMERA, "pose": POSE, "sun": SUN, "points": points})["points"], "project")
        self.alike(said["rays"], self.document("/v1/rays", {"rays": rays, "sun": SUN})["rays"], "rays")
        self.assertEqual([ray["hit"] for ray in said["rays"]], [True, False])
        self.assertEqual(said["datasets"], 6)

    def check_attitudes(self, said):
        self.assertEqual(len(said["attitudes"]), 7)
        for way, q in said["attitudes"].items():
            for key, value in dict(w=0.8, x=0.2, y=-0.4, z=0.4).items():
                self.assertAlmostEqual(q[key], value, delta=1e-14, msg=way)

    def check_pictures(self, said):
        picture = self.service.frame({"camera": CAMERA, "pose": POSE, "sun": SUN, "products": ["image"]}, "image/png")
        self.assertEqual(said["picture"], {"type": "image/png", "bytes": len(picture[2])})
        archive = self.service.arrays(MAP, "/v1/maps")
        self.assertEqual(said["map"]["shape"], list(archive["height"].shape))
        self.assert_alike(said["map"]["height"], float(archive["height"][3, 5]), "map.height")
        self.assertEqual(said["map"]["hash"], archive["meta"]["content_hash"])


@unittest.skipUnless(CPP_EXAMPLES, "SELENOGRAPH_CPP_EXAMPLES isn't set")
class Cpp(Programs, OneService):
    def run_every_call(self, *arguments):
        return run_cpp("every_call", *arguments)


@unittest.skipUnless(OCTAVE, "Octave isn't installed: apt-get install octave")
class Octave(Programs, OneService):
    last_places = 2

    def run_every_call(self, *arguments):
        return run_octave_function("every_call", *arguments)


class Python(Calls, OneService):
    def test_every_call(self):
        """The results of each call: python_client_test.py."""
        with Client(self.url()) as client:
            self.assertEqual(client.map(MAP)["height"].shape, self.service.arrays(MAP, "/v1/maps")["height"].shape)
            self.assertTrue(client.rays([1800000, 0, 0], [-1, 0, 0]).shape == ())
            client.project(CAMERA, POSE, [[-6.5, 40.0]], SUN)
            self.assertEqual(client.heights(-6.5, 40.0).height_m, self.document(HEIGHT)["height_m"])
            client.datasets()
            self.assert_answers(self.calls_by_path(client))
        self.assert_all_endpoints_called()

    def calls_by_path(self, client):
        def listed(answer, *names):
            return {name: [str(x) if answer[name].dtype == numpy.uint64 else None if x != x else x
                           for x in answer[name].ravel().tolist()] for name in names}

        headers = client.encoded(REQUESTS["/v1/frames"], "application/x-npy").headers
        limb = dict(REQUESTS["/v1/limb"])
        terminator = client.terminator(**limb)
        limb.pop("sun")
        return {
            "/v1/frames": client.document(json.loads(headers["Selenograph-Meta"])["metadata_at"]),
            "/v1/lidar": listed(client.lidar(REQUESTS["/v1/lidar"]), "range_m", "direction", "count", "false_alarm", "rock"),
            "/v1/limb": {**listed(client.limb(**limb), "x_px", "position_m"),
                         "terminator_visible": terminator.visible.tolist()},
            "/v1/horizons": listed(client.horizons(REQUESTS["/v1/horizons"]), "elevation_deg", "azimuth_deg"),
            "/v1/illumination": listed(client.illumination(REQUESTS["/v1/illumination"]), "sun_mean", "sun"),
            "/v1/sky": {"objects": client.sky(REQUESTS["/v1/sky"])},
            "/v1/features": {"craters": client.features(**REQUESTS["/v1/features"])},
            **{path: client.document(path, REQUESTS[path]) for path in ("/v1/verify/roundtrip", "/v1/verify/mertis")},
            **{path: client.document(path) for path in (HEIGHT, "/openapi.json")}}


if __name__ == "__main__":
    harness.main()
