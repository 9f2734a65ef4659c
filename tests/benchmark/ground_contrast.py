#!/usr/bin/env python3
"""How much a camera sees of a detail's ground: contrast by the size of what is seen, from several heights.

    SELENOGRAPH_BINARY=build/selenograph tests/benchmark/ground_contrast.py DEM LAT,LON [--detail landing] [--sun 20,55]

DEM is a folder of tiles. Frames look straight down, 1024 x 1024 pixels, 50 degrees wide, four samples a pixel, Sun as
wide as it is, lunar-Lambert. Printed are the RMS of the radiance in bands of wavelengths (pixels) over its mean, by a
Fourier transform under a Hann window, the ratio of the first band to the third, the standard deviation over the mean,
the share of pixels in shadow, and with --pixels the same for pixels of so many metres. With --images FOLDER each frame
is written there, scaled to twice its mean, and with --oblique a view from 1.6 m to the northern horizon, whose Sun is
a point.
"""

import argparse
import json
import math
import os
import sys
import time

import numpy as np
from PIL import Image

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness  # noqa: E402

ASSETS = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "deploy", "assets")
SIDE_PX, FOV_DEG = 1024, 50.0
NORTH_UP = {"up_azimuth_deg": 0}
BANDS_PX = ((2, 4), (4, 8), (8, 16))
SHADOW = 0.06  # of the mean radiance: pixels below it count as shadow


def contrasts(image):
    """RMS of an image's parts in the bands over its mean."""
    side = min(image.shape)
    image = image[:side, :side].astype(float)
    window = np.outer(np.hanning(side), np.hanning(side))
    mean = (image * window).sum() / window.sum()
    power = np.abs(np.fft.fft2((image - mean) * window)) ** 2
    cycles_px = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side)))
    norm = side * side * (window ** 2).sum()
    return [math.sqrt(power[(cycles_px >= 1 / longest) & (cycles_px < 1 / shortest)].sum() / norm) / mean
            for shortest, longest in BANDS_PX]


class Ground:
    def __init__(self, service, at, detail):
        self.service, self.at, self.detail = service, at, {"detail": detail} if detail != "none" else {}
        body = service.post("/v1/heights", {"points": [at], **self.detail}, "application/json")[2]
        self.height_m = json.loads(body)["points"][0]["height_m"]

    def oblique(self, sun_deg):
        """From 1.6 m, 15 degrees below the level."""
        return self.frame(1.6, sun_deg, nadir={"tilt_deg": 75, "azimuth_deg": 0}, angular_radius_deg=0)

    def frame(self, above_m, sun_deg, nadir=NORTH_UP, angular_radius_deg="sun"):
        body = {"camera": {"width": SIDE_PX, "height": SIDE_PX, "fov_deg": FOV_DEG}, "products": ["radiance"],
                "pose": {"geodetic": {**self.at, "height_m": self.height_m + above_m}, "nadir": nadir},
                "sun": {"local": {**self.at, "azimuth_deg": 270, "elevation_deg": sun_deg},
                        "angular_radius_deg": angular_radius_deg},
                "surface": {"reflectance": {"model": "lunar_lambert", "rho": 0.11}},
                "accuracy": {"samples_per_pixel": 4}, **self.detail}
        return np.squeeze(self.service.arrays(body)["radiance"])


def write(image, file):
    Image.fromarray(np.clip(image / image.mean() * 127.5, 0, 255).astype(np.uint8)).save(file)


def print_row(name, image, took_s):
    first, _, third = bands = contrasts(image)
    shadow = (image < SHADOW * image.mean()).mean()
    print(f"{name:<24} " + " ".join(f"{band:7.4f}" for band in bands) + f"  {first / third:5.2f}  "
          f"{image.std() / image.mean():6.3f}  {shadow:6.3f}  {took_s:5.1f} s", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dem", metavar="DEM")
    parser.add_argument("place", metavar="LAT,LON", help="degrees")
    parser.add_argument("--detail", default="landing", help="none: the posts alone")
    parser.add_argument("--heights", default="300,100,30,10,2", help="above the ground, m")
    parser.add_argument("--pixels", default="", help="sizes of pixels on the ground, m")
    parser.add_argument("--sun", default="20,55", help="elevations, degrees")
    parser.add_argument("--images", help="folder")
    parser.add_argument("--oblique", action="store_true", help="needs --images")
    asked = parser.parse_args()
    lat_deg, lon_deg = map(float, asked.place.split(","))
    heights = [(f"{h} m", float(h)) for h in asked.heights.split(",") if h]
    heights += [(f"pixels of {p} m", float(p) * SIDE_PX / 2 / math.tan(math.radians(FOV_DEG / 2)))
                for p in asked.pixels.split(",") if p]
    harness.set_up()
    try:
        service = harness.Service("--assets-dir", ASSETS, "--log-level", "warning",
                                  dem=os.path.abspath(asked.dem))
        ground = Ground(service, {"lat_deg": lat_deg, "lon_deg": lon_deg}, asked.detail)
        print(f"{asked.detail:<24} " + " ".join(f"{a}-{b} px".rjust(7) for a, b in BANDS_PX)
              + "  ratio  sd/mean  shadow")
        for name, above_m in heights:
            for sun_deg in map(float, asked.sun.split(",")):
                start = time.perf_counter()
                image = ground.frame(above_m, sun_deg)
                print_row(f"{name}, Sun {sun_deg:g}", image, time.perf_counter() - start)
                if asked.images:
                    write(image, f"{asked.images}/{name.split()[0]}-{sun_deg:g}.png")
        if asked.oblique:
            for sun_deg in map(float, asked.sun.split(",")):
                write(np.nan_to_num(ground.oblique(sun_deg)), f"{asked.images}/oblique-{sun_deg:g}.png")
        service.stop()
    finally:
        harness.tear_down()


if __name__ == "__main__":
    main()
