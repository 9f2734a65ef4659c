#!/usr/bin/env python3
"""Tiles on a server, under the real service: the same bytes as from a disk, within the prefixes of --remote-prefix.

A server that is away gives an error that names the tile; the rest of the terrain serves, and nothing is remembered of the fault.
"""

import functools
import http.server
import json
import os
import struct
import threading
import unittest

import harness
from harness import Service, tearDownModule

SIDE, TILED = 512, 128  # posts of a tile, and of one of the blocks within


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
    """Serves `files`; answers all requests with the status `fault` instead, if it is set."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Answer)
        self.files, self.requests, self.fault = {}, [], None
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def prefix(self):
        return f"/vsicurl/http://127.0.0.1:{self.server_port}/"


class Answer(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def do_HEAD(self):
        self.do_GET(with_body=False)

    def do_GET(self, with_body=True):
        self.server.requests.append(self.path)
        content, wanted = self.server.files.get(self.path), self.headers.get("Range")
        status = self.server.fault or (404 if content is None else 206 if wanted else 200)
        body = content if status < 300 else b""
        self.send_response(status)
        if status == 206:
            first, _, last = wanted.partition("=")[2].partition("-")
            body = content[int(first):int(last or len(content)) + 1]
            self.send_header("Content-Range", f"bytes {first}-{int(first) + len(body) - 1}/{len(content)}")
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Last-Modified", "Tue, 03 Mar 2020 10:00:00 GMT")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if with_body:
            self.wfile.write(body)


def setUpModule():
    harness.set_up()
    os.environ["GDAL_HTTP_RETRY_DELAY"] = "0.01"
    os.makedirs(harness.path("disk"))
    with open(harness.path("disk/moon.tif"), "wb") as f:
        f.write(tiff())


class RemoteTiles(unittest.TestCase):
    def setUp(self):
        self.server = Tiles()
        self.server.files["/dem/moon.tif"] = tiff()
        self.url = self.server.prefix + "dem/moon.tif"

    def tearDown(self):
        self.server.shutdown()
        self.server.server_close()

    def start(self, *dem):
        service = Service(options=["--port", "0", "--cache-dir", harness.path(f"cache-{self.id()}-{len(dem[0])}"), "--remote-prefix",
                                   self.server.prefix + "dem/", "--dem", *dem])
        self.addCleanup(lambda: self.assertEqual(service.stop(), 0))
        return service

    def frame(self, service, lat_deg=0.5, lon_deg=30.5):
        pose = {"geodetic": {"lat_deg": lat_deg, "lon_deg": lon_deg, "height_m": 20000.0}, "nadir": {"up_azimuth_deg": 0.0}}
        sun = {"local": {"lat_deg": lat_deg, "lon_deg": lon_deg, "azimuth_deg": 90.0, "elevation_deg": 15.0}}
        return service.frame(harness.frame_request(pose=pose, sun=sun), "application/x-npy")

    def info(self, name, *prefixes):
        return harness.run("info", "--json", "--cache-dir", harness.path("cache"), "--remote-prefix", *prefixes, "--dem", name)

    def test_the_bytes_of_a_disk(self):
        remote = self.frame(self.start(self.url))
        self.assertEqual(remote[0], 200, remote[2][:300])
        self.assertTrue(remote[2] == self.frame(self.start(harness.path("disk/moon.tif")))[2])
        # Neither a folder's listing nor names that might lie beside the tile.
        self.assertEqual(set(self.server.requests), {"/dem/moon.tif"})

    def test_a_vrt_may_name_them(self):
        with open(harness.path("v.vrt"), "w") as f:
            f.write(f'<VRTDataset rasterXSize="{SIDE}" rasterYSize="{SIDE}"><SRS>GEOGCS["Moon",DATUM["Moon",SPHEROID["Moon",1737400,0]],'
                    f'PRIMEM["0",0],UNIT["degree",0.0174532925199433]]</SRS><GeoTransform>30, {1 / SIDE}, 0, 1, 0, {-1 / SIDE}</GeoTransform>'
                    f'<VRTRasterBand dataType="Int16" band="1"><SimpleSource><SourceFilename relativeToVRT="0">{self.url}'
                    '</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>')
        service = self.start(harness.path("v.vrt"))
        self.server.fault = 503
        status, _, body = self.frame(service)
        self.assertEqual(status, 503, body[:300])
        self.server.fault = None
        self.assertEqual(self.frame(service)[0], 200)

    def test_other_names_are_refused(self):
        self.server.files["/other.tif"] = self.server.files["/dem/moon.tif"]
        for name in (self.server.prefix + "other.tif", self.server.prefix + "dem/../other.tif",
                     self.url.replace("/vsicurl/", "/vsicurl_streaming/"), "/vsizip/" + self.url):
            done = self.info(name, self.server.prefix + "dem/")
            self.assertNotEqual(done.returncode, 0, name)
            self.assertIn(name, done.stderr)
            self.assertIn("--remote-prefix", done.stderr)
        host = self.server.prefix.rstrip("/")
        self.assertNotEqual(self.info(self.url, host[:-1]).returncode, 0, "a port that begins like another")
        self.assertEqual(self.server.requests, [])
        self.assertEqual(self.info(self.url, host).returncode, 0)

    def test_a_server_that_is_away(self):
        harness.sample("local", "--south-deg", "0", "--west-deg", "90", "--rows", "1", "--columns", "1", "--ppd", "512")
        service = self.start(self.url, harness.path("local"))
        content = self.server.files.pop("/dem/moon.tif")
        for fault in (503, 500, None):  # None: the server has no such file
            with self.subTest(fault=fault):
                self.server.fault = fault
                status, headers, body = self.frame(service)
                self.assertEqual(status, 503, body[:300])
                self.assertIn("Retry-After", headers)
                self.assertIn(self.url, json.loads(body)["detail"])
                self.assertEqual(self.frame(service, 0.5, 90.5)[0], 200)
        done = self.info(self.url, self.server.prefix)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn(self.url, done.stderr)
        self.server.files["/dem/moon.tif"] = content
        self.assertEqual(self.frame(service)[0], 200)


if __name__ == "__main__":
    harness.main()
