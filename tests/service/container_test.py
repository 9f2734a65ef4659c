#!/usr/bin/env python3
"""deploy/operation/container/Containerfile: the image is built on a base from debootstrap, and the service and a campaign
run from it. No image registry is needed, only Debian's mirror; takes 10 minutes on two free cores and 8 GB in $TMPDIR.

Needs root, and buildah, podman, runc and debootstrap (deploy/install-packages container); skipped without.
SELENOGRAPH_TEST_DEBIAN=13 takes Debian 13 in place of 12. Everything of it is below the test's folder: containers that
are there already are not seen.
"""

import http.client
import json
import os
import re
import shutil
import subprocess
import unittest

import harness
from harness import REPOSITORY, frame_request

TOOLS = ("buildah", "podman", "runc", "debootstrap")
MISSING = [tool for tool in TOOLS if not shutil.which(tool, path=os.environ["PATH"] + ":/usr/sbin")]
DEBIAN = os.environ.get("SELENOGRAPH_TEST_DEBIAN", "12")
SUITE = {"12": "bookworm", "13": "trixie"}[DEBIAN]
BUILD_S = 7200
BASE, IMAGE = f"localhost/debootstrap:{DEBIAN}", "localhost/selenograph"


def setUpModule():
    if MISSING:
        raise unittest.SkipTest(f"no {', '.join(MISSING)}: deploy/install-packages container")
    if os.geteuid() != 0:
        raise unittest.SkipTest("debootstrap needs root")
    harness.set_up()
    # Not tearDownModule(): a failed build is cleared away, too. What was added last is done first.
    unittest.addModuleCleanup(harness.tear_down)
    # runc takes any control groups. Limits that every machine allows: the defaults are higher than some have.
    os.environ.update(
        CONTAINERS_CONF=harness.write("containers.conf", """
            [containers]
            default_ulimits = ["nofile=4096:4096", "nproc=4096:4096"]
            [engine]
            runtime = "runc"
            cgroup_manager = "cgroupfs"
            events_logger = "file"
            """),
        CONTAINERS_STORAGE_CONF=harness.write("storage.conf", f"""
            [storage]
            driver = "overlay"
            graphroot = "{harness.path('storage')}"
            runroot = "{harness.path('run')}"
            """),
        DISABLE_HC_SYSTEMD="true")  # the test asks for the health itself
    unittest.addModuleCleanup(said, "podman", "rmi", "--all", "--force", timeout_s=BUILD_S)
    unittest.addModuleCleanup(said, "buildah", "rm", "--all", timeout_s=BUILD_S)
    unittest.addModuleCleanup(said, "podman", "rm", "--all", "--force", "--time", "1", timeout_s=BUILD_S)
    build()


def command(*words, timeout_s=harness.PATIENCE_S, **options):
    return subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=timeout_s, **options)


def said(*words, **options):
    done = command(*words, **options)
    assert done.returncode == 0, f"{' '.join(words)}: exit status {done.returncode}: {done.stdout[-4000:]}"
    return done.stdout.strip()


def mirror():
    """What this machine's apt reads Debian from."""
    for name in ("sources.list.d/debian.sources", "sources.list"):
        path = os.path.join("/etc/apt", name)
        if os.path.exists(path):
            with open(path) as file:
                if found := re.search(r"^(?:URIs:|deb(?: \[.*\])?) *(http\S+)", file.read(), re.M):
                    return [found[1]]
    return []


def build():
    said("debootstrap", "--variant=minbase", SUITE, harness.path("base"), *mirror(), timeout_s=BUILD_S,
         env={**os.environ, "PATH": os.environ["PATH"] + ":/usr/sbin:/sbin"})
    said("tar", "-C", harness.path("base"), "--exclude=./var/lib/apt/lists/*", "--exclude=./var/cache/apt/*",  # 80 MB
         "-cf", harness.path("base.tar"), ".")
    said("podman", "import", harness.path("base.tar"), BASE)
    said("buildah", "bud", "--isolation", "chroot", "--format", "docker", "--build-arg", f"BASE={BASE}",
         "-f", os.path.join("deploy", "operation", "container", "Containerfile"), "-t", IMAGE, ".",
         cwd=REPOSITORY, timeout_s=BUILD_S)


