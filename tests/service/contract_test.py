#!/usr/bin/env python3
"""Checks the numbers of the frame contract as a client would: from the answers alone, with its own mathematics.

Nothing here knows how the service works. Expected values come from the text of the contract, from the files' own posts
and from published formulae (named where they are used). SELENOGRAPH_BINARY names the executable. Real terrain is read
from SELENOGRAPH_SHARED_DATA or, failing that, ../shared/data beside the repository; tests that need it skip without it.
"""

import json
import os
import re
import unittest

import numpy as np

import harness
from harness import setUpModule, shared_data, tearDownModule

RADIUS_M = 1737400.0
RUNNING = {}  # name -> Moon; started when first asked for


# --- the service under test ------------------------------------------------------------------------------------------


class Moon(harness.Service):
    def __init__(self, name, dem):
        super().__init__(options=["--port", "0", "--cache-dir", harness.path("cache-" + name), "--dem", *dem])

    def call(self, path, document):
        status, _, body = self.post(path, document)
        assert status == 200, (path, status, body[:600])
        return json.loads(body)

    def places(self, lat_deg, lon_deg):
        lat, lon = np.broadcast_arrays(np.asarray(lat_deg, float), np.asarray(lon_deg, float))
        points = [{"lat_deg": float(a), "lon_deg": float(o)} for a, o in zip(lat.ravel(), lon.ravel())]
        answers = []
        for k in range(0, len(points), 20000):
            answers += self.call("/v1/heights", {"points": points[k:k + 20000]})["points"]
        return answers

    def heights(self, lat_deg, lon_deg):
        return np.array([np.nan if p["height_m"] is None else p["height_m"] for p in self.places(lat_deg, lon_deg)])

    def rays(self, origins, directions, **more):
        rays = [{"origin_m": list(map(float, o)), "direction": list(map(float, d))} for o, d in zip(origins, directions)]
        return self.call("/v1/rays", {"rays": rays, **more})["rays"]


def shared(*parts):
    folder = shared_data(parts[0])
    if not folder:
        raise unittest.SkipTest(f"no {parts[0]}: set SELENOGRAPH_SHARED_DATA")
    return os.path.join(folder, *parts[1:])


def service(name):
    if name not in RUNNING:
        if name == "sample":
            dem = [harness.sample("sample", *harness.PLACE, "--ppd", "256")]
        elif name == "layers":
            dem = [shared("global"), shared("hadley")]
        elif name == "void":
            dem = [harness.path("void")]
        else:
            dem = [shared(name)]
        RUNNING[name] = Moon(name, dem)
    return RUNNING[name]


# --- the client's own mathematics ------------------------------------------------------------------------------------


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def up_at(lat_deg, lon_deg):
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat) + 0 * lon], -1)


def place(lat_deg, lon_deg, height_m):
    return up_at(lat_deg, lon_deg) * (RADIUS_M + np.asarray(height_m))[..., None]


def matrix(q):
    """v' = q v q*, Hamilton's product."""
    w, x, y, z = (q[k] for k in "wxyz")
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def distort(x, y, k1=0, k2=0, k3=0, k4=0, k5=0, k6=0, p1=0, p2=0, s1=0, s2=0, s3=0, s4=0, tau_x_deg=0, tau_y_deg=0):
    """OpenCV's documentation of projectPoints."""
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s1 * r2 + s2 * r2**2
    yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + s3 * r2 + s4 * r2**2
    (ax, sx), (ay, sy) = ((np.cos(t), np.sin(t)) for t in np.radians([tau_x_deg, tau_y_deg]))
    turn = np.array([[ay, 0, -sy], [0, 1, 0], [sy, 0, ay]]) @ np.array([[1, 0, 0], [0, ax, sx], [0, -sx, ax]])
    tilt = np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1]]) @ turn
    x, y, z = np.moveaxis(np.stack([xd, yd, np.ones_like(xd)], -1) @ tilt.T, -1, 0)
    return x / z, y / z


