#!/usr/bin/env python3
"""Files that the system can't write or must not fetch, under the real service.

A cache folder that can't be written costs time, not answers, and no byte of them; nothing is fetched from a network.
"""

import http.server
import json
import os
import re
import resource
import shutil
import subprocess
import threading
import unittest

import harness
from harness import frame_request, PLACE, Service, tearDownModule

HEIGHT = "/v1/height?lat_deg=0.1&lon_deg=30.1"
HIT = "DTM_MAP_01_N01E030N00E031SC"


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE, "--columns", "2", "--ppd", "256")


def pyramid(cache):
    """Path: (size, time) of all files of the pyramid."""
    found = {}
    for folder, _, names in os.walk(harness.path(cache, "pyramid")):
        for name in names:
            state = os.stat(os.path.join(folder, name))
            found[os.path.join(folder, name)] = (state.st_size, state.st_mtime_ns)
    return found


class CommandLine(unittest.TestCase):
    def run_it(self, *arguments):
        return subprocess.run([harness.BINARY, *arguments], capture_output=True, text=True, timeout=60, check=False)

    def test_a_folder_without_dems_is_an_error(self):
        os.makedirs(harness.path("nothing", "within"))
        for command in (("info",), ("serve", "--port", "0")):
            done = self.run_it(*command, "--dem", harness.path("nothing"), "--cache-dir", harness.path("cache-nothing"))
            self.assertEqual(done.returncode, 1, done.stdout)
            self.assertIn(f"{harness.path('nothing')}: has no DEM file", done.stderr)
        harness.write(os.path.join("nothing", "a.lbl"), "not a label")
        self.assertIn("has no usable DEM file: ", self.run_it("info", "--dem", harness.path("nothing")).stderr)

    def test_info_has_lowest_and_highest_height(self):
        for line in self.run_it("info", "--dem", harness.path("dem")).stdout.splitlines()[1:5]:
            found = re.search(r", (-?\d+\.\d) to (-?\d+\.\d) m$", line)
            self.assertTrue(found, line)
            self.assertLess(float(found[1]), float(found[2]))

    def test_info_says_which_heights_are_taken_for_voids(self):
        shutil.copytree(harness.path("dem"), harness.path("dem-high"))
        with open(harness.path("dem-high", HIT + ".img"), "r+b") as file:
            file.write((20000).to_bytes(2, "big") * 256)
        high, *others = sorted(self.run_it("info", "--dem", harness.path("dem-high")).stdout.splitlines()[1:5],
                               key=lambda line: HIT not in line)
        self.assertRegex(high, r" to 20000\.0 m; posts outside of -12000 \.\. 13000 m are taken as voids$")
        self.assertNotIn("voids", "".join(others))

    def test_info_lists_the_rest_beside_a_vrt_without_its_source(self):
        shutil.copytree(harness.path("dem"), harness.path("gap"))
        harness.write(os.path.join("gap", "v.vrt"), VRT.format(name=harness.path("gap", "gone.tif"), properties=PROPERTIES))
        for borders in ("0", "64"):
            done = self.run_it("info", "--dem", harness.path("gap"), "--borders", borders)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertRegex(done.stdout, rf"  {HIT} .* m\n")
            self.assertRegex(done.stdout, r"v\.vrt: its source .*gone\.tif is missing\n")
        done = self.run_it("info", "--dem", harness.path("gap"), "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("gone.tif is missing", json.loads(done.stdout)["problems"][0]["what"])

    def test_a_request_that_is_a_folder_is_named(self):
        folder = harness.path("dem")
        for arguments in (("ask", "frames", folder, "-o", "x.png", "--dem", folder),
                          ("batch", folder, "-o", "x", "--dem", folder), ("verify", "mertis", "--instrument", folder, "-o", "x")):
            done = self.run_it(*(harness.path(a) if a.startswith("x") else a for a in arguments))
            self.assertEqual(done.returncode, 1)
            self.assertIn(f"error: {folder}: cannot be opened: Is a directory\n", done.stderr)

    def test_misspelt_commands_and_options(self):
        for arguments, meant in ((("ingset", "x"), "ingset: did you mean ingest?"), (("info", "--dme", "x"), "--dme: did you mean --dem?"),
                                 (("verify", "accurcy"), "accurcy: did you mean accuracy?"), (("serve", "--prot=1"), "--port?")):
            done = self.run_it(*arguments)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(meant, done.stderr)

    def test_former_commands_name_their_successors(self):
        for arguments, meant in ((("render", "x.json"), "selenograph ask frames REQUEST.json -o OUT"),
                                 (("verify", "moon"), "tests/verify/moon.py"),
                                 (("verify", "accuracy", "--indirect"), "--gtest_filter='IndirectLight.*'"),
                                 (("batch", "x.jsonl", "--coco"), "python3 -m selenograph coco DIR -o coco.json")):
            done = self.run_it(*arguments)
            self.assertEqual(done.returncode, 1)
            self.assertIn(meant, done.stderr)

    def test_a_request_stands_before_the_options(self):
        for command, usage in ((("ask",), "ask call request [OPTIONS]"),
                               (("batch",), "batch [manifest] [OPTIONS] [SUBCOMMAND]"),
                               (("batch", "verify"), "batch verify manifest [OPTIONS]"), (("serve",), "serve [OPTIONS]")):
            self.assertIn(f"Usage: selenograph {usage}\n", self.run_it(*command, "--help").stdout)
        # --dem takes what follows it.
        done = self.run_it("ask", "maps", "--dem", harness.path("dem"), "site.json", "-o", harness.path("x.tif"))
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("request is required\n", done.stderr)
        self.assertIn("Usage: selenograph ask call request [OPTIONS]\n", done.stderr)


class CacheFolder(unittest.TestCase):
    def frame_twice(self, service):
        bodies = []
        for _ in range(2):
            status, headers, body = service.frame(frame_request(("radiance", "source")), "application/x-npz")
            self.assertEqual(status, 200, body[:300])
            self.assertIn("ETag", headers)
            bodies.append(body)
        self.assertEqual(bodies[0], bodies[1])
        return bodies[0]

    def sound(self):
        service = Service(cache="cache-sound")
        try:
            self.assertEqual(service.ask("GET", "/health/ready")[2], b"ok\n")
            return self.frame_twice(service)
        finally:
            service.stop()

    def test_ingest_is_not_complete(self):
        """What can't be written is an error with the file and the system's reason, though frames would be answered."""
        def ingest(cache, **options):
            done = harness.run("ingest", "--dem", harness.path("dem"), "--cache-dir", cache, **options)
            return done.returncode, done.stdout, done.stderr
        no_folder = os.path.join(harness.write("no-folder", ""), "cache")
        small = harness.path("cache-small")
        limits = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))  # noqa: E731
        for cache, reason, options in ((no_folder, "Not a directory", {}), (small, "File too large", {"preexec_fn": limits})):
            status, said, wrong = ingest(cache, **options)
            self.assertEqual(status, 1, said + wrong)
            self.assertRegex(wrong, f"(?m)^error: {re.escape(cache)}/pyramid/.*: {reason}$")
            self.assertNotIn("complete", said)
        self.assertEqual(ingest("")[0], 1)
        for words in ("the pyramid in", "nothing to do"):
            status, said, wrong = ingest(small)
            self.assertEqual(status, 0, wrong)
            self.assertIn(words, said)

    def test_frames_say_nothing_of_this_machine(self):
        for folder in ("cache-full", "cache-sound"):
            shutil.rmtree(harness.path(folder), ignore_errors=True)
        meta = harness.meta_of(self.sound())
        self.assertNotIn(harness.path(), json.dumps(meta))
        # The same with a tile that the layer below replaces.
        damaged = shutil.copytree(harness.path("dem"), harness.path("dem-damaged"))
        service = Service("--on-data-error", "fall-through", cache="cache-replaced", dem="dem-damaged")
        os.truncate(os.path.join(damaged, HIT + ".img"), 1000)
        bodies = [service.frame(frame_request(), "application/x-npz") for _ in range(2)]
        self.assertEqual(bodies[0][2], bodies[1][2])
        self.assertNotIn("ETag", bodies[0][1])
        meta = harness.meta_of(bodies[0][2])
        said = [w for w in meta["warnings"] if "places without data" not in w]  # the view's own
        self.assertEqual(said, [HIT + ".lbl: cannot be used; the layer below stands in for it"])
        self.assertNotIn(harness.path(), json.dumps(meta))
        self.assertIn(HIT, service.log_text())
        self.assertEqual(service.stop(), 0)


