"""Plots and tables of what the other commands wrote."""

import json
import textwrap

import matplotlib
import numpy as np

from . import campaign, consistency, scenarios
from .flight import COLUMNS

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

EDGES_M = (0, 150, 300, 700, 1500, 3000, 5000, 8000, 12000, 14000, 20000)
STYLE = {"font.size": 8, "axes.grid": True, "grid.color": "#dddddd", "grid.linewidth": 0.5, "lines.linewidth": 1.2,
         "legend.frameon": False, "figure.constrained_layout.use": True, "savefig.dpi": 80}
BLUE, RED, GREEN = "#0072B2", "#D55E00", "#009E73"


def draw(folder):
    """Returns the tables, which are in report.json as well."""
    report = {}
    with plt.rc_context(STYLE):
        for name in ("fly", "monte-carlo"):
            if list((folder / name).glob("*.npz")):
                report[name] = _flights(folder, name)
        if (folder / "causes.json").exists():
            report["causes"] = json.loads((folder / "causes.json").read_text())
        if (folder / "map-errors" / "table.json").exists():
            report["map-errors"] = json.loads((folder / "map-errors" / "table.json").read_text())
        if (folder / "sweep").is_dir():
            report["sweep"] = _points(folder / "sweep")
            _sweep(folder, report["sweep"])
    campaign.write_json(folder / "report.json", report)
    return report


def publish(work):
    """Writes report.md into `work`: plots and tables of the scenarios that have been flown there."""
    text = []
    for folder in sorted(path.parent for path in work.glob("*/report.json")):
        tables = draw(folder)
        for name in ("monte-carlo", "sweep"):
            if tables.get(name):
                text += _monte_carlo_page(tables[name]) if name == "monte-carlo" else _sweep_page(tables[name], folder)
                text += [f"![{folder.name}: {name}]({folder.name}/{name}.png)", ""]
        if tables.get("causes"):
            text += _causes_page(tables["causes"], folder)
        if tables.get("map-errors"):
            text += _map_errors_page(tables["map-errors"], folder)
    (work / "report.md").write_text("\n".join(line for long in text for line in _lines(long)))


def _lines(text):
    """Prose in lines of 120 characters; tables, plots and headings as they are."""
    if text.startswith(("|", "!", "#")) or not text:
        return [text]
    return textwrap.wrap(text, 120, subsequent_indent="  " if text.startswith("- ") else "", break_on_hyphens=False)


def _flights(folder, name):
    runs, seconds = campaign.flights(folder / name)
    conditions = {**json.loads((folder / name / "conditions.json").read_text()), "runs": len(runs),
                  "frames": runs.shape[1], "navigation_processor_ms_per_frame": 1000 * seconds.mean() / runs.shape[1],
                  "map": json.loads((folder / name / "map.json").read_text())}
    _plot_flights(runs, conditions, folder / f"{name}.png")
    low, high = consistency.nees_bounds(len(runs))
    begun = consistency.acquired(runs, COLUMNS)
    position, velocity = (consistency.column(runs, COLUMNS, f"{what}") for what in ("position_error_m",
                                                                                    "velocity_error_m_s"))
    first = np.where(begun.any(axis=1), begun.argmax(axis=1), runs.shape[1]) * conditions["frame_step_s"]
    all_begun = begun.all(axis=0)
    means = {what: consistency.column(runs, COLUMNS, f"{what}_nees").mean(axis=0)[all_begun]
             for what in ("position", "velocity", "attitude")}
    return {
        "conditions": conditions,
        "acquisition_s": {"median": float(np.median(first)), "largest": float(first.max()),
                          "never": int((~begun.any(axis=1)).sum())},
        "end": {"position_rms_m": float(consistency.rms(position[:, -1])),
                "position_median_m": float(np.median(position[:, -1])),
                "position_95_m": float(np.percentile(position[:, -1], 95)), "largest_m": float(position[:, -1].max()),
                "velocity_rms_m_s": float(consistency.rms(velocity[:, -1]))},
        "nees": {"bounds": [float(low), float(high)],
                 **{f"{what}_mean": float(values.mean()) for what, values in means.items()},
                 **{f"{what}_frames_below_percent": float(100 * np.mean(values < low))
                    for what, values in means.items()},
                 **{f"{what}_frames_above_percent": float(100 * np.mean(values > high))
                    for what, values in means.items()}},
        "by_altitude": consistency.by_altitude(runs, COLUMNS, conditions["focal_px"], EDGES_M),
    }


