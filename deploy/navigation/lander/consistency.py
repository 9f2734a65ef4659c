"""Statistics of many flights: errors against altitude, and the consistency of the filter."""

import numpy as np
from scipy import stats


def column(runs, columns, name):
    """runs: (runs, frames, columns)."""
    return runs[:, :, columns.index(name)]


def rms(values):
    return np.sqrt(np.mean(np.square(values), axis=0))


def nees_bounds(runs, freedom=3, probability=0.95):
    """Of the mean over independent runs of a normalised estimation error squared (Bar-Shalom et al. 2001, 5.4.2)."""
    tail = 0.5 * (1 - probability)
    return stats.chi2.ppf([tail, 1 - tail], runs * freedom) / runs


def share_inside(mean_nees, runs, freedom=3):
    low, high = nees_bounds(runs, freedom)
    return float(np.mean((mean_nees >= low) & (mean_nees <= high)))


def acquired(runs, columns):
    """Frames (runs, frames) from a flight's first matches on."""
    return np.cumsum(column(runs, columns, "matches") > 0, axis=1) > 0


def by_altitude(runs, columns, focal_px, edges_m):
    """Rows of (altitude, errors) for frames between edges of altitude above the terrain, once matches have begun."""
    altitude, begun = column(runs, columns, "altitude_m"), acquired(runs, columns)
    rows = []
    for low, high in zip(edges_m[:-1], edges_m[1:]):
        inside = (altitude >= low) & (altitude < high) & begun
        if not inside.any():
            continue

        def of(name):
            return column(runs, columns, name)[inside]

        position, velocity, height = of("position_error_m"), of("velocity_error_m_s"), altitude[inside]
        row = {"altitude_m": [low, high], "frames": int(inside.sum())}
        of_altitude = position / height
        for unit, values in (("m", position), ("percent", 100 * of_altitude), ("px", focal_px * of_altitude)):
            row[f"position_rms_{unit}"] = float(rms(values))
            row[f"position_95_{unit}"] = float(np.percentile(values, 95))
        row["velocity_rms_m_s"], row["velocity_95_m_s"] = float(rms(velocity)), float(np.percentile(velocity, 95))
        row["velocity_rms_percent_per_s"] = float(rms(100 * velocity / height))
        row["velocity_rms_px_per_s"] = float(rms(velocity * focal_px / height))
        for what in ("position", "velocity", "attitude"):
            row[f"{what}_nees"] = float(of(f"{what}_nees").mean())
        row["matches"] = float(of("matches").mean())
        row["frames_with_matches_percent"] = float(100 * (of("matches") > 0).mean())
        rows.append(row)
    return rows