class Counting(http.server.BaseHTTPRequestHandler):
    requests = []

    def do_GET(self):
        Counting.requests.append(self.path)
        self.send_error(404)

    do_HEAD = do_GET

    def log_message(self, *arguments):
        pass


WMS = """<GDAL_WMS><Service name="TMS"><ServerUrl>{url}/${{z}}/${{x}}/${{y}}.png</ServerUrl></Service><DataWindow>
<UpperLeftX>-180</UpperLeftX><UpperLeftY>90</UpperLeftY><LowerRightX>180</LowerRightX><LowerRightY>-90</LowerRightY>
<TileLevel>3</TileLevel><SizeX>512</SizeX><SizeY>256</SizeY></DataWindow><BandsCount>1</BandsCount></GDAL_WMS>"""
VRT = """<VRTDataset rasterXSize="8" rasterYSize="8"><SRS>GEOGCS["Moon",DATUM["Moon",SPHEROID["Moon",1737400,0]],
PRIMEM["Reference",0],UNIT["degree",0.0174532925199433]]</SRS><GeoTransform>30,0.125,0,1,0,-0.125</GeoTransform>
<VRTRasterBand dataType="Int16" band="1"><SimpleSource><SourceFilename relativeToVRT="0">{name}</SourceFilename>
<SourceBand>1</SourceBand>{properties}<SrcRect xOff="0" yOff="0" xSize="8" ySize="8"/>
<DstRect xOff="0" yOff="0" xSize="8" ySize="8"/></SimpleSource></VRTRasterBand></VRTDataset>"""
PROPERTIES = '<SourceProperties RasterXSize="8" RasterYSize="8" DataType="Int16" BlockXSize="8" BlockYSize="8"/>'


