"""The onboard map: radiance and heights in levels of finer and finer pixels along the nominal track."""

import cv2
import numpy as np

from .descent import MOON_RADIUS_M, geodetic
from .filter import NO_MAP_ERROR

MOST_PIXELS = 16e6  # of a level, a little below the service's --max-map-pixels


class Level:
    """One map of the service, equirectangular about its own centre."""

    def __init__(self, frame, gsd_m, shift_m=0.0):
        """shift_m: displacement of the map to the east, to simulate an error."""
        self.gsd_m = gsd_m
        area, transform = frame.meta["request"]["map"], frame.meta["grid"]["geotransform"]
        self._centre_lon_deg = area["center"]["lon_deg"]
        self._east_m_per_deg = np.radians(1) * MOON_RADIUS_M * np.cos(np.radians(area["center"]["lat_deg"]))
        self._north_m_per_deg = np.radians(1) * MOON_RADIUS_M
        self._west_m, self._step_x, self._north_m, self._step_y = (transform[i] for i in (0, 1, 3, 5))
        self._west_m += shift_m
        self.radiance = np.nan_to_num(frame["radiance"]).astype(np.float32)
        height = frame["height"].astype(np.float32)
        self.mean_height_m = float(np.nanmean(height))
        self.height_m = np.where(np.isfinite(height), height, np.float32(self.mean_height_m))

    def pixels(self, positions_m):
        """Returns column and row of points (.., 3), whatever their height."""
        lat_deg, lon_deg, _ = geodetic(positions_m)
        lon_deg = (lon_deg - self._centre_lon_deg + 180) % 360 - 180
        return ((lon_deg * self._east_m_per_deg - self._west_m) / self._step_x - 0.5,
                (lat_deg * self._north_m_per_deg - self._north_m) / self._step_y - 0.5)

    def height_at(self, column, row):
        return cv2.remap(self.height_m, column.astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR,
                         borderMode=cv2.BORDER_REPLICATE)

    def ground(self, origin_m, directions):
        """Intersects rays (rows, columns, 3) with the map's heights. Returns points, column and row; NaN for a miss.

        Fixed-point iteration over the height: it converges where slope times the tangent of the emission angle is below
        1, as it is under a camera that looks down.
        """
        height = np.full(directions.shape[:2], self.mean_height_m)
        along = (directions @ origin_m) / (directions**2).sum(-1)
        square = (directions**2).sum(-1)
        for _ in range(5):
            radius = MOON_RADIUS_M + height
            with np.errstate(invalid="ignore"):
                t = -along - np.sqrt(along**2 - (origin_m @ origin_m - radius**2) / square)
            points = origin_m + t[..., None] * directions
            column, row = self.pixels(points)
            height = self.height_at(column, row)
        return points, column, row

    def holds(self, column, row):
        rows, columns = self.radiance.shape
        return (column >= 0) & (column <= columns - 1) & (row >= 0) & (row <= rows - 1)

    def holds_view(self, camera, position, moon_from_camera, margin_px):
        """Tells whether the map covers the camera's view with a margin of pixels around it."""
        side = np.array([-margin_px, camera.centre, camera.side - 1 + margin_px])
        _, column, row = self.ground(position, camera.rays(*np.meshgrid(side, side)) @ moon_from_camera.T)
        return bool(self.holds(column, row).all())


class Map:
    def __init__(self, levels, error=NO_MAP_ERROR, post_spacing_m=0.0):
        self.levels = sorted(levels, key=lambda level: -level.gsd_m)
        self.error, self.post_spacing_m = error, post_spacing_m

    def level(self, camera_gsd_m, holds):
        """Returns the coarsest level that covers the view, holds(level), and is at most 1.5 times as coarse as the
        camera; else the finest that covers it. If none covers it, the coarsest of all."""
        large = [level for level in self.levels if holds(level)] or self.levels[:1]
        return next((level for level in large if level.gsd_m <= 1.5 * camera_gsd_m), large[-1])


def levels_of(client, requests, shift_m=0.0, **more):
    """Returns the levels of these requests (level_requests()). more: members that each request gets."""
    return [Level(client.map({**request, **more}), request["map"]["gsd_m"], shift_m) for request in requests]


def level_requests(scenario, post_spacing_m, position_sigma_m):
    """Returns requests for /v1/maps along the nominal track; a level serves all altitudes below its own.

    The finest level has three pixels per post: finer pixels would show nothing more.
    """
    descent, camera = scenario.descent, scenario.camera
    times = np.linspace(0, descent.duration_s, 400)
    points = np.array([descent.position(t) for t in times])
    lat_deg, lon_deg, height_m = geodetic(points)
    altitude_m = height_m - descent.site_height_m
    view = np.sqrt(2) * 0.5 * camera.side / camera.focal  # half a diagonal, per metre of altitude
    gsd_m, levels = altitude_m[0] / camera.focal, []
    while True:
        # The coarsest level must cover the initial error. Finer ones are used once the error is below the footprint.
        used = altitude_m <= (1.6 * gsd_m * camera.focal if levels else np.inf)
        doubt_m = 0.3 * altitude_m[used].max() if levels else 3 * position_sigma_m
        centre_lon = lon_deg[used].mean()
        center = {"lat_deg": 0.5 * (lat_deg[used].min() + lat_deg[used].max()), "lon_deg": centre_lon}
        margin_m = 1.3 * view * altitude_m[used].max() + doubt_m
        degree_m = np.radians(1) * MOON_RADIUS_M
        east_m = 2 * np.abs(lon_deg[used] - centre_lon).max() * degree_m * np.cos(np.radians(center["lat_deg"]))
        north_m = np.ptp(lat_deg[used]) * degree_m
        size = {"width_m": east_m + 2 * margin_m, "height_m": north_m + 2 * margin_m}
        fitting_m = max(gsd_m, np.sqrt(size["width_m"] * size["height_m"] / MOST_PIXELS), post_spacing_m / 3)
        if not levels or fitting_m < 0.75 * levels[-1]["map"]["gsd_m"]:
            levels.append({"map": {"projection": "equirectangular", "center": center, "gsd_m": fitting_m, **size},
                           "sun": scenario.map_sun, "surface": scenario.surface, "detail": scenario.detail,
                           "products": ["radiance", "height"]})
        gsd_m /= 2
        if gsd_m < post_spacing_m / 3 or gsd_m * camera.focal < altitude_m[-1] / 2:
            return levels
