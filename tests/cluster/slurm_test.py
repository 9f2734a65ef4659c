#!/usr/bin/env python3
"""A campaign on a real Slurm, whose tasks are killed and requeued at random: every frame once, with the bytes of a run in
one process.

Starts munged, slurmctld and slurmd on loopback in a temporary folder, as whoever runs it. Debian's slurm-wlm and munge
(deploy/install-packages slurm); skipped without. SLURM_TEST_FRAMES (default 10000) frames of 16 x 16 pixels.
"""

import getpass
import json
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness  # noqa: E402
from harness import BINARY, REPOSITORY, free_port, run, wait_until  # noqa: E402

FRAMES = int(os.environ.get("SLURM_TEST_FRAMES", "10000"))
SLOTS = 4
MOST_ARRAY = 12
MOST_DISTURBANCES = 40
SEED = 20261122
NEEDED = ("munged", "slurmctld", "slurmd", "sbatch", "scontrol", "squeue", "scancel")
PATIENCE_S = 60

os.environ["PATH"] += ":/usr/sbin:/sbin"
MISSING = [program for program in NEEDED if not shutil.which(program)]

CONFIGURATION = """
ClusterName=selenograph
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller_port}
SlurmdPort={node_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
ReturnToService=2
KillWait=2
MinJobAge=3600
MaxArraySize={most_array}
SchedulerParameters=sched_min_interval=100000,batch_sched_delay=0
NodeName={host} NodeAddr=127.0.0.1 CPUs={slots} RealMemory=1000
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


class Cluster:
    """A controller and one node with several slots, in a folder."""

    def __init__(self, folder):
        self.folder = folder
        self.processes = []
        for name in ("state", "spool"):
            os.makedirs(os.path.join(folder, name), mode=0o755)
        with open(self.path("munge.key"), "wb") as file:
            file.write(os.urandom(1024))
        os.chmod(self.path("munge.key"), 0o400)
        self.host = socket.gethostname().split(".")[0]
        with open(self.path("slurm.conf"), "w") as file:
            file.write(CONFIGURATION.format(folder=folder, host=self.host, user=getpass.getuser(), slots=SLOTS,
                                            most_array=MOST_ARRAY, controller_port=free_port(), node_port=free_port()))
        os.environ["SLURM_CONF"] = self.path("slurm.conf")

    def path(self, name):
        return os.path.join(self.folder, name)

    def start(self):
        # --force: of folders that others may write, /tmp above all.
        self.launch("munged", "--foreground", "--force", f"--key-file={self.path('munge.key')}",
                    f"--socket={self.path('munge.socket')}", f"--pid-file={self.path('munge.pid')}",
                    f"--log-file={self.path('munge.log')}", f"--seed-file={self.path('munge.seed')}")
        wait_until(lambda: os.path.exists(self.path("munge.socket")), "munged")
        self.launch("slurmctld", "-D", "-i")
        self.launch("slurmd", "-D", "-N", self.host)
        wait_until(lambda: " idle" in self.ask("sinfo", "-h", "-o", "%n %T", check=False), "the node is idle")

    def launch(self, *command):
        log = open(self.path(command[0] + ".out"), "wb")
        with log:
            self.processes.append(subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder))

    def stop(self):
        subprocess.run(["scancel", "--full", "-u", getpass.getuser()], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for process in reversed(self.processes):
            process.terminate()
        for process in self.processes:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def ask(self, *command, check=True):
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE_S)
        if check and done.returncode != 0:
            raise AssertionError(f"{' '.join(command)}: {done.stdout}")
        return done.stdout

    def tasks(self, job):
        """Array task -> state."""
        found = {}
        for line in self.ask("squeue", "-h", "-r", "-j", job, "-o", "%K %T", check=False).splitlines():
            task, _, state = line.partition(" ")
            if task.isdigit():
                found[int(task)] = state
        return found

    def job(self, job):
        return dict(re.findall(r"(\w+)=(\S+)", self.ask("scontrol", "show", "job", job)))

    def logs(self):
        texts = []
        for name in ("munged.out", "munge.log", "slurmctld.log", "slurmd.log", "slurmctld.out", "slurmd.out"):
            if os.path.exists(self.path(name)):
                with open(self.path(name), errors="replace") as file:
                    texts.append(f"--- {name}\n" + file.read()[-3000:])
        return "\n".join(texts)


@unittest.skipIf(MISSING, f"no {', '.join(MISSING)}: deploy/install-packages slurm")
class Campaign(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        harness.set_up()
        # unittest calls no tearDownClass when this fails.
        cls.addClassCleanup(harness.tear_down)
        cls.dem = harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "256")
        assert run("ingest", "--dem", cls.dem, "--cache-dir", harness.path("cache")).returncode == 0
        os.environ.update(SELENOGRAPH=os.path.abspath(BINARY), SELENOGRAPH_DEM=cls.dem,
                          SELENOGRAPH_CACHE_DIR=harness.path("cache"), CAMPAIGN_RESTARTS="1000")
        os.makedirs(harness.path("slurm"))
        cls.cluster = Cluster(harness.path("slurm"))
        cls.addClassCleanup(cls.cluster.stop)
        try:
            cls.cluster.start()
        except AssertionError as error:
            raise AssertionError(f"{error}\n{cls.cluster.logs()}") from None

    def manifest(self, name, frames):
        numbers = random.Random(SEED)
        path = harness.path(name)
        with open(path, "w") as file:
            for i in range(frames):
                place = {"lat_deg": numbers.uniform(-0.9, 0.9), "lon_deg": numbers.uniform(29.1, 30.9),
                         "height_m": numbers.choice([10e3, 20e3, 60e3])}
                request = harness.frame_request(width=16, height=16, pose={"geodetic": place, "nadir": {"up_azimuth_deg": 0}})
                file.write(json.dumps({"name": f"frame-{i:05}", **request}) + "\n")
        return path

    def submit(self, *arguments):
        """The numbers of the array and of the check."""
        done = subprocess.run([os.path.join(REPOSITORY, "deploy", "campaigns", "slurm", "submit"), *arguments], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.said = done.stderr
        found = re.fullmatch(r"campaign (\d+) verify (\d+)\n", done.stdout)
        self.assertTrue(found, done.stdout)
        return found[1], found[2]

    def log_of(self, folder, job):
        texts = []
        for name in sorted(os.listdir(folder)):
            if name.startswith(f"slurm-{job}"):
                with open(os.path.join(folder, name), errors="replace") as file:
                    texts.append(f"--- {name}\n{file.read()}")
        return "\n".join(texts)

    def logs_of_tasks(self, folder, job):
        found = {}
        for name in os.listdir(folder):
            if task := re.fullmatch(rf"slurm-{job}_(\d+)\.log", name):
                with open(os.path.join(folder, name), errors="replace") as file:
                    found[task[1]] = file.read()
        return found

    def frames(self, folder):
        """File -> content, of all frames."""
        found = {}
        for name in os.listdir(folder):
            if name.endswith(".npz"):
                with open(os.path.join(folder, name), "rb") as file:
                    found[name] = file.read()
        return found

    def processes_of(self, folder):
        """Shard -> number of the process that renders it into a folder."""
        found = {}
        for number in filter(str.isdigit, os.listdir("/proc")):
            try:
                with open(f"/proc/{number}/cmdline", "rb") as file:
                    words = file.read().decode(errors="replace").split("\0")
            except OSError:
                continue
            if words[0] == os.environ["SELENOGRAPH"] and "--shard" in words and folder in words:
                found[int(words[words.index("--shard") + 1].split("/")[0])] = int(number)
        return found

    def disturb(self, job, folder, moments):
        """One of the tasks that run is ended in one of the ways in which that happens; says in which, or None."""
        # Not one that is ending already: the signal would come before its successor could have a trap for it.
        running = sorted((s, p) for s, p in self.processes_of(folder).items() if p not in self.disturbed)
        if not running:
            return None
        shard, process = moments.choice(running)
        self.disturbed.add(process)
        how = moments.choice(("requeue", "kill", "signal"))
        commands = {"requeue": ["scontrol", "requeue", f"{job}_{shard}"],
                    "signal": ["scancel", "--batch", "--signal=TERM", f"{job}_{shard}"]}  # what --signal=B:TERM@60 does
        try:  # it may have ended; scancel then tries on and on
            if how in commands:
                subprocess.run(commands[how], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=5)
            else:
                os.kill(process, signal.SIGKILL)
        except (subprocess.TimeoutExpired, ProcessLookupError):
            return None
        return how

    def release(self, job):
        """Slurm starts a requeued task after two minutes; here it needn't wait."""
        for line in self.cluster.ask("squeue", "-h", "-r", "-j", job, "-o", "%K %T %r", check=False).splitlines():
            if line.endswith(" PENDING BeginTime"):
                task = f"JobId={job}_{line.split()[0]}"
                self.cluster.ask("scontrol", "update", task, "StartTime=now", check=False)

    def wait_for(self, job, folder, patience_s):
        states = ("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL")
        try:
            wait_until(lambda: self.cluster.job(job).get("JobState") in states, f"job {job}", patience_s)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.cluster.ask('squeue')}\n{self.log_of(folder, '')[-3000:]}\n"
                                 f"{self.cluster.logs()}") from None
        return self.cluster.job(job)

    def test_killed_and_requeued_at_random(self):
        path, folder = self.manifest("manifest.jsonl", FRAMES), harness.path("out")
        started = time.monotonic()
        job, check = self.submit("--shards", "1000", path, folder)
        self.assertIn(f"{MOST_ARRAY} shards, not 1000: MaxArraySize is {MOST_ARRAY}", self.said)
        moments = random.Random(SEED)
        how_often, self.disturbed = {}, set()
        while self.cluster.tasks(job):
            time.sleep(0.5 + 2 * moments.random())
            if sum(how_often.values()) < MOST_DISTURBANCES and (how := self.disturb(job, folder, moments)):
                how_often[how] = how_often.get(how, 0) + 1
            self.release(job)
        ended = self.wait_for(check, folder, 600)
        log = self.log_of(folder, check)
        if ended["ExitCode"] == "1:0" and "0 bad lines" in log:
            # Slurm may lose a task that is requeued while it ends. The check says so, and the same command goes on.
            print(f"a second time, since: {log.splitlines()[-1]}", end=" ", flush=True)
            job, check = self.submit("--shards", "1000", path, folder)
            ended = self.wait_for(check, folder, 600)
            log = self.log_of(folder, check)
        if (ended["JobState"], ended["ExitCode"]) != ("COMPLETED", "0:0"):
            lost = {t: text for t, text in self.logs_of_tasks(folder, job).items()
                    if not re.search(r"rendered, \d+ existed\n(?:(?:warning, of|\d+ of the frames) [^\n]*\n)*[^\n]*\n?$", text)}
            with open(self.cluster.path("slurmctld.log")) as file:
                said = [line for line in file if any(f"{job}_{task}" in line for task in lost)]
            self.fail("\n".join([log[-200:], *lost.values(), *said]))
        self.assertIn(f"{FRAMES} frames done, 0 not done, 0 bad lines", log)
        seconds = time.monotonic() - started
        self.assertGreaterEqual(sum(how_often.values()), min(3, FRAMES // 1000), "hardly anything was disturbed")
        alone = harness.path("alone")
        # One thread: on a busy machine threads of small frames wait for each other more than they compute.
        subprocess.run([BINARY, "batch", path, "-o", alone, "--threads", "1"], check=True, stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL)
        ours = self.frames(folder)
        self.assertEqual(len(ours), FRAMES)
        self.assertTrue(ours == self.frames(alone))
        self.assertEqual([name for name in os.listdir(folder) if ".tmp-" in name], [])
        print(f"{FRAMES} frames, {MOST_ARRAY} shards on {SLOTS} slots in {seconds:.0f} s; {how_often}", end=" ", flush=True)

    def test_errors_are_not_tried_again(self):
        """And what a task did not do is in the manifest to run again."""
        path, folder = self.manifest("hopeless.jsonl", 4), harness.path("hopeless")
        job, check = self.submit(path, folder, "--", "--threads", "1", "--dem", harness.path("nowhere"))
        ended = self.wait_for(check, folder, 120)
        self.assertEqual((ended["JobState"], ended["ExitCode"]), ("FAILED", "1:0"), self.log_of(folder, check))
        self.assertEqual(self.cluster.job(job + "_0").get("Restarts"), "0")
        self.assertIn("nowhere", self.log_of(folder, job))
        with open(os.path.join(folder, "rerun.jsonl")) as file:
            self.assertEqual(len(file.readlines()), 4)

    def test_a_cancelled_campaign_stays_cancelled(self):
        path, folder = self.manifest("cancelled.jsonl", 3000), harness.path("cancelled")
        job, check = self.submit("--shards", "1", path, folder)
        wait_until(lambda: self.processes_of(folder), "a task runs")
        self.cluster.ask("scancel", job)
        wait_until(lambda: not self.cluster.tasks(job), "the array is gone", 120)
        ended = self.wait_for(check, folder, 120)
        self.assertEqual(ended["ExitCode"], "1:0", self.log_of(folder, check))
        self.assertEqual(self.processes_of(folder), {})


if __name__ == "__main__":
    harness.main()
