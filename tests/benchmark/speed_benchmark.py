#!/usr/bin/env python3
"""Two binaries side by side: the same requests in turn, with the machine's widest vectors and with AVX2.

    tests/benchmark/speed_benchmark.py OLD NEW [--rounds N] [--only TEXT] [--folder DIR]

Prints a table per vector target, in Markdown: the median time that a client waits for the answer of each binary, their ratio
with the quartiles of the ratios of single rounds, the ratio of processor times, and the share of each stage in the new
binary's time (`Server-Timing`). Ground and pyramids are warm. A row that a binary refuses is printed without figures. `deploy/check speed` builds two commits and calls this.
"""

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness  # noqa: E402

SAMPLE = {"lat_deg": -6.5, "lon_deg": 40.0}
HADLEY = {"lat_deg": 26.13, "lon_deg": 3.63}
ARRAY, PNG, NPZ = "application/octet-stream", "image/png", "application/x-npz"
# Disables every vector target above AVX2 (a lower bit is a better target). Embree chooses its own.
NARROW = "#include <hwy/targets.h>\n__attribute__((constructor)) static void narrow() { hwy::DisableTargets(HWY_AVX2 - 1); }\n"


class Row:
    """Requests of one kind: the documents are sent in turn, each `repeats` times, so that a row may change its Sun."""

    def __init__(self, name, documents, path="/v1/frames", accept=ARRAY, terrain="sample", repeats=1):
        self.name, self.documents, self.path, self.accept = name, documents, path, accept
        self.terrain, self.repeats = terrain, repeats


def frame(place, height_m, sun_deg, size=1024, azimuth_deg=90.0, tilt_deg=0, **members):
    request = harness.frame_request(["radiance"], size, size)
    request["camera"]["fov_deg"] = 50.0
    request["pose"] = {"geodetic": {**place, "height_m": height_m}}
    if tilt_deg:
        distance_deg = height_m * 1.7 / 30323.0  # to the ground that is seen 60 degrees off nadir
        request["pose"]["look_at"] = {"lat_deg": place["lat_deg"] + distance_deg, "lon_deg": place["lon_deg"], "height_m": 0,
                                      "up": "north"}
    else:
        request["pose"]["nadir"] = {"up_azimuth_deg": 0.0}
    request["sun"] = {"local": {**place, "azimuth_deg": azimuth_deg, "elevation_deg": sun_deg}}
    del request["accuracy"]
    return {**request, **members}


def rows(ground_m):
    """`ground_m`: height of the ground below the low rows."""
    low = frame(SAMPLE, ground_m + 300, 20, detail="landing")
    image = {"products": ["image"], "surface": {"preset": "moon"}}
    with open(os.path.join(harness.REPOSITORY, "deploy", "assets", "cameras", "navigation-camera.json")) as file:
        navigation_camera = json.load(file)
    del navigation_camera["description"]
    south = {**SAMPLE, "lat_deg": SAMPLE["lat_deg"] - 0.3}
    lidar = {"instrument_preset": "flash", "detail": "landing", "pose": {"geodetic": {**SAMPLE, "height_m": ground_m + 300},
                                                                  "nadir": {"up_azimuth_deg": 0.0}}}
    terrain_map = {"map": {"projection": "orthographic", "center": SAMPLE, "width_m": 40000, "height_m": 40000, "gsd_m": 40},
                   "sun": frame(SAMPLE, 0, 15)["sun"], "products": ["radiance", "height", "slope"]}
    by_azimuth = [frame(SAMPLE, 15000, 10, 512, azimuth_deg=10.0 * k, indirect={}) for k in range(36)]
    return [
        Row("nadir from 30 km, Sun 3 degrees", [frame(SAMPLE, 30000, 3)]),
        Row("nadir from 30 km, Sun 15", [frame(SAMPLE, 30000, 15)]),
        Row("nadir from 30 km, Sun 45", [frame(SAMPLE, 30000, 45)]),
        Row("60 degrees oblique from 20 km, Sun 3", [frame(south, 20000, 3, tilt_deg=60)]),
        Row("60 degrees oblique from 20 km, Sun 15", [frame(south, 20000, 15, tilt_deg=60)]),
        Row("Hadley from 15 km, Sun 15", [frame(HADLEY, 15000, 15)], terrain="hadley"),
        Row("300 m, `landing`", [low]),
        Row("PNG, 2048 x 2048", [frame(SAMPLE, 30000, 15, 2048, **image)], accept=PNG),
        Row("`image` with a sensor", [frame(SAMPLE, 30000, 15, **image, **navigation_camera)]),
        Row("rows with times", [frame(SAMPLE, 30000, 15, shutter={"line_time_s": 1e-5, "velocity_m_s": [0, 0, 1600]})]),
        Row("light from terrain", [by_azimuth[0]]),
        Row("light from terrain, each frame a new Sun", by_azimuth),
        Row("map, 1000 x 1000", [terrain_map], path="/v1/maps", accept=NPZ),
        Row("lidar, flash from 300 m", [lidar], path="/v1/lidar", accept=NPZ),
        Row("cislunar, 1024 x 1024", [frame(SAMPLE, 3e7, 15, camera={"model": "pinhole", "width": 1024, "height": 1024,
                                                                     "fov_deg": 10.0})]),
        Row("1000 heights, one a request", [{"points": [SAMPLE]}], path="/v1/heights", accept="application/json", repeats=1000),
    ]


