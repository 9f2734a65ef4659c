"""Map-relative matching: map patches warped to the predicted view, normalised correlation, coarse then fine.

The method of the Lander Vision System of Mars 2020 (Johnson et al., AIAA SciTech 2022). No constant here comes from the
truth: search radii follow from the filter's covariance, the noise of the matches from their own scatter.
"""

import dataclasses

import cv2
import numpy as np

from .camera import averaged
from .descent import MOON_RADIUS_M
from .filter import projected

# Pixels between exact ray intersections; between them the warp is bilinear, a plane for each cell. Over the sample
# terrain the estimated height is 1 to 2 m too large with cells of 8 pixels, and 0.5 m with cells of 4.
CELL = 4
PATCH = 32  # greatest side of the fine patches, pixels
LEAST_CORRELATION = 0.5  # of a fine match
LEAST_MATCHES = 6  # for an update of the filter
LEAST_POSTS = 4  # least side of a fine patch in posts of the map: with less detail it matches anywhere
MANY_MATCHES = 50  # number of matches from which their scatter is taken as the map's
CONFIRMING = 0.25  # share of the patches tried that must match for the fine search to confirm the coarse one
WIDEST = 12  # greatest reach of the fine search, pixels
COARSE_SIGMAS = 4.0  # reach of the coarse search in standard deviations: one in 100 flights begins beyond 3


@dataclasses.dataclass
class Matches:
    """Points of the map and the pixels of the frame at which they were found."""

    points_m: np.ndarray  # positions on the map, (n, 3)
    pixels: np.ndarray  # positions in the full frame, (n, 2)
    sigmas_px: np.ndarray  # standard deviations of one match in x and y
    counted_px: np.ndarray  # the same as the filter takes them, larger where matches of a frame are not independent
    stage: str  # "coarse" or "fine"
    tried: int = 0  # number of patches with enough contrast


