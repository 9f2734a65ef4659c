#!/usr/bin/env python3
"""Holds the service to its own document: every answer that /openapi.json lists is provoked, and none that it does not list.

JSON answers are checked against the document's schemas by python3-jsonschema. With Redocly's linter in the PATH
(npm install -g @redocly/cli) the document is linted, too. Python's standard library and jsonschema only.
"""

import concurrent.futures
import copy
import json
import os
import select
import shutil
import subprocess
import time
import unittest

import jsonschema

import harness
from harness import frame_request, PATIENCE_S, Service, tearDownModule

# Where the document's examples look at.
PLACE = ("--south-deg", "25", "--west-deg", "2", "--rows", "2", "--columns", "2", "--ppd", "64")
DAMAGED = "DTM_MAP_01_N27E003N26E004SC"
ASSETS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "deploy", "assets")
SMALL_LIMITS = ("--max-body-kb", "4096", "--max-image-pixels", "16000000", "--assets-dir", ASSETS)

DOCUMENT = {}


def setUpModule():
    harness.set_up()
    dem = harness.sample("dem", *PLACE)
    shutil.copytree(dem, harness.path("damaged"))
    service = Service(*SMALL_LIMITS)
    DOCUMENT.update(json.loads(service.ask("GET", "/openapi.json")[2]))
    assert service.stop() == 0


def resolve(node):
    while "$ref" in node:
        target = node["$ref"]
        node = DOCUMENT
        for part in target.lstrip("#/").split("/"):
            node = node[part.replace("~1", "/").replace("~0", "~")]
    return node


def validator(schema):
    return jsonschema.Draft202012Validator(schema, resolver=jsonschema.RefResolver("", DOCUMENT))


def operations():
    for path, methods in DOCUMENT["paths"].items():
        for method, operation in methods.items():
            yield path, method.upper(), operation


class Operation:
    """One path and method, and ways to ask."""

    def __init__(self, path, method, operation):
        self.path, self.method = path, method
        self.responses = operation["responses"]
        body = operation.get("requestBody")
        content = body["content"]["application/json"] if body else {}
        self.examples = {name: example["value"] for name, example in content.get("examples", {}).items()}
        self.schema = content.get("schema")
        required = [resolve(p) for p in operation.get("parameters", [])]
        query = {"lat_deg": "26.1322", "lon_deg": "3.6339"}
        asked = [f"{p['name']}={query[p['name']]}" for p in required if p["in"] == "query"]
        self.target = path.replace("{hash}", "0" * 32) + ("?" + "&".join(asked) if asked else "")
        self.waits = bool(self.schema) or path == "/v1/height"  # for a place in work
        self.good = 404 if "{hash}" in path else 200  # of an ordinary request: no metadata are kept under that hash

    def __str__(self):
        return f"{self.method} {self.path}"

    def body(self):
        return next(iter(self.examples.values()), None)

    def small(self):
        """The example, with a frame that is soon rendered."""
        body = copy.deepcopy(self.body())
        if body and "camera" in body:
            body["camera"].update(width=32, height=32)
        return body

    def ask(self, service, body=None, target=None, method=None, **headers):
        sent = {name.replace("_", "-"): value for name, value in headers.items()}
        content = None
        if self.method == "POST":
            sent.setdefault("Content-Type", "application/json")
            content = body if isinstance(body, bytes) else json.dumps(body or self.small()).encode()
        return service.ask(method or self.method, target or self.target, content, sent)

    def raw(self, service, rest, target=None):
        """Sends a head that no HTTP library would; (status, headers, body) of what comes back."""
        answer = service.raw(f"{self.method} {target or self.target} HTTP/1.1\r\n".encode() + rest)
        head, _, body = answer.partition(b"\r\n\r\n")
        lines = head.decode("latin-1").split("\r\n")
        return int(lines[0].split()[1]), dict(line.split(": ", 1) for line in lines[1:]), body


