"""The cruise to the Moon, and the filter that estimates it. Axes of ICRF, metres from the Moon's centre.

The Moon's point mass alone: neither the Earth nor the Sun pulls, in truth as in the filter, since the subject is what
the images know."""

import numpy as np
from scipy.integrate import solve_ivp

from lander.descent import GM_M3_S2 as GM
from lander.descent import MOON_RADIUS_M

FARTHEST_M, NEAREST_M = 400e6, 2e6 + MOON_RADIUS_M


def _motion(_, state):
    place = state[:3]
    return np.concatenate([state[3:], -GM * place / np.linalg.norm(place) ** 3])


def _after(state, seconds):
    return solve_ivp(_motion, (0, seconds), state, method="DOP853", rtol=1e-11, atol=1e-3).y[:, -1]


class Cruise:
    """A hyperbola with an excess speed of 900 m/s and a perilune 300 km up, with states at `steps` distances in equal
    ratios."""

    def __init__(self, steps, random):
        axis = np.array([0.62, -0.74, 0.26]) / np.linalg.norm([0.62, -0.74, 0.26])
        across = np.cross(axis, [0.1, 0.2, 1.0])
        across /= np.linalg.norm(across)
        perilune, afar = MOON_RADIUS_M + 300e3, 900.0
        speed = np.sqrt(afar**2 + 2 * GM / FARTHEST_M)
        aside = perilune * np.sqrt(afar**2 + 2 * GM / perilune) / speed
        state = np.concatenate([FARTHEST_M * axis + aside * across, -speed * axis])
        # Flights differ by what a launch and its corrections leave.
        state += np.concatenate([random.normal(0, 100e3, 3), random.normal(0, 1.0, 3)])
        distances = np.geomspace(np.linalg.norm(state[:3]), NEAREST_M, steps)
        self.times_s, self.states = [0.0], [state]
        for distance in distances[1:]:
            def arrived(_, now, distance=distance):
                return np.linalg.norm(now[:3]) - distance
            arrived.terminal = True
            way = solve_ivp(_motion, (0, 1e7), self.states[-1], method="DOP853", rtol=1e-11, atol=1e-3,
                            events=arrived)
            self.times_s.append(self.times_s[-1] + way.t[-1])
            self.states.append(way.y[:, -1])
        self.states = np.array(self.states)


class Filter:
    """Extended Kalman filter of position and velocity."""

    def __init__(self, state, sigma):
        self.state, self.covariance = state, np.diag(np.square(sigma))

    def propagate(self, seconds):
        moved = _after(self.state, seconds)
        steps = np.diag(np.sqrt(np.diag(self.covariance)) * 1e-2 + 1e-6)
        transition = np.array([(_after(self.state + step, seconds) - moved) / step.sum() for step in steps]).T
        self.state, self.covariance = moved, transition @ self.covariance @ transition.T

    def update(self, place, covariance):
        gain = self.covariance[:, :3] @ np.linalg.inv(self.covariance[:3, :3] + covariance)
        self.state = self.state + gain @ (place - self.state[:3])
        left = np.eye(6)
        left[:, :3] -= gain
        self.covariance = left @ self.covariance @ left.T + gain @ covariance @ gain.T
