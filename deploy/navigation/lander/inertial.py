"""An inertial measurement unit: exact increments of the truth, and the errors of a real one."""

import dataclasses

import numpy as np

from .descent import MOON_RATE_RAD_S, rotation, rotation_vector


@dataclasses.dataclass(frozen=True)
class Imu:
    """1-sigma figures of a tactical-grade unit, of the order of the LN-200S's data sheet."""

    accelerometer_bias_m_s2: float = 300e-6 * 9.80665
    accelerometer_noise_m_s2_rthz: float = 35e-6 * 9.80665
    gyro_bias_rad_s: float = np.radians(1.0) / 3600
    gyro_noise_rad_rts: float = np.radians(0.07) / 60


def exact_increments(descent, times_s):
    """What an ideal strapdown unit integrates between the times: velocity in axes of the interval's middle, and angles.

    Gauss' rule of two points integrates the specific force.
    """
    velocity, angle = [], []
    for start, end in zip(times_s[:-1], times_s[1:]):
        step, middle = end - start, 0.5 * (start + end)
        camera_from_moon = descent.moon_from_camera(middle).T
        points = (middle - step / np.sqrt(12), middle + step / np.sqrt(12))
        velocity.append(camera_from_moon @ sum(descent.specific_force(t) for t in points) * (0.5 * step))
        # The inertial rotation: the Moon-fixed one after the Moon's own.
        inertial_from_moon = rotation(MOON_RATE_RAD_S * step)
        angle.append(rotation_vector(descent.moon_from_camera(start).T @ inertial_from_moon
                                     @ descent.moon_from_camera(end)))
    return np.array(velocity), np.array(angle)


def measured(imu, increments, times_s, random):
    """With constant biases and white noise; returns (velocity, angle, accelerometer bias, gyro bias)."""
    velocity, angle = increments
    step = np.diff(times_s)[:, None]
    bias = random.normal(0, imu.accelerometer_bias_m_s2, 3)
    drift = random.normal(0, imu.gyro_bias_rad_s, 3)
    root = np.sqrt(step)
    velocity = velocity + bias * step + random.normal(0, imu.accelerometer_noise_m_s2_rthz, velocity.shape) * root
    angle = angle + drift * step + random.normal(0, imu.gyro_noise_rad_rts, angle.shape) * root
    return velocity, angle, bias, drift