class Documented(unittest.TestCase):
    """Checks each answer against the document, and notes which of the documented ones were seen."""

    @classmethod
    def setUpClass(cls):
        cls.seen = set()
        cls.operations = [Operation(*o) for o in operations()]

    def check(self, operation, answer, status):
        got, headers, body = answer
        self.assertEqual(got, status, f"{operation}: {body[:300]}")
        self.assertIn(str(got), operation.responses, f"{operation} answers what is not documented")
        response = resolve(operation.responses[str(got)])
        content = response.get("content")
        media_type = (headers.get("Content-Type") or "").partition(";")[0]
        self.assertEqual(bool(body), bool(content), f"{operation} {got}")
        if content:
            self.assertIn(media_type, content, f"{operation} {got}")
            self.assertTrue(content[media_type], f"{operation} {got}")
            if media_type.endswith("json"):
                self.assertTrue(body.endswith(b"\n"), f"{operation} {got}")
                document = json.loads(body)
                validator(content[media_type]["schema"]).validate(document)
                self.assertEqual(document.get("status", got), got)
        for name in response.get("headers", {}):
            if name not in self.only_some(operation, headers):
                self.assertIn(name.lower(), {h.lower() for h in headers.keys()}, f"{operation} {got}")
        self.seen.add((operation.path, operation.method, str(got), media_type))
        return headers, body

    def only_some(self, operation, headers):
        """Headers that are documented for some answers only."""
        if operation.path in ("/v1/rays", "/v1/project", "/v1/sky", "/v1/features"):
            return ("Selenograph-Warnings",)
        if operation.path not in ("/v1/frames", "/v1/maps"):
            return ()
        missing = ("Selenograph-Missing-Fraction", "Selenograph-Warnings")  # of frames and maps that run off the data
        if operation.path == "/v1/maps":
            return missing
        missing += ("Selenograph-Echo",)  # of requests with an echo
        if headers.get("Content-Type") not in ("application/x-npy", "application/octet-stream"):
            return missing + ("Selenograph-Product", "Selenograph-Shape", "Selenograph-Dtype", "Selenograph-Meta")
        return missing

    def each(self, status):
        """Operations that document this status."""
        return [operation for operation in self.operations if str(status) in operation.responses]


