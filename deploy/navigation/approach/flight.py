"""One flight: limb and stars at each distance, navigated twice, with the Moon as a sphere and with its terrain."""

import datetime
import json
import pathlib

import numpy as np

from lander.camera import Camera
from lander.descent import rotation

from . import horizon, stars
from .cruise import Cruise, Filter

EPOCH = datetime.datetime(2026, 11, 25, tzinfo=datetime.timezone.utc)  # the way is lit from the side
PRESET = json.loads((pathlib.Path(__file__).parents[2] / "assets" / "cameras" / "navigation-camera.json").read_text())
AZIMUTHS = 180
LEAST_EDGE_PX = 0.02  # 1 sigma of an edge, whatever the scatter about the fit says
ATTITUDE_RAD = np.radians(20 / 3600)  # 1 sigma about each axis, before stars
POINTING_RAD = np.radians(0.05)
COLUMNS = ("distance_m", "stars", "edges", "attitude_arcsec") + tuple(
    f"{how}_{what}" for how in ("sphere", "terrain")
    for what in ("range_m", "across_m", "law_range_m", "place_m", "velocity_m_s", "place_sigma_m"))


def sensor(seed, frame, f_number, integration_s):
    made = json.loads(json.dumps(PRESET["sensor"]))
    made["optics"]["f_number"], made["seed"], made["frame"] = f_number, seed, frame
    made["detector"]["integration_time_s"] = integration_s
    return made


def facing(forward, aside):
    """camera_from_axes of a camera that looks forward; `aside` is to its right as nearly as can be."""
    forward = forward / np.linalg.norm(forward)
    down = np.cross(forward, aside)
    down /= np.linalg.norm(down)
    return np.array([np.cross(down, forward), down, forward])


def pose(place, camera_from_icrf):
    return {"frame": "ICRF", "position_m": list(place),
            "camera_from_moon_matrix": [list(row) for row in camera_from_icrf]}


class Flight:
    def __init__(self, client, seed, steps=24):
        self.client, self.seed, self.random = client, seed, np.random.default_rng(seed)
        self.cruise = Cruise(steps, self.random)
        sigma = np.array([100e3] * 3 + [1.0] * 3)
        start = self.cruise.states[0] + sigma * self.random.standard_normal(6)
        self.filters = {how: Filter(start.copy(), sigma) for how in ("sphere", "terrain")}

    def fly(self):
        rows = []
        for step in range(len(self.cruise.states)):
            if step > 0:
                for one in self.filters.values():
                    one.propagate(self.cruise.times_s[step] - self.cruise.times_s[step - 1])
            rows.append(self._step(step))
        return np.array(rows)

    def _step(self, step):
        state = self.cruise.states[step]
        distance = np.linalg.norm(state[:3])
        utc = (EPOCH + datetime.timedelta(seconds=self.cruise.times_s[step])).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        # The disc fills the image of the one until 16 000 km; the other sees all of it down to 2000 km.
        camera = Camera.of(1024, 16.0 if distance > 16e6 else 75.0)
        sun = np.array(self._sky(state, np.eye(3), Camera.of(16, 1.0), utc, sun=True)[0]["direction_icrf"])
        true = rotation(POINTING_RAD * self.random.standard_normal(3)) @ facing(-state[:3], np.cross(state[:3], sun))
        believed = rotation(ATTITUDE_RAD * self.random.standard_normal(3)) @ true
        attitude, used = self._attitude(state, true, believed, sun, utc, step)
        off = attitude @ true.T
        row = [distance, used, 0, np.degrees(np.linalg.norm([off[1, 2], off[2, 0], off[0, 1]])) * 3600]
        image = self._image(camera, pose(state[:3], true), utc, sensor=sensor(self.seed, step, 5.6, 1e-3))
        for how, one in self.filters.items():
            row[2], figures = self._navigate(how, one, state, camera, image, attitude, sun, utc)
            row += figures
        return row

    def _navigate(self, how, one, state, camera, image, attitude, sun, utc):
        """How many edges were used, and the figures of COLUMNS for `how`."""
        azimuths = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
        moon = attitude @ -one.state[:3]
        # The first look is around where the filter has it, the second around where the image has it.
        for reach_px in (40.0, 8.0):
            edges = horizon.edges(image, camera, moon, attitude @ sun, azimuths, reach_px)
            if np.isfinite(edges).sum() < 10:
                return 0, [np.nan] * 6
            around = moon
            moon, covariance, used = self._fitted(around, azimuths, edges, camera)
        if how == "terrain":
            edges = edges - self._relief(camera, moon, attitude, utc)
            moon, covariance, used = self._fitted(around, azimuths, edges, camera)
        line, truth = -state[:3] / np.linalg.norm(state[:3]), -state[:3]
        error = attitude.T @ moon - truth
        spread = attitude.T @ covariance @ attitude
        one.update(-(attitude.T @ moon), spread)
        left = one.state - state
        return used, [error @ line, np.linalg.norm(error - error @ line * line), np.sqrt(line @ spread @ line),
                      np.linalg.norm(left[:3]), np.linalg.norm(left[3:]), np.sqrt(np.trace(one.covariance[:3, :3]))]

    @staticmethod
    def _fitted(around, azimuths, edges, camera):
        """The fit without its outliers, edges of shadows. How far edges scatter about it says how good it is."""
        use, sigma_px = np.isfinite(edges), 0.1
        for _ in range(4):
            moon, covariance = horizon.fit(around, azimuths[use], edges[use], sigma_px / camera.focal)
            left_px = camera.focal * (edges - horizon.angles_of(moon, around, azimuths))
            sigma_px = max(1.4826 * np.median(np.abs(left_px[use])), LEAST_EDGE_PX)
            use = np.isfinite(edges) & (np.abs(left_px) < 3 * sigma_px)
        return moon, covariance, int(use.sum())

    def _relief(self, camera, moon, attitude, utc):
        """How far the terrain's limb is outside the sphere's, by azimuth, seen from where the fit has the camera: its
        azimuths and those of the edges differ by less than their step."""
        limb = self.client.limb(camera.request, {**pose(-(attitude.T @ moon), attitude), "utc": utc}, points=AZIMUTHS)
        return np.radians(limb["angle_deg"] - limb["sphere_angle_deg"])

    def _image(self, camera, from_pose, utc, **more):
        request = {"camera": camera.request, "pose": from_pose, "sun": {"utc": utc}, "products": ["image"],
                   "surface": {"preset": "moon"}, "band": PRESET["band"], **more}
        return self.client.frame(request)["image"].astype(np.float32)

    def _sky(self, state, camera_from_icrf, camera, utc, **what):
        return self.client.sky({"camera": camera.request, "pose": pose(state[:3], camera_from_icrf), "utc": utc,
                                "sky": what})

    def _attitude(self, state, true, believed, sun, utc, step):
        """The attitude of the Moon's camera by another that is fixed to it and sees stars, away from Moon and Sun."""
        toward = state[:3] / np.linalg.norm(state[:3])
        away = np.cross(toward, sun)
        camera = Camera.of(1024, 20.0)
        mounted = facing(true @ away, true @ toward)
        image = self._image(camera, pose(state[:3], mounted @ true), utc,
                            sensor=sensor(self.seed + 100000, step, 1.4, 0.2), sky={"stars": "bright"})
        listed = [o for o in self._sky(state, mounted @ believed, camera, utc, stars="bright") if o["in_frame"]]
        solved, used = stars.solved(image, camera, listed, mounted @ believed)
        return mounted.T @ solved, used
