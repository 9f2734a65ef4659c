#!/usr/bin/env python3
"""POST /v1/sky over HTTP, and its places against astropy and ERFA in Python (skipped without python3-astropy)."""

import datetime
import json
import math
import os
import random
import subprocess
import sys
import unittest

import numpy as np

import harness
from harness import assets, path, sample, Service, tearDownModule

try:
    import astropy.units as u
    import erfa
    from astropy.coordinates import (GCRS, ICRS, CartesianRepresentation, SkyCoord, get_body_barycentric,
                                     solar_system_ephemeris)
    from astropy.time import Time
    from astropy.utils import iers
    iers.conf.auto_download = False
except ImportError:
    erfa = None

EPOCHS = ("2001-02-03T04:05:06", "2026-11-25T00:00:00", "2049-07-01T12:00:00")
HEAD = "id,ra_deg,dec_deg,epoch_yr,pm_ra_mas_yr,pm_dec_mas_yr,parallax_mas,v_mag,b_v"
# ICRF axes at the Moon's centre: a fisheye that sees all but a cone behind it.
POSITION_M, VELOCITY_M_S = [3.0e6, -2.0e7, 1.0e6], [1200.0, -800.0, 500.0]
EVERYTHING = {"camera": {"model": "fisheye", "width": 1024, "height": 1024, "fov_deg": 358.0},
              "pose": {"frame": "ICRF", "position_m": POSITION_M, "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}},
              "utc": EPOCHS[1] + "Z", "sky": {"stars": "thousand"}}
service = None


def setUpModule():
    global service
    harness.set_up()
    sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "256")
    folder, chance = assets(), random.Random(5)
    with open(os.path.join(folder, "stars", "thousand.csv"), "w", encoding="ascii") as file:
        print(HEAD, file=file)
        for i in range(1000):
            dec, pm = math.degrees(math.asin(2 * chance.random() - 1)), [chance.gauss(0, 300) for _ in range(2)]
            print(f"T{i},{360 * chance.random():.9f},{dec:.9f},{chance.choice((1991.25, 2000, 2016))},{pm[0]:.4f},"
                  f"{pm[1]:.4f},{abs(chance.gauss(0, 100)) + 0.1:.4f},{5 * chance.random():.3f},0.6", file=file)
    service = Service("--assets-dir", folder)


class Catalogues(unittest.TestCase):
    """deploy/stars, without a download."""

    def refused(self, *options, before=None, **environment):
        done = subprocess.run([os.path.join(harness.REPOSITORY, "deploy", "stars"), "bright", *options], capture_output=True,
                              text=True, timeout=harness.PATIENCE_S, env={**os.environ, **environment}, preexec_fn=before)
        self.assertNotEqual(done.returncode, 0)
        self.assertNotIn("Traceback", done.stderr)
        return done.stderr

    def test_what_it_refuses(self):
        self.assertIn("nothing can be written there", self.refused("-o", path("nowhere", "bright.csv")))
        self.assertIn("nan is not a number", self.refused("--magnitude-limit", "nan"))
        os.symlink(sys.executable, path("python3"))
        self.assertIn("there is no apt-get", self.refused("-o", path("bright.csv"), PATH=path()))

def sky(**changes):
    status, _, body = service.post("/v1/sky", {**EVERYTHING, **changes})
    assert status == 200, body[:500]
    return json.loads(body)["objects"]


def unit(v):
    return np.asarray(v) / np.linalg.norm(v)


def arcsec(a, b):
    return math.degrees(math.asin(min(1, np.linalg.norm(np.cross(a, b))))) * 3600


def toward(eye, direction):
    """The pose there that looks along a direction, MOON_ME."""
    place = eye + 20e3 * np.asarray(direction)
    radius = np.linalg.norm(place)
    return {"position_m": eye.tolist(),
            "look_at": {"lat_deg": math.degrees(math.asin(place[2] / radius)), "up": "zenith",
                        "lon_deg": math.degrees(math.atan2(place[1], place[0])), "height_m": radius - 1737400}}


