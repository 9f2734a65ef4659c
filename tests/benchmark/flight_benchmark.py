#!/usr/bin/env python3
"""The flight table: what a camera in flight waits for on tiles of real size, against one that hovers.

    SELENOGRAPH_BINARY=build/selenograph tests/benchmark/flight_benchmark.py TILES [--rows ROW,ROW...] [--frames N]
        [--detail NAME] [--indirect] [--sun-step DEG] [--rate HZ]

TILES is what `build/selenograph_real_size_tiles COARSE_FOLDER TILES` makes, or a folder of tiles. Each frame is
1024 x 1024 pixels of `radiance` as octet-stream over one kept connection, Sun at 15 degrees; times are the client's,
from the request to the last byte.

    cold     empty cache folder, tiles in the page cache: the first frame, ingest, and gdaladdo
             -r average on copies of the tiles, one after the other; medians of three. Ratios are per post: tiles that
             aren't on the lattice are interpolated to more posts
    disk     bytes of the cache folder after ingest, over those of the .img files
    hover    one pose again and again, turned by 0.001 degrees a frame; restart: first frames of new services, warm disk
    orbit    15 km high, 160 m a frame at HZ, over its hovering
    descent  from 100 km to 100 m above the ground at HZ, over 5 repetitions of each pose
    memory   resident memory while frames at full speed cross all tiles, --cache-mb 256 --scene-mb 256

A restart and a flight begin with the tiles and the cache folder read once, hovering at its first pose; nothing else is
in the service's memory. N replaces the 300 frames of a flight, the 3000 of
`memory` and, where it is less, the 60 of hovering: it is a trial then. NAME is a detail of deploy/assets, for all
frames, which --indirect gives light from terrain. In flights the Sun rises by DEG a frame; left out: it stands. HZ is
10; a machine on which a frame takes longer has time between frames at a lower rate.
"""

import argparse
import concurrent.futures
import glob
import http.client
import json
import math
import os
import re
import shutil
import statistics
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness  # noqa: E402

ROWS = ("cold", "disk", "hover", "orbit", "descent", "memory")
SETS = ("sldem2013", "seamless")
SIDE_PX = 1024
SMALLER_PX = (768, 512)  # where --scene-mb of the row `memory` refuses SIDE_PX
COLD_STARTS = 3
FOV_DEG, HIGH_FOV_DEG = 50.0, 60.0
ELEVATION_DEG = 15.0
LOW_M, HIGH_M, LANDED_M = 15000.0, 100000.0, 100.0
STEP_M, MEMORY_STEP_M = 160.0, 640.0
TRACK_AZIMUTH_DEG = 30.0
BORDER_DEG = 0.45  # half a diagonal of the view from LOW_M: the track keeps away so far from the border
RATE_HZ = 10.0
FLIGHT_FRAMES, HOVER_FRAMES, MEMORY_FRAMES = 300, 60, 3000
AHEAD = 16
BUDGET_MB = 256
PATIENCE_S = 1800
METRES_PER_DEGREE = math.radians(1737400.0)
FACTORS = ("2", "4", "8", "16", "32", "64")


def row(name, what, figure, ratio=None, target=None):
    """Of figures with a target, the last column says what became of it."""
    met = "" if target is None else "met" if ratio <= target else "MISSED"
    print(f"  {name:<8} {what:<46} {figure:>14} {'' if ratio is None else format(ratio, '.2f'):>8} "
          f"{'' if target is None else f'<= {target:g}':>8}  {met}".rstrip(), flush=True)


def note(text):
    print(f"           {text}", flush=True)


def quantile(values, share):
    return sorted(values)[math.ceil(share * len(values)) - 1]


def ms(value):
    return f"{value:.1f} ms"


