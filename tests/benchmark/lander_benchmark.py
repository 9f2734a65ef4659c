#!/usr/bin/env python3
"""What a lander's measurements cost, each as one request and its answer: a lidar's million beams of seven sub-rays 100 m over
ground with detail and rocks, rays as JSON and as arrays, hazard maps. Times are the best of five, of the client: with everything.

    SELENOGRAPH_BINARY=build/selenograph PYTHONPATH=tests/service python3 tests/benchmark/lander_benchmark.py
"""

import io
import json
import os
import time

import numpy as np

import harness
from harness import Service

ASSETS = os.path.join(harness.REPOSITORY, "deploy", "assets")
PLACE = {"lat_deg": 0.1, "lon_deg": 30.1}
NPZ = "application/x-npz"
INSTRUMENT = {"divergence_mrad": 0.5, "pulse_length_ns": 1, "wavelength_um": 1.55, "threshold": 10, "dark_count_hz": 1e6,
              "range_gate_m": [10, 2000],
              "receiver": {"signal": "photon_counting", "energy_j": 1e-5, "aperture_m": 0.04, "efficiency": 0.15}}


def best(ask, times=5):
    taken = []
    for _ in range(times):
        start = time.perf_counter()
        status, _, body = ask()
        taken.append(time.perf_counter() - start)
        assert status == 200, body[:500]
    return f"{min(taken):.2f} s (first {taken[0]:.2f} s), {len(body) / 1e6:.0f} MB"


def main():
    harness.set_up()
    harness.sample("dem", *harness.PLACE, "--columns", "2", "--ppd", "1024")
    service = Service("--assets-dir", ASSETS, "--max-body-kb", "16384")
    ground_m = json.loads(service.ask("GET", "/v1/height?lat_deg=0.1&lon_deg=30.1")[2])["height_m"]
    pose = {"geodetic": {**PLACE, "height_m": ground_m + 100}, "nadir": {}}
    for fov_deg in (10, 20, 40):
        for detail in (None, "landing"):
            pattern = {"scan": "flash", "columns": 1000, "rows": 1000, "fov_x_deg": fov_deg}
            scan = {"instrument": INSTRUMENT, "pattern": pattern, "pose": pose, "detail": detail, "seed": 1}
            scan = {name: value for name, value in scan.items() if value is not None}
            print(f"1 000 000 beams of 7 sub-rays, {fov_deg} degrees, {detail or 'no detail'}:",
                  best(lambda: service.post("/v1/lidar", scan, NPZ)), flush=True)
    slope = np.tan(np.radians(10)) * np.linspace(-1, 1, 256)
    x, y = np.meshgrid(slope, slope)
    origin_m = np.array(service.arrays({**scan, "pattern": {**pattern, "columns": 1, "rows": 1}}, "/v1/lidar")["origin_m"][0])
    down = -origin_m / np.linalg.norm(origin_m)
    east = np.cross(down, [0, 0, 1.0])
    directions = down + x[..., None] * east + y[..., None] * np.cross(down, east)
    listed = {"rays": [{"origin_m": origin_m.tolist(), "direction": d.tolist()} for d in directions.reshape(-1, 3)]}
    body = io.BytesIO()
    np.savez(body, origin_m=np.broadcast_to(origin_m, directions.shape), direction=directions)
    for name, detail in (("no detail", {}), ("landing", {"detail": "landing"})):
        print(f"256 x 256 rays as JSON, {name}:", best(lambda: service.post("/v1/rays", {**listed, **detail}, "application/json")))
        body = io.BytesIO()
        np.savez(body, origin_m=np.broadcast_to(origin_m, directions.shape), direction=directions, request=json.dumps(detail))
        print(f"256 x 256 rays as arrays, {name}:", best(lambda: service.ask(
            "POST", "/v1/rays", body.getvalue(), {"Content-Type": NPZ, "Accept": NPZ})), flush=True)
    every = ["height", "slope", "roughness", "rock_height", "rock_cover", "hazard"]
    for name, products in (("hazard", ["hazard"]), ("six products", every)):
        asked = {"map": {"projection": "orthographic", "center": PLACE, "gsd_m": 0.1, "width_m": 100, "height_m": 100},
                 "detail": "landing", "rocks": True, "footprint": {"diameter_m": 8.0}, "products": products,
                 "hazard": {"max_slope_deg": 10, "max_roughness_m": 0.3, "max_rock_height_m": 0.3}}
        print(f"hazard map of 1000 x 1000 at 0.1 m, {name}:",
              best(lambda: service.post("/v1/maps", asked, "image/tiff")), flush=True)
    service.stop()
    harness.tear_down()


if __name__ == "__main__":
    main()