def cahvor_pixels(x, y, A, H, V, O, R, linearity=1):
    """Gennery (2006), for the directions (x, y, 1)."""
    p = np.stack([x, y, np.ones_like(x)], -1)
    zeta = p @ O
    across = p - zeta[..., None] * O
    size = np.linalg.norm(across, axis=-1)
    theta = np.arctan2(size, zeta)
    chi = np.tan(linearity * theta) / linearity if linearity > 0 else np.sin(linearity * theta) / linearity if linearity else theta
    bent = (size / chi)[..., None] * np.asarray(O) + (1 + R[0] + R[1] * chi**2 + R[2] * chi**4)[..., None] * across
    return bent @ H / (bent @ A), bent @ V / (bent @ A)


def inverted(function, u, v, x, y):
    """Newton's method with slopes by differences, from (x, y)."""
    h = 1e-6
    for _ in range(30):
        (a, b), (ae, be), (an, bn) = function(x, y), function(x + h, y), function(x, y + h)
        ax, bx, ay, by = (ae - a) / h, (be - b) / h, (an - a) / h, (bn - b) / h
        det = ax * by - ay * bx
        x, y = x - (by * (a - u) - ay * (b - v)) / det, y - (ax * (b - v) - bx * (a - u)) / det
    return x, y


def pixel_rays(camera):
    """Camera-axes direction with z = 1 through the centre of each pixel."""
    u, v = np.meshgrid(np.arange(camera["width"], dtype=float), np.arange(camera["height"], dtype=float))
    k = {name: value for name, value in camera.get("distortion", {}).items() if name != "model"}
    if "cahvor" in camera:
        c = camera["cahvor"]
        x, y = inverted(lambda x, y: cahvor_pixels(x, y, **c), u, v, (u - c["H"][2]) / c["H"][0], (v - c["V"][2]) / c["V"][1])
    else:
        xd, yd = (u - camera["cx"]) / camera["fx"], (v - camera["cy"]) / camera["fy"]
        x, y = inverted(lambda x, y: distort(x, y, **k), xd, yd, xd, yd)
    return np.stack([x, y, np.ones_like(x)], -1)


# --- requests --------------------------------------------------------------------------------------------------------

LAT, LON = 0.05, 30.02  # the middle of the sample terrain
SUN = {"local": {"lat_deg": LAT, "lon_deg": LON, "azimuth_deg": 80.0, "elevation_deg": 20.0}}
DISTORTION = {"model": "brown_conrady", "k1": -0.21, "k2": 0.06, "k3": -0.011, "p1": 0.0031, "p2": -0.0024}
OPENCV = {"model": "opencv", "k1": 0.7, "k2": 0.1, "k3": 0.01, "k4": 0.95, "k5": 0.25, "k6": 0.02, "p1": 0.0031, "p2": -0.0024,
          "s1": 0.004, "s2": -0.001, "s3": -0.003, "s4": 0.002, "tau_x_deg": 3.0, "tau_y_deg": -5.0}
CAHVOR = {"A": unit(np.array([0.02, -0.01, 1])).tolist(), "H": [45.0, 0.2, 22.0], "V": [-0.3, 47.0, 21.5],
          "O": unit(np.array([-0.01, 0.015, 1])).tolist(), "R": [0.003, -0.05, 0.01]}
CAHVORE = dict(CAHVOR, H=[32.0, 0.2, 22.0], V=[-0.3, 33.0, 21.5], R=[0.003, -0.02, 0.004], linearity=0.2)


def request(products=("position",), lat=LAT, lon=LON, height=15000.0, width=64, rows=48, fov=50.0, **changes):
    document = {"camera": {"width": width, "height": rows, "fov_deg": fov},
                "pose": {"geodetic": {"lat_deg": lat, "lon_deg": lon, "height_m": height}, "nadir": {}},
                "sun": SUN, "products": list(products)}
    document.update(changes)
    return document


class Test(unittest.TestCase):
    def close(self, got, wanted, tolerance, message=""):
        worst = np.max(np.abs(np.asarray(got, float) - np.asarray(wanted, float)))
        self.assertLessEqual(worst, tolerance, message)  # NaN fails, too


# --- the camera ------------------------------------------------------------------------------------------------------


