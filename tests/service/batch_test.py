#!/usr/bin/env python3
"""`selenograph batch` and `batch verify`: a campaign's frames are complete and the service's, whatever interrupts it.

Python's standard library and NumPy only.
"""

import datetime
import io
import json
import math
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tarfile
import time
import unittest

import harness
from harness import BINARY, frame_request, PATIENCE_S, REPOSITORY, run, Service, tearDownModule

sys.path.insert(0, os.path.join(REPOSITORY, "api", "clients", "python"))
from selenograph import Trajectory  # noqa: E402

SEED = 20261122
KILLS = int(os.environ.get("BATCH_KILLS", "3"))
DONE, AGAIN, BAD = 0, 1, 2  # exit statuses
FRAME_BYTES = 4000  # more than half of each of requests()
BELOW_THE_GROUND = {"geodetic": {"lat_deg": 0, "lon_deg": 30, "height_m": -20000}, "nadir": {"up_azimuth_deg": 0}}

DEM = ""


def setUpModule():
    global DEM
    harness.set_up()
    DEM = harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "256")
    assert run("ingest", "--dem", DEM, "--cache-dir", harness.path("cache")).returncode == 0


def requests(count, size=16, **changes):
    """Frames all over the terrain, from several heights, in no order."""
    any_number = random.Random(SEED)
    for _ in range(count):
        place = {"lat_deg": any_number.uniform(-0.9, 0.9), "lon_deg": any_number.uniform(29.1, 30.9),
                 "height_m": any_number.choice([10e3, 20e3, 60e3])}
        yield frame_request(width=size, height=size, pose={"geodetic": place, "nadir": {"up_azimuth_deg": 0}}, **changes)


def manifest(lines, name="manifest.jsonl"):
    path = harness.path(name)
    with open(path, "w") as file:
        for line in lines:
            file.write((line if isinstance(line, str) else json.dumps(line)) + "\n")
    return path


def command(manifest_path, folder, *options):
    return ["batch", manifest_path, "-o", harness.path(folder), "--dem", DEM, "--cache-dir", harness.path("cache"),
            *options]


def batch(manifest_path, folder, *options, **more):
    return run(*command(manifest_path, folder, *options), **more)


def verify(manifest_path, folder, *options):
    return run("batch", "verify", manifest_path, "-o", harness.path(folder), *options)


def read(*parts):
    with open(harness.path(*parts), "rb") as file:
        return file.read()


def read_lines(path):
    with open(path) as file:
        return [json.loads(line) for line in file]


def contents(folder, suffix):
    return {name: read(folder, name) for name in sorted(os.listdir(harness.path(folder))) if name.endswith(suffix)}


def problems(folder):
    """The problem of each line that was refused, by its name."""
    return {name[:-len(".problem.json")]: json.loads(text) for name, text in contents(folder, ".problem.json").items()}


def unfinished(folder):
    return [name for name in os.listdir(harness.path(folder)) if ".tmp-" in name]