def grid_of_stars(name, up, east, azimuths, elevations):
    """A catalogue of stars of EPOCHS[1] in places of a sky, MOON_ME and radians, azimuths from the east."""
    some = {o["id"]: o for o in sky()}.values()
    u_, _, v = np.linalg.svd(np.array([o["direction_icrf"] for o in some]).T @ np.array([o["direction"] for o in some]))
    icrf_from_moon, north = u_ @ np.diag([1, 1, np.linalg.det(u_ @ v)]) @ v, np.cross(up, east)
    directions = np.array([math.cos(e) * (math.cos(a) * east + math.sin(a) * north) + math.sin(e) * up
                           for a in azimuths for e in elevations + 0.02 * a])
    with open(path("assets", "stars", name + ".csv"), "w", encoding="ascii") as file:
        print(HEAD, file=file)
        for i, (x, y, z) in enumerate(directions @ icrf_from_moon.T):
            ra, dec = math.degrees(math.atan2(y, x)) % 360, math.degrees(math.asin(z))
            print(f"G{i},{ra:.9f},{dec:.9f},2026.9,0,0,0,3,0.6", file=file)


class Answer(unittest.TestCase):
    def test_orion_among_the_bright_stars(self):
        with open(os.path.join(harness.REPOSITORY, "api", "endpoints", "examples.json"), encoding="utf-8") as file:
            orion = json.load(file)["/v1/sky"]["orion"]
        stars = {o["id"]: o for o in sky(**orion)}
        betelgeuse, rigel, bellatrix, saiph = (stars[f"HR {n}"] for n in (2061, 1713, 1790, 2004))
        self.assertLess(betelgeuse["y_px"], rigel["y_px"])  # north is up
        self.assertLess(betelgeuse["x_px"], bellatrix["x_px"])  # east is left
        self.assertLess(saiph["x_px"], rigel["x_px"])
        belt = [stars[f"HR {n}"] for n in (1948, 1903, 1852)]  # Alnitak, Alnilam, Mintaka
        self.assertEqual(sorted(belt, key=lambda o: o["x_px"]), belt)
        self.assertTrue(all(o["visible"] for o in stars.values() if o["kind"] == "star"))

    def test_npz_has_what_json_has(self):
        what = {"stars": "thousand", "earth": True, "sun": True, "planets": True}
        objects = sky(sky=what)
        arrays = service.arrays({**EVERYTHING, "sky": what}, "/v1/sky")
        self.assertEqual(arrays["meta"]["id"], [o["id"] for o in objects])
        self.assertEqual(arrays["meta"]["kind"][-9:], ["sun", "earth"] + 7 * ["planet"])
        for name in ("direction_icrf", "direction", "direction_camera"):
            self.assertEqual(arrays[name].tolist(), [o[name] for o in objects])
        self.assertEqual(arrays["magnitude"][:, 0].tolist(), [o["magnitude"] for o in objects])

    def test_what_is_wrong_is_said(self):
        for changes, pointer in (({"utc": None}, ""), ({"utc": "2026-13-01T00:00:00Z"}, "/utc"),
                                 ({"sky": {"stars": "nowhere"}}, "/sky/stars"),
                                 ({"sky": {"magnitude": 4}}, "/sky/magnitude"),
                                 ({"sky": None}, "/sky")):
            document = {k: v for k, v in {**EVERYTHING, **changes}.items() if v is not None}
            status, _, body = service.post("/v1/sky", document)
            self.assertEqual(status, 422, body)
            self.assertIn(pointer, [error["pointer"] for error in json.loads(body)["errors"]], body)

    def test_a_frame_needs_an_epoch_for_its_sky(self):
        request = harness.frame_request(sky={"stars": True})
        status, _, body = service.frame(request)
        self.assertEqual((status, json.loads(body)["errors"][0]["pointer"]), (422, "/sky"), body)
        self.assertEqual(service.frame({**request, "sky": {"stars": True, "utc": EPOCHS[0]}})[0], 200)

    def test_a_broken_catalogue_is_named_with_its_line(self):
        for name, star in (("broken", "A,1,2,2000,0,0,0,4,x"), ("latin", "\xe9,1,2,2000,0,0,0,4,0.6")):
            with open(path("assets", "stars", f"{name}.csv"), "w", encoding="latin-1") as file:
                file.write(f"{HEAD}\n{star}\n")
            status, _, body = service.post("/v1/sky", {**EVERYTHING, "sky": {"stars": name}})
            self.assertEqual(status, 500)
            self.assertIn(f"{name}.csv: line 2".encode(), body)


