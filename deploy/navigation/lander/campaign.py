"""Single flights, Monte Carlo and sweeps; what they find goes to files for the report."""

import json
import multiprocessing
import platform
import time

import numpy as np

from . import consistency, flight, inertial, scenarios
from .camera import Detector

INITIAL, IMU = flight.InitialError(), inertial.Imu()
_shared = {}  # truth and map, inherited by forked processes


def _machine():
    with open("/proc/cpuinfo") as lines:
        models = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    model = models[0] if models else platform.machine()
    return f"{model}, {multiprocessing.cpu_count()} cores"


def _prepared(scenario, client):
    start = time.monotonic()
    truth = flight.Truth(scenario, client)
    rendered = time.monotonic()
    onboard = flight.onboard_map(scenario, client, truth.post_spacing_m, INITIAL)
    gsds = ", ".join(f"{level.gsd_m:.0f}" for level in onboard.levels)
    print(f"{scenario.name}: {len(truth.frames)} frames in {rendered - start:.1f} s, "
          f"map levels of {gsds} m in {time.monotonic() - rendered:.1f} s", flush=True)
    return truth, onboard


def _one(job):
    seed, detector = job
    start = time.monotonic()
    rows = flight.fly(_shared["truth"], _shared["map"], IMU, INITIAL, seed, detector)
    return rows, time.monotonic() - start


def flown(truth, onboard, runs, seed, processes, detector=Detector()):
    """(runs, frames, columns), and the mean seconds of a run."""
    _shared.update(truth=truth, map=onboard)
    jobs = [(seed + i, detector) for i in range(runs)]
    if processes < 2 or runs < 2:
        done = [_one(job) for job in jobs]
    else:
        with multiprocessing.get_context("fork").Pool(processes) as pool:
            done = []
            for i, result in enumerate(pool.imap(_one, jobs, chunksize=1)):
                done.append(result)
                print(f"run {i + 1} of {runs}: {result[0][-1, 2]:.1f} m at the end, {result[1]:.0f} s", flush=True)
    return np.array([rows for rows, _ in done]), float(np.mean([seconds for _, seconds in done]))


def _conditions(scenario, truth, onboard, runs, seed, seconds):
    return {
        "scenario": scenario.name, "runs": runs, "first_seed": seed, "frames": len(truth.frames),
        "camera_px": scenario.camera.side, "focal_px": scenario.camera.focal, "duration_s": scenario.descent.duration_s,
        "post_spacing_m": truth.post_spacing_m, "map_gsd_m": [level.gsd_m for level in onboard.levels],
        "flight_sun": scenario.flight_sun["local"], "map_sun": scenario.map_sun["local"],
        "initial_rms": {"position_m": INITIAL.position_m, "velocity_m_s": INITIAL.velocity_m_s,
                        "attitude_deg": INITIAL.attitude_deg},
        "navigation_ms_per_frame": 1000 * seconds / len(truth.frames), "machine": _machine(),
    }


def _written(output, name, runs, conditions):
    np.savez_compressed(output / f"{name}.npz", runs=runs.astype(np.float32), columns=np.array(flight.COLUMNS))
    (output / f"{name}.json").write_text(json.dumps(conditions, indent=2) + "\n")


def fly(scenario, client, seed, output):
    truth, onboard = _prepared(scenario, client)
    runs, seconds = flown(truth, onboard, 1, seed, 1)
    _written(output, "fly", runs, _conditions(scenario, truth, onboard, 1, seed, seconds))


def monte_carlo(scenario, client, count, seed, processes, output):
    truth, onboard = _prepared(scenario, client)
    runs, seconds = flown(truth, onboard, count, seed, processes)
    _written(output, "monte-carlo", runs, _conditions(scenario, truth, onboard, count, seed, seconds))


def sweep(name, side, client, count, seed, processes, output):
    """One thing changed at a time; each point renders its own frames, or its own map."""
    more = {"side": side} if side else {}
    made = scenarios.ALL[name]
    base = made(**more)
    onboard = _prepared(base, client)[1]
    points = []

    def point(what, value, truth, onboard, detector=Detector()):
        runs, _ = flown(truth, onboard, count, seed, processes, detector)
        position = consistency.column(runs, flight.COLUMNS, "position_error_m")
        half = position.shape[1] // 2
        points.append({"what": what, "value": value, "runs": count,
                       "position_rms_m": float(np.sqrt(np.mean(position[:, half:] ** 2))),
                       "end_rms_m": float(np.sqrt(np.mean(position[:, -1] ** 2))),
                       "matches": float(consistency.column(runs, flight.COLUMNS, "matches")[:, half:].mean())})
        print(json.dumps(points[-1]), flush=True)
        (output / "sweep.json").write_text(json.dumps(points, indent=2) + "\n")

    azimuth, elevation = (base.flight_sun["local"][k] for k in ("azimuth_deg", "elevation_deg"))
    for value in (105, 95, 45, 285):
        truth = flight.Truth(made(flight=(value, elevation), **more), client)
        point("flight Sun's azimuth, deg", value, truth, onboard)
    for value in (5, 10, 30):
        truth = flight.Truth(made(flight=(azimuth, value), **more), client)
        point("flight Sun's elevation, deg", value, truth, onboard)
    truth = flight.Truth(base, client)
    for value in (20, 80, 320):
        point("read noise, electrons", value, truth, onboard, Detector(read_noise_e=value))
    for value in (2, 8):
        point("max_error_px", value, flight.Truth(base, client, accuracy={"max_error_px": value}), onboard)
    point("shadows", "hard", truth, onboard)
    soft = flight.Truth(base, client, sun={**base.flight_sun, "angular_radius_deg": 0.2666})
    point("shadows", "soft", soft, onboard)