class Area:
    """Where the tiles of a folder lie, and the places and requests of the flights over them."""

    def __init__(self, folder, members, sun_step_deg=0.0):
        self.members, self.sun_step_deg = members, sun_step_deg
        text = ""
        for name in glob.glob(os.path.join(folder, "*.lbl")):
            with open(name) as label:
                text += label.read()

        def all_of(member):  # posts end short of the border, which is at a whole degree
            return [round(float(value)) for value in re.findall(rf"^ *{member} *= *([-\d.]+)", text, re.M)]

        self.south, self.north = min(all_of("MINIMUM_LATITUDE")), max(all_of("MAXIMUM_LATITUDE"))
        self.west, self.east = min(all_of("WESTERNMOST_LONGITUDE")), max(all_of("EASTERNMOST_LONGITUDE"))
        self.middle = ((self.south + self.north) / 2, (self.west + self.east) / 2)
        per_degree = max(float(value) for value in re.findall(r"^ *MAP_RESOLUTION *= *([\d.]+)", text, re.M))
        self.posts_made = (2 ** math.ceil(math.log2(per_degree)) / per_degree) ** 2  # of each post of a tile

    def on_track(self, i, step_m=STEP_M):
        """Place of frame i on a straight track that starts in the south-west and is folded back at the borders."""
        def folded(way, low, high):
            way %= 2 * (high - low)
            return low + min(way, 2 * (high - low) - way)

        north = i * step_m * math.cos(math.radians(TRACK_AZIMUTH_DEG)) / METRES_PER_DEGREE
        east = i * step_m * math.sin(math.radians(TRACK_AZIMUTH_DEG)) / METRES_PER_DEGREE
        return (folded(north, self.south + BORDER_DEG, self.north - BORDER_DEG),
                folded(east / math.cos(math.radians(self.middle[0])), self.west + BORDER_DEG, self.east - BORDER_DEG))

    def orbit(self, frames):
        return [pose(self.on_track(i), LOW_M) for i in range(frames)]

    def descent(self, frames, ground_m):
        fall = (LANDED_M / HIGH_M) ** (1 / max(1, frames - 1))
        return [pose(self.middle, ground_m + HIGH_M * fall ** i) for i in range(frames)]

    def body(self, of_pose, fov_deg=FOV_DEG, ahead=(), side_px=SIDE_PX, elevation_deg=ELEVATION_DEG):
        lat, lon = self.middle
        request = harness.frame_request(["radiance"], side_px, side_px, pose=of_pose, sun={
            "local": {"lat_deg": lat, "lon_deg": lon, "azimuth_deg": 90.0, "elevation_deg": elevation_deg}})
        request["camera"]["fov_deg"] = fov_deg
        request.update(self.members)
        if ahead:
            request["ahead"] = list(ahead)
        return json.dumps(request).encode()

    def bodies(self, poses, ahead):
        return [self.body(p, ahead=poses[i + 1:i + 1 + AHEAD] if ahead else (),
                          elevation_deg=ELEVATION_DEG + i * self.sun_step_deg) for i, p in enumerate(poses)]

    def hovering(self, at, frames):
        """Each a little turned, so that no answer is one that was given before."""
        azimuth = at["nadir"]["up_azimuth_deg"]
        return [self.body(dict(at, nadir={"up_azimuth_deg": azimuth + 0.001 * (i + 1)})) for i in range(frames)]


def pose(place, height_m):
    return {"geodetic": {"lat_deg": place[0], "lon_deg": place[1], "height_m": height_m},
            "nadir": {"up_azimuth_deg": TRACK_AZIMUTH_DEG}}


class Refused(Exception):
    """Another answer than a frame."""