class View:
    """The map's image as a camera at a pose sees it, with a margin of pixels around the frame."""

    def __init__(self, level, camera, position, moon_from_camera, margin):
        self.margin = margin
        cells = -(-(camera.side + 2 * margin) // CELL) + 1
        axis = np.arange(cells) * float(CELL) - margin
        x, y = np.meshgrid(axis, axis)
        self._points, column, row = level.ground(position, camera.rays(x, y) @ moon_from_camera.T)
        inside = level.holds(column, row)
        side = camera.side + 2 * margin
        # warpAffine keeps the cells' corners where they are; resize() would move them by half a cell.
        scale = np.float32([[CELL, 0, 0], [0, CELL, 0]])

        def spread(values):
            return cv2.warpAffine(np.nan_to_num(values).astype(np.float32), scale, (side, side), flags=cv2.INTER_LINEAR,
                                  borderMode=cv2.BORDER_REPLICATE)

        self.image = cv2.remap(level.radiance, spread(column), spread(row), cv2.INTER_LINEAR)
        self.valid = np.full((side, side), True) if inside.all() else spread(inside.astype(np.float32)) > 0.999

    def points(self, x, y):
        """Returns the map's points at pixels of the frame, interpolated between the rays."""
        column, row = ((np.asarray(v, np.float32) + self.margin) / CELL for v in (x, y))
        return np.stack([_interpolated(self._points[..., i], column, row) for i in range(3)], axis=-1)


def _interpolated(values, column, row):
    """Interpolates bilinearly in double precision: float32 resolves Moon-centred coordinates to 0.1 m only."""
    i = np.clip(np.floor(row).astype(int), 0, values.shape[0] - 2)
    j = np.clip(np.floor(column).astype(int), 0, values.shape[1] - 2)
    a, b = row - i, column - j
    return ((1 - a) * ((1 - b) * values[i, j] + b * values[i, j + 1])
            + a * ((1 - b) * values[i + 1, j] + b * values[i + 1, j + 1]))


def peak(scores):
    """Returns x, y and score of the maximum, refined by a parabola on each axis; None for a maximum at the border."""
    y, x = np.unravel_index(int(np.argmax(scores)), scores.shape)
    if not (0 < y < scores.shape[0] - 1 and 0 < x < scores.shape[1] - 1):
        return None
    best = float(scores[y, x])
    curve_x = 2 * best - scores[y, x - 1] - scores[y, x + 1]
    curve_y = 2 * best - scores[y - 1, x] - scores[y + 1, x]
    if curve_x <= 0 or curve_y <= 0:
        return None
    return (x + 0.5 * (scores[y, x + 1] - scores[y, x - 1]) / curve_x,
            y + 0.5 * (scores[y + 1, x] - scores[y - 1, x]) / curve_y, best)


class Matcher:
    def __init__(self, camera, onboard_map):
        self.camera, self.map = camera, onboard_map
        self._map_sigmas = None  # of a match, x and y, in pixels of the map; learnt in flight

    def working_scale(self, state):
        """Returns the level of the map to match with, and the factor by which frames are averaged to its detail."""
        gsd_m = self.altitude_m(state) / self.camera.focal
        margin_px = 3 * self._sigma_px(state, self.map.levels[0])
        level = self.map.level(gsd_m, lambda one: one.holds_view(self.camera, state.map_position,
                                                                 state.moon_from_camera, margin_px))
        factor = int(np.clip(round(0.7 * level.gsd_m / gsd_m), 1, max(1, self.camera.side // 96)))
        return level, factor

    def update(self, state, image):
        """Matches a frame and updates the filter; returns the matches used.

        Where the prediction is too uncertain for the fine search, the coarse search comes first; its update is undone
        unless the fine search confirms it.
        """
        used = []
        level, factor = self.working_scale(state)
        sigma_px = self._sigma_px(state, level) / factor
        before = None
        if 3 * sigma_px > WIDEST - 3:
            coarse = self.coarse(state, image, level, factor, COARSE_SIGMAS * sigma_px)
            if coarse is None:
                return used
            before = state.copy()
            state.update(self.camera, coarse.points_m, coarse.pixels, coarse.counted_px)
            used.append(coarse)
            level, factor = self.working_scale(state)
            sigma_px = self._sigma_px(state, level) / factor
        fine = self.fine(state, image, level, factor, self.reach_px(state, sigma_px, level, factor))
        if fine is not None:
            fine = gated(state, self.camera, fine)
        if fine is not None and before is not None and len(fine.pixels) < CONFIRMING * fine.tried:
            fine = None
        if fine is None:
            if before is not None:  # nothing confirms what the coarse search found
                state.restore(before)
            return []
        state.update(self.camera, fine.points_m, fine.pixels, fine.counted_px)
        return [*used, fine]

    def coarse(self, state, image, level, factor, reach_px):
        """Five large patches of the frame, searched in the map as seen from the predicted pose with a wide margin.

        An uncertain height changes the scale: heights are tried in steps of 5 %, up to twice the standard deviation.
        No search reaches farther than the frame is wide, or beyond twice the height: near the ground, an uncertainty of
        many footprints would take minutes.
        """
        more = int(np.clip(np.ceil(reach_px / 40), 1, max(1, self.camera.side // factor // 64)))
        factor *= more
        camera, small = self.camera.reduced(factor), averaged(image, factor)
        reach = min(int(np.ceil(reach_px / more)) + 2, camera.side)
        up = state.position / np.linalg.norm(state.position)
        sigma_m = np.sqrt(up @ state.covariance[:3, :3] @ up)
        altitude_m = self.altitude_m(state)
        doubt_m = min(2 * sigma_m, altitude_m)
        steps = int(np.ceil(doubt_m / (0.05 * altitude_m))) if sigma_m > 0.02 * altitude_m else 0
        best = None
        for offset_m in np.linspace(-doubt_m, doubt_m, 2 * steps + 1) if steps else [0.0]:
            if altitude_m + offset_m < 0.2 * altitude_m:
                continue
            view = View(level, camera, state.map_position + offset_m * up, state.moon_from_camera, reach)
            found = self._large_patches(view, small, camera.side, reach)
            if found is not None and (best is None or found[0] > best[0]):
                best = found
        if best is None:
            return None
        _, points_m, pixels, scatter = best
        # Assume at least half a pixel: five matches say little about their own scatter.
        sigmas_px = np.full(2, factor * max(scatter, 0.5))
        return Matches(points_m, pixels * factor + 0.5 * (factor - 1), sigmas_px, sigmas_px, "coarse")

    def _large_patches(self, view, small, side, reach):
        """Searches four quadrants and the middle of the frame `small`, of `side` pixels, within `reach` in the view.

        Returns the sum of their scores, the points on the map, the pixels and the scatter; None if fewer than three
        patches move alike.
        """
        half, starts = side // 2, ((0, 0), (0, 1), (1, 0), (1, 1), (0.5, 0.5))
        moves, pixels, scores = [], [], []
        for down, right in starts:
            y, x = int(down * half), int(right * half)
            window = view.image[y:y + half + 2 * reach, x:x + half + 2 * reach]
            found = peak(cv2.matchTemplate(window, small[y:y + half, x:x + half], cv2.TM_CCOEFF_NORMED))
            if found:
                moves.append((found[0] - reach, found[1] - reach))
                pixels.append((x + 0.5 * (half - 1), y + 0.5 * (half - 1)))
                scores.append(found[2])
        if len(moves) < 3:
            return None
        moves, pixels, scores = np.array(moves), np.array(pixels), np.array(scores)
        off = np.abs(moves - np.median(moves, axis=0)).max(axis=1)
        kept = off < 3.0  # a degree of roll and 5 % of scale move the quadrants by less
        if kept.sum() < 3:
            return None
        moves, pixels = moves[kept], pixels[kept]
        points_m = view.points(*(pixels + moves).T)
        scatter = 1.4826 * np.median(off[kept])
        return scores[kept].sum(), points_m, pixels, scatter

    def fine(self, state, image, level, factor, reach):
        """Searches many small patches of the map in the frame; returns the matches, or None if there are too few."""
        camera, small = self.camera.reduced(factor), averaged(image, factor)
        view = View(level, camera, state.map_position, state.moon_from_camera, 0)
        patch, gsd_m = min(PATCH, camera.side // 4), self.altitude_m(state) / self.camera.focal
        if patch * factor * gsd_m < LEAST_POSTS * self.map.post_spacing_m:
            return None
        # Place patches side by side where there is room for eight; else let neighbours overlap by half.
        spacing = patch if camera.side >= 8 * patch else patch // 2
        starts = np.arange(reach, camera.side - patch - reach + 1, spacing)
        moves, pixels, tried = [], [], 0
        for y in starts:
            for x in starts:
                if not view.valid[y:y + patch:patch - 1, x:x + patch:patch - 1].all():
                    continue
                template = view.image[y:y + patch, x:x + patch]
                mean, deviation = cv2.meanStdDev(template)
                if not deviation[0, 0] > 1e-3 * mean[0, 0]:
                    continue  # no contrast: all shadow
                tried += 1
                window = small[y - reach:y + patch + reach, x - reach:x + patch + reach]
                found = peak(cv2.matchTemplate(window, template, cv2.TM_CCOEFF_NORMED))
                if found and found[2] >= LEAST_CORRELATION:
                    moves.append((found[0] - reach, found[1] - reach))
                    pixels.append((x + 0.5 * (patch - 1), y + 0.5 * (patch - 1)))
        if len(moves) < LEAST_MATCHES:
            return None
        found = self._agreeing(view, np.array(moves), np.array(pixels), factor)
        if found is None:
            return None
        found.sigmas_px = self._sigmas_of_map(found, level.gsd_m / gsd_m)
        found.counted_px = self.map.error.excess_at(state.position) * found.sigmas_px
        found.tried = tried
        return found

    def reach_px(self, state, sigma_px, level, factor):
        """Returns the reach of the fine search: three sigma of the prediction and of the matches' scatter together.

        A shorter search would find only matches near the prediction, wherever that is, so that the filter would take
        its own error for a measurement (over Hadley half of it, across the Sun's azimuth, within 4 pixels).
        """
        if self._map_sigmas is None:
            return WIDEST
        match_px = self._map_sigmas.max() * level.gsd_m * self.camera.focal / (self.altitude_m(state) * factor)
        return int(np.clip(np.ceil(3 * np.hypot(sigma_px, match_px)) + 2, 4, WIDEST))

    def _sigmas_of_map(self, found, map_px):
        """Returns the standard deviations of matches; for few matches at least those learnt from frames with many.

        With few patches the affine field follows their errors, so that the scatter about it says little. The errors
        are mostly the map's, which has another Sun, and stay about the same in pixels of the map. map_px: size of a
        pixel of the map in pixels of the camera.
        """
        if len(found.pixels) >= MANY_MATCHES:
            sigmas = found.sigmas_px / map_px
            self._map_sigmas = sigmas if self._map_sigmas is None else 0.9 * self._map_sigmas + 0.1 * sigmas
        elif self._map_sigmas is not None:
            return np.maximum(found.sigmas_px, self._map_sigmas * map_px)
        return found.sigmas_px

    def _agreeing(self, view, moves, pixels, factor):
        """Returns the matches that follow one affine field, as a pose error moves them (least median of squares)."""
        cv2.setRNGSeed(1)
        fit, freedom = (cv2.estimateAffine2D, 6) if len(pixels) >= 16 else (cv2.estimateAffinePartial2D, 4)
        model, kept = fit(pixels, pixels + moves, method=cv2.LMEDS, maxIters=1000)
        if model is None:
            return None
        residual = pixels @ model[:, :2].T + model[:, 2] - pixels - moves
        kept = kept.ravel().astype(bool)
        if kept.sum() < LEAST_MATCHES:
            return None
        # Correct the variance for the numbers fitted. The axes differ: shading says less across the Sun's azimuth.
        spread = 2 * kept.sum() / (2 * kept.sum() - freedom)
        sigmas_px = factor * np.maximum(np.sqrt(spread * np.mean(residual[kept] ** 2, axis=0)), 0.05)
        points_m = view.points(*pixels[kept].T)
        full = (pixels[kept] + moves[kept]) * factor + 0.5 * (factor - 1)
        return Matches(points_m, full, sigmas_px, sigmas_px, "fine")

    def altitude_m(self, state):
        """Returns the height above the map's ground straight below, at least 50 m."""
        level = self.map.levels[0]
        column, row = level.pixels(state.position[None, None])
        radius = np.linalg.norm(state.position)
        return max(50.0, float(radius - MOON_RADIUS_M - level.height_at(column, row)[0, 0]))

    def _sigma_px(self, state, level):
        """Returns the largest standard deviation of the predicted pixel of the point in the frame's middle."""
        x = np.array([[self.camera.centre]])
        points, _, _ = level.ground(state.map_position, self.camera.rays(x, x) @ state.moon_from_camera.T)
        return float(state.pixel_sigmas(self.camera, points[0])[0])


def gated(state, camera, matches):
    """Returns the matches without those whose innovation is improbable by the filter's covariance, or None for too few.

    The limit is the 99.99 % quantile of the chi-square distribution of two degrees of freedom.
    """
    predicted, jacobian = projected(camera, state.map_position, state.moon_from_camera, matches.points_m)
    rows = jacobian.reshape(-1, 2, jacobian.shape[1])
    innovation = matches.pixels - predicted
    covariance = rows @ state.covariance @ rows.transpose(0, 2, 1) + np.diag(matches.sigmas_px**2)
    distance = np.einsum("ni,nij,nj->n", innovation, np.linalg.inv(covariance), innovation)
    kept = distance < 18.4
    if kept.sum() < LEAST_MATCHES:
        return None
    return dataclasses.replace(matches, points_m=matches.points_m[kept], pixels=matches.pixels[kept])
