"""An error-state extended Kalman filter in the rotating, Moon-fixed frame.

The error state has 15 elements: position, velocity, attitude (a rotation vector in camera axes: true = estimate *
rotation(error)), bias of the accelerometers, bias of the gyros; each is true minus estimated.
"""

import numpy as np

from .descent import GM_M3_S2, MOON_RATE_RAD_S, cross_matrix, gravity, rotation

POSITION, VELOCITY, ATTITUDE = slice(0, 3), slice(3, 6), slice(6, 9)
ACCELEROMETER, GYRO = slice(9, 12), slice(12, 15)
SIZE = 15


class Filter:
    def __init__(self, position, velocity, moon_from_camera, sigmas, imu):
        """sigmas: of position, velocity and attitude, for each axis. The biases start at 0 with the IMU's sigmas."""
        self.position, self.velocity = np.array(position, float), np.array(velocity, float)
        self.moon_from_camera = np.array(moon_from_camera, float)
        self.accelerometer_bias, self.gyro_bias = np.zeros(3), np.zeros(3)
        self.imu = imu
        self.covariance = np.diag(np.repeat([*sigmas, imu.accelerometer_bias_m_s2, imu.gyro_bias_rad_s], 3) ** 2.0)

    def copy(self):
        return (self.position, self.velocity, self.moon_from_camera, self.accelerometer_bias, self.gyro_bias,
                self.covariance)

    def restore(self, copied):
        (self.position, self.velocity, self.moon_from_camera, self.accelerometer_bias, self.gyro_bias,
         self.covariance) = copied

    def propagate(self, velocity_increment, angle_increment, step):
        """One interval of the IMU, by the midpoint rule."""
        force = velocity_increment / step - self.accelerometer_bias
        rate = angle_increment / step - self.gyro_bias
        transition = self.transition(force, rate, step)

        w = MOON_RATE_RAD_S
        half = rotation(-0.5 * step * w) @ self.moon_from_camera @ rotation(0.5 * step * rate)
        position = self.position + 0.5 * step * self.velocity
        acceleration = half @ force + gravity(position) - np.cross(w, np.cross(w, position))
        # The Coriolis term at the interval's middle.
        middle = self.velocity + 0.5 * step * (acceleration - 2 * np.cross(w, self.velocity))
        acceleration -= 2 * np.cross(w, middle)
        self.position = self.position + step * self.velocity + 0.5 * step**2 * acceleration
        self.velocity = self.velocity + step * acceleration
        self.moon_from_camera = rotation(-step * w) @ self.moon_from_camera @ rotation(step * rate)

        self.covariance = transition @ self.covariance @ transition.T
        diagonal = np.einsum("ii->i", self.covariance)
        diagonal[VELOCITY] += self.imu.accelerometer_noise_m_s2_rthz**2 * step
        diagonal[ATTITUDE] += self.imu.gyro_noise_rad_rts**2 * step

    def rates(self, force):
        """F of d(error)/dt = F error, but for the attitude's own turning, which is taken exactly in transition()."""
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
        f = step * self.rates(force)
        transition = np.eye(SIZE) + f + 0.5 * f @ f
        transition[ATTITUDE, ATTITUDE] = rotation(-step * rate)
        return transition

    def corrected(self, error):
        """The nominal state with an error put in: (position, velocity, attitude, biases)."""
        return (self.position + error[POSITION], self.velocity + error[VELOCITY],
                self.moon_from_camera @ rotation(error[ATTITUDE]), self.accelerometer_bias + error[ACCELEROMETER],
                self.gyro_bias + error[GYRO])

    def put(self, error):
        (self.position, self.velocity, self.moon_from_camera, self.accelerometer_bias, self.gyro_bias) = (
            self.corrected(error))

    def update(self, camera, points_m, pixels, sigmas_px, iterations=3):
        """Points of the map seen at pixels; an iterated update (Gauss-Newton: first errors are kilometres).

        sigmas_px: of x and y of each pixel, independent. In the information form: 15 x 15, however many points.
        """
        prior = np.linalg.inv(self.covariance)
        weights = np.tile(1 / np.asarray(sigmas_px), len(pixels))
        error = np.zeros(SIZE)
        for _ in range(iterations):
            position, _, moon_from_camera, _, _ = self.corrected(error)
            predicted, jacobian = projected(camera, position, moon_from_camera, points_m)
            target = weights * ((pixels - predicted).ravel() + jacobian @ error)
            jacobian = weights[:, None] * jacobian
            covariance = np.linalg.inv(prior + jacobian.T @ jacobian)
            change = covariance @ (jacobian.T @ target) - error
            error = error + change
            if np.linalg.norm(change[POSITION]) < 0.1:
                break
        self.covariance = 0.5 * (covariance + covariance.T)
        self.put(error)

    def pixel_sigmas(self, camera, points_m):
        """Largest standard deviation of each predicted pixel."""
        _, jacobian = projected(camera, self.position, self.moon_from_camera, points_m)
        rows = jacobian.reshape(-1, 2, SIZE)
        covariance = rows @ self.covariance @ rows.transpose(0, 2, 1)
        return np.sqrt(np.linalg.eigvalsh(covariance)[:, 1])


def projected(camera, position, moon_from_camera, points_m):
    """Pixels of points, (n, 2), and their derivatives to the error state, (2 n, 15)."""
    seen = (points_m - position) @ moon_from_camera  # in camera axes
    x, y, z = seen.T
    pixels = camera.pixels(seen)
    by_seen = np.zeros((len(seen), 2, 3))
    by_seen[:, 0, 0], by_seen[:, 0, 2] = camera.focal / z, -camera.focal * x / z**2
    by_seen[:, 1, 1], by_seen[:, 1, 2] = camera.focal / z, -camera.focal * y / z**2
    jacobian = np.zeros((len(seen), 2, SIZE))
    jacobian[..., POSITION] = -by_seen @ moon_from_camera.T
    # true = estimate rotation(e): seen = rotation(-e) seen0, so that d seen / d e = [seen]x
    crosses = np.zeros((len(seen), 3, 3))
    crosses[:, 0, 1], crosses[:, 0, 2], crosses[:, 1, 2] = -z, y, -x
    crosses -= crosses.transpose(0, 2, 1).copy()
    jacobian[..., ATTITUDE] = by_seen @ crosses
    return pixels, jacobian.reshape(-1, SIZE)
