#!/usr/bin/env python3
"""What members of a request cost: frames with them over the same frame without, hovering, as a service's first, and
under a new Sun.

    SELENOGRAPH_BINARY=build/selenograph tests/benchmark/members_benchmark.py DEM LAT,LON HEIGHT_M,... MEMBERS...

DEM is a folder of tiles; the camera looks straight down from so high above the ground at a place. MEMBERS is JSON, such
as '{"detail": "landing"}' or '{"indirect": {"terrain": true}}'. Frames are 1024 x 1024 pixels of `radiance` as
octet-stream, 50 degrees wide, Sun at 15 degrees. Hovering, the camera turns by 0.001 degrees a frame, and one service
is asked for both frames in turn, N times. First frames are those of services that start on a cache folder with the
tiles' pyramids and without made ground, as often as --starts says; each is followed by the same frame with the Sun
three degrees further around. Printed are medians of the client's wall time and of the service's processor time and, in
brackets, their ratios.
"""

import argparse
import json
import os
import statistics
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness  # noqa: E402

SIDE_PX, FOV_DEG, SUN_DEG = 1024, 50.0, 15.0
NEW_SUN_AZIMUTH_DEG = 93.0
ASSETS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "deploy", "assets")
WARM_UP = 3


class Place:
    def __init__(self, dem, lat_deg, lon_deg):
        self.dem, self.at = os.path.abspath(dem), {"lat_deg": lat_deg, "lon_deg": lon_deg}
        with self.service() as service:
            status, _, body = service.ask("GET", f"/v1/height?lat_deg={lat_deg}&lon_deg={lon_deg}")
            height_m = json.loads(body).get("height_m") if status == 200 else None
            if height_m is None:
                sys.exit(f"no ground there: {body.decode(errors='replace')}")
            self.ground_m = height_m

    def service(self):
        return Served(harness.Service("--assets-dir", ASSETS, "--log-level", "warning", "--ground-disk-mb", "0", dem=self.dem))

    def body(self, height_m, turn, members, sun_azimuth_deg=90.0):
        geodetic = {**self.at, "height_m": self.ground_m + height_m}
        return json.dumps({
            "camera": {"width": SIDE_PX, "height": SIDE_PX, "fov_deg": FOV_DEG}, "products": ["radiance"],
            "pose": {"geodetic": geodetic, "nadir": {"up_azimuth_deg": 30 + 0.001 * turn}},
            "sun": {"local": {**self.at, "azimuth_deg": sun_azimuth_deg, "elevation_deg": SUN_DEG}}, **members})


class Served:
    def __init__(self, service):
        self.service, self.connection = service, service.connect()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.connection.close()
        self.service.stop()

    def ask(self, method, path):
        return self.service.ask(method, path, connection=self.connection)

    def frame(self, body):
        """Wall and processor time, ms."""
        before, start = self.processor_ms(), time.perf_counter()
        status, _, content = self.service.ask("POST", "/v1/frames", body, {
            "Content-Type": "application/json", "Accept": "application/octet-stream"}, self.connection)
        wall = 1000 * (time.perf_counter() - start)
        if status != 200:
            sys.exit(f"{status}: {content[:600].decode(errors='replace')}")
        return wall, self.processor_ms() - before

    def processor_ms(self):
        tasks, total_ns = f"/proc/{self.service.process.pid}/task", 0
        for task in os.listdir(tasks):
            with open(f"{tasks}/{task}/schedstat") as file:
                total_ns += int(file.read().split()[0])
        return total_ns / 1e6


def medians(times):
    return [[statistics.median(column) for column in zip(*took)] for took in times]


def hovering(place, height_m, sets, frames):
    """Medians of wall and processor time of each set of members."""
    times = [[] for _ in sets]
    with place.service() as served:
        for i in range(-WARM_UP, frames):
            for k, members in enumerate(sets):
                took = served.frame(place.body(height_m, i, members))
                if i >= 0:
                    times[k].append(took)
    return medians(times)


def first(place, height_m, sets, starts):
    """The same of first frames, followed by those under a new Sun."""
    times = [[] for _ in sets]
    for _ in range(starts):
        for k, members in enumerate(sets):
            with place.service() as served:
                times[k].append([*served.frame(place.body(height_m, 0, members)),
                                 *served.frame(place.body(height_m, 0, members, NEW_SUN_AZIMUTH_DEG))])
    return medians(times)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dem", metavar="DEM")
    parser.add_argument("place", metavar="LAT,LON", help="degrees")
    parser.add_argument("heights", metavar="HEIGHT_M,...", help="above the ground")
    parser.add_argument("members", metavar="MEMBERS", nargs="+", type=json.loads, help="a JSON object")
    parser.add_argument("--frames", type=int, default=25)
    parser.add_argument("--starts", type=int, default=5)
    asked = parser.parse_args()
    harness.set_up()
    try:
        place = Place(asked.dem, *map(float, asked.place.split(",")))
        sets = [{}, *asked.members]
        print(f"{'':>7} {'':<34} " + " ".join(f"{name:>18} {'processor':>18}" for name in ("hovering", "first frame", "new Sun")))
        for height_m in map(float, asked.heights.split(",")):
            warm, cold = (measure(place, height_m, sets, times)
                          for measure, times in ((hovering, asked.frames), (first, asked.starts)))
            for members, *rows in zip(sets, warm, cold):
                cells = [pair for row, plain in zip(rows, (warm[0], cold[0])) for pair in zip(row, plain)]
                text = (f"{ms:6.0f} ms" + (f" ({ms / plain:4.2f})" if members else " " * 7) for ms, plain in cells)
                print(f"{height_m:5.0f} m {json.dumps(members) if members else 'plain':<34} "
                      + " ".join(f"{cell:>18}" for cell in text), flush=True)
    finally:
        harness.tear_down()


if __name__ == "__main__":
    main()
