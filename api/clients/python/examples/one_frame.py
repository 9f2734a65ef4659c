#!/usr/bin/env python3
"""One frame with ground truth, over the sample terrain: python3 one_frame.py [URL] [frame.npz]"""

import os
import sys

import numpy as np

sys.path.insert(1, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))  # the package, if not installed
from selenograph import Camera, Client, Pose, Sun

url = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8080"
request = {
    "camera": Camera.pinhole(width=512, height=512, fov_deg=50),
    "pose": Pose.look_at(lat_deg=-7.15, lon_deg=39.85, height_m=42000, target_lat_deg=-6.52, target_lon_deg=39.96),
    "sun": Sun.local(lat_deg=-6.5, lon_deg=40.0, azimuth_deg=80, elevation_deg=15),
    "products": ["radiance", "range", "lit"],
}
with Client(url) as client:
    frame = client.frame(request)

print(f"radiance up to {frame['radiance'].max():.1f} W m-2 sr-1")
print(f"ground {np.nanmin(frame['range']) / 1e3:.1f} to {np.nanmax(frame['range']) / 1e3:.1f} km away")
print(f"{100 * np.nanmean(frame['lit']):.0f} % of it in sunlight")
print(f"level of detail within {frame.meta['lod_error_px']:.2f} px")
print(f"visibility took {frame.timing['visibility']:.1f} ms")
if len(sys.argv) > 2:
    np.savez(sys.argv[2], **frame)
