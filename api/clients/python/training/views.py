#!/usr/bin/env python3
"""A manifest of random views over one site, with labels, for `selenograph batch`.

usage: views.py URL MANIFEST.jsonl [--count 500] [--side 512] [--detail landing] [--region SOUTH NORTH WEST EAST] ..
"""

import argparse
import json
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
import selenograph  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("url", help="of a service that has the terrain and the detail")
    parser.add_argument("manifest")
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--side", type=int, default=512, help="pixels of the camera's side")
    parser.add_argument("--detail", default="landing", help="preset whose craters and rocks are labelled")
    parser.add_argument("--region", type=float, nargs=4, required=True, metavar=("SOUTH", "NORTH", "WEST", "EAST"))
    parser.add_argument("--altitude-m", type=float, nargs=2, default=(50, 500), metavar=("LEAST", "MOST"))
    parser.add_argument("--off-nadir-deg", type=float, nargs=2, default=(0, 30), metavar=("LEAST", "MOST"))
    parser.add_argument("--sun-elevation-deg", type=float, nargs=2, default=(10, 50), metavar=("LEAST", "MOST"))
    parser.add_argument("--smallest-px", type=float, default=6, help="of craters and rocks that are labelled")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    request = {"camera": selenograph.Camera.pinhole(width=args.side, height=args.side, fov_deg=50),
               "detail": args.detail, "products": ["image", "depth"], "image": {"bit_depth": 8},
               "labels": True, "craters": {"smallest_px": args.smallest_px, "min_depth_over_diameter": 0.04},
               "truth": {"distance_type": "float16"}}
    region = dict(zip(("south_deg", "north_deg", "west_deg", "east_deg"), args.region))
    views = selenograph.random_views(selenograph.Client(args.url), request, args.count, region=region, seed=args.seed,
                                     altitude_m=tuple(args.altitude_m), off_nadir_deg=tuple(args.off_nadir_deg),
                                     sun_elevation_deg=tuple(args.sun_elevation_deg))
    with open(args.manifest, "w", encoding="utf-8") as file:
        for view in views:
            file.write(json.dumps(view) + "\n")


if __name__ == "__main__":
    main()
