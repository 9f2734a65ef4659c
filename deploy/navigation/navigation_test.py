#!/usr/bin/env python3
"""deploy/navigation: the filter's Jacobians, propagation and consistency, what the rehearsal finds, a flight of 200
frames, and campaigns that go on where they were stopped.

Skips where OpenCV or SciPy are missing (deploy/install-packages navigation).
"""

import json
import os
import pathlib
import subprocess
import sys
import unittest
from unittest import mock

import harness

NAVIGATION = os.path.join(harness.REPOSITORY, "deploy", "navigation")
sys.path[:0] = [NAVIGATION, os.path.join(harness.REPOSITORY, "api", "clients", "python")]

try:
    import numpy as np
    import scipy  # noqa: F401
    from lander import (campaign, consistency, descent, filter, flight, inertial, map, map_errors, matcher, rehearsal,
                        report, scenarios)
    from lander.camera import Camera
    MISSING = None
except ImportError as error:
    MISSING = f"{error}: deploy/install-packages navigation"


def setUpModule():
    if MISSING:
        raise unittest.SkipTest(MISSING)
    harness.set_up()


def tearDownModule():
    harness.tear_down()


def some_map_error(length_m=3000.0):
    radii = descent.MOON_RADIUS_M + np.array([0.0, 20000.0])
    return filter.MapError(radii, np.array([[30.0, 15.0, 10.0], [40.0, 20.0, 10.0]]), length_m, np.ones(2))


def some_filter(imu=None, sigmas=(100.0, 1.0, 0.01)):
    truth = scenarios.short().descent
    return filter.Filter(truth.position(0), truth.velocity(0), truth.moon_from_camera(0), sigmas, imu or inertial.Imu(),
                         some_map_error())


