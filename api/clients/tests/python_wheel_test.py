#!/usr/bin/env python3
"""The Python client as a package: its wheel, and pip's installation of it without a network.

Needs python3-pip, python3-setuptools and python3-wheel (deploy/install-packages clients); skipped without. The folder is
copied first: setuptools leaves its own files beside what it builds.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import unittest
import zipfile

import harness
from harness import PATIENCE_S, REPOSITORY, tearDownModule

MISSING = [name for name in ("pip", "setuptools", "wheel") if not importlib.util.find_spec(name)]
OFFLINE = ("--no-index", "--no-build-isolation", "--disable-pip-version-check", "--no-cache-dir")


def setUpModule():
    if MISSING:
        raise unittest.SkipTest(f"no {', '.join(MISSING)}: deploy/install-packages clients")
    harness.set_up()


class Wheel(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.source = harness.path("source")
        shutil.copytree(os.path.join(REPOSITORY, "api", "clients", "python"), cls.source,
                        ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))

    def said(self, *command, **environment):
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE_S * 3,
                              cwd=harness.path(), env={**os.environ, "PYTHONPATH": "", **environment})
        self.assertEqual(done.returncode, 0, done.stdout)
        return done.stdout

    def version(self):
        """The executable's: that of the whole project."""
        return re.search(r"[0-9]+\.[0-9]+\.[0-9]+", harness.run("--version").stdout)[0]

    def check_import(self, python, folder, **environment):
        script = ("import importlib.metadata, selenograph; print(selenograph.__file__, selenograph.__version__, "
                  "importlib.metadata.version('selenograph'))")
        file, version, packaged = self.said(python, "-c", script, **environment).split()
        self.assertTrue(file.startswith(folder), file)
        self.assertEqual((version, packaged), (self.version(), self.version()))

    def test_the_wheel(self):
        folder = harness.path("wheels")
        self.said(sys.executable, "-m", "pip", "wheel", *OFFLINE, "--no-deps", "-w", folder, self.source)
        name = f"selenograph-{self.version()}-py3-none-any.whl"
        self.assertEqual(os.listdir(folder), [name])
        with zipfile.ZipFile(os.path.join(folder, name)) as wheel:
            modules = sorted(f"selenograph/{name}" for name in os.listdir(os.path.join(self.source, "selenograph"))
                             if name.endswith((".py", ".typed")))
            self.assertIn("selenograph/py.typed", modules)  # type checkers read the hints of packages with it only
            self.assertIn("selenograph/__main__.py", modules)
            self.assertEqual(sorted(file for file in wheel.namelist() if ".dist-info/" not in file), modules)
            for module in modules:
                with open(os.path.join(self.source, module), "rb") as file:
                    self.assertEqual(wheel.read(module), file.read(), module)
            metadata = wheel.read(f"selenograph-{self.version()}.dist-info/METADATA").decode()
        self.assertRegex(metadata, r"(?m)^Requires-Dist: numpy")
        # A wheel is enough to install from.
        target = harness.path("from-wheel")
        self.said(sys.executable, "-m", "pip", "install", *OFFLINE, "--no-deps", "--target", target,
                  os.path.join(folder, name))
        self.check_import(sys.executable, target, PYTHONPATH=target)

    def test_a_target_folder(self):
        target = harness.path("target")
        self.said(sys.executable, "-m", "pip", "install", *OFFLINE, "--no-deps", "--target", target, self.source)
        self.check_import(sys.executable, target, PYTHONPATH=target)

    def test_a_virtual_environment(self):
        """With its dependency, which the system's packages meet."""
        folder = harness.path("venv")
        self.said(sys.executable, "-m", "venv", "--without-pip", "--system-site-packages", folder)
        python = os.path.join(folder, "bin", "python")
        self.said(python, "-m", "pip", "install", *OFFLINE, self.source)
        self.check_import(python, folder)
        self.assertIn("usage", self.said(python, "-m", "selenograph", "--help"))


if __name__ == "__main__":
    harness.main()
