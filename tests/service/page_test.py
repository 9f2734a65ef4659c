#!/usr/bin/env python3
"""The pages for people: who gets them, that the script of /docs runs and so do its examples, and in a real browser that a
drag changes the frame and that what is copied gives the same bytes. Needs nodejs for the one, chromium-driver,
python3-selenium and python3-scipy for the other. SELENOGRAPH_SCREENSHOTS names a folder for pictures of the pages."""

import glob
import hashlib
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import unittest

import numpy as np

import harness
from harness import sample, tearDownModule

try:
    from scipy.spatial.transform import Rotation
    from selenium import webdriver
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.ui import WebDriverWait
except ImportError:
    webdriver = None


SCREENSHOTS = os.environ.get("SELENOGRAPH_SCREENSHOTS")
LAPTOP, NARROW = (1366, 768), (600, 900)
SMALL, PHONE = (1280, 720), (500, 844)  # Chromium makes no window narrower


def setUpModule():
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "64")
    os.makedirs(SCREENSHOTS or harness.path("screenshots"), exist_ok=True)


def source(name):
    with open(os.path.join(harness.REPOSITORY, "server", "page", name), "rb") as f:
        return f.read()


def attitude(nadir, east, up):
    """Rows: the axes of a camera that is tilted from the nadir, as the API document defines it."""
    def along(azimuth_deg):
        return math.cos(math.radians(azimuth_deg)) * np.cross(up, east) + math.sin(math.radians(azimuth_deg)) * east

    down = -along(nadir["up_azimuth_deg"])
    upright = np.array([np.cross(down, -up), down, -up])
    turn = Rotation.from_rotvec(math.radians(nadir["tilt_deg"]) * np.cross(along(nadir["azimuth_deg"]), up))
    return turn.apply(upright)


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
        for method in ("POST", "OPTIONS"):
            status, headers, _ = self.get("/", method=method)
            self.assertEqual((status, headers["Allow"]), (405, "GET, HEAD"))
        status, _, body = self.get("/", method="HEAD")
        self.assertEqual((status, body), (200, b""))

    def test_pages_ask_nobody_else(self):
        for name in ("page.html", "docs.html"):
            self.assertNotIn(b"http://", source(name))
            self.assertNotIn(b"https://", source(name))


