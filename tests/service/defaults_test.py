#!/usr/bin/env python3
"""What /openapi.json calls a default is what a member that is left out means: written out, it makes the same request. Every
default that the document has is tried. Python's standard library and jsonschema only.
"""

import copy
import json
import os
import unittest

import jsonschema

import harness
from harness import Service, tearDownModule

PLACE = ("--south-deg", "25", "--west-deg", "2", "--rows", "2", "--columns", "2", "--ppd", "64")  # of the document's examples

POSE = {"geodetic": {"lat_deg": 26.1, "lon_deg": 3.6, "height_m": 20000.0}, "nadir": {}}
FRAME = {"camera": {"width": 16, "height": 12, "fov_deg": 40.0}, "pose": POSE,
         "sun": {"local": {"lat_deg": 26.1, "lon_deg": 3.6, "azimuth_deg": 90.0, "elevation_deg": 30.0}}}
OBJECT = {"mesh": "satellite", "pose": {"geodetic": {"lat_deg": 26.1, "lon_deg": 3.6, "height_m": 19500.0}, "upright": {}},
          "material": {"reflectance": {}}}
SENSOR = {"optics": {"f_number": 4.0}, "motion": {},
          "detector": {"pixel_pitch_um": 5.5, "quantum_efficiency": 0.4, "integration_time_s": 0.001, "gain_e_dn": 50.0}}