class FilterTest(unittest.TestCase):
    def test_derivatives_of_pixels_are_finite_differences(self):
        camera, state = Camera.of(256, 50.0), some_filter()
        random = np.random.default_rng(3)
        seen = np.column_stack([random.uniform(-2000, 2000, (20, 2)), random.uniform(6000, 9000, 20)])
        points = state.position + seen @ state.moon_from_camera.T
        _, jacobian = filter.projected(camera, state.position, state.moon_from_camera, points)
        for i in range(filter.SIZE):
            step = np.zeros(filter.SIZE)
            step[i] = 1e-5 if filter.ATTITUDE.start <= i < filter.ATTITUDE.stop else 0.5
            ends = []
            for sign in (1, -1):
                position, _, attitude, _, _, map_bias = state.corrected(sign * step)
                ends.append(filter.projected(camera, position + map_bias, attitude, points)[0].ravel())
            np.testing.assert_allclose(jacobian[:, i], (ends[0] - ends[1]) / (2 * step[i]), rtol=1e-5, atol=1e-6)

    def test_the_transition_is_the_propagations_derivative(self):
        force, rate, step = np.array([0.5, -2.5, -1.5]), np.array([0.02, -0.03, 0.01]), 0.1
        size = np.repeat([10.0, 1.0, 1e-3, 1e-2, 1e-4, 10.0], 3)

        def end(error):
            state = some_filter()
            state.put(error)
            state.propagate(force * step, rate * step, step)
            return state

        expected = some_filter().transition(force, rate, step)
        for i in range(filter.SIZE):
            error = np.zeros(filter.SIZE)
            error[i] = size[i]
            plus, minus = end(error), end(-error)
            difference = np.concatenate([
                plus.position - minus.position, plus.velocity - minus.velocity,
                descent.rotation_vector(minus.moon_from_camera.T @ plus.moon_from_camera),
                plus.accelerometer_bias - minus.accelerometer_bias, plus.gyro_bias - minus.gyro_bias,
                plus.map_bias - minus.map_bias]) / (2 * size[i])
            # The rows' scales differ by what a step can do; half a step squared is what the model leaves out.
            np.testing.assert_allclose(expected[:, i], difference, rtol=2e-3, atol=2e-3, err_msg=f"element {i}")

    def test_a_ballistic_arc_is_keplers(self):
        state = some_filter()
        # A circular orbit, seen in the rotating frame: no force is felt, the inertial attitude stays.
        radius = descent.MOON_RADIUS_M + 15000
        rate = np.sqrt(descent.GM_M3_S2 / radius**3)
        moon = descent.MOON_RATE_RAD_S[2]
        state.position, state.velocity = np.array([radius, 0, 0]), np.array([0, (rate - moon) * radius, 0])
        before = state.moon_from_camera
        for _ in range(3000):
            state.propagate(np.zeros(3), np.zeros(3), 0.1)
        angle = (rate - moon) * 300
        expected = radius * np.array([np.cos(angle), np.sin(angle), 0])
        self.assertLess(np.linalg.norm(state.position - expected), 0.5)  # of 480 km
        turned = descent.rotation(-300 * descent.MOON_RATE_RAD_S) @ before
        np.testing.assert_allclose(state.moon_from_camera, turned, atol=1e-9)

    def test_exact_increments_lead_along_the_truth(self):
        truth = scenarios.short().descent
        times = np.arange(0, 100, 0.1)
        velocity, angle = inertial.exact_increments(truth, times)
        state = some_filter()
        for v, a in zip(velocity, angle):
            state.propagate(v, a, 0.1)
        self.assertLess(np.linalg.norm(state.position - truth.position(times[-1])), 0.5)
        self.assertLess(np.linalg.norm(state.velocity - truth.velocity(times[-1])), 0.01)
        error = descent.rotation_vector(state.moon_from_camera.T @ truth.moon_from_camera(times[-1]))
        self.assertLess(np.linalg.norm(error), 1e-6)

    def test_the_truths_velocity_and_force_are_its_positions_derivatives(self):
        truth, t, h = scenarios.short().descent, 40.0, 0.01
        velocity = (truth.position(t + h) - truth.position(t - h)) / (2 * h)
        np.testing.assert_allclose(truth.velocity(t), velocity, atol=1e-3)
        acceleration = (truth.velocity(t + h) - truth.velocity(t - h)) / (2 * h)
        w = descent.MOON_RATE_RAD_S
        force = (acceleration + 2 * np.cross(w, velocity) + np.cross(w, np.cross(w, truth.position(t)))
                 - descent.gravity(truth.position(t)))
        np.testing.assert_allclose(truth.specific_force(t), force, atol=1e-5)

    def test_the_map_bias_forgets_by_the_ground_that_has_passed(self):
        state = some_filter()
        state.map_bias = np.array([10.0, 0, 0])
        before = state.covariance[filter.MAP, filter.MAP].copy()
        ground_m = 0.0
        for _ in range(30):
            ground_m += 0.1 * np.linalg.norm(state.velocity) * descent.MOON_RADIUS_M / np.linalg.norm(state.position)
            state.propagate(np.zeros(3), np.zeros(3), 0.1)
        self.assertAlmostEqual(state.map_bias[0], 10 * np.exp(-ground_m / 3000), delta=0.01)
        # Nothing was seen: it stays as uncertain as it was, but for 2 km of track.
        np.testing.assert_allclose(state.covariance[filter.MAP, filter.MAP], before, atol=2.0)

    def test_nees_of_a_simulated_case_keeps_its_bounds(self):
        """True landmarks, noise as stated: the filter has to be consistent. 40 flights of 10 updates."""
        low, high = consistency.nees_bounds(40, 9, 0.999)
        mean = self.mean_nees(filter.NO_MAP_ERROR, filter.NO_MAP_ERROR)
        self.assertTrue(low < mean < high, (low, mean, high))

    def test_nees_keeps_its_bounds_under_a_biased_map(self):
        low, high = consistency.nees_bounds(40, 9, 0.999)
        mean = self.mean_nees(some_map_error(), some_map_error())
        self.assertTrue(low < mean < high, (low, mean, high))
        self.assertGreater(self.mean_nees(some_map_error(), filter.NO_MAP_ERROR), high)

    def mean_nees(self, true_error, assumed_error):
        truth, camera, imu = scenarios.short().descent, Camera.of(256, 50.0), inertial.Imu()
        times = np.arange(0, 10.1, 0.25)
        increments = inertial.exact_increments(truth, times)
        initial = flight.InitialError(300.0, 3.0, 0.5)
        nees = []
        for seed in range(40):
            random = np.random.default_rng(seed)
            state = filter.Filter(truth.position(0) + random.normal(0, initial.sigmas[0], 3),
                                  truth.velocity(0) + random.normal(0, initial.sigmas[1], 3),
                                  truth.moon_from_camera(0) @ descent.rotation(random.normal(0, initial.sigmas[2], 3)),
                                  initial.sigmas, imu, assumed_error)
            velocity, angle, _, _ = inertial.measured(imu, increments, times, random)
            bias = random.multivariate_normal(np.zeros(3), true_error.covariance(truth.position(0)))
            for i in range(40):
                state.propagate(velocity[i], angle[i], 0.25)
                if i % 4 == 3:
                    t = times[i + 1]
                    position = truth.position(t)
                    ground_m = np.linalg.norm(truth.velocity(t)) * descent.MOON_RADIUS_M / np.linalg.norm(position)
                    kept = np.exp(-ground_m / true_error.length_m)  # in a second
                    bias = kept * bias + random.multivariate_normal(
                        np.zeros(3), (1 - kept**2) * true_error.covariance(position))
                    seen = np.column_stack([random.uniform(-2500, 2500, (30, 2)), random.uniform(6000, 9000, 30)])
                    points = position + bias + seen @ truth.moon_from_camera(t).T
                    pixels = camera.pixels(seen) + random.normal(0, (0.5, 1.0), (30, 2))
                    state.update(camera, points, pixels, (0.5, 1.0))
            error = np.concatenate([truth.position(t) - state.position, truth.velocity(t) - state.velocity,
                                    descent.rotation_vector(state.moon_from_camera.T @ truth.moon_from_camera(t))])
            nees.append(error @ np.linalg.solve(state.covariance[:9, :9], error))
        return np.mean(nees)