class Camera(Test):
    def check_rays(self, camera, pose=None, **changes):
        document = request(["position", "depth", "range", "geodetic"], camera=camera, **changes)
        if pose:
            document["pose"] = pose
        f = service("sample").arrays(document)
        got = f["meta"]["request"]
        resolved = dict(camera, **{k: got["camera"][k] for k in ("fx", "fy", "cx", "cy") if k in got["camera"]})
        origin, axes = np.array(got["pose"]["position_m"]), matrix(got["pose"]["camera_from_moon"])
        rays = pixel_rays(resolved)
        hit = np.isfinite(f["depth"])
        self.assertGreater(hit.mean(), 0.99)
        expected = origin + f["depth"][..., None] * (rays @ axes)  # rows of axes are the camera's axes in MOON_ME
        self.close(f["position"][hit], expected[hit], 1e-4, "positions are not on the rays of their pixels")
        self.close(f["range"][hit], np.linalg.norm(f["position"] - origin, axis=-1)[hit], 1e-6, "range is not Euclidean")
        p, g = f["position"][hit], f["geodetic"][hit]
        self.close(g[:, 2], np.linalg.norm(p, axis=-1) - RADIUS_M, 1e-6)
        self.close(place(g[:, 0], g[:, 1], g[:, 2]), p, 1e-5, "geodetic and position differ")
        return f

    def test_every_pixel_of_a_pinhole(self):
        self.check_rays({"width": 61, "height": 40, "fx": 70.0, "fy": 65.0, "cx": 25.25, "cy": 24.5})

    def test_every_pixel_of_opencv_s_terms(self):
        camera = {"width": 60, "height": 44, "fx": 55.0, "fy": 56.0, "cx": 28.0, "cy": 23.0, "distortion": OPENCV}
        self.check_rays(camera)

    def test_every_pixel_of_cahvor_s_vectors(self):
        for vectors in (CAHVOR, CAHVORE):
            for visibility in ("raytrace", "zbuffer"):
                self.check_rays({"width": 48, "height": 40, "cahvor": vectors}, visibility=visibility)

    def test_every_pixel_of_an_oblique_view(self):
        pose = {"geodetic": {"lat_deg": LAT - 0.3, "lon_deg": LON - 0.2, "height_m": 9000.0},
                "look_at": {"lat_deg": LAT, "lon_deg": LON, "height_m": 0.0}}
        camera = {"width": 40, "height": 30, "fov_deg": 25.0, "distortion": dict(DISTORTION, k1=0.1)}
        self.check_rays(camera, pose)

    def test_one_pixel_and_one_column(self):
        f = service("sample").arrays(request(["position"], width=1, rows=1))
        self.close(unit(f["position"][0, 0]), up_at(LAT, LON), 1e-9, "the only pixel of a nadir camera looks at the nadir")
        self.check_rays({"width": 1, "height": 40, "fx": 40.0, "fy": 40.0, "cx": 0.0, "cy": 19.5})


# --- radiance, angles, lit -------------------------------------------------------------------------------------------