class EveryAnswer(Documented):
    """One test, in steps: at its end nothing that is documented may be left."""

    def test_every_documented_answer(self):
        service = Service(*SMALL_LIMITS)
        self.answers_to_good_requests(service)
        self.representations(service)
        self.metadata_of_their_own(service)
        self.refusals_of_requests(service)
        self.refusals_of_http(service)
        self.deadlines(service)
        self.assertEqual(service.stop(), 0)
        self.busy()
        self.shutting_down()
        self.too_many_connections()
        self.damaged_terrain()
        documented = {(o.path, o.method, status, media_type) for o in self.operations for status, response in o.responses.items()
                      for media_type in resolve(response).get("content", {"": None})}
        self.assertEqual(documented - self.seen, set(), "documented, but not provoked")

    def answers_to_good_requests(self, service):
        for operation in self.each(200):
            for body in operation.examples.values() or (None,):
                headers, _ = self.check(operation, operation.ask(service, body), operation.good)
            if "304" in operation.responses:
                etag = operation.ask(service)[1]["ETag"]
                self.check(operation, operation.ask(service, If_None_Match=etag), 304)

    def representations(self, service):
        round_trip = next(o for o in self.operations if o.path == "/v1/verify/roundtrip")
        for media_type in round_trip.responses["200"]["content"]:
            headers, _ = self.check(round_trip, round_trip.ask(service, Accept=media_type), 200)
            self.assertEqual(headers["Content-Type"], media_type)
        maps = next(o for o in self.operations if o.path == "/v1/maps")
        for media_type in maps.responses["200"]["content"]:
            self.check(maps, maps.ask(service, dict(maps.examples["slopes"], products=["slope"]), Accept=media_type), 200)
        for path, map_type in (("/v1/horizons", "image/tiff"), ("/v1/illumination", "image/tiff")):
            operation = next(o for o in self.operations if o.path == path)
            example = next(iter(operation.examples.values()))
            area = {"map": {"projection": "orthographic", "center": {"lat_deg": 26.1322, "lon_deg": 3.6339}, "width_m": 200,
                            "height_m": 200, "gsd_m": 100}}
            place = {"places": [{"lat_deg": 26.1322, "lon_deg": 3.6339}]}
            rest = {name: value for name, value in example.items() if name not in ("map", "places")}
            for media_type in operation.responses["200"]["content"]:
                body = {**rest, **(area if media_type == map_type else place)}
                self.check(operation, operation.ask(service, body, Accept=media_type), 200)
        for path in ("/v1/features", "/v1/sky", "/v1/limb", "/v1/rays", "/v1/project", "/v1/lidar"):
            operation = next(o for o in self.operations if o.path == path)
            for media_type in operation.responses["200"]["content"]:
                self.check(operation, operation.ask(service, Accept=media_type), 200)
        frames = next(o for o in self.operations if o.path == "/v1/frames")
        for media_type in frames.responses["200"]["content"]:
            body = dict(frames.small(), products=["image" if media_type == "image/png" else "range"])
            headers, content = self.check(frames, frames.ask(service, body, Accept=media_type), 200)
            self.assertEqual(headers["Content-Type"], media_type)
            metadata = validator({"$ref": "#/components/schemas/FrameMetadata"})
            if media_type == "application/x-npz":
                metadata.validate(harness.meta_of(content))
            if "Selenograph-Meta" in headers:
                meta = json.loads(headers["Selenograph-Meta"])
                metadata.validate(meta)
                # "A valid request itself", and the same frame.
                again = frames.ask(service, meta["request"], Accept=media_type)
                self.check(frames, again, 200)
                self.assertEqual(again[2], content)

    def refusals_of_requests(self, service):
        for operation in self.each(422):
            if operation.schema:
                self.check(operation, operation.ask(service, dict(operation.body(), unknown=1)), 422)
            else:
                self.check(operation, operation.ask(service, target=operation.path + "?lat_deg=91&lon_deg=0"), 422)
        for operation in self.each(406):
            self.check(operation, operation.ask(service, Accept="text/html"), 406)
        for operation in self.each(415):
            self.check(operation, operation.ask(service, Content_Type="text/plain"), 415)
        for operation in self.each(413):
            self.check(operation, operation.ask(service, b" " * ((4096 << 10) + 1)), 413)
        for operation in self.each(400):
            if operation.schema:
                self.check(operation, operation.ask(service, b'{"camera": '), 400)
        for operation in self.each(405):
            for method in ("DELETE", "PUT", "GET" if operation.method == "POST" else "POST"):
                headers, _ = self.check(operation, service.ask(method, operation.path), 405)
                self.assertIn(operation.method, headers["Allow"])

    def refusals_of_http(self, service):
        for operation in self.each(400):
            self.check(operation, operation.raw(service, b"Host: localhost\r\nHost: localhost\r\n\r\n"), 400)
        # A name of somebody else's, and a page from elsewhere, get nothing from any path.
        self.assertEqual(self.each(421), self.operations)
        self.assertEqual(self.each(403), self.operations)
        for operation in self.each(421):
            self.check(operation, operation.raw(service, b"Host: evil.example\r\n\r\n"), 421)
        for operation in self.each(403):
            self.check(operation, operation.raw(service, b"Host: localhost\r\nOrigin: http://evil.example\r\n\r\n"), 403)
        for operation in self.each(414):
            self.check(operation, operation.raw(service, b"Host: localhost\r\n\r\n", operation.path + "?" + "a" * 9000), 414)
        slow = self.each(408)
        body = b"Host: localhost\r\nContent-Length: 10\r\n\r\n{"  # a head in time, the rest never
        with concurrent.futures.ThreadPoolExecutor(len(slow)) as pool:  # they only wait
            for operation, answer in zip(slow, pool.map(lambda o: o.raw(service, body), slow)):
                self.check(operation, answer, 408)

    def deadlines(self, service):
        """Work that takes longer than its deadline on any machine."""
        points = [{"lat_deg": 26.0 + i * 1e-5, "lon_deg": 3.0} for i in range(20000)]
        slow = {"/v1/frames": frame_request(width=4000, height=4000, samples=36, pose=self.frame_pose()),
                "/v1/rays": {"rays": [{"origin_m": [1757400.0, i, 0.0], "direction": [-1.0, 0.0, 0.0]} for i in range(20000)]},
                "/v1/heights": {"points": points},
                "/v1/verify/mertis": {"channels": 10000, "temperatures_k": [300.0] * 16},
                "/v1/project": {"camera": frame_request()["camera"], "pose": self.frame_pose(), "points": points}}
        for operation in self.each(504):
            if operation.path in slow:
                self.check(operation, operation.ask(service, slow[operation.path], Request_Timeout_Ms="1"), 504)
            else:
                # The first height has a pyramid made: in a cache that none before has left one in.
                cold = Service("--assets-dir", ASSETS, cache="cold" + operation.path.replace("/", "-"))
                self.check(operation, operation.ask(cold, Request_Timeout_Ms="1"), 504)
                self.assertEqual(cold.stop(), 0)

    def frame_pose(self):
        return self.operations[0].examples["nadir"]["pose"]

    def long_frame(self, samples=100):
        return frame_request(width=4000, height=4000, samples=samples, pose=self.frame_pose())

    def metadata_of_their_own(self, service):
        frames = next(o for o in self.operations if o.path == "/v1/frames")
        body = dict(frames.small(), products=["range"], band={"response": [[0.4 + 0.0005 * i, 1.0 - 0.0001 * i] for i in range(900)]})
        headers, _ = self.check(frames, frames.ask(service, body, Accept="application/x-npy"), 200)
        self.assertLessEqual(len(headers["Selenograph-Meta"]), 6000)
        place = json.loads(headers["Selenograph-Meta"])["metadata_at"]
        operation = next(o for o in self.operations if o.path == "/v1/frames/{hash}/meta")
        self.check(operation, operation.ask(service, target=place), 200)

    def busy(self):
        service = Service("--max-frames", "1", "--max-waiting", "0", *SMALL_LIMITS)
        client = service.start_frame(self.long_frame())
        service.wait_for("selenograph_frames_in_work", 1)
        for operation in self.each(503):
            if operation.waits:
                headers, _ = self.check(operation, operation.ask(service), 503)
                self.assertGreaterEqual(int(headers["Retry-After"]), 1)
            else:
                self.check(operation, operation.ask(service), operation.good)
        client.close()
        service.wait_for("selenograph_frames_in_work", 0)
        self.assertEqual(service.stop(), 0)

    def shutting_down(self):
        service = Service("--max-frames", "2", *SMALL_LIMITS)
        client = service.start_frame(self.long_frame())
        service.wait_for("selenograph_frames_in_work", 1)
        service.process.terminate()
        service.wait_for("selenograph_ready", 0)
        for operation in self.operations:
            if operation.waits or operation.path == "/health/ready":
                self.check(operation, operation.ask(service), 503)
            else:
                self.check(operation, operation.ask(service), operation.good)
        client.close()
        self.assertEqual(service.process.wait(PATIENCE_S), 0)
        service.stop()

    def too_many_connections(self):
        """Every connection that there may be is at work: only health and metrics are answered."""
        service = Service("--max-connections", "4", "--max-frames", "4", "--deadline-s", "3600", *SMALL_LIMITS)
        clients = [service.start_frame(self.long_frame(256)) for _ in range(4)]

        def all_at_work():
            for i, client in enumerate(clients):
                if select.select([client.sock], [], [], 0)[0]:  # refused while the last scrape's connection still counted
                    client.close()
                    clients[i] = service.start_frame(self.long_frame(256))
            return service.metric("selenograph_frames_in_work") == 4

        harness.wait_until(all_at_work, "four frames at work")
        for operation in self.operations:
            answer = operation.raw(service, b"Host: localhost\r\nContent-Length: 0\r\n\r\n")
            if operation.path in ("/health/live", "/health/ready", "/metrics"):
                self.assertEqual(answer[0], 200, operation)
            else:
                headers, _ = self.check(operation, answer, 503)
                self.assertGreaterEqual(int(headers["Retry-After"]), 1)
        for client in clients:
            client.close()
        self.assertEqual(service.stop(), 0)

    def damaged_terrain(self):
        service = Service("--assets-dir", ASSETS, cache="cache-damaged", dem="damaged")
        os.truncate(harness.path("damaged", DAMAGED + ".img"), 1000)
        bodies = {"/v1/rays": {"rays": [{"origin_m": [1570000.0, 99700.0, 773000.0], "direction": [-0.9, -0.0569, -0.44]}]},
                  "/v1/sky": {"camera": frame_request()["camera"], "utc": "2026-11-25T00:00:00Z", "sky": {"stars": True},
                              "pose": {"geodetic": {"lat_deg": 26.1322, "lon_deg": 3.6339, "height_m": 3000.0}, "nadir": {}}},
                  "/v1/limb": {"camera": frame_request()["camera"],
                               "pose": {"geodetic": {"lat_deg": 26.1322, "lon_deg": 3.6339, "height_m": 3000.0}, "nadir": {}}},
                  "/v1/features": {"detail": "highlands", "smallest_m": 20,
                                   "region": {"south_deg": 26.1, "north_deg": 26.11, "west_deg": 3.62, "east_deg": 3.63}}}
        for operation in self.each(500):
            _, body = self.check(operation, operation.ask(service, bodies.get(operation.path)), 500)
            self.assertIn(DAMAGED, json.loads(body)["detail"])
        self.assertEqual(service.stop(), 0)


