"""One flight of the filter along the truth, and what the service renders for it."""

import dataclasses

import numpy as np
from selenograph import Pose

from . import inertial
from .camera import Detector
from .descent import geodetic, rotation, rotation_vector
from .filter import Filter
from .map import level_requests, levels_of
from .matcher import Matcher


@dataclasses.dataclass(frozen=True)
class InitialError:
    """RMS lengths of the error vectors. Each axis has a normal error with 1/sqrt(3) of that deviation."""

    position_m: float = 3000.0
    velocity_m_s: float = 3.0
    attitude_deg: float = 1.0

    @property
    def sigmas(self):
        return np.array([self.position_m, self.velocity_m_s, np.radians(self.attitude_deg)]) / np.sqrt(3)


def post_spacing_of(scenario, ground):
    """Returns the spacing of the finest posts shown: the DEM's or, with detail, three of the map's pixels."""
    return 3 * scenario.map_gsd_m if scenario.detail else float(np.median(ground.post_spacing_m))


class Truth:
    """Data that all flights of a scenario share: times, the IMU's exact increments, frames. A frame depends on the true
    pose alone, so that sharing it is exact."""

    def __init__(self, scenario, client, sun=None, accuracy=None, shadows=True):
        self.scenario = scenario
        descent = scenario.descent
        steps = int(round(scenario.frame_step_s / scenario.imu_step_s))
        count = int(descent.duration_s / scenario.frame_step_s)
        self.imu_times_s = np.arange(count * steps + 1) * scenario.imu_step_s
        self.steps = steps
        self.frame_times_s = self.imu_times_s[steps::steps]
        self.increments = inertial.exact_increments(descent, self.imu_times_s)
        self.positions = np.array([descent.position(t) for t in self.frame_times_s])
        self.velocities = np.array([descent.velocity(t) for t in self.frame_times_s])
        self.attitudes = np.array([descent.moon_from_camera(t) for t in self.frame_times_s])
        lat_deg, lon_deg, height_m = geodetic(self.positions)
        ground = client.heights(lat_deg, lon_deg, detail=scenario.detail)
        self.altitudes_m = height_m - ground.height_m
        self.post_spacing_m = post_spacing_of(scenario, ground)

        self.frames, times_ms = [], []
        products = ["radiance"] if shadows else ["radiance", "angles", "lit"]
        requests = [{"camera": scenario.camera.request, "sun": sun or scenario.flight_sun, "products": products,
                     "surface": scenario.surface, "detail": scenario.detail,
                     **({"accuracy": accuracy} if accuracy else {}),
                     "pose": Pose.from_matrix(attitude, direction="moon_from_camera", position_m=position)}
                    for position, attitude in zip(self.positions, self.attitudes)]
        for frame in client.frames(requests):
            self.frames.append(frame["radiance"] if shadows else without_shadows(frame))
            times_ms.append(frame.timing["total"])
        self.service_ms = float(np.median(times_ms))
        self.whites = [Detector.white(frame) for frame in self.frames]


def without_shadows(frame):
    """What the service would render if nothing cast a shadow: McEwen's law, as `moon` has it, times the function of the
    phase angle that the frame has where it is lit."""
    incidence, emission = (np.cos(np.radians(frame["angles"][..., i])) for i in range(2))
    phase_deg = frame["angles"][..., 2]
    towards = incidence > 0  # False where it is NaN
    seeliger = incidence / np.where(towards, incidence + emission, 1)
    share = 1 + phase_deg * (-0.019 + phase_deg * (0.242e-3 - 1.46e-6 * phase_deg))  # McEwen (1996)
    shade = np.where(towards, 2 * share * seeliger + (1 - share) * incidence, 0)
    seen = (frame["lit"] == 1) & (shade > 0.02)
    law = np.polynomial.Polynomial.fit(phase_deg[seen], np.log(frame["radiance"][seen] / shade[seen]), 2)
    return np.where(towards, shade * np.exp(law(np.where(towards, phase_deg, 45.0))), 0).astype(np.float32)


def map_levels(scenario, client, post_spacing_m, initial, shift_m=0.0):
    return levels_of(client, level_requests(scenario, post_spacing_m, initial.sigmas[0]), shift_m=shift_m)


COLUMNS = ("time_s", "altitude_m", "position_error_m", "velocity_error_m_s", "attitude_error_deg", "position_sigma_m",
           "velocity_sigma_m_s", "position_nees", "velocity_nees", "attitude_nees", "matches", "match_sigma_px",
           "coarse")


def fly(truth, onboard, imu, initial, seed, detector=Detector(), keep=None):
    """Returns a row of COLUMNS for each frame. keep(i, image, used) sees what was matched."""
    scenario, descent = truth.scenario, truth.scenario.descent
    random = np.random.default_rng(seed)
    sigmas = initial.sigmas
    state = Filter(descent.position(0) + random.normal(0, sigmas[0], 3),
                   descent.velocity(0) + random.normal(0, sigmas[1], 3),
                   descent.moon_from_camera(0) @ rotation(random.normal(0, sigmas[2], 3)), sigmas, imu,
                   onboard.error)
    velocity, angle, _, _ = inertial.measured(imu, truth.increments, truth.imu_times_s, random)
    matcher = Matcher(scenario.camera, onboard)
    rows = []
    for i, frame in enumerate(truth.frames):
        for j in range(i * truth.steps, (i + 1) * truth.steps):
            state.propagate(velocity[j], angle[j], scenario.imu_step_s)
        image = detector.image(frame, truth.whites[i], random)
        used = matcher.update(state, image)
        if keep:
            keep(i, image, used, state)
        rows.append(_row(truth, i, state, used))
    return np.array(rows)


def _row(truth, i, state, used):
    errors = (truth.positions[i] - state.position, truth.velocities[i] - state.velocity,
              rotation_vector(state.moon_from_camera.T @ truth.attitudes[i]))
    nees, sigmas = [], []
    for k, error in enumerate(errors):
        block = state.covariance[3 * k:3 * k + 3, 3 * k:3 * k + 3]
        nees.append(error @ np.linalg.solve(block, error))
        sigmas.append(np.sqrt(np.trace(block)))
    fine = [m for m in used if m.stage == "fine"]
    return (truth.frame_times_s[i], truth.altitudes_m[i], np.linalg.norm(errors[0]), np.linalg.norm(errors[1]),
            np.degrees(np.linalg.norm(errors[2])), sigmas[0], sigmas[1], *nees, len(fine[0].pixels) if fine else 0,
            np.sqrt(np.mean(fine[0].sigmas_px**2)) if fine else np.nan, float(any(m.stage == "coarse" for m in used)))