def _plot_flights(runs, conditions, path):
    count, focal_px = len(runs), conditions["focal_px"]

    def of(name):
        return consistency.column(runs, COLUMNS, name)

    altitude, time = of("altitude_m")[0], of("time_s")[0]
    figure, axes = plt.subplots(2, 3, figsize=(12, 6.4))
    for axis, error, sigma, unit in ((axes[0, 0], "position_error_m", "position_sigma_m", "position, m"),
                                     (axes[0, 1], "velocity_error_m_s", "velocity_sigma_m_s", "velocity, m/s")):
        axis.plot(time, of(error)[:20].T, color="#bbbbbb", linewidth=0.3)  # some, to see what one is like
        axis.plot(time, consistency.rms(of(error)), color=BLUE, label="RMS of the error")
        if count > 1:
            axis.plot(time, np.percentile(of(error), 95, axis=0), color=RED, label="95 %")
        axis.plot(time, consistency.rms(of(sigma)), "--", color=GREEN, label="1 sigma of the filter (RMS)")
        axis.set(yscale="log", xlabel="time, s", ylabel=unit, title=f"{conditions['scenario']}: {count} flights")
        axis.legend()
    axis = axes[1, 0]
    low, high = consistency.nees_bounds(count)
    for what, colour in (("position", BLUE), ("velocity", RED), ("attitude", GREEN)):
        axis.plot(time, of(f"{what}_nees").mean(axis=0), color=colour, label=what)
    axis.axhspan(low, high, color="#bbbbbb", label=f"95 % bounds of {count} flights")
    axis.set(yscale="log", xlabel="time, s", ylabel="mean NEES, 3 degrees of freedom", title="Consistency")
    axis.legend()
    axis = axes[1, 1]
    axis.plot(time, altitude / 1000, color="black", label="altitude above the terrain, km")
    axis.plot(time, of("matches").mean(axis=0) / 10, color=BLUE, label="matches a frame / 10")
    axis.set(xlabel="time, s", title="Flight and matches")
    axis.legend()
    edges = np.geomspace(altitude.min(), altitude.max() * 1.001, 19)
    rows = consistency.by_altitude(runs, COLUMNS, focal_px, edges)
    middles = [np.sqrt(row["altitude_m"][0] * row["altitude_m"][1]) / 1000 for row in rows]
    for axis, unit, label in ((axes[0, 2], "m", "m"), (axes[1, 2], "percent", "% of altitude")):
        axis.plot(middles, [row[f"position_rms_{unit}"] for row in rows], "o-", markersize=3, color=BLUE, label="RMS")
        axis.plot(middles, [row[f"position_95_{unit}"] for row in rows], "o-", markersize=3, color=RED, label="95 %")
        axis.set(xscale="log", yscale="log", xlabel="altitude above the terrain, km", ylabel=f"position error, {label}",
                 title="Against altitude, from the first matches on")
        axis.set_xticks([1, 2, 5, 10, 15])
        axis.legend()
    pixels = axes[1, 2].twinx()
    pixels.set(yscale="log", ylabel="pixels", ylim=np.array(axes[1, 2].get_ylim()) * focal_px / 100)
    pixels.grid(False)
    for axis in (axes[0, 2], axes[1, 2], pixels):
        axis.yaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter("")
        axis.yaxis.set_minor_formatter("")
    figure.savefig(path)
    plt.close(figure)


