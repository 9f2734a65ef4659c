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


def by_altitude(runs, columns, focal_px, edges_m):
    """Rows of (altitude, errors) for frames between edges of altitude; each altitude is that above the terrain."""
    altitude = column(runs, columns, "altitude_m")[0]
    rows = []
    for low, high in zip(edges_m[:-1], edges_m[1:]):
        inside = (altitude >= low) & (altitude < high)
        if not inside.any():
            continue
        position = column(runs, columns, "position_error_m")[:, inside]
        velocity = column(runs, columns, "velocity_error_m_s")[:, inside]
        mean_altitude = float(altitude[inside].mean())
        rows.append({
            "altitude_m": [low, high], "frames": int(inside.sum()),
            "position_rms_m": float(np.sqrt(np.mean(position**2))),
            "position_95_m": float(np.percentile(position, 95)),
            "position_rms_percent_of_altitude": float(100 * np.sqrt(np.mean((position / altitude[inside]) ** 2))),
            "position_rms_px": float(np.sqrt(np.mean((position * focal_px / altitude[inside]) ** 2))),
            "velocity_rms_m_s": float(np.sqrt(np.mean(velocity**2))),
            "velocity_95_m_s": float(np.percentile(velocity, 95)),
            "velocity_rms_percent_of_altitude_per_s": float(100 * np.sqrt(np.mean(velocity**2)) / mean_altitude),
            "position_nees": float(column(runs, columns, "position_nees")[:, inside].mean()),
            "velocity_nees": float(column(runs, columns, "velocity_nees")[:, inside].mean()),
            "matches": float(column(runs, columns, "matches")[:, inside].mean()),
            "frames_with_matches_percent": float(100 * (column(runs, columns, "matches")[:, inside] > 0).mean()),
        })
    return rows
