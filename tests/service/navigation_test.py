#!/usr/bin/env python3
"""deploy/navigation: the filter's Jacobians and propagation against closed forms, and a flight of 200 frames.

Skips where OpenCV or SciPy are missing (deploy/install-packages navigation).
"""

import json
import os
import subprocess
import sys
import unittest

import harness

NAVIGATION = os.path.join(harness.REPOSITORY, "deploy", "navigation")
sys.path[:0] = [NAVIGATION, os.path.join(harness.REPOSITORY, "api", "clients", "python")]

try:
    import numpy as np
    import scipy  # noqa: F401
    from lander import consistency, descent, filter, flight, inertial, matcher, scenarios
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


def some_filter(imu=None, sigmas=(100.0, 1.0, 0.01)):
    truth = scenarios.short().descent
    return filter.Filter(truth.position(0), truth.velocity(0), truth.moon_from_camera(0), sigmas, imu or inertial.Imu())


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
                position, _, attitude, _, _ = state.corrected(sign * step)
                ends.append(filter.projected(camera, position, attitude, points)[0].ravel())
            np.testing.assert_allclose(jacobian[:, i], (ends[0] - ends[1]) / (2 * step[i]), rtol=1e-5, atol=1e-6)

    def test_the_transition_is_the_propagations_derivative(self):
        force, rate, step = np.array([0.5, -2.5, -1.5]), np.array([0.02, -0.03, 0.01]), 0.1
        size = np.repeat([10.0, 1.0, 1e-3, 1e-2, 1e-4], 3)

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
                plus.accelerometer_bias - minus.accelerometer_bias, plus.gyro_bias - minus.gyro_bias]) / (2 * size[i])
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

    def test_nees_of_a_simulated_case_keeps_its_bounds(self):
        """True landmarks, noise as stated: the filter has to be consistent. 40 flights of 10 updates."""
        truth, camera, imu = scenarios.short().descent, Camera.of(256, 50.0), inertial.Imu()
        times = np.arange(0, 10.05, 0.1)
        increments = inertial.exact_increments(truth, times)
        initial = flight.InitialError(300.0, 3.0, 0.5)
        nees = []
        for seed in range(40):
            random = np.random.default_rng(seed)
            state = filter.Filter(truth.position(0) + random.normal(0, initial.sigmas[0], 3),
                                  truth.velocity(0) + random.normal(0, initial.sigmas[1], 3),
                                  truth.moon_from_camera(0) @ descent.rotation(random.normal(0, initial.sigmas[2], 3)),
                                  initial.sigmas, imu)
            velocity, angle, _, _ = inertial.measured(imu, increments, times, random)
            for i in range(100):
                state.propagate(velocity[i], angle[i], 0.1)
                if i % 10 == 9:
                    t = times[i + 1]
                    seen = np.column_stack([random.uniform(-2500, 2500, (30, 2)), random.uniform(6000, 9000, 30)])
                    points = truth.position(t) + seen @ truth.moon_from_camera(t).T
                    pixels = camera.pixels(seen) + random.normal(0, (0.5, 1.0), (30, 2))
                    state.update(camera, points, pixels, (0.5, 1.0))
            error = np.concatenate([truth.position(t) - state.position, truth.velocity(t) - state.velocity,
                                    descent.rotation_vector(state.moon_from_camera.T @ truth.moon_from_camera(t))])
            nees.append(error @ np.linalg.solve(state.covariance[:9, :9], error))
        low, high = consistency.nees_bounds(40, 9, 0.999)
        self.assertTrue(low < np.mean(nees) < high, (low, np.mean(nees), high))


class MatcherTest(unittest.TestCase):
    def test_a_peak_is_found_between_pixels(self):
        y, x = np.mgrid[0:15, 0:17]
        found = matcher.peak((1 - 0.01 * ((x - 8.3) ** 2 + (y - 5.8) ** 2)).astype(np.float32))
        np.testing.assert_allclose(found[:2], (8.3, 5.8), atol=1e-3)

    def test_a_maximum_at_the_border_is_none(self):
        y, x = np.mgrid[0:15, 0:17]
        self.assertIsNone(matcher.peak((x + y).astype(np.float32)))


class FlightTest(unittest.TestCase):
    def test_a_flight_of_200_frames_converges(self):
        output = harness.path("flight")
        done = subprocess.run([os.path.join(NAVIGATION, "run"), "fly", "--scenario", "short", "--binary",
                               harness.BINARY, "--work", harness.path("navigation"), "-o", output],
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=harness.PATIENCE_S * 5)
        self.assertEqual(done.returncode, 0, done.stderr)
        with np.load(os.path.join(output, "fly.npz")) as stored:
            rows, names = stored["runs"][0], list(stored["columns"])
        self.assertGreaterEqual(len(rows), 190)
        error, altitude = rows[:, names.index("position_error_m")], rows[:, names.index("altitude_m")]
        matches = rows[:, names.index("matches")]
        self.assertEqual(rows[0, names.index("coarse")], 1)  # kilometres off at first
        self.assertGreater((matches > 0).mean(), 0.9)
        # After the first tenth: some percent of the altitude, and never lost.
        self.assertLess(np.max(error[20:] / altitude[20:]), 0.05)
        self.assertLess(error[-1], 60)
        with open(os.path.join(output, "report.json")) as file:
            self.assertEqual(json.load(file)["fly"]["conditions"]["frames"], len(rows))
        self.assertTrue(os.path.exists(os.path.join(output, "fly.png")))


if __name__ == "__main__":
    harness.main()