def _points(folder):
    """What a sweep has flown, in the order of its points; errors of the second half of the flights."""
    rows = []
    flown = {path.parent.name: json.loads(path.read_text()) for path in folder.glob("*/conditions.json")}
    known = [name for made in scenarios.ALL.values() for name in (point.name for point in campaign.points(made()))]
    for name in sorted(flown, key=lambda name: known.index(name) if name in known else len(known)):
        path, conditions = folder / name / "conditions.json", flown[name]
        runs, _ = campaign.flights(path.parent)
        if not len(runs):
            continue
        frames = json.loads((path.parent / "frames.json").read_text())
        half = runs[:, runs.shape[1] // 2:]
        position = consistency.column(half, COLUMNS, "position_error_m")
        rows.append({"what": conditions["what"], "value": conditions["value"], "runs": len(runs),
                     "position_rms_m": float(np.sqrt(np.mean(position**2))),
                     "position_95_m": float(np.percentile(position, 95)),
                     "end_rms_m": float(consistency.rms(position[:, -1])),
                     "velocity_rms_m_s": float(np.sqrt(np.mean(
                         consistency.column(half, COLUMNS, "velocity_error_m_s")**2))),
                     "position_nees": float(consistency.column(half, COLUMNS, "position_nees").mean()),
                     "matches": float(consistency.column(half, COLUMNS, "matches").mean()), **frames})
    return rows


def _sweep(folder, points):
    kinds = list(dict.fromkeys(point["what"] for point in points))
    if not kinds:
        return
    columns = min(4, len(kinds))
    rows = -(-len(kinds) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(2.6 * columns, 2.4 * rows), squeeze=False)
    for axis in axes.flat[len(kinds):]:
        axis.set_axis_off()
    for axis, kind in zip(axes.flat, kinds):
        these = [point for point in points if point["what"] == kind]
        for column, label, colour in (("position_rms_m", "RMS", BLUE), ("position_95_m", "95 %", RED)):
            axis.plot([str(point["value"]) for point in these], [point[column] for point in these], "o-", color=colour,
                      label=label)
        axis.set(xlabel=kind, ylabel="position, second half, m")
        if max(point["position_95_m"] for point in these) > 20 * min(point["position_rms_m"] for point in these):
            axis.set_yscale("log")
        else:
            axis.set_ylim(0, None)
        axis.legend()
    figure.savefig(folder / "sweep.png")
    plt.close(figure)


def _table(heads, rows):
    return ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads),
            *("| " + " | ".join(row) + " |" for row in rows), ""]


def _figures(value):
    """Three figures, without an exponent."""
    digits = 2 if abs(value) < 1e-9 else max(0, 2 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.{min(digits, 4)}f}"


def _pair(row, name):
    unit = name.split("_", 1)[1]
    return f"{_figures(row[f'position_rms_{unit}'])}, {_figures(row[f'position_95_{unit}'])}"


def _monte_carlo_page(tables):
    conditions, end, nees = tables["conditions"], tables["end"], tables["nees"]
    of_map, flight, over = conditions["map"], conditions["flight_sun"], conditions["map_sun"]
    rows = [[f"{row['altitude_m'][0] / 1000:g} to {row['altitude_m'][1] / 1000:g}", _pair(row, "position_m"),
             _pair(row, "position_percent"), _pair(row, "position_px"),
             f"{_figures(row['velocity_rms_m_s'])}, {_figures(row['velocity_95_m_s'])}",
             f"{_figures(row['velocity_rms_percent_per_s'])}, {_figures(row['velocity_rms_px_per_s'])}",
             *(f"{row[f'{what}_nees']:.1f}" for what in ("position", "velocity", "attitude")), f"{row['matches']:.0f}"]
            for row in tables["by_altitude"][::-1]]
    return [
        f"### {conditions['scenario']}: {conditions['runs']} flights", "",
        (f"Detail `{conditions['detail']}`" if conditions.get("detail") else f"Posts of {of_map['post_spacing_m']:.0f} m")
        + f", map pixels of {', '.join(f'{gsd:.2g}' for gsd in of_map['gsd_m'])} m. Sun (azimuth, elevation): frames "
        f"{flight['azimuth_deg']:g}, {flight['elevation_deg']:g}; map {over['azimuth_deg']:g}, "
        f"{over['elevation_deg']:g} degrees. Reflectance `{conditions['surface']['preset']}`. {conditions['frames']} frames of {conditions['camera_px']} x "
        f"{conditions['camera_px']}, each {conditions['frame_step_s']:g} s.", "",
        f"- First matches after {tables['acquisition_s']['median']:.0f} s (median), "
        f"{tables['acquisition_s']['largest']:.0f} s (longest); never: {tables['acquisition_s']['never']} flights.",
        f"- At the end: position RMS {_figures(end['position_rms_m'])} m, median {_figures(end['position_median_m'])}, "
        f"95 % {_figures(end['position_95_m'])}, largest {_figures(end['largest_m'])} m; velocity RMS "
        f"{_figures(end['velocity_rms_m_s'])} m/s.",
        f"- NEES of 3: position {nees['position_mean']:.2f}, velocity {nees['velocity_mean']:.2f}, attitude "
        f"{nees['attitude_mean']:.2f} on average; 95 % bounds of the mean of {conditions['runs']} flights "
        f"{nees['bounds'][0]:.2f} to {nees['bounds'][1]:.2f}. Frames below, above them: "
        + ", ".join(f"{what} {nees[f'{what}_frames_below_percent']:.0f} %, {nees[f'{what}_frames_above_percent']:.0f} %"
                    for what in ("position", "velocity", "attitude")) + ".",
        f"- Navigation: {conditions['navigation_processor_ms_per_frame']:.0f} ms of processor time a frame "
        f"({conditions['machine']}, others at work on it).", "",
        *_table(["altitude, km", "position RMS, 95 %: m", "% of altitude", "pixels", "velocity RMS, 95 %: m/s",
                 "RMS: %/s, px/s", "NEES position", "velocity", "attitude", "matches"], rows)]