class Client:
    """A service of its own, one connection to it, and the buffer that all frames are received in."""

    def __init__(self, tiles, cache, *options):
        start = time.perf_counter()
        self.service = harness.Service("--deadline-s", str(PATIENCE_S), "--log-level", "warning", "--assets-dir",
                                       os.path.join(harness.REPOSITORY, "deploy", "assets"), *options, cache=cache,
                                       dem=tiles)
        self.start_s = time.perf_counter() - start
        self.connection = self.service.connect(PATIENCE_S)
        self.connection.connect()
        self.buffer = memoryview(bytearray(4 * SIDE_PX * SIDE_PX))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.connection.close()
        self.service.stop()

    def frame(self, body, side_px=SIDE_PX):
        """Milliseconds until the frame was here, and the answer's Server-Timing."""
        start = time.perf_counter()
        self.connection.request("POST", "/v1/frames", body=body, headers={
            "Content-Type": "application/json", "Accept": "application/octet-stream"})
        answer = self.connection.getresponse()
        if answer.status != 200 or answer.length != 4 * side_px * side_px:
            raise Refused(f"{answer.status}: {answer.read()[:600].decode(errors='replace').strip()}")
        view = self.buffer[:answer.length]
        while view:
            got = answer.readinto(view)
            if not got:
                raise Refused("the answer ended early")
            view = view[got:]
        answer.read()  # nothing is left: the connection is free for the next request
        return 1000 * (time.perf_counter() - start), answer.headers["Server-Timing"]

    def median(self, bodies):
        return statistics.median(self.frame(body)[0] for body in bodies)

    def paced(self, bodies, rate_hz):
        """Times, those of the stages by name, and how many started late: at once, where their tick had passed."""
        times, stages, late = [], {}, 0
        start = time.perf_counter()
        for i, body in enumerate(bodies):
            wait_s = start + i / rate_hz - time.perf_counter()
            if wait_s > 0:
                time.sleep(wait_s)
            elif i > 0:
                late += 1
            took, timing = self.frame(body)
            times.append(took)
            for name, value in re.findall(r"(\w+);dur=([\d.]+)", timing):
                stages.setdefault(name, []).append(float(value))
        return times, stages, late

    def knows_ahead(self, area):
        """Asks for one frame with it. An unknown member is 422."""
        at = pose(area.middle, LOW_M)
        status, _, content = self.service.ask("POST", "/v1/frames", area.body(at, ahead=[at]), {
            "Content-Type": "application/json", "Accept": "application/octet-stream"}, self.connection)
        if status != 200 and not (status == 422 and b"ahead" in content):
            raise Refused(f"{status}: {content[:600].decode(errors='replace')}")
        return status == 200

    def metrics(self):
        text = self.service.ask("GET", "/metrics", connection=self.connection)[2].decode()
        return re.findall(r"^([^#\s]\S*) (\S+)$", text, re.M)


