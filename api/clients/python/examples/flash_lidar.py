#!/usr/bin/env python3
"""A flash lidar over ground with detail, as a picture: python3 flash_lidar.py [URL [OUT.png [LAT LON]]]

Left the measured heights of the ground, middle the intensities, right what is false: white for misses, red for false
alarms, blue for beams on rocks.
"""

import os
import struct
import sys
import zlib

import numpy as np

sys.path.insert(1, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))  # the package, if not installed
from selenograph import MOON_RADIUS_M, Client

ABOVE_M = 100
LAT_DEG, LON_DEG = (float(sys.argv[3]), float(sys.argv[4])) if len(sys.argv) > 4 else (-6.5, 40.0)


def png(pixels):
    """Rows of red, green and blue as a file's bytes."""
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    head = struct.pack(">IIBBBBB", pixels.shape[1], pixels.shape[0], 8, 2, 0, 0, 0)
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")


def grey(values):
    low, high = np.nanpercentile(values, [1, 99])
    level = np.nan_to_num(np.clip((values - low) / (high - low), 0, 1))
    return np.repeat((255 * level).astype(np.uint8)[..., None], 3, axis=2)


url = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8080"
with Client(url) as client:
    ground_m = float(client.heights(LAT_DEG, LON_DEG, detail="landing").height_m)
    pose = {"geodetic": {"lat_deg": LAT_DEG, "lon_deg": LON_DEG, "height_m": ground_m + ABOVE_M}, "nadir": {}}
    scan = client.lidar({"instrument_preset": "flash", "detail": "landing", "pose": pose, "seed": 1})

found = (scan["count"] > 0) & ~scan["false_alarm"]
error_m = (scan["range_m"] - scan["true_range_m"])[found]
heights_m = np.where(found, np.linalg.norm(scan.points_m(), axis=-1) - MOON_RADIUS_M, np.nan)
print(f"{found.mean():.4f} of {found.size} beams measured, {scan['false_alarm'].sum()} false alarms, "
      f"{np.count_nonzero(scan['rock'])} on {len(np.unique(scan['rock'])) - 1} rocks; "
      f"noise {error_m.std():.3f} m, heights from {np.nanmin(heights_m):.2f} to {np.nanmax(heights_m):.2f} m")
if len(sys.argv) > 2:
    truth = np.zeros((*scan.shape, 3), np.uint8)
    truth[scan["rock"] != 0] = (80, 120, 255)
    truth[scan["count"] == 0] = 255
    truth[scan["false_alarm"]] = (255, 60, 40)
    with open(sys.argv[2], "wb") as file:
        file.write(png(np.hstack([grey(heights_m), grey(np.where(found, scan["intensity"], np.nan)), truth])))
