#!/usr/bin/env python3
"""A descent from 30 km to 1 km in 20 frames, with requests in flight: python3 descent.py [URL]"""

import os
import sys

import numpy as np

sys.path.insert(1, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))  # the package, if not installed
from selenograph import Camera, Client, Pose, Sun

FRAMES = 20

url = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8080"
with Client(url) as client:
    ground_m = float(client.heights(-6.5, 40.0).height_m)

    # Northward and down; the camera looks at the landing site, the local vertical is up in the image.
    share = np.linspace(0, 1, FRAMES)
    site = {"target_lat_deg": -6.5, "target_lon_deg": 40.0, "target_height_m": ground_m}
    poses = [Pose.look_at(lat_deg=-7.5 + 0.9 * s, lon_deg=40.0, height_m=ground_m + 30000 - 29000 * s, **site,
                          up="zenith") for s in share]
    common = {
        "camera": Camera.pinhole(width=256, height=256, fov_deg=40),
        "sun": Sun.local(lat_deg=-6.5, lon_deg=40.0, azimuth_deg=90, elevation_deg=20),
        "products": ["radiance", "range"],
    }
    # A list: the poses ahead are known, and the service can load their terrain early.
    frames = client.frames([{**common, "pose": pose} for pose in poses], in_flight=2, ahead=4)
    for i, frame in enumerate(frames):
        print(f"frame {i:2d}  {frame['range'][128, 128]:8.1f} m to the site  mean radiance "
              f"{frame['radiance'].mean():5.2f} W m-2 sr-1  visibility {frame.timing['visibility']:6.1f} ms")