class RehearsalTest(unittest.TestCase):
    def test_an_offset_is_the_shift_of_the_camera(self):
        truth, camera, random = scenarios.short().descent, Camera.of(256, 50.0), np.random.default_rng(5)
        position, attitude = truth.position(20), truth.moon_from_camera(20)
        seen = np.column_stack([random.uniform(-2500, 2500, (30, 2)), random.uniform(6000, 9000, 30)])
        east, north, up = descent.east_north_up(position).T
        points = position + 40 * east - 25 * north + 60 * up + seen @ attitude.T
        shift, _ = rehearsal.offset(camera, position, attitude, points, camera.pixels(seen), np.array([1.0, 2.0]))
        np.testing.assert_allclose(shift, (40, -25, 60), atol=1e-3)

    def test_sigmas_and_length_of_simulated_offsets(self):
        """The noise of the matches is not the map's bias."""
        random = np.random.default_rng(7)
        sigmas, noise = np.array([20.0, 10.0, 5.0]), np.array([10.0, 5.0, 2.5])
        track = np.arange(0, 600e3, 600.0)
        kept = np.exp(-600.0 / 5000)
        shifts = [random.normal(0, sigmas)]
        for _ in track[1:]:
            shifts.append(kept * shifts[-1] + np.sqrt(1 - kept**2) * random.normal(0, sigmas))
        count = len(track)
        rows = np.column_stack([track, descent.MOON_RADIUS_M + 15000 - track / 50,
                                np.array(shifts) + random.normal(0, noise, (count, 3)), np.tile(noise**2, (count, 1)),
                                random.normal(0, 1, (count, 3)), np.arange(count)])
        found = rehearsal.map_error(rows)
        self.assertTrue(np.all(np.diff(found.radii_m) > 0))
        np.testing.assert_allclose(np.sqrt(np.mean(found.sigmas_m**2, axis=0)), sigmas, rtol=0.25)
        self.assertTrue(2500 < found.length_m < 10000, found.length_m)
        self.assertTrue(np.all(found.excess < 2) and found.excess.mean() < 1.4, found.excess)

    def test_maps_of_two_seeds_have_nothing_in_common(self):
        """Two maps, each with one error everywhere, of opposite signs: all of it is bias, whatever their mean."""
        random = np.random.default_rng(11)
        track, noise = np.arange(0, 60e3, 600.0), np.full(3, 5.0)
        count = len(track)
        maps = [np.column_stack([track, descent.MOON_RADIUS_M + 15000 - track / 5,
                                 sign * np.array([30.0, 20.0, 10.0]) + random.normal(0, noise, (count, 3)),
                                 np.tile(noise**2, (count, 1)), random.normal(0, 1, (count, 3)), np.arange(count)])
                for sign in (1, -1)]
        rows, draws = np.concatenate(maps), np.repeat([0, 1], count)
        found = rehearsal.map_error(rows, draws)
        np.testing.assert_allclose(np.sqrt(np.mean(found.sigmas_m**2, axis=0)), [30, 20, 10], rtol=0.15)
        self.assertLess(np.sqrt(np.mean(rehearsal.map_error(rows).sigmas_m[:, 0] ** 2)), 15)

    def test_a_shift_adds_to_the_bias(self):
        known = map_errors.with_shift(some_map_error(3000.0), 40.0)
        np.testing.assert_allclose(known.sigmas_m[0], [50.0, np.hypot(15, 40), 10.0])
        self.assertTrue(50e3 < known.length_m < map_errors.SHIFT_LENGTH_M, known.length_m)
        self.assertEqual(map_errors.with_shift(some_map_error(), 0.0).length_m, some_map_error().length_m)

    def test_each_seed_has_a_map_of_its_own(self):
        case, scenario = map_errors.CASES[-1], scenarios.short()
        first, second = (case.draw(scenario, seed) for seed in (1, 2))
        self.assertEqual(first, case.draw(scenario, 1))
        self.assertNotEqual(first["shift"], second["shift"])
        self.assertEqual(first["height"], second["height"])
        self.assertAlmostEqual(first["about"]["lon_deg"], 30.6, delta=0.01)
        self.assertIsNone(map_errors.CASES[0].draw(scenario, 1))
        drawn = [case.draw(scenario, seed)["shift"]["east_m"] for seed in range(400)]
        self.assertAlmostEqual(np.std(drawn), case.shift_sigma_m, delta=2.5)

    def test_what_comes_again_counts_as_often(self):
        """Each value in four frames: correlations of 3/4, 1/2 and 1/4 to both sides."""
        values = np.repeat(np.random.default_rng(8).normal(0, 1, (200, 3)), 4, axis=0)
        self.assertAlmostEqual(rehearsal.sum_of_correlations(np.arange(800), values), 4.0, delta=0.8)

    def test_a_white_tilt_is_of_variance_1(self):
        truth, camera, random = scenarios.short().descent, Camera.of(256, 50.0), np.random.default_rng(9)
        position, attitude = truth.position(20), truth.moon_from_camera(20)
        found = []
        for _ in range(200):
            seen = np.column_stack([random.uniform(-2500, 2500, (30, 2)), random.uniform(6000, 9000, 30)])
            pixels = camera.pixels(seen) + random.normal(0, (1.0, 2.0), (30, 2))
            found.append(rehearsal.tilt(camera, position, attitude, position + seen @ attitude.T, pixels,
                                        np.array([1.0, 2.0])))
        np.testing.assert_allclose(np.cov(np.array(found).T), np.eye(3), atol=0.3)

    def test_the_rehearsals_sun_is_neither_the_flights_nor_the_maps(self):
        scenario = scenarios.short(flight=(95, 18), map_sun=(105, 30))
        local = rehearsal.other_sun(scenario)["local"]
        self.assertEqual((local["azimuth_deg"], local["elevation_deg"]), (115, 18))