class Radiance(Test):
    PRODUCTS = ["radiance", "normal", "angles", "lit", "position", "image"]

    def check(self, name, document, reflectance, sun=None):
        f = service(name).arrays(document)
        meta = f["meta"]
        s = unit(np.array(meta["request"]["sun"]["direction"])) if sun is None else sun
        hit = np.isfinite(f["lit"])
        n, p = f["normal"][hit].astype(float), f["position"][hit]
        v = unit(np.array(meta["request"]["pose"]["position_m"]) - p)
        mu0, mu = n @ s, np.sum(n * v, -1)
        lit, radiance = f["lit"][hit].astype(float), f["radiance"][hit].astype(float)
        e_sun = meta["solar_irradiance"]["value_w_m2"]
        self.close(np.linalg.norm(n, axis=-1), 1, 1e-6, "normals are not of length one")
        self.assertGreater(np.sum(n * unit(p), -1).min(), 0, "normals point inwards")
        self.assertTrue(np.all((lit == 0) | (lit == 1)), "a point Sun leaves no half shadow")
        self.assertTrue(np.all(lit[mu0 < -1e-6] == 0), "lit where the Sun is below the surface")
        facing = mu > 1e-3  # the shading normal of a surface seen from its edge may face away
        expected = np.where(mu0 > 0, e_sun * mu0 * reflectance(mu0, mu) * lit, 0)
        self.close(radiance[facing], expected[facing], 1e-5 * e_sun, "radiance is not E_sun mu0 f_r lit")
        self.assertTrue(np.all(np.isfinite(radiance)) and radiance.min() >= 0)
        a = f["angles"][hit].astype(float)
        self.close(np.cos(np.radians(a[:, 0])), mu0, 3e-6, "incidence")
        self.close(np.cos(np.radians(a[:, 1])), mu, 3e-6, "emission")
        self.close(np.cos(np.radians(a[:, 2])), v @ s, 3e-6, "phase")
        self.assertGreater(lit.mean(), 0.02)
        return f

    def test_the_three_reflectances(self):
        lambert = lambda mu0, mu: 0.2 / np.pi
        seeliger = lambda mu0, mu: 0.2 / (2 * np.pi) / (mu0 + mu)
        models = [({"model": "lambert", "rho": 0.2}, lambert), ({"model": "lommel_seeliger", "rho": 0.2}, seeliger)]
        for w in (0.0, 0.35, 1.0):
            models.append(({"model": "lunar", "lommel_seeliger_weight": w, "rho": 0.2},
                           lambda mu0, mu, w=w: w * seeliger(mu0, mu) + (1 - w) * lambert(mu0, mu)))
        for reflectance, f_r in models:
            with self.subTest(reflectance):
                f = self.check("sample", request(self.PRODUCTS, surface={"reflectance": reflectance}), f_r)
                self.assertEqual(f["meta"]["request"]["surface"]["reflectance"]["rho"], 0.2)
                self.assertIn("rho", f["meta"]["reflectance"]["normalisation"])

    def test_distance_scales_irradiance(self):
        at_one = service("sample").arrays(request(["radiance"]))
        self.assertAlmostEqual(at_one["meta"]["solar_irradiance"]["value_w_m2"], 1361, delta=10)
        for au in (0.5, 1.0167, 2.0):
            far = service("sample").arrays(request(["radiance"], sun=dict(SUN, distance_au=au)))
            self.close(far["radiance"] * au**2, at_one["radiance"], 1e-4)
            self.assertAlmostEqual(far["meta"]["solar_irradiance"]["value_w_m2"] * au**2,
                                   at_one["meta"]["solar_irradiance"]["value_w_m2"], places=6)


# --- rays and landmarks ----------------------------------------------------------------------------------------------