class Image(unittest.TestCase):
    def inspected(self):
        [image] = json.loads(said("podman", "image", "inspect", IMAGE))
        return image

    def in_image(self, *words):
        return said("podman", "run", "--rm", "--network", "none", "--entrypoint", words[0], IMAGE, *words[1:])

    def test_what_it_is(self):
        image = self.inspected()
        config = image["Config"]
        self.assertEqual((config["User"], config["Entrypoint"], config["Cmd"]), ("10001:10001", ["selenograph"], ["serve"]))
        self.assertIn("/health/ready", image["Healthcheck"]["Test"][-1])
        self.assertIn("SELENOGRAPH_HOST=0.0.0.0", config["Env"])
        self.assertEqual(self.in_image("id", "-u"), "10001")
        self.assertEqual(self.in_image("selenograph", "--version"), harness.run("--version").stdout.strip())

    def test_only_what_runs(self):
        """No compiler, no headers, no systemd, nothing of apt's; less than a gigabyte."""
        packages = self.in_image("dpkg-query", "-W", "-f", "${Package}\n").split()
        self.assertIn("selenograph", packages)
        self.assertEqual([name for name in packages if name.endswith("-dev") or name.startswith(("g++", "cmake"))
                          or name in ("systemd", "git")], [])
        self.assertEqual(self.in_image("ls", "/var/lib/apt/lists"), "")
        size_mb = self.inspected()["Size"] / 1e6
        print(f"image: {size_mb:.0f} MB with its base, {len(packages)} packages")
        self.assertLess(size_mb, 1000)

    def test_the_service(self):
        port = harness.free_port()
        said("podman", "run", "--detach", "--name", "service", "--network", "host", "--read-only", "--cap-drop", "all",
             "--security-opt", "no-new-privileges", "--volume", "cache:/var/cache/selenograph",
             "--env", f"SELENOGRAPH_PORT={port}", IMAGE)
        log = lambda: command("podman", "logs", "service").stdout  # noqa: E731
        harness.wait_until(lambda: command("podman", "healthcheck", "run", "service").returncode == 0, log)
        check = self.inspected()["Healthcheck"]["Test"]
        self.assertEqual(check[0], "CMD-SHELL")
        for at, healthy in ((port, True), (harness.free_port(), False)):  # where nothing answers it is not healthy
            done = command("podman", "exec", "--env", f"SELENOGRAPH_PORT={at}", "service", "sh", "-c", check[1])
            self.assertEqual(done.returncode == 0, healthy, done.stdout)
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=harness.PATIENCE_S)
        with open(os.path.join(REPOSITORY, "deploy", "examples", "example-request.json"), "rb") as request:
            connection.request("POST", "/v1/frames", request.read(),
                               {"Content-Type": "application/json", "Accept": "image/png"})
        answer = connection.getresponse()
        body = answer.read()
        self.assertEqual((answer.status, body[:4]), (200, b"\x89PNG"), body[:500])
        connection.close()
        said("podman", "stop", "--time", "30", "service")  # SIGTERM: it ends by itself
        self.assertEqual(said("podman", "inspect", "--format", "{{.State.ExitCode}}", "service"), "0", log())
        self.assertIn('{"time":"', log())

    def test_a_campaign_from_the_image(self):
        """deploy/campaigns/slurm/from-image: the command line of campaign.sbatch, whose frames belong to who runs it."""
        folder = harness.path("campaign")
        os.makedirs(folder)
        environment = {**os.environ, "SELENOGRAPH_IMAGE": IMAGE, "SELENOGRAPH_FOLDERS": folder, "SELENOGRAPH_DEM": "dem",
                       "SELENOGRAPH_CACHE_DIR": "cache"}
        program = os.path.join(os.path.abspath(REPOSITORY), "deploy", "campaigns", "slurm", "from-image")

        def run(*words):
            return said(program, *words, env=environment, cwd=folder)

        run("sample", "dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2", "--ppd", "64")
        with open(os.path.join(folder, "manifest.jsonl"), "w") as file:
            for _ in range(2):
                file.write(json.dumps(frame_request(width=8, height=8)) + "\n")
        manifest, frames = os.path.join(folder, "manifest.jsonl"), os.path.join(folder, "frames")
        for shard in range(2):
            run("batch", manifest, "-o", frames, "--shard", f"{shard}/2", "--threads", "1")
        self.assertIn("2 frames done, 0 not done", run("batch", "verify", manifest, "-o", frames))
        self.assertEqual(os.stat(os.path.join(frames, "000001.npz")).st_uid, os.getuid())
        # Slurm's SIGTERM reaches the program inside, which gives up and says so by its exit status.
        with open(manifest, "w") as file:
            for _ in range(1000):
                file.write(json.dumps(frame_request(width=512, height=512, samples=16)) + "\n")
        more = os.path.join(folder, "more")
        process = subprocess.Popen([program, "batch", manifest, "-o", more], env=environment, cwd=folder,
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        harness.wait_until(lambda: os.path.exists(more) and any(name.endswith(".npz") for name in os.listdir(more)),
                           "no frame")
        process.terminate()
        told = process.communicate(timeout=60)[0]
        self.assertEqual(process.returncode, 1, told)
        self.assertIn("interrupted", told)


if __name__ == "__main__":
    harness.main()
