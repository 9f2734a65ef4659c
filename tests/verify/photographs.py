#!/usr/bin/python3
"""Compares photographs of the Moon with frames of their views, and with frames of a wrong Sun as the control.

usage: tests/verify/photographs.py --images DIR [--views VIEWS.json] --dem PATH [--assets-dir DIR] -o DIR [--fit]

Writes photographs.csv, photographs.md and panels as PNG; --fit writes views.json with fitted views instead. The
measures, their bounds and a views file: engine/verify/photographs.md. Exits with 1 if a bound is missed or the control
is within it. Needs python3-opencv and python3-scipy (deploy/install-packages verify).
"""

import argparse
import csv
import json
import pathlib
import sys

import cv2
import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

import terrain_service
from photograph_ties import PARAMETERS, Ties, fitted_view
from terrain_service import TerrainService, Unusable, cell

RADIANCE_UNIT = "W m-2 sr-1 um-1"
# The members of the last line are what --fit writes for the reader; they are not read.
VIEW_MEMBERS = {"image", "request", "free", "unit",
                "tie_points", "residual_px_rms", "residual_px_median"}
SEARCH_PX = 6
MIN_TIES = 30  # fewer may all be false
FACTOR = 4  # pixels of shadow masks along a pixel of the photograph


# Input


def read_image(path):
    """The mean of an image's bands, or an .npy of two dimensions."""
    try:
        if path.suffix == ".npy":
            image = np.load(path)
        else:
            image = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
            image = None if image is None else image.mean(2)
    except (OSError, ValueError) as why:
        raise Unusable(f"{path}: {why}")
    if image is None or image.ndim != 2:
        raise Unusable(f"{path}: must be an image, or an .npy with rows and columns")
    return image.astype(float)


class Photograph:
    """A photograph, and the request for its view."""

    def __init__(self, name, view, folder):
        def need(fulfilled, what):
            if not fulfilled:
                raise Unusable(f"view {name}: {what}")

        unknown = set(view) - VIEW_MEMBERS
        need(not unknown, f"unknown member {', '.join(sorted(unknown))}")
        need(isinstance(view.get("image"), str) and "request" in view,
             'needs "image", a file name, and "request", as for POST /v1/frames')
        need(view.get("unit") in (None, RADIANCE_UNIT), f'"unit" must be "{RADIANCE_UNIT}" or left out')
        self.name, self.free = name, view.get("free", ["position"])
        may_change = [name for name in PARAMETERS if name != "turn"]
        need(set(self.free) <= set(may_change), f'"free" must list some of {", ".join(may_change)}')
        self.image = read_image(folder / view["image"])
        need(np.isfinite(self.image).all(), "the image has pixels without a value")
        self.request = {"accuracy": {"samples_per_pixel": 16, "max_error_px": 0.25}, **view["request"],
                        "products": ["radiance", "lit", "position"]}
        self.is_radiance = "unit" in view
        need(not self.is_radiance or "width_um" in self.request.get("band", {}),
             'a photograph with a unit needs a "band" by center_um and width_um')
        camera, (height, width) = self.request.get("camera", {}), self.image.shape
        need((camera.get("width"), camera.get("height")) == (width, height),
             f"the camera has {camera.get('width')} x {camera.get('height')} pixels, the image {width} x {height}")


class Frame:
    """The frame of a photograph's view. `radiance`: in the photograph's unit, if it has one."""

    def __init__(self, service, photograph, request):
        arrays = service.arrays("/v1/frames", request, f"view {photograph.name}")
        self.meta, self.position_m = arrays["meta"], arrays["position"]
        self.radiance = arrays["radiance"].astype(float)
        if photograph.is_radiance:
            self.radiance /= request["band"]["width_um"]
        self.lit = np.nan_to_num(arrays["lit"].astype(float), nan=1)
        self.ground = np.isfinite(self.position_m[..., 0])
        steps_m = np.linalg.norm(np.diff(self.position_m, axis=1), axis=2)
        self.pixel_m = np.median(steps_m[np.isfinite(steps_m)]) if np.isfinite(steps_m).any() else np.nan
        self.post_m = self.meta["post_spacing_m"]["min"] if self.ground.any() else np.nan

    def missing_terrain(self, is_radiance):
        """Why the view cannot be compared on this terrain; None if it can."""
        if not self.pixel_m > 0 or self.meta["missing_fraction"] > 0.1:
            return f"no terrain in {100 * (1 - self.ground.mean()):.0f} % of the image"
        # The mean radiance of a strip needs no resolved relief.
        if self.post_m > 4 * self.pixel_m and not is_radiance:
            return (f"the finest posts there, {self.post_m:.0f} m, are {self.post_m / self.pixel_m:.1f} pixels wide; "
                    "at most 4 are compared")
        return None