class Schemas(Documented):
    def test_schemas_are_valid(self):
        for name, schema in DOCUMENT["components"]["schemas"].items():
            with self.subTest(schema=name):
                jsonschema.Draft202012Validator.check_schema(schema)

    def test_examples_and_defaults_follow_them(self):
        def walk(node, where):
            if isinstance(node, dict):
                if "schema" in node and "examples" in node:
                    for name, example in node["examples"].items():
                        with self.subTest(where=where, example=name):
                            validator(node["schema"]).validate(example["value"])
                if "default" in node and ("type" in node or "oneOf" in node or "$ref" in node):
                    with self.subTest(where=where):
                        validator(node).validate(node["default"])
                for key, value in node.items():
                    walk(value, f"{where}/{key}")
            elif isinstance(node, list):
                for i, value in enumerate(node):
                    walk(value, f"{where}/{i}")

        walk(DOCUMENT, "")

    def test_service_refuses_what_schemas_refuse(self):
        """Each member of each example is left out, misspelt, of other types and out of range (a quarter of that by
        default): where the schema says no, so does the service, and it points at something."""
        service = Service(*SMALL_LIMITS)
        refused = 0
        for operation in self.operations:
            if not operation.schema:
                continue
            schema = validator(operation.schema)
            for name, example in operation.examples.items():
                for what, body in harness.share(mutations(example), 4):
                    if schema.is_valid(body):
                        continue
                    with self.subTest(operation=str(operation), example=name, mutation=what):
                        _, answer = self.check(operation, operation.ask(service, json.dumps(body).encode()), 422)
                        self.assertTrue(json.loads(answer)["errors"])
                    refused += 1
        self.assertEqual(service.stop(), 0)
        self.assertGreater(refused, 300)