LIDAR = {"divergence_mrad": 1, "pulse_length_ns": 4, "wavelength_um": 1.064, "threshold": 5, "range_gate_m": [10, 40000]}
AT_TIMES = [{"time_s": t, "pose": POSE} for t in (0.0, 1.0)]
GROUND = {"lat_deg": 26.1, "lon_deg": 3.6}
MAP = {"projection": "equirectangular", "center": {"lat_deg": 26.1, "lon_deg": 3.6}, "width_m": 2000, "height_m": 2000, "gsd_m": 200}
# Beside the document's examples: what else may be left out.
BODIES = {
    "/v1/frames": (
        dict(FRAME, shutter={"line_time_s": 0.01, "velocity_m_s": [0, 0, 1600]}),
        dict(FRAME, shutter={"line_time_s": 0.01, "angular_rate_deg_s": [0, 0, 1]}),
        dict({name: FRAME[name] for name in ("camera", "sun")}, shutter={"line_time_s": 0.01, "poses": AT_TIMES}),
        dict(FRAME, camera=dict(FRAME["camera"], distortion={})),
        dict(FRAME, camera=dict(FRAME["camera"], model="fisheye", distortion={"model": "kannala_brandt"})),
        dict(FRAME, camera=dict(FRAME["camera"], distortion={"model": "opencv"})),
        dict(FRAME, camera={"width": 16, "height": 12, "cahvor": {"A": [0, 0.1, 0.995], "H": [20, 0, 8], "V": [0, 20, 6]}}),
        dict(FRAME, accuracy={}, truth={}, surface={"reflectance": {}}, objects=[OBJECT], products=["lit", "radiance"]),
        dict(FRAME, accuracy={"budget_ms": 50}),
        dict(FRAME, detail="highlands", craters={}),
        dict(FRAME, detail="highlands", labels=True, products=["radiance"]),
        dict(FRAME, indirect={}),
        dict(FRAME, sky={"utc": "2026-11-20T00:00:00Z", "states": {}}),
        dict(FRAME, indirect={"terrain": True, "earth": {"sub_earth": {"lat_deg": 0.0, "lon_deg": 0.0}}}),
        *(dict(FRAME, surface={"reflectance": {"model": model}}) for model in (
            "lambert", "lommel_seeliger", "blinn_phong", "lunar_lambert", "hapke")),
        dict(FRAME, surface={"reflectance": {"model": "hapke", "terms": "2002"}}),
        dict(FRAME, products=["image"], image={}),
        dict(FRAME, products=["image"], band={"center_um": 0.65, "width_um": 0.2}, sensor=SENSOR),
        dict(FRAME, products=["image"], band={"center_um": 0.65, "width_um": 0.2}, sensor=dict(SENSOR, tdi={"stages": 4}),
             shutter={"line_time_s": 0.01, "velocity_m_s": [0, 0, 1600], "pushbroom": True}),
        dict(FRAME, products=["image"], band={"center_um": 0.65, "width_um": 0.2}, sensor=dict(
            SENSOR, optics={"f_number": 4.0, "stray_light": {"b0_sr": 1.0, "shoulder": 0.01, "slope": -1.5}})),
        dict(FRAME, products=["image"], band={"center_um": 0.65, "width_um": 0.2}, sensor=dict(
            SENSOR, exposure={"target_fill": 0.5, "metering": {}}, detector={**SENSOR["detector"], "full_well_e": 1e4, "integration_time_s": None})),
    ),
    "/v1/maps": (
        {"map": MAP, "sun": FRAME["sun"], "accuracy": {}},
        *({"map": MAP, "footprint": {"diameter_m": 8000, **shape}, "hazard": {"max_slope_deg": 5}, "products": ["hazard"]}
          for shape in ({}, {"shape": "legs"})),
        *({"map": MAP, "products": ["height"], "map_error": dict(error, about=GROUND)}
          for error in ({"shift": {"east_m": 5}, "tilt": {"slope_deg": 0.1}}, {"shift": {"north_m": 5}})),
    ),
    "/v1/lidar": tuple(
        dict({"instrument": dict(LIDAR, receiver=receiver, pattern=pattern), "pose": POSE}, **more)
        for receiver, pattern, more in (
            ({"signal": "photon_counting", "energy_j": 1e-3, "aperture_m": 0.1}, {"scan": "raster", "columns": 2, "rows": 2, "fov_x_deg": 1, "fov_y_deg": 1}, {"motion": {"velocity_m_s": [0, 0, 1]}}),
            ({"signal": "snr", "snr": 10, "range_m": 1000}, {"scan": "cone", "beams": 3, "half_angle_deg": 20}, {"motion": {"angular_rate_deg_s": [0, 0, 1]}}),
            ({"signal": "snr", "snr": 10, "range_m": 1000}, {"scan": "beams", "directions": [[0, 0, 1]]}, {"pulses": [{"direction": [0, 0, 1]}], "objects": [OBJECT]}),
            ({"signal": "snr", "snr": 10, "range_m": 1000}, {"scan": "flash", "columns": 2, "rows": 1, "fov_x_deg": 1}, {"surface": {"reflectance": {}}, "detail": "highlands", "craters": {}}),
        )),
    "/v1/horizons": ({"places": [GROUND], "horizon": {}},),
    "/v1/illumination": ({"places": [GROUND], "from_utc": "2026-11-20T00:00:00Z", "to_utc": "2026-11-20T03:00:00Z",
                          "horizon": {"azimuths": 8, "farthest_km": 2}},),
    "/v1/limb": ({"camera": FRAME["camera"], "pose": POSE},),
    "/v1/features": ({"detail": "highlands", "smallest_m": 200, "region": {
        "south_deg": 26.1, "north_deg": 26.11, "west_deg": 3.62, "east_deg": 3.63}},),
    "/v1/verify/roundtrip": ({"center": {"lat_deg": 26.1, "lon_deg": 3.6}, "mode": "camera", "posts": 8},),
    "/v1/verify/mertis": ({},),
}
# Defaults in words, for what depends on other members: (members beside a frame's, the member, what it is then).
IN_WORDS = (
    ({"camera": {"width": 16, "height": 12, "fx": 20.0}}, ("camera", "fy"), 20.0),
    ({"camera": {"width": 16, "height": 12, "fx": 20.0}}, ("camera", "cx"), 7.5),
    ({"camera": {"width": 16, "height": 12, "fx": 20.0}}, ("camera", "cy"), 5.5),
    ({}, ("sun", "distance_au"), 1.0),
    ({}, ("sun", "angular_radius_deg"), 0.0),
    ({"sun": {"utc": "2026-11-20T00:00:00Z"}}, ("sun", "angular_radius_deg"), "sun"),
    ({}, ("detail",), None),
)


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE)