class Geometry(Test):
    def test_projection_of_every_pixel_s_position(self):
        size, focal = {"width": 48, "height": 40}, {"fx": 45.0, "fy": 47.0, "cx": 22.0, "cy": 21.5}
        for camera in ({**size, **focal, "distortion": {"model": "brown_conrady"}}, {**size, **focal, "distortion": DISTORTION},
                       {**size, **focal, "distortion": OPENCV}, {**size, "cahvor": CAHVOR}, {**size, "cahvor": CAHVORE}):
            document = request(["geodetic", "range", "lit"], camera=camera, accuracy={"max_error_px": 0})
            f = service("sample").arrays(document)
            g = f["geodetic"].reshape(-1, 3)
            self.assertFalse(np.isnan(g).any())
            points = [{"lat_deg": a, "lon_deg": o, "height_m": h} for a, o, h in g.tolist()]
            answers = service("sample").call("/v1/project", {"camera": camera, "pose": document["pose"], "sun": SUN,
                                                             "points": points})["points"]
            v, u = np.mgrid[0:40, 0:48]
            got = np.array([[p["x_px"], p["y_px"]] for p in answers])
            self.close(got, np.stack([u.ravel(), v.ravel()], -1), 1e-6)
            self.close([p["range_m"] for p in answers], f["range"].ravel(), 1e-5)
            self.assertTrue(all(p["in_frame"] for p in answers))
            self.assertEqual([k for k, p in enumerate(answers) if not p["visible"]], [], "a pixel's own point is hidden")
            wrong = np.sum(np.array([p["lit"] for p in answers]) != f["lit"].ravel())
            self.assertLessEqual(wrong, 2, "lit differs from the frame's")

    def test_flow_through_calibrated_lenses(self):
        size = {"width": 40, "height": 32}
        moved = {"geodetic": {"lat_deg": LAT + 0.02, "lon_deg": LON - 0.01, "height_m": 14000.0}, "nadir": {"up_azimuth_deg": 7.0}}
        for camera in ({**size, "fx": 45.0, "fy": 47.0, "cx": 20.0, "cy": 15.5, "distortion": OPENCV},
                       {**size, "cahvor": dict(CAHVOR, H=[45.0, 0.2, 20.0], V=[-0.3, 47.0, 15.5])}):
            f = service("sample").arrays(request(["position", "flow"], camera=camera, flow_to=moved))
            there = service("sample").arrays(request(["depth"], camera=camera, pose=moved))["meta"]["request"]["pose"]
            p = (f["position"] - there["position_m"]) @ matrix(there["camera_from_moon"]).T
            x, y = p[..., 0] / p[..., 2], p[..., 1] / p[..., 2]
            if "cahvor" in camera:
                u, v = cahvor_pixels(x, y, **camera["cahvor"])
            else:
                x, y = distort(x, y, **{name: k for name, k in OPENCV.items() if name != "model"})
                u, v = camera["fx"] * x + camera["cx"], camera["fy"] * y + camera["cy"]
            seen = np.isfinite(f["flow"][..., 0])
            self.assertGreater(seen.mean(), 0.9)
            rows, columns = np.mgrid[0:32, 0:40]
            self.close(f["flow"][seen], np.stack([u - columns, v - rows], -1)[seen], 1e-6)

    def test_edges_of_the_frame(self):
        """Pixel centres are integers, so that the frame reaches half a pixel beyond the outermost centres."""
        document = request(["geodetic"], width=9, rows=7, fov=30.0, accuracy={"max_error_px": 0})
        lat, lon, height = service("sample").arrays(document)["geodetic"][0, 8]  # top right
        focal = 4.5 / np.tan(np.radians(15))
        for dx, dy, inside in ((0.49, 0, True), (0.51, 0, False), (0, -0.49, True), (0, -0.51, False)):
            camera = {"width": 9, "height": 7, "fx": focal, "fy": focal, "cx": 4 + dx, "cy": 3 + dy}
            p = service("sample").call("/v1/project", {
                "camera": camera, "pose": document["pose"],
                "points": [{"lat_deg": lat, "lon_deg": lon, "height_m": height}]})["points"][0]
            self.close([p["x_px"], p["y_px"]], [8 + dx, dy], 1e-6)
            self.assertEqual((p["in_frame"], p["visible"]), (inside, inside), (dx, dy))
            self.assertNotIn("lit", p)

    def test_hidden_points(self):
        ground = service("sample").heights(LAT, LON)[0]
        camera, pose = request()["camera"], request()["pose"]
        points = [(LAT, LON, None), (LAT, LON, ground + 300), (LAT, LON, ground - 5), (-LAT, LON - 180, 0.0), (LAT, LON, 16000.0),
                  (LAT, LON + 90, 0.0)]
        documents = [{"lat_deg": a, "lon_deg": o, **({} if h is None else {"height_m": h})} for a, o, h in points]
        on, above, below, far_side, behind, aside = service("sample").call(
            "/v1/project", {"camera": camera, "pose": pose, "points": documents})["points"]
        self.close(on["height_m"], ground, 1e-6)
        self.close([on["x_px"], on["y_px"]], [31.5, 23.5], 1e-6)
        self.assertEqual([p["visible"] for p in (on, above, below, far_side, behind, aside)],
                         [True, True, False, False, False, False])
        self.assertEqual([p["in_frame"] for p in (on, above, below, far_side)], [True] * 4, "in_frame says nothing of terrain")
        self.assertEqual([behind["in_frame"], aside["in_frame"]], [False, False])
        self.assertEqual([behind["x_px"], behind["y_px"]], [None, None])
        self.close(far_side["range_m"], 2 * RADIUS_M + 15000, 1e-3)

    def test_an_altimeter_reads_the_height(self):
        rng = np.random.default_rng(5)
        lat, lon = rng.uniform(-0.6, 0.6, 400), rng.uniform(29.4, 30.6, 400)
        up = up_at(lat, lon)
        rays = service("sample").rays(up * (RADIUS_M + 20000), -up)
        self.close([20000 - r["range_m"] for r in rays], service("sample").heights(lat, lon), 1e-3)

    def test_positions_lie_on_the_terrain(self):
        """At max_error_px 0 within 1 cm; otherwise within the bound that the frame states."""
        for error in (0, 0.5, 4):
            f = service("sample").arrays(request(["geodetic"], height=60000.0, fov=40.0, accuracy={"max_error_px": error}))
            g = f["geodetic"][np.isfinite(f["geodetic"][..., 0])]
            self.assertGreater(len(g), 0, f"max_error_px {error}: nothing is seen of the terrain below")
            bound = 0.01 if error == 0 else f["meta"]["lod_error_m"] + 0.01
            self.close(g[:, 2], service("sample").heights(g[:, 0], g[:, 1]), bound, f"max_error_px {error}")
            self.assertLessEqual(f["meta"]["lod_error_px"], error + 1e-3)  # at 0 the rounding of stored heights is left