def wrong_sun(frame):
    """The Sun turned by 10 degrees toward the horizon of the image's middle, or away from it if it would set there.

    Turning it about the vertical instead would leave the lengths of shadows."""
    points = frame.position_m[frame.ground]
    up = (points / np.linalg.norm(points, axis=1, keepdims=True)).mean(0)
    up /= np.linalg.norm(up)
    sun = frame.meta["request"]["sun"]
    direction = np.array(sun["direction"])
    axis = np.cross(up, direction)
    turn_deg = 10 if np.degrees(np.arcsin(up @ direction)) > 10 else -10
    turned = Rotation.from_rotvec(np.radians(turn_deg) * axis / np.linalg.norm(axis)).apply(direction)
    return {**sun, "direction": turned.tolist()}


def fit(service, photograph, view):
    """Writes the fitted view into `view`: first the attitude alone with a wide search, then all free parameters."""
    request, ties = photograph.request, None
    for number in range(4):
        frame = Frame(service, photograph, request)
        if why := frame.missing_terrain(photograph.is_radiance):
            print(f"{photograph.name}: not fitted: {why}")
            return
        ties = Ties(photograph.image, frame, SEARCH_PX if number else max(SEARCH_PX, min(photograph.image.shape) // 29))
        resolved = frame.meta["request"]
        w, *xyz = (resolved["pose"]["camera_from_moon"][key] for key in "wxyz")
        start = {"camera": resolved["camera"],
                 "pose": {"position_m": resolved["pose"]["position_m"],
                          "camera_from_moon_matrix": Rotation.from_quat([*xyz, w]).as_matrix().tolist()}}
        fitted = fitted_view(service, start, photograph.free if number else [], ties)
        request = {**request, **fitted}
    distances_px = ties.held_out_px(service, fitted)
    view["request"] = {**view["request"], **fitted}
    view.update(tie_points=len(distances_px), residual_px_rms=np.sqrt(np.mean(distances_px ** 2)),
                residual_px_median=np.median(distances_px))
    print(f"{photograph.name}: {len(distances_px)} ties held out, {view['residual_px_rms']:.3f} px RMS")


# Measures


def compared_pixels(frame):
    """Ground, and not within 1/64 of the image's shorter side of its borders, where scans have frames and labels."""
    border = min(frame.ground.shape) // 64
    mask = np.zeros_like(frame.ground)
    inner = np.s_[border:mask.shape[0] - border, border:mask.shape[1] - border]
    mask[inner] = frame.ground[inner]
    return mask


def toned(frame, photograph, mask):
    """The frame under the monotone curve that maps it to the photograph, whose film has an unknown response.

    Isotonic regression of the photograph's means over 60 quantiles of the frame; equal values stay in one bin."""
    values, target = frame[mask], photograph[mask]
    edges = np.unique(np.quantile(values, np.linspace(0, 1, 61)[1:-1]))
    _, bins = np.unique(np.searchsorted(edges, values), return_inverse=True)
    middles = ndimage.median(values, bins, np.arange(bins.max() + 1))
    sums, weights = (np.r_[0, np.cumsum(np.bincount(bins, w))] for w in (target, None))
    spans = np.maximum(weights[None, 1:] - weights[:-1, None], 1)
    means = (sums[None, 1:] - sums[:-1, None]) / spans  # [i, j]: over bins i to j
    return np.interp(frame, middles, [means[:k + 1, k:].min(1).max() for k in range(len(middles))])


def shadow_threshold(values):
    """The value below which a photograph is in shadow; NaN if it shows none, whatever the frame shows.

    The valley of its histogram between the peak of shadow, below half of the median, and the median (Prewitt &
    Mendelsohn 1966)."""
    bright, median = np.quantile(values, 0.999), np.median(values)
    if not median > 0:
        return np.nan
    counts = np.bincount(np.clip(values / bright * 256, 0, 255).astype(int), minlength=256).astype(float)
    counts = ndimage.gaussian_filter1d(counts, 3)
    peak = counts[:int(median / 2 / bright * 256) + 1].argmax()
    valley = peak + counts[peak:int(median / bright * 256) + 1].argmin()
    return np.nan if counts[valley] > counts[peak] / 2 else (valley + 0.5) * bright / 256


def without_small(mask, min_px):
    """The mask without its 4-connected components of fewer pixels of the photograph."""
    labels, _ = ndimage.label(mask)
    sizes = np.bincount(labels.ravel())
    return mask & (sizes >= min_px * FACTOR ** 2)[labels]


def distances_to(mask):
    """Each pixel's distance to the mask, px of the photograph."""
    return ndimage.distance_transform_edt(~mask) / FACTOR if mask.any() else np.full(mask.shape, np.inf)


def edges_of(mask):
    """The mask's pixels with a neighbour outside it; those on the image's border are no edges."""
    edges = mask & ~ndimage.binary_erosion(mask)
    edges[[0, -1], :] = edges[:, [0, -1]] = False
    return edges


def compare_shadows(photograph, frame, mask):
    """Measures of shadows of 40 pixels and more, and of fragments within 3 pixels of them, at a quarter of a pixel."""
    def enlarged(image):
        return cv2.resize(image, None, fx=FACTOR, fy=FACTOR, interpolation=cv2.INTER_LINEAR)

    out = dict.fromkeys(("share", "area", "overlap", "edges"), np.nan)
    limits = np.kron(mask, np.ones((FACTOR, FACTOR), bool))
    dark = [limits & (enlarged(photograph) < shadow_threshold(photograph[mask])), limits & (enlarged(frame.lit) < 0.5)]
    large = [without_small(some, 40) for some in dark]
    zone = distances_to(large[0] | large[1]) <= 3
    ours, theirs = both = [zone & without_small(some, 5) for some in dark]
    if not (ours.any() and theirs.any()):
        return out, None
    inner = distances_to(~limits) > 2  # an edge on the border of the compared pixels is the border's
    distances = [distances_to(edges_of(target))[inner & edges_of(edge)]
                 for edge, target in zip(large, reversed(both))]
    out.update(share=dark[0].sum() / limits.sum(), area=theirs.sum() / ours.sum(),
               overlap=(ours & theirs).sum() / (ours | theirs).sum(), edges=np.median(np.concatenate(distances)))
    return out, both


def measures_of(service, photograph, frame, request):
    """The measures of a frame by name, its image under the tone curve, and the shadow masks."""
    image, mask = photograph.image, compared_pixels(frame)
    view = {name: request[name] for name in ("camera", "pose")}
    distances_px = Ties(image, frame, SEARCH_PX).held_out_px(service, view)
    curve = toned(frame.radiance, image, mask)
    shadows, masks = compare_shadows(image, frame, mask)
    return {"ties": len(distances_px), "share": shadows["share"],
            "radiance, photograph / frame": image[mask].sum() / frame.radiance[mask].sum(),
            "ties held out, RMS, px": np.sqrt(np.mean(distances_px ** 2)) if len(distances_px) >= MIN_TIES else np.nan,
            "tone": np.corrcoef(image[mask], curve[mask])[0, 1],
            "tone, photograph blurred by 1 px": np.corrcoef(ndimage.gaussian_filter(image, 1)[mask], curve[mask])[0, 1],
            "shadow area, frame / photograph": shadows["area"], "shadow overlap (IoU)": shadows["overlap"],
            "shadow edges, median, px": shadows["edges"]}, curve, masks


# Report

BOUNDS = {"radiance, photograph / frame": (0.88, 1.12), "ties held out, RMS, px": (0, 0.2), "tone": (0.85, 1),
          "tone, photograph blurred by 1 px": (0.9, 1), "shadow area, frame / photograph": (0.9, 1.1),
          "shadow overlap (IoU)": (0.8, 1), "shadow edges, median, px": (0, 0.5)}


def applies(measure, photograph, found):
    if measure.startswith("radiance"):
        return photograph.is_radiance
    # A strip of a few lines of radiance has no room for ties, so that its view is taken as it is.
    if photograph.is_radiance and found["ties"] < MIN_TIES:
        return False
    return not measure.startswith("shadow") or found["share"] >= 0.01


def bound_words(low, high):
    return f"at least {low:g}" if high == 1 else f"at most {high:g}" if low == 0 else f"{low:g} to {high:g}"


def write_panels(folder, photograph, curve, masks):
    """Photograph, frame, difference and shadows as PNG. Values are scaled to 255 at the photograph's brightest
    thousandth; a difference of 0 is 128. Shadows: 0 in both, 85 in the photograph alone, 170 in the frame alone."""
    bright = np.quantile(photograph.image, 0.999)
    a, b = (values * (255 / bright if bright > 0 else 1) for values in (photograph.image, curve))
    panels = {"photograph": a, "frame": b, "difference": 128 + a - b}
    if masks:
        panels["shadows"] = 255.0 - 170 * masks[0] - 85 * masks[1]
    for what, values in panels.items():
        cv2.imwrite(str(folder / f"{photograph.name}.{what}.png"), np.clip(np.round(values), 0, 255).astype(np.uint8))


def compare(service, photograph, folder):
    """A row per measure, the lines of its table, and what is beyond its bound; or why it was skipped."""
    frame = Frame(service, photograph, photograph.request)
    if why := frame.missing_terrain(photograph.is_radiance):
        return [], [f"skipped: {photograph.name}: {why}"], []
    found, curve, masks = measures_of(service, photograph, frame, photograph.request)
    write_panels(folder, photograph, curve, masks)
    request = {**photograph.request, "sun": wrong_sun(frame)}
    control = measures_of(service, photograph, Frame(service, photograph, request), request)[0]
    rows, beyond = [], []
    lines = [f"{photograph.name}: pixels of {frame.pixel_m:.0f} m, posts of {frame.post_m:.0f} m, {found['ties']} ties "
             "held out", "", "| measure | bound | value | Sun turned by 10 degrees |", "|---|---|---|---|"]
    for measure, (low, high) in BOUNDS.items():
        if not applies(measure, photograph, found):
            continue
        value, wrong, words = found[measure], control[measure], bound_words(low, high)
        rows.append([photograph.name, measure, low, high, cell(value), cell(wrong)])
        missed, within = not low <= value <= high, low <= wrong <= high
        lines.append(f"| {measure} | {words} | {cell(value, '{:.4g}')}{' (missed)' if missed else ''} | "
                     f"{cell(wrong, '{:.4g}')}{' (within)' if within else ''} |")
        beyond += [f"{photograph.name}: {measure}: {value:.4g} is not {words}"] if missed else []
        beyond += [f"{photograph.name}: {measure}: {wrong:.4g} with a wrong Sun is {words}"] if within else []
    return rows, lines, beyond


def main():
    parser = argparse.ArgumentParser(description="Compare photographs with frames of the same views.")
    parser.add_argument("--images", required=True, type=pathlib.Path, metavar="DIR", help="folder of the photographs")
    parser.add_argument("--views", type=pathlib.Path, metavar="VIEWS.json", help="default: views.json of that folder")
    parser.add_argument("--fit", action="store_true", help="fit the views instead, and write them to views.json")
    terrain_service.add_options(parser)
    options = parser.parse_args()
    views_path, out = options.views or options.images / "views.json", options.output
    try:
        views = json.loads(views_path.read_text())
    except (OSError, ValueError) as why:
        raise Unusable(f"{views_path}: {why}")
    if not isinstance(views, dict) or not views:
        raise Unusable(f"{views_path}: must be a JSON object with a view per photograph")
    photographs = [Photograph(name, view, options.images) for name, view in views.items()]
    out.mkdir(parents=True, exist_ok=True)
    service = TerrainService(options.binary, *terrain_service.terrain_options(options))
    if options.fit:
        for photograph in photographs:
            fit(service, photograph, views[photograph.name])
        (out / "views.json").write_text(json.dumps(views, indent=1) + "\n")
        print(f"{out}: views.json")
        return 0
    rows, tables, beyond = zip(*(compare(service, photograph, out) for photograph in photographs))
    page = "\n".join("\n".join(["", *lines]) for lines in tables) + "\n"
    if not any(rows):
        raise Unusable("no photograph was compared: " + "; ".join(line for lines in tables for line in lines))
    with open(out / "photographs.csv", "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(
            [["photograph", "measure", "low", "high", "value", "wrong_sun"], *(row for some in rows for row in some)])
    (out / "photographs.md").write_text(page)
    print(page)
    for what in (line for lines in beyond for line in lines):
        print("beyond its bound:", what)
    print(f"{out}: photographs.csv, photographs.md, panels as PNG; pictures: deploy/plot {out}")
    return 1 if any(beyond) else 0


if __name__ == "__main__":
    sys.exit(terrain_service.run(main))
