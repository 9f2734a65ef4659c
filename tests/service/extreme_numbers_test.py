#!/usr/bin/env python3
"""Every numeric member at the ends of its range, as the API document has it: an answer or a named refusal, never a fault.

By default one in four numbers of a document; all in slow.extreme_numbers.
"""

import copy
import itertools
import json
import math
import os
import random
import time
import unittest

import harness
from harness import changed, frame_request, tearDownModule

FINE = {200, 422, 504}
DEADLINE_S = 3
LATE_S = 30  # of an answer on a busy machine; what depends on a denormal number never ends
SEVERAL = int(os.environ.get("EXTREME_SEVERAL", "1"))  # requests of each document with three numbers changed at once
DENORMAL, NORMAL, LARGEST = 5e-324, 2.3e-308, 1.7976931348623157e308
PLACE = {"lat_deg": 0.1, "lon_deg": 30.1}
HIGH = {**PLACE, "height_m": 20000.0}
SUN_M = [-8.02519e10, -1.141109e11, -4.94833e10]  # from the Moon at the epoch of the sky below
NADIR = {"geodetic": HIGH, "nadir": {"up_azimuth_deg": 10.0}}
SENSOR = {
    "optics": {"f_number": 4.0, "point_spread": {"model": "airy"}, "vignetting": {"model": "table", "table": [[5.0, 0.9], [20.0, 0.5]]}},
    "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.004, "full_well_e": 1e5,
                 "dark_current_e_s": 10.0, "smear_time_s": 1e-6, "read_noise_e": 5.0, "prnu": 0.01, "dsnu_e": 2.0,
                 "dead_fraction": 0.001, "hot_fraction": 0.001, "hot_current_e_s": 100.0, "gain_e_dn": 2.0, "offset_dn": 60.0,
                 "bit_depth": 12},
    "motion": {"angular_rate_deg_s": [0.1, 0.2, 0.3], "velocity_m_s": [1.0, 2.0, 3.0], "samples": 2},
    "seed": 3, "frame": 4,
}


def small(products=("radiance",), **changes):
    return frame_request(products, 12, 8, **changes)


