#!/usr/bin/env python3
"""One frame from SPICE kernels: from_spice.py META_KERNEL SPACECRAFT CAMERA_FRAME UTC [URL] [frame.png]

Needs spiceypy. geometry.md beside this folder lists the kernels. CAMERA_FRAME has +x right, +y down and the boresight +z.
"""

import os
import sys

import numpy as np
import spiceypy

sys.path.insert(1, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))  # the package, if not installed
from selenograph import Camera, Client, Pose, Sun

AU_KM = 149597870.7

if len(sys.argv) < 5:
    sys.exit(__doc__)
kernel, spacecraft, camera_frame, utc = sys.argv[1:5]
url = sys.argv[5] if len(sys.argv) > 5 else "http://127.0.0.1:8080"

spiceypy.furnsh(kernel)
et = spiceypy.str2et(utc)
position_km, _ = spiceypy.spkpos(spacecraft, et, "MOON_ME", "NONE", "MOON")
sun_km, _ = spiceypy.spkpos("SUN", et, "MOON_ME", "LT+S", "MOON")
request = {
    "camera": Camera.pinhole(width=512, height=512, fov_deg=50),
    "pose": Pose.from_matrix(spiceypy.pxform("MOON_ME", camera_frame, et), direction="camera_from_moon",
                             position_m=1000 * np.asarray(position_km)),
    "sun": Sun.direction(sun_km, distance_au=float(np.linalg.norm(sun_km)) / AU_KM),
    "products": ["image"],
}
with Client(url) as client:
    frame = client.frame(request)
    print(f"boresight at {frame.meta['view']['lat_deg']:.4f}, {frame.meta['view']['lon_deg']:.4f} degrees")
    print(f"the Sun is {frame.meta['view']['sun']['elevation_deg']:.2f} degrees high there")
    if len(sys.argv) > 6:
        with open(sys.argv[6], "wb") as file:
            file.write(client.encoded(request, "image/png").content)
