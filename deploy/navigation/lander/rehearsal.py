"""What planners can know before flight: how far matches of the map are off together, and over what distance.

Frames of the nominal descent are rendered under a Sun that is neither the flight's nor the map's and matched at their
known poses. A shift of the lander that fits all matches of a frame is its offset. What the offsets have beyond the
scatter of single matches is the map's bias (filter.MapError).
"""

import numpy as np

from .descent import east_north_up
from .filter import POSITION, Filter, MapError, projected
from .matcher import Matcher

BANDS = 8  # of distance from the Moon's centre, with as many frames each


def other_sun(scenario):
    """As far from the map's Sun as the flight's is, but to the other side of its azimuth."""
    flight, of_map = scenario.flight_sun["local"], scenario.map_sun["local"]
    azimuth_deg = (2 * of_map["azimuth_deg"] - flight["azimuth_deg"]) % 360
    return {**scenario.flight_sun, "local": {**flight, "azimuth_deg": azimuth_deg}}


def offset(camera, position, moon_from_camera, points_m, pixels, sigmas_px):
    """The shift (east, north, up) of a camera that fits the pixels, and its covariance by the matches' scatter."""
    axes, shift, weights = east_north_up(position), np.zeros(3), np.tile(1 / sigmas_px, len(pixels))
    for _ in range(3):
        predicted, jacobian = projected(camera, position + axes @ shift, moon_from_camera, points_m)
        jacobian = weights[:, None] * jacobian[:, POSITION] @ axes
        covariance = np.linalg.inv(jacobian.T @ jacobian)
        shift = shift + covariance @ (jacobian.T @ (weights * (pixels - predicted).ravel()))
    return shift, covariance


def offsets(truth, onboard, imu, detector, seed=0):
    """Of each frame with matches: distance along the track, radius, shift and its own variances; (n, 8)."""
    random, rows = np.random.default_rng(seed), []
    track_m = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(truth.positions, axis=0), axis=1))])
    matcher = Matcher(truth.scenario.camera, onboard, truth.scenario.frame_step_s)
    for i, frame in enumerate(truth.frames):
        pose = truth.positions[i], truth.attitudes[i]
        state = Filter(pose[0], truth.velocities[i], pose[1], np.zeros(3), imu)
        image = detector.image(frame, truth.whites[i], random)
        level, factor = matcher.working_scale(matcher.altitude_m(state))
        found = matcher.fine(state, image, level, factor, matcher.reach_px(state, 0.0, level, factor))
        if found is not None:
            shift, covariance = offset(truth.scenario.camera, *pose, found.points_m, found.pixels, found.sigmas_px)
            rows.append([track_m[i], np.linalg.norm(pose[0]), *shift, *np.diag(covariance)])
    return np.array(rows)


def map_error(rows):
    rows = rows[np.argsort(rows[:, 1])]
    bands = np.array_split(rows, BANDS)
    radii = np.array([band[:, 1].mean() for band in bands])
    sigmas = np.array([np.sqrt(np.maximum(np.mean(band[:, 2:5] ** 2 - band[:, 5:8], axis=0), 0)) for band in bands])
    return MapError(radii, sigmas, correlation_length(rows))


def correlation_length(rows):
    """Of exp(-distance / length) that fits the products of the shifts, normalised by band, of all pairs of frames."""
    normal = np.concatenate([band[:, 2:5] / np.sqrt(np.mean(band[:, 2:5] ** 2, axis=0))
                             for band in np.array_split(rows, BANDS)])
    apart_m = np.abs(rows[:, None, 0] - rows[None, :, 0])
    pairs = (apart_m > 0) & (apart_m < 50e3)
    products = np.mean(normal[:, None] * normal[None], axis=2)[pairs]
    lengths = np.geomspace(100, 100e3, 61)
    misfits = [np.mean((products - np.exp(-apart_m[pairs] / length)) ** 2) for length in lengths]
    return float(lengths[np.argmin(misfits)])
