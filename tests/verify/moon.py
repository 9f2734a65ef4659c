#!/usr/bin/python3
"""Compares the Moon's brightness in frames with models of its irradiance and with real images: engine/verify/moon.md.

usage: tests/verify/moon.py [--dem PATH [--albedo-maps NAME] [--images DIR] [--assets-dir DIR]] -o DIR
       tests/verify/moon.py --dem PATH --center LAT,LON [--width-m M] [--detail NAME] -o DIR

Writes disc.csv, images.csv, relief.csv, moon.json and moon.md. Exits with 1 if a bound is exceeded, or if a control is
within it. Needs python3-scipy (deploy/install-packages verify).
"""

import argparse
import concurrent.futures
import csv
import itertools
import json
import pathlib
import sys

import numpy as np

import moon_images
import terrain_service
from terrain_service import MOON_RADIUS_M, TerrainService, Unusable, cell, harness

EARTH_M, FAR_M = 384.4e6, 1e10  # distances of the camera
RADIOMETRY = pathlib.Path(__file__).resolve().parents[2] / "engine" / "radiometry"
PHASES_DEG = (2, 3, 5, 7, 10, 15, 20, 30, 40, 50, 60, 70, 80, 90, 97)
TERRAIN_PHASES_DEG = (2, 5, 7, 15, 30, 45, 60, 75, 90)
NARROW_UM, TERRAIN_UM = 1e-3, 0.675
SATO_UM = (0.321, 0.689)  # measured bands of Sato et al. (2014)
PRESETS = ("moon", "moon-mare", "moon-highlands", "sato2014", "sato2014-mare", "sato2014-highlands")
MODELS = {**{name: {"preset": name} for name in PRESETS}, **{
    ", ".join(words): {"reflectance": dict(zip(("model", "phase"), words))} for words in (
        ("lommel_seeliger",), ("lommel_seeliger", "allen"), ("lommel_seeliger", "rolo"), ("lunar_lambert", "rolo"),
        ("hapke",))}}


# Published models of the disc


class DiscModel:
    """Disc-equivalent reflectance by Kieffer & Stone (2005), eq. (10), from a table of coefficients."""

    def __init__(self, name, first_deg, last_deg, shared=()):
        self.table = np.loadtxt(RADIOMETRY / f"{name}.csv", delimiter=",", skiprows=1)
        self.first_deg, self.last_deg, self.shared = first_deg, last_deg, shared

    def at(self, wavelength_um, phase_deg, sun_lon_deg=0):
        """Linear between bands; NaN outside them and outside the fitted phases. The observer is at 0 N 0 E."""
        centres_um = self.table[:, 0]
        if not (centres_um[0] <= wavelength_um <= centres_um[-1] and self.first_deg <= phase_deg <= self.last_deg):
            return np.nan
        return np.interp(wavelength_um, centres_um, [self.band(row, phase_deg, sun_lon_deg) for row in self.table])

    def band(self, row, phase_deg, sun_lon_deg):
        a, b, rest = row[1:5], row[5:8], row[8:]
        d, p = (rest[4:7], rest[7:]) if len(rest) > 3 else (rest, self.shared)
        g, sun = np.radians(phase_deg), np.radians(sun_lon_deg)
        return np.exp(a @ g ** np.arange(4) + b @ sun ** np.array([1, 3, 5]) + d[0] * np.exp(-phase_deg / p[0]) +
                      d[1] * np.exp(-phase_deg / p[1]) + d[2] * np.cos((phase_deg - p[2]) / p[3]))


ROLO = DiscModel("rolo", 1.55, 97, (4.06054, 12.8802, -30.5858, 16.7498))
LIME = DiscModel("lime", 0, 90)


def disc_row(preset, ground, wavelength_um, phase_deg, reflectance, sun_lon_deg=0):
    """A row of disc.csv; phases are negative when waning."""
    return {"preset": preset, "wavelength_um": wavelength_um, "phase_deg": phase_deg, "reflectance": reflectance,
            "rolo": ROLO.at(wavelength_um, abs(phase_deg), sun_lon_deg),
            "lime": LIME.at(wavelength_um, abs(phase_deg), sun_lon_deg), "ground": ground}


# Discs


