#!/usr/bin/env python3
"""What is left of a pyramid by a killed process, a bad disk or an operator never changes an answer.

Every round compares with the bytes that a clean cache gave. Python's standard library and NumPy only.
"""

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import time
import unittest

import harness
from harness import BINARY, frame_request, PATIENCE_S, run, Service, tearDownModule

SEED = 20261120
KILLS = int(os.environ.get("RECOVERY_KILLS", "2"))
PRODUCTS = ("radiance", "range", "normal", "lit", "source")
SUN = {"local": {"lat_deg": 0.0, "lon_deg": 31.0, "azimuth_deg": 90.0, "elevation_deg": 15.0}}
POINTS = [{"lat_deg": 0.05 + 0.09 * i, "lon_deg": 31.05 + 0.09 * ((3 * i) % 11)} for i in range(11)]

DEM = ""
ANSWERS = []  # what a clean cache gives
FILES = {}    # the pyramid's files by name, as a clean cache gets them
SERVED = set()  # names of those that ANSWERS need
DURATION_S = {}  # of building the pyramid


def frame_from(height_m, fov_deg, max_error_px):
    request = frame_request(PRODUCTS, sun=SUN, accuracy={"max_error_px": max_error_px})
    request["camera"]["fov_deg"] = fov_deg
    request["pose"] = {"geodetic": {"lat_deg": 0.45, "lon_deg": 31.4, "height_m": height_m}, "nadir": {"up_azimuth_deg": 20.0}}
    return request


NEAR = frame_from(15e3, 30.0, 0)  # the posts themselves
FAR = frame_from(1500e3, 4.0, 0.5)  # the coarse part of the pyramid


def setUpModule():
    global DEM, ANSWERS, FILES, SERVED
    harness.set_up()
    # Tiles fine enough that coarse parts of the pyramid are made from finer ones.
    DEM = harness.sample("dem", "--south-deg", "0", "--west-deg", "31", "--rows", "1", "--columns", "2", "--ppd", "2048")
    started = time.monotonic()
    assert run("ingest", "--cache-dir", harness.path("reference"), "--dem", DEM).returncode == 0
    DURATION_S["ingest"] = time.monotonic() - started
    FILES = files_of("reference")
    assert len(FILES) > 3, FILES.keys()
    service = Service(cache="clean")
    started = time.monotonic()
    ANSWERS = answers(service)
    DURATION_S["serve"] = time.monotonic() - started
    assert service.stop() == 0
    SERVED = set(files_of("clean"))


def answers(service):
    frames = [service.frame(request, "application/x-npz") for request in (FAR, NEAR)]
    heights = service.post("/v1/heights", {"points": POINTS})
    assert [a[0] for a in (*frames, heights)] == [200] * 3, [a[2][:300] for a in (*frames, heights)]
    return [a[2] for a in (*frames, heights)]


def names_in(cache):
    for folder, _, names in os.walk(harness.path(cache)):
        for name in names:
            yield os.path.relpath(os.path.join(folder, name), harness.path(cache))


def files_of(cache):
    found = {}
    for name in names_in(cache):
        if name.endswith(".sgp"):
            with open(harness.path(cache, name), "rb") as file:
                found[name] = file.read()
    return found


def temporaries(cache):
    return [name for name in names_in(cache) if ".tmp-" in name]


@contextlib.contextmanager
def cache_folder(name, copy_of=None):
    """A cache that is gone afterwards."""
    folder = harness.path(name)
    if copy_of:
        shutil.copytree(harness.path(copy_of), folder)
    else:
        os.makedirs(folder)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


class Recovery(unittest.TestCase):
    def assert_same(self, got, wanted, what):
        self.assertTrue(got == wanted, what)  # megabytes: not to be printed

    def assert_complete(self, cache):
        files = files_of(cache)
        self.assertEqual(files.keys(), FILES.keys())
        for name, content in files.items():
            self.assert_same(content, FILES[name], f"{name} is not what a clean cache has")


