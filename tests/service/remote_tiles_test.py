#!/usr/bin/env python3
"""Tiles on a server that delays, fails, hangs up, cuts short and forgets, under the real service.

What --remote-prefix allows is read, and nothing else. A lost connection is tried again; then an error names the tile, nothing is
remembered of it, and a request after the fault gets what it would have got without. The catalogue itself is kept between starts.
"""

import functools
import http.server
import itertools
import json
import os
import random
import socket
import struct
import threading
import time
import unittest
import unittest.mock

import harness
from harness import Service

SIDE, TILED = 512, 128  # posts of a tile, and of one of the blocks within
PLACES = [(0.5, 30.5), (0.31, 30.77), (0.9, 30.12)]
NO_SUCH_KEY = b"<?xml version='1.0'?><Error><Code>NoSuchKey</Code><Message>none</Message></Error>"  # as S3 says it
TIMES = {"GDAL_HTTP_TIMEOUT": "1", "GDAL_HTTP_CONNECTTIMEOUT": "1"}


def height_at(lat_deg, lon_deg):
    return round(1000 * lat_deg + 500 * (lon_deg - 30))


@functools.lru_cache
def blocks_of_posts():
    posts = [[height_at(1 - (r + 0.5) / SIDE, 30 + (c + 0.5) / SIDE) for c in range(SIDE)] for r in range(SIDE)]
    return [b"".join(struct.pack(f"<{TILED}h", *posts[r][left:left + TILED]) for r in range(top, top + TILED))
            for top in range(0, SIDE, TILED) for left in range(0, SIDE, TILED)]


def tiff(west_deg=30):
    """A tiled GeoTIFF of int16 posts, 0 to 1 N and one degree wide, on the Moon's sphere."""
    blocks = blocks_of_posts()
    keys = [(1024, 0, 1, 2), (1025, 0, 1, 1), (2048, 0, 1, 32767), (2050, 0, 1, 32767), (2052, 0, 1, 9001), (2054, 0, 1, 9102),
            (2056, 0, 1, 32767), (2057, 34736, 1, 0), (2058, 34736, 1, 1)]
    directory = [1, 1, 0, len(keys)] + [number for key in keys for number in key]
    tags = [(256, "H", [SIDE]), (257, "H", [SIDE]), (258, "H", [16]), (259, "H", [1]), (262, "H", [1]), (277, "H", [1]), (322, "H", [TILED]),
            (323, "H", [TILED]), (324, "L", [0] * len(blocks)), (325, "L", [len(b) for b in blocks]), (339, "H", [2]),
            (33550, "d", [1 / SIDE, 1 / SIDE, 0]), (33922, "d", [0, 0, 0, west_deg, 1, 0]), (34735, "H", directory),
            (34736, "d", [1737400.0, 1737400.0])]
    start = 8 + 2 + 12 * len(tags) + 4

    def lay_out(offsets):
        entries, values = b"", b""
        for tag, kind, numbers in tags:
            numbers = offsets if tag == 324 else numbers
            data = struct.pack(f"<{len(numbers)}{kind}", *numbers)
            where = data.ljust(4, b"\0") if len(data) <= 4 else struct.pack("<L", start + len(values))
            if len(data) > 4:
                values += data
            entries += struct.pack("<HHL", tag, {"H": 3, "L": 4, "d": 12}[kind], len(numbers)) + where
        return b"II*\0\x08\0\0\0" + struct.pack("<H", len(tags)) + entries + b"\0\0\0\0" + values

    first = len(lay_out([0] * len(blocks)))
    return lay_out([first + i * len(blocks[0]) for i in range(len(blocks))]) + b"".join(blocks)


