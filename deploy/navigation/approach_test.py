#!/usr/bin/env python3
"""deploy/navigation/approach: limb fit, edges, star attitude and filter against closed forms, and a short flight.

Skips where OpenCV or SciPy are missing (deploy/install-packages navigation); the flight also where the shared data's
DEM of the whole Moon is.
"""

import os
import sys
import unittest
import warnings

import harness

NAVIGATION = os.path.join(harness.REPOSITORY, "deploy", "navigation")
sys.path[:0] = [NAVIGATION, os.path.join(harness.REPOSITORY, "api", "clients", "python")]

try:
    import cv2
    import numpy as np
    from approach import cruise, flight, horizon, stars
    from lander.camera import Camera
    from selenograph import Client, FrameWarning
    MISSING = None
except ImportError as error:
    MISSING = f"{error}: deploy/install-packages navigation"


def setUpModule():
    if MISSING:
        raise unittest.SkipTest(MISSING)
    harness.set_up()


def tearDownModule():
    harness.tear_down()


AZIMUTHS = 2 * np.pi * np.arange(180) / 180 if not MISSING else None
MOON = np.array([3e5, -2e5, 2e7]) if not MISSING else None


class HorizonTest(unittest.TestCase):
    def test_a_spheres_limb_leads_to_its_centre(self):
        for around in (MOON, MOON + [4e4, 3e4, -5e5]):
            angles = horizon.angles_of(MOON, around, AZIMUTHS)
            part = slice(20, 90)  # a lit half
            found, _ = horizon.fit(around, AZIMUTHS[part], angles[part], 1e-6)
            np.testing.assert_allclose(found, MOON, atol=1.0)

    def test_angles_around_the_centre_are_those_of_a_cone(self):
        np.testing.assert_allclose(horizon.angles_of(MOON, MOON, AZIMUTHS),
                                   np.arcsin(horizon.RADIUS_M / np.linalg.norm(MOON)), rtol=1e-12)

    def test_the_covariance_is_that_of_many_fits(self):
        random, sigma, part = np.random.default_rng(2), 1e-5, slice(20, 90)
        angles = horizon.angles_of(MOON, MOON, AZIMUTHS)[part]
        fits = np.array([horizon.fit(MOON, AZIMUTHS[part], angles + sigma * random.standard_normal(len(angles)),
                                     sigma)[0] for _ in range(2000)])
        _, covariance = horizon.fit(MOON, AZIMUTHS[part], angles, sigma)
        np.testing.assert_allclose(np.cov(fits.T), covariance, rtol=0.15, atol=0.05 * np.max(np.abs(covariance)))

    def off_px(self, law, blur_px):
        """How far edges are found outside of a half-lit disc's limb, in an image whose pixels are means over 5 x 5
        samples of a sphere by a law of mu0 and mu."""
        camera, samples = Camera.of(512, 16.0), 5
        moon, sun = np.array([1e5, 5e4, 2e7]), np.array([0.8, 0.3, -0.52])
        sun = sun / np.linalg.norm(sun)
        at = (np.arange(camera.side * samples) + 0.5) / samples - 0.5
        x, y = np.meshgrid(at, at)
        rays = camera.rays(x, y)
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        along = rays @ moon
        beneath = along**2 - moon @ moon + horizon.RADIUS_M**2
        normal = (rays * (along - np.sqrt(np.maximum(beneath, 0)))[..., None] - moon) / horizon.RADIUS_M
        light = np.where(beneath > 0, law(np.maximum(normal @ sun, 0), -np.sum(normal * rays, -1)), 0)
        if blur_px > 0:
            light = cv2.GaussianBlur(light, (0, 0), blur_px * samples)
        image = light.reshape(camera.side, samples, camera.side, samples).mean((1, 3)).astype(np.float32)
        around = moon + [2e4, -1e4, 0]
        edges = horizon.edges(image, camera, around, sun, AZIMUTHS)
        use = np.isfinite(edges)
        self.assertGreater(use.sum(), 60)
        return camera.focal * (edges - horizon.angles_of(moon, around, AZIMUTHS))[use]

    def test_edges_of_a_disc_half_lit(self):
        def lambert(mu0, _):
            return mu0

        def lommel_seeliger(mu0, mu):
            return mu0 / np.maximum(mu0 + mu, 1e-9)

        for law, blur_px, most in ((lambert, 0, 0.02), (lambert, 1.0, 0.02), (lommel_seeliger, 0.6, 0.045),
                                   (lommel_seeliger, 1.0, 0.045)):
            off_px = self.off_px(law, blur_px)
            print(f"{law.__name__}, blurred by {blur_px} px: {np.mean(off_px):.4f} px, RMS {np.std(off_px):.3f}")
            self.assertLess(np.sqrt(np.mean(off_px**2)), 0.1)
            self.assertLess(abs(np.mean(off_px)), most)


