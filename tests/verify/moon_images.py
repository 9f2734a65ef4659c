"""Real images of the Moon's disc compared with frames: a spinning scanner's lines, point spread, limb."""

import json

import numpy as np
from scipy import ndimage, optimize
from scipy.spatial.transform import Rotation

from terrain_service import MOON_RADIUS_M, Unusable

REGIONS = ("mare", "highlands", "limb", "terminator")
FACTOR = 4  # pixels of a frame along one of a real image: an instrument spreads light before its pixels average
# Channels of MSG SEVIRI (EUMETSAT): centre and width, um, in the order of an image's array.
CHANNELS = {"VIS006": (0.635, 0.15), "VIS008": (0.81, 0.14), "NIR016": (1.64, 0.28)}
# SEVIRI reads three lines per rotation of 0.6 s. They begin in the direction of the Earth, which moves by 43.8 urad per
# rotation; the Moon moves by 5.6 urad, from the satellite's 3.07 km/s and the Moon's 1 km/s in the opposite direction.
# A pixel is 83.9 urad.
TURN_LINES, TURN_PX = 3, 0.455


def displacements_px(first, phase_px, height):
    """Each row's displacement to the right by a spinning scanner, which reads TURN_LINES lines a turn, upwards.

    `first`: the bottom row's place in its turn; `phase_px`: that turn's displacement. Lines begin at whole pixels, so
    that only the fraction of the Moon's movement, -1/2 to 1/2, displaces them."""
    turns = (height - 1 - np.arange(height) + first) // TURN_LINES
    moved_px = phase_px + TURN_PX * turns
    return moved_px - np.floor(moved_px + 0.5)


def scan_of(images):
    """The displacements after whose undoing adjacent lines are smoothest, to a fortieth of a pixel."""
    height, width = images[0].shape
    padded = np.pad(images, ((0, 0), (0, 0), (1, 1)), mode="edge")

    def roughness(moved_px):
        share = np.abs(moved_px)[:, None]
        beside = np.where(moved_px[:, None] > 0, padded[..., 2:], padded[..., :-2])
        still = (1 - share) * padded[..., 1:-1] + share * beside
        return (np.diff(still, 2, axis=1) ** 2).sum()

    phases = [(first, k / 40) for first in range(TURN_LINES) for k in range(40)]
    return min((displacements_px(first, phase_px, height) for first, phase_px in phases), key=roughness)


class ImagePair:
    """A channel of a real image, and its frame in W m-2 sr-1 um-1, whose pixels are a quarter as wide."""

    def __init__(self, name, channel, observed, moved_px, view, service, sphere, surface):
        self.name, self.channel, self.observed, self.moved_px = name, channel, observed.astype(float), moved_px
        self.center_um, self.width_um = CHANNELS[channel]
        self.sphere = sphere
        band = {"center_um": self.center_um, "width_um": self.width_um}
        self.request = {**view, "band": band, "products": ["radiance"]}
        camera = view["camera"]
        if (camera["height"], camera["width"]) != observed.shape:
            raise Unusable(f"{name}: views.json and the .npy file have different sizes")
        fine = {**camera, **{side: FACTOR * camera[side] for side in ("width", "height", "fx", "fy")},
                # Pixel centres are at whole numbers, so that the image begins at -0.5: scale positions from there.
                **{axis: (camera[axis] + 0.5) * FACTOR - 0.5 for axis in ("cx", "cy")}}
        radiance = service.arrays("/v1/frames", {**self.request, "camera": fine, "surface": surface}, name)["radiance"]
        self.fine = radiance.astype(float) / self.width_um
        self.on_disc = np.isfinite(self.smooth(0, 0)["angles"][..., 0])

    def smooth(self, dx_px, dy_px):
        """The smooth Moon's frame of the view, moved in the image."""
        camera = self.request["camera"]
        moved = {**camera, "cx": camera["cx"] + dx_px, "cy": camera["cy"] + dy_px}
        return self.sphere.arrays("/v1/frames", {**self.request, "camera": moved, "surface": {"preset": "moon"},
                                                 "products": ["radiance", "angles"]}, self.name)

    def spread(self, sigma_px):
        """Blurs the frame by the point spread and by a pixel of the image; placed() samples it."""
        blurred = ndimage.gaussian_filter(self.fine, sigma_px * FACTOR, mode="constant", truncate=5)
        self.coefficients = ndimage.spline_filter(ndimage.uniform_filter(blurred, FACTOR, mode="constant"))

    def placed(self, dx_px=0, dy_px=0):
        """The frame in the image's pixels, displaced and with its lines moved as the scanner's."""
        rows, columns = np.indices(self.observed.shape).astype(float)
        # A pixel's mean is at the filter's index after its middle.
        at = [FACTOR * (rows - dy_px) + FACTOR / 2, FACTOR * (columns - dx_px - self.moved_px[:, None]) + FACTOR / 2]
        return ndimage.map_coordinates(self.coefficients, at, prefilter=False)

    def correlation(self, frame):
        return np.corrcoef(self.observed[self.on_disc], frame[self.on_disc])[0, 1]

    def registered(self):
        """The displacement that correlates best, to a twentieth of a pixel and within half of one.

        The disc's position in a real image is known only from the image itself."""
        here, best = (0.0, 0.0), self.correlation(self.placed())
        for step_px in (0.2, 0.1, 0.05):
            improved = True
            while improved:
                tried = [(here[0] + dx, here[1] + dy)
                         for dx, dy in ((step_px, 0), (-step_px, 0), (0, step_px), (0, -step_px))]
                found = [(self.correlation(self.placed(*place)), place)
                         for place in tried if np.abs(place).max() <= 0.5]
                improved = max(found)[0] > best
                best, here = max(found) if improved else (best, here)
        return here

    def compare(self):
        """A row of images.csv, the frame, and the control's correlation: the image moved by a pixel."""
        dx_px, dy_px = self.registered()
        frame, smooth = self.placed(dx_px, dy_px), self.smooth(dx_px, dy_px)
        disc = np.isfinite(smooth["angles"][..., 0])
        incidence_deg, emission_deg, _ = np.moveaxis(smooth["angles"], 2, 0)
        dark = frame < 0.85 * smooth["radiance"] / self.width_um  # than the mean Moon
        region = np.select([incidence_deg > 70, emission_deg > 60, dark], [3, 2, 0], 1)
        scale = self.observed[disc].sum() / frame[disc].sum()
        left = self.observed - scale * frame
        row = {"image": self.name, "channel": self.channel,
               "correlation": np.corrcoef(self.observed[disc], frame[disc])[0, 1], "scale": scale,
               "limb_px": limb_px(self.observed, frame, smooth["meta"]["request"]), "dx_px": dx_px, "dy_px": dy_px}
        for number, name in enumerate(REGIONS):
            pixels = disc & (region == number)
            row[f"residual_{name}"] = np.sqrt(np.mean(left[pixels] ** 2)) / (scale * frame[pixels].mean())
        return row, frame, np.corrcoef(np.roll(self.observed, 1, axis=1)[disc], frame[disc])[0, 1]