class Batch(unittest.TestCase):
    def setUp(self):
        self.remove("out")

    def remove(self, *folders):
        for folder in folders:
            shutil.rmtree(harness.path(folder), ignore_errors=True)

    def assert_status(self, done, status):
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)

    def interrupted(self, arguments, enough, how):
        """Starts the command, sends the signal (or calls what is to be done) when enough() says so; returns the exit
        status, and what it said."""
        with subprocess.Popen([BINARY, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            give_up = time.monotonic() + PATIENCE_S
            while process.poll() is None and not enough() and time.monotonic() < give_up:
                time.sleep(0.001)
            if process.poll() is None:
                how() if callable(how) else process.send_signal(how)
            said = process.communicate(timeout=PATIENCE_S)[0]
            return process.returncode, said

    def damage(self, name, change):
        content = bytearray(read("out", name))
        change(content)
        harness.write(os.path.join("out", name), content)

    def frames_in(self, folder):
        """About so many frames are written, finished or not."""
        try:
            sizes = [entry.stat().st_size for entry in os.scandir(harness.path(folder))]
        except FileNotFoundError:  # the folder, or a file that has its name now
            return 0
        return sum(sizes) // FRAME_BYTES


class Frames(Batch):
    def test_bytes_are_the_services(self):
        two = {"cameras": {"left": {"camera": {"width": 8, "height": 8, "fov_deg": 30}},
                           "right": {"camera": {"width": 9, "height": 8, "fov_deg": 30}}}}
        base = next(requests(1))
        several = {**{k: v for k, v in base.items() if k != "camera"}, **two}
        service = Service()
        for suffix, accept, asked in (
                ("npz", "application/x-npz", [*requests(3), frame_request(["image", "range"]), several]),
                ("exr", "image/x-exr", [frame_request(["radiance", "range"])]),
                ("tiff", "image/tiff", [frame_request(["range"])]),
                ("png", "image/png", [frame_request(["image"])])):
            with self.subTest(suffix=suffix):
                self.remove("out")
                path = manifest({"name": f"frame-{i}", **request} for i, request in enumerate(asked))
                self.assert_status(batch(path, "out", "--format", suffix), DONE)
                for i, request in enumerate(asked):
                    status, _, body = service.frame(request, accept)
                    self.assertEqual(status, 200, body[:300])
                    self.assertTrue(read("out", f"frame-{i}.{suffix}") == body, f"frame-{i}.{suffix}")
                # Each format has the content hash by which a frame is known.
                inodes = {entry.name: entry.inode() for entry in os.scandir(harness.path("out"))}
                again = batch(path, "out", "--format", suffix)
                self.assert_status(again, DONE)
                self.assertIn(f"0 frames rendered, {len(asked)} existed", again.stdout)
                self.assertEqual(inodes, {entry.name: entry.inode() for entry in os.scandir(harness.path("out"))})
                self.assert_status(verify(path, "out"), DONE)
                self.damage("frame-0." + suffix, lambda content: content.__delitem__(slice(len(content) // 2, None)))
                self.assert_status(verify(path, "out"), AGAIN)
        service.expect_clean_stop()

    def test_warnings_are_told_once(self):
        """However many frames have the same trouble; the texts are constant."""
        suns = [{"local": {"lat_deg": 0, "lon_deg": 30, "azimuth_deg": 90, "elevation_deg": up}} for up in (-20, -21, -22, 30)]
        lines = [frame_request(["image"], width=16, height=16, sun=sun) for sun in suns]
        for form in ("npz", "png"):
            done = batch(manifest(lines, "dark.jsonl"), "dark-" + form, "--format", form)
            self.assertEqual(done.returncode, DONE, done.stderr)
            said = [line for line in done.stdout.splitlines() if line.startswith("warning")]
            self.assertEqual(len(said), 1, done.stdout)
            self.assertRegex(said[0], "^warning, of 3 frames: no signal")

    def test_bad_lines_are_recorded_and_the_rest_is_rendered(self):
        good = list(requests(6))
        lines = [good[0], "{nonsense", {**good[1], "poes": 1}, {"name": "../up", **good[2]}, {"name": "twice", **good[3]},
                 {"name": "twice", **good[4]}, {**good[5], "pose": BELOW_THE_GROUND}, 17, {"name": 5, **good[0]},
                 '{"name": "a", "name": "b"}', {**good[5], "products": ["radiance", "depth"]}]
        path = manifest(lines)
        for _ in range(2):
            done = batch(path, "out")
            self.assert_status(done, BAD)
            self.assertIn("8 lines can never become a frame", done.stdout)
            self.assertEqual(sorted(contents("out", ".npz")), ["000001.npz", "000011.npz", "twice.npz"])
        found = problems("out")  # those that the manifest alone does not show
        self.assertEqual(sorted(found), ["000003", "000007", "000008"])
        self.assertEqual([e["pointer"] for e in found["000003"]["errors"]], ["/poes"])
        self.assertEqual([e["pointer"] for e in found["000007"]["errors"]], ["/pose"])
        self.assertEqual(found["000007"]["request"], lines[6])
        for words in ("line 2 (000002): ", "line 4 (000004): /name: ", "line 6 (twice): /name: ", "is the name of line 5",
                      "line 9 (000009): /name: ", "line 10 (000010): "):
            self.assertIn(words, done.stderr)
        self.assertIn("line 7 (000007)", done.stderr)
        checked = verify(path, "out", "--rerun", harness.path("rerun.jsonl"))
        self.assert_status(checked, BAD)
        self.assertEqual(read("rerun.jsonl"), b"")
        self.assertIn("3 frames done, 0 not done, 8 bad lines", checked.stdout)
        # A problem is that of its request: the line is mended, and rendered.
        lines[6]["pose"] = good[5]["pose"]
        mended = manifest(lines)
        self.assert_status(verify(mended, "out"), AGAIN)
        self.assert_status(batch(mended, "out"), BAD)
        self.assertEqual(sorted(problems("out")), ["000003", "000008"])
        # One format's problem is not the other's.
        self.assert_status(batch(manifest([lines[-1]]), "tiff", "--format", "tiff"), BAD)
        self.assertEqual(problems("tiff")["000001"]["errors"][0]["pointer"], "/products")

    def test_what_is_wrong_with_the_command(self):
        path = manifest(requests(1))
        for options, word in ((("--shard", "1/1"), "--shard"), (("--shard", "0/0"), "--shard"), (("--format", "gif"), "--format"),
                              (("--dem", harness.path("nowhere")), "nowhere")):
            with self.subTest(options=options):
                done = batch(path, "out", *options)
                self.assertNotEqual(done.returncode, 0)
                self.assertIn(word, done.stderr)
        misplaced = run("batch", "verify", path, "-o", harness.path("out"), "--format", "npz")
        self.assertGreater(misplaced.returncode, 100)
        self.assertIn("--format is an option of batch, not of verify", misplaced.stderr)
        for done in (batch(harness.path("nowhere.jsonl"), "out"), batch(manifest([], "empty.jsonl"), "out"), run("batch", path)):
            self.assert_status(done, AGAIN)
            self.assertIn("error: ", done.stderr)


class Interrupted(Batch):
    """What was finished stays, and is not made again."""

    @classmethod
    def setUpClass(cls):
        cls.path = manifest(requests(60), "interrupted.jsonl")
        done = batch(cls.path, "reference")
        assert done.returncode == 0, done.stderr
        cls.frames = contents("reference", ".npz")
        assert len(cls.frames) == 60

    def assert_complete(self, folder):
        self.assertTrue(contents(folder, ".npz") == self.frames)
        self.assert_status(verify(self.path, folder), DONE)
        self.assertEqual(unfinished(folder), [])

    def test_signals(self):
        for how in (signal.SIGTERM, signal.SIGINT):
            with self.subTest(signal=how.name):
                self.remove("out")
                status, said = self.interrupted(command(self.path, "out"), lambda: self.frames_in("out") > 10, how)
                self.assertEqual(status, AGAIN, said)
                self.assertIn("run the same command to continue", said)
                first = {n: os.stat(harness.path("out", n)) for n in contents("out", ".npz")}
                self.assertTrue(0 < len(first) < 60)
                self.assertEqual(unfinished("out"), [])
                again = batch(self.path, "out")
                self.assert_status(again, DONE)
                self.assertIn(f"{60 - len(first)} frames rendered, {len(first)} existed", again.stdout)
                for name, before in first.items():
                    after = os.stat(harness.path("out", name))
                    self.assertEqual((after.st_ino, after.st_mtime_ns), (before.st_ino, before.st_mtime_ns), name)
                self.assert_complete("out")

    def test_killed_again_and_again(self):
        moments = random.Random(SEED)
        lives = 0
        for _ in range(KILLS):
            target = self.frames_in("out") + moments.randrange(0, 12)
            status, said = self.interrupted(command(self.path, "out"), lambda: self.frames_in("out") >= target, signal.SIGKILL)
            lives += status == -signal.SIGKILL
            for name, content in contents("out", ".npz").items():
                self.assertTrue(content == self.frames[name], f"{name}: a frame appears whole or not at all")
            # A process killed while it writes leaves an unfinished file; here it does.
            if os.path.isdir(harness.path("out")):
                harness.write(os.path.join("out", "000060.npz.tmp-1-0"), b"torn")
        self.assertGreater(lives, 0)
        self.assert_status(batch(self.path, "out"), DONE)
        self.assert_complete("out")

    def test_shards_are_a_partition(self):
        for of in (3, 70):
            with self.subTest(of=of):
                self.remove("out")
                made = []
                for i in range(of) if of < 10 else (34, 69):
                    before = set(contents("out", ".npz")) if os.path.isdir(harness.path("out")) else set()
                    self.assert_status(batch(self.path, "out", "--shard", f"{i}/{of}"), DONE)
                    made.append(set(contents("out", ".npz")) - before)
                if of < 10:
                    self.assertEqual([len(m) for m in made], [20, 20, 20])
                    self.assert_complete("out")
                else:
                    self.assertTrue(all(len(m) <= 1 for m in made), made)
        # The others' frames count, however many shards they were.
        again = batch(self.path, "out")
        self.assert_status(again, DONE)
        self.assertIn(f"{60 - sum(map(len, made))} frames rendered, {sum(map(len, made))} existed", again.stdout)
        self.assert_complete("out")

    def test_a_shard_twice_at_once(self):
        """Both render it, one of them may give up; what is there is whole all the same."""
        with subprocess.Popen([BINARY, *command(self.path, "out")], stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as other:
            first = batch(self.path, "out")
            other.communicate(timeout=PATIENCE_S)
        self.assertIn(DONE, (first.returncode, other.returncode))
        for name, content in contents("out", ".npz").items():
            self.assertTrue(content == self.frames[name], name)
        self.assert_status(batch(self.path, "out"), DONE)
        self.assert_complete("out")

    def test_no_room(self):
        """A frame's file is over the limit for files: as on a full disk."""
        limit = max(map(len, self.frames.values())) // 2
        done = batch(self.path, "out", preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
        self.assert_status(done, AGAIN)
        self.assertRegex(done.stderr, r"error: .*\d{6}\.npz: File too large")
        self.assertEqual((unfinished("out"), contents("out", ".npz")), ([], {}))
        self.assert_status(batch(self.path, "out"), DONE)
        self.assert_complete("out")

    def test_a_folder_that_holds_other_frames(self):
        shutil.copytree(harness.path("reference"), harness.path("out"))
        lines = read_lines(self.path)
        lines[4]["accuracy"] = {"max_error_px": 2}
        changed = manifest(lines, "changed.jsonl")
        refused = batch(changed, "out")
        self.assert_status(refused, AGAIN)
        self.assertIn("000005.npz", refused.stderr)
        self.assertIn("--resume", refused.stderr)
        self.assertTrue(contents("out", ".npz") == self.frames)
        replaced = batch(changed, "out", "--resume")
        self.assert_status(replaced, DONE)
        self.assertIn("1 frames rendered, 59 existed", replaced.stdout)
        self.assertFalse(read("out", "000005.npz") == self.frames["000005.npz"])
        self.assert_status(verify(changed, "out"), DONE)
        # Back again: nothing remembers that line 5 was done before.
        self.assert_status(batch(self.path, "out", "--resume", "--shard", "0/1"), DONE)
        self.assert_complete("out")
        # A line that is refused gives up the frame of the earlier one.
        lines[4]["pose"] = BELOW_THE_GROUND
        self.assert_status(batch(manifest(lines, "changed.jsonl"), "out", "--resume"), BAD)
        self.assertFalse(os.path.exists(harness.path("out", "000005.npz")))
        self.assert_status(verify(changed, "out"), BAD)
        # A file that is no frame.
        os.makedirs(harness.path("foreign"))
        harness.write(os.path.join("foreign", "000002.npz"), b"mine")
        refused = batch(self.path, "foreign")
        self.assert_status(refused, AGAIN)
        self.assertIn("000002.npz", refused.stderr)
        self.assertEqual(read("foreign", "000002.npz"), b"mine")
        self.assert_status(batch(self.path, "foreign", "--resume"), DONE)
        self.assert_complete("foreign")

    def test_a_frame_that_is_there_twice(self):
        shutil.copytree(harness.path("reference"), harness.path("out"))
        self.assert_status(batch(manifest(read_lines(self.path)[:2]), "out", "--format", "webdataset"), DONE)
        done = verify(self.path, "out")
        self.assert_status(done, AGAIN)
        self.assertIn("58 frames done, 2 not done", done.stdout)
        self.assertRegex(done.stderr, r"line 2 \(000002\): is there twice, in .*000002\.npz.*: remove one")

    def test_other_terrain_is_another_campaign(self):
        shutil.copytree(harness.path("reference"), harness.path("out"))
        other = harness.sample("other", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd",
                               "256", "--seed", "5")
        refused = run("batch", self.path, "-o", harness.path("out"), "--dem", other, "--cache-dir", harness.path("cache"))
        self.assert_status(refused, AGAIN)
        self.assertIn("this terrain", refused.stderr)


class Verified(Batch):
    @classmethod
    def setUpClass(cls):
        cls.path = manifest(({"name": f"f{i:02}", **r} for i, r in enumerate(requests(12))), "verified.jsonl")
        assert batch(cls.path, "verified").returncode == 0
        cls.frames = contents("verified", ".npz")

    def setUp(self):
        super().setUp()
        shutil.copytree(harness.path("verified"), harness.path("out"))

    def test_missing_and_damaged(self):
        os.unlink(harness.path("out", "f03.npz"))
        self.damage("f05.npz", lambda c: c.__setitem__(len(c) // 2, c[len(c) // 2] ^ 1))
        self.damage("f06.npz", lambda c: c.pop())
        done = verify(self.path, "out")
        self.assert_status(done, AGAIN)
        self.assertIn("9 frames done, 3 not done, 0 bad lines", done.stdout)
        for words in ("not done: line 4 (f03): is not there", "not done: line 6 (f05): f05.npz is damaged",
                      "not done: line 7 (f06): f06.npz is damaged"):
            self.assertIn(words, done.stderr)
        self.assertEqual(done.stderr.count("damaged: "), 2)
        rerun = harness.path("rerun.jsonl")
        self.assert_status(verify(self.path, "out", "--rerun", rerun), AGAIN)
        names = [line["name"] for line in read_lines(rerun)]
        self.assertEqual(names, ["f03", "f05", "f06"])
        self.assert_status(batch(rerun, "out"), DONE)
        self.assert_status(verify(self.path, "out"), DONE)
        self.assertTrue(contents("out", ".npz") == self.frames)

    def test_names_by_number_stay_in_the_rerun(self):
        path = manifest(requests(5))
        self.assert_status(batch(path, "numbers"), DONE)
        wanted = contents("numbers", ".npz")
        os.unlink(harness.path("numbers", "000004.npz"))
        rerun = harness.path("rerun.jsonl")
        self.assert_status(verify(path, "numbers", "--missing", rerun), AGAIN)
        self.assert_status(batch(rerun, "numbers"), DONE)
        self.assertTrue(contents("numbers", ".npz") == wanted)

    def test_files_of_no_line(self):
        """They are neither frames of the manifest nor a reason to run again; a shard removes its own unfinished ones."""
        for name in ("stray.npz", "f11.npz.tmp-77-5", "f01.npz.tmp-77-6"):
            harness.write(os.path.join("out", name), b"?")
        done = verify(self.path, "out")
        self.assert_status(done, DONE)
        self.assertIn("12 frames done, 0 not done, 0 bad lines", done.stdout)
        self.assert_status(batch(self.path, "out", "--shard", "1/2"), DONE)
        self.assertEqual(unfinished("out"), ["f01.npz.tmp-77-6"])

    def test_not_rendered_yet(self):
        self.remove("out")
        os.makedirs(harness.path("out"))
        done = verify(self.path, "out")
        self.assert_status(done, AGAIN)
        self.assertIn("12 not done", done.stdout)
        self.assert_status(verify(self.path, "nowhere"), AGAIN)


class WebDataset(Batch):
    OPTIONS = ("--format", "webdataset", "--frames-per-tar", "7")

    @classmethod
    def setUpClass(cls):
        lines = list(requests(30))
        lines[3] = {**lines[3], "pose": BELOW_THE_GROUND}  # a bad line in the middle
        lines[20] = "{"
        cls.path = manifest(lines, "web.jsonl")
        done = batch(cls.path, "web", *cls.OPTIONS)
        assert done.returncode == BAD, done.stderr
        cls.tars = contents("web", ".tar")
        assert batch(cls.path, "plain").returncode == BAD
        cls.frames = contents("plain", ".npz")

    def assert_complete(self, folder):
        self.assertTrue(contents(folder, ".tar") == self.tars, sorted(contents(folder, ".tar")))
        self.assert_status(verify(self.path, folder), BAD)
        self.assertEqual(unfinished(folder), [])

    def test_members(self):
        self.assertEqual(list(self.tars), [f"frames-{i:06}.tar" for i in range(5)])
        members = {}
        for name, content in self.tars.items():
            with tarfile.open(fileobj=io.BytesIO(content)) as tar:
                for member in tar:
                    self.assertEqual((member.mtime, member.uid, member.gid, member.mode, member.uname), (0, 0, 0, 0o644, ""))
                    self.assertNotIn(member.name, members)
                    members[member.name] = tar.extractfile(member).read()
        self.assertTrue(members == self.frames)
        self.assertEqual(len(members), 28)

    def test_killed_at_random_moments(self):
        moments = random.Random(SEED + 1)
        lives, finished = 0, {}
        for i in range(KILLS):
            how = signal.SIGTERM if i % 3 == 2 else signal.SIGKILL
            target = self.frames_in("out") + moments.randrange(0, 9)
            status, said = self.interrupted(command(self.path, "out", *self.OPTIONS), lambda: self.frames_in("out") >= target, how)
            # SIGTERM before the program handles it ends the process like SIGKILL.
            self.assertIn(status, (-how, AGAIN, BAD), said)
            lives += status in (-how, AGAIN)
            for name, content in contents("out", ".tar").items():
                self.assertTrue(content == self.tars[name], f"{name}: a tar appears whole or not at all")
                state = os.stat(harness.path("out", name))
                known = finished.setdefault(name, (state.st_ino, state.st_mtime_ns))
                self.assertEqual(known, (state.st_ino, state.st_mtime_ns), "what is finished is not made again")
        self.assertGreater(lives, 0)
        self.assert_status(batch(self.path, "out", *self.OPTIONS), BAD)
        self.assert_complete("out")

    def test_however_many_shards(self):
        for i in (2, 0, 1):
            self.assertIn(batch(self.path, "out", *self.OPTIONS, "--shard", f"{i}/3").returncode, (DONE, BAD))
        self.assert_complete("out")

    def test_a_frame_at_a_time_or_several(self):
        self.assert_status(batch(self.path, "out", *self.OPTIONS, "--in-work", "5"), BAD)
        self.assert_complete("out")
        self.remove("out")
        self.assert_status(batch(self.path, "out", *self.OPTIONS, "--in-work", "1", "--threads", "1"), BAD)
        self.assert_complete("out")

    def test_damage_is_found_and_mended(self):
        shutil.copytree(harness.path("web"), harness.path("out"))
        content = bytearray(read("out", "frames-000001.tar"))
        content[3000] ^= 1
        harness.write(os.path.join("out", "frames-000001.tar"), content)
        os.unlink(harness.path("out", "frames-000003.tar"))
        rerun = harness.path("rerun.jsonl")
        done = verify(self.path, "out", "--rerun", rerun)
        self.assert_status(done, AGAIN)
        for words in ("damaged: ", "frames-000001.tar is damaged", "is not there"):
            self.assertIn(words, done.stderr)
        self.assertIn(read("rerun.jsonl").count(b"\n"), (13, 14))  # of two tars, perhaps without the bad line
        # Tars are mended by their own manifest, which makes them as they were.
        self.assert_status(batch(self.path, "out", *self.OPTIONS), BAD)
        self.assert_complete("out")

    def test_tars_of_another_manifest(self):
        shutil.copytree(harness.path("web"), harness.path("out"))
        other = manifest(requests(30, size=17), "other.jsonl")
        refused = batch(other, "out", *self.OPTIONS)
        self.assert_status(refused, AGAIN)
        self.assertRegex(refused.stderr, r"frames-000000\.tar: exists, but is not what lines 1 to 7 of .* --resume")
        self.assert_complete("out")
        self.assert_status(batch(other, "out", *self.OPTIONS, "--resume"), DONE)
        self.assert_status(verify(other, "out"), DONE)
        # Other tars of the same lines.
        refused = batch(self.path, "web", "--format", "webdataset", "--frames-per-tar", "8")
        self.assert_status(refused, AGAIN)
        self.assert_complete("web")

    def test_a_line_that_fails(self):
        """Its tar waits for the next run; the others are written, and the counts say so."""
        lines = list(requests(20))
        os.makedirs(harness.path("assets", "objects"), exist_ok=True)
        harness.write(os.path.join("assets", "objects", "torn.ply"), "ply")  # the operator may mend it: not the line's fault
        torn = {"mesh": "torn", "pose": {"geodetic": {"lat_deg": 0, "lon_deg": 30, "height_m": 0}, "upright": {}}, "material": {}}
        lines[7] = "{"
        options = (*self.OPTIONS, "--assets-dir", harness.path("assets"))
        path = manifest([*lines[:9], {**lines[9], "objects": [torn]}, *lines[10:]], "torn.jsonl")
        for existing in (0, 13):
            done = batch(path, "out", *options)
            self.assert_status(done, AGAIN)
            self.assertIn(f"{13 - existing} frames rendered, {existing} existed", done.stdout)
            for words in ("1 lines can never become a frame", "1 lines failed temporarily",
                          "5 frames of tars with a line that failed are left to the next run"):
                self.assertIn(words, done.stdout)
            self.assertNotIn("interrupted", done.stdout)
            self.assertEqual(list(contents("out", ".tar")), ["frames-000000.tar", "frames-000002.tar"])
            self.assertEqual(unfinished("out"), [])
        self.assertIn("13 frames done, 6 not done, 1 bad lines", verify(path, "out").stdout)
        again = batch(manifest(lines, "mended.jsonl"), "out", *self.OPTIONS)
        self.assert_status(again, BAD)
        self.assertIn("6 frames rendered, 13 existed", again.stdout)


class FromATrajectory(Batch):
    def test_the_python_client_makes_the_manifest(self):
        trajectory = Trajectory(range(3), [[1.757e6 * math.cos(x), 1.757e6 * math.sin(x), 3000.0] for x in (0.52, 0.53, 0.54)],
                                up_azimuth_deg=10.0, start=datetime.datetime(2026, 11, 20, tzinfo=datetime.timezone.utc))
        asked = list(trajectory.requests({"camera": {"model": "pinhole", "width": 16, "height": 12, "fov_deg": 40.0}}))
        self.assert_status(batch(manifest(asked), "out"), DONE)
        service = Service("--dem", DEM)
        for i, request in enumerate(asked):
            self.assertTrue(service.frame(request, "application/x-npz")[2] == read("out", f"{i + 1:06}.npz"))
        service.expect_clean_stop()

    def test_files_become_manifests(self):
        """A CSV file, and CCSDS messages of a place with a camera that turns by 90 degrees about its boresight."""
        harness.write("common.json", json.dumps(
            {"camera": {"width": 16, "height": 12, "fov_deg": 40.0}, "sun": {"direction": [1, 1, 0.2]}, "products": ["range"]}))
        half = math.sqrt(0.5)
        files = {"place.csv": "time_s,x_m,y_m,z_m,up_azimuth_deg\n0,1.5215e6,8.785e5,0,0\n10,1.5216e6,8.786e5,0,0\n",
                 "place.oem": "CCSDS_OEM_VERS = 2.0\nMETA_START\nCENTER_NAME = MOON\nREF_FRAME = MOON_ME\n"
                              "TIME_SYSTEM = UTC\nMETA_STOP\n2026-11-20T00:00:00 1521.5 878.5 0 0.01 0.01 0\n"
                              "2026-11-20T00:00:10 1521.6 878.6 0 0.01 0.01 0\n",
                 "turn.aem": "CCSDS_AEM_VERS = 1.0\nMETA_START\nREF_FRAME_A = MOON_ME\nREF_FRAME_B = SC_BODY_1\n"
                             "ATTITUDE_DIR = A2B\nTIME_SYSTEM = UTC\nATTITUDE_TYPE = QUATERNION\nQUATERNION_TYPE = LAST\n"
                             "META_STOP\nDATA_START\n2026-11-20T00:00:00 0 0 0 1\n"
                             f"2026-11-20T00:00:10 0 0 {half} {half}\nDATA_STOP\n"}
        for name, text in files.items():
            harness.write(name, text)
        for name, options in (("place.csv", ()), ("place.oem", ("--aem", harness.path("turn.aem")))):
            path = harness.path("from_file.jsonl")
            done = subprocess.run(
                [sys.executable, "-m", "selenograph", "manifest", harness.path(name), *options, "--request",
                 harness.path("common.json"), "--step-s", "5", "-o", path], capture_output=True, text=True,
                timeout=PATIENCE_S, env={**os.environ, "PYTHONPATH": os.path.join(REPOSITORY, "api", "clients", "python")})
            self.assertEqual((done.returncode, done.stdout + done.stderr), (0, ""))
            self.remove("out")
            self.assert_status(batch(path, "out"), DONE)
            self.assertEqual(sorted(contents("out", ".npz")), ["000001.npz", "000002.npz", "000003.npz"])
            pose = harness.meta_of(read("out", "000002.npz"))["request"]["pose"]
            self.assertAlmostEqual(pose["position_m"][0], 1521550, 6)
            if options:
                self.assertAlmostEqual(pose["camera_from_moon"]["z"], -math.sin(math.pi / 8), 12)  # the axes turn by +45 degrees


if __name__ == "__main__":
    harness.main()
