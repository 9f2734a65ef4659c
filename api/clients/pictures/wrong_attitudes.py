#!/usr/bin/env python3
"""Renders the four frames of conventions.md: one attitude as it is meant, and three times mistaken.

Over sample terrain to the horizon:

    selenograph sample DIR --south-deg -15 --west-deg 31 --rows 18 --columns 18 --ppd 128
    selenograph serve --dem DIR
    python3 wrong_attitudes.py [URL]     # writes right.png, conjugate.png, xyzw.png, opengl.png beside itself
"""

import os
import sys

FOLDER = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(1, os.path.join(FOLDER, "..", "python"))
from selenograph import Camera, Client, Pose, Sun

PLACE = {"lat_deg": -6.5, "lon_deg": 40.0, "height_m": 20000}

url = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8080"
request = {
    "camera": Camera.pinhole(width=240, height=240, fov_deg=70),
    "pose": Pose.look_at(**PLACE, target_lat_deg=-4.1, target_lon_deg=40.65, up="zenith"),
    "sun": Sun.local(lat_deg=-6.5, lon_deg=40, azimuth_deg=80, elevation_deg=20),
    "image": {"full_scale_radiance": 25},
    "accuracy": {"samples_per_pixel": 4},
    "products": ["image"],
}
with Client(url) as client:
    q = client.frame(request).meta["request"]["pose"]["camera_from_moon"]
    w, x, y, z = (q[c] for c in "wxyz")
    meant = {"order": "wxyz", "direction": "camera_from_moon", **PLACE}
    mistaken = {
        "right": Pose.from_quaternion([w, x, y, z], **meant),
        "conjugate": Pose.from_quaternion([w, -x, -y, -z], **meant),
        "xyzw": Pose.from_quaternion([x, y, z, w], **meant),
        "opengl": Pose.from_quaternion([w, x, y, z], axes="opengl", **meant),
    }
    for name, pose in mistaken.items():
        with open(os.path.join(FOLDER, f"{name}.png"), "wb") as file:
            file.write(client.encoded({**request, "pose": pose}, "image/png").content)