def frames():
    pinhole = {"model": "pinhole", "width": 12, "height": 8, "fx": 20.0, "fy": 21.0, "cx": 5.5, "cy": 3.5}
    yield small(("image", "radiance"), band={"center_um": 0.65, "width_um": 0.3}, sensor=SENSOR)
    spread = copy.deepcopy(SENSOR)
    spread["optics"]["point_spread"] = {"model": "gaussian", "sigma_px": 0.7}
    yield small(("image",), band={"response": [[0.4, 0.1], [0.7, 0.9]]}, sensor=spread)
    spread["optics"]["point_spread"] = {"model": "kernel", "kernel": [[0.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 0.0]]}
    yield small(("image",), band={"center_um": 8.0, "width_um": 1.0}, sensor=spread, surface={"temperature_k": 250.0})
    yield small(("image", "angles", "geodetic"), image={"bit_depth": 16, "full_scale_radiance": 55.5}, sun={
        "direction": [0.1, 1.0, 0.2], "distance_au": 1.0, "angular_radius_deg": 0.27})
    yield small(camera={**pinhole, "distortion": {"model": "brown_conrady", "k1": -0.1, "k2": 0.01, "k3": 0.001, "p1": 1e-3, "p2": 1e-3}})
    yield small(camera={**pinhole, "distortion": {
        "model": "opencv", "k1": 0.4, "k4": 0.5, "k5": 0.01, "k6": 0.001, "s1": 1e-3, "s2": 1e-3, "s3": 1e-3, "s4": 1e-3,
        "tau_x_deg": 2.0, "tau_y_deg": -1.0}})
    yield small(camera={"width": 12, "height": 8, "cahvor": {
        "A": [0.0, 0.1, 0.995], "H": [15.0, 0.1, 5.5], "V": [0.1, 15.0, 3.5], "O": [0.1, 0.0, 0.995], "R": [0.01, 0.02, 0.003],
        "linearity": 0.5}})
    yield small(camera={"model": "fisheye", "width": 12, "height": 8, "fov_deg": 150.0}, sun={"subsolar": {"lat_deg": 1.0, "lon_deg": 40.0}})
    yield small(pose={"position_m": [1e6, 1.2e6, 9e5], "look_at": {**PLACE, "height_m": 0.0, "up": [0.0, 0.1, 1.0]}})
    yield small(pose={"geodetic": HIGH, "camera_from_moon": {"w": 0.5, "x": 0.5, "y": -0.5, "z": 0.5}})
    yield small(accuracy={"max_error_px": 1.0, "max_shadow_error_px": 8.0, "samples_per_pixel": 4})
    yield small(accuracy={"budget_ms": 20.0})
    for reflectance in ({"model": "lunar", "lommel_seeliger_weight": 0.7, "rho": 0.12}, {"model": "blinn_phong", "shininess": 20.0},
                        {"model": "lunar_lambert", "limb_darkening": 0.4},
                        {"model": "hapke", "w": 0.3, "b0": 1.0, "h": 0.1, "b": 0.2, "c": 0.1, "theta_bar_deg": 20.0}):
        yield small(surface={"reflectance": reflectance})
    yield small(shutter={"line_time_s": 0.001, "velocity_m_s": [0.0, 1600.0, 1.0], "angular_rate_deg_s": [0.1, 0.2, 30.0]})
    strip = small(("radiance", "position"), shutter={"line_time_s": 0.001, "pushbroom": True, "poses": [
        {"time_s": -1.0, "pose": NADIR}, {"time_s": 1.0, "pose": {"geodetic": {**HIGH, "lon_deg": 30.2}, "nadir": {}}}]})
    del strip["pose"]
    yield strip
    exposed = copy.deepcopy(SENSOR)
    exposed["exposure"] = {"target_fill": 0.5, "metering": {"region": {"x": 0, "y": 0, "width": 8, "height": 8}, "percentile": 99}}
    del exposed["detector"]["integration_time_s"]
    yield small(("image", "radiance"), band={"center_um": 0.65, "width_um": 0.3}, sensor=exposed)
    yield small(("image",), band={"center_um": 0.65, "width_um": 0.3}, sensor={
        "optics": {"f_number": 4.0}, "tdi": {"stages": 4, "samples": 3},
        "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.004, "gain_e_dn": 2.0}},
                shutter={"line_time_s": 0.001, "velocity_m_s": [0.0, 1600.0, 1.0], "pushbroom": True})
    yield small(("radiance", "position"), truth={"region": {"x": 2, "y": 1, "width": 6, "height": 5}, "every_px": 2})
    yield small(("radiance", "detail"), detail="landing", accuracy={"max_detail_error_px": 8.0},
                pose={"geodetic": {**PLACE, "height_m": 9000.0}, "nadir": {"up_azimuth_deg": 0.0}})
    yield small(("radiance", "flow"), flow_to={**NADIR, "geodetic": {**HIGH, "lat_deg": 0.2}})
    yield small(sky={"utc": "2026-11-20T00:00:00Z", "stars": "bright", "magnitude_limit": 3.0, "sun": True, "earth": True,
                     "planets": True, "velocity_m_s": [0.0, 100.0, 0.0], "states": {"sun": {
                         "position_m": SUN_M, "velocity_m_s": [25000.0, 14000.0, 6000.0]}}})
    thing = {"mesh": "satellite", "scale": 2.0, "material": {"temperature_k": 200.0},
             "pose": {"geodetic": {**PLACE, "height_m": 19900.0}, "upright": {"azimuth_deg": 30.0}}}
    yield small(objects=[thing])
    yield small(objects=[{**thing, "pose": {"position_m": [1.5e6, 8.8e5, 3e3], "object_from_moon": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}}}],
                terrain=False)