class Network(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Counting)
        cls.url = f"http://127.0.0.1:{cls.server.server_port}"
        threading.Thread(target=cls.server.serve_forever, daemon=True).start()

    @classmethod
    def tearDownClass(cls):
        cls.server.shutdown()
        cls.server.server_close()

    def test_nothing_is_fetched(self):
        folder = shutil.copytree(harness.path("dem"), harness.path("dem-remote"))
        wms = os.path.join(folder, "source.wms")
        contents = {"wms.tif": WMS.format(url=self.url), "wms.vrt": WMS.format(url=self.url), "source.wms": WMS.format(url=self.url),
                    "url.img": self.url + "/a.img", "inner.xml": VRT.format(name="/vsicurl/" + self.url + "/inner.tif", properties="")}
        names = {"curl": f"/vsicurl/{self.url}/a.tif", "streaming": f"/vsicurl_streaming/{self.url}/a.tif",
                 "question": f"/vsicurl?url={self.url}/a.tif", "zip": f"/vsizip//vsicurl/{self.url}/a.zip/a.tif", "http": f"{self.url}/a.tif",
                 "wms": wms, "inline": WMS.format(url=self.url).replace("<", "&lt;").replace("\n", " "),
                 "nested": os.path.join(folder, "inner.xml")}
        for name, source in names.items():
            for kind, properties in (("lazy", PROPERTIES), ("eager", "")):
                contents[f"{name}-{kind}.vrt"] = VRT.format(name=source, properties=properties)
        for name, text in contents.items():
            with open(os.path.join(folder, name), "w") as f:
                f.write(text)
        maps = os.path.join(harness.assets(), "maps")
        for name in ("wms.tif", "curl-lazy.vrt", "nested-eager.vrt"):
            shutil.copy(os.path.join(folder, name), maps)
            with open(os.path.join(maps, name[:3] + ".json"), "w") as f:
                json.dump({"file": name, "extent": {"south_deg": 0, "north_deg": 1, "west_deg": 30, "east_deg": 31}}, f)
        service = Service("--on-data-error", "fall-through", "--assets-dir", harness.path("assets"), cache="cache-remote", dem=folder)
        self.assertEqual(service.ask("GET", HEIGHT)[0], 200)
        for name in ("wms", "cur", "nes"):
            status, _, body = service.frame(frame_request(surface={"albedo_maps": [name]}))
            self.assertEqual(status, 500, body[:300])
        self.assertEqual(service.frame(frame_request())[0], 200)
        problems = [os.path.basename(p["path"]) for p in json.loads(service.ask("GET", "/v1/datasets")[2])["problems"]]
        for name in ("curl-lazy.vrt", "http-lazy.vrt", "wms.tif", "wms.vrt"):
            self.assertIn(name, problems)
        self.assertEqual(service.stop(), 0)
        self.assertEqual(Counting.requests, [])


if __name__ == "__main__":
    harness.main()
