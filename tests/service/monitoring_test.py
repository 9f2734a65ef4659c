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
from harness import REPOSITORY, Service, frame_request, tearDownModule

OPERATION = os.path.join(REPOSITORY, "deploy", "operation")
DASHBOARD = os.path.join(OPERATION, "grafana", "selenograph.json")
ALERTS = os.path.join(OPERATION, "prometheus", "alerts.yml")
FUNCTIONS = {"rate", "sum", "by", "increase", "changes", "histogram_quantile", "label_values", "and", "or"}
OF_PROMETHEUS = {"up", "instance", "job"}
# What the alerts read, as promtool writes values: where all is bad, and where all is well.
NODE, PROXY = 'instance="a",job="selenograph"', 'instance="p",job="selenograph-proxy"'
RISES, STAYS = "0+6000x180", "7x180"
SERIES = {
    f"up{{{NODE}}}": ("0x180", "1x180"),
    f"up{{{PROXY}}}": ("0x180", "1x180"),
    f"selenograph_ready{{{NODE}}}": ("0x180", "1x180"),
    f"process_start_time_seconds{{{NODE}}}": (RISES, STAYS),
    f'selenograph_http_requests_total{{{NODE},route="/v1/frames",method="POST",status="200"}}': (RISES, RISES),
    **{f'selenograph_errors_total{{{NODE},code="{code}"}}': (RISES, STAYS)
       for code in ("busy", "deadline_exceeded", "internal", "terrain_data_error", "asset_error", "storage_unavailable")},
    f"selenograph_frames_waiting{{{NODE}}}": ("250x180", "10x180"),
    f"selenograph_frames_waiting_limit{{{NODE}}}": ("256x180", "256x180"),
    f"selenograph_terrain_warnings{{{NODE}}}": ("1x180", "0x180"),
    f"selenograph_cache_trouble{{{NODE}}}": ("1x180", "0x180"),
    f"selenograph_terrain_chunks_rejected_total{{{NODE}}}": (RISES, STAYS),
    f"selenograph_terrain_chunks_built_total{{{NODE}}}": (RISES, STAYS),
    f"selenograph_terrain_cache_evictions_total{{{NODE}}}": (RISES, STAYS),
    f"selenograph_terrain_cache_misses_total{{{NODE}}}": (RISES, STAYS),
    f"selenograph_terrain_cache_hits_total{{{NODE}}}": (RISES, RISES),
    f"selenograph_request_memory_bytes{{{NODE}}}": ("95x180", "10x180"),
    f"selenograph_request_memory_capacity_bytes{{{NODE}}}": ("100x180", "100x180"),
    f"selenograph_log_dropped_total{{{NODE}}}": (RISES, STAYS),
    f'haproxy_backend_active_servers{{{PROXY},proxy="nodes"}}': ("0x180", "2x180"),
    f'haproxy_server_status{{{PROXY},proxy="nodes",server="node1",state="UP"}}': ("0x180", "1x180"),
    f'haproxy_backend_retry_warnings_total{{{PROXY},proxy="nodes"}}': (RISES, STAYS),
    f'haproxy_backend_http_requests_total{{{PROXY},proxy="nodes"}}': (RISES, RISES),
    f'haproxy_frontend_http_responses_total{{{PROXY},proxy="outside",code="5xx"}}': (RISES, STAYS),
    f'haproxy_frontend_http_responses_total{{{PROXY},proxy="outside",code="2xx"}}': (RISES, RISES),
}


def dashboard_expressions():
    with open(DASHBOARD) as file:
        dashboard = json.load(file)
    found = [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", ())]
    return found + [variable["definition"] for variable in dashboard["templating"]["list"] if "definition" in variable]


def alert_expressions():
    with open(ALERTS) as file:
        return re.findall(r"^\s+expr: (.+)$", file.read(), re.M)


def alert_names():
    with open(ALERTS) as file:
        return re.findall(r"^\s+- alert: (\w+)$", file.read(), re.M)


def promtool(*arguments):
    done = subprocess.run(["promtool", *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return done.returncode, done.stdout


of_promtool = unittest.skipUnless(shutil.which("promtool"), "promtool is not installed: apt-get install prometheus")


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

    def test_both_sides_of_a_comparison_have_the_same_labels(self):
        """Else it is of nothing, and never true."""
        for expression in alert_expressions():
            for comparison in re.split(" and | or ", expression):
                sides = [selectors(side) for side in re.split(" (?:[<>]=?|==) ", comparison)]
                labels = [[labels for name, labels in side if name is None] or [labels for _, labels in side] for side in sides if side]
                self.assertTrue(all(one == labels[0] for one in labels), comparison)

    @of_promtool
    def test_promtool_takes_the_alerts(self):
        for arguments in (("rules", ALERTS), ("config", os.path.join(OPERATION, "prometheus", "prometheus.yml"))):
            status, said = promtool("check", *arguments)
            self.assertEqual(status, 0, said)

    @of_promtool
    def test_each_alert_fires_and_none_where_all_is_well(self):
        firing = [{"labels": f'{{alertname="{name}"}}', "value": 1} for name in alert_names()]
        self.assertGreater(len(firing), 15)
        tests = [{"interval": "1m",
                  "input_series": [{"series": series, "values": values[i]} for series, values in SERIES.items()],
                  "promql_expr_test": [{"expr": 'group by (alertname) (ALERTS{alertstate="firing"})', "eval_time": "150m",
                                        "exp_samples": expected}]}
                 for i, expected in enumerate((firing, []))]
        status, said = promtool("test", "rules", harness.write("alerts.json", {
            "rule_files": [os.path.abspath(ALERTS)], "evaluation_interval": "1m", "tests": tests}))
        self.assertEqual(status, 0, said)


if __name__ == "__main__":
    harness.main()
