#!/usr/bin/env python3
"""deploy/install-packages where another program holds apt's locks, with stubs for apt: it waits, and says for whom."""

import os
import shutil
import subprocess
import tempfile
import unittest

REPOSITORY = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
# Fails as apt does while a lock is held: `held` holds the number of tries left.
APT_GET = """#!/bin/sh
echo "$*" >>"$STUBS/calls"
case "$*" in
  *-s*install* | *--print-uris*) exit 0 ;;
  *update*) lock=/var/lib/apt/lists/lock ;;
  *) lock=/var/lib/dpkg/lock-frontend ;;
esac
left=$(cat "$STUBS/held")
[ "$left" = broken ] && { echo "E: Unable to fetch some archives" >&2; exit 100; }
[ "$left" -gt 0 ] || exit 0
echo $((left - 1)) >"$STUBS/held"
echo "E: Could not get lock $lock. It is held by process 77 (unattended-upgr)" >&2
exit 100
"""
STUBS = {"apt-get": APT_GET, "apt-cache": "#!/bin/sh\n", "dpkg-query": "#!/bin/sh\nexit 1\n", "sleep": "#!/bin/sh\n",
         "sudo": "#!/bin/sh\nexec \"$@\"\n"}


class InstallPackages(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="selenograph-packages-test-")
        self.addCleanup(shutil.rmtree, self.folder)
        os.makedirs(os.path.join(self.folder, "deploy", "support"))
        for name in ("install-packages", "support/progress"):
            shutil.copy(os.path.join(REPOSITORY, "deploy", name), os.path.join(self.folder, "deploy", name))
        for name, text in STUBS.items():
            with open(os.path.join(self.folder, name), "w") as file:
                file.write(text)
            os.chmod(os.path.join(self.folder, name), 0o755)

    def run_with(self, held):
        with open(os.path.join(self.folder, "held"), "w") as file:
            file.write(held)
        environment = {**os.environ, "STUBS": self.folder, "PATH": self.folder + ":" + os.environ["PATH"]}
        return subprocess.run([os.path.join(self.folder, "deploy", "install-packages"), "run"], env=environment, text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=60)

    def calls(self):
        with open(os.path.join(self.folder, "calls")) as file:
            return [line for line in file if "--print-uris" not in line and " -s " not in f" {line}"]

    def test_waits_for_each_lock_and_says_once_who_holds_it(self):
        done = self.run_with("3")
        self.assertEqual(done.returncode, 0, done.stderr)
        waited = [line for line in done.stdout.splitlines() if "waiting" in line]
        self.assertEqual(waited, ["packages: waiting for apt's lock /var/lib/apt/lists/lock. "
                                  "It is held by process 77 (unattended-upgr)"])
        self.assertEqual(sum("update" in call for call in self.calls()), 4)
        self.assertEqual(sum("install" in call for call in self.calls()), 1)

    def test_another_failure_is_one(self):
        done = self.run_with("broken")
        self.assertEqual(done.returncode, 1)
        self.assertIn("Unable to fetch", done.stderr)
        self.assertEqual(len(self.calls()), 1)


if __name__ == "__main__":
    unittest.main(verbosity=2)