# --- misses and metadata ---------------------------------------------------------------------------------------------


class MissesAndMetadata(Test):
    @classmethod
    def setUpClass(cls):
        cls.document = request(harness.PRODUCTS, width=24, rows=18, accuracy={"max_error_px": 0}, pose={
            "geodetic": {"lat_deg": LAT, "lon_deg": LON, "height_m": 8000.0},
            "look_at": {"lat_deg": LAT, "lon_deg": LON + 4.0, "height_m": 6000.0}})  # half of it sky
        cls.frame = service("sample").arrays(cls.document)

    def test_where_nothing_is_hit(self):
        miss = np.isnan(self.frame["depth"])
        self.assertTrue(0.05 < miss.mean() < 0.95, miss.mean())
        for name in ("range", "position", "geodetic", "normal", "angles", "lit", "gsd"):
            self.assertTrue(np.all(np.isnan(self.frame[name][miss])), name)
            self.assertFalse(np.any(np.isnan(self.frame[name][~miss])), name)
        self.assertTrue(np.all(self.frame["radiance"][miss] == 0) and np.all(self.frame["image"][miss] == 0))
        self.assertTrue(np.all(self.frame["source"][miss] == 65535) and np.all(self.frame["source"][~miss] < 65535))
        self.assertAlmostEqual(self.frame["meta"]["hit_fraction"], 1 - miss.mean(), places=6)

    def test_metadata(self):
        meta = self.frame["meta"]
        resolved = meta["request"]
        self.assertEqual(resolved["pose"]["frame"], "MOON_ME")
        self.assertEqual(set(resolved["camera"]) >= {"width", "height", "fx", "fy", "cx", "cy"}, True)
        self.close(np.linalg.norm(resolved["sun"]["direction"]), 1, 1e-12)
        self.assertEqual(resolved["surface"]["reflectance"], {"model": "lunar", "lommel_seeliger_weight": 1.0, "rho": 0.12})
        self.assertGreater(len(meta["sources"]), 0)
        for source in meta["sources"]:
            self.assertTrue(source["name"].startswith("DTM_MAP") and source["version"])
        self.assertLess(self.frame["source"][self.frame["source"] < 65535].max(), len(meta["sources"]))
        self.assertLessEqual(meta["lod_error_px"], resolved["accuracy"]["max_error_px"] + 1e-3)
        self.assertGreaterEqual(meta["lod_error_m"], 0)
        self.assertTrue(meta["software"]["version"])
        for share in ("filled_fraction", "missing_fraction"):
            self.assertTrue(0 <= meta[share] <= 1)
        self.assertEqual(self.frame["headers"]["ETag"], '"%s"' % meta["content_hash"])


# --- errors ----------------------------------------------------------------------------------------------------------


class Errors(Test):
    def test_a_camera_just_below_and_just_above_the_terrain(self):
        rng = np.random.default_rng(11)
        lat, lon = rng.uniform(-0.6, 0.6, 12), rng.uniform(29.4, 30.6, 12)
        for a, o, h in zip(lat, lon, service("sample").heights(lat, lon)):
            status, _, body = service("sample").frame(request(["range"], lat=a, lon=o, height=float(h) - 1))
            self.assertEqual((status, [e["pointer"] for e in json.loads(body)["errors"]]), (422, ["/pose"]))
            f = service("sample").arrays(request(["range"], lat=a, lon=o, height=float(h) + 1, width=1, rows=1))
            self.close(f["range"], 1, 0.5)
        for position in ([0.0, 0.0, 0.0], [5e-324, 0.0, 0.0], [1000.0, 0.0, 0.0], [0.0, 0.0, 1700000.0]):
            status, _, body = service("sample").frame(request(["range"], pose={"position_m": position, "nadir": {}}))
            self.assertEqual(status, 422, body[:300])

# --- terrain ---------------------------------------------------------------------------------------------------------