def write_sphere(folder):
    """Writes a tile of the whole Moon with height 0 everywhere."""
    folder.mkdir()
    rows, columns, per_degree = 361, 720, 2
    (folder / "sphere.img").write_bytes(bytes(4 * rows * columns))
    (folder / "sphere.lbl").write_text("\r\n".join((
        'PDS_VERSION_ID = "PDS3"', "MISSION_NAME = SELENE", '^IMAGE = ("sphere.img", 1 <BYTES>)',
        "OBJECT = IMAGE_MAP_PROJECTION", 'MAP_PROJECTION_TYPE = "SIMPLE CYLINDRICAL"', f"MAP_RESOLUTION = {per_degree}",
        "MAXIMUM_LATITUDE = 90", "MINIMUM_LATITUDE = -90", "WESTERNMOST_LONGITUDE = 0",
        f"EASTERNMOST_LONGITUDE = {360 - 1 / per_degree}", f"LINE_PROJECTION_OFFSET = {90 * per_degree}",
        "SAMPLE_PROJECTION_OFFSET = 0", "END_OBJECT = IMAGE_MAP_PROJECTION", "OBJECT = IMAGE", f"LINES = {rows}",
        f"LINE_SAMPLES = {columns}", "SAMPLE_TYPE = PC_REAL", "SAMPLE_BITS = 32", "DUMMY = -99999",
        "END_OBJECT = IMAGE", "END", "")))


def disc_reflectance(service, surface, wavelength_um, sun_lon_deg, distance_m, size_px, accuracy):
    """Disc-equivalent reflectance of a frame of the whole Moon, north up, seen along the prime meridian."""
    f = size_px * distance_m / (2 * 1.02 * MOON_RADIUS_M)
    sun = np.radians(sun_lon_deg)
    arrays = service.arrays("/v1/frames", {
        "camera": {"width": size_px, "height": size_px, "fx": f}, "surface": surface, "products": ["radiance"],
        "pose": {"position_m": [distance_m, 0, 0], "camera_from_moon_matrix": [[0, 1, 0], [0, 0, -1], [-1, 0, 0]]},
        "sun": {"direction": [np.cos(sun), np.sin(sun), 0]}, "accuracy": accuracy,
        "band": {"center_um": wavelength_um, "width_um": NARROW_UM}}, "disc")
    # Pixels of a camera with so narrow a view have the same solid angle to 1e-4.
    moonlight = arrays["radiance"].sum(dtype=float) / f ** 2 / (MOON_RADIUS_M / distance_m) ** 2
    return moonlight / arrays["meta"]["solar_irradiance"]["value_w_m2"]


def discs_on_sphere(sphere, phases_deg):
    """Rows of all models, from so far away that the phase angle is the same all over.

    `moon` is rendered in all bands of ROLO and LIME, other presets in LIME's, a model without a spectrum in one."""
    lime_um = list(LIME.table[:, 0])
    all_um = sorted([*ROLO.table[:, 0], *lime_um])
    first, last = SATO_UM

    def frame(model, wavelength_um, phase_deg):
        return disc_reflectance(sphere, MODELS[model], wavelength_um, phase_deg, FAR_M, 128,
                                {"samples_per_pixel": 16, "max_error_px": 2})

    bands_um = {name: all_um if name == "moon" else lime_um if name in PRESETS else lime_um[:1] for name in MODELS}
    tasks = [(name, um, g) for name, bands in bands_um.items() for um in bands for g in phases_deg
             if "sato" not in name or first <= um <= last]
    with concurrent.futures.ThreadPoolExecutor(4) as threads:
        found = list(threads.map(frame, *zip(*tasks)))
    return [disc_row(name, "sphere", shown_um, g, value) for (name, um, g), value in zip(tasks, found)
            for shown_um in ([um] if name in PRESETS else all_um)]


def discs_on_terrain(service, surface, size_px):
    """Rows in LIME's band at 0.675 um from 384 400 km: terrain has the same effect at all wavelengths."""
    return [disc_row("moon", "terrain", TERRAIN_UM, g,
                     disc_reflectance(service, surface, TERRAIN_UM, g, EARTH_M, size_px, {"samples_per_pixel": 4}), g)
            for phase_deg in TERRAIN_PHASES_DEG for g in (phase_deg, -phase_deg)]


