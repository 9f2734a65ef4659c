"""Single flights, Monte Carlo and sweeps.

A campaign is a folder: conditions.json, and one file for each flight, written whole as the flight ends. What is there
stays with resume, if it was flown under the same conditions by the same code.
"""

import dataclasses
import hashlib
import json
import multiprocessing
import os
import pathlib
import platform
import shutil
import sys
import time

import numpy as np

from . import flight, inertial, rehearsal, scenarios, service
from .camera import Detector
from .map import Map

INITIAL, IMU = flight.InitialError(), inertial.Imu()
FLYING = ("camera", "descent", "filter", "flight", "inertial", "map", "matcher", "rehearsal", "scenarios")
_shared = {}  # truth and map, inherited by forked processes


def _machine():
    with open("/proc/cpuinfo") as lines:
        models = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    model = models[0] if models else platform.machine()
    return f"{model}, {multiprocessing.cpu_count()} cores"


def _code_now():
    here = pathlib.Path(__file__).parent
    return hashlib.sha256(b"".join((here / f"{name}.py").read_bytes() for name in FLYING)).hexdigest()


CODE = _code_now()  # as it was loaded, not as it may be edited while it flies


def write_whole(path, write):
    """write(file) into a file that gets its name when all is written."""
    with open(path.with_name(path.name + ".part"), "wb") as file:
        write(file)
    os.replace(file.name, path)


def write_json(path, content):
    write_whole(path, lambda file: file.write((json.dumps(content, indent=2) + "\n").encode()))


def flights(folder):
    """Rows of all flights (runs, frames, columns), and the processor seconds of each."""
    rows, seconds = [], []
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as stored:
            rows.append(stored["rows"].astype(float))
            seconds.append(float(stored["processor_s"]))
    return np.array(rows), np.array(seconds)


