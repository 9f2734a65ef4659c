"""Where the Moon is, from points of its limb: a sub-pixel edge detector and the fit of Christian and Robinson."""

import cv2
import numpy as np

from lander.descent import MOON_RADIUS_M as RADIUS_M  # of the sphere that /v1/limb compares with


def sides(toward):
    """Returns two unit vectors across a direction, camera axes. /v1/limb counts azimuths from one to the other."""
    axis = np.cross([0.0, 0.0, 1.0], toward)
    sine, cosine = np.linalg.norm(axis), toward[2]
    if sine < 1e-12:
        return np.eye(3)[0], np.eye(3)[1]
    turn, _ = cv2.Rodrigues(axis / sine * np.arctan2(sine, cosine))
    return turn[:, 0], turn[:, 1]


def across(moon_m, azimuths):
    """Returns unit vectors in camera axes: toward the Moon's centre and, for each azimuth, across that direction."""
    toward = moon_m / np.linalg.norm(moon_m)
    right, down = sides(toward)
    return toward, np.cos(azimuths)[:, None] * right + np.sin(azimuths)[:, None] * down


def edges(image, camera, moon_m, sun, azimuths, reach_px=12.0):
    """Returns the angles, radians, from the estimated direction to the Moon's centre (camera axes) to the edge in the
    image at each azimuth; NaN where no edge is lit, in the image and clear.

    Along each radius the edge is where the image crosses the brightness that a step there would have after the image's
    blur, which is about half of what is just inside. Toward the limb that rises with falling mu, the cosine of the
    emission angle: mu0 / (mu0 + mu) by Lommel and Seeliger, which is steepest at the limb itself, since mu grows with
    the root of the depth. It is taken as linear in mu. (Linear in the depth, half of it finds edges 0.03 pixels too far
    out.)"""
    toward, aside = across(moon_m, azimuths)
    sphere = np.arcsin(RADIUS_M / np.linalg.norm(moon_m))
    along_px = np.arange(-reach_px, reach_px + 0.125, 0.25)
    angles = sphere + along_px / camera.focal * np.cos(sphere) ** 2
    rays = np.cos(angles)[None, :, None] * toward + np.sin(angles)[None, :, None] * aside[:, None, :]
    seen = camera.pixels(rays.reshape(-1, 3)).astype(np.float32).reshape(len(azimuths), len(angles), 2)
    inside = ((seen >= 2) & (seen <= camera.side - 3)).all(axis=(1, 2))
    values = cv2.remap(image, seen[..., 0], seen[..., 1], cv2.INTER_LINEAR)
    lit, blur_px = np.flatnonzero(inside & (aside @ sun > 0.15)), 0.75
    places = np.full(len(azimuths), np.nan)
    # The steepness of the edges gives the image's blur, with which they are located once more.
    for _ in range(2):
        if len(lit) == 0:
            break
        places[lit], steepness = _crossings(along_px, values[lit].astype(float), image.max(),
                                            camera.focal * np.tan(sphere), blur_px)
        if np.isfinite(steepness).sum() < 5:
            break
        blur_px = 1 / (np.sqrt(2 * np.pi) * np.nanmedian(steepness))
    return np.interp(places, along_px, angles)


# Depths within a blurred edge, in its standard deviations, and their share of what the edge's place itself gets.
_DEPTHS = (np.arange(40) + 0.5) / 10
_SHARES = np.exp(-0.5 * _DEPTHS**2) / np.exp(-0.5 * _DEPTHS**2).sum()


def _last(flags):
    """Returns the index of the last true flag of each row; the row's last index if there is none."""
    return flags.shape[1] - 1 - np.argmax(flags[:, ::-1], axis=1)


def _crossings(along_px, profiles, brightest, radius_px, blur_px):
    """Returns where profiles, one a row, cross the edge's brightness, and the steepness there, per pixel and relative
    to the brightness inside; NaN where no edge is clear."""
    def mu(depth_px):
        return np.sqrt(np.clip(1 - (1 - depth_px / radius_px) ** 2, 0, 1))

    rows, step, past = np.arange(len(profiles)), along_px[1] - along_px[0], len(along_px) - 1
    light = profiles - np.median(profiles[:, -8:], axis=1)[:, None]
    top = light.max(1)
    edge = along_px[_last(light > 0.3 * top[:, None])]
    clear = top >= 0.05 * brightest
    for _ in range(2):
        depth = edge[:, None] - along_px
        within = (depth > 2.5 * blur_px) & (depth < 2.5 * blur_px + 5)
        count = within.sum(1)
        clear &= (count >= 8) & (edge <= along_px[-9])
        with np.errstate(divide="ignore", invalid="ignore"):
            at, inside = np.where(within, mu(depth), 0), np.where(within, light, 0)
            mean_at, mean_inside = at.sum(1) / count, inside.sum(1) / count
            slope = ((at * inside).sum(1) - count * mean_at * mean_inside) / ((at**2).sum(1) - count * mean_at**2)
            level = mean_inside + slope * (_SHARES @ mu(_DEPTHS * blur_px) - mean_at)
            last = _last(light > 0.5 * level[:, None])
            clear &= last < past
            last = np.minimum(last, past - 1)
            share = (light[rows, last] - 0.5 * level) / (light[rows, last] - light[rows, last + 1])
            edge = np.where(clear, along_px[last] + share * step, along_px[0])

    def seen(x_px):
        cell = np.clip((x_px - along_px[0]) / step, 0, past - 1e-9)
        low = cell.astype(int)
        return light[rows, low] + (cell - low) * (light[rows, low + 1] - light[rows, low])

    steepness = (seen(edge - 0.5) - seen(edge + 0.5)) / level
    return np.where(clear, edge, np.nan), np.where(clear, steepness, np.nan)


def fit(moon_m, azimuths, angles, sigma_rad):
    """Returns the Moon's centre in camera axes, m, from angles of its limb around a direction that need not be exact,
    and its covariance for errors of sigma_rad in each angle. Horizon points of a sphere lie in a plane: unit vectors s
    with n . s = 1 (Christian & Robinson 2016, Noniterative Horizon-Based Optical Navigation by Cholesky
    Factorization)."""
    toward, aside = across(moon_m, azimuths)
    points = np.cos(angles)[:, None] * toward + np.sin(angles)[:, None] * aside
    outward = np.cos(angles)[:, None] * aside - np.sin(angles)[:, None] * toward
    normal, *_ = np.linalg.lstsq(points, np.ones(len(points)), rcond=None)
    square = normal @ normal - 1
    solved = np.linalg.pinv(points) * (sigma_rad * (outward @ normal))
    jacobian = RADIUS_M * (np.eye(3) / np.sqrt(square) - np.outer(normal, normal) / square**1.5)
    return RADIUS_M * normal / np.sqrt(square), jacobian @ solved @ solved.T @ jacobian.T


def angles_of(moon_m, around_m, azimuths):
    """Returns the angles, radians, at which radii around a direction other than the centre's meet a sphere's limb."""
    toward, aside = across(around_m, azimuths)
    # cos(t) a + sin(t) b = c
    a, b = moon_m @ toward, aside @ moon_m
    c = np.sqrt(moon_m @ moon_m - RADIUS_M**2)
    return np.arctan2(b, a) + np.arccos(np.clip(c / np.hypot(a, b), -1, 1))
