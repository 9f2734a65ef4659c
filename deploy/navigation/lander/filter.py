"""An error-state extended Kalman filter in the rotating, Moon-fixed frame.

The error state has 18 elements: position, velocity, attitude (a rotation vector in camera axes: true = estimate *
rotation(error)), bias of the accelerometers, bias of the gyros, bias of the map; each is true minus estimated.

The map's bias is the common error of all matches of a frame: a lander at p sees the map as from p + bias. It is a
first-order Gauss-Markov process in the distance flown over the ground, since it belongs to the ground.
"""

import dataclasses

import numpy as np

from .descent import GM_M3_S2, MOON_RADIUS_M, MOON_RATE_RAD_S, cross_matrix, east_north_up, gravity, rotation

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
ACCELEROMETER, GYRO, MAP = slice(9, 12), slice(12, 15), slice(15, 18)
SIZE = 18


@dataclasses.dataclass(frozen=True)
class MapError:
    """Statistics, known before flight, of the common error of a frame's matches, by distance from the Moon's centre."""

    radii_m: np.ndarray  # (n,), distances from the Moon's centre, rising
    sigmas_m: np.ndarray  # (n, 3), standard deviations of the bias: east, north, up
    length_m: float  # distance on the ground over which the bias is correlated
    excess: np.ndarray  # (n,), factor by which frames scatter more than independent matches would

    def covariance(self, position_m):
        """Returns the covariance of the bias at a position, in the Moon-fixed frame."""
        axes = east_north_up(position_m)
        radius = np.linalg.norm(position_m)
        sigmas = np.array([np.interp(radius, self.radii_m, column) for column in self.sigmas_m.T])
        return axes * sigmas**2 @ axes.T

    def excess_at(self, position_m):
        return float(np.interp(np.linalg.norm(position_m), self.radii_m, self.excess))


NO_MAP_ERROR = MapError(np.zeros(1), np.zeros((1, 3)), 1.0, np.ones(1))


