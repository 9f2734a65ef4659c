"""Many flights: error against distance, beside the law of the fit's covariance."""

import concurrent.futures
import csv
import warnings

import matplotlib
import numpy as np
from selenograph import Client, FrameWarning

from .flight import COLUMNS, Flight

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def _fly(url, seed):
    warnings.simplefilter("ignore", FrameWarning)  # the Moon's reflectance at large phases: no figure hangs on it
    with Client(url, timeout_s=600) as client:
        return Flight(client, seed).fly()


def campaign(url, runs, seed, processes, folder):
    """Flies what isn't in the folder yet, one file for each flight, and draws all."""
    folder.mkdir(parents=True, exist_ok=True)
    left = [s for s in range(seed, seed + runs) if not (folder / f"flight-{s:04}.npy").exists()]
    with concurrent.futures.ProcessPoolExecutor(processes) as pool:
        for at, rows in zip(left, pool.map(_fly, [url] * len(left), left)):
            np.save(folder / f"flight-{at:04}.npy", rows)
    flights = np.array([np.load(folder / f"flight-{s:04}.npy") for s in range(seed, seed + runs)])
    table = _table(flights)
    with open(folder / "approach.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, table[0])
        writer.writeheader()
        writer.writerows(table)
    _draw(table, folder / "approach.png")
    return table


def _table(flights):
    of = {name: flights[..., i] for i, name in enumerate(COLUMNS)}

    def rms(name):
        return np.sqrt(np.nanmean(of[name] ** 2, axis=0))

    columns = {"distance_km": of["distance_m"].mean(0) / 1e3, "edges": of["edges"].mean(0),
               "stars": of["stars"].mean(0), "attitude_arcsec": rms("attitude_arcsec")}
    for how in ("sphere", "terrain"):
        columns |= {f"{how}_range_km": rms(f"{how}_range_m") / 1e3,
                    f"{how}_range_mean_km": np.nanmean(of[f"{how}_range_m"], axis=0) / 1e3,
                    f"{how}_across_km": rms(f"{how}_across_m") / 1e3,
                    f"{how}_law_range_km": rms(f"{how}_law_range_m") / 1e3,
                    f"{how}_filter_km": rms(f"{how}_place_m") / 1e3, f"{how}_filter_m_s": rms(f"{how}_velocity_m_s")}
    return [dict(zip(columns, map(float, values))) for values in zip(*columns.values())]


def _draw(table, path):
    distance = [row["distance_km"] for row in table]
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for how, colour in (("sphere", "#D55E00"), ("terrain", "#0072B2")):
        left.loglog(distance, [row[f"{how}_range_km"] for row in table], colour, label=f"{how}: range of one fit, RMS")
        left.loglog(distance, [row[f"{how}_across_km"] for row in table], colour, ls="--", label=f"{how}: across")
        right.loglog(distance, [row[f"{how}_filter_km"] for row in table], colour, label=f"{how}: place, filtered, RMS")
    left.loglog(distance, [row["terrain_law_range_km"] for row in table], "k:",
                label="law: range, by the scatter of the edges")
    for axes in (left, right):
        axes.set(xlabel="distance from the Moon's centre, km", ylabel="km")
        axes.invert_xaxis()
        axes.grid(True, color="#dddddd", lw=0.5)
        axes.legend(fontsize=7)
    figure.savefig(path, dpi=90)
    plt.close(figure)
