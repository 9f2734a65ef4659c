#!/usr/bin/env python3
"""The notebooks in api/clients/python/examples: each runs from top to bottom against the service.

Their cells are executed without Jupyter, in one namespace. Needs NumPy and Matplotlib (deploy/install-packages test).
"""

import contextlib
import glob
import importlib.util
import io
import json
import os
import re
import unittest
import warnings
from unittest import mock

import harness
from harness import REPOSITORY, Service, tearDownModule

CLIENT = os.path.join(REPOSITORY, "api", "clients", "python")
EXAMPLES = os.path.join(CLIENT, "examples")
ASSETS = os.path.join(REPOSITORY, "deploy", "assets")
MAX_BYTES = 20000  # a notebook with outputs is larger
PLACES = {"south_pole": ("--south-deg", "-86", "--west-deg", "120", "--rows", "1", "--columns", "12", "--ppd", "256")}
ELSEWHERE = ("--ppd", "256")  # where quickstart has it, but coarser


def setUpModule():
    if not importlib.util.find_spec("matplotlib"):
        raise unittest.SkipTest("no matplotlib: deploy/install-packages test")
    harness.set_up()


class Notebooks(unittest.TestCase):
    def test_names_and_links(self):
        names = sorted(os.path.basename(path) for path in glob.glob(os.path.join(EXAMPLES, "*.ipynb")))
        self.assertEqual(names, ["descent.ipynb", "lidar_line.ipynb", "south_pole.ipynb"])
        with open(os.path.join(CLIENT, "README.md")) as file:
            page = file.read()
        for name in names:
            self.assertIn(f"(examples/{name})", page)

    def run_notebook(self, name):
        """Runs the cells of code; returns what they print."""
        path = os.path.join(EXAMPLES, f"{name}.ipynb")
        self.assertLess(os.path.getsize(path), MAX_BYTES)
        with open(path) as file:
            cells = json.load(file)["cells"]
        service = Service("--assets-dir", ASSETS, dem=harness.sample(name, *PLACES.get(name, ELSEWHERE)),
                          cache=f"{name}-cache")
        self.addCleanup(service.stop)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(EXAMPLES)
        printed = io.StringIO()
        url = {"SELENOGRAPH_URL": f"http://{service.host}:{service.port}", "MPLBACKEND": "agg"}
        namespace = {"__name__": "notebook"}
        with mock.patch.dict(os.environ, url), contextlib.redirect_stdout(printed), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the terrain is coarser here; agg shows no figures
            for number, cell in enumerate(cells):
                if cell["cell_type"] == "code":
                    self.assertEqual((cell["outputs"], cell["execution_count"]), ([], None), f"cell {number} was saved as run")
                    exec(compile("".join(cell["source"]), f"{name}.ipynb, cell {number}", "exec"), namespace)
        return printed.getvalue()

    def test_descent(self):
        printed = self.run_notebook("descent")
        self.assertRegex(printed, r"^21 frames, altitude from \d{5} to \d{3,4} m")
        self.assertIn("in the image", printed)

    def test_south_pole(self):
        printed = self.run_notebook("south_pole")
        exposed_s = float(re.search(r"exposed for (\S+) s", printed)[1])
        self.assertGreater(exposed_s, 0)
        from_sun, from_terrain = map(float, re.search(r"(\S+) W m-2 from the Sun, (\S+) W m-2 from terrain", printed).groups())
        self.assertGreater(from_terrain, 0)

    def test_lidar_line(self):
        self.assertRegex(self.run_notebook("lidar_line"), r"the map is (150|175|200|225|250) m off")


if __name__ == "__main__":
    harness.main()