class SampleTerrain(Test):
    def test_single_and_batch_agree(self):
        status, _, body = service("sample").ask("GET", f"/v1/height?lat_deg={LAT}&lon_deg={LON}")
        self.assertEqual((status, json.loads(body)), (200, service("sample").places(LAT, LON)[0]))
        nowhere = service("sample").places(50.0, 200.0)[0]
        self.assertEqual((nowhere["lon_deg"], nowhere["height_m"]), (-160.0, None))
        self.assertTrue(nowhere["reason"])


class Hadley(Test):
    def test_error_bound_near_the_ground(self):
        """Near the ground the finest posts are all there is: the bound must say so, not be a division by nothing."""
        for height in (5000.0, 0.0, -1500.0, -1800.0):
            f = service("hadley").arrays(request(["range", "gsd"], lat=26.1, lon=3.5, height=height, width=64, rows=64))
            self.assertLessEqual(f["meta"]["lod_error_px"], 0.5, f"at {height} m, lod_error_m {f['meta']['lod_error_m']}")


class Void(Test):
    """A void too large to fill: null and a reason, in a tile made here."""

    @classmethod
    def setUpClass(cls):
        with open(shared("labels", "variants", "A_neg_bytes.lbl"), newline="") as file:
            label = file.read()
        folder = harness.path("void")
        os.makedirs(folder, exist_ok=True)
        rng = np.random.default_rng(4)
        cls.posts = rng.integers(-300, 300, (768, 768))
        cls.posts[300:420, 300:420] = -9999
        cls.posts[100:103, 100:103] = -9999
        name = "DTM_MAPs02_N12E030N09E033SC"
        values = {"LINE_LAST_PIXEL": 768, "SAMPLE_LAST_PIXEL": 768, "LINES": 768, "LINE_SAMPLES": 768,
                  "MAP_RESOLUTION": "256 <pixel/deg>", "MAP_SCALE": f"{np.pi * 1737.4 / 180 / 256} <km/pixel>",
                  "MAXIMUM_LATITUDE": "12 <deg>", "MINIMUM_LATITUDE": f"{12 - 767 / 256} <deg>",
                  "WESTERNMOST_LONGITUDE": "30 <deg>", "EASTERNMOST_LONGITUDE": f"{30 + 767 / 256} <deg>",
                  "LINE_PROJECTION_OFFSET": f"{12 * 256} <pixel>", "SAMPLE_PROJECTION_OFFSET": f"{-30 * 256} <pixel>"}
        for key, value in values.items():
            label = re.sub(r"(?m)^(\s*%s\s*=\s*)[^\r\n]*" % key, lambda m, v=value: m[1] + str(v), label)
        with open(os.path.join(folder, name + ".lbl"), "w", newline="") as file:
            file.write(label.replace("A_neg_bytes", name))
        cls.posts.astype(">i2").tofile(os.path.join(folder, name + ".img"))

    def at(self, row, column):
        return service("void").places(12 - row / 256, 30 + column / 256)[0]

    def test_a_void_is_no_larger_in_frames_than_in_the_file(self):
        for height, fov in ((60000.0, 60.0), (300000.0, 30.0)):
            lat, lon = 12 - 360 / 256, 30 + 360 / 256
            document = request(["position"], lat=lat, lon=lon, height=height, width=150, rows=150, fov=fov)
            f = service("void").arrays(document)
            got = f["meta"]["request"]
            origin = np.array(got["pose"]["position_m"])
            rays = unit(pixel_rays(got["camera"]) @ matrix(got["pose"]["camera_from_moon"]))
            along = rays @ origin
            on_sphere = origin + (-along - np.sqrt(along**2 - origin @ origin + RADIUS_M**2))[..., None] * rays
            row = (12 - np.degrees(np.arcsin(on_sphere[..., 2] / RADIUS_M))) * 256
            column = (np.degrees(np.arctan2(on_sphere[..., 1], on_sphere[..., 0])) - 30) * 256
            hit = np.isfinite(f["position"][..., 0])
            out = np.maximum(np.maximum(299 - row, row - 420), np.maximum(299 - column, column - 420))  # posts beyond the void
            edge = np.minimum(np.minimum(row, 767 - row), np.minimum(column, 767 - column))  # posts inside of the tile
            slack = 6 + 2 * f["meta"]["post_spacing_m"]["max"] / 118.45
            self.assertFalse(np.any(hit[(out < -slack) | (edge < -slack)]), "hits where there is no data")
            seen = hit[(out > slack) & (edge > slack)]
            self.assertTrue(np.all(seen), f"from {height} m {100 * np.mean(~seen):.0f} % of the pixels on valid posts see nothing")

    def test_frames_over_both(self):
        products = ["position", "source", "lit"]
        sun = {"subsolar": {"lat_deg": 0.0, "lon_deg": 60.0}}
        f = service("void").arrays(request(products, lat=12 - 360 / 256, lon=30 + 360 / 256, height=10000.0, fov=30.0, sun=sun))
        self.assertEqual((f["meta"]["missing_fraction"], f["meta"]["hit_fraction"]), (1.0, 0.0))
        self.assertEqual(f["headers"]["Selenograph-Missing-Fraction"], "1")
        self.assertTrue(np.all(f["source"] == 65535))
        f = service("void").arrays(request(products, lat=12 - 101 / 256, lon=30 + 101 / 256, height=10000.0, fov=30.0, sun=sun))
        self.assertEqual(f["meta"]["hit_fraction"], 1.0)
        self.assertNotIn("Selenograph-Missing-Fraction", f["headers"])
        self.assertGreater(f["meta"]["filled_fraction"], 0.001)