class Tiles(http.server.ThreadingHTTPServer):
    """Serves `files`; the next `fault[1]` requests of names that begin with `fault[2]` go wrong as `fault[0]` says."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Answer)
        self.files, self.modified, self.etag, self.redirects = {}, "Tue, 03 Mar 2020 10:00:00 GMT", None, {}
        self.requests, self.fault, self.lock, self.over = [], None, threading.Lock(), threading.Event()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def prefix(self):
        return f"/vsicurl/http://127.0.0.1:{self.server_port}/"

    def handle_error(self, request, client_address):
        pass  # connections that a test breaks

    def go_wrong(self, kind, times=10 ** 9, name="/", least_offset=0):
        with self.lock:
            self.fault = [kind, times, name, least_offset] if kind else None

    def fault_of(self, path, offset):
        with self.lock:
            if not self.fault or self.fault[1] <= 0 or not path.startswith(self.fault[2]) or offset < self.fault[3]:
                return None
            self.fault[1] -= 1
            return self.fault[0]

    def asked(self, method=None):
        with self.lock:
            return [r for r in self.requests if method in (None, r[0])]

    def forget(self):
        with self.lock:
            self.requests = []


class Answer(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def do_HEAD(self):
        self.answer(False)

    def do_GET(self):
        self.answer(True)

    def answer(self, with_body):
        server, wanted = self.server, self.headers.get("Range")
        with server.lock:
            server.requests.append((self.command, self.path, wanted))
        content = server.files.get(self.path)
        first, last = 0, len(content or b"") - 1
        if content and wanted:
            first, _, end = wanted.partition("=")[2].partition("-")
            first, last = int(first), min(int(end or last), last)
        fault = server.fault_of(self.path, first)
        if fault == "hang up":
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # by a reset
            self.connection.close()
            self.close_connection = True
            return
        if fault == "delay":
            server.over.wait(30)
        if isinstance(fault, int):
            return self.send(fault, b"<html>sorry</html>", with_body)
        if self.path in server.redirects:
            self.send_response(302)
            self.send_header("Location", server.redirects[self.path])
            self.send_header("Content-Length", "0")
            return self.end_headers()
        if content is None:
            return self.send(404, NO_SUCH_KEY, with_body)
        body = content[first:last + 1]
        self.send_response(206 if wanted else 200)
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Last-Modified", server.modified)
        if server.etag:
            self.send_header("ETag", server.etag)
        if wanted:
            self.send_header("Content-Range", f"bytes {first}-{last}/{len(content)}")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if not with_body:
            return
        if fault == "truncate":
            self.wfile.write(body[:len(body) // 2])
            self.close_connection = True
        elif fault == "trickle":
            self.wfile.write(body[:100])
            self.wfile.flush()
            server.over.wait(30)
            self.close_connection = True
        else:
            self.wfile.write(body)

    def send(self, status, body, with_body):
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if with_body:
            self.wfile.write(body)


def setUpModule():
    harness.set_up()
    os.environ.update(TIMES)


def tearDownModule():
    harness.tear_down()


class AsksForHeights(unittest.TestCase):
    def height(self, place=PLACES[0]):
        return self.service.ask("GET", f"/v1/height?lat_deg={place[0]}&lon_deg={place[1]}", headers={"Request-Timeout-Ms": "60000"})

    def check_heights(self):
        for place in PLACES:
            status, _, body = self.height(place)
            self.assertEqual(status, 200, body)
            self.assertAlmostEqual(json.loads(body)["height_m"], height_at(*place), delta=1.01)


class RemoteTiles(AsksForHeights):
    def setUp(self):
        self.server = Tiles()
        self.server.files["/dem/moon.tif"] = tiff()
        self.url = self.server.prefix + "dem/moon.tif"
        self.cache = f"cache-{self.id()}"
        self.service = None

    def tearDown(self):
        self.server.over.set()
        if self.service:
            self.assertEqual(self.service.stop(), 0)
        self.server.shutdown()
        self.server.server_close()

    def start(self, *dem, more=()):
        self.service = Service(options=["--port", "0", "--cache-dir", harness.path(self.cache), "--remote-prefix", self.server.prefix + "dem/",
                                        "/vsis3/another/", *more, "--dem", *(dem or [self.url])])
        return self.service

    def info(self, *dem, prefixes=None):
        allowed = ["--remote-prefix", *prefixes] if prefixes else []
        return harness.run("info", "--json", "--cache-dir", harness.path(self.cache), *allowed, "--dem", *(dem or [self.url]))

    def check_fault(self, status=503, tile="dem/moon.tif"):
        got, headers, body = self.height()
        self.assertEqual(got, status, body)
        document = json.loads(body)
        self.assertIn(self.server.prefix + tile, document["detail"])
        self.assertEqual("Retry-After" in headers, status == 503)
        return document["detail"]

    def test_allowed_prefixes_are_read(self):
        self.start()
        self.check_heights()
        datasets = json.loads(self.service.ask("GET", "/v1/datasets")[2])["datasets"]
        self.assertEqual([(d["name"], d["path"], d["bytes"]) for d in datasets], [("moon", self.url, len(self.server.files["/dem/moon.tif"]))])
        # Neither a folder's listing nor names that might lie beside it.
        self.assertEqual({r[1] for r in self.server.asked()}, {"/dem/moon.tif"})

    def test_other_urls_are_refused(self):
        self.server.files["/other.tif"] = self.server.files["/dem/moon.tif"]
        for name in (self.server.prefix + "other.tif", self.server.prefix + "dem/../other.tif", self.server.prefix + "dem/%2e%2E/other.tif",
                     self.url.replace("/vsicurl/", "/vsicurl_streaming/"), self.url.replace("/vsicurl/", "/vsicurl?url="),
                     "/vsizip/" + self.url):
            done = self.info(name, prefixes=["/vsis3/another/", self.server.prefix + "dem/"])
            self.assertNotEqual(done.returncode, 0, name)
            self.assertIn(name, done.stderr)
            self.assertIn("--remote-prefix", done.stderr)
        self.assertNotEqual(self.info().returncode, 0)
        self.assertEqual(self.server.asked(), [])

    def test_a_prefix_ends_where_a_name_does(self):
        host = self.server.prefix.rstrip("/")
        self.assertNotEqual(self.info(prefixes=[host[:-1]]).returncode, 0, "a port that begins like another")
        self.assertEqual(self.server.asked(), [])
        self.assertEqual(self.info(prefixes=[host]).returncode, 0)

    def test_redirects_stay_within_the_prefixes(self):
        other = Tiles()
        other.files["/dem/moon.tif"] = self.server.files["/dem/moon.tif"]
        elsewhere = other.prefix + "dem/moon.tif"
        allowed = self.server.prefix + "dem/"
        try:
            for location, target in ((elsewhere.removeprefix("/vsicurl/"), elsewhere), ("/other/moon.tif", self.server.prefix + "other/moon.tif")):
                with self.subTest(location):
                    self.server.files["/other/moon.tif"] = other.files["/dem/moon.tif"]
                    self.server.redirects = {"/dem/moon.tif": location}
                    done = self.info(prefixes=[allowed])
                    self.assertNotEqual(done.returncode, 0)
                    for words in (self.url, target, "--remote-prefix"):
                        self.assertIn(words, done.stderr)
                    self.assertEqual([r for r in other.asked() + self.server.asked() if r[0] == "GET"], [])
                    done = self.info(prefixes=[allowed, target])
                    self.assertEqual(done.returncode, 0, done.stderr)
                    self.server.forget()
                    other.forget()
            self.server.files["/dem/real.tif"] = other.files["/dem/moon.tif"]
            self.server.redirects = {"/dem/moon.tif": "real.tif"}
            self.start()
            self.check_heights()
        finally:
            other.shutdown()
            other.server_close()

    def test_another_etag_is_another_file(self):
        self.server.etag = '"one"'
        first = self.info(prefixes=[self.server.prefix])
        self.assertEqual(first.returncode, 0, first.stderr)
        self.assertEqual(self.info(prefixes=[self.server.prefix]).stdout, first.stdout)
        self.start()
        self.server.etag = '"two"'
        self.assertIn("changed", self.check_fault(500))
        self.server.etag = '"one"'
        self.check_heights()
        self.server.etag = '"two"'
        second = self.info(prefixes=[self.server.prefix])
        self.assertNotEqual(json.loads(second.stdout)["fingerprint"], json.loads(first.stdout)["fingerprint"])

    def write_vrt(self, url):
        with open(harness.path("v.vrt"), "w") as f:
            f.write(f'<VRTDataset rasterXSize="{SIDE}" rasterYSize="{SIDE}"><SRS>GEOGCS["Moon",DATUM["Moon",SPHEROID["Moon",1737400,0]],'
                    f'PRIMEM["0",0],UNIT["degree",0.0174532925199433]]</SRS><GeoTransform>30, {1 / SIDE}, 0, 1, 0, {-1 / SIDE}</GeoTransform>'
                    '<VRTRasterBand dataType="Int16" band="1"><SimpleSource><SourceFilename relativeToVRT="0">' + url +
                    f'</SourceFilename><SourceBand>1</SourceBand><SourceProperties RasterXSize="{SIDE}" RasterYSize="{SIDE}" '
                    f'DataType="Int16" BlockXSize="{TILED}" BlockYSize="{TILED}"/></SimpleSource></VRTRasterBand></VRTDataset>')

    def test_a_vrt_may_name_them(self):
        self.write_vrt(self.url)
        self.start(harness.path("v.vrt"))
        self.server.go_wrong("hang up")
        self.check_fault()
        self.server.go_wrong(503)
        self.check_fault()
        self.server.go_wrong(None)
        self.check_heights()
        self.assertEqual({r[1] for r in self.server.asked()}, {"/dem/moon.tif"})

    def test_a_source_that_is_not_there_is_a_gap(self):
        self.write_vrt(self.server.prefix + "dem/none.tif")
        done = self.info(harness.path("v.vrt"), prefixes=[self.server.prefix])
        self.assertIn("none.tif is missing", done.stdout)
        self.assertEqual([d["name"] for d in json.loads(done.stdout)["datasets"]], ["v"])

    def test_passing_faults_are_tried_again(self):
        self.start()
        for kind in (503, 500, "hang up", "truncate", "trickle") if harness.full_effort() else (503, "truncate"):
            with self.subTest(kind):
                self.service.stop()
                self.cache = f"cache-passing-{kind}"
                self.start()
                self.server.go_wrong(kind, times=2)
                self.check_heights()
                self.assertEqual(self.server.fault[1], 0, "nothing went wrong")
                self.server.go_wrong(None)

    def test_lasting_faults_name_the_tile_and_are_forgotten(self):
        self.start()
        # From the start, or behind the header: by default one of them for each kind.
        for i, (kind, offset) in enumerate(itertools.product((503, "hang up", "truncate", "trickle", "delay"), (0, 100000))):
            if i % 4 in (0, 3) or harness.full_effort():
                with self.subTest(kind=kind, offset=offset):
                    self.server.go_wrong(kind, least_offset=offset)
                    self.check_fault()
        self.assertEqual([name for _, _, names in os.walk(harness.path(self.cache, "pyramid")) for name in names], [])
        self.server.go_wrong(None)
        self.server.over.set()
        self.check_heights()

    def test_a_server_that_never_answers_is_given_up(self):
        self.start()
        self.server.go_wrong("delay")
        begin = time.monotonic()
        self.check_fault()
        self.assertLess(time.monotonic() - begin, 45)

    def test_a_tile_that_is_gone_or_another(self):
        self.start()
        content = self.server.files.pop("/dem/moon.tif")
        self.assertIn("missing", self.check_fault(500))
        self.server.files["/dem/moon.tif"] = content
        self.server.modified = "Wed, 04 Mar 2020 10:00:00 GMT"
        self.assertIn("changed", self.check_fault(500))
        self.server.modified = "Tue, 03 Mar 2020 10:00:00 GMT"
        self.check_heights()

    def test_a_file_that_is_cut_short_on_its_server_is_no_terrain(self):
        whole = self.server.files["/dem/moon.tif"]
        self.server.files["/dem/moon.tif"] = whole[:len(whole) // 2]
        self.start()
        got = [self.height(place)[0] for place in PLACES]
        self.assertEqual(got, [500] * len(PLACES))

    def test_one_that_cant_be_reached_at_the_start(self):
        self.server.go_wrong("hang up")
        done = self.info(prefixes=[self.server.prefix])
        self.assertNotEqual(done.returncode, 0)
        self.assertIn(self.url, done.stderr)
        self.server.go_wrong(None)
        first = self.info(prefixes=[self.server.prefix])
        self.assertEqual(first.returncode, 0, first.stderr)
        # From now on it is known: what it holds need not be read again, and a server that is away for a while is believed.
        self.server.forget()
        second = self.info(prefixes=[self.server.prefix])
        self.assertEqual(second.stdout, first.stdout)
        self.assertEqual(self.server.asked("GET"), [])
        self.server.go_wrong("hang up")
        third = self.info(prefixes=[self.server.prefix])
        self.assertEqual(third.stdout, first.stdout)
        self.assertIn(self.url, third.stderr)
        self.server.go_wrong(None)
        self.server.modified = "Wed, 04 Mar 2020 10:00:00 GMT"
        fourth = self.info(prefixes=[self.server.prefix])
        self.assertNotEqual(json.loads(fourth.stdout)["fingerprint"], json.loads(first.stdout)["fingerprint"])
        self.server.files.clear()
        self.assertNotEqual(self.info(prefixes=[self.server.prefix]).returncode, 0)

    def test_many_are_asked_for_at_once(self):
        names = [f"/dem/t{i}.tif" for i in range(40)]
        for i, name in enumerate(names):
            self.server.files[name] = tiff(west_deg=i)
        done = self.info(*(self.server.prefix + name[1:] for name in names), prefixes=[self.server.prefix])
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(sorted(d["name"] for d in json.loads(done.stdout)["datasets"]), sorted(f"t{i}" for i in range(40)))

    def test_random_faults_change_no_answer(self):
        self.start()
        chance = random.Random(7)
        faults = ["hang up", "truncate", 503, None, None, None, None]
        self.server.fault_of = lambda path, offset: chance.choice(faults)
        for place in PLACES:
            for _ in range(40):  # four faults in a row are 503, and not rare
                status, _, body = self.height(place)
                if status == 200:
                    break
                self.assertEqual(status, 503, body)
            self.assertEqual(status, 200)
            self.assertAlmostEqual(json.loads(body)["height_m"], height_at(*place), delta=1.01)


class ASlowServer(AsksForHeights):
    """One that lets requests for its tile wait keeps nobody waiting who asks for something else."""

    def setUp(self):
        self.server = Tiles()
        self.server.files["/dem/moon.tif"] = tiff()
        self.url = self.server.prefix + "dem/moon.tif"
        if not os.path.isdir(harness.path("local")):
            harness.sample("local", "--south-deg", "0", "--west-deg", "90", "--rows", "1", "--columns", "1", "--ppd", "512")
        self.cache = harness.path(f"cache-{self.id()}")
        self.service = None

    def tearDown(self):
        self.server.over.set()
        self.assertEqual(self.service.stop(), 0)
        self.server.shutdown()
        self.server.server_close()

    def start(self, *more):
        with unittest.mock.patch.dict(os.environ, {"GDAL_HTTP_TIMEOUT": "60", "GDAL_HTTP_LOW_SPEED_TIME": "60"}):
            self.service = Service(options=["--port", "0", "--cache-dir", self.cache, *more, "--remote-prefix", self.server.prefix + "dem/",
                                            "--dem", self.url, harness.path("local")])

    def frame_over(self, lat_deg, lon_deg, height_m=20000.0, **accuracy):
        pose = {"geodetic": {"lat_deg": lat_deg, "lon_deg": lon_deg, "height_m": height_m}, "nadir": {"up_azimuth_deg": 0.0}}
        sun = {"local": {"lat_deg": lat_deg, "lon_deg": lon_deg, "azimuth_deg": 90.0, "elevation_deg": 15.0}}
        return self.service.frame(harness.frame_request(pose=pose, sun=sun, accuracy=accuracy), "application/x-npy",
                                  Request_Timeout_Ms="40000")

    def check_others_while(self, ask, least_offset=0):
        """ask() needs what lies behind an offset in the slow tile."""
        answers = []
        waiting = threading.Thread(target=lambda: answers.append(ask()))
        self.server.go_wrong("delay", least_offset=least_offset)
        waiting.start()
        give_up = time.monotonic() + 20
        while self.server.fault[1] == 10 ** 9 and time.monotonic() < give_up:
            time.sleep(0.01)
        self.assertLess(self.server.fault[1], 10 ** 9, "nobody waits")
        time.sleep(0.5)  # until all that can wait for the server does
        self.assertEqual([self.frame_over(0.5, 90.5)[0] for _ in range(2)], [200, 200])
        self.assertEqual(self.service.ask("GET", "/v1/height?lat_deg=0.2&lon_deg=90.8")[0], 200)
        for path in ("/health/ready", "/health/live", "/v1/datasets", "/metrics"):
            self.assertEqual(self.service.ask("GET", path)[0], 200, path)
        self.assertEqual(len(answers), 0, "they waited for the slow tile")
        self.server.go_wrong(None)
        self.server.over.set()
        waiting.join()
        self.assertEqual(answers[0][0], 200, answers[0][2][:300])

    def test_pyramids_of_other_tiles_are_built(self):
        self.start()
        self.check_others_while(lambda: self.frame_over(0.5, 30.5))
        self.check_heights()

    def test_frames_of_other_tiles_have_threads(self):
        def ask():
            return self.frame_over(0.85, 30.5, 40000.0, max_error_px=0)

        self.start()
        first = ask()
        self.assertEqual(first[0], 200)
        self.assertEqual(self.service.stop(), 0)
        self.start()  # the pyramid is there; the posts themselves come from the server
        again = []
        # The ground below the camera is there, what else it sees, by many blocks, isn't.
        self.check_others_while(lambda: again.append(ask()) or again[0], least_offset=len(self.server.files["/dem/moon.tif"]) // 2)
        self.assertTrue(again[0][2] == first[2])


class TilesInABucket(AsksForHeights):
    """The same by GDAL's file system for S3, at an endpoint of this machine."""

    def setUp(self):
        self.server = Tiles()
        self.server.files["/bucket/dem/moon.tif"] = tiff()
        self.url = "/vsis3/bucket/dem/moon.tif"
        endpoint = {"AWS_S3_ENDPOINT": f"127.0.0.1:{self.server.server_port}", "AWS_HTTPS": "NO",
                    "AWS_VIRTUAL_HOSTING": "FALSE", "AWS_NO_SIGN_REQUEST": "YES"}
        with unittest.mock.patch.dict(os.environ, endpoint):
            self.service = Service(options=["--port", "0", "--cache-dir", harness.path(f"cache-{self.id()}"),
                                            "--remote-prefix", "/vsis3/bucket/dem/", "--dem", self.url])

    def tearDown(self):
        self.assertEqual(self.service.stop(), 0)
        self.server.shutdown()
        self.server.server_close()

    def test_they_are_read(self):
        self.check_heights()
        self.assertEqual({r[1].partition("?")[0] for r in self.server.asked()}, {"/bucket/dem/moon.tif"})

    def test_faults_are_tried_again_then_name_the_tile(self):
        for kind in (503, "hang up", "truncate"):
            with self.subTest(kind):
                self.server.go_wrong(kind)
                status, headers, body = self.height()
                self.assertEqual(status, 503, body)
                self.assertIn("Retry-After", headers)
                self.assertIn(self.url, json.loads(body)["detail"])
        for kind in (503, "hang up", "truncate"):
            self.server.go_wrong(kind, times=1)
            self.check_heights()

    def test_one_that_is_gone(self):
        del self.server.files["/bucket/dem/moon.tif"]
        status, _, body = self.height()
        self.assertEqual(status, 500, body)
        self.assertIn(self.url + " is missing", json.loads(body)["detail"].replace(": ", " "))


if __name__ == "__main__":
    harness.main()
