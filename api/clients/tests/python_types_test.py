#!/usr/bin/env python3
"""Holds the Python client's requests to the service's own document: /openapi.json.

Each typed member of a request, each keyword of a method and each part that a constructor makes exists in the document, with
a type that the document allows. The document may have more. And every function of the client has all hints. Needs NumPy and
jsonschema.
"""

import ast
import datetime
import inspect
import json
import os
import sys
import typing
import unittest

import jsonschema
import numpy as np

import harness
from harness import REPOSITORY, Service, tearDownModule

sys.path.insert(0, os.path.join(REPOSITORY, "api", "clients", "python"))
import selenograph  # noqa: E402
from selenograph import Camera, Client, Pose, Sun, request_types  # noqa: E402

DOCUMENT = {}
MAPPINGS = (dict, typing.get_origin(typing.Mapping[str, int]))
SEQUENCES = (list, tuple, typing.get_origin(typing.Sequence[int]))
TYPES = {str: ("string",), bool: ("boolean",), int: ("integer", "number"), float: ("number",), datetime.datetime: ("string",),
         np.ndarray: ("array",), type(None): ("null",)}

# The class of each request that is passed as a whole.
REQUEST_CLASSES = {
    "/v1/frames": request_types.FrameRequest,
    "/v1/maps": request_types.MapRequest,
    "/v1/lidar": request_types.LidarRequest,
    "/v1/sky": request_types.SkyRequest,
    "/v1/horizons": request_types.HorizonsRequest,
    "/v1/illumination": request_types.IlluminationRequest,
}
# The path of each method whose keywords are members, and the keywords with another name or place there: in the elements of a
# list, or among the members of a part (light).
METHODS = {
    "rays": ("/v1/rays", {"origins_m": "rays/origin_m", "directions": "rays/direction", "light": ""}),
    "project": ("/v1/project", {"light": ""}),
    "lidar": ("/v1/lidar", {"request": "", "directions": "pulses/direction", "times_s": "pulses/time_s"}),
    "heights": ("/v1/heights", {"lat_deg": "points/lat_deg", "lon_deg": "points/lon_deg"}),
    "features": ("/v1/features", {}),
    "limb": ("/v1/limb", {}),
    "terminator": ("/v1/limb", {}),
}
WHOLE_REQUESTS = {"frame", "frames", "encoded", "map", "sky", "horizons", "illumination"}
WITHOUT_REQUEST = {"close", "datasets"}
ANY_REQUEST = {"document"}
# The member of a part that each keyword of its constructors becomes, where it has another name or place there.
POSE_MEMBERS = {"lat_deg": "geodetic/lat_deg", "lon_deg": "geodetic/lon_deg", "height_m": "geodetic/height_m",
                "height_above_ground_m": "geodetic/height_above_ground_m", "up_azimuth_deg": "nadir/up_azimuth_deg",
                "tilt_deg": "nadir/tilt_deg", "azimuth_deg": "nadir/azimuth_deg",
                "target_height_above_ground_m": "look_at/height_above_ground_m", "target_lat_deg": "look_at/lat_deg",
                "target_lon_deg": "look_at/lon_deg", "target_height_m": "look_at/height_m", "up": "look_at/up"}
SUN_MEMBERS = {"subsolar": {"lat_deg": "subsolar/lat_deg", "lon_deg": "subsolar/lon_deg"},
               "local": {name: f"local/{name}" for name in ("lat_deg", "lon_deg", "azimuth_deg", "elevation_deg")},
               "direction": {"vector": "direction"}, "utc": {"when": "utc"}, "et": {}}


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "1", "--columns", "1", "--ppd", "16")
    service = Service()
    DOCUMENT.update(json.loads(service.ask("GET", "/openapi.json")[2]))
    assert service.stop() == 0