class Layers(Test):
    """GLD100 of the whole Moon with Hadley's tiles in it."""

    def test_no_hole_along_the_seam(self):
        for lat, lon, height in ((18.0, 6.0, 30000.0), (24.0, 12.0, 30000.0), (30.0, 0.0, 30000.0), (18.0, 12.0, 150000.0),
                                 (24.0, 0.0, 8000.0)):
            f = service("layers").arrays(request(["geodetic", "source"], lat=lat, lon=lon, height=height, width=160, rows=160))
            self.assertEqual(np.isnan(f["geodetic"]).sum(), 0, (lat, lon, height))
            names = [s["name"] for s in f["meta"]["sources"]]
            fine = np.array([n.startswith("DTM_MAPs02") for n in names])[f["source"]]
            g = f["geodetic"]
            within = (g[..., 0] > 18.02) & (g[..., 0] < 29.99) & (g[..., 1] > 0.01) & (g[..., 1] < 11.98)
            beyond = (g[..., 0] < 17.9) | (g[..., 0] > 30.1) | (g[..., 1] < -0.1) | (g[..., 1] > 12.1)
            self.assertTrue(np.all(fine[within]), f"{np.mean(fine[within])} of the pixels on Hadley's tiles name them")
            self.assertFalse(np.any(fine[beyond]), "Hadley's tiles named beyond their edge")

    def test_the_whole_moon_in_view(self):
        height, size, fov = 4e8, 256, 0.6
        f = service("layers").arrays({"camera": {"width": size, "height": size, "fov_deg": fov}, "products": ["position", "lit", "geodetic"],
                                     "pose": {"geodetic": {"lat_deg": 10.0, "lon_deg": 0.0, "height_m": height}, "nadir": {}},
                                     "sun": {"subsolar": {"lat_deg": 0.0, "lon_deg": -80.0}}})
        got = f["meta"]["request"]
        origin = np.array(got["pose"]["position_m"])
        rays = unit(pixel_rays(got["camera"]) @ matrix(got["pose"]["camera_from_moon"]))
        nearest = np.linalg.norm(np.cross(origin, rays), axis=-1)  # each ray's distance from the Moon's centre
        hit = np.isfinite(f["lit"])
        self.assertTrue(np.all(hit[nearest < RADIUS_M - 9200]), "holes in the disc")
        self.assertFalse(np.any(hit[nearest > RADIUS_M + 11000]), "hits beside the disc")
        g = f["geodetic"][hit]
        self.assertTrue(-9200 < g[:, 2].min() and g[:, 2].max() < 10800)
        lit, lon = f["lit"][hit], g[:, 1]
        self.assertGreater(lit[(lon < -20) & (np.abs(g[:, 0]) < 60)].mean(), 0.97)  # the terminator is at 10 E
        self.assertEqual(lit[(lon > 30) & (np.abs(g[:, 0]) < 60)].sum(), 0)
        self.assertLessEqual(f["meta"]["lod_error_px"], 0.5)


if __name__ == "__main__":
    harness.main()