class Table:
    """The rows of one set of tiles."""

    def __init__(self, name, tiles, frames, area, rate_hz=RATE_HZ):
        self.name, self.tiles, self.area = name, tiles, area
        self.rate_hz = rate_hz
        self.flight_frames = frames or FLIGHT_FRAMES
        self.memory_frames = frames or MEMORY_FRAMES
        self.hover_frames = min(frames or HOVER_FRAMES, HOVER_FRAMES)
        self.images = sorted(glob.glob(os.path.join(tiles, "*.img")))
        self.image_bytes = sum(os.path.getsize(image) for image in self.images)
        self.warm = harness.path("cache-" + name)
        self.ingested = False
        self.ahead = None

    def ingest(self):
        """The warm cache folder, made by the first row that wants it."""
        if not self.ingested:
            self.read_tiles()
            self.ingested_s(self.warm)
            self.ingested = True
        return self.warm

    def ingested_s(self, cache):
        start = time.perf_counter()
        done = harness.run("ingest", "--cache-dir", cache, "--dem", self.tiles, "--log-level", "warning")
        took = time.perf_counter() - start
        if done.returncode:
            raise Refused(done.stderr[-600:])
        return took

    def read_tiles(self):
        self.read(self.images)

    def warm_disk(self):
        """The folder of what ingest made, all of which, and the tiles, are in the page cache now, not only some time ago."""
        cache = self.ingest()
        self.read_tiles()
        self.read(os.path.join(folder, file) for folder, _, files in os.walk(cache) for file in files)
        return cache

    @staticmethod
    def read(paths):
        for path in paths:
            with open(path, "rb") as file:
                while file.read(1 << 24):
                    pass

    def gdaladdo(self, processes):
        """Seconds for all tiles, so many at a time."""
        scratch = harness.path("gdaladdo-" + self.name)
        shutil.copytree(self.tiles, scratch)
        labels = sorted(glob.glob(os.path.join(scratch, "*.lbl")))
        start = time.perf_counter()
        with concurrent.futures.ThreadPoolExecutor(processes) as pool:
            for _ in pool.map(lambda label: subprocess.run(
                    ["gdaladdo", "-q", "-r", "average", "-ro", label, *FACTORS], check=True), labels):
                pass
        took = time.perf_counter() - start
        shutil.rmtree(scratch)
        return took

    def cold(self):
        self.read_tiles()
        cache = harness.path("cold-" + self.name)
        starts = []

        def median(run):
            """Of several times over an empty cache folder."""
            times = []
            for _ in range(COLD_STARTS):
                times.append(run())
                shutil.rmtree(cache, ignore_errors=True)
            return statistics.median(times)

        def first_frame(body):
            with Client(self.tiles, cache) as client:
                starts.append(client.start_s)
                return client.frame(body)[0] / 1000

        one = two = None
        if shutil.which("gdaladdo"):
            one, two = (median(lambda: self.gdaladdo(processes)) for processes in (1, 2))
            row("gdaladdo", f"{len(self.images)} tiles, one after the other", f"{one:.2f} s")
            row("", "two at a time", f"{two:.2f} s", two / one)
        else:
            note("no gdaladdo to compare with: apt-get install gdal-bin")
        views = (("100 km, 60 degrees", self.area.body(pose(self.area.middle, HIGH_M), HIGH_FOV_DEG)),
                 ("15 km", self.area.body(pose(self.area.on_track(FLIGHT_FRAMES // 2), LOW_M))))
        as_many = one and one * self.area.posts_made

        def compare(stage, what, seconds):
            row(stage, f"{what}; / gdaladdo", f"{seconds:.2f} s", as_many and seconds / as_many, as_many and 0.8)

        for name, body in views:
            compare("cold", f"first frame, {name}", median(lambda: first_frame(body)))
        compare("", "ingest", median(lambda: self.ingested_s(cache)))
        if self.area.posts_made > 1.001:
            note(f"ratios are per post: {self.area.posts_made:.2f} are made of each of the tile's")
        row("", "catalogue: start until the service listens", f"{statistics.median(starts):.2f} s")

    def disk(self):
        used = sum(os.path.getsize(os.path.join(folder, file)) for folder, _, files in os.walk(self.ingest())
                   for file in files)
        row("disk", f"cache folder / {self.image_bytes / 1e6:.0f} MB of tiles", f"{used / 1e6:.0f} MB",
            used / self.image_bytes)

    def hover(self):
        at = pose(self.area.on_track(FLIGHT_FRAMES // 2), LOW_M)
        with Client(self.tiles, self.ingest()) as client:
            client.median(self.area.hovering(at, 5))
            hovering = client.median(self.area.hovering(at, self.hover_frames))
            paced = statistics.median(client.paced(self.area.hovering(at, self.hover_frames), self.rate_hz)[0])
        firsts, starts = [], []
        for _ in range(3):
            with Client(self.tiles, self.warm_disk()) as client:
                starts.append(client.start_s)
                firsts.append(client.frame(self.area.body(at))[0])
        row("restart", "first frame, worst of 3; / hovering", ms(max(firsts)), max(firsts) / hovering, 6)
        row("", "start until the service listens", f"{max(starts):.2f} s")
        row("hover", f"15 km, median of {self.hover_frames} at full speed", ms(hovering))
        row("", f"at {self.rate_hz:g} Hz; / at full speed", ms(paced), paced / hovering)

    def orbit(self):
        self.with_and_without_ahead("orbit", self.orbit_once)

    def orbit_once(self, ahead):
        poses = self.area.orbit(self.flight_frames)
        with Client(self.tiles, self.warm_disk()) as client:
            client.median(self.area.hovering(poses[0], 5))
            flown = client.paced(self.area.bodies(poses, ahead), self.rate_hz)
            counters = client.metrics()
            there = []
            for at in (poses[0], poses[len(poses) // 2], poses[-1]):
                client.median(self.area.hovering(at, 3))
                there += [client.frame(body)[0] for body in self.area.hovering(at, math.ceil(self.hover_frames / 3))]
        hovering = statistics.median(there)
        row("orbit", f"{self.title(ahead)}; hovering along it", ms(hovering))
        for what, value, target in (("median", statistics.median(flown[0]), 1.3), ("99 %", quantile(flown[0], 0.99), 2),
                                    ("worst", max(flown[0]), 4)):
            row("", f"{what}; / hovering", ms(value), value / hovering, target)
        self.notes(flown, counters)

    def descent(self):
        self.with_and_without_ahead("descent", self.descent_once)

    def descent_once(self, ahead):
        with Client(self.tiles, self.warm_disk()) as client:
            lat, lon = self.area.middle
            ground = json.loads(client.service.ask("GET", f"/v1/height?lat_deg={lat}&lon_deg={lon}")[2])
            poses = self.area.descent(self.flight_frames, ground["height_m"])
            client.median(self.area.hovering(poses[0], 5))
            flown = client.paced(self.area.bodies(poses, ahead), self.rate_hz)
            counters = client.metrics()
            hovering = [client.median(self.area.hovering(at, 5)) for at in poses]
        ratios = [took / still for took, still in zip(flown[0], hovering)]
        row("descent", f"{self.title(ahead)}; median of its hovering", ms(statistics.median(hovering)))
        for what, of, target in (("median; of frames / their own hovering", statistics.median, 1.5),
                                 ("99 %", lambda values: quantile(values, 0.99), 2.5), ("worst", max, 4)):
            row("", what, ms(of(flown[0])), of(ratios), target)
        worst = ratios.index(max(ratios))
        note(f"worst ratio: frame {worst}, {poses[worst]['geodetic']['height_m'] - ground['height_m']:.0f} m above the "
             f"ground, {flown[0][worst]:.1f} over {hovering[worst]:.1f} ms")
        self.notes(flown, counters)

    def memory(self):
        self.with_and_without_ahead("memory", self.memory_once)

    def memory_once(self, ahead):
        limit_mb = 1.15 * 2 * BUDGET_MB
        places = [self.area.on_track(i, MEMORY_STEP_M) for i in range(self.memory_frames)]
        poses = [pose(place, LOW_M) for place in places]
        resident, refused = [], []
        sides, made = [*sorted(SMALLER_PX), SIDE_PX], {}
        with Client(self.tiles, self.ingest(), "--cache-mb", str(BUDGET_MB), "--scene-mb", str(BUDGET_MB)) as client:
            idle_mb = client.service.resident_mb("VmRSS")
            for i, at in enumerate(poses):
                while True:
                    body = self.area.body(at, ahead=poses[i + 1:i + 1 + AHEAD] if ahead else (), side_px=sides[-1])
                    try:
                        client.frame(body, sides[-1])
                        made[sides[-1]] = made.get(sides[-1], 0) + 1
                        break
                    except Refused as problem:
                        if len(sides) == 1 or not str(problem).startswith("422"):
                            raise
                        refused.append(f"{sides.pop()} px from frame {i} on, {problem}")
                if i % 50 == 49 or i + 1 == len(poses):
                    resident.append(client.service.resident_mb("VmRSS"))
            peak_mb = client.service.resident_mb("VmHWM")
            evictions = dict(client.metrics()).get("selenograph_terrain_cache_evictions_total", "no count of")
        tiles = len({(math.floor(lat), math.floor(lon)) for lat, lon in places})
        row("memory", f"{len(poses)} frames{' with `ahead`' if ahead else ''}; / both budgets + 15 %",
            f"{max(resident):.0f} MiB", max(resident) / limit_mb, 1)
        note(f"VmRSS {idle_mb:.0f} MiB idle, {resident[-1]:.0f} at the end, VmHWM {peak_mb:.0f}; limit {limit_mb:.0f}; "
             f"{tiles} square degrees below the camera, {evictions} evictions")
        for problem in refused:
            detail = re.search(r'"detail":"([^"]*)"', problem)
            note(f"refused {problem.split(':')[0]}: {detail[1] if detail else problem}")
        if refused:
            note("the figure is that of smaller frames: " + ", ".join(f"{n} of {px} px" for px, n in made.items()))

    def with_and_without_ahead(self, name, once):
        once(False)
        if self.ahead is None:
            with Client(self.tiles, self.ingest()) as client:
                self.ahead = client.knows_ahead(self.area)
        if self.ahead:
            once(True)
        else:
            row(name, "with `ahead`: not known to this binary", "-")

    def title(self, ahead):
        return f"{self.flight_frames} frames" + (" with `ahead`" if ahead else "")

    @staticmethod
    def notes(flown, counters):
        times, stages, late = flown
        note(f"{late} of {len(times)} frames started late; stages, median and most ms:")
        parts = [f"{name} {statistics.median(values):.1f} {max(values):.1f}" for name, values in stages.items()]
        for i in range(0, len(parts), 6):
            note("  " + ", ".join(parts[i:i + 6]))
        for name, value in counters:
            if "prefetch" in name:
                note(f"  {name} {value}")


FAILURES = (Refused, RuntimeError, OSError, http.client.HTTPException, subprocess.SubprocessError)


def machine():
    with open("/proc/cpuinfo") as file:
        model = re.search(r"^model name\s*: (.*)$", file.read(), re.M)
    return (f"{model[1] if model else os.uname().machine}, {len(os.sched_getaffinity(0))} cores; "
            f"load {os.getloadavg()[0]:.1f} at the start")


def rows_of(text):
    rows = text.split(",")
    if not set(rows) <= set(ROWS):
        raise argparse.ArgumentTypeError("rows are " + ",".join(ROWS))
    return rows


def positive(text):
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("at least 1")
    return value


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tiles", metavar="TILES")
    parser.add_argument("--rows", type=rows_of, default=ROWS)
    parser.add_argument("--frames", type=positive)
    parser.add_argument("--detail", metavar="NAME")
    parser.add_argument("--indirect", action="store_true")
    parser.add_argument("--sun-step", metavar="DEG", type=float, default=0.0)
    parser.add_argument("--rate", metavar="HZ", type=float, default=RATE_HZ)
    asked = parser.parse_args()
    if not asked.rate > 0:
        parser.error("--rate must be above 0")
    if not os.access(harness.BINARY, os.X_OK):
        sys.exit("set SELENOGRAPH_BINARY to the executable")
    members = {"detail": asked.detail} if asked.detail else {}
    if asked.indirect:
        members["indirect"] = {"terrain": True}
    version = subprocess.run([harness.BINARY, "--version"], stdout=subprocess.PIPE, text=True, check=True).stdout
    print(f"selenograph {version.strip()}; {machine()}")
    print(f"{SIDE_PX} x {SIDE_PX} radiance, octet-stream, one client{'; a trial' if asked.frames else ''}"
          f"{f'; {members}' if members else ''}{f'; Sun {asked.sun_step:g} degrees a frame' if asked.sun_step else ''}")
    unfinished = 0
    harness.set_up()
    try:
        own = glob.glob(os.path.join(asked.tiles, "*.lbl"))
        for name in (os.path.basename(os.path.abspath(asked.tiles)),) if own else SETS:
            folder = os.path.abspath(asked.tiles if own else os.path.join(asked.tiles, name))
            if not glob.glob(os.path.join(folder, "*.lbl")):
                print(f"{name}: no tiles in {folder}")
                continue
            table = Table(name, folder, asked.frames, Area(folder, members, asked.sun_step), asked.rate)
            print(f"\n{f'{name}, tiles: {len(table.images)}':<57} {'figure':>14} {'ratio':>8} {'target':>8}")
            for wanted in asked.rows:
                try:
                    getattr(table, wanted)()
                except FAILURES as problem:
                    unfinished += 1
                    row(wanted, "NOT FINISHED", "-")
                    note(f"{type(problem).__name__}: {problem}")
            shutil.rmtree(table.warm, ignore_errors=True)
    finally:
        harness.tear_down()
    return 1 if unfinished else 0


if __name__ == "__main__":
    sys.exit(main())