class MatcherTest(unittest.TestCase):
    def test_a_peak_is_found_between_pixels(self):
        y, x = np.mgrid[0:15, 0:17]
        found = matcher.peak((1 - 0.01 * ((x - 8.3) ** 2 + (y - 5.8) ** 2)).astype(np.float32))
        np.testing.assert_allclose(found[:2], (8.3, 5.8), atol=1e-3)

    def test_a_level_of_the_map_serves_cameras_whose_view_it_holds(self):
        levels = [mock.Mock(gsd_m=gsd_m) for gsd_m in (8, 34, 20)]
        for camera_gsd_m, held, level_gsd_m in ((30, (34, 20, 8), 34), (21, (34, 20, 8), 20), (21, (34, 8), 8),
                                                (21, (34,), 34), (1, (34, 20), 20), (1, (), 34)):
            found = map.Map(levels).level(camera_gsd_m, lambda one: one.gsd_m in held)
            self.assertEqual(found.gsd_m, level_gsd_m, (camera_gsd_m, held))

    def test_a_level_holds_what_lies_on_it(self):
        side = 301  # pixels of 100 m, about the place below
        area = {"center": {"lat_deg": 10.0, "lon_deg": 20.0}}
        north_m = np.radians(10.0) * descent.MOON_RADIUS_M + 15050.0
        meta = {"request": {"map": area}, "grid": {"geotransform": [-15050.0, 100.0, 0, north_m, 0, -100.0]}}
        flat = np.zeros((side, side))
        frame = mock.MagicMock(meta=meta)
        frame.__getitem__.side_effect = {"radiance": flat, "height": flat}.get
        level = map.Level(frame, 100.0)
        camera = Camera.of(256, 53.13)  # as wide as it is high
        east, north, up = descent.east_north_up(descent.unit_vector(10.0, 20.0)).T
        looking_down = np.column_stack([east, -north, -up])
        for altitude_m, margin_px, held in ((10e3, 0, True), (25e3, 0, True), (35e3, 0, False), (10e3, 100, True),
                                            (10e3, 300, False)):
            position = (descent.MOON_RADIUS_M + altitude_m) * up
            self.assertEqual(level.holds_view(camera, position, looking_down, margin_px), held, (altitude_m, margin_px))

    def test_the_coarse_search_ends_with_the_frame_and_the_height(self):
        """A doubt of many footprints near the ground: the search took minutes."""
        camera = Camera.of(256, 50.0)
        searching, state = matcher.Matcher(camera, map.Map([mock.Mock(gsd_m=30.0)])), some_filter(sigmas=(2000.0, 1.0, 0.01))
        searching.altitude_m = lambda state: 100.0
        margins = []

        def view(level, camera, position, moon_from_camera, margin):
            margins.append(margin)
            size = camera.side + 2 * margin
            return mock.Mock(image=np.zeros((size, size), np.float32))

        with mock.patch.object(matcher, "View", view):
            searching.coarse(state, np.zeros((256, 256), np.float32), None, 1, 1e5)
        self.assertLessEqual(max(margins), 64)
        self.assertLessEqual(len(margins), 41)

    def test_the_search_reaches_beyond_the_matches_own_scatter(self):
        """Else matches lie about the prediction, and the filter measures its own error."""
        camera = Camera.of(256, 50.0)

        class Ground:  # a level without relief
            gsd_m = 30.0

            def pixels(self, positions):
                return np.zeros(positions.shape[:-1]), np.zeros(positions.shape[:-1])

            def height_at(self, column, row):
                return np.zeros(column.shape)

        ground = Ground()
        searching = matcher.Matcher(camera, map.Map([ground]))
        state = some_filter()
        self.assertEqual(searching.reach_px(state, 0.5, ground, 1), matcher.WIDEST)  # nothing is known yet
        map_px = ground.gsd_m * camera.focal / searching.altitude_m(state)
        searching._map_sigmas = np.array([0.5, 2.0]) / map_px
        self.assertEqual(searching.reach_px(state, 0.5, ground, 1), int(np.ceil(3 * np.hypot(0.5, 2.0))) + 2)

    def test_a_patch_of_a_few_posts_is_not_searched(self):
        camera, image = Camera.of(256, 50.0), np.random.default_rng(1).random((256, 256), np.float32)

        class Level:
            gsd_m = 30.0

        seen = mock.Mock(image=image, valid=np.full((256, 256), True), points=lambda x, y: np.zeros((len(x), 3)))
        for post_spacing_m, found in ((30.0, True), (500.0, False)):  # patches are 32 pixels of 29 m
            matching = matcher.Matcher(camera, map.Map([Level()], post_spacing_m=post_spacing_m))
            matching.altitude_m = lambda state: 8000.0
            with mock.patch.object(matcher, "View", return_value=seen):
                self.assertEqual(matching.fine(some_filter(), image, Level(), 1, 4) is not None, found)

    def test_maximum_at_the_border_is_rejected(self):
        y, x = np.mgrid[0:15, 0:17]
        self.assertIsNone(matcher.peak((x + y).astype(np.float32)))