class LikeFrames(unittest.TestCase):
    """What frames take, /v1/sky takes."""

    def test_a_rolling_shutter_sees_each_star_in_its_row(self):
        """A camera that turns about its y axis: a star is where the row's attitude has it, at the row's time."""
        camera, rate_deg_s, line_time_s = {"model": "pinhole", "width": 512, "height": 512, "fov_deg": 40.0}, 2.0, 1e-3
        still = {"camera": camera, "sky": {"stars": "thousand"}}
        focal, middle = 256 / math.tan(math.radians(20)), 255.5
        moving = sky(**still, shutter={"line_time_s": line_time_s, "angular_rate_deg_s": [0, rate_deg_s, 0]})
        before = {o["id"]: o for o in sky(**still)}
        compared = 0
        for o in moving:
            if not o["in_frame"]:
                continue
            compared += 1
            turned = math.radians(rate_deg_s * line_time_s * o["y_px"])
            x, y, z = o["direction_camera"] if o["id"] not in before else before[o["id"]]["direction_camera"]
            # In axes that have turned by an angle about y, what stays turns back.
            x, z = x * math.cos(turned) - z * math.sin(turned), x * math.sin(turned) + z * math.cos(turned)
            self.assertAlmostEqual(o["x_px"], middle + focal * x / z, delta=1e-5)
            self.assertAlmostEqual(o["y_px"], middle + focal * y / z, delta=1e-5)
        self.assertGreater(compared, 15)
        moved = [abs(o["x_px"] - before[o["id"]]["x_px"]) for o in moving if o["id"] in before and o["in_frame"]]
        self.assertGreater(max(moved), 10)


class OfAnotherEpoch(unittest.TestCase):
    """A pose in ICRF an hour after its sky: the Moon has turned by half a degree, and an inertial camera with it."""

    CAMERA, LATER = {"width": 64, "height": 64, "fov_deg": 10.0}, {"utc": "2026-11-25T01:00:00Z"}
    POSE = EVERYTHING["pose"]
    WORDS = "the epoch of a pose in ICRF"

    def warnings(self, headers):
        return [text for text in json.loads(headers.get("Selenograph-Warnings", "[]")) if self.WORDS in text]

    def test_frames_warn_and_have_another_tag(self):
        moons = {"position_m": POSITION_M, "look_at": {"lat_deg": 0, "lon_deg": 0}}
        request = {"camera": self.CAMERA, "sun": {"utc": EVERYTHING["utc"]}, "sky": {"stars": "thousand"}}

        def asked(pose, **changes):
            arrays = service.arrays({**request, "products": ["radiance"], "pose": pose, **changes})
            self.assertEqual([text for text in arrays["meta"]["warnings"] if self.WORDS in text],
                             self.warnings(arrays["headers"]))
            return len(self.warnings(arrays["headers"])), arrays
        count, later = asked({**self.POSE, **self.LATER})
        self.assertEqual(count, 1)
        # The same frame by its resolved pose, which is the Moon's.
        count, resolved = asked(later["meta"]["request"]["pose"])
        self.assertEqual(count, 0)
        self.assertTrue(np.array_equal(later["radiance"], resolved["radiance"]))
        self.assertNotEqual(later["headers"]["ETag"], resolved["headers"]["ETag"])
        for pose, changes in ((self.POSE, {}), (moons, {}), ({**self.POSE, **self.LATER}, {"products": ["depth"]}),
                              ({**self.POSE, **self.LATER}, {"sky": {**request["sky"], **self.LATER}})):
            self.assertEqual(asked(pose, **changes)[0], 0, (pose, changes))