def resolve(schema):
    while "$ref" in schema:
        schema = DOCUMENT["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    return schema


def request_schema(path):
    return resolve(DOCUMENT["paths"][path]["post"]["requestBody"]["content"]["application/json"]["schema"])


def part_schema(name):
    return resolve(DOCUMENT["components"]["schemas"][name])


def member_of(schema, path):
    """The schema of a member, by its names from the outside in; of a list, by those in its elements. None without it."""
    for name in filter(None, path.split("/")):
        schema = resolve(schema)
        schema = resolve(schema["items"]) if schema.get("type") == "array" else schema
        schema = schema.get("properties", {}).get(name)
        if schema is None:
            return None
    return resolve(schema)


def alternatives(schema):
    """The schemas of which a value needs to fit one."""
    schema = resolve(schema)
    nested = schema.get("oneOf", []) + schema.get("anyOf", [])
    return [a for inner in nested for a in alternatives(inner)] if nested and "type" not in schema else [schema]


def fits(hint, schema):
    """Whether each kind of value that a hint names is a value of the schema. A hint `Any` names none."""
    if hint is typing.Any:
        return True
    arguments = typing.get_args(hint)
    origin = typing.get_origin(hint)
    if origin is typing.Union:
        return all(fits(argument, schema) for argument in arguments)
    if origin is typing.Literal:
        return all(any(value in a.get("enum", [a.get("const", value)]) for a in alternatives(schema)) for value in arguments)
    kinds = [a.get("type") for a in alternatives(schema)]
    if origin in SEQUENCES:
        return any(fits(arguments[0], a.get("items", {})) for a in alternatives(schema) if a.get("type") == "array")
    if origin in MAPPINGS or isinstance(hint, type) and issubclass(hint, dict):
        return "object" in kinds
    return any(kind in kinds for kind in TYPES[hint])


def without_none(hint):
    """A keyword's hint, without the None of one that is left out."""
    arguments = [argument for argument in typing.get_args(hint) if argument is not type(None)]
    return typing.Union[tuple(arguments)] if typing.get_origin(hint) is typing.Union else hint


def keywords(function):
    """The hints of a function's keywords, but for those that any member may follow (**more)."""
    hints = typing.get_type_hints(function)
    return {name: hints[name] for name, parameter in inspect.signature(function).parameters.items()
            if name != "self" and parameter.kind != parameter.VAR_KEYWORD}


class Hints(unittest.TestCase):
    def unhinted(self, source):
        """Arguments without a hint, and functions without one of their result."""
        for function in ast.walk(ast.parse(source)):
            if isinstance(function, (ast.FunctionDef, ast.AsyncFunctionDef)):
                named = function.args
                of_all = [*named.posonlyargs, *named.args, *named.kwonlyargs, *filter(None, (named.vararg, named.kwarg))]
                yield from (f"{function.name}({a.arg})" for a in of_all if not a.annotation and a.arg not in ("self", "cls"))
                if function.returns is None:
                    yield function.name

    def test_every_function_has_all_hints(self):
        """So py.typed promises."""
        self.assertEqual(list(self.unhinted("def f(self, a, *b: int, c: str = ''): pass")), ["f(a)", "f"])
        folder = os.path.dirname(selenograph.__file__)
        self.assertIn("py.typed", os.listdir(folder))
        for name in os.listdir(folder):
            if name.endswith(".py"):
                with open(os.path.join(folder, name)) as file:
                    self.assertEqual(list(self.unhinted(file.read())), [], name)


class Requests(unittest.TestCase):
    def check(self, hint, schema, path, what):
        member = member_of(schema, path)
        self.assertIsNotNone(member, f"{what}: the document has no {path}")
        self.assertTrue(fits(hint, member), f"{what}: {hint}, the document has {member}")

    def check_members(self, class_, schema, what):
        for name, hint in typing.get_type_hints(class_).items():
            with self.subTest(f"{what}.{name}"):
                self.check(hint, schema, name, f"{what}.{name}")

    def test_the_check_finds_faults(self):
        schema = request_schema("/v1/limb")
        for hint, path in ((int, "azimuths"), (str, "points"), (typing.Sequence[int], "points"), (float, "camera/width"),
                           (typing.Optional[int], "points"), (typing.Mapping[str, int], "detail"), (bool, "camera")):
            with self.assertRaises(AssertionError, msg=(hint, path)):
                self.check(hint, schema, path, "")
        self.check(typing.Optional[str], schema, "detail", "")  # null or a text

    def test_typed_members(self):
        for path, class_ in REQUEST_CLASSES.items():
            self.check_members(class_, request_schema(path), class_.__name__)
        for path in ("/v1/rays", "/v1/project"):
            self.check_members(request_types.Light, request_schema(path), "Light")
        self.check_members(request_types.MapError, part_schema("MapError"), "MapError")
        region = member_of(request_schema("/v1/features"), "region")
        self.check_members(request_types.Region, region, "Region")
        self.assertEqual(set(request_types.Region.__required_keys__), set(region["required"]))
        self.assertGreater(len(typing.get_type_hints(request_types.FrameRequest)), 20)

    def test_keywords_of_methods(self):
        public = {name for name, member in vars(Client).items() if callable(member) and not name.startswith("_")}
        self.assertEqual(public, set(METHODS) | WHOLE_REQUESTS | WITHOUT_REQUEST | ANY_REQUEST, "a method that no test knows")
        for method, (path, elsewhere) in METHODS.items():
            for name, hint in keywords(getattr(Client, method)).items():
                with self.subTest(f"{method}({name}=)"):
                    self.check(without_none(hint), request_schema(path), elsewhere.get(name, name), f"{method}({name}=)")

    def test_keywords_of_constructors(self):
        for constructor in (Camera.pinhole, Camera.fisheye):
            for name, hint in keywords(constructor).items():
                self.check(without_none(hint), part_schema("Camera"), name, f"{constructor.__name__}({name}=)")
        for constructor, skipped in ((Pose.nadir, ()), (Pose.look_at, ()), (Pose.from_quaternion, ("q", "order", "direction")),
                                     (Pose.from_matrix, ("matrix", "direction")), (Pose.from_mrp, ("sigma", "direction"))):
            for name, hint in keywords(constructor).items():
                if name not in skipped:
                    self.check(without_none(hint), part_schema("Pose"), POSE_MEMBERS.get(name, name),
                               f"{constructor.__name__}({name}=)")
        for constructor, elsewhere in SUN_MEMBERS.items():
            for name, hint in keywords(getattr(Sun, constructor)).items():
                self.check(without_none(hint), part_schema("Sun"), elsewhere.get(name, name), f"Sun.{constructor}({name}=)")

    def test_what_constructors_make(self):
        place = {"lat_deg": -6.5, "lon_deg": 40, "height_m": 20000}
        size = {"width": 64, "height": 48}
        turned = {"direction": "moon_from_camera", **place}
        noon = datetime.datetime(2026, 11, 20, 12, tzinfo=datetime.timezone.utc)
        for name, parts in (
                ("Camera", [Camera.pinhole(**size, fov_deg=50, distortion={"k1": 0.1, "p2": 0.01}),
                            Camera.pinhole(**size, fx=60, fy=61, cx=30, cy=20),
                            Camera.fisheye(**size, focal_length_mm=5, pixel_pitch_um=4, distortion={"k4": 0.01}),
                            Camera.from_opencv(np.diag([60, 60, 1]), [0.1, 0, 0, 0, 0.1], **size),
                            Camera.from_opencv(np.diag([60, 60, 1]), [0.1] * 14, **size),
                            Camera.from_cahvor([0, 0, 1], [60, 1, 31], [0, 60, 23], **size)[0]]),
                ("Pose", [Pose.nadir(**place), Pose.nadir(position_m=[2e6, 0, 0], frame="MOON_PA_DE440"),
                          Pose.look_at(target_lat_deg=-6, target_lon_deg=40, **place),
                          Pose.look_at(target_lat_deg=-6, target_lon_deg=40, up="zenith", **place),
                          Pose.from_quaternion([1, 0, 0, 0], order="wxyz", axes="opengl", **turned),
                          Pose.from_matrix(np.eye(3), direction="camera_from_moon", **place),
                          Pose.from_mrp([0, 0, 0.1], **turned)]),
                ("Sun", [Sun.direction([1, 2, 3], distance_au=0.98, angular_radius_deg="sun"),
                         Sun.subsolar(lat_deg=0, lon_deg=10, angular_radius_deg=0.27), Sun.utc(noon), Sun.et(8e8),
                         Sun.local(lat_deg=0, lon_deg=10, azimuth_deg=90, elevation_deg=5)])):
            validator = jsonschema.Draft202012Validator(part_schema(name), resolver=jsonschema.RefResolver("", DOCUMENT))
            for part in parts:
                with self.subTest(part):
                    validator.validate(json.loads(json.dumps(part)))
            self.assertFalse(validator.is_valid({"unknown": 1}))

    def test_words_and_limits(self):
        frame = request_schema("/v1/frames")
        self.assertEqual(selenograph.MOST_AHEAD, member_of(frame, "ahead")["maxItems"])
        frames = set(member_of(frame, "pose/frame")["enum"])
        self.assertLessEqual(set(selenograph.FRAMES.values()) | set(selenograph.INERTIAL), frames)
        [sunless] = [option["properties"]["products"]["items"]["enum"] for part in frame["allOf"]
                     for option in part.get("anyOf", [{}])[0].get("anyOf", []) if "products" in option.get("required", [])]
        self.assertEqual(selenograph.NEED_SUN, set(member_of(frame, "products")["items"]["enum"]) - set(sunless))
        for name in selenograph.NEED_SUN:
            self.assertIn(name, frame["description"])
        answers = DOCUMENT["paths"]["/v1/frames"]["post"]["responses"]["200"]["content"]
        self.assertLessEqual(set(selenograph.MEDIA_TYPES.values()), set(answers))
        self.assertLessEqual(selenograph.POINTS_AT_ONCE, member_of(request_schema("/v1/heights"), "points")["maxItems"])
        self.assertLessEqual(selenograph.ROWS_AT_ONCE, member_of(request_schema("/v1/rays"), "rays")["maxItems"])


if __name__ == "__main__":
    harness.main()