def _causes_page(causes, folder):
    def triple(values):
        return ", ".join(f"{value:.1f}" for value in values)

    low, high = causes["altitudes_m"]
    rows = [[case["case"], triple(case["offset_mean_m"]), triple(case["offset_rms_m"]), triple(case["scatter_m"]),
             f"{case['matches']:.0f}"] for case in causes["cases"]]
    followed = [f"{reach} pixels: {east:.2f}, {north:.2f}" for reach, (east, north) in causes["followed"].items()]
    return [f"### {folder.name}: why matches err", "",
            f"Frames at known poses between {low / 1000:g} and {high / 1000:g} km. Offset: the shift (east, north, up) "
            "that fits all matches of a frame. Scatter: of single matches, across and along the track.", "",
            *_table(["case", "offset, mean: m", "RMS: m", "scatter: m", "matches"], rows),
            f"Share of the lander's own error that matches repeat (east, north), by the reach of the search in pixels "
            f"of the working scale: {'; '.join(followed)}. 0 is right.", ""]


def _sweep_page(points, folder):
    rows = [[point["what"], str(point["value"]), str(point["runs"]),
             f"{_figures(point['position_rms_m'])}, {_figures(point['position_95_m'])}", _figures(point["end_rms_m"]),
             _figures(point["velocity_rms_m_s"]), f"{point['position_nees']:.1f}", f"{point['matches']:.0f}",
             f"{point['service_ms']:.0f}"] for point in points]
    return [f"### {folder.name}: one thing changed at a time", "",
            *_table(["what", "value", "flights", "position RMS, 95 %, second half: m", "at the end, RMS: m",
                     "velocity RMS: m/s", "NEES of 3", "matches", "service, ms a frame"], rows)]


def _map_errors_page(table, folder):
    nees = ("end_position", "low_position", "position", "velocity", "attitude")
    rows = [[row["case"], "yes" if row["knows"] else "no", str(row["flights"]), _figures(row["end_rms_m"]),
             _figures(row["end_largest_m"]), _figures(row["end_sigma_m"]), *(f"{row[f'{what}_nees']:.1f}" for what in nees),
             f"{row['matches']:.0f}"] for row in table]
    bounds = {row["flights"]: "{:.2f} to {:.2f}".format(*row["nees_bounds"]) for row in table}
    return [f"### {folder.name}: maps that are wrong", "",
            "Each flight carries a map of its own (`map_error`, drawn by seed); frames show the terrain. A filter that "
            "knows the errors has the statistics of a rehearsal with maps of other seeds, and the shift's deviation; one "
            "that does not has those of a rehearsal with the right map. NEES of 3, the position's at the end, below 3 km "
            "and over the flight. 95 % bounds of the mean: "
            f"{', '.join(f'{text} for {count} flights' for count, text in bounds.items())}.", "",
            *_table(["error of the map", "known", "flights", "at the end, RMS: m", "largest: m", "filter's sigma: m",
                     "NEES at the end", "below 3 km", "position", "velocity", "attitude", "matches"], rows)]