def processor_s(process):
    """Processor time of a running process, by its own clock (clock_getcpuclockid)."""
    return time.clock_gettime((~process.pid) << 3 | 2)


def assets_of(binary):
    """The assets of the commit in whose build folder the binary is: another commit's may have members that it does not know."""
    own = os.path.join(os.path.dirname(os.path.abspath(binary)), "..", "deploy", "assets")
    return own if os.path.isdir(own) else os.path.join(harness.REPOSITORY, "deploy", "assets")


class Side:
    """One binary with its services, a connection to each, and what was measured."""

    def __init__(self, name, binary, terrains, environment):
        self.services, self.connections = {}, {}
        for terrain, folder in terrains.items():
            options = ["--port", "0", "--cache-dir", harness.path("cache", name, terrain), "--dem", folder, "--assets-dir",
                       assets_of(binary)]
            # `limits` runs in the service's process, whose environment it may change.
            self.services[terrain] = harness.Service(binary=binary, options=options,
                                                     limits=lambda: os.environ.update(environment))
            self.connections[terrain] = self.services[terrain].connect(timeout=900)

    def ask(self, row, document):
        """Returns wall and processor time, ms, and the stages; None if the request is refused."""
        process, connection = self.services[row.terrain].process, self.connections[row.terrain]
        body = json.dumps(document).encode()
        headers = {"Content-Type": "application/json", "Accept": row.accept}
        used_s, start = processor_s(process), time.perf_counter()
        for _ in range(row.repeats):
            connection.request("POST", row.path, body, headers)
            answer = connection.getresponse()
            answer.read()
        wall_ms = 1000 * (time.perf_counter() - start)
        if answer.status != 200:
            return None
        stages = {name: float(ms) for name, ms in re.findall(r"(\w+);dur=([\d.]+)", answer.headers["Server-Timing"] or "")}
        return wall_ms, 1000 * (processor_s(process) - used_s), stages

    def stop(self):
        for service in self.services.values():
            service.stop()


def measure(row, sides, rounds):
    """Returns, per side, what its rounds took; None if a side refuses. The first two rounds load the ground."""
    taken = [[], []]
    for k in range(rounds + 2):
        document = row.documents[k % len(row.documents)]
        for i in ((0, 1) if k % 2 == 0 else (1, 0)):
            answer = sides[i].ask(row, document)
            if answer is None:
                return None
            if k >= 2:
                taken[i].append(answer)
    return taken


def table_row(row, taken):
    if taken is None:
        return f"| {row.name} | | | refused | | |"
    old, new = ([answer[0] for answer in side] for side in taken)
    old_ms, new_ms = statistics.median(old), statistics.median(new)
    low, _, high = statistics.quantiles([b / a for a, b in zip(old, new)], n=4)
    processor = [statistics.median(answer[1] for answer in side) for side in taken]
    total_ms = statistics.median(answer[2].get("total", 0) for answer in taken[1])
    stages = []
    for name in taken[1][0][2]:
        share = statistics.median(answer[2].get(name, 0) for answer in taken[1]) / total_ms if total_ms else 0
        if name != "total" and share >= 0.03:
            stages.append(f"{name} {share:.2f}")
    return (f"| {row.name} | {old_ms:.1f} | {new_ms:.1f} | {new_ms / old_ms:.2f} ({low:.2f} to {high:.2f}) "
            f"| {processor[1] / processor[0]:.2f} | {', '.join(stages)} |")


def processor():
    """Returns the processor's name and whether it has AVX-512."""
    with open("/proc/cpuinfo") as file:
        text = file.read()
    return re.search(r"model name\s*: (.*)", text)[1], " avx512f " in text


def compare(binaries, terrains, environment, options):
    sides = [Side(name, binary, terrains, environment) for name, binary in zip(("old", "new"), binaries)]
    answer = sides[1].services["sample"].ask("GET", "/v1/height?lat_deg={lat_deg}&lon_deg={lon_deg}".format(**SAMPLE))
    print("| row | old, ms | new, ms | new / old (quartiles) | processor time | stages of new |\n|---|---|---|---|---|---|")
    for row in rows(json.loads(answer[2])["height_m"]):
        if options.only in row.name and row.terrain in terrains:
            print(table_row(row, measure(row, sides, options.rounds)), flush=True)
    for side in sides:
        side.stop()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--only", default="", help="rows whose name contains this text")
    parser.add_argument("--folder", help="keeps terrain and pyramids for the next run")
    options = parser.parse_args()
    binaries = [os.path.abspath(options.old), os.path.abspath(options.new)]
    harness.BINARY = binaries[1]
    harness.use(options.folder) if options.folder else harness.set_up()
    try:
        if not os.path.isdir(harness.path("sample")):
            harness.sample("sample")
        terrains = {"sample": harness.path("sample")}
        if harness.shared_data("hadley"):
            terrains["hadley"] = harness.shared_data("hadley")
        narrow = harness.path("narrow.so")
        subprocess.run(["c++", "-shared", "-fPIC", "-x", "c++", "-", "-o", narrow, "-lhwy"], input=NARROW, text=True, check=True)
        name, has_avx512 = processor()
        for target, environment in (("AVX-512", {}), ("AVX2", {"LD_PRELOAD": narrow}))[0 if has_avx512 else 1:]:
            print(f"\n{target}: {name}, {os.cpu_count()} cores, medians of {options.rounds} rounds\n", flush=True)
            compare(binaries, terrains, environment, options)
    finally:
        harness.stop_all() if options.folder else harness.tear_down()


if __name__ == "__main__":
    main()
