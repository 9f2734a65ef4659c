#!/usr/bin/env python3
"""The pages for people: who gets them, and in a real browser that a drag changes the frame and that what is copied gives
the same bytes. Needs chromium-driver, python3-selenium and python3-scipy for the latter."""

import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import unittest

import numpy as np

import harness
from harness import sample

try:
    from scipy.spatial.transform import Rotation
    from selenium import webdriver
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait
except ImportError:
    webdriver = None


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "64")


def tearDownModule():
    harness.tear_down()


def source(name):
    with open(os.path.join(harness.REPOSITORY, "server", "page", name), "rb") as f:
        return f.read()


class WhoGetsThem(unittest.TestCase):
    def get(self, path, *options, method="GET"):
        service = harness.Service(*options)
        try:
            return service.ask(method, path)
        finally:
            self.assertEqual(service.stop(), 0)

    def test_loopback_does_by_default(self):
        for path, name in (("/", "page.html"), ("/docs", "docs.html")):
            status, headers, body = self.get(path)
            self.assertEqual(status, 200)
            self.assertEqual(body, source(name))
            self.assertEqual(headers["Content-Type"], "text/html; charset=utf-8")
            self.assertIn("default-src 'none'", headers["Content-Security-Policy"])

    def test_nobody_does_when_off(self):
        for path in ("/", "/docs", "/marked.js"):
            status, headers, body = self.get(path, "--page", "off")
            self.assertEqual(status, 404)
            self.assertEqual(json.loads(body)["status"], 404)

    def test_only_get(self):
        self.assertEqual(self.get("/", method="POST")[0], 404)
        status, _, body = self.get("/", method="HEAD")
        self.assertEqual((status, body), (200, b""))

    def test_pages_ask_nobody_else(self):
        for name in ("page.html", "docs.html"):
            self.assertNotIn(b"http://", source(name))
            self.assertNotIn(b"https://", source(name))


def browser():
    options = webdriver.ChromeOptions()
    for switch in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1500,1400"):
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options=options)