def without_null(node):
    if isinstance(node, dict):
        return {name: without_null(value) for name, value in node.items() if value is not None}
    return [without_null(value) for value in node] if isinstance(node, list) else node


class Defaults(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.service = Service("--assets-dir", os.path.join(harness.REPOSITORY, "deploy", "assets"))
        cls.document = json.loads(cls.service.ask("GET", "/openapi.json")[2])

    @classmethod
    def tearDownClass(cls):
        cls.service.expect_clean_stop()

    def resolve(self, schema):
        """(name of the component or None, schema)"""
        name = None
        while "$ref" in schema:
            name = schema["$ref"].rsplit("/", 1)[1]
            schema = self.document["components"]["schemas"][name]
        return name, schema

    def valid(self, schema, value):
        return jsonschema.Draft202012Validator(schema, resolver=jsonschema.RefResolver("", self.document)).is_valid(value)

    def left_out(self, schema, value, path=()):
        """(component, member, where, default) of each member with a default that a value does not have."""
        name, schema = self.resolve(schema)
        for either in schema.get("oneOf", []) + schema.get("anyOf", []):
            if "required" not in either and self.valid(either, value):
                yield from self.left_out(either, value, path)
        if isinstance(value, dict):
            for member, of_it in schema.get("properties", {}).items():
                if member in value:
                    yield from self.left_out(of_it, value[member], (*path, member))
                elif "default" in of_it:
                    yield name, member, (*path, member), of_it["default"]
            if isinstance(more := schema.get("additionalProperties"), dict):
                for member, inner in value.items():
                    yield from self.left_out(more, inner, (*path, member))
        elif isinstance(value, list) and "items" in schema:
            for i, inner in enumerate(value):
                yield from self.left_out(schema["items"], inner, (*path, i))

    def small(self, body):
        body = without_null(copy.deepcopy(body))
        if "map" in body:
            body["map"]["gsd_m"] = 2000.0
        elif "camera" in body:
            body["camera"].update(width=16, height=12)
            body["camera"].pop("cx", None)
            body["camera"].pop("cy", None)
        return body

    def answer(self, path, body, tag=None):
        """(status, what tells one request from another)"""
        headers = {"Content-Type": "application/json", **({"If-None-Match": tag} if tag else {})}
        status, got, content = self.service.ask("POST", path, json.dumps(body).encode(), headers)
        return status, got.get("ETag") or content

    def same(self, path, body, where, default):
        longer = harness.changed(body, where, default)
        status, without = self.answer(path, body)
        self.assertEqual(status, 200, (body, without))
        tag = without if path in ("/v1/frames", "/v1/maps") else None
        status, written = self.answer(path, longer, tag)
        self.assertEqual((status, written), (304 if tag else 200, without), (where, default, written))

    def test_documented_defaults(self):
        tried = set()
        for path, methods in self.document["paths"].items():
            content = methods.get("post", {}).get("requestBody", {}).get("content", {}).get("application/json")
            if not content:
                continue
            examples = [example["value"] for example in content["examples"].values()]
            for body in map(self.small, (*examples, *BODIES.get(path, ()))):
                self.assertTrue(self.valid(content["schema"], body), body)
                for component, member, where, default in self.left_out(content["schema"], body):
                    if not self.valid(content["schema"], harness.changed(body, where, default)):
                        continue  # the document says that it isn't this request's
                    tried.add((component, member))
                    with self.subTest(path=path, member=where, default=default):
                        self.same(path, body, where, default)
        there = {(name, member) for name, schema in self.document["components"]["schemas"].items()
                 for member, of_it in schema.get("properties", {}).items() if "default" in of_it}
        self.assertEqual(there - tried, set(), "no request leaves these out")
        print(f"\n  {len(tried)} defaults", end=" ", flush=True)

    def test_defaults_in_words(self):
        for beside, where, default in IN_WORDS:
            with self.subTest(member=where, default=default):
                self.same("/v1/frames", {**FRAME, **beside}, where, default)


if __name__ == "__main__":
    harness.main()
