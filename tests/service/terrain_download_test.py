#!/usr/bin/env python3
"""deploy/terrain against a local archive that has the layout of the real ones, and stalls, cuts, redirects and refuses."""

import http.server
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import unittest

from osgeo import gdal

import harness
from harness import REPOSITORY, Service, frame_request, tearDownModule

TOOL = os.path.join(REPOSITORY, "deploy", "terrain")
NAME = "DTM_MAP_01_N01E030N00E031SC"
BOUNDS = ("--bounds", "0.1", "0.9", "30.1", "30.9")
ARCHIVE = "pub/pds3/sln-l-tc-5-sldem2013-v1.0/"
WAC = "data/LRO-L-LROC-5-RDR-V1.0/LROLRC_2001/DATA/MDR/WAC_EMP/WAC_EMP_643NM_E300N0450_304P.IMG"
MOON_KIT = "vis/a000000/a004700/a004720/lroc_color_poles_2k.tif"


class Archive(http.server.ThreadingHTTPServer):
    """Files by path; `faults`: what happens to requests for a path, one after the other."""

    daemon_threads = True

    def __init__(self):
        super().__init__(("127.0.0.1", 0), Handler)
        self.files, self.faults, self.asked, self.version = {}, {}, [], 1
        self.forgetful = False  # answers with a range of whatever version it has
        self.url = f"http://127.0.0.1:{self.server_address[1]}/"
        self.released = threading.Event()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def handle_error(self, request, client_address):
        pass  # the client went away, as it may


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def do_HEAD(self):
        self.do_GET()

    def do_GET(self):
        archive, path = self.server, self.path.lstrip("/").removeprefix("moved/")
        archive.asked.append((self.command, self.path, self.headers.get("Range")))
        if path not in archive.files:
            return self.answer(404, b"no such file")
        faults = archive.faults.get(path, [])
        fault = faults.pop(0) if faults and self.command == "GET" else None
        if fault == "redirect":
            self.send_response(302)
            self.send_header("Location", "/moved/" + path)
            self.send_header("Content-Length", "0")
            return self.end_headers()
        if fault == "silent":
            self.close_connection = True
            return None
        if fault == "busy":
            return self.answer(503, b"later")
        if fault == "rude":
            self.wfile.write(b"HTTP/1.1 403 \x1b[31mgo away\x1b]0;title\x07\r\nContent-Length: 0\r\n\r\n")
            return None
        if fault == "elsewhere":
            self.wfile.write(b"HTTP/1.1 302 Found\r\nLocation: file:///etc/passwd\r\nContent-Length: 0\r\n\r\n")
            return None
        if fault == "nonsense":
            self.wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: \x1b[2Jmany\r\n\r\n")
            self.close_connection = True
            return None
        content, tag, start = archive.files[path], f'"{archive.version}"', 0
        asked = re.fullmatch(r"bytes=(\d+)-", self.headers.get("Range", ""))
        if asked and fault != "no ranges" and (self.headers.get("If-Range") == tag or archive.forgetful):
            start = int(asked.group(1))
        self.send_response(206 if start else 200)
        self.send_header("ETag", tag)
        if start:
            self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
        if fault == "endless":
            self.close_connection = True
        else:
            self.send_header("Content-Length", str(len(content) - start))
        self.end_headers()
        if self.command == "HEAD":
            return None
        if fault == "endless":
            for _ in range(1000):
                self.wfile.write(bytes(1 << 20))
            return None
        if fault == "trickle":
            for i in range(len(content)):
                self.wfile.write(content[i:i + 1])
                if archive.released.wait(0.1):
                    break
            return None
        end = len(content) if fault not in ("stall", "cut", "wait") else (start + len(content)) // 2
        self.wfile.write(content[start:end])
        if fault in ("stall", "wait"):
            self.wfile.flush()
            archive.released.wait(30 if fault == "wait" else 5)
        if fault in ("stall", "cut", "wait"):
            self.close_connection = True
        return None

    def answer(self, status, body):
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(body)


def setUpModule():
    harness.set_up()
    harness.sample("tile", "--south-deg", "0", "--west-deg", "30", "--rows", "1", "--columns", "1", "--ppd", "4096")


class Downloads(unittest.TestCase):
    def setUp(self):
        self.archive = Archive()
        self.image, self.label = f"{ARCHIVE}lon030/data/{NAME}.img", f"{ARCHIVE}lon030/data/{NAME}.lbl"
        for path in (self.image, self.label):
            with open(harness.path("tile", os.path.basename(path)), "rb") as file:
                self.archive.files[path] = file.read()
        self.folder = harness.path(self.id().rsplit(".", 1)[1])

    def tearDown(self):
        self.archive.released.set()
        self.archive.shutdown()
        self.archive.server_close()

    def command(self, *more, product="sldem2013", region=BOUNDS):
        return [sys.executable, TOOL, "get", product, *region, "-o", self.folder, "--base-url", self.archive.url, "--timeout", "1",
                "--retry-s", "0.05", *more]

    def get(self, *more, status=0, **which):
        done = subprocess.run(self.command(*more, **which), capture_output=True, text=True, timeout=120, check=False)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done.stdout, done.stderr

    def fetched(self, path):
        with open(os.path.join(self.folder, os.path.basename(path)), "rb") as file:
            return file.read()

    def assert_no_parts(self):
        self.assertEqual([n for n in os.listdir(self.folder) if ".part" in n], [])

    def test_stalled_cut_moved_and_busy(self):
        self.archive.faults = {self.image: ["redirect", "cut", "stall", "no ranges"], self.label: ["busy", "redirect"]}
        said, _ = self.get()
        self.assertIn("2 files, 33.6 MB", said)
        for path in (self.image, self.label):
            self.assertEqual(self.fetched(path), self.archive.files[path])
        self.assert_no_parts()
        self.assertTrue(any(asked for _, _, asked in self.archive.asked), "nothing was resumed")
        asked = len(self.archive.asked)
        self.get()
        self.assertEqual(len(self.archive.asked), asked, "what is there is not asked for")
        service = Service(dem=self.folder, cache="cache-downloaded")
        try:
            status, _, body = service.frame(frame_request(), "application/x-npz")
            self.assertEqual(status, 200, body[:300])
        finally:
            service.stop()

    def test_where_no_server_answers_it_gives_up_soon(self):
        self.archive.faults = {self.image: ["silent"] * 6, self.label: ["silent"] * 6}
        _, said = self.get(status=1)
        self.assertEqual(said.count("; trying again"), 1, said)
        self.assertLessEqual(len(self.archive.asked), 2 * 3)
        self.assertEqual(said.count("; the same command resumes"), 2, said)
        # One that has answered may be silent for longer.
        self.archive.faults = {self.image: ["silent"] * 5}
        _, said = self.get("--jobs", "1")
        self.assertEqual(said.count("; trying again"), 1, said)
        self.archive.shutdown()
        self.archive.server_close()
        self.folder += "-closed"
        self.assertRegex(self.get(status=1)[1], "connect.*; trying again")

    def test_a_refused_region_leaves_no_folder(self):
        self.get(region=("--bounds", "1", "0", "0", "1"), status=1)
        self.assertFalse(os.path.exists(self.folder))

    def test_missing_files_are_named_and_others_come(self):
        del self.archive.files[self.image]
        _, said = self.get(status=1)
        self.assertIn(self.archive.url + self.image + ": 404", said)
        self.assertEqual(self.fetched(self.label), self.archive.files[self.label])

    def test_sizes_and_labels_are_checked(self):
        self.archive.files[self.image] = self.archive.files[self.image][:-2]
        self.archive.files[self.label] = b"not a label"
        _, said = self.get(status=1)
        self.assertIn("has 33554430 bytes, expected 33554432", said)
        self.assertIn("is not a PDS3 label", said)
        self.assertEqual(set(os.listdir(self.folder)), {".terrain.lock"})

    def killed(self, how):
        self.archive.faults = {self.image: ["wait"]}
        process = subprocess.Popen(self.command("--timeout", "60"), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        part = os.path.join(self.folder, NAME + ".img.part")
        half = len(self.archive.files[self.image]) // 2
        harness.wait_until(lambda: os.path.exists(part) and os.path.getsize(part) > half - (1 << 18), "half a file")
        began = time.monotonic()
        process.send_signal(how)
        said = process.communicate(timeout=30)[1]
        self.assertFalse(os.path.exists(os.path.join(self.folder, NAME + ".img")), "half a file under its real name")
        return time.monotonic() - began, said

    def test_killed_it_resumes(self):
        self.killed(signal.SIGKILL)
        self.get()
        self.assertEqual(self.fetched(self.image), self.archive.files[self.image])
        self.assertTrue(any(asked and not asked.startswith("bytes=0-") for _, _, asked in self.archive.asked), "not resumed")

    def get_onto_a_disk(self, free, status):
        """As where so many bytes are free."""
        program = (f"import collections, runpy, shutil, sys; sys.argv = sys.argv[1:]; "
                   f"shutil.disk_usage = lambda _: collections.namedtuple('Usage', 'free')({free}); "
                   "runpy.run_path(sys.argv[0], run_name='__main__')")
        done = subprocess.run([sys.executable, "-c", program, *self.command()[1:]], capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done.stderr

    def test_it_resumes_where_the_disk_holds_what_is_missing(self):
        self.killed(signal.SIGKILL)
        whole, image = len(self.archive.files[self.image]), os.path.join(self.folder, NAME + ".img")
        missing = whole - os.path.getsize(image + ".part")
        self.assertLess(missing, whole - 10_000_000)
        self.assertIn("are needed", self.get_onto_a_disk(missing - 1, status=1))
        self.get_onto_a_disk(missing, status=0)
        self.assertEqual(self.fetched(self.image), self.archive.files[self.image])
        # One that is too long stays until there is another: it makes no room.
        with open(image, "ab") as file:
            file.write(b"more")
        self.assertIn("are needed", self.get_onto_a_disk(whole - 1, status=1))
        self.get_onto_a_disk(whole, status=0)

    def test_interrupted_it_ends(self):
        seconds, said = self.killed(signal.SIGINT)
        self.assertLess(seconds, 10)
        self.assertIn("the same command resumes", said)

    def test_another_version_is_fetched_anew(self):
        self.killed(signal.SIGKILL)
        self.archive.version = 2
        self.archive.files[self.image] = bytes(len(self.archive.files[self.image]))
        self.get()
        self.assertEqual(self.fetched(self.image), self.archive.files[self.image])

    def test_a_range_of_another_version_is_not_appended(self):
        """By a server that ignores If-Range, with the same size or another one."""
        for grown in (0, 2):
            with self.subTest(grown):
                self.folder = harness.path(f"forgetful-{grown}")
                self.killed(signal.SIGKILL)
                self.archive.version += 1
                self.archive.forgetful = True
                self.archive.files[self.image] = bytes(len(self.archive.files[self.image]))
                self.get()
                self.assertEqual(self.fetched(self.image), self.archive.files[self.image])

    def test_a_body_of_another_size_than_said_is_refused(self):
        """Before it fills the disk; and a label is no larger than a mebibyte."""
        for path in (self.image, self.label):
            with self.subTest(path):
                self.folder = harness.path(f"endless-{os.path.basename(path)}")
                self.archive.faults = {path: ["endless"]}
                _, said = self.get(status=1)
                self.assertIn("bytes expected", said)
                self.assertNotIn(os.path.basename(path), os.listdir(self.folder))
                self.assert_no_parts()

    def test_a_server_that_trickles_is_left(self):
        self.archive.faults = {self.image: ["trickle"]}
        _, said = self.get("--jobs", "1")
        self.assertIn("too slow", said)
        self.assertEqual(self.fetched(self.image), self.archive.files[self.image])

    def test_what_a_server_says_is_printed_without_control_characters(self):
        for fault, words in (("rude", "go away"), ("elsewhere", "Protocol"), ("nonsense", "Content-Length")):
            with self.subTest(fault):
                self.folder = harness.path(fault)
                self.archive.faults = {path: [fault] * 20 for path in (self.image, self.label)}
                out, said = self.get(status=1)
                self.assertIn(words, said)
                self.assertNotIn("Traceback", said)
                self.assertTrue(all(c.isprintable() or c == "\n" for c in out + said), said)

    def test_one_at_a_time_in_a_folder(self):
        self.archive.faults = {self.image: ["wait"]}
        process = subprocess.Popen(self.command("--timeout", "60"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        harness.wait_until(lambda: os.path.exists(os.path.join(self.folder, NAME + ".img.part")), "a download")
        self.assertIn("another download", self.get(status=1)[1])
        process.kill()
        process.wait()

    def test_sites_and_maps(self):
        self.archive.files = {WAC: b"pixels"}
        self.get(product="albedo", region=("--bounds", "10", "20", "10", "20"))
        with open(os.path.join(self.folder, "WAC_EMP_643NM_E300N0450_304P.json"), encoding="utf-8") as file:
            description = json.load(file)
        self.assertEqual([description[name] for name in ("quantity", "incidence_deg", "emission_deg", "phase_deg",
                                                         "wavelength_um")], ["radiance_factor", 30, 0, 30, 0.643])
        _, said = self.get(product="nac-dtm", region=("--site", "../x"), status=1)
        self.assertIn("--site ../x: names have letters, digits and _", said)

    def test_a_colour_map_becomes_an_albedo(self):
        """Fetched into the maps of an assets folder, the Moon Kit is rho as its publisher's equation makes it of the red band."""
        red, assets = 100, harness.path("assets-moon-kit")
        made = harness.path("moon-kit.tif")
        picture = gdal.GetDriverByName("GTiff").Create(made, 64, 32, 3)
        for band, value in enumerate((red, 200, 50), 1):
            picture.GetRasterBand(band).Fill(value)
        del picture
        with open(made, "rb") as file:
            self.archive.files = {MOON_KIT: file.read()}
        self.folder = os.path.join(assets, "maps")
        self.get(product="albedo", region=("--site", "lroc_color_poles_2k"))
        harness.sample("coarse", "--south-deg", "0", "--west-deg", "30", "--rows", "1", "--columns", "1", "--ppd", "256")
        service = Service("--assets-dir", assets, dem="coarse", cache="cache-coarse")
        try:
            # Level ground: of two frames with the map and with the constant, the ratio is that of the rhos.
            frames = [service.arrays(frame_request(["radiance"], surface=surface))["radiance"].sum(dtype=float)
                      for surface in ({"albedo_maps": ["lroc_color_poles_2k"]}, {"reflectance": {"rho": 0.12}})]
        finally:
            service.stop()
        radiance_factor = ((0.16 + 0.24 * red / 255) / 0.935) ** 2.8
        # I/F = pi mu0 rho / (2 pi) / (mu0 + mu) at 60 degrees of incidence, 0 of emission.
        self.assertAlmostEqual(frames[0] / frames[1], radiance_factor * 2 * 1.5 / 0.5 / 0.12, places=4)

    def test_web_pages_and_folders_that_cannot_be_written(self):
        self.archive.files = {MOON_KIT: b"<!DOCTYPE html><title>log in</title>"}
        _, said = self.get(product="albedo", region=("--site", "lroc_color_poles_2k"), status=1)
        self.assertIn("lroc_color_poles_2k.tif: is a web page", said)
        self.assertEqual(set(os.listdir(self.folder)), {".terrain.lock"})
        self.folder = harness.path("tile", NAME + ".lbl")
        self.assertEqual(self.get(status=1)[1], f"deploy/terrain: -o {self.folder}: File exists\n")


class Names(unittest.TestCase):
    def urls(self, product, *region):
        done = subprocess.run([sys.executable, TOOL, "get", product, *region, "-o", "unused", "--dry-run"], capture_output=True, text=True,
                              check=True)
        return [line.split()[0].rsplit("/", 3)[-1] for line in done.stdout.splitlines()]

    def test_tiles_of_a_region(self):
        self.assertEqual(self.urls("sldem2013", "--bounds", "26.2", "26.8", "3.2", "3.8"),
                         ["DTM_MAP_01_N27E003N26E004SC.lbl", "DTM_MAP_01_N27E003N26E004SC.img"])
        across = self.urls("sldem2013", "--bounds", "-1", "1", "359", "361")
        self.assertEqual([n for n in across if n.endswith(".img")],
                         ["DTM_MAP_01_N01E359N00E000SC.img", "DTM_MAP_01_N01E000N00E001SC.img",
                          "DTM_MAP_01_N00E359S01E000SC.img", "DTM_MAP_01_N00E000S01E001SC.img"])
        self.assertEqual(self.urls("kaguya-seamless", "--bounds", "26", "26.5", "3.1", "4")[0], "DTM_MAPs02_N27E003N24E006SC.lbl")
        self.assertEqual(self.urls("sldem2015", "--bounds", "-5", "-4", "44", "46"),
                         [f"SLDEM2015_512_30S_00S_{x}_FLOAT.{e}" for x in ("000_045", "045_090") for e in ("LBL", "IMG")])

    def test_nothing_is_asked_twice(self):
        for product in ("sldem2013", "kaguya-seamless", "sldem2015", "albedo"):
            for west, east in (("-180", "180"), ("0.5", "360.5")):
                urls = self.urls(product, "--bounds", "-2", "2", west, east)
                self.assertEqual(len(urls), len(set(urls)))

    def test_regions_across_the_date_line_and_at_poles(self):
        for west, east in (("179.5", "-179.5"), ("179.5", "180.5")):
            self.assertEqual(self.urls("sldem2013", "--bounds", "0.2", "0.8", west, east)[1::2],
                             ["DTM_MAP_01_N01E179N00E180SC.img", "DTM_MAP_01_N01E180N00E181SC.img"])
        self.assertEqual(self.urls("sldem2013", "--bounds", "-90", "-89.5", "0", "1")[1], "DTM_MAP_01_S89E000S90E001SC.img")
        self.assertEqual(self.urls("kaguya-seamless", "--bounds", "83", "90", "0", "1")[1], "DTM_MAPs02_N84E000N81E003SC.img")

    def test_files_that_cover_a_region(self):
        self.assertEqual(self.urls("lola", "--bounds", "0", "1", "0", "1")[1], "LDEM_128.IMG")
        self.assertEqual(self.urls("lola-polar", "--bounds", "-90", "-86", "-180", "180")[1], "LDEM_85S_10M.IMG")
        self.assertEqual(self.urls("lola-polar", "--bounds", "50", "90", "0", "10")[1], "LDEM_45N_400M.IMG")
        self.assertEqual(self.urls("albedo", "--bounds", "50", "70", "350", "10"),
                         [f"WAC_EMP_643NM_{tile}_304P.IMG" for tile in ("E300N3150", "E300N0450", "P900N0000")])

    def test_products_and_paths_of_a_mirror(self):
        done = subprocess.run([sys.executable, TOOL, "list"], capture_output=True, text=True, check=True)
        self.assertEqual([line.split()[0] for line in done.stdout.splitlines() if line[0] != " "],
                         ["sldem2013", "kaguya-seamless", "sldem2015", "lola", "lola-polar", "polar-site", "lola-80m", "nac-dtm",
                          "albedo"])
        for product, region, path in (
                ("sldem2013", ("--bounds", "26.2", "26.8", "3.2", "3.8"), ARCHIVE + "lon003/data/DTM_MAP_01_N27E003N26E004SC.lbl"),
                ("polar-site", ("--site", "Haworth"), "data/LOLA_5mpp/Haworth/Haworth_final_adj_5mpp_surf.tif"),
                ("albedo", ("--site", "lroc_color_poles_2k"), MOON_KIT)):
            done = subprocess.run([sys.executable, TOOL, "get", product, *region, "-o", "unused", "--dry-run", "--base-url",
                                   "http://mirror:1/moon/"], capture_output=True, text=True, check=True)
            self.assertEqual(done.stdout.split()[0], "http://mirror:1/moon/" + path)

    def test_wrong_requests(self):
        for arguments, said in ((("sldem2013", "--site", "A"), "has tiles: give --bounds"),
                                (("nac-dtm", "--bounds", "0", "1", "0", "1"), "has named files: give --site"),
                                (("lola", "--site", "LDEM_3"), "unknown; known are LDEM_4"),
                                (("nac-dtm", "--site", "APOLL\u00d611"), "names have letters, digits and _"),
                                (("sldem2013", "--bounds", "1", "0", "0", "1"), "south below north"),
                                (("sldem2013", "--bounds", "0", "1", "4", "3"), "4 is east of 3. Are they swapped?"),
                                (("sldem2013", "--bounds", "0", "1", "5", "5"), "west below east"),
                                (("sldem2013", "--bounds", "nan", "1", "0", "1"), "south below north"),
                                (("lola-polar", "--bounds", "-10", "80", "0", "1"), "no file of this product covers the region"),
                                (("sldem2015", "--bounds", "70", "80", "0", "1"), "ends at 60 degrees")):
            done = subprocess.run([sys.executable, TOOL, "get", *arguments, "-o", "unused", "--dry-run"], capture_output=True, text=True,
                                  check=False)
            self.assertEqual(done.returncode, 1, arguments)
            self.assertIn(said, done.stderr)
        for option, value, said in (("--jobs", "0", "0 is not above 0"), ("--base-url", "file:///srv", "does not begin with http"),
                                     ("--base-url", "http://[::1", "http://[::1 is no address"), ("--base-url", "http://m\u00f6nd/", "is no address")):
            done = subprocess.run([sys.executable, TOOL, "get", "lola", "--site", "LDEM_4", "-o", "unused", option, value],
                                  capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 2, option)
            self.assertIn(said, done.stderr)


if __name__ == "__main__":
    harness.main()