def limb_px(observed, frame, request):
    """Mean distance of the observed lit limb outside the frame's, within 60 degrees of the Sun's side."""
    camera, position_m = request["camera"], np.array(request["pose"]["position_m"])
    w, *xyz = (request["pose"]["camera_from_moon"][key] for key in "wxyz")
    turn = Rotation.from_quat([*xyz, w])
    middle, sun = turn.apply(-position_m), turn.apply(request["sun"]["direction"])
    centre = np.array([camera["cx"] + camera["fx"] * middle[0] / middle[2],
                       camera["cy"] + camera["fy"] * middle[1] / middle[2]])
    radius_px = camera["fx"] * MOON_RADIUS_M / np.linalg.norm(position_m)
    angles = np.arctan2(sun[1], sun[0]) + np.radians(np.arange(-60, 61))

    def edges_px(image):
        """By angle, where the light falls to half of the maximum just inside the limb; NaN where there is none."""
        def light(radii_px):
            at = centre[:, None, None] + radii_px * np.array([np.cos(angles), np.sin(angles)])[..., None]
            return ndimage.map_coordinates(image, at[::-1], order=1, mode="nearest")

        inside = light(np.arange(0.9 * radius_px, 0.95 * radius_px, 0.05)).max(1)
        radii_px = np.arange(1.06 * radius_px, 0.95 * radius_px, -0.05)
        lit = light(radii_px) > inside[:, None] / 2
        return np.where(lit.any(1) & (inside > 0), radii_px[lit.argmax(1)], np.nan)

    return np.nanmean(edges_px(observed) - edges_px(frame))


def compare_images(service, sphere, options, surface):
    """Rows of images.csv, the controls' correlations, the point spread fitted to all; writes images and frames."""
    try:
        views = json.loads((options.images / "views.json").read_text())
        arrays = {name: np.load(options.images / f"{name}.npy") for name in views}
    except (OSError, ValueError) as why:
        raise Unusable(str(why))
    if not views:
        raise Unusable(f"{options.images / 'views.json'}: names no image")
    pairs = []
    for name, view in views.items():
        moved_px = scan_of(arrays[name])
        pairs += [ImagePair(name, channel, image, moved_px, view, service, sphere, surface)
                  for channel, image in zip(CHANNELS, arrays[name])]

    def loss(sigma_px):
        for pair in pairs:
            pair.spread(sigma_px)
        return -np.mean([pair.correlation(pair.placed()) for pair in pairs])

    found = optimize.minimize_scalar(loss, bounds=(0.3, 1.2), method="bounded", options={"xatol": 0.02})
    spread_px = round(20 * found.x) / 20
    rows, controls = [], []
    for pair in pairs:
        pair.spread(spread_px)
        row, frame, control = pair.compare()
        rows.append(row)
        controls.append(control)
        for what, image in (("observed", pair.observed), ("frame", frame)):
            np.save(options.output / f"{pair.name}.{pair.channel}.{what}.npy", image.astype(np.float32))
    return rows, controls, spread_px
