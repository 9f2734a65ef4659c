#!/usr/bin/env python3
"""The campaign table: frames per second and bytes read per frame of `selenograph batch`, by one and by two processes that
share a cache folder.

    SELENOGRAPH_BINARY=build/selenograph tests/benchmark/campaign_benchmark.py [--dem TILES] [--frames N] [--size PX]

Without TILES on sample terrain. The pyramid is built by `ingest` first; the campaigns must not change it. Frames are
`radiance` as .npz, SIZE x SIZE pixels, nadir from 10 to 30 km, all over the terrain in no order, Sun at 15 degrees. Each
process is one shard, started together with the others; the rate counts from the first process's start to the last one's
end. Bytes read are those of read() and the like (/proc/PID/io, rchar),
whether the disk or the system's memory has them; bytes from disk are read_bytes, CPU seconds those of all threads.

The first line says the machine and its load: on a busy machine the figures are to be taken again.
"""

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness  # noqa: E402

SEED = 20261122
CORES = len(os.sched_getaffinity(0))
# Processes, render threads of each, frames in work in each.
CASES = ((1, CORES, 1), (1, CORES, 2), (2, CORES, 1), (2, max(1, CORES // 2), 1), (2, max(1, CORES // 2), 2))


def machine():
    with open("/proc/cpuinfo") as file:
        model = re.search(r"model name\s*: (.*)", file.read())
    return f"{model[1] if model else 'unknown processor'}, {CORES} cores; load {' '.join(f'{x:.1f}' for x in os.getloadavg())}"


def bounds(terrain):
    """South, north, west, east of the data, in degrees."""
    done = subprocess.run([harness.BINARY, "info", "--json", *terrain], stdout=subprocess.PIPE, check=True)
    boxes = [tile["footprint"] for tile in json.loads(done.stdout)["datasets"]]
    return (min(b["south_deg"] for b in boxes), max(b["north_deg"] for b in boxes), min(b["west_deg"] for b in boxes),
            max(b["east_deg"] for b in boxes))


def write_manifest(path, frames, size, box, border_deg=0.5):
    numbers = random.Random(SEED)
    south, north, west, east = box
    with open(path, "w") as file:
        for _ in range(frames):
            place = {"lat_deg": numbers.uniform(south + border_deg, north - border_deg),
                     "lon_deg": numbers.uniform(west + border_deg, east - border_deg)}
            file.write(json.dumps({
                "camera": {"model": "pinhole", "width": size, "height": size, "fov_deg": 50},
                "pose": {"geodetic": {**place, "height_m": numbers.uniform(10e3, 30e3)}, "nadir": {"up_azimuth_deg": 0}},
                "sun": {"local": {**place, "azimuth_deg": 90, "elevation_deg": 15}}, "products": ["radiance"]}) + "\n")


def state(folder):
    return sorted((os.path.join(at, name), os.stat(os.path.join(at, name)).st_mtime_ns)
                  for at, _, names in os.walk(folder) for name in names if name.endswith(".sgp"))


def run_case(manifest, folder, terrain, processes, threads, in_work):
    shutil.rmtree(folder, ignore_errors=True)
    started = time.monotonic()
    running = [subprocess.Popen([harness.BINARY, "batch", manifest, "-o", folder, "--shard", f"{i}/{processes}", "--threads",
                                 str(threads), "--in-work", str(in_work), "--log-level", "error", *terrain],
                                stdout=subprocess.DEVNULL) for i in range(processes)]
    counts = {"rchar": 0, "wchar": 0, "read_bytes": 0}
    cpu_s = 0.0
    for process in running:
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)  # its counts are there until it is waited for
        with open(f"/proc/{process.pid}/io") as file:
            for line in file:
                name, _, value = line.partition(": ")
                if name in counts:
                    counts[name] += int(value)
        usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(usage[1])
        cpu_s += usage[2].ru_utime + usage[2].ru_stime
        assert process.returncode == 0, process.returncode
    seconds = time.monotonic() - started
    return seconds, counts, cpu_s


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--dem", help="tiles (default: sample terrain)")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--size", type=int, default=1024)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="selenograph-campaign-") as root:
        harness.use(root)
        terrain = ["--dem", options.dem or harness.sample("dem"), "--cache-dir", harness.path("cache")]
        subprocess.run([harness.BINARY, "ingest", *terrain], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        manifest = harness.path("manifest.jsonl")
        write_manifest(manifest, options.frames, options.size, bounds(terrain))
        before = state(harness.path("cache"))
        print(f"{machine()}; {options.frames} frames of {options.size} x {options.size}\n")
        print("| processes | threads each | in work each | frames a second | MB read a frame | "
              "of these from disk | MB written a frame | CPU s a frame |\n|---|---|---|---|---|---|---|---|")
        for processes, threads, in_work in CASES:
            seconds, counts, cpu_s = run_case(manifest, harness.path("out"), terrain, processes, threads, in_work)
            n = options.frames
            print(f"| {processes} | {threads} | {in_work} | {n / seconds:.2f} | {counts['rchar'] / n / 1e6:.2f} | "
                  f"{counts['read_bytes'] / n / 1e6:.2f} | {counts['wchar'] / n / 1e6:.2f} | {cpu_s / n:.4f} |", flush=True)
        assert state(harness.path("cache")) == before, "a campaign changed the pyramid"
        print(f"\nload at the end: {' '.join(f'{x:.1f}' for x in os.getloadavg())}")


if __name__ == "__main__":
    main()