def run(*arguments):
    return subprocess.run([os.path.join(NAVIGATION, "run"), *arguments, "--binary", harness.BINARY, "--work",
                           harness.path("navigation")],
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=harness.PATIENCE_S * 5)


class FlightTest(unittest.TestCase):
    def test_without_shadows_is_the_frame_where_it_is_lit(self):
        """Shadows are filled by the law that the lit pixels follow; what faces away stays dark."""
        y, x = np.mgrid[:40, :40] / 40
        angles = np.stack([60 + 35 * x, 20 * y, 50 + 15 * x - 10 * y], axis=-1)
        incidence, emission = np.cos(np.radians(angles[..., 0])), np.cos(np.radians(angles[..., 1]))
        share = 1 - 0.019 * angles[..., 2] + 0.242e-3 * angles[..., 2]**2 - 1.46e-6 * angles[..., 2]**3
        shade = 2 * share * incidence / (incidence + emission) + (1 - share) * incidence
        right = np.where(incidence > 0, shade * 12 * np.exp(-0.02 * angles[..., 2]), 0)
        lit = ((incidence > 0) & (y > 0.3)).astype(np.float32)
        frame = {"angles": angles, "radiance": np.where(lit == 1, right, 0), "lit": lit}
        np.testing.assert_allclose(flight.without_shadows(frame), right, rtol=1e-5, atol=1e-6)

    def test_a_flight_of_200_frames_converges(self):
        output = harness.path("flight")
        done = run("fly", "--scenario", "short", "-o", output)
        self.assertEqual(done.returncode, 0, done.stderr)
        rows, _ = campaign.flights(pathlib.Path(output, "fly"))
        rows, names = rows[0], list(flight.COLUMNS)
        self.assertGreaterEqual(len(rows), 190)
        error, altitude = rows[:, names.index("position_error_m")], rows[:, names.index("altitude_m")]
        matches = rows[:, names.index("matches")]
        self.assertEqual(rows[0, names.index("coarse")], 1)  # kilometres off at first
        self.assertGreater((matches > 0).mean(), 0.9)
        # After the first tenth: some thousandths of the altitude, and never lost.
        self.assertLess(np.max(error[20:] / altitude[20:]), 0.02)
        self.assertLess(error[-1], 20)
        # A single flight: the mean over its correlated frames is not as narrow as that of independent ones.
        self.assertLess(rows[20:, names.index("position_nees")].mean(), 7)
        with open(os.path.join(output, "report.json")) as file:
            self.assertEqual(json.load(file)["fly"]["conditions"]["frames"], len(rows))
        self.assertTrue(os.path.exists(os.path.join(output, "fly.png")))


