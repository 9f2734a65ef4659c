#!/usr/bin/env python3
"""deploy/campaigns/kubernetes/campaign.yaml: its image is the one that the project builds, and its command line renders its
shard. No cluster is needed, and none has seen it. Needs python3-yaml; skipped without.
"""

import json
import os
import re
import subprocess
import unittest

import harness
from harness import BINARY, REPOSITORY, frame_request, run

try:
    import yaml
except ImportError:
    yaml = None

MANIFEST = os.path.join(REPOSITORY, "deploy", "campaigns", "kubernetes", "campaign.yaml")


@unittest.skipIf(yaml is None, "no PyYAML: deploy/install-packages test")
class IndexedJob(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        with open(MANIFEST) as file:
            cls.job = yaml.safe_load(file)
        cls.spec = cls.job["spec"]
        cls.pod = cls.spec["template"]["spec"]
        cls.container = cls.pod["containers"][0]
        cls.environment = {e["name"]: e["value"] for e in cls.container["env"]}

    def test_the_image(self):
        """Its version and its user are those of the image that deploy/operation/container builds."""
        self.assertTrue(self.container["securityContext"]["runAsNonRoot"])
        with open(os.path.join(REPOSITORY, "deploy", "operation", "container", "Containerfile")) as file:
            [(user, group)] = re.findall(r"^USER (\d+):(\d+)$", file.read(), re.M)  # a name cannot be told from root's
        self.assertNotEqual(user, "0")
        self.assertEqual(self.pod["securityContext"]["fsGroup"], int(group))
        self.assertEqual(self.container["image"].rpartition(":")[2], run("--version").stdout.split()[-1])

    def test_its_command_renders_its_shard(self):
        harness.set_up()
        self.addCleanup(harness.tear_down)
        mounts = {m["mountPath"]: harness.path(m["name"]) for m in self.container["volumeMounts"]}
        for folder in mounts.values():
            os.makedirs(folder)

        def here(text):
            for mount, folder in mounts.items():
                text = text.replace(mount + "/", folder + "/")
            return text

        terrain = harness.sample(here("/terrain/dem"), "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns",
                                 "2", "--ppd", "64")
        self.assertEqual(run("ingest", "--dem", terrain, "--cache-dir", here("/terrain/cache")).returncode, 0)
        count = 40
        with open(here("/campaign/manifest.jsonl"), "w") as file:
            for i in range(count):
                place = {"lat_deg": -0.9 + 1.8 * i / count, "lon_deg": 30.0, "height_m": 20000}
                file.write(json.dumps(frame_request(
                    width=8, height=8, pose={"geodetic": place, "nadir": {"up_azimuth_deg": 0}})) + "\n")
        os.makedirs(harness.path("bin"))
        os.symlink(os.path.abspath(BINARY), harness.path("bin", "selenograph"))
        sanitizers = {name: value for name, value in os.environ.items() if name.endswith("SAN_OPTIONS")}
        environment = {"PATH": harness.path("bin") + ":" + os.environ["PATH"], **sanitizers,
                       **{name: here(value) for name, value in self.environment.items()}}
        for index in range(self.spec["completions"]):
            done = subprocess.run([here(word) for word in self.container["command"]],
                                  env={**environment, "JOB_COMPLETION_INDEX": str(index)}, stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, text=True, timeout=harness.PATIENCE_S)
            self.assertEqual(done.returncode, 0, done.stderr)
            if index == 0:
                frames = [n for n in os.listdir(here("/campaign/frames")) if n.endswith(".npz")]
                self.assertTrue(1 <= len(frames) <= 4, frames)
        checked = run("batch", "verify", here("/campaign/manifest.jsonl"), "-o", here("/campaign/frames"))
        self.assertEqual(checked.returncode, 0, checked.stderr)
        self.assertIn(f"{count} frames done, 0 not done", checked.stdout)


if __name__ == "__main__":
    harness.main()
