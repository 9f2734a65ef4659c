"""Why matches err: frames against the map with one cause after the other taken away, at known poses."""

import numpy as np
from selenograph import Pose

from . import campaign, rehearsal
from .camera import Detector
from .descent import east_north_up, geodetic
from .filter import Filter
from .flight import post_spacing_of
from .map import Map, level_requests, levels_of
from .matcher import WIDEST, Matcher

FRAMES = 40
ALTITUDES_M = (3000, 12000)  # above the terrain
DISPLACED_M = 25.0
LAMBERT = {"reflectance": {"model": "lunar", "lommel_seeliger_weight": 0.0, "rho": 0.12}}
NARROW = 4  # pixels


class Poses:
    """Poses of the nominal descent, evenly in time, and the altitudes that belong to them."""

    def __init__(self, scenario, client):
        descent = scenario.descent
        self.scenario, self.times = scenario, np.linspace(1, descent.duration_s - 1, 4 * FRAMES)
        positions = np.array([descent.position(t) for t in self.times])
        lat_deg, lon_deg, height_m = geodetic(positions)
        ground = client.heights(lat_deg, lon_deg, detail=scenario.detail)
        altitudes_m = height_m - ground.height_m
        inside = np.flatnonzero((altitudes_m >= ALTITUDES_M[0]) & (altitudes_m < ALTITUDES_M[1]))
        chosen = inside[np.linspace(0, len(inside) - 1, FRAMES).astype(int)]
        self.times, self.positions, self.altitudes_m = self.times[chosen], positions[chosen], altitudes_m[chosen]
        self.velocities = [descent.velocity(t) for t in self.times]
        self.attitudes = [descent.moon_from_camera(t) for t in self.times]
        self.post_spacing_m = post_spacing_of(scenario, ground)

    def frames(self, client, sun, surface):
        requests = [{"camera": self.scenario.camera.request, "sun": sun, "products": ["radiance"],
                     "surface": surface or self.scenario.surface, "detail": self.scenario.detail,
                     "pose": Pose.from_matrix(attitude, direction="moon_from_camera", position_m=position)}
                    for position, attitude in zip(self.positions, self.attitudes)]
        return [frame["radiance"] for frame in client.frames(requests)]


def found(poses, i, image, onboard, reach, displaced_m=(0.0, 0.0, 0.0)):
    """The shift (east, north, up) that a frame's matches ask for, and their scatter in metres (x and y of the image),
    where the lander believes to be displaced."""
    scenario, position, attitude = poses.scenario, poses.positions[i], poses.attitudes[i]
    believed = position + east_north_up(position) @ np.array(displaced_m)
    state = Filter(believed, poses.velocities[i], attitude, np.zeros(3), campaign.IMU)
    matcher = Matcher(scenario.camera, onboard)
    matches = matcher.fine(state, image, *matcher.working_scale(state), reach)
    if matches is None:
        return None
    shift, _ = rehearsal.offset(scenario.camera, position, attitude, matches.points_m, matches.pixels,
                                matches.sigmas_px)
    return np.array([*shift, *matches.sigmas_px * poses.altitudes_m[i] / scenario.camera.focal, len(matches.pixels)])


def explain(scenario, client):
    poses = Poses(scenario, client)

    def map_of(surface):
        return Map(levels_of(client, level_requests(scenario, poses.post_spacing_m, campaign.INITIAL.sigmas[0]),
                             **surface))

    def noisy(frames):
        random = np.random.default_rng(0)
        return [Detector().image(frame, Detector.white(frame), random) for frame in frames]

    plain = map_of({})
    alike, under_map, under_flight = (poses.frames(client, sun, surface) for sun, surface in (
        (scenario.map_sun, LAMBERT), (scenario.map_sun, None), (scenario.flight_sun, None)))
    seen, cases = noisy(under_flight), []
    for name, images, onboard in (
            ("map's Sun, no detector noise, Lambert in frames and map", alike, map_of({"surface": LAMBERT})),
            ("map's Sun, no detector noise, as the Moon reflects", under_map, plain),
            ("map's Sun", noisy(under_map), plain),
            ("flight's Sun, no detector noise", under_flight, plain), ("flight's Sun: as flown", seen, plain)):
        rows = [found(poses, i, image, onboard, WIDEST) for i, image in enumerate(images)]
        rows = np.array([row for row in rows if row is not None])
        cases.append({"case": name, "frames": len(rows), "offset_mean_m": list(rows[:, :3].mean(axis=0)),
                      "offset_rms_m": list(np.sqrt(np.mean(rows[:, :3]**2, axis=0))),
                      "scatter_m": list(np.sqrt(np.mean(rows[:, 3:5]**2, axis=0))),
                      "matches": float(rows[:, 5].mean())})
    return {"altitudes_m": list(ALTITUDES_M), "cases": cases,
            "followed": {str(reach): _followed(poses, seen, plain, reach) for reach in (NARROW, 8, WIDEST)}}


def _followed(poses, seen, onboard, reach):
    """How much of an error of the lander's own position matches repeat (east, north): 0 is right, 1 says nothing."""
    shares = []
    for i, image in enumerate(seen):
        ends = [found(poses, i, image, onboard, reach, sign * DISPLACED_M * np.eye(3)[axis])
                for axis in (0, 1) for sign in (1, -1)]
        if all(end is not None for end in ends):
            shares.append([(ends[2 * axis][axis] - ends[2 * axis + 1][axis]) / (2 * DISPLACED_M) for axis in (0, 1)])
    return list(np.median(shares, axis=0))