REGION = {"south_deg": 0.0, "north_deg": 0.01, "west_deg": 30.0, "east_deg": 30.01}
CENTER = {"center": PLACE, "width_m": 2000.0, "height_m": 1500.0, "gsd_m": 100.0}
LIT = {"sun": {"direction": [0.1, 1.0, 0.2], "angular_radius_deg": 0.27}, "products": ["lit", "height"]}
OTHERS = [
    ("/v1/features", {"detail": "highlands", "region": REGION, "smallest_m": 10.0}),
    ("/v1/features", {"detail": "landing", "kind": "rocks", "region": REGION, "smallest_m": 2.0}),
    ("/v1/maps", {"map": {"projection": "equirectangular", "bounds": REGION, "gsd_m": 20.0, "standard_parallel_deg": 10.0}, **LIT}),
    ("/v1/maps", {"map": {"projection": "orthographic", **CENTER}, **LIT}),
    ("/v1/maps", {"map": {"projection": "polar_stereographic", **CENTER}, "view": {"direction": [1.0, 0.5, 0.0]}, **LIT,
                  "products": ["radiance"]}),
    ("/v1/maps", {"map": {"projection": "orthographic", **CENTER}, "detail": "landing", "rocks": True, "products": ["hazard", "slope"],
                  "footprint": {"shape": "legs", "diameter_m": 500.0, "legs": 3, "azimuth_deg": 10.0},
                  "hazard": {"max_slope_deg": 5.0, "max_roughness_m": 20.0, "max_rock_height_m": 1.0, "max_rock_cover": 0.1}}),
    ("/v1/maps", {"map": {"projection": "orthographic", **CENTER}, "detail": "highlands", "products": ["height"], "map_error": {
        "seed": 3, "missing_craters_below_m": 30.0, "resolution_m": 60.0, "about": {**PLACE, "height_m": 100.0},
        "shift": {"north_m": 30.0, "east_m": -20.0}, "scale": 1.01, "tilt": {"slope_deg": 0.05, "azimuth_deg": 40.0},
        "height": [{"standard_deviation_m": 3.0, "correlation_length_m": 500.0}],
        "albedo": [{"standard_deviation": 0.05, "correlation_length_m": 500.0}]}}),
    ("/v1/rays", {"rays": [{"origin_m": [1.6e6, 9e5, 3e3], "direction": [-1.0, -0.5, 0.0]}], "sun": {"direction": [1.0, 0.0, 0.0]}}),
    ("/v1/project", {"camera": small()["camera"], "pose": NADIR, "points": [{**PLACE, "height_m": 100.0}]}),
    ("/v1/sky", {"camera": small()["camera"], "pose": NADIR, "et_s": 8e8, "sky": {"stars": True, "sun": True, "earth": True}}),
    ("/v1/limb", {"camera": small()["camera"], "pose": NADIR, "points": 5}),
    ("/v1/horizons", {"places": [PLACE], "horizon": {"azimuths": 8, "height_above_ground_m": 1.0, "farthest_km": 5.0}}),
    ("/v1/illumination", {"places": [PLACE], "from_utc": "2026-11-20T00:00:00Z", "to_utc": "2026-11-20T03:00:00Z", "step_s": 3600.0,
                          "horizon": {"azimuths": 8, "farthest_km": 5.0}}),
    ("/v1/heights", {"points": [PLACE]}),
    ("/v1/verify/mertis", {"first_um": 7.0, "last_um": 14.0, "channels": 20, "pixel_pitch_um": 35.0, "f_number": 2.0,
                           "efficiency": [[7.0, 0.3], [14.0, 0.4]], "noise_equivalent_power_w": 1e-12, "temperatures_k": [350.0]}),
    ("/v1/verify/roundtrip", {"center": PLACE, "height_m": 2000.0, "mode": "camera", "posts": 8, "footprint_ratio": 1.0, "max_error_px": 1.0}),
]


def at_pole(document):
    """The same over the north pole."""
    if isinstance(document, list):
        return [at_pole(item) for item in document]
    if not isinstance(document, dict):
        return document
    document = {name: at_pole(member) for name, member in document.items()}
    if "lat_deg" in document:
        document["lat_deg"] = 90.0
    if "north_deg" in document:
        document |= {"south_deg": 89.998, "north_deg": 90.0, "west_deg": -180.0, "east_deg": 180.0}
    return document


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "89", "--west-deg", "-180", "--rows", "1", "--columns", "360", "--ppd", "16")
    ExtremeNumbersTest.service = harness.service_with_assets()


def fits(schema, value):
    kind = {dict: "object", list: "array", str: "string", bool: "boolean"}.get(type(value), "number")
    return schema.get("type", kind) in ((kind, "integer") if kind == "number" else (kind,))