class CampaignTest(unittest.TestCase):
    def begun(self, resume, **more):
        folder = pathlib.Path(harness.path("campaign"))
        return campaign.Campaign(folder, 4, 1, 1, resume), {"scenario": "some", **more}

    def test_campaign_resumes(self):
        one, conditions = self.begun(resume=False)
        self.assertEqual(one.begin(conditions), [1, 2, 3, 4])
        rows = np.ones((5, len(flight.COLUMNS)), np.float32)
        campaign.write_whole(one._path(2), lambda file: np.savez(file, rows=rows, processor_s=1.5))
        one._path(3).with_name("00003.npz.part").write_bytes(b"half of a flight")
        again, _ = self.begun(resume=True)
        self.assertEqual(again.begin(conditions), [1, 3, 4])
        runs, seconds = campaign.flights(again.folder)
        self.assertEqual((runs.shape, list(seconds)), ((1, 5, len(flight.COLUMNS)), [1.5]))
        with self.assertRaisesRegex(SystemExit, "flown with other scenario; leave --resume out"):
            again.begin({**conditions, "scenario": "another"})
        self.assertEqual(one.begin(conditions), [1, 2, 3, 4])  # anew

    def test_the_page_has_the_tables_of_what_was_flown(self):
        work = pathlib.Path(harness.path("work"))
        one = campaign.Campaign(work / "short" / "monte-carlo", 2, 1, 1, False)
        one.begin(campaign.conditions_of(scenarios.short()))
        campaign.write_json(one.folder / "map.json", {"post_spacing_m": 30.0, "gsd_m": [29.0]})
        random = np.random.default_rng(1)
        for seed in (1, 2):
            rows = random.uniform(1, 2, (50, len(flight.COLUMNS)))
            rows[:, flight.COLUMNS.index("altitude_m")] = np.linspace(4000, 2000, 50)
            rows[:, flight.COLUMNS.index("position_error_m")] = 40.0
            campaign.write_whole(one._path(seed), lambda file: np.savez(file, rows=rows, processor_s=1.0))
        (work / "short" / "report.json").write_text("{}")
        report.publish(work)
        page = (work / "report.md").read_text()
        self.assertTrue(page.startswith("### short: 2 flights\n"), page)
        self.assertIn("Reflectance `moon`.", " ".join(page.split()))
        self.assertIn("position RMS 40.0 m", page)
        self.assertIn("(short/monte-carlo.png)", page)
        self.assertTrue((work / "short" / "monte-carlo.png").exists())


if __name__ == "__main__":
    harness.main()