@unittest.skipUnless(shutil.which("node"), "needs nodejs")
class DocsWithoutABrowser(unittest.TestCase):
    """tests/service/docs_page.js runs the page's script and presses each "send"."""

    @classmethod
    def setUpClass(cls):
        service = harness.Service("--assets-dir", os.path.join(harness.REPOSITORY, "deploy", "assets"))
        cls.document = json.loads(service.ask("GET", "/openapi.json")[2])
        script = os.path.join(os.path.dirname(os.path.abspath(__file__)), "docs_page.js")
        done = subprocess.run(["node", script, f"http://127.0.0.1:{service.port}"], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, timeout=harness.PATIENCE_S * 5)  # all examples at full size
        service.stop()
        if done.returncode:
            raise AssertionError(done.stderr)
        cls.page = json.loads(done.stdout)

    def test_each_call_and_object_has_a_section_and_each_link_a_target(self):
        ids = self.page["ids"]
        self.assertEqual(len(ids), len(set(ids)))
        for operations in self.document["paths"].values():
            for operation in operations.values():
                self.assertIn(operation["operationId"], ids)
        for name in self.document["components"]["schemas"]:
            self.assertIn("object-" + name, ids)
        for href in self.page["links"]:
            self.assertTrue(href.startswith("/") or href[1:] in ids, href)

    def test_each_example_runs_where_this_terrain_is(self):
        examples = [f"example: {name}" for operations in self.document["paths"].values() for operation in operations.values()
                    for content in operation.get("requestBody", {}).get("content", {}).values() for name in content.get("examples", ())]
        self.assertEqual([box["name"] for box in self.page["boxes"] if box["request"]], examples)
        for box in self.page["boxes"]:
            with self.subTest(call=box["call"], name=box["name"]):
                if "{hash}" in box["call"]:
                    self.assertIn("{hash}", box["said"])
                    continue
                self.assertEqual(box["status"], 200, box["said"])
                self.assertTrue(box["missing"] < 0.9 or box["name"] == "example: illumination")  # that is at the pole
                if "/v1/rays" in box["call"]:
                    self.assertIn('"hit": true', box["said"])


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
        cls.service = harness.Service("--assets-dir", os.path.join(harness.REPOSITORY, "deploy", "assets"))
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

    def screenshot(self, name):
        file = os.path.join(SCREENSHOTS or harness.path("screenshots"), name + ".png")
        self.assertTrue(self.browser.save_screenshot(file))
        self.assertGreater(os.path.getsize(file), 10000)

    def at_size(self, size):
        self.addCleanup(self.browser.set_window_size, 1500, 1400)
        self.browser.set_window_size(*size)

    def open(self, url=None):
        self.browser.get((url or self.url) + "/")
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

    def test_on_a_laptop_the_frame_is_the_largest_and_all_sliders_are_in_sight(self):
        self.at_size(LAPTOP)
        self.open()
        self.wait(lambda: self.data("maps"))
        boxes, sliders, high = self.browser.execute_script("""
            const box = e => { const b = e.getBoundingClientRect(); return [b.width * b.height, b.top, b.bottom, b.right]; };
            return [Object.fromEntries([...document.querySelectorAll('canvas, fieldset')].map(e => [e.id, box(e)])),
                    [...document.querySelectorAll('input[type=range], #detail, #reflectance, #indirect, #sky, #sensor, #disc, #product')].map(box), innerHeight]""")
        area, top, bottom, _ = boxes.pop("frame")
        self.assertTrue(0 <= top and bottom <= high, boxes)
        self.assertGreater(area, 1.5 * max(other[0] for other in boxes.values()))
        self.assertEqual(len(sliders), 17)
        for _, top, bottom, right in sliders:
            self.assertTrue(0 < top < bottom <= high and right <= LAPTOP[0], (top, bottom, high))
        self.screenshot("page-laptop")
        self.at_size(NARROW)
        self.wait(lambda: self.browser.execute_script("return document.documentElement.scrollWidth <= innerWidth"))
        self.screenshot("page-narrow")

    def test_on_small_screens_nothing_is_cut_off(self):
        for size in (SMALL, PHONE):
            self.at_size(size)
            self.open()
            cut, narrow, beyond = self.browser.execute_script("""
                const shown = kind => [...document.querySelectorAll(kind)].filter(e => e.offsetWidth);
                return [shown('input:not([type=range]), select, textarea').filter(e => e.scrollWidth > e.clientWidth).map(e => e.id),
                        shown('input[type=range]').filter(e => e.offsetWidth < 100).map(e => e.id),
                        shown('input, select, button, canvas').filter(e => e.getBoundingClientRect().right > innerWidth).map(e => e.id)]""")
            self.assertEqual((cut, narrow, beyond), ([], [], []), size)

    def test_the_keyboard_moves_map_and_camera(self):
        self.open()
        self.wait(lambda: self.data("maps"))
        map_ = self.browser.find_element(By.ID, "map")
        before = self.browser.execute_script("return [area.lat, area.lon, area.per_px]")
        map_.send_keys(Keys.ARROW_UP, Keys.ARROW_RIGHT, "+")
        after = self.browser.execute_script("return [area.lat, area.lon, area.per_px]")
        self.assertTrue(after[0] > before[0] and after[1] > before[1] and after[2] < before[2], (before, after))
        self.assertTrue(self.changes(lambda: map_.send_keys(Keys.ENTER)))
        self.assertAlmostEqual(self.browser.execute_script("return camera.lat_deg - area.lat"), 0, 9)
        # Everything that can be done with the mouse alone can be reached: the frame shows, it takes nothing.
        reached = self.browser.execute_script("return [...document.querySelectorAll('input, select, button, canvas[id], summary')]"
                                              ".filter(e => e.tabIndex < 0).map(e => e.id)")
        self.assertEqual(reached, ["frame"])

    def test_synthetic_terrain_is_named_and_only_that(self):
        self.open()
        self.assertEqual(self.text("synthetic"), "synthetic terrain: sample terrain")
        self.assertTrue(self.changes(lambda: self.set("detail", "landing")))
        self.assertEqual(self.text("synthetic"), 'synthetic terrain: sample terrain, detail "landing"')
        # As from a survey: at the south pole, so that its box is shown, and no other's.
        sample("polar", "--south-deg", "-88", "--west-deg", "40", "--rows", "1", "--columns", "1", "--ppd", "64")
        for label in glob.glob(harness.path("polar", "*.lbl")):
            with open(label) as file:
                text = file.read()
            with open(label, "w") as file:
                file.write(text.replace("SYNTHETIC-SELENOGRAPH-SAMPLE-TERRAIN-IN-", ""))
        survey = harness.Service(dem="polar", cache="cache-polar")
        self.addCleanup(survey.stop)
        self.open(f"http://127.0.0.1:{survey.port}")
        self.assertEqual(self.text("synthetic"), "")
        self.wait(lambda: self.data("maps"))
        shown = "return document.getElementById(arguments[0]).offsetHeight > 0"
        self.assertEqual([self.browser.execute_script(shown, pole) for pole in ("north", "south")], [False, True])

    def test_ground_sensor_and_sun_have_controls(self):
        self.open()

        def check(element):
            return lambda: self.browser.find_element(By.ID, element).click()

        self.browser.execute_script("camera.sun_elevation_deg = 5")
        self.changes(lambda: self.set("size", "256"))
        for act, member, value in (
                (lambda: self.set("reflectance", "hapke"), "surface", {"reflectance": {"model": "hapke"}}),
                (check("disc"), "sun", {"angular_radius_deg": "sun"}),
                (lambda: self.set("detail", "highlands"), "detail", "highlands"),
                (check("indirect"), "indirect", {"terrain": True, "earth": False}),
                (check("sensor"), "sensor", {"exposure": {"target_fill": 0.8, "longest_s": 0.2}})):
            self.assertTrue(self.changes(act), member)
            asked = self.browser.execute_script("return asked")[member]
            self.assertEqual({k: asked[k] for k in value} if isinstance(value, dict) else asked, value)
        self.set("detail", "nowhere")
        self.wait(lambda: "no such detail" in self.text("problem"))

    def test_a_focal_length_is_a_field_of_view(self):
        self.open()
        self.set("pitch_um", "10")
        self.assertTrue(self.changes(lambda: self.set("focal_mm", "2.56")))  # half of 512 pixels of 10 um
        self.assertAlmostEqual(self.browser.execute_script("return asked.camera.fov_deg"), 90, 9)
        self.changes(lambda: self.set("fov_deg_number", "53.13010235"))
        self.assertAlmostEqual(float(self.browser.find_element(By.ID, "focal_mm").get_attribute("value")), 5.12, 4)

    def test_a_day_of_the_sun_plays(self):
        self.open()
        self.changes(lambda: self.set("size", "256"))

        def elevation(days):
            self.changes(lambda: self.browser.execute_script("setDay(arguments[0])", days))
            return self.browser.execute_script("return view.sun.elevation_deg")

        sunrise, noon, night = elevation(0), elevation(7), elevation(22)
        self.assertTrue(0 < sunrise < 8, sunrise)
        self.assertGreater(noon, 80)
        self.assertLess(night, -60)
        self.changes(lambda: self.set("utc", "2027-01-01T00:00:00Z"))
        self.assertEqual(self.browser.execute_script("return asked.sun.utc"), "2027-01-01T00:00:00Z")
        # With a time the sky and the Earth's light have an epoch. Stars are above the horizon, and too faint for 8 bits.
        self.changes(lambda: self.set("tilt_deg_number", "60"))
        self.changes(lambda: self.set("product", "radiance"))
        for switch in ("sky", "indirect"):
            self.assertTrue(self.changes(lambda: self.browser.find_element(By.ID, switch).click()), switch)
        asked = self.browser.execute_script("return asked")
        self.assertEqual(asked["sky"], {"stars": True, "earth": True, "sun": True, "planets": True})
        self.assertEqual(asked["indirect"], {"terrain": True, "earth": True})
        self.changes(lambda: self.browser.find_element(By.ID, "indirect").click())
        frames = int(self.data("frames"))
        play = self.browser.find_element(By.ID, "play")
        play.click()
        self.wait(lambda: int(self.data("frames")) >= frames + 5)
        play.click()
        self.assertEqual(play.text, "play a day")
        days = float(self.browser.find_element(By.ID, "day").get_attribute("value"))
        self.assertAlmostEqual(days / (29.5306 / 240) % 1, 0, 6)
        self.assertGreaterEqual(days, 29.5306 / 240 * 4)
        self.wait(lambda: self.text("state") == "ready")
        # The Sun by hand again.
        self.changes(lambda: self.set("sun_azimuth_deg_number", "45"))
        self.assertEqual(self.browser.execute_script("return asked.sun.local.azimuth_deg"), 45)

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
                f"Object.assign(camera, {{lat_deg: 0.05, lon_deg: 30.05, fov_deg: 10, tilt_deg: 20, azimuth_deg: {azimuth}, "
                f"up_azimuth_deg: {azimuth}}}); changed()"))
            there = self.browser.execute_script("return [view.lat_deg - camera.lat_deg, view.lon_deg - camera.lon_deg]")
            self.assertGreater(sign * there[member], 0.1)
            self.assertLess(abs(there[1 - member]), 0.01)
            # What is farther away is up in the image: the upper corners are farther from the camera.
            upper, lower = self.browser.execute_script("""
                const far = c => Math.hypot(c.lat_deg - camera.lat_deg, c.lon_deg - camera.lon_deg);
                return [far(view.corners[0]), far(view.corners[3])]""")
            self.assertGreater(upper, lower)

    def test_a_place_is_looked_at_from_above_the_ground(self):
        self.open()
        self.changes(lambda: self.browser.find_element(By.ID, "above_ground").click())
        pose = self.browser.execute_script("return asked.pose")
        self.assertEqual(pose["geodetic"]["height_above_ground_m"], 30000)
        self.changes(lambda: self.browser.find_element(By.ID, "aims").click())
        self.changes(lambda: self.set("aim_lat_deg", "0.2"))
        self.changes(lambda: self.set("aim_lon_deg", "30.1"))
        at = self.browser.execute_script("return [view.lat_deg, view.lon_deg]")
        np.testing.assert_allclose(at, (0.2, 30.1), atol=1e-4)
        # A tilt ends it.
        self.changes(lambda: self.set("tilt_deg_number", "0"))
        self.assertNotIn("look_at", self.browser.execute_script("return asked.pose"))
        rows = self.browser.execute_script("return trajectory('lat_deg,lon_deg,height_above_ground_m\\n1,2,300').map(poseOf)")
        self.assertEqual(rows[0]["geodetic"], {"lat_deg": 1, "lon_deg": 2, "height_above_ground_m": 300})
        self.assertEqual(self.errors(), [])

    def test_the_scale_states_what_it_clips_and_noise_at_night_is_black(self):
        self.open()
        self.changes(lambda: self.set("product", "radiance"))
        clipped = self.browser.execute_script("return document.getElementById('legend').textContent")
        above = re.search(r"; ([0-9.]+) % above", clipped)
        self.assertTrue(above and 0 < float(above[1]) < 0.2, clipped)
        self.changes(lambda: self.set("product", "image"))
        brightest = """const frame = document.getElementById("frame");
            const values = frame.getContext("2d").getImageData(0, 0, frame.width, frame.height).data;
            return values.filter((_, i) => i % 4 === 0).sort()[Math.floor(values.length / 4 * 0.99)]"""
        self.changes(lambda: self.browser.find_element(By.ID, "sensor").click())
        self.assertGreater(self.browser.execute_script(brightest), 200)
        self.changes(lambda: self.set("sun_elevation_deg_number", "-15"))
        self.assertLess(self.browser.execute_script(brightest), 30)

    def test_each_product_is_shown(self):
        self.open()
        self.changes(lambda: self.set("size", "256"))
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
        # A box adds true and false, which Python spells otherwise.
        self.changes(lambda: self.browser.find_element(By.ID, "indirect").click())
        self.browser.find_element(By.CSS_SELECTOR, "[data-as=python]").click()
        program = self.browser.find_element(By.ID, "copied").get_attribute("value")
        check = '\nimport hashlib\nprint(hashlib.sha256(frame["radiance"].tobytes()).hexdigest())'
        client = os.path.join(harness.REPOSITORY, "api", "clients", "python")
        done = subprocess.run([sys.executable, "-c", program + check], stdout=subprocess.PIPE, text=True, check=True,
                              timeout=harness.PATIENCE_S, env=dict(os.environ, PYTHONPATH=client))
        self.assertEqual(done.stdout.split()[-1], self.data("frameSha256"))

    def test_epochs_are_read_as_the_service_reads_them(self):
        self.browser.execute_cdp_cmd("Emulation.setTimezoneOverride", {"timezoneId": "Asia/Karachi"})
        self.addCleanup(self.browser.execute_cdp_cmd, "Emulation.setTimezoneOverride", {"timezoneId": ""})
        self.open()
        for epoch in ("2026-11-20T00:00:00Z", "2026-11-20T00:00:00", "2026-324T00:00:00Z"):
            self.assertEqual(self.browser.execute_script("setTime(arguments[0]); return utcText(day_start)", epoch), "2026-11-20T00:00:00Z")

    def test_fields_and_pictures_have_names(self):
        self.open()
        nodes = self.browser.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
        roles = {"slider", "spinbutton", "textbox", "checkbox", "radio", "button", "combobox", "img", "image", "Canvas"}
        named = [n.get("name", {}).get("value") for n in nodes if n.get("role", {}).get("value") in roles and not n["ignored"]]
        self.assertGreater(len(named), 30)
        self.assertEqual([name for name in named if not name], [])

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
        self.wait(lambda: "either lat_deg, lon_deg and one of height_m" in self.text("problem"))
        self.browser.execute_script("play(new File(['lat_deg,lon_deg,height_m\\n0.1,30,-9000'], 'way.csv'))")
        self.wait(lambda: "/pose" in self.text("problem") and self.text("state") == "refused")

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
                np.testing.assert_allclose(attitude(pose["nadir"], east, up), matrix, atol=1e-9)
                np.testing.assert_allclose([pose["geodetic"][m] for m in ("lat_deg", "lon_deg", "height_m")],
                                           (0.1, 30.0, 20000.0), rtol=1e-9)
        frames = int(self.data("frames"))
        self.browser.execute_script("""play(new File([['utc,lat_deg,lon_deg,height_m,tilt_deg',
            '2026-11-20T00:00:00Z,0.1,30.0,20000,5', '2026-11-20T00:10:00Z,0.1,30.1,20000,5'].join('\\n')], 'way.csv'))""")
        self.wait(lambda: int(self.data("frames")) >= frames + 2)
        self.assertEqual(self.browser.execute_script("return asked.sun.utc"), "2026-11-20T00:10:00Z")
        for wrong, said in (("lat_deg,lon_deg,height_m,pitch\n1,2,3,4", "column pitch is unknown"),
                            ("lat_deg,lon_deg,height_m,camera_from_moon_w\n1,2,3,4", "has not all of"),
                            ("lat_deg,lon_deg,height_m\n1,,3", "line 2: lon_deg is not a number"),
                            ("lat_deg,lon_deg,height_m\n1,3", "line 2: 2 values for 3 columns")):
            self.browser.execute_script("play(new File([arguments[0]], 'way.csv'))", wrong)
            self.wait(lambda said=said: said in self.text("problem"))

    def open_docs(self):
        self.browser.get(self.url + "/docs")
        self.wait(lambda: self.data("ready"))

    def unfold(self):
        """Opens all details, and those within them; returns what is to be read then."""
        closed = "return document.querySelectorAll('details:not([open])').length"
        while self.browser.execute_script(closed):
            self.browser.execute_script("for (const box of document.querySelectorAll('details:not([open])')) box.open = true")
            self.wait(lambda: self.browser.execute_script("return [...document.querySelectorAll('details[open]')].every(d => d.children.length > 1)"))
        return self.browser.execute_script("return document.body.innerText")  # the driver's own takes a minute

    def test_the_api_document_is_rendered_text(self):
        for name, size in (("laptop", LAPTOP), ("narrow", NARROW)):
            self.at_size(size)
            self.open_docs()
            self.assertTrue(self.browser.execute_script("return document.documentElement.scrollWidth <= innerWidth"), name)
            self.screenshot("docs-" + name)
            self.browser.execute_script("document.getElementById('renderFrame').scrollIntoView()")
            self.screenshot("docs-call-" + name)
        text = self.unfold()
        for said in ("POST /v1/frames", "height_m", "example: nadir", "exactly one of fov_deg, fx, focal_length_mm, cahvor, lines_of_sight is required"):
            self.assertIn(said, text)
        for raw in ("##", "|--", "`", "**", "[object", "undefined"):
            self.assertNotIn(raw, text)
        about = self.browser.find_element(By.CSS_SELECTOR, "h1 + div")
        self.assertTrue(about.find_elements(By.TAG_NAME, "h2") and about.find_elements(By.CSS_SELECTOR, "table td code"))
        self.assertEqual(self.errors(), [])

    def test_the_api_document_opens_with_what_most_need(self):
        self.open_docs()
        self.assertLess(len(self.browser.find_element(By.TAG_NAME, "body").text), 30000)
        self.browser.execute_script("location.hash = '#object-Camera'")
        self.wait(lambda: "fov_deg" in self.browser.find_element(By.CSS_SELECTOR, "#object-Camera + details").text)

if __name__ == "__main__":
    if not webdriver:
        print("no selenium or no SciPy: the browser's part is skipped", file=sys.stderr)
    harness.main()