def relief_rows(service, sphere, options, surface):
    """Brightness of terrain from straight above relative to that of smooth ground, by incidence.

    The reflectance was fitted to the real Moon and includes its slopes and shadows already: this ratio shows how much
    terrain counts them twice."""
    try:
        lat_deg, lon_deg = map(float, options.center.split(","))
    except ValueError:
        raise Unusable(f"--center {options.center}: must be latitude and longitude in degrees: 26.1,3.6")
    point = {"lat_deg": lat_deg, "lon_deg": lon_deg}
    ground_m = service.json("/v1/heights", {"points": [point]}, "--center")["points"][0]["height_m"]
    if ground_m is None:
        raise Unusable(f"--center {options.center}: there is no terrain")
    above_m = 20 * options.width_m  # nearly parallel rays
    rows = []
    for incidence_deg in range(0, 90, 10):
        sun = {"local": {**point, "azimuth_deg": 270, "elevation_deg": 90 - incidence_deg}}
        camera = {"width": options.size_px, "height": options.size_px, "fx": 20 * options.size_px}
        request = {"camera": camera, "sun": sun, "products": ["radiance", "lit"]}

        def frame(of, height_m, **more):
            pose = {"geodetic": {**point, "height_m": height_m}, "nadir": {"up_azimuth_deg": 0}}
            return of.arrays("/v1/frames", {**request, "pose": pose, **more}, "relief")

        terrain = frame(service, ground_m + above_m, surface=surface, detail=options.detail)
        smooth = frame(sphere, above_m, surface={"preset": "moon"})
        ground = np.isfinite(terrain["lit"])
        rows.append({"incidence_deg": incidence_deg,
                     "ratio": terrain["radiance"].sum(dtype=float) / smooth["radiance"][ground].sum(dtype=float),
                     "shadowed": (terrain["lit"][ground] == 0).mean(),
                     "post_spacing_m": terrain["meta"]["post_spacing_m"]["min"]})
    return rows


# Report


def in_lime(row):
    """Returns true for bands in which LIME was fitted: only there are presets compared."""
    return 0.4399 < row["wavelength_um"] < 1.6401


def disc_table(discs, ground, model):
    """Ratios to a model: a row per preset, a column per phase angle, each with its range over the bands."""
    ratios = {}
    for row in discs:
        if row["ground"] == ground and in_lime(row):
            by_phase = ratios.setdefault(row["preset"], {})
            by_phase.setdefault(row["phase_deg"], []).append(row["reflectance"] / row[model])
    if not ratios:
        return []

    def words(values):
        low, high = np.nanmin(values), np.nanmax(values)
        return f"{low:.3f}" if high - low < 5e-4 else f"{low:.3f} to {high:.3f}"

    columns = [g for shown in TERRAIN_PHASES_DEG for g in (shown, -shown) if g in next(iter(ratios.values()))]
    head = f"| {ground}, over {model.upper()} | " + " | ".join(map(str, columns)) + " |"
    rows = [" | ".join([preset, *(words(by_phase[g]) for g in columns)]) for preset, by_phase in ratios.items()]
    return ["", head, "|---" * (len(columns) + 1) + "|", *(f"| {row} |" for row in rows)]


def page_of(discs, relief, images, spread_px):
    lines = ["Disc-equivalent reflectance over the model's, by phase angle in degrees (negative: waning); smallest and",
             "largest ratio in the bands from 0.44 to 1.64 um."]
    for ground, model in itertools.product(("sphere", "terrain"), ("lime", "rolo")):
        lines += disc_table(discs, ground, model)
    if relief:
        lines += ["", "| incidence, degrees | brightness over smooth ground | shadowed |", "|---|---|---|"]
        lines += [f"| {row['incidence_deg']} | {row['ratio']:.3f} | {row['shadowed']:.3f} |" for row in relief]
    if images:
        lines += ["", f"Point spread: {spread_px:.2f} pixels (standard deviation), the same for all. Residuals are RMS "
                  "over the region's mean.", "", "| image | channel | moved, px | correlation | scale | limb, px | " +
                  " | ".join(moon_images.REGIONS) + " |", "|---" * 10 + "|"]
        form = "| {image} | {channel} | {dx_px:.2f}, {dy_px:.2f} | {correlation:.4f} | {scale:.3f} | {limb_px:.3f} | "
        lines += [form.format(**row) +
                  " | ".join(cell(row[f"residual_{name}"], "{:.3f}") for name in moon_images.REGIONS) + " |"
                  for row in images]
    return "\n".join(lines) + "\n"