class BehindMountains(unittest.TestCase):
    """Stars above a rugged horizon: a frame shows those that no ray to them hits the ground, and /v1/sky says so."""

    LAT, LON, SIDE, FOV_DEG = 0.4, 30.5, 640, 50.0

    def test_frames_show_stars_where_rays_are_free(self):
        status, _, body = service.post("/v1/heights", {"points": [{"lat_deg": self.LAT, "lon_deg": self.LON}]})
        ground_m = json.loads(body)["points"][0]["height_m"]
        lat, lon = math.radians(self.LAT), math.radians(self.LON)
        up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
        east = np.array([-math.sin(lon), math.cos(lon), 0])
        eye = (1737400 + ground_m + 3) * up
        ahead = {"lat_deg": self.LAT, "lon_deg": self.LON + 0.1, "height_m": ground_m + 0.1 * 30323 * math.tan(math.radians(16))}
        # Closer to each other up and down than a pixel's neighbours, farther apart sideways.
        grid_of_stars("grid", up, east, np.radians(np.arange(-20, 20.1, 0.8)), np.radians(np.linspace(-4, 36, 61)))
        request = {"camera": {"width": self.SIDE, "height": self.SIDE, "fov_deg": self.FOV_DEG}, "utc": EPOCHS[1] + "Z",
                   "pose": {"position_m": eye.tolist(), "look_at": {**ahead, "up": "zenith"}}, "sky": {"stars": "grid"}}
        listed = {o["id"]: o for o in json.loads(service.post("/v1/sky", request)[2])["objects"]}
        # Night: what is not black is a star.
        night = {"local": {"lat_deg": self.LAT, "lon_deg": self.LON, "azimuth_deg": 0, "elevation_deg": -30}}
        frame = dict(request, sun=night, products=["radiance"], sky=dict(request["sky"], utc=request.pop("utc")),
                     accuracy={"max_error_px": 0})
        radiance = service.arrays(frame)["radiance"]
        chosen = [o for o in listed.values() if all(3 < o[k] < self.SIDE - 4 for k in ("x_px", "y_px"))]
        rays = [{"origin_m": eye.tolist(), "direction": o["direction"]} for o in chosen]
        status, _, body = service.post("/v1/rays", {"rays": rays})
        free = np.array([not ray["hit"] for ray in json.loads(body)["rays"]])
        self.assertGreater(min(free.sum(), (~free).sum()), 300)
        shown = []
        for o in chosen:
            x, y = round(o["x_px"]), round(o["y_px"])
            shown.append(radiance[y - 1:y + 2, x - 1:x + 2].max() > 0)
        self.assertEqual([o["id"] for o, a, b in zip(chosen, shown, free) if a != b], [])
        self.assertEqual([o["visible"] for o in chosen], free.tolist())
        self.assertTrue(all(o.get("hidden_by") == "moon" for o, f in zip(chosen, free) if not f))

    def test_a_moon_without_data_hides_the_sun(self):
        """From 100 km, 50 degrees below the horizon: nobody knows the ground there."""
        lat, lon, utc = math.radians(self.LAT), math.radians(self.LON), "2026-12-10T00:00:00Z"
        eye = (1737400 + 1e5) * np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
        still = {"position_m": eye.tolist(), "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}}
        sun = sky(pose=still, utc=utc, sky={"sun": True})[0]
        self.assertEqual(sun["hidden_by"], "moon")
        request = {"camera": {"width": 64, "height": 64, "fov_deg": 8.0}, "pose": toward(eye, sun["direction"]),
                   "sun": {"utc": utc}, "sky": {"sun": True}}
        self.assertEqual(service.arrays({**request, "products": ["radiance"]})["radiance"].max(), 0)

    def test_an_object_hides_the_sun(self):
        """Two kilometres before it on the line of sight, or above the camera."""
        lat, lon = math.radians(self.LAT), math.radians(self.LON)
        up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
        still = {"position_m": ((1737400 + 1e5) * up).tolist(), "camera_from_moon": {"w": 1, "x": 0, "y": 0, "z": 0}}
        request = {"pose": still, "utc": "2026-12-24T00:00:00Z", "sky": {"sun": True}}
        sun = sky(**request)[0]
        self.assertEqual(sun["hidden_by"], "none")
        for direction, hidden_by in ((np.array(sun["direction"]), "object"), (up, "none")):
            x, y, z = np.array(still["position_m"]) + 2000 * direction
            radius_m = math.hypot(x, y, z)
            place = {"lat_deg": math.degrees(math.asin(z / radius_m)), "lon_deg": math.degrees(math.atan2(y, x)),
                     "height_m": radius_m - 1737400}
            satellite = {"mesh": "satellite", "scale": 60, "pose": {"geodetic": place, "upright": {"azimuth_deg": 30}},
                         "material": {"reflectance": {"model": "lambert", "rho": 0.3}}}
            self.assertEqual(sky(**request, objects=[satellite])[0]["hidden_by"], hidden_by)


class OverGroundWithDetail(unittest.TestCase):
    """A lander's sky over a horizon of fine ground: what hides it the frame knows, and needs no more ground for it.

    Each test has a camera of its own: the service prepares no ground for where it might move next.
    """

    LAT, LON, HEIGHT_M, SIDE = 0.4, 30.5, 300, 256
    SUN_ON_HORIZON = "2026-12-15T11:00:00Z"
    MISSES = "selenograph_terrain_cache_misses_total"

    @classmethod
    def setUpClass(cls):
        status, _, body = service.post("/v1/heights", {"points": [{"lat_deg": cls.LAT, "lon_deg": cls.LON}]})
        lat, lon = math.radians(cls.LAT), math.radians(cls.LON)
        cls.up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
        cls.eye = (1737400 + json.loads(body)["points"][0]["height_m"] + cls.HEIGHT_M) * cls.up

    def with_sky(self, frame, options):
        """The frame with and without a sky: it takes no block of terrain that it doesn't take without."""
        without = service.arrays(frame)
        before = service.metric(self.MISSES)
        shown = service.arrays({**frame, "sky": options})
        self.assertEqual(service.metric(self.MISSES), before)
        return shown, without

    def test_the_sun_is_hidden_where_pixels_see_ground(self):
        sun = sky(utc=self.SUN_ON_HORIZON, sky={"sun": True})[0]["direction"]
        frame = {"camera": {"width": 64, "height": 64, "fov_deg": 8.0}, "pose": toward(self.eye, sun), "detail": "landing",
                 "sun": {"utc": self.SUN_ON_HORIZON}, "products": ["radiance", "range"], "accuracy": {"max_error_px": 2}}
        shown, without = self.with_sky(frame, {"sun": True})
        light, free = shown["radiance"] - without["radiance"], np.isnan(without["range"])
        y, x = np.mgrid[:64, :64]
        disc = np.hypot(x - 31.5, y - 31.5) < 1.6
        self.assertGreater(min((disc & free).sum(), (disc & ~free).sum()), 1)
        self.assertGreater(light[disc & free].min(), 1e5)
        self.assertEqual(np.abs(light[~free]).max(), 0)

class Eclipse(unittest.TestCase):
    """Total on 2025 March 14, 06:26 to 07:31; the penumbra has left the Moon at 10:00."""

    TOTAL, OVER = "2025-03-14T06:59:00Z", "2025-03-14T10:05:00Z"

    def warnings(self, meta):
        return [text for text in meta["warnings"] if "the Earth covers the Sun" in text]

    def test_frames_warn_and_their_share_is_said(self):
        tags = set()
        for sun, share in ({"utc": self.TOTAL}, 1), ({"utc": self.OVER}, None), (None, None):
            if sun is None:  # the Sun of the first, by its direction: the same light, and no epoch to warn of
                sun = first["request"]["sun"]
            arrays = service.arrays(harness.frame_request(sun=sun))
            first = arrays["meta"] if share else first
            self.assertEqual(arrays["meta"].get("sun_covered_fraction"), share)
            self.assertEqual(len(self.warnings(arrays["meta"])), share or 0)
            self.assertEqual("the Earth covers" in arrays["headers"].get("Selenograph-Warnings", ""), bool(share))
            tags.add(arrays["headers"]["ETag"])
        self.assertEqual(len(tags), 3)
        depth = service.arrays(harness.frame_request(("depth",), sun={"utc": self.TOTAL}))["meta"]
        self.assertEqual(self.warnings(depth), [])

    def test_a_partial_eclipse_has_its_share(self):
        meta = service.arrays(harness.frame_request(sun={"utc": "2025-03-14T05:20:00Z"}))["meta"]
        self.assertTrue(0.05 < meta["sun_covered_fraction"] < 1, meta["sun_covered_fraction"])

    def test_maps_rays_and_landmarks_warn(self):
        for utc, warned in (self.TOTAL, 1), (self.OVER, 0):
            sun = {"utc": utc}
            area = {"projection": "orthographic", "gsd_m": 100.0, "center": {"lat_deg": 0.4, "lon_deg": 30.5},
                    "width_m": 800.0, "height_m": 800.0}
            meta = service.arrays({"map": area, "sun": sun, "products": ["lit"]}, "/v1/maps")["meta"]
            self.assertEqual((len(self.warnings(meta)), meta.get("sun_covered_fraction", 0)), (warned, warned))
            ray = {"origin_m": [2e6, 0, 0], "direction": [-1, 0, 0]}
            frame = harness.frame_request()
            for where, request in (("/v1/rays", {"rays": [ray]}),
                                   ("/v1/project", {"camera": frame["camera"], "pose": frame["pose"],
                                                    "points": [{"lat_deg": 0.4, "lon_deg": 30.5}]})):
                status, headers, body = service.post(where, {**request, "sun": sun})
                self.assertEqual(status, 200, body)
                said = json.loads(headers.get("Selenograph-Warnings", "[]"))
                self.assertEqual(len(self.warnings({"warnings": said})), warned, (where, utc))


class MapOfTheEarth(unittest.TestCase):
    UTC, SIDE, FOV_DEG = "2026-11-12T06:00:00", 512, 2.2  # three days after new moon: the Earth is nearly full

    @staticmethod
    def earth_from_icrf(utc):
        """Archinal et al. (2018), table 1: the Earth's pole and prime meridian."""
        tt = (datetime.datetime.fromisoformat(utc) - datetime.datetime(2000, 1, 1, 12)).total_seconds() + 37 + 32.184
        days = tt / 86400
        ra, dec, w = (math.radians(a) for a in (-0.641 * days / 36525, 90 - 0.557 * days / 36525,
                                                190.147 + 360.9856235 * days))

        def turned(axis, angle):
            c, s = math.cos(angle), math.sin(angle)
            return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]] if axis == 3 else [[1, 0, 0], [0, c, s], [0, -s, c]])
        return turned(3, w) @ turned(1, math.pi / 2 - dec) @ turned(3, math.pi / 2 + ra)

    def request(self):
        """A camera between the Moon and the Earth that looks at the Earth, and /v1/sky's Earth and Sun for it."""
        request = {"camera": {"model": "pinhole", "width": self.SIDE, "height": self.SIDE, "fov_deg": self.FOV_DEG},
                   "pose": {"frame": "ICRF", "position_m": POSITION_M,
                            "camera_from_moon_matrix": np.eye(3).tolist()}, "utc": self.UTC + "Z"}
        status, _, body = service.post("/v1/sky", {**request, "sky": {"earth": True, "sun": True}})
        assert status == 200, body
        bodies = {o["kind"]: o for o in json.loads(body)["objects"]}
        forward = np.array(bodies["earth"]["direction_icrf"])
        right = unit(np.cross([0, 0, -1.0], forward))
        axes = np.array([right, np.cross(forward, right), forward])
        request["pose"]["camera_from_moon_matrix"] = axes.tolist()
        return request, bodies, axes

    def seen(self, rotation, lat_deg, lon_deg, bodies, axes):
        """Pixels of places on the ellipsoid, and their share of the light."""
        lat, lon = np.radians(lat_deg), np.radians(lon_deg)
        normal = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
        e2 = 1 - (1 - 1 / 298.257223563) ** 2
        place = 6378137 / np.sqrt(1 - e2 * np.sin(lat) ** 2)[..., None] * normal * [1, 1, 1 - e2]
        way = np.array(bodies["earth"]["direction_icrf"]) * bodies["earth"]["distance_m"] + place @ rotation
        x, y, z = np.moveaxis(way @ axes.T, -1, 0)
        focal, middle = 0.5 * self.SIDE / math.tan(math.radians(self.FOV_DEG / 2)), (self.SIDE - 1) / 2
        toward_camera = -way / np.linalg.norm(way, axis=-1, keepdims=True)
        mu, mu0 = ((normal @ rotation) * v for v in (toward_camera, np.array(bodies["sun"]["direction_icrf"])))
        light = np.maximum(mu.sum(-1), 0) * np.maximum(mu0.sum(-1), 0) * np.cos(lat)
        return middle + focal * x / z, middle + focal * y / z, light

    def put_map(self, name, values):
        """A grid of latitudes from north to south."""
        rows, columns = values.shape
        with open(path("assets", "maps", name + ".asc"), "w", encoding="ascii") as file:
            print(f"ncols {columns}\nnrows {rows}\nxllcorner -180\nyllcorner -90\ncellsize {180 / rows}", file=file)
            for row in values:
                print(" ".join(f"{v:g}" for v in row), file=file)
        with open(path("assets", "maps", name + ".json"), "w", encoding="ascii") as file:
            json.dump({"file": name + ".asc", "extent": {"south_deg": -90, "north_deg": 90, "west_deg": -180,
                                                         "east_deg": 180}}, file)

    def disc(self, request, **what):
        answer = {k: v for k, v in request.items() if k != "utc"}
        return service.arrays({**answer, "sun": {"utc": self.UTC + "Z"}, "products": ["radiance"],
                               "band": {"center_um": 0.55, "width_um": 0.1},
                               "sky": {"earth": True, **what}})["radiance"].astype(float)

    def test_a_bright_cell_is_where_the_earths_rotation_has_it(self):
        request, bodies, axes = self.request()
        rotations = {"Archinal et al.": (self.earth_from_icrf(self.UTC), 0.4)}
        if erfa:
            time = Time(self.UTC, scale="utc") - bodies["earth"]["distance_m"] / 299792458.0 * u.s
            rotations["ERFA"] = (erfa.c2t06a(time.tt.jd1, time.tt.jd2, time.utc.jd1, time.utc.jd2, 0, 0), 0.01)
        below = self.earth_from_icrf(self.UTC) @ -np.array(bodies["earth"]["direction_icrf"])
        lat0, lon0 = (round(math.degrees(a)) for a in (math.asin(below[2]), math.atan2(below[1], below[0])))
        for case, (lat, lon) in enumerate(((lat0 + 40, lon0 - 20), (lat0 - 50, lon0 + 25))):
            values = np.zeros((180, 360))
            values[89 - lat, (lon + 180) % 360] = 1  # from lat to lat + 1
            self.put_map(f"cell{case}", values)
            radiance = self.disc(request, earth_map=f"cell{case}")
            down, right = np.indices(radiance.shape)
            found = np.array([(radiance * right).sum(), (radiance * down).sum()]) / radiance.sum()
            # The map is linear between the centres of its texels: a tent around the cell's.
            at = np.linspace(-1, 1, 41)
            dlat, dlon = np.meshgrid(at, at, indexing="ij")
            for name, (rotation, most) in rotations.items():
                x, y, light = self.seen(rotation, lat + 0.5 + dlat, lon + 0.5 + dlon, bodies, axes)
                light = light * (1 - np.abs(dlat)) * (1 - np.abs(dlon))
                off = np.hypot(*(found - np.array([(light * x).sum(), (light * y).sum()]) / light.sum()))
                print(f"cell at {lat} N {lon % 360} E: {off:.4f} px from where {name} has it")
                self.assertLess(off, most)

    def test_the_whole_keeps_its_light(self):
        request = self.request()[0]
        request["camera"].update(width=256, height=256)
        lat, lon = np.meshgrid(np.linspace(89, -89, 90), np.linspace(-179, 179, 180), indexing="ij")
        self.put_map("stripes", 0.3 + 0.25 * np.sin(np.radians(3 * lon)) * np.cos(np.radians(2 * lat)))
        self.put_map("level", np.full((90, 180), 0.31))
        plain, level, stripes = (self.disc(request, **what) for what in
                                 ({}, {"earth_map": "level"}, {"earth_map": "stripes"}))
        np.testing.assert_allclose(level, plain, rtol=1e-5)
        self.assertAlmostEqual(stripes.sum() / plain.sum(), 1, delta=2e-3)
        bright = plain > 0.3 * plain.max()
        self.assertGreater((stripes[bright] / plain[bright]).max(), 1.5)
        self.assertLess((stripes[bright] / plain[bright]).min(), 0.5)
        self.put_map("black", np.zeros((90, 180)))
        for what, pointer in (({"earth_map": "black"}, "/sky/earth_map"), ({"earth_map": "none"}, "/sky/earth_map"),
                              ({"earth": False, "earth_map": "level"}, "/sky/earth_map")):
            answer = {k: v for k, v in request.items() if k != "utc"}
            status, _, body = service.frame({**answer, "sun": {"utc": self.UTC + "Z"}, "products": ["radiance"],
                                             "sky": {"earth": True, **what}})
            self.assertEqual((status, json.loads(body)["errors"][0]["pointer"]), (422, pointer), body)