class Document:
    def __init__(self, openapi):
        self.openapi = openapi

    def resolved(self, schema, value):
        """The alternative of a schema that a value is of."""
        while True:
            if "$ref" in schema:
                schema = self.openapi["components"]["schemas"][schema["$ref"].rsplit("/", 1)[1]]
            elif "type" not in schema and "properties" not in schema and ("anyOf" in schema or "oneOf" in schema):
                schema = next(s for s in schema.get("anyOf") or schema["oneOf"] if fits(self.resolved(s, value), value))
            else:
                return schema

    def numbers(self, schema, value, path=()):
        """(path, schema) of every number in a value."""
        schema = self.resolved(schema, value)
        if isinstance(value, dict):
            for name, member in value.items():
                yield from self.numbers(schema["properties"][name], member, path + (name,))
        elif isinstance(value, list):
            for i, item in enumerate(value):
                yield from self.numbers(schema["prefixItems"][i] if "prefixItems" in schema else schema["items"], item, path + (i,))
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            yield path, schema


def ends(schema):
    """The smallest and the largest value that a schema allows; next to the ends where these are excluded."""
    low, high = schema.get("minimum", schema.get("exclusiveMinimum", -LARGEST)), schema.get("maximum", schema.get("exclusiveMaximum", LARGEST))
    if schema["type"] == "integer":
        return [int(low), int(high)] if "enum" not in schema else schema["enum"]
    if "exclusiveMinimum" in schema:
        low = math.nextafter(low, math.inf)
    if "exclusiveMaximum" in schema:
        high = math.nextafter(high, -math.inf)
    return [low, high] + ([DENORMAL, NORMAL] if low <= 0 < high else [])


class ExtremeNumbersTest(unittest.TestCase):
    def ask(self, path, document, accept, tried):
        """An answer in time, or a refusal that names a member."""
        started = time.monotonic()
        status, _, body = self.service.post(path, document, accept, Request_Timeout_Ms=str(1000 * DEADLINE_S))
        with self.subTest(path=path, tried=tried):
            self.assertIn(status, FINE, body[:500])
            self.assertLess(time.monotonic() - started, DEADLINE_S + LATE_S)
            if status == 422:
                self.assertTrue(json.loads(body)["errors"], body)

    def attack(self, path, document, accept):
        numbers = self.numbers(path, document)
        self.assertEqual(self.service.post(path, document, accept)[0], 200, document)
        draw = random.Random(json.dumps(document))
        for where, values in numbers if harness.full_effort() else numbers[draw.randrange(4)::4]:
            for value in values if harness.full_effort() else [draw.choice(values)]:
                self.ask(path, changed(document, where, value), accept, {"/".join(map(str, where)): value})
        self.change_several(path, document, accept, numbers)

    def numbers(self, path, document):
        openapi = Document(json.loads(self.service.ask("GET", "/openapi.json")[2]))
        schema = openapi.openapi["paths"][path]["post"]["requestBody"]["content"]["application/json"]["schema"]
        numbers = [(where, ends(of)) for where, of in openapi.numbers(schema, document)]
        self.assertGreater(len(numbers), 1)
        return numbers

    def change_several(self, path, document, accept, numbers):
        draw = random.Random(json.dumps(document))
        for _ in range(SEVERAL):
            several = document
            chosen = [(where, draw.choice(values)) for where, values in draw.sample(numbers, min(3, len(numbers)))]
            for where, value in chosen:
                several = changed(several, where, value)
            self.ask(path, several, accept, {"/".join(map(str, where)): value for where, value in chosen})

    def test_frames(self):
        for document in frames():
            self.attack("/v1/frames", document, "application/x-npz")

    def test_other_calls(self):
        for path, document in OTHERS:
            self.attack(path, document, "*/*")

    def test_at_a_pole(self):
        for path, document in [("/v1/frames", frame) for frame in frames()] + OTHERS:
            document = at_pole(document)
            self.ask(path, document, "*/*" if path != "/v1/frames" else "application/x-npz", "as it is")
            self.change_several(path, document, "application/x-npz" if path == "/v1/frames" else "*/*", self.numbers(path, document))

    def test_a_denormal_diameter_over_all_of_the_moon(self):
        whole = {"south_deg": -90.0, "north_deg": 90.0, "west_deg": -180.0, "east_deg": 180.0}
        for kind, smallest_m in itertools.product(("craters", "rocks"), (DENORMAL, NORMAL, 0.0, 0.01, LARGEST)):
            self.ask("/v1/features", {"detail": "landing", "kind": kind, "region": whole, "smallest_m": smallest_m}, "*/*", smallest_m)


if __name__ == "__main__":
    harness.main()
