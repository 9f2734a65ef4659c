#!/usr/bin/env python3
"""Frames per second over HTTP: one client, one connection, a camera that moves.

    SELENOGRAPH_BINARY=build/selenograph tests/benchmark/http_benchmark.py [FRAMES] [MEMBER=JSON]...

1024 x 1024 pixels of `radiance` as octet-stream from sample terrain, 30 km below, warm; each frame from 20 m further north than
the one before. Members replace those of the request, as in sun.local.elevation_deg=3. Prints the median of each stage that
Server-Timing names and what is left of the time that the client waited.
"""

import json
import os
import re
import statistics
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness  # noqa: E402


def request_of(step, changes):
    request = harness.frame_request(["radiance"], 1024, 1024)
    request["camera"]["fov_deg"] = 50.0
    request["pose"]["geodetic"] = {"lat_deg": 0.0 + 20.0 * step / 30323.0, "lon_deg": 30.0, "height_m": 30000.0}
    for name, value in changes.items():
        *folders, last = name.split(".")
        member = request
        for folder in folders:
            member = member.setdefault(folder, {})
        member[last] = value
    return json.dumps(request).encode()


def main():
    numbers = [a for a in sys.argv[1:] if "=" not in a]
    frames = int(numbers[0]) if numbers else 200
    changes = {name: json.loads(value) for name, value in (a.split("=", 1) for a in sys.argv[1:] if "=" in a)}
    harness.set_up()
    try:
        harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "2", "--columns", "2")
        service = harness.Service()
        connection = service.connect()
        headers = {"Content-Type": "application/json", "Accept": "application/octet-stream"}
        frame = bytearray(4 * 1024 * 1024)  # where a loop keeps the frame that it works on
        waits, stages = [], {}
        for step in range(-10, frames):
            body = request_of(max(step, 0), changes)
            start = time.perf_counter()
            connection.request("POST", "/v1/frames", body=body, headers=headers)
            answer = connection.getresponse()
            assert answer.status == 200, answer.read(300)
            assert 1024 * 1024 <= answer.length <= len(frame), answer.length
            view = memoryview(frame)[:answer.length]
            while view:
                view = view[answer.readinto(view):]
            wait = 1000 * (time.perf_counter() - start)
            if step < 0:
                continue  # loads the terrain
            waits.append(wait)
            for name, value in re.findall(r"(\w+);dur=([\d.]+)", answer.headers["Server-Timing"]):
                stages.setdefault(name, []).append(float(value))
        connection.close()
        service.stop()
    finally:
        harness.tear_down()
    total = statistics.median(waits)
    print(f"{len(waits)} frames, {1000 * len(waits) / sum(waits):.1f} per second; median {total:.2f} ms, "
          f"99 % within {sorted(waits)[int(0.99 * (len(waits) - 1))]:.2f} ms")
    medians = {name: statistics.median(values) for name, values in stages.items()}
    for name, value in medians.items():
        print(f"  {name:<12} {value:7.2f} ms")
    shares = [other / all_of_it for other, all_of_it in zip(stages["other"], stages["total"])]
    print(f"  other: {100 * statistics.median(shares):.1f} % of total, at most {100 * max(shares):.1f} %")
    print(f"  {'the rest':<12} {statistics.median(w - t for w, t in zip(waits, stages['total'])):7.2f} ms: HTTP and the client")


if __name__ == "__main__":
    main()
