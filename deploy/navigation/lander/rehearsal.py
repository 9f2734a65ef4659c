"""What planners can know before flight: how far matches of the map are off together, and over what distance.

Frames of the nominal descent are rendered under a Sun that is neither the flight's nor the map's and matched at their
known poses. A shift of the lander that fits all matches of a frame is its offset. What offsets have in common over some
distance is the map's bias; the rest is noise of the matches (filter.MapError).
"""

import numpy as np

from .descent import east_north_up
from .filter import ATTITUDE, POSITION, Filter, MapError, projected
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


def tilt(camera, position, moon_from_camera, points_m, pixels, sigmas_px):
    """The rotation that fits the pixels together with a shift; made white: of variance 1 for independent matches."""
    weights = np.tile(1 / sigmas_px, len(pixels))
    predicted, jacobian = projected(camera, position, moon_from_camera, points_m)
    scale = np.linalg.norm(points_m.mean(axis=0) - position)  # so that angles are of the size of shifts
    jacobian = weights[:, None] * np.hstack([jacobian[:, POSITION], jacobian[:, ATTITUDE] / scale])
    root = np.linalg.cholesky(jacobian.T @ jacobian)
    return np.linalg.solve(root, jacobian.T @ (weights * (pixels - predicted).ravel()))[3:]


def offsets(truth, onboard, imu, detector, seed=0):
    """Of each frame with matches: distance along the track, radius, shift and its own variances, white tilt, number of
    the frame; (n, 12)."""
    random, rows = np.random.default_rng(seed), []
    track_m = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(truth.positions, axis=0), axis=1))])
    matcher = Matcher(truth.scenario.camera, onboard)
    for i, frame in enumerate(truth.frames):
        pose = truth.positions[i], truth.attitudes[i]
        state = Filter(pose[0], truth.velocities[i], pose[1], np.zeros(3), imu)
        image = detector.image(frame, truth.whites[i], random)
        level, factor = matcher.working_scale(state)
        found = matcher.fine(state, image, level, factor, matcher.reach_px(state, 0.0, level, factor))
        if found is not None:
            matches = found.points_m, found.pixels, found.sigmas_px
            shift, covariance = offset(truth.scenario.camera, *pose, *matches)
            rows.append([track_m[i], np.linalg.norm(pose[0]), *shift, *np.diag(covariance),
                         *tilt(truth.scenario.camera, *pose, *matches), i])
    return np.array(rows)


def map_error(rows, draws=None):
    """draws: number of the map that each row's frame was matched to, where there were several.

    The variance of the shifts is that of the bias, a share of it, and of the matches' noise. The latter is compared
    with the variance that their scatter lets expect. The filter takes noise as new in each frame, but frames of the same
    ground have some of it in common: its variance grows by the sum of its correlations, which tilts show without bias.
    """
    order = np.argsort(rows[:, 1])
    rows, draws = rows[order], (np.zeros(len(rows)) if draws is None else draws[order])
    bands = np.array_split(rows, BANDS)
    variances = np.array([np.mean(band[:, 2:5] ** 2, axis=0) for band in bands])
    expected = np.array([np.mean(band[:, 5:8], axis=0) for band in bands])
    share, length_m = correlation(rows, np.concatenate([band[:, 2:5] / np.sqrt(variance)
                                                        for band, variance in zip(bands, variances)]), draws)
    radii_m = np.array([band[:, 1].mean() for band in bands])
    repeats = np.array([sum_of_correlations(band[:, 11], band[:, 8:11], of_band)
                        for band, of_band in zip(bands, np.array_split(draws, BANDS))])
    excess = np.sqrt(repeats * np.maximum(np.mean((1 - share) * variances / expected, axis=1), 1))
    return MapError(radii_m, np.sqrt(share * variances), length_m, excess)


def sum_of_correlations(frames, values, draws=0):
    """Over all lags to both sides, until they vanish: by how much a mean of many frames is more uncertain."""
    products = np.mean(values[:, None] * values[None], axis=2)
    draws = np.broadcast_to(draws, frames.shape)
    lags = np.where(draws[:, None] == draws[None, :], frames[:, None] - frames[None, :], np.nan)
    total, variance = 1.0, np.mean(values**2)
    for lag in range(1, len(frames) // 2):
        pairs = lags == lag
        correlation = products[pairs].mean() / variance if pairs.any() else 0.0
        if correlation <= 0:
            break
        total += 2 * correlation
    return total


def correlation(rows, shifts, draws):
    """share * exp(-distance / length) that fits the mean products of the shifts (of variance 1) by distance."""
    apart_m = np.abs(rows[:, None, 0] - rows[None, :, 0])
    apart_m[draws[:, None] != draws[None, :]] = np.inf  # errors of two maps have nothing in common
    products = np.mean(shifts[:, None] * shifts[None], axis=2)
    edges_m = np.geomspace(300, 100e3, 13)
    bins = np.digitize(apart_m, edges_m)
    filled = [k for k in range(1, len(edges_m)) if (bins == k).sum() > 20]
    distance_m = np.array([apart_m[bins == k].mean() for k in filled])
    means = np.array([products[bins == k].mean() for k in filled])
    best = None
    for length_m in np.geomspace(300, 100e3, 61):
        curve = np.exp(-distance_m / length_m)
        share = float(np.clip(curve @ means / (curve @ curve), 0, 1))
        misfit = np.mean((means - share * curve) ** 2)
        if best is None or misfit < best[0]:
            best = misfit, share, float(length_m)
    return best[1:]