def violations(discs, images, controls):
    """A line per value outside its bound, and per control within it."""
    out = []

    def check(within, words):
        if not within:
            out.append(words)

    for row in (row for row in discs if in_lime(row) and row["lime"] == row["lime"] and row["ground"] == "sphere"):
        ratio, bound = row["reflectance"] / row["lime"], 0.01 if row["phase_deg"] >= 5 else 0.02
        words = (f"{row['preset']} on a sphere, {row['wavelength_um']:g} um, {row['phase_deg']:g} degrees: "
                 f"{ratio:.4f} of LIME")
        if row["preset"] == "moon":
            check(abs(ratio - 1) <= bound, words)
        if row["preset"] == "moon-mare":
            check(abs(ratio - 1) > bound, words + ": a wrong preset must not be within the bound")
    for g in TERRAIN_PHASES_DEG:
        sums = np.sum([(row["reflectance"], row["lime"]) for row in discs
                       if row["ground"] == "terrain" and abs(row["phase_deg"]) == g] or [(1, 1)], axis=0)
        mean = sums[0] / sums[1]
        check(abs(mean - 1) <= 0.03, f"moon on terrain, {TERRAIN_UM:g} um, {g} degrees: {mean:.4f} of LIME")
    for row, control in zip(images, controls):
        name = f"{row['image']} {row['channel']}"
        least = 0.995 if moon_images.CHANNELS[row["channel"]][0] < 1 else 0.985
        check(row["correlation"] >= least, f"{name}: correlation {row['correlation']:.4f}")
        check(control < least, f"{name}: correlation {control:.4f}, although the image was moved by a pixel")
        check(abs(row["scale"] - 1) <= 0.1, f"{name}: scale {row['scale']:.3f}")
        check(abs(row["limb_px"]) <= 0.1, f"{name}: limb off by {row['limb_px']:.3f} px")
    for channel in moon_images.CHANNELS:
        scales = [row["scale"] for row in images if row["channel"] == channel]
        if scales:
            check(max(scales) / min(scales) <= 1.02, f"{channel}: scales from {min(scales):.3f} to {max(scales):.3f}")
    return out


def write_csv(path, rows):
    if rows:
        with open(path, "w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(rows[0])
            writer.writerows([value if isinstance(value, str) else cell(value) for value in row.values()]
                             for row in rows)


def main():
    parser = argparse.ArgumentParser(description="Compare the Moon's brightness with models and images.")
    parser.add_argument("--albedo-maps", nargs="+", metavar="NAME", help="maps of radiance factors")
    parser.add_argument("--images", type=pathlib.Path, metavar="DIR", help="images, listed in its views.json")
    parser.add_argument("--center", metavar="LAT,LON", help="compare terrain there with smooth ground, not the disc")
    parser.add_argument("--width-m", type=float, default=20e3, help="width of the ground at --center")
    parser.add_argument("--detail", metavar="NAME", help="detail of the assets folder at --center")
    parser.add_argument("--size-px", type=int, default=256, help="side of frames of terrain")
    parser.add_argument("--phases-of-table", action="store_true", help="no discs but those that the tables show")
    terrain_service.add_options(parser)
    options = parser.parse_args()
    if not options.dem and (options.images or options.center or options.albedo_maps):
        raise Unusable("--images, --center and --albedo-maps need --dem: a DEM of the whole Moon")
    if options.detail and not options.center:
        raise Unusable("--detail needs --center")
    options.output.mkdir(parents=True, exist_ok=True)
    write_sphere(pathlib.Path(harness.path("sphere")))
    sphere = TerrainService(options.binary, "--dem", harness.path("sphere"), "--cache-dir", harness.path("cache"))
    discs, relief, images, controls, spread_px = [], [], [], [], 0
    if options.dem:
        service = TerrainService(options.binary, *terrain_service.terrain_options(options))
        surface = {"preset": "moon", **({"albedo_maps": options.albedo_maps} if options.albedo_maps else {})}
        if options.center:
            relief = relief_rows(service, sphere, options, surface)
        else:
            discs = discs_on_terrain(service, surface, options.size_px)
        if options.images:
            images, controls, spread_px = moon_images.compare_images(service, sphere, options, surface)
    shown_deg = [g for g in PHASES_DEG if g in TERRAIN_PHASES_DEG]
    discs = discs_on_sphere(sphere, shown_deg if options.phases_of_table else PHASES_DEG) + discs
    for name, rows in (("disc", discs), ("relief", relief), ("images", images)):
        write_csv(options.output / f"{name}.csv", rows)
    page, beyond = page_of(discs, relief, images, spread_px), violations(discs, images, controls)
    (options.output / "moon.md").write_text(page)
    facts = {"point_spread_px": spread_px, "beyond_bounds": beyond}
    (options.output / "moon.json").write_text(json.dumps(facts) + "\n")
    print(page, end="")
    for what in beyond:
        print("beyond its bound:", what)
    print(f"{options.output}: disc.csv, moon.md, moon.json; pictures: deploy/plot {options.output}")
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(terrain_service.run(main))