@unittest.skipUnless(webdriver and shutil.which("chromedriver"), "needs python3-selenium and chromium-driver")
class InABrowser(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.service = harness.Service()
        cls.browser = browser()
        cls.url = f"http://127.0.0.1:{cls.service.port}"

    @classmethod
    def tearDownClass(cls):
        cls.browser.quit()
        cls.service.stop()

    def setUp(self):
        self.browser.get_log("browser")  # of the test before: a refusal is an error to a browser

    def wait(self, condition):
        return WebDriverWait(self.browser, harness.PATIENCE_S, 0.1).until(lambda _: condition())

    def data(self, name):
        return self.browser.execute_script(f"return document.body.dataset.{name} || ''")

    def open(self):
        self.browser.get(self.url + "/")
        self.wait(lambda: self.data("frames") and self.text("state") == "ready")

    def text(self, element):
        return self.browser.find_element(By.ID, element).text

    def errors(self):
        return [e for e in self.browser.get_log("browser") if e["level"] == "SEVERE"]

    def set(self, element, value):
        self.browser.execute_script(
            "const e = document.getElementById(arguments[0]); e.value = arguments[1];"
            "e.dispatchEvent(new Event('change'));", element, value)

    def changes(self, act):
        before, frames = self.data("frameSha256"), self.data("frames")
        act()
        self.wait(lambda: self.data("frames") != frames and self.text("state") in ("ready", "refused"))
        self.assertEqual(self.text("problem"), "")
        return self.data("frameSha256") != before

    def test_it_loads_without_errors_and_shows_the_frame_and_the_map(self):
        self.open()
        self.wait(lambda: self.data("maps"))
        self.assertEqual(self.text("problem"), "")
        self.assertIn("off the nadir", self.text("facts"))
        # The frame's pixels are not all alike.
        colours = self.browser.execute_script(
            "const c = document.getElementById('frame'); const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
            "return new Set(Array.from(p)).size")
        self.assertGreater(colours, 20)
        self.assertEqual(self.errors(), [])

    def test_a_drag_on_the_map_moves_the_camera(self):
        self.open()

        def drag():
            self.browser.execute_script("""
                const map = document.getElementById('map'), box = map.getBoundingClientRect();
                const fire = (type, x, y) => map.dispatchEvent(new PointerEvent(type,
                  {clientX: box.left + x * box.width, clientY: box.top + y * box.height, bubbles: true, pointerId: 1}));
                map.setPointerCapture = () => {};
                fire('pointerdown', 0.5, 0.5), fire('pointermove', 0.55, 0.45), fire('pointerup', 0.55, 0.45);""")

        self.assertTrue(self.changes(drag))

    def test_a_tilt_looks_towards_its_azimuth(self):
        self.open()
        for azimuth, member, sign in ((0, 0, 1), (90, 1, 1), (180, 0, -1), (270, 1, -1)):
            self.changes(lambda: self.browser.execute_script(
                f"Object.assign(camera, {{lat_deg: 0.05, lon_deg: 30.05, fov_deg: 10, tilt_deg: 20, tilt_azimuth_deg: {azimuth}, "
                f"up_azimuth_deg: {azimuth}}}); changed()"))
            there = self.browser.execute_script("return [view.lat_deg - camera.lat_deg, view.lon_deg - camera.lon_deg]")
            self.assertGreater(sign * there[member], 0.1)
            self.assertLess(abs(there[1 - member]), 0.01)
            # What is farther away is up in the image: the upper corners are farther from the camera.
            upper, lower = self.browser.execute_script("""
                const far = c => Math.hypot(c.lat_deg - camera.lat_deg, c.lon_deg - camera.lon_deg);
                return [far(view.corners[0]), far(view.corners[3])]""")
            self.assertGreater(upper, lower)

    def test_each_product_is_shown(self):
        self.open()
        names = self.browser.execute_script("return [...document.getElementById('product').options].map(o => o.value)")
        self.assertIn("angles.incidence", names)
        for name in names:
            self.changes(lambda name=name: self.set("product", name))
            self.assertNotIn("NaN", self.text("legend"))
        self.assertEqual(self.errors(), [])

    def test_what_is_copied_gives_the_bytes_on_the_screen(self):
        self.open()
        self.changes(lambda: self.set("product", "radiance"))
        self.browser.find_element(By.CSS_SELECTOR, "[data-as=curl]").click()
        command = self.browser.find_element(By.ID, "copied").get_attribute("value")
        words = shlex.split(command.replace("\\\n", ""))
        self.assertEqual(words[0], "curl")
        out = harness.path("copied.raw")
        words[words.index("-o") + 1] = out
        subprocess.run(words, check=True, timeout=harness.PATIENCE_S)
        with open(out, "rb") as f:
            self.assertEqual(hashlib.sha256(f.read()).hexdigest(), self.data("frameSha256"))
        self.browser.find_element(By.CSS_SELECTOR, "[data-as=json]").click()
        json.loads(self.browser.find_element(By.ID, "copied").get_attribute("value"))

    def test_refusals_and_warnings_are_shown(self):
        self.open()
        self.browser.execute_script("camera.height_m = -9000; changed()")
        self.wait(lambda: self.text("state") == "refused")
        self.assertIn("/pose", self.text("problem"))
        self.browser.execute_script("camera.height_m = 20000; camera.tilt_deg = 120; changed()")
        self.wait(lambda: "nothing of the Moon" in self.text("warnings"))

    def test_a_trajectory_plays(self):
        self.open()
        frames = int(self.data("frames"))
        self.browser.execute_script("""
            const rows = ['lat_deg,lon_deg,height_m', '0.1,30.0,20000', '0.1,30.1,20000', '0.1,30.2,15000'];
            play(new File([rows.join('\\n')], 'way.csv'))""")
        self.wait(lambda: int(self.data("frames")) >= frames + 3)
        self.assertEqual(self.browser.execute_script("return camera.height_m"), 15000)
        self.browser.execute_script("play(new File(['a,b\\n1,2'], 'way.csv'))")
        self.wait(lambda: "either lat_deg, lon_deg, height_m or" in self.text("problem"))

    def test_a_trajectory_has_positions_attitudes_and_times(self):
        self.open()
        rng = np.random.default_rng(3)
        quaternions = rng.normal(size=(20, 4))
        # Straight down at 0.1 N 30 E with north up, too, where a tilt has no azimuth.
        lat, lon = np.radians((0.1, 30.0))
        up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        east = np.array([-np.sin(lon), np.cos(lon), 0.0])
        down = Rotation.from_matrix([east, np.cross(east, up), -up]).as_quat()
        quaternions = np.vstack([quaternions, np.roll(down, 1)])
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        for name in ("camera_from_moon", "moon_from_camera"):
            columns = ["x_m", "y_m", "z_m", *(f"{name}_{c}" for c in "wxyz")]
            place = up * (1737400.0 + 20000.0)
            rows = [",".join(columns), *(",".join(map(repr, [*map(float, place), *map(float, q)])) for q in quaternions)]
            poses = self.browser.execute_script("return trajectory(arguments[0]).map(poseOf)", "\n".join(rows))
            for pose, (w, *v) in zip(poses, quaternions):
                matrix = Rotation.from_quat([*v, w]).as_matrix()
                matrix = matrix if name == "camera_from_moon" else matrix.T
                np.testing.assert_allclose(pose["camera_from_moon_matrix"], matrix, atol=1e-9)
                np.testing.assert_allclose([pose["geodetic"][m] for m in ("lat_deg", "lon_deg", "height_m")],
                                           (0.1, 30.0, 20000.0), rtol=1e-9)
        frames = int(self.data("frames"))
        self.browser.execute_script("""play(new File([['utc,lat_deg,lon_deg,height_m,tilt_deg',
            '2026-11-20T00:00:00Z,0.1,30.0,20000,5', '2026-11-20T00:10:00Z,0.1,30.1,20000,5'].join('\\n')], 'way.csv'))""")
        self.wait(lambda: int(self.data("frames")) >= frames + 2)
        self.assertEqual(self.browser.execute_script("return asked.sun"), {"utc": "2026-11-20T00:10:00Z"})
        for wrong, said in (("lat_deg,lon_deg,height_m,pitch\n1,2,3,4", "column pitch is unknown"),
                            ("lat_deg,lon_deg,height_m,camera_from_moon_w\n1,2,3,4", "has not all of"),
                            ("lat_deg,lon_deg,height_m\n1,,3", "line 2: lon_deg is no number"),
                            ("lat_deg,lon_deg,height_m\n1,3", "line 2: 2 values for 3 columns")):
            self.browser.execute_script("play(new File([arguments[0]], 'way.csv'))", wrong)
            self.wait(lambda said=said: said in self.text("problem"))

    def test_the_api_document_is_readable(self):
        self.browser.get(self.url + "/docs")
        self.wait(lambda: self.browser.find_elements(By.ID, "object-FrameRequest"))
        text = self.browser.find_element(By.TAG_NAME, "body").text
        for said in ("POST /v1/frames", "height_m", "example: nadir"):
            self.assertIn(said, text)
        about = self.browser.find_element(By.CSS_SELECTOR, "h1 + div")
        self.assertTrue(about.find_elements(By.TAG_NAME, "h2") and about.find_elements(By.TAG_NAME, "li"), "Markdown is rendered")
        self.assertNotIn("##", text)
        self.assertEqual(self.errors(), [])


if __name__ == "__main__":
    if not webdriver:
        print("no selenium or no SciPy: the browser's part is skipped", file=sys.stderr)
    harness.main()