class StarsTest(unittest.TestCase):
    TURN_DEG = (0.004, -0.003, 0.01)  # within a pixel or two

    def star_field(self, count, seed=5):
        """An image by a camera that is turned from where it is believed to be, the camera, what /v1/sky lists, and the
        turn."""
        camera, random = Camera.of(512, 20.0), np.random.default_rng(seed)
        places = random.uniform(30, 480, (count, 2))
        directions = camera.rays(*places.T)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        turn = flight.rotation(np.radians(self.TURN_DEG))
        seen = directions @ turn.T
        x, y = np.meshgrid(np.arange(512.0), np.arange(512.0))
        image = random.normal(100, 2, (512, 512))
        for px, py in camera.pixels(seen):
            image += 3000 * np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * 0.8**2))
        listed = [{"x_px": px, "y_px": py, "direction_icrf": d} for (px, py), d in zip(places, directions)]
        return image, camera, listed, turn

    def test_centroids_and_the_rotation_they_say(self):
        image, camera, listed, turn = self.star_field(12)
        found, used = stars.solved(image, camera, listed, np.eye(3))
        self.assertEqual(used, 12)
        self.assertLess(np.degrees(np.linalg.norm(found - turn)) * 3600, 15)  # a twentieth of a pixel is 7
        self.assertGreater(np.degrees(np.linalg.norm(np.eye(3) - turn)) * 3600, 40)

    def test_what_is_no_star_is_left_out(self):
        """Bright pixels beside some of the stars, brighter than these: each would be taken for its star."""
        for count, false in ((4, 1), (8, 3), (20, 9)):
            image, camera, listed, turn = self.star_field(count, seed=count)
            for star, (dx, dy) in zip(listed[:false], ((3, 2), (-3, 1), (2, -3)) * 3):
                image[round(star["y_px"]) + dy, round(star["x_px"]) + dx] = 20000
            found, used = stars.solved(image, camera, listed, np.eye(3))
            self.assertGreaterEqual(used, count - false - 1)
            self.assertLessEqual(used, count - false)
            self.assertLess(np.degrees(np.linalg.norm(found - turn)) * 3600, 30)

    def test_of_three_stars_that_disagree_none_is_believed(self):
        image, camera, listed, _ = self.star_field(3)
        image[round(listed[0]["y_px"]) - 2, round(listed[0]["x_px"]) + 3] = 20000
        believed = flight.rotation(np.radians(self.TURN_DEG))
        found, used = stars.solved(image, camera, listed, believed)
        np.testing.assert_array_equal(found, believed)
        self.assertLess(used, 3)

    def test_without_stars_the_attitude_stays(self):
        believed = flight.rotation(np.array([0.1, 0.2, 0.3]))
        found, used = stars.solved(np.ones((64, 64)), Camera.of(64, 20.0), [], believed)
        np.testing.assert_array_equal(found, believed)
        self.assertEqual(used, 0)


class CruiseTest(unittest.TestCase):
    def test_energy_and_distances(self):
        way = cruise.Cruise(10, np.random.default_rng(1))
        distances = np.linalg.norm(way.states[:, :3], axis=1)
        energy = 0.5 * np.sum(way.states[:, 3:] ** 2, axis=1) - cruise.GM / distances
        np.testing.assert_allclose(energy, energy[0], rtol=1e-6)
        self.assertAlmostEqual(distances[-1], cruise.NEAREST_M, delta=10)
        np.testing.assert_allclose(distances[1:-1] / distances[:-2], distances[1] / distances[0], rtol=1e-6)

    def test_the_filter_knows_how_well_it_knows(self):
        """Places of normal errors, 60 ways: the squared error by the covariance is that of six numbers."""
        random, squares = np.random.default_rng(8), []
        for _ in range(60):
            way = cruise.Cruise(6, random)
            sigma = np.array([100e3] * 3 + [1.0] * 3)
            one = cruise.Filter(way.states[0] + sigma * random.standard_normal(6), sigma)
            for step in range(1, 6):
                one.propagate(way.times_s[step] - way.times_s[step - 1])
                spread = np.diag((1e-4 * np.linalg.norm(way.states[step][:3]) * np.array([1, 2, 3])) ** 2)
                one.update(way.states[step][:3] + np.sqrt(np.diag(spread)) * random.standard_normal(3), spread)
            left = one.state - way.states[-1]
            squares.append(left @ np.linalg.solve(one.covariance, left))
        self.assertAlmostEqual(np.mean(squares), 6, delta=1.8)


class FlightTest(unittest.TestCase):
    def test_terrain_takes_the_bias_of_the_sphere_away(self):
        dem = harness.shared_data("global")
        if dem is None:
            self.skipTest("needs ../shared/data/global, or SELENOGRAPH_SHARED_DATA to name its parent")
        warnings.simplefilter("ignore", FrameWarning)
        service = harness.Service(options=["--port", "0", "--cache-dir", harness.path("cache"), "--dem", dem,
                                           "--assets-dir", os.path.join(harness.REPOSITORY, "deploy", "assets")])
        with Client(f"http://{service.host}:{service.port}", timeout_s=600) as client:
            rows = flight.Flight(client, 1, steps=5).fly()
        service.expect_clean_stop()
        of = {name: rows[:, i] for i, name in enumerate(flight.COLUMNS)}
        self.assertTrue((of["stars"] >= 4).all())
        self.assertTrue((of["edges"] >= 60).all())
        self.assertLess(of["attitude_arcsec"].max(), 20)
        self.assertLess(of["terrain_place_m"][-1], 1500)
        self.assertGreater(of["sphere_place_m"][-1], 2 * of["terrain_place_m"][-1])


if __name__ == "__main__":
    unittest.main()
