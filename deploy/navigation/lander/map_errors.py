"""Flights with wrong maps: each flight carries a map of its own, drawn from stated errors.

The planners know the statistics of the errors, not the draw. They rehearse with maps of other seeds; the shift, one value for
a whole map, is added to the rehearsed bias by its standard deviation. Beside it flies a filter whose planners trust the map.
"""

import dataclasses
import json

import numpy as np

from . import campaign as campaigns
from . import consistency, flight, rehearsal
from .camera import Detector
from .descent import geodetic
from .filter import MapError
from .map import Map, level_requests, levels_of

PLANNERS_SEEDS = (9001, 9002, 9003)  # of the maps that the planners rehearse with
LOW_M = 3000  # altitude below which the figures have a NEES of their own
SHIFT_LENGTH_M = 100e3  # a shift does not change over a descent: the longest distance that a rehearsal fits


@dataclasses.dataclass(frozen=True)
class Case:
    name: str
    error: dict  # members of `map_error`, but for those that are drawn
    shift_sigma_m: float = 0.0  # of each axis

    def draw(self, scenario, seed):
        """Returns the `map_error` of a seed, None without one."""
        members = {**self.error}
        if self.shift_sigma_m:
            north_m, east_m = np.random.default_rng([seed, 5]).normal(0, self.shift_sigma_m, 2)
            lat_deg, lon_deg, _ = geodetic(scenario.descent.position(scenario.descent.duration_s))
            members.update(about={"lat_deg": float(lat_deg), "lon_deg": float(lon_deg)},
                           shift={"north_m": north_m, "east_m": east_m})
        return {**members, "seed": seed} if members else None


def heights(deviation_m, length_m):
    return {"height": [{"standard_deviation_m": deviation_m, "correlation_length_m": length_m}]}


CASES = (
    Case("none", {}),
    Case("heights 3.5 m over 300 m (`sldem2015`, at the terrain's resolution)", heights(3.5, 300)),
    Case("heights 10 m over 1000 m", heights(10, 1000)),
    Case("albedo 5 % over 300 m", {"albedo": [{"standard_deviation": 0.05, "correlation_length_m": 300}]}),
    Case("resolution 118 m (the terrain: 30 m)", {"resolution_m": 118}),
    Case("shift 20 m north and east", {}, shift_sigma_m=20),
    Case("heights 10 m over 1000 m, albedo 5 % over 300 m, shift 20 m",
         {**heights(10, 1000), "albedo": [{"standard_deviation": 0.05, "correlation_length_m": 300}]}, shift_sigma_m=20),
)


def _levels(scenario, client, requests, error):
    return levels_of(client, requests, **({"map_error": error} if error else {}))


def rehearsed(case, scenario, client, requests, practice):
    """What planners learn of a case's maps without knowing which one flies."""
    rows, draws = [], []
    without_shift = dataclasses.replace(case, shift_sigma_m=0.0)
    for number, seed in enumerate(PLANNERS_SEEDS if case.error else PLANNERS_SEEDS[:1]):
        levels = _levels(scenario, client, requests, without_shift.draw(scenario, seed))
        onboard = Map(levels, post_spacing_m=practice.post_spacing_m)
        found = rehearsal.offsets(practice, onboard, campaigns.IMU, Detector(), seed=number)
        rows.append(found)
        draws.append(np.full(len(found), number))
    return with_shift(rehearsal.map_error(np.concatenate(rows), np.concatenate(draws)), case.shift_sigma_m)


def with_shift(error, sigma_m):
    """Adds a shift of the map to the statistics of its bias. The filter has one length for both: their mean, weighted by
    the variances."""
    if not sigma_m:
        return error
    variances = error.sigmas_m**2 + np.array([sigma_m**2, sigma_m**2, 0.0])
    share = (sigma_m**2 * 2) / variances.sum(axis=1).mean()
    length_m = (1 - share) * error.length_m + share * SHIFT_LENGTH_M
    return MapError(error.radii_m, np.sqrt(variances), length_m, error.excess)


def fly(scenario, client, campaign):
    """Flies each case with both filters; returns and writes the table."""
    truth = flight.Truth(scenario, client)
    practice = flight.Truth(scenario, client, sun=rehearsal.other_sun(scenario))
    requests = level_requests(scenario, truth.post_spacing_m, campaigns.INITIAL.sigmas[0])
    trusted = rehearsed(CASES[0], scenario, client, requests, practice)
    rows = []
    for case in CASES:
        errors = {True: rehearsed(case, scenario, client, requests, practice) if case.draw(scenario, 0) else trusted}
        if case.draw(scenario, 0):
            errors[False] = trusted
        _fly_case(case, errors, requests, truth, client, campaign)
        for knows, error in errors.items():
            rows.append({"case": case.name, "knows": knows, **_figures(_folder(campaign, case, knows), error)})
            print(json.dumps(rows[-1]), flush=True)
        campaigns.write_json(campaign.folder / "table.json", rows)
    return rows


def _folder(campaign, case, knows):
    return campaign.folder / f"{CASES.index(case)}-{'known' if knows else 'unknown'}"


def _fly_case(case, errors, requests, truth, client, campaign):
    """Draws each seed's map once, for both filters."""
    left = {}
    for knows in errors:
        one = dataclasses.replace(campaign, folder=_folder(campaign, case, knows))
        left[knows] = one, one.begin({**campaigns.conditions_of(truth.scenario), "case": dataclasses.asdict(case),
                                      "knows": knows})
    levels = None
    for seed in sorted({seed for _, seeds in left.values() for seed in seeds}):
        if levels is None or case.draw(truth.scenario, 0):  # without an error all seeds have one map
            levels = _levels(truth.scenario, client, requests, case.draw(truth.scenario, seed))
        for knows, (one, seeds) in left.items():
            if seed in seeds:
                one.fly([seed], truth, Map(levels, errors[knows], truth.post_spacing_m))


def _figures(folder, error):
    runs, _ = campaigns.flights(folder)

    def of(name):
        return consistency.column(runs, list(flight.COLUMNS), name)

    end_m, begun = of("position_error_m")[:, -1], consistency.acquired(runs, list(flight.COLUMNS))
    is_low = of("altitude_m")[0] < LOW_M
    low, high = consistency.nees_bounds(len(runs))
    return {"flights": len(runs), "end_rms_m": float(consistency.rms(end_m)), "end_largest_m": float(end_m.max()),
            "end_sigma_m": float(of("position_sigma_m")[:, -1].mean()),
            **{f"{what}_nees": float(of(f"{what}_nees")[begun].mean()) for what in ("position", "velocity", "attitude")},
            "low_position_nees": float(of("position_nees")[:, is_low].mean()),
            "end_position_nees": float(of("position_nees")[:, -1].mean()), "nees_bounds": [float(low), float(high)],
            "matches": float(of("matches")[begun].mean()), "bias_sigma_m": float(error.sigmas_m.max())}