class Killed(Recovery):
    def kill_ingest(self, cache, moment):
        """True: it was killed before it was done."""
        started = time.monotonic()
        command = [BINARY, "ingest", "--cache-dir", harness.path(cache), "--dem", DEM]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            try:
                process.wait(moment * DURATION_S["ingest"])
            except subprocess.TimeoutExpired:
                process.kill()
                return True
        DURATION_S["ingest"] = min(DURATION_S["ingest"], time.monotonic() - started)  # the machine was busy before
        return False

    def kill_serve(self, cache, moment):
        service = Service(cache=cache)
        clients = [service.start_frame(FAR), service.start_frame(NEAR)]
        time.sleep(moment * DURATION_S["serve"])
        service.kill()
        for client in clients:
            client.close()
        return not SERVED <= files_of(cache).keys()

    def recover(self, cache):
        for name, content in files_of(cache).items():
            self.assert_same(content, FILES[name], f"{name}: a file appears whole or not at all")
        service = Service(cache=cache)
        self.assertEqual(temporaries(cache), [])
        self.assert_same(answers(service), ANSWERS, "another answer than with a clean cache")
        self.assertEqual(service.metric("selenograph_terrain_chunks_rejected_total"), 0)
        self.assertEqual(service.stop(), 0)
        self.assertEqual(run("ingest", "--cache-dir", harness.path(cache), "--dem", DEM).returncode, 0)
        self.assert_complete(cache)
        self.assertEqual(temporaries(cache), [])

    def test_at_random_moments(self):
        moments = random.Random(SEED)
        unfinished = 0
        for i in range(KILLS):
            kill = self.kill_serve if i % 2 else self.kill_ingest
            moment = (i // 2 + moments.random()) / (KILLS // 2)  # spread over the whole build
            with self.subTest(kill=kill.__name__, moment=round(moment, 3)), cache_folder("killed") as cache:
                unfinished += kill(cache, moment)
                self.recover(cache)
        print(f"{unfinished} of {KILLS} were killed before the pyramid was complete", end=" ", flush=True)
        self.assertGreaterEqual(unfinished, KILLS // 4)  # else the moments were not what they are meant to be

    def test_in_the_middle_of_a_write(self):
        with cache_folder("torn") as cache:
            command = [BINARY, "ingest", "--cache-dir", cache, "--dem", DEM]
            with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
                while process.poll() is None and not temporaries(cache):
                    pass
                process.kill()
            self.recover(cache)


class Interrupted(Recovery):
    def interrupt(self, cache, stop):
        """Exit status of an ingest that got the signal after its first piece, and what it said then."""
        command = [BINARY, "ingest", "--cache-dir", cache, "--dem", DEM]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            for line in process.stderr:
                if " 1/" in line:
                    break
            process.send_signal(stop)
            said = process.communicate(timeout=PATIENCE_S)[1]
            return process.returncode, said

    def assert_resumes(self, cache):
        done = {name: os.stat(os.path.join(cache, name)) for name in files_of(cache)}
        self.assertTrue(0 < len(done) < len(FILES), done.keys())
        self.assertEqual(temporaries(cache), [])
        self.assertEqual(run("ingest", "--cache-dir", cache, "--dem", DEM).returncode, 0)
        self.assert_complete(cache)
        for name, before in done.items():
            after = os.stat(os.path.join(cache, name))
            self.assertEqual((after.st_ino, after.st_mtime_ns), (before.st_ino, before.st_mtime_ns), f"{name} was made again")
        self.assertIn("nothing to do", run("ingest", "--cache-dir", cache, "--dem", DEM).stdout)

    def test_ingest_goes_on_where_it_was(self):
        for stop in (signal.SIGINT, signal.SIGTERM):
            for _ in range(10):  # on a busy machine it may be done before the signal comes
                with self.subTest(signal=stop.name), cache_folder("interrupted") as cache:
                    status, said = self.interrupt(cache, stop)
                    if status == 0:
                        continue
                    self.assertEqual(status, 130, said)
                    self.assertIn("run the same command to continue", said)
                    self.assert_resumes(cache)
                    break
            else:
                self.fail("it was always done before the signal came")


class Damaged(Recovery):
    """Files of the pyramid that are not what was written."""

    @classmethod
    def setUpClass(cls):
        cls.fine = max(FILES, key=lambda name: (name.split(os.sep)[1], len(FILES[name])))
        cls.request = harness.path("near.json")
        with open(cls.request, "w") as file:
            json.dump(NEAR, file)

    def render(self, cache, **options):
        output = os.path.join(harness.path(), "damaged.npz")
        done = run("ask", "frames", self.request, "-o", output, "--cache-dir", cache, "--dem", DEM, **options)
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(output, "rb") as file:
            return file.read()

    def test_while_the_service_runs(self):
        """Files truncated, removed and overwritten under a service that has them open."""
        with cache_folder("live", copy_of="reference") as cache:
            service = Service(cache=cache)
            self.assert_same(service.frame(FAR, "application/x-npz")[2], ANSWERS[0], "far")
            for i, (name, content) in enumerate(sorted(FILES.items())):
                path = os.path.join(cache, name)
                if i % 3 == 0:
                    os.truncate(path, len(content) // 3)
                elif i % 3 == 1:
                    os.remove(path)
                else:
                    with open(path, "r+b") as file:
                        file.write(bytes(len(content)))
            self.assert_same(answers(service), ANSWERS, "another answer than with a clean cache")
            self.assertEqual(service.stop(), 0)

    def test_of_another_place(self):
        """A whole and sound file, but of another part of the pyramid."""
        with cache_folder("swapped", copy_of="reference") as cache:
            other = next(name for name in FILES if name != self.fine and os.path.dirname(name) == os.path.dirname(self.fine))
            shutil.copyfile(os.path.join(cache, other), os.path.join(cache, self.fine))
            self.assert_same(self.render(cache), ANSWERS[1], "another answer than with a clean cache")
            self.assert_complete(cache)


if __name__ == "__main__":
    harness.main()
