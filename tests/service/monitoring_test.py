"""Each metric that the dashboard and the alerts of deploy/operation name exists in a running service, with the labels and
values that they name. (team_test.py checks those of the proxy.) promtool checks the alerts where it is installed.
"""

import json
import os
import re
import shutil
import subprocess
import unittest

import harness
from harness import REPOSITORY, Service, frame_request

OPERATION = os.path.join(REPOSITORY, "deploy", "operation")
DASHBOARD = os.path.join(OPERATION, "grafana", "selenograph.json")
ALERTS = os.path.join(OPERATION, "prometheus", "alerts.yml")
FUNCTIONS = {"rate", "sum", "by", "increase", "changes", "histogram_quantile", "label_values", "and", "or"}
OF_PROMETHEUS = {"up", "instance", "job"}


def dashboard_expressions():
    with open(DASHBOARD) as file:
        dashboard = json.load(file)
    found = [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", ())]
    return found + [variable["definition"] for variable in dashboard["templating"]["list"] if "definition" in variable]


def alert_expressions():
    with open(ALERTS) as file:
        return re.findall(r"^\s+expr: (.+)$", file.read(), re.M)


def selectors(expression):
    """(metric, {label: value of a matcher}) of each time series that a PromQL expression names, and labels of `by (..)`."""
    used = []
    for grouping in re.findall(r"\bby \(([^)]*)\)", expression):
        used += [(None, {label.strip(): None}) for label in grouping.split(",")]
    expression = re.sub(r"\bby \([^)]*\)|\[[^\]]*\]", " ", expression)
    for name, labels in re.findall(r"([a-zA-Z_:][a-zA-Z0-9_:]*)\s*(\{[^}]*\})?", re.sub(r'"[^"]*"(?![^{]*\})', "", expression)):
        if name not in FUNCTIONS:
            used.append((name, dict(re.findall(r'(\w+)=~?"([^"]*)"', labels))))
    return used


def samples(exposition):
    """{metric: [{label: value}, ...]}"""
    found = {}
    for line in exposition.splitlines():
        if line and not line.startswith("#"):
            name, labels = re.fullmatch(r"(\w+)(\{.*\})? \S+", line).groups()
            found.setdefault(name, []).append(dict(re.findall(r'(\w+)="((?:[^"\\]|\\.)*)"', labels or "")))
    return found


def missing(expressions, there, mine):
    """What `mine` (a prefix) metrics are named, with labels, that are not there."""
    lacks = []
    for expression in expressions:
        for name, labels in selectors(expression):
            if name is None or name in OF_PROMETHEUS or not name.startswith(mine):
                continue
            series = there.get(name)
            if series is None:
                lacks.append(f"{name} in {expression}")
                continue
            wanted = {label: value for label, value in labels.items() if label not in OF_PROMETHEUS}
            if not any(all(label in s and re.fullmatch(value.replace("$instance", ".*"), s[label])
                           for label, value in wanted.items()) for s in series):
                lacks.append(f"{name}{wanted} in {expression}")
    return lacks


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "1", "--columns", "1", "--ppd", "64")


def tearDownModule():
    harness.tear_down()


class Monitoring(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.service = Service()
        cls.service.frame(frame_request())
        cls.service.wait_for('selenograph_http_requests_total{route="/v1/frames",method="POST",status="200"}', 1)
        cls.there = samples(cls.service.ask("GET", "/metrics")[2].decode())

    @classmethod
    def tearDownClass(cls):
        cls.service.expect_clean_stop()

    def test_dashboard_queries_existing_metrics(self):
        expressions = dashboard_expressions()
        self.assertGreater(len(expressions), 30)
        self.assertEqual(missing(expressions, self.there, ("selenograph_", "process_")), [])

    def test_alerts_query_existing_metrics(self):
        expressions = alert_expressions()
        self.assertGreater(len(expressions), 15)
        self.assertEqual(missing(expressions, self.there, ("selenograph_", "process_")), [])

    def test_all_names_are_somebodys(self):
        for expression in dashboard_expressions() + alert_expressions():
            for name, _ in selectors(expression):
                if name is not None and name not in OF_PROMETHEUS:
                    self.assertRegex(name, "^(selenograph|haproxy|process)_", expression)

    def test_the_dashboard_shows_all_there_is(self):
        shown = {name for expression in dashboard_expressions() for name, _ in selectors(expression)}
        shown |= {name.replace("_bucket", part) for name in shown if name for part in ("_sum", "_count")}
        self.assertEqual(set(self.there) - shown, {"process_start_time_seconds"})

    def test_the_panels_do_not_overlap(self):
        with open(DASHBOARD) as file:
            panels = json.load(file)["panels"]
        self.assertEqual(len({panel["id"] for panel in panels}), len(panels))
        taken = set()
        for panel in panels:
            at = panel["gridPos"]
            cells = {(x, y) for x in range(at["x"], at["x"] + at["w"]) for y in range(at["y"], at["y"] + at["h"])}
            self.assertFalse(cells & taken, panel["title"])
            taken |= cells

    @unittest.skipUnless(shutil.which("promtool"), "promtool is not installed: apt-get install prometheus")
    def test_promtool_takes_the_alerts(self):
        done = subprocess.run(["promtool", "check", "rules", ALERTS], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.assertEqual(done.returncode, 0, done.stdout)
        done = subprocess.run(["promtool", "check", "config", os.path.join(OPERATION, "prometheus", "prometheus.yml")],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.assertEqual(done.returncode, 0, done.stdout)


if __name__ == "__main__":
    harness.main()
