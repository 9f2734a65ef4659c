"""Tie points of a photograph and a frame of the same view, and the view fitted to them."""

import cv2
import numpy as np
from scipy import ndimage, optimize
from scipy.spatial.transform import Rotation

from terrain_service import MOON_RADIUS_M, Unusable

# Parameters of a view that its fit may change, and how many numbers each has. A turn is always fitted.
PARAMETERS = {"turn": 3, "position": 3, "focal_length": 1, "aspect": 1, "principal_point": 2, "k1": 1}


def locally_normalised(image, sigma_px):
    """(value - local mean) / local deviation: images of one scene by films of different response become comparable."""
    difference = image - ndimage.gaussian_filter(image, sigma_px)
    return difference / np.sqrt(ndimage.gaussian_filter(difference ** 2, sigma_px) + 1e-12)


class Ties:
    """Windows of the frame that are found in the photograph, each within search_px of its own position."""

    def __init__(self, photograph, frame, search_px):
        height, width = photograph.shape
        side = min(width, height)
        half, step = round(side / 20), max(1, round(side / 25))
        border = half + search_px
        # The root compresses bright slopes as film does, so that windows do not follow their brightest pixels alone.
        expected, observed = (locally_normalised(image, side / 33).astype(np.float32)
                              for image in (np.sqrt(np.maximum(frame.radiance, 0)), photograph))
        found_px, ground_m, held_out = [], [], []
        for row, y in enumerate(range(border, height - border if half >= 3 else 0, step)):
            for column, x in enumerate(range(border, width - border, step)):
                window = np.s_[y - half:y + half + 1, x - half:x + half + 1]
                if not frame.ground[y, x] or frame.ground[window].mean() < 0.98:
                    continue
                peak = peak_of(cv2.matchTemplate(observed[y - border:y + border + 1, x - border:x + border + 1],
                                                 expected[window], cv2.TM_CCOEFF_NORMED).astype(float))
                if peak:
                    found_px.append([x - search_px + peak[0], y - search_px + peak[1]])
                    ground_m.append(frame.position_m[y, x])
                    held_out.append((row + column) % 2 == 1)  # one colour of a chessboard
        self.found_px, self.ground_m = np.reshape(found_px, (-1, 2)), np.reshape(ground_m, (-1, 3))
        self.held_out = np.array(held_out, bool)

    def residuals_px(self, service, view, chosen):
        """Projected ground minus photograph; 0 for ground that the view does not image."""
        if not chosen.any():
            return np.empty((0, 2))
        ground_m = self.ground_m[chosen]
        range_m = np.linalg.norm(ground_m, axis=1)
        degrees = np.degrees([np.arcsin(ground_m[:, 2] / range_m), np.arctan2(ground_m[:, 1], ground_m[:, 0])]).T
        points = [{"lat_deg": lat, "lon_deg": lon, "height_m": height}
                  for (lat, lon), height in zip(degrees, range_m - MOON_RADIUS_M)]
        answer = service.json("/v1/project", {**view, "points": points}, "ties")["points"]
        return np.nan_to_num(np.array([[p["x_px"], p["y_px"]] for p in answer], float) - self.found_px[chosen])

    def held_out_px(self, service, view):
        return np.linalg.norm(self.residuals_px(service, view, self.held_out), axis=1)


def peak_of(correlations):
    """(column, row) of the maximum by a parabola; None if it is weak or on the border of the search."""
    row, column = np.unravel_index(correlations.argmax(), correlations.shape)
    last = correlations.shape[0] - 1
    if correlations[row, column] < 0.45 or not (0 < row < last and 0 < column < last):
        return None

    def vertex(before, middle, after):
        return (after - before) / (2 * (2 * middle - after - before))

    return (column + vertex(*correlations[row, column - 1:column + 2]),
            row + vertex(*correlations[row - 1:row + 2, column]))


def moved(view, named):
    """The view with changed parameters, in units in which a pixel's change is of the order of one."""
    pose, camera = view["pose"], {**view["camera"]}
    turn = Rotation.from_rotvec(1e-3 * named["turn"]) * Rotation.from_matrix(pose["camera_from_moon_matrix"])
    position_m = np.array(pose["position_m"]) + 1e3 * named.get("position", 0)
    focal_length, aspect, k1 = (named.get(name, [0])[0] for name in ("focal_length", "aspect", "k1"))
    camera["fx"] *= 1 + 1e-3 * focal_length
    camera["fy"] *= (1 + 1e-3 * focal_length) * (1 + 1e-3 * aspect)
    if "principal_point" in named:
        camera["cx"], camera["cy"] = np.array([camera["cx"], camera["cy"]]) + named["principal_point"]
    if "k1" in named:
        camera["distortion"] = {**camera["distortion"], "k1": camera["distortion"]["k1"] + 1e-3 * k1}
    return {"camera": camera, "pose": {"position_m": position_m.tolist(),
                                       "camera_from_moon_matrix": turn.as_matrix().tolist()}}


def fitted_view(service, view, free, ties):
    """The view fitted to the ties that are not held out, with a robust loss against false ones.

    The position is bound to its start with 300 m, the principal point with 1.5 px."""
    if (~ties.held_out).sum() < 8:
        raise Unusable("fewer than 8 tie points: the view is too far off")
    names = [name for name in PARAMETERS if name == "turn" or name in free]
    ends = np.cumsum([PARAMETERS[name] for name in names])

    def named(q):
        return dict(zip(names, np.split(q, ends[:-1])))

    def residuals(q):
        bonds = named(q)
        return np.r_[ties.residuals_px(service, moved(view, named(q)), ~ties.held_out).ravel(),
                     np.ravel(bonds.get("position", [])) / 0.3, np.ravel(bonds.get("principal_point", [])) / 1.5]

    found = optimize.least_squares(residuals, np.zeros(ends[-1]), loss="soft_l1", f_scale=0.5)
    return moved(view, named(found.x))
