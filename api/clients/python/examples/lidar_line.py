#!/usr/bin/env python3
"""Ranges of a lidar that looks down along a ground track: python3 lidar_line.py [URL]"""

import os
import sys

import numpy as np

sys.path.insert(1, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))  # the package, if not installed
from selenograph import MOON_RADIUS_M, Client

HEIGHT_M = 15000
SHOTS = 200

url = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8080"
lat, lon = np.radians(np.linspace(-7.0, -6.0, SHOTS)), np.radians(40.0)
up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)  # MOON_ME

with Client(url) as client:
    shots = client.rays((MOON_RADIUS_M + HEIGHT_M) * up, -up)

heights_m = HEIGHT_M - shots.range_m  # NaN where there is no terrain
for i in range(0, SHOTS, 10):
    print(f"{np.degrees(lat[i]):8.4f} deg  range {shots.range_m[i]:9.3f} m  ground at {heights_m[i]:9.3f} m")
print(f"{np.count_nonzero(shots.hit)} of {SHOTS} shots returned; "
      f"the ground varies by {np.nanmax(heights_m) - np.nanmin(heights_m):.0f} m")
