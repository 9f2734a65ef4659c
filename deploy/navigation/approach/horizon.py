"""Where the Moon is, from points of its limb: a sub-pixel edge detector and the fit of Christian and Robinson."""

import cv2
import numpy as np

RADIUS_M = 1737400.0  # of the sphere that /v1/limb compares with


def sides(toward):
    """Unit vectors across a direction, as /v1/limb counts azimuths: from the first to the second. Camera axes."""
    axis = np.cross([0.0, 0.0, 1.0], toward)
    sine, cosine = np.linalg.norm(axis), toward[2]
    if sine < 1e-12:
        return np.eye(3)[0], np.eye(3)[1]
    turn, _ = cv2.Rodrigues(axis / sine * np.arctan2(sine, cosine))
    return turn[:, 0], turn[:, 1]


def across(moon_m, azimuths):
    """The direction to the Moon's centre and, for each azimuth around it, the one across; unit, camera axes."""
    toward = moon_m / np.linalg.norm(moon_m)
    right, down = sides(toward)
    return toward, np.cos(azimuths)[:, None] * right + np.sin(azimuths)[:, None] * down


def edges(image, camera, moon_m, sun, azimuths, reach_px=12.0):
    """Angles from the direction to the Moon's centre, as it is believed to be (camera axes), to the edge that the image
    shows at each azimuth; NaN where none is lit, in the image and clear. radians

    Along each radius the edge is where the image crosses half of what it is just inside. A point spread that is
    symmetric moves it by little, since the limb's brightness is nearly constant over a few pixels."""
    toward, aside = across(moon_m, azimuths)
    sphere = np.arcsin(RADIUS_M / np.linalg.norm(moon_m))
    along_px = np.arange(-reach_px, reach_px + 0.125, 0.25)
    angles = sphere + along_px / camera.focal * np.cos(sphere) ** 2
    rays = np.cos(angles)[None, :, None] * toward + np.sin(angles)[None, :, None] * aside[:, None, :]
    seen = camera.pixels(rays.reshape(-1, 3)).astype(np.float32).reshape(len(azimuths), len(angles), 2)
    inside = ((seen >= 2) & (seen <= camera.side - 3)).all(axis=(1, 2))
    values = cv2.remap(image, seen[..., 0], seen[..., 1], cv2.INTER_LINEAR)
    found = np.full(len(azimuths), np.nan)
    for i in np.flatnonzero(inside & (aside @ sun > 0.15)):
        found[i] = _crossing(along_px, angles, values[i], image.max())
    return found


def _crossing(along_px, angles, profile, brightest):
    sky = np.median(profile[-8:])
    rise = np.flatnonzero(profile > sky + 0.2 * (np.max(profile) - sky))
    if len(rise) == 0 or profile.max() - sky < 0.05 * brightest:
        return np.nan
    rough = along_px[rise[-1]]
    within = (along_px < rough - 1.5) & (along_px > rough - 5.5)
    if within.sum() < 8 or rough > along_px[-9]:
        return np.nan
    slope, level = np.polyfit(along_px[within] - rough, profile[within], 1)
    half = sky + 0.5 * (level - 0.5 * slope - sky)
    above = np.flatnonzero(profile > half)[-1]
    if above + 1 >= len(profile):
        return np.nan
    share = (profile[above] - half) / (profile[above] - profile[above + 1])
    return angles[above] + share * (angles[above + 1] - angles[above])


def fit(moon_m, azimuths, angles, sigma_rad):
    """The Moon's centre in camera axes, m, from angles of its limb around a direction that need not be exact; and the
    covariance of errors of sigma_rad in each angle. Horizon points of a sphere lie in a plane: unit vectors s with
    n . s = 1 (Christian & Robinson 2016, Noniterative Horizon-Based Optical Navigation by Cholesky Factorization)."""
    toward, aside = across(moon_m, azimuths)
    points = np.cos(angles)[:, None] * toward + np.sin(angles)[:, None] * aside
    outward = np.cos(angles)[:, None] * aside - np.sin(angles)[:, None] * toward
    normal, *_ = np.linalg.lstsq(points, np.ones(len(points)), rcond=None)
    square = normal @ normal - 1
    solved = np.linalg.pinv(points) * (sigma_rad * (outward @ normal))
    jacobian = RADIUS_M * (np.eye(3) / np.sqrt(square) - np.outer(normal, normal) / square**1.5)
    return RADIUS_M * normal / np.sqrt(square), jacobian @ solved @ solved.T @ jacobian.T


def angles_of(moon_m, around_m, azimuths):
    """Of a sphere's limb around a direction that isn't its centre's: where each radius meets it. radians"""
    toward, aside = across(around_m, azimuths)
    # cos(t) a + sin(t) b = c
    a, b = moon_m @ toward, aside @ moon_m
    c = np.sqrt(moon_m @ moon_m - RADIUS_M**2)
    return np.arctan2(b, a) + np.arccos(np.clip(c / np.hypot(a, b), -1, 1))
