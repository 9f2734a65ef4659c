"""The truth: a powered descent in closed form, and the camera's attitude along it.

The track lies in the plane of a great circle. Downrange angle and radius are polynomials of time, so that position,
velocity and specific force are exact, and the IMU's increments carry no integration error of the truth's.
"""

import numpy as np

MOON_RADIUS_M = 1737400.0
GM_M3_S2 = 4902.8e9  # GRAIL; a point mass, no spherical harmonics
MOON_RATE_RAD_S = np.array([0.0, 0.0, 2.6617e-6])  # sidereal, about the pole of MOON_ME


def gravity(position_m):
    """Returns the attraction of a point mass, m s-2."""
    return -GM_M3_S2 * position_m / np.linalg.norm(position_m) ** 3


def cross_matrix(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0.0]])


def rotation(vector):
    """Returns the rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    k = cross_matrix(vector)
    if angle < 1e-8:
        return np.eye(3) + k + 0.5 * k @ k
    return np.eye(3) + np.sin(angle) / angle * k + (1 - np.cos(angle)) / angle**2 * k @ k


def rotation_vector(matrix):
    """Returns the rotation vector of a rotation matrix, for angles below a half turn."""
    axis = 0.5 * np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    sine = np.linalg.norm(axis)
    if sine < 1e-12:
        return axis
    return axis * np.arctan2(sine, 0.5 * (np.trace(matrix) - 1)) / sine


def unit_vector(lat_deg, lon_deg):
    lat, lon = np.radians(lat_deg), np.radians(lon_deg)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)


def east_north_up(position_m):
    """Returns the local axes at a point, as columns."""
    up = position_m / np.linalg.norm(position_m)
    east = np.array([-up[1], up[0], 0.0]) / np.hypot(up[0], up[1])
    return np.stack([east, np.cross(up, east), up], axis=1)


def geodetic(position_m):
    """Returns latitude and longitude in degrees, and height in metres, of points (.., 3)."""
    radius = np.linalg.norm(position_m, axis=-1)
    return (np.degrees(np.arcsin(position_m[..., 2] / radius)),
            np.degrees(np.arctan2(position_m[..., 1], position_m[..., 0])), radius - MOON_RADIUS_M)


def _hermite(start, start_rate, end, end_rate, duration):
    """Returns the cubic polynomial of time with these values and rates at its ends."""
    rise, a, b = end - start, start_rate * duration, end_rate * duration
    return np.polynomial.Polynomial([start, a / duration, (3 * rise - 2 * a - b) / duration**2,
                                     (a + b - 2 * rise) / duration**3])


class Descent:
    """Position, velocity, attitude and IMU inputs as functions of time.

    The camera hangs on a platform that points at the Moon's centre, up in the image is along the track, with a motion
    of some degrees on all axes. The IMU sits at the camera, its axes are the camera's.
    """

    def __init__(self, site_lat_deg, site_lon_deg, site_height_m, azimuth_deg, range_m, speed_m_s, perilune_m=15000.0,
                 end_altitude_m=1000.0, end_speed_m_s=30.0, end_descent_m_s=20.0, swing_deg=2.0):
        east, north, up = east_north_up(unit_vector(site_lat_deg, site_lon_deg)).T
        azimuth = np.radians(azimuth_deg)
        self._up = up
        self._along = np.cos(azimuth) * north + np.sin(azimuth) * east
        self.duration_s = 2 * range_m / (speed_m_s + end_speed_m_s)
        radius = MOON_RADIUS_M + site_height_m
        self.site_height_m = site_height_m
        self._swing = np.radians(swing_deg)
        self._angle = _hermite(-range_m / radius, speed_m_s / radius, 0.0, end_speed_m_s / radius, self.duration_s)
        self._radius = _hermite(radius + perilune_m, 0.0, radius + end_altitude_m, -end_descent_m_s, self.duration_s)

    def position(self, t):
        return self._radius(t) * self._radial(t)

    def velocity(self, t):
        """Returns the velocity in the rotating, Moon-fixed frame, m/s."""
        r, a = self._radius, self._angle
        return r.deriv()(t) * self._radial(t) + r(t) * a.deriv()(t) * self._tangent(t)

    def specific_force(self, t):
        """Returns the specific force that an accelerometer measures, in the Moon-fixed frame, m s-2."""
        r, a = self._radius, self._angle
        rate, turn = r.deriv()(t), a.deriv()(t)
        acceleration = ((r.deriv(2)(t) - r(t) * turn**2) * self._radial(t)
                        + (r(t) * a.deriv(2)(t) + 2 * rate * turn) * self._tangent(t))
        w = MOON_RATE_RAD_S
        position = self.position(t)
        return (acceleration + 2 * np.cross(w, self.velocity(t)) + np.cross(w, np.cross(w, position))
                - gravity(position))

    def moon_from_camera(self, t):
        down, forward = -self._radial(t), self._tangent(t)
        level = np.stack([np.cross(-forward, down), -forward, down], axis=1)  # x right, y down the image, z boresight
        swing = self._swing * np.array([np.sin(0.11 * t), np.sin(0.07 * t + 1), np.sin(0.05 * t + 2)])
        return level @ rotation(swing)

    def _radial(self, t):
        return np.cos(self._angle(t)) * self._up + np.sin(self._angle(t)) * self._along

    def _tangent(self, t):
        return -np.sin(self._angle(t)) * self._up + np.cos(self._angle(t)) * self._along
