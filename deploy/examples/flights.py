"""Plans 200 flights with a wrong map each: flights.jsonl, and the requests of their maps in maps/."""

import json
import pathlib

import numpy as np
from selenograph import Camera, Client, Pose, Sun

FLIGHTS = 200
METERED_PX = 48
site = {"lat_deg": -6.5, "lon_deg": 40.0}
look = {f"target_{name}": value for name, value in site.items()}

# A, H, V, O, R as calibrated, here in the camera's own axes. In a lander's: camera_from_lander * lander's attitude.
camera, camera_from_lander = Camera.from_cahvor([0, 0, 1], [400, 0.2, 255.5], [0, 400, 255.5], [0.005, -0.004, 0.99998],
                                                [0, -0.05, 0.01], width=512, height=512)
common = {
    "camera_preset": "navigation-camera", "camera": camera,  # the detector and optics of the preset, another projection
    "sun": Sun.local(**site, azimuth_deg=95, elevation_deg=18), "surface": {"preset": "moon"},
    "products": ["image", "range", "position"]}
onboard = {
    "map": {"projection": "orthographic", "center": site, "width_m": 12000, "height_m": 12000, "gsd_m": 30},
    "sun": Sun.local(**site, azimuth_deg=105, elevation_deg=30), "products": ["radiance", "height"]}

client = Client("http://127.0.0.1:8080")
draws = np.random.default_rng(1)
pathlib.Path("maps").mkdir(exist_ok=True)
with open("flights.jsonl", "w") as manifest:
    for flight in range(FLIGHTS):
        north_m, east_m = draws.normal(0, 10, 2)
        error = {"preset": "sldem2015", "seed": flight, "about": site, "shift": {"north_m": north_m, "east_m": east_m}}
        pathlib.Path(f"maps/{flight:03}.json").write_text(json.dumps({**onboard, "map_error": error}))
        offset_deg = draws.normal(0, 0.003, 2)  # 90 m
        for step, height_m in enumerate((8000, 4000, 2000)):
            pose = Pose.look_at(lat_deg=-6.5 - height_m / 60e3 + offset_deg[0], lon_deg=40.0 + offset_deg[1],
                                height_above_ground_m=height_m, target_height_above_ground_m=0, **look)
            pixel = client.project(camera, pose, [[site["lat_deg"], site["lon_deg"]]])[0]
            x, y = (int(np.clip(round(c) - METERED_PX // 2, 0, 512 - METERED_PX)) for c in (pixel.x_px, pixel.y_px))
            metering = {"statistic": "mean", "region": {"x": x, "y": y, "width": METERED_PX, "height": METERED_PX}}
            sensor = {"frame": 3 * flight + step,  # of the noise, which repeats with the same number
                      "detector": {"integration_time_s": None},  # takes the preset's away: exposure chooses it
                      "exposure": {"target_fill": 0.5, "longest_s": 0.01, "metering": metering}}
            line = {**common, "name": f"{flight:03}-{step}", "pose": pose, "sensor": sensor}
            print(json.dumps(line), file=manifest)
