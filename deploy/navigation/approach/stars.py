"""Attitude from stars: centroids in an image, and the rotation that fits them best (Wahba's problem)."""

import numpy as np


def centroids(image, expected, half=3):
    """Returns the centroids of stars near their expected pixels, (n, 2); NaN where no star stands out."""
    found = np.full((len(expected), 2), np.nan)
    offsets = np.arange(-half, half + 1)
    noise = 1.4826 * np.median(np.abs(image - np.median(image))) + 1e-12
    for i, (x, y) in enumerate(np.round(expected).astype(int)):
        if not (2 * half <= x < image.shape[1] - 2 * half and 2 * half <= y < image.shape[0] - 2 * half):
            continue
        # The expected place is off by the attitude's error: centre the window on the brightest pixel near it.
        near = image[y - half:y + half + 1, x - half:x + half + 1]
        dy, dx = np.unravel_index(np.argmax(near), near.shape)
        x, y = x + dx - half, y + dy - half
        window = image[y - half:y + half + 1, x - half:x + half + 1]
        around = np.concatenate([window[0], window[-1], window[:, 0], window[:, -1]])
        light = np.clip(window - np.median(around), 0, None)
        light[light < 3 * noise] = 0
        if light.sum() < 30 * noise:
            continue
        found[i] = [x + (light.sum(0) @ offsets) / light.sum(), y + (light.sum(1) @ offsets) / light.sum()]
    return found


def attitude(seen, directions):
    """Returns the rotation from the directions' axes into the camera's (Markley 1988), for unit vectors in rows."""
    u, _, vt = np.linalg.svd(seen.T @ directions)
    return u @ np.diag([1, 1, np.linalg.det(u) * np.linalg.det(vt)]) @ vt


def agreeing(seen, directions, bound):
    """Returns flags of the stars that one rotation fits to `bound` radians: of the rotations by each pair of stars, the
    one with which most others agree (Fischler & Bolles 1981; all pairs are tried, so that the result is not random)."""
    best = np.zeros(len(seen), dtype=bool)
    among_seen, among_known = (np.arccos(np.clip(u @ u.T, -1, 1)) for u in (seen, directions))
    # A false star is at a wrong angle from the others in any attitude: skip its pairs.
    for i, j in np.argwhere(np.triu(np.abs(among_seen - among_known) < 2 * bound, 1)):
        turn = attitude(seen[[i, j]], directions[[i, j]])
        fits = np.linalg.norm(seen - directions @ turn.T, axis=1) < bound
        if fits.sum() > best.sum():
            best = fits
    return best


def solved(image, camera, objects, camera_from_axes, within_px=0.7, least_sigma_px=0.03):
    """Returns camera_from_axes, corrected by the stars that /v1/sky lists for it, and the number used. A bright pixel,
    or a star that the list lacks, may lie near where one is expected: only stars that agree within `within_px` are
    used, and of those the ones within 3 sigma of the fit. With fewer than 3 camera_from_axes stays."""
    places = np.array([[o["x_px"], o["y_px"]] for o in objects], dtype=float).reshape(-1, 2)
    directions = np.array([o["direction_icrf"] for o in objects], dtype=float).reshape(-1, 3)
    found = centroids(image, places)
    seen = np.isfinite(found).all(1)
    rays, directions = camera.rays(found[seen, 0], found[seen, 1]), directions[seen]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    use = agreeing(rays, directions, within_px / camera.focal)
    turn = camera_from_axes
    for _ in range(3):
        if use.sum() < 3:
            return camera_from_axes, int(use.sum())
        turn = attitude(rays[use], directions[use])
        off = np.linalg.norm(rays - directions @ turn.T, axis=1)
        # Of two errors, to the right and down: the median of their length is 1.18 sigma.
        sigma = max(np.median(off[use]) / 1.18, least_sigma_px / camera.focal)
        use = off < min(3 * sigma, within_px / camera.focal)
    return turn, int(use.sum())
