#!/usr/bin/env python3
"""deploy/campaigns/kubernetes/campaign.yaml: its members are those of the API, and its command line renders its shard.

No cluster is needed, and none has seen it. Needs python3-yaml; skipped without.
"""

import json
import os
import re
import subprocess
import tempfile
import unittest

import harness
from harness import BINARY, REPOSITORY, frame_request, run

try:
    import yaml
except ImportError:
    yaml = None

MANIFEST = os.path.join(REPOSITORY, "deploy", "campaigns", "kubernetes", "campaign.yaml")

# As in the Kubernetes API reference, batch/v1 Job and core/v1 PodSpec (1.29): the members that a campaign may need, and
# what they hold. [..]: a list of these; {"": ..}: any names.
CONTAINER = {
    "name": str, "image": str, "command": [str], "args": [str], "env": [{"name": str, "value": str}],
    "imagePullPolicy": str, "workingDir": str,
    "resources": {"requests": {"": str}, "limits": {"": str}},
    "securityContext": {"allowPrivilegeEscalation": bool, "readOnlyRootFilesystem": bool, "runAsNonRoot": bool},
    "volumeMounts": [{"name": str, "mountPath": str, "readOnly": bool, "subPath": str}],
}
POD = {
    "restartPolicy": str, "terminationGracePeriodSeconds": int, "containers": [CONTAINER], "nodeSelector": {"": str},
    "securityContext": {"fsGroup": int, "fsGroupChangePolicy": str, "runAsUser": int, "runAsNonRoot": bool},
    "volumes": [{"name": str, "persistentVolumeClaim": {"claimName": str, "readOnly": bool}, "emptyDir": {}}],
}
JOB = {
    "apiVersion": str, "kind": str, "metadata": {"name": str, "namespace": str, "labels": {"": str}},
    "spec": {
        "completionMode": str, "completions": int, "parallelism": int, "backoffLimitPerIndex": int, "maxFailedIndexes": int,
        "activeDeadlineSeconds": int, "ttlSecondsAfterFinished": int, "suspend": bool,
        "podFailurePolicy": {"rules": [{
            "action": str, "onExitCodes": {"containerName": str, "operator": str, "values": [int]},
            "onPodConditions": [{"type": str, "status": str}]}]},
        "template": {"metadata": {"labels": {"": str}}, "spec": POD},
    },
}


def faults(value, form, where=""):
    if isinstance(form, type):
        if type(value) is not form:
            yield f"{where} is {value!r}, not of type {form.__name__}"
    elif isinstance(form, list):
        if not isinstance(value, list) or not value:
            yield f"{where} is no list"
        else:
            for i, element in enumerate(value):
                yield from faults(element, form[0], f"{where}/{i}")
    elif not isinstance(value, dict):
        yield f"{where} is no object"
    else:
        for name, member in value.items():
            known = form.get(name, form.get(""))
            if known is None:
                yield f"{where}/{name} is no member"
            else:
                yield from faults(member, known, f"{where}/{name}")


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

    def test_members(self):
        self.assertEqual(list(faults(self.job, JOB)), [])
        self.assertEqual(list(faults({**self.job, "spec": {**self.spec, "completion": 1, "parallelism": "8"}}, JOB)),
                         ["/spec/parallelism is '8', not of type int", "/spec/completion is no member"])

    def test_rules_between_members(self):
        """As the API's documentation says them."""
        self.assertEqual((self.job["apiVersion"], self.job["kind"]), ("batch/v1", "Job"))
        # backoffLimitPerIndex "can only be set when Job's completionMode=Indexed, and the Pod's restart policy is Never".
        self.assertEqual((self.spec["completionMode"], self.pod["restartPolicy"]), ("Indexed", "Never"))
        self.assertLessEqual(self.spec["parallelism"], self.spec["completions"])
        names = {c["name"] for c in self.pod["containers"]}
        for rule in self.spec["podFailurePolicy"]["rules"]:
            # "One of onExitCodes and onPodConditions, but not both, can be used in each rule."
            self.assertEqual(("onExitCodes" in rule) + ("onPodConditions" in rule), 1)
            self.assertIn(rule["action"], ("FailJob", "FailIndex", "Ignore", "Count"))
            if codes := rule.get("onExitCodes"):
                self.assertIn(codes["containerName"], names)
                self.assertIn(codes["operator"], ("In", "NotIn"))
                # "Value '0' cannot be used for the In operator"; "must be ordered and must not contain duplicates".
                self.assertNotIn(0, codes["values"])
                self.assertEqual(codes["values"], sorted(set(codes["values"])))
        self.assertEqual({m["name"] for m in self.container["volumeMounts"]}, {v["name"] for v in self.pod["volumes"]})
        self.assertEqual(self.environment["SHARDS"], str(self.spec["completions"]))

    def test_the_image(self):
        """Its version and its user are those of the image that deploy/operation/container builds."""
        self.assertTrue(self.container["securityContext"]["runAsNonRoot"])
        with open(os.path.join(REPOSITORY, "deploy", "operation", "container", "Containerfile")) as file:
            [(user, group)] = re.findall(r"^USER (\d+):(\d+)$", file.read(), re.M)  # a name cannot be told from root's
        self.assertNotEqual(user, "0")
        self.assertEqual(self.pod["securityContext"]["fsGroup"], int(group))
        self.assertEqual(self.container["image"].rpartition(":")[2], run("--version").stdout.split()[-1])

    def test_the_check_runs_however_the_job_ends(self):
        """The commands of the file's head, with stand-ins for the cluster: a job with a failed index is never Complete."""
        with open(MANIFEST) as file:
            commands = "".join(re.findall(r"^#   (.*\n)", file.read(), re.M))
        for end in ("Complete", "Failed"):
            with tempfile.TemporaryDirectory() as folder:
                for name, what in (("kubectl", f"""[ "$1" = get ] || exit 0
                                                echo asked >> log; [ $(wc -l < log) -lt 3 ] || echo '{end}'"""),
                                   ("sleep", "[ $(wc -l < log) -lt 9 ] || kill $PPID"),
                                   ("selenograph", 'echo "$1 $2" >> log')):
                    with open(os.path.join(folder, name), "w") as file:
                        file.write("#!/bin/sh\n" + what + "\n")
                    os.chmod(file.name, 0o755)
                subprocess.run(["bash", "-c", commands], cwd=folder, env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"},
                               timeout=harness.PATIENCE_S, check=False)
                with open(os.path.join(folder, "log")) as file:
                    self.assertEqual(file.read().split("\n"), ["asked"] * 3 + ["batch verify", ""], end)

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