def mutations(document):
    """(what, copy) of a JSON document, with one thing changed in each."""
    places = []

    def collect(node, path):
        for key in node if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ():
            places.append((*path, key))
            collect(node[key], (*path, key))

    def changed(path, change):
        whole = copy.deepcopy(document)
        parent = whole
        for key in path[:-1]:
            parent = parent[key]
        change(parent, path[-1])
        return whole

    collect(document, ())
    for path in places:
        def replace(value):
            return lambda parent, key: parent.__setitem__(key, value)

        where = "/" + "/".join(map(str, path))
        for value in (None, True, "text", "", -1, 0.5, 1e12, -1e12, [], [1], {}, {"a": 1}):
            yield f"{where} = {json.dumps(value)}", changed(path, replace(value))
        yield f"{where} left out", changed(path, lambda parent, key: parent.pop(key))
        if isinstance(path[-1], str):
            yield f"{where} misspelt", changed(path, lambda parent, key: parent.__setitem__(key + "x", parent.pop(key)))


class Linter(unittest.TestCase):
    def test_redocly(self):
        linter = shutil.which("redocly")
        if not linter:
            self.skipTest("no linter: npm install -g @redocly/cli")
        harness.write("openapi.json", DOCUMENT)
        environment = dict(os.environ, REDOCLY_TELEMETRY="off", REDOCLY_SUPPRESS_UPDATE_NOTICE="true")
        done = subprocess.run([linter, "lint", "openapi.json"], cwd=harness.path(), env=environment, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, timeout=PATIENCE_S)
        self.assertEqual(done.returncode, 0, done.stdout)


if __name__ == "__main__":
    harness.main()
