"""Plots and tables of what the other commands wrote."""

import json

import matplotlib
import numpy as np

from . import consistency

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

EDGES_M = (0, 1500, 3000, 5000, 8000, 12000, 20000)
STYLE = {"font.size": 8, "axes.grid": True, "grid.color": "#dddddd", "grid.linewidth": 0.5, "lines.linewidth": 1.2,
         "legend.frameon": False, "figure.constrained_layout.use": True, "savefig.dpi": 110}
BLUE, RED, GREEN = "#0072B2", "#D55E00", "#009E73"


def draw(folder):
    """Returns the tables, which are in report.json as well."""
    report = {}
    with plt.rc_context(STYLE):
        for name in ("fly", "monte-carlo"):
            if (folder / f"{name}.npz").exists():
                report[name] = _flights(folder, name)
        if (folder / "sweep.json").exists():
            report["sweep"] = json.loads((folder / "sweep.json").read_text())
            _sweep(folder, report["sweep"])
    (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n")
    return report


def _flights(folder, name):
    with np.load(folder / f"{name}.npz") as stored:
        runs, columns = stored["runs"].astype(float), [str(c) for c in stored["columns"]]
    conditions = json.loads((folder / f"{name}.json").read_text())
    count = len(runs)

    def of(column):
        return consistency.column(runs, columns, column)

    altitude_km, time = of("altitude_m")[0] / 1000, of("time_s")[0]
    figure, axes = plt.subplots(2, 2, figsize=(10, 6.4))
    for axis, error, sigma, unit in ((axes[0, 0], "position_error_m", "position_sigma_m", "position, m"),
                                     (axes[0, 1], "velocity_error_m_s", "velocity_sigma_m_s", "velocity, m/s")):
        axis.plot(time, of(error).T, color="#bbbbbb", linewidth=0.4)
        axis.plot(time, consistency.rms(of(error)), color=BLUE, label="RMS of the error")
        if count > 1:
            axis.plot(time, np.percentile(of(error), 95, axis=0), color=RED, label="95 %")
        axis.plot(time, consistency.rms(of(sigma)), "--", color=GREEN, label="1 sigma of the filter")
        axis.set(yscale="log", xlabel="time, s", ylabel=unit, title=f"{conditions['scenario']}: {count} flights")
        axis.legend()
    axis = axes[1, 0]
    low, high = consistency.nees_bounds(count)
    for what, colour in (("position", BLUE), ("velocity", RED), ("attitude", GREEN)):
        axis.plot(time, of(f"{what}_nees").mean(axis=0), color=colour, label=what)
    axis.axhspan(low, high, color="#dddddd", label="95 % of 3 degrees of freedom")
    axis.set(yscale="log", xlabel="time, s", ylabel="mean NEES", title="Consistency of the filter")
    axis.legend()
    axis = axes[1, 1]
    axis.plot(time, altitude_km, color="black", label="altitude above the terrain, km")
    axis.plot(time, of("matches").mean(axis=0) / 10, color=BLUE, label="matches a frame / 10")
    axis.set(xlabel="time, s", title="Flight and matches")
    axis.legend()
    figure.savefig(folder / f"{name}.png")
    plt.close(figure)
    tables = {"conditions": conditions, "nees_95_percent_bounds": [float(low), float(high)],
              "nees_inside_percent": {what: 100 * consistency.share_inside(of(f"{what}_nees").mean(axis=0), count)
                                      for what in ("position", "velocity", "attitude")},
              "end": {"position_rms_m": float(consistency.rms(of("position_error_m"))[-1]),
                      "position_95_m": float(np.percentile(of("position_error_m")[:, -1], 95)),
                      "velocity_rms_m_s": float(consistency.rms(of("velocity_error_m_s"))[-1])},
              "by_altitude": consistency.by_altitude(runs, columns, conditions["focal_px"], EDGES_M)}
    return tables


def _sweep(folder, points):
    kinds = list(dict.fromkeys(point["what"] for point in points))
    figure, axes = plt.subplots(1, len(kinds), figsize=(2.4 * len(kinds), 3), squeeze=False)
    for axis, kind in zip(axes[0], kinds):
        these = [point for point in points if point["what"] == kind]
        axis.plot([str(point["value"]) for point in these], [point["position_rms_m"] for point in these], "o-",
                  color=BLUE)
        axis.set(xlabel=kind, ylabel="position RMS, second half, m", ylim=(0, None))
    figure.savefig(folder / "sweep.png")
    plt.close(figure)
