#!/usr/bin/env python3
"""What a second camera at the same instant costs in flight, over two requests of their own.

    SELENOGRAPH_BINARY=build/selenograph tests/benchmark/cameras_benchmark.py TILES [--frames N]

TILES is a folder of DEM tiles that hold 0 to 1 N, 10 to 12 E, such as `build/selenograph sample TILES --south-deg -2
--west-deg 8 --rows 4 --columns 4 --ppd 4096` makes. Each set of cameras has a service of its own; they are asked in
turn, so that each prepares its next instant while the others answer. Cameras have 1024 x 1024 pixels of `radiance`, the
Sun is at 15 degrees, the answers are .npz; times are the client's. The first frames, which load the terrain, don't count.
"""

import argparse
import json
import math
import os
import re
import statistics
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness  # noqa: E402

SETS = (("down",), ("right",), ("narrow",), ("ahead",), ("down", "right"), ("down", "narrow"), ("down", "ahead"))
FLIGHTS = ((15000.0, 800.0), (3000.0, 100.0))  # height, way from instant to instant
FIRST = 5
BASELINE_M = 0.5
METRES_PER_DEGREE = math.radians(1737400.0)
SUN = {"local": {"lat_deg": 0.1, "lon_deg": 10.0, "azimuth_deg": 90.0, "elevation_deg": 15.0}}


def camera(name, way_m, height_m):
    def at(east_m):
        return {"lat_deg": 0.1, "lon_deg": 10.2 + east_m / METRES_PER_DEGREE}

    pose = {"geodetic": {**at(way_m + (BASELINE_M if name == "right" else 0.0)), "height_m": height_m}}
    if name == "ahead":
        pose["look_at"] = at(way_m + height_m)
    else:
        pose["nadir"] = {"up_azimuth_deg": 90.0}
    return {"camera": {"width": 1024, "height": 1024, "fov_deg": 10.0 if name == "narrow" else 45.0}, "pose": pose,
            "products": ["radiance"]}


def milliseconds(service, connection, names, way_m, height_m):
    request = {"sun": SUN, "cameras": {name: camera(name, way_m, height_m) for name in names}}
    start = time.perf_counter()
    status, headers, content = service.ask("POST", "/v1/frames", json.dumps(request), {
        "Content-Type": "application/json", "Accept": "application/x-npz"}, connection)
    took = 1000 * (time.perf_counter() - start)
    if status != 200:
        sys.exit(f"{status}: {content[:600].decode(errors='replace')}")
    return took, dict((name, float(value)) for name, value in re.findall(r"(\w+);dur=([\d.]+)", headers["Server-Timing"]))


def flight(tiles, height_m, step_m, frames):
    services = [harness.Service("--cache-mb", "512", "--scene-mb", "512", dem=tiles) for _ in SETS]
    connections = [service.connect() for service in services]
    times, stages = [[] for _ in SETS], [[] for _ in SETS]
    for i in range(FIRST + frames):
        for k, names in enumerate(SETS):
            took, timing = milliseconds(services[k], connections[k], names, i * step_m, height_m)
            if i >= FIRST:
                times[k].append(took)
                stages[k].append(timing)
    for service in services:
        service.stop()
    alone = {}
    print(f"{height_m:.0f} m high, {step_m:.0f} m an instant, {frames} of them: median and worst ms")
    for k, names in enumerate(SETS):
        median, worst = statistics.median(times[k]), max(times[k])
        over = ""
        if len(names) == 1:
            alone[names[0]] = median
        else:
            over = f"  {median / sum(alone[name] for name in names):.2f} of their own requests"
        of_stage = "  ".join(f"{name} {statistics.mean(s.get(name, 0.0) for s in stages[k]):.1f}"
                             for name in ("select", "build", "draw", "resolve", "shadow", "encode"))
        print(f"  {' + '.join(names):<14} {median:6.1f} {worst:6.1f}{over:<30}  mean: {of_stage}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tiles", metavar="TILES")
    parser.add_argument("--frames", type=int, default=60)
    asked = parser.parse_args()
    harness.set_up()
    try:
        for height_m, step_m in FLIGHTS:
            flight(os.path.abspath(asked.tiles), height_m, step_m, asked.frames)
    finally:
        harness.tear_down()


if __name__ == "__main__":
    main()