@unittest.skipUnless(erfa, "needs python3-astropy")
class AgainstAstropy(unittest.TestCase):
    worst = {}

    def observer(self, epoch):
        """Position and velocity from the Earth's centre, m and m/s: ERFA's Moon and the camera's."""
        time = Time(epoch, scale="utc")
        moon = erfa.moon98(time.tt.jd1, time.tt.jd2)
        return time, moon["p"] * u.au.to(u.m) + POSITION_M, moon["v"] * (u.au / u.day).to(u.m / u.s) + VELOCITY_M_S

    def asked(self, epoch, **what):
        return {o["id"]: o for o in
                sky(utc=epoch + "Z", sky={"velocity_m_s": VELOCITY_M_S, "velocity_frame": "ICRF", **what})}

    def frame(self, epoch):
        time, place, motion = self.observer(epoch)
        return GCRS(obstime=time, obsgeoloc=CartesianRepresentation(place * u.m),
                    obsgeovel=CartesianRepresentation(motion * u.m / u.s))

    def test_a_thousand_stars_at_three_epochs(self):
        with open(path("assets", "stars", "thousand.csv"), encoding="ascii") as file:
            lines = [line.split(",") for line in file if line.startswith("T")]
        rows = {name: [float(x) for x in numbers] for name, *numbers in lines}
        worst = 0
        for epoch in EPOCHS:
            frame = self.frame(epoch)
            answers = self.asked(epoch, stars="thousand")
            self.assertGreater(len(answers), 990)
            for of_epoch in (1991.25, 2000.0, 2016.0):
                names = [n for n in answers if rows[n][2] == of_epoch]
                table = np.array([rows[n] for n in names])
                stars = SkyCoord(ra=table[:, 0] * u.deg, dec=table[:, 1] * u.deg,
                                 pm_ra_cosdec=table[:, 3] * u.mas / u.yr,
                                 pm_dec=table[:, 4] * u.mas / u.yr, distance=(1000 / table[:, 5]) * u.pc,
                                 obstime=Time(of_epoch, format="jyear", scale="tdb"), frame=ICRS)
                seen = stars.apply_space_motion(new_obstime=frame.obstime).transform_to(frame)
                for name, direction in zip(names, seen.cartesian.xyz.value.T):
                    worst = max(worst, arcsec(unit(direction), answers[name]["direction_icrf"]))
        print(f"stars: {worst:.6f} arcsec at most")
        self.assertLess(worst, 0.01)

    def test_sun_and_earth_are_where_astropy_has_them(self):
        """Its built-in ephemeris and its aberration; phases from its places. It bends the Earth's light as a star's."""
        worst, worst_deg = 0, 0
        for epoch in EPOCHS:
            frame = self.frame(epoch)
            answers = self.asked(epoch, sun=True, earth=True)
            with solar_system_ephemeris.set("builtin"):
                def at(body, seconds):
                    return get_body_barycentric(body, frame.obstime - seconds * u.s).xyz.to_value(u.m)
                here, ways = at("earth", 0) + frame.obsgeoloc.xyz.to_value(u.m), {}
                for name in ("sun", "earth"):
                    seconds = 0
                    for _ in range(4):
                        ways[name] = at(name, seconds) - here
                        seconds = np.linalg.norm(ways[name]) / 299792458.0
                    seen = ICRS(CartesianRepresentation((ways[name] + here) * u.m)).transform_to(frame)
                    worst = max(worst, arcsec(unit(seen.cartesian.xyz.value), answers[name]["direction_icrf"]))
            phase = math.degrees(math.acos(unit(ways["sun"] - ways["earth"]) @ unit(-ways["earth"])))
            worst_deg = max(worst_deg, abs(phase - answers["earth"]["phase_deg"]))
        print(f"Sun and Earth: {worst:.4f} arcsec, {worst_deg:.5f} degrees of phase at most")
        self.assertLess(worst, 0.1)
        self.assertLess(worst_deg, 0.1)

if __name__ == "__main__":
    harness.main()
