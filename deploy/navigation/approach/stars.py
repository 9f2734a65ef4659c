"""Attitude from stars: centroids in an image, and the rotation that fits them best (Wahba's problem)."""

import numpy as np


def centroids(image, expected, half=3):
    """Of stars near where they are expected, (n, 2) pixels; NaN where none stands out."""
    found = np.full((len(expected), 2), np.nan)
    offsets = np.arange(-half, half + 1)
    noise = 1.4826 * np.median(np.abs(image - np.median(image))) + 1e-12
    for i, (x, y) in enumerate(np.round(expected).astype(int)):
        if not (2 * half <= x < image.shape[1] - 2 * half and 2 * half <= y < image.shape[0] - 2 * half):
            continue
        # The expected place is off by the attitude's error: the brightest pixel near it is the middle.
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
    """The rotation from the directions' axes into the camera's (Markley 1988), of unit vectors in rows."""
    u, _, vt = np.linalg.svd(seen.T @ directions)
    return u @ np.diag([1, 1, np.linalg.det(u) * np.linalg.det(vt)]) @ vt


def solved(image, camera, objects, camera_from_axes):
    """camera_from_axes, corrected by the stars that /v1/sky lists for it; and how many were used."""
    places = np.array([[o["x_px"], o["y_px"]] for o in objects], dtype=float).reshape(-1, 2)
    directions = np.array([o["direction_icrf"] for o in objects], dtype=float).reshape(-1, 3)
    found = centroids(image, places)
    use = np.isfinite(found).all(1)
    if use.sum() < 3:
        return camera_from_axes, int(use.sum())
    rays = camera.rays(found[use, 0], found[use, 1])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return attitude(rays, directions[use]), int(use.sum())