@dataclasses.dataclass(frozen=True)
class Campaign:
    folder: pathlib.Path
    runs: int
    seed: int
    processes: int
    resume: bool

    def begin(self, conditions):
        """The seeds that are left to fly."""
        # By way of JSON, as what is compared with was read.
        conditions = json.loads(json.dumps({**conditions, "first_seed": self.seed, "code": CODE}))
        path = self.folder / "conditions.json"
        if self.resume and path.exists():
            before = json.loads(path.read_text())
            differing = [name for name in conditions if conditions[name] != before.get(name)]
            if differing:
                sys.exit(f"{self.folder}: flown with other {', '.join(differing)}; leave --resume out to begin anew")
        elif self.folder.exists():
            shutil.rmtree(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        write_json(path, {**conditions, "machine": _machine()})
        return [seed for seed in range(self.seed, self.seed + self.runs) if not self._path(seed).exists()]

    def fly(self, seeds, truth, onboard, detector=Detector()):
        _shared.update(truth=truth, map=onboard, detector=detector, path=self._path)
        if self.processes < 2 or len(seeds) < 2:
            ends = map(_one, seeds)
            self._tell(ends, len(seeds))
        else:
            with multiprocessing.get_context("fork").Pool(self.processes) as pool:
                self._tell(pool.imap_unordered(_one, seeds, chunksize=1), len(seeds))

    def _path(self, seed):
        return self.folder / f"{seed:05d}.npz"

    @staticmethod
    def _tell(ends, count):
        for i, (seed, error_m, seconds) in enumerate(ends):
            print(f"flight {i + 1} of {count}, seed {seed}: {error_m:.1f} m at the end, {seconds:.0f} s", flush=True)


def _one(seed):
    start = time.process_time()
    rows = flight.fly(_shared["truth"], _shared["map"], IMU, INITIAL, seed, _shared["detector"])
    seconds = time.process_time() - start
    write_whole(_shared["path"](seed), lambda file: np.savez_compressed(
        file, rows=rows.astype(np.float32), columns=np.array(flight.COLUMNS), processor_s=seconds))
    return seed, rows[-1, 2], seconds


def rehearsed(scenario, client, levels):
    """The map with what is known of its errors before flight."""
    practice = flight.Truth(scenario, client, sun=rehearsal.other_sun(scenario))
    plain = Map(levels, post_spacing_m=practice.post_spacing_m)
    error = rehearsal.map_error(rehearsal.offsets(practice, plain, IMU, Detector()))
    return Map(levels, error, practice.post_spacing_m)


def prepared(scenario, client):
    start = time.monotonic()
    truth = flight.Truth(scenario, client)
    rendered = time.monotonic()
    levels = flight.map_levels(scenario, client, truth.post_spacing_m, INITIAL)
    mapped = time.monotonic()
    onboard = rehearsed(scenario, client, levels)
    gsds = ", ".join(f"{level.gsd_m:.0f}" for level in levels)
    print(f"{scenario.name}: {len(truth.frames)} frames in {rendered - start:.1f} s, map levels of {gsds} m in "
          f"{mapped - rendered:.1f} s, rehearsal in {time.monotonic() - mapped:.1f} s; map bias of at most "
          f"{onboard.error.sigmas_m.max():.0f} m over {onboard.error.length_m:.0f} m", flush=True)
    return truth, onboard


def conditions_of(scenario):
    return {
        "scenario": scenario.name, "camera_px": scenario.camera.side, "focal_px": scenario.camera.focal,
        "duration_s": scenario.descent.duration_s, "frame_step_s": scenario.frame_step_s, "surface": scenario.surface,
        **({"detail": scenario.detail, "map_gsd_m": scenario.map_gsd_m} if scenario.detail else {}),
        "flight_sun": scenario.flight_sun["local"], "map_sun": scenario.map_sun["local"],
        "initial_rms": dataclasses.asdict(INITIAL), "imu": dataclasses.asdict(IMU),
    }


def _note_map(campaign, truth, onboard):
    """Beside the conditions: what the preparation found."""
    error = onboard.error
    write_json(campaign.folder / "map.json", {
        "post_spacing_m": truth.post_spacing_m, "gsd_m": [level.gsd_m for level in onboard.levels],
        "bias_radius_m": list(error.radii_m), "bias_sigma_m": error.sigmas_m.tolist(),
        "bias_length_m": error.length_m, "excess": list(error.excess)})


def fly(scenario, client, campaign):
    truth, onboard = prepared(scenario, client)
    seeds = campaign.begin(conditions_of(scenario))
    _note_map(campaign, truth, onboard)
    campaign.fly(seeds, truth, onboard)


def monte_carlo(scenario, client, campaign):
    seeds = campaign.begin(conditions_of(scenario))
    if seeds:
        truth, onboard = prepared(scenario, client)
        _note_map(campaign, truth, onboard)
        campaign.fly(seeds, truth, onboard)


@dataclasses.dataclass(frozen=True)
class Point:
    """Of a sweep: what differs from the scenario."""

    what: str
    value: object
    scene: dict = dataclasses.field(default_factory=dict)  # options of the scenario
    frames: dict = dataclasses.field(default_factory=dict)  # options of flight.Truth
    detector: Detector = Detector()
    coarser: int = 1  # posts of the map's DEM, in those of the frames'
    shift_m: float = 0.0  # of the map, to the east

    @property
    def name(self):
        return f"{self.what} {self.value}".replace(",", "").replace(" ", "-").replace("/", "-")


def points(base):
    azimuth, elevation = (base.flight_sun["local"][k] for k in ("azimuth_deg", "elevation_deg"))
    soft = {**base.flight_sun, "angular_radius_deg": 0.2666}
    found = [Point("flight Sun's azimuth, deg", value, {"flight": (value, elevation)}) for value in (105, 85, 45, 285)]
    found += [Point("flight Sun's elevation, deg", value, {"flight": (azimuth, value)}) for value in (5, 10, 18, 30)]
    found += [Point("shadows", "hard"), Point("shadows", "soft", frames={"sun": soft}),
              Point("shadows", "off", frames={"shadows": False})]
    found += [Point("read noise, electrons", value, detector=Detector(read_noise_e=value)) for value in (20, 80, 320)]
    found += [Point("max_error_px", value, frames={"accuracy": {"max_error_px": value}}) for value in (0.5, 2, 8, 32)]
    if base.sample:
        found += [Point("posts of the map's DEM, in the frames'", value, coarser=value) for value in (1, 4, 16)]
    found += [Point("map shifted east, m", value, shift_m=value) for value in (0, 50, 200)]
    return found


def sweep(made, more, start, client, campaign):
    """One thing changed at a time. made(**more): the scenario; start(scenario): a service with other terrain."""
    base, ready = made(**more), {}

    def prepared_once():
        if not ready:
            ready["truth"], ready["map"] = prepared(base, client)
        return ready["truth"], ready["map"]

    for point in points(base):
        scenario = made(**{**more, **point.scene})
        one = dataclasses.replace(campaign, folder=campaign.folder / point.name)
        conditions = {**conditions_of(scenario), "what": point.what, "value": point.value,
                      "point": dataclasses.asdict(point)}
        seeds = one.begin(conditions)
        if not seeds:
            continue
        print(point.name, flush=True)
        truth, onboard = prepared_once()
        if point.scene or point.frames:
            truth = flight.Truth(scenario, client, **point.frames)
        if point.scene:
            onboard = rehearsed(scenario, client, onboard.levels)
        if point.coarser > 1 or point.shift_m:
            wrong = _wrong_levels(base, truth, point, start, client)
            onboard = Map(wrong, onboard.error, onboard.post_spacing_m)
        write_json(one.folder / "frames.json", {"service_ms": truth.service_ms})
        one.fly(seeds, truth, onboard, point.detector)


def _wrong_levels(base, truth, point, start, client):
    """What the lander is given instead; its planners don't know, so that the rehearsal is that of the right map."""
    if point.coarser == 1:
        return flight.map_levels(base, client, truth.post_spacing_m, INITIAL, point.shift_m)
    with start(scenarios.coarser(base, point.coarser)) as other:
        return flight.map_levels(base, other, truth.post_spacing_m, INITIAL)