class Filter:
    def __init__(self, position, velocity, moon_from_camera, sigmas, imu, map_error=NO_MAP_ERROR):
        """sigmas: of position, velocity and attitude, for each axis. The biases start at 0 with the IMU's sigmas."""
        self.position, self.velocity = np.array(position, float), np.array(velocity, float)
        self.moon_from_camera = np.array(moon_from_camera, float)
        self.accelerometer_bias, self.gyro_bias, self.map_bias = np.zeros(3), np.zeros(3), np.zeros(3)
        self.imu, self.map_error = imu, map_error
        sigmas = np.repeat([*sigmas, imu.accelerometer_bias_m_s2, imu.gyro_bias_rad_s, 0.0], 3)
        self.covariance = np.diag(sigmas**2)
        self.covariance[MAP, MAP] = map_error.covariance(self.position)

    def copy(self):
        return (self.position, self.velocity, self.moon_from_camera, self.accelerometer_bias, self.gyro_bias,
                self.map_bias, self.covariance)

    def restore(self, copied):
        (self.position, self.velocity, self.moon_from_camera, self.accelerometer_bias, self.gyro_bias,
         self.map_bias, self.covariance) = copied

    @property
    def map_position(self):
        """Returns the position from which the lander sees the map."""
        return self.position + self.map_bias

    def propagate(self, velocity_increment, angle_increment, step):
        """Propagates state and covariance over one interval of the IMU, by the midpoint rule."""
        force = velocity_increment / step - self.accelerometer_bias
        rate = angle_increment / step - self.gyro_bias
        transition = self.transition(force, rate, step)

        w, turn = MOON_RATE_RAD_S, cross_matrix(MOON_RATE_RAD_S)
        # Attitude, position and velocity at the interval's middle give gravity, centrifugal and Coriolis acceleration.
        middle_attitude = rotation(-0.5 * step * w) @ self.moon_from_camera @ rotation(0.5 * step * rate)
        middle_position = self.position + 0.5 * step * self.velocity
        acceleration = middle_attitude @ force + gravity(middle_position) - turn @ (turn @ middle_position)
        middle_velocity = self.velocity + 0.5 * step * (acceleration - 2 * turn @ self.velocity)
        acceleration -= 2 * turn @ middle_velocity
        correlation = self.map_correlation(step)
        self.position = self.position + step * self.velocity + 0.5 * step**2 * acceleration
        self.velocity = self.velocity + step * acceleration
        self.moon_from_camera = rotation(-step * w) @ self.moon_from_camera @ rotation(step * rate)

        self.map_bias = correlation * self.map_bias

        self.covariance = transition @ self.covariance @ transition.T
        diagonal = np.einsum("ii->i", self.covariance)
        diagonal[VELOCITY] += self.imu.accelerometer_noise_m_s2_rthz**2 * step
        diagonal[ATTITUDE] += self.imu.gyro_noise_rad_rts**2 * step
        self.covariance[MAP, MAP] += (1 - correlation**2) * self.map_error.covariance(self.position)

    def map_correlation(self, step):
        """Returns the correlation of the map's bias over the distance that is flown in one interval."""
        distance_m = step * np.linalg.norm(self.velocity) * MOON_RADIUS_M / np.linalg.norm(self.position)
        return np.exp(-distance_m / self.map_error.length_m)

    def rates(self, force):
        """Returns F of d(error)/dt = F error, without the attitude's own rotation, which transition() adds exactly."""
        f = np.zeros((SIZE, SIZE))
        w = cross_matrix(MOON_RATE_RAD_S)
        distance = np.linalg.norm(self.position)
        up = self.position / distance
        f[POSITION, VELOCITY] = np.eye(3)
        f[VELOCITY, POSITION] = GM_M3_S2 / distance**3 * (3 * np.outer(up, up) - np.eye(3)) - w @ w
        f[VELOCITY, VELOCITY] = -2 * w
        f[VELOCITY, ATTITUDE] = -self.moon_from_camera @ cross_matrix(force)
        f[VELOCITY, ACCELEROMETER] = -self.moon_from_camera
        f[ATTITUDE, GYRO] = -np.eye(3)
        return f

    def transition(self, force, rate, step):
        """Returns the matrix that takes the error from the beginning of an interval to its end."""
        f = step * self.rates(force)
        transition = np.eye(SIZE) + f + 0.5 * f @ f
        transition[ATTITUDE, ATTITUDE] = rotation(-step * rate)
        transition[MAP, MAP] *= self.map_correlation(step)
        return transition

    def corrected(self, error):
        """Returns the state corrected by an error: (position, velocity, attitude, the three biases)."""
        return (self.position + error[POSITION], self.velocity + error[VELOCITY],
                self.moon_from_camera @ rotation(error[ATTITUDE]), self.accelerometer_bias + error[ACCELEROMETER],
                self.gyro_bias + error[GYRO], self.map_bias + error[MAP])

    def put(self, error):
        """Corrects the state by an error."""
        (self.position, self.velocity, self.moon_from_camera, self.accelerometer_bias, self.gyro_bias,
         self.map_bias) = self.corrected(error)

    def update(self, camera, points_m, pixels, sigmas_px, iterations=3):
        """Updates the state with points of the map that were seen at pixels.

        The update is iterated (Gauss-Newton), since first errors are kilometres. sigmas_px: independent standard
        deviations of each pixel's x and y. However many points there are, only an 18 x 18 matrix is inverted, and the
        prior covariance is not: it may be singular, as for a map whose bias is known to be 0.
        """
        weights = np.tile(1 / np.asarray(sigmas_px), len(pixels))
        error = np.zeros(SIZE)
        for _ in range(iterations):
            position, _, moon_from_camera, _, _, map_bias = self.corrected(error)
            predicted, jacobian = projected(camera, position + map_bias, moon_from_camera, points_m)
            target = weights * ((pixels - predicted).ravel() + jacobian @ error)
            jacobian = weights[:, None] * jacobian
            information = jacobian.T @ jacobian
            covariance = np.linalg.solve(np.eye(SIZE) + self.covariance @ information, self.covariance)
            change = covariance @ (jacobian.T @ target) - error
            error = error + change
            if np.linalg.norm(change[POSITION]) < 0.1:
                break
        self.covariance = 0.5 * (covariance + covariance.T)
        self.put(error)

    def pixel_sigmas(self, camera, points_m):
        """Returns the largest standard deviation of each predicted pixel."""
        _, jacobian = projected(camera, self.map_position, self.moon_from_camera, points_m)
        rows = jacobian.reshape(-1, 2, SIZE)
        covariance = rows @ self.covariance @ rows.transpose(0, 2, 1)
        return np.sqrt(np.linalg.eigvalsh(covariance)[:, 1])


def projected(camera, map_position, moon_from_camera, points_m):
    """Returns the pixels of points of the map, (n, 2), and their derivatives by the error state, (2 n, 18)."""
    seen = (points_m - map_position) @ moon_from_camera  # in camera axes
    x, y, z = seen.T
    pixels = camera.pixels(seen)
    by_seen = np.zeros((len(seen), 2, 3))
    by_seen[:, 0, 0], by_seen[:, 0, 2] = camera.focal / z, -camera.focal * x / z**2
    by_seen[:, 1, 1], by_seen[:, 1, 2] = camera.focal / z, -camera.focal * y / z**2
    jacobian = np.zeros((len(seen), 2, SIZE))
    jacobian[..., POSITION] = jacobian[..., MAP] = -by_seen @ moon_from_camera.T
    # true = estimate rotation(e): seen = rotation(-e) seen0, so that d seen / d e = [seen]x
    crosses = np.zeros((len(seen), 3, 3))
    crosses[:, 0, 1], crosses[:, 0, 2], crosses[:, 1, 2] = -z, y, -x
    crosses -= crosses.transpose(0, 2, 1).copy()
    jacobian[..., ATTITUDE] = by_seen @ crosses
    return pixels, jacobian.reshape(-1, SIZE)
