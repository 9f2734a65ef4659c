#!/usr/bin/env python3
"""The service's document keeps what clients of version 1 rely on: api/v1.openapi.json, without texts and examples. So do
the names of commands, their options and metrics: api/v1.names.json.

`compatibility_test.py --write` renews both files, and refuses if anything in them would break.
"""

import copy
import functools
import json
import os
import re
import subprocess
import sys
import unittest

import harness
from harness import REPOSITORY, Service, tearDownModule

FROZEN = os.path.join(REPOSITORY, "api", "v1.openapi.json")
MANUAL = os.path.join(REPOSITORY, "deploy", "operation", "package", "selenograph.1")
NAMES = os.path.join(REPOSITORY, "api", "v1.names.json")
TEXTS = ("description", "summary", "title", "examples", "example", "info", "servers", "tags", "license")
# Bounds of which a request may only get looser, and the sign of that.
BOUNDS = {"minimum": -1, "exclusiveMinimum": -1, "minItems": -1, "minLength": -1, "minProperties": -1,
          "maximum": 1, "exclusiveMaximum": 1, "maxItems": 1, "maxLength": 1, "maxProperties": 1}
CONDITIONS = ("allOf", "if", "then", "else", "not", "dependentSchemas", "contains", "propertyNames", "pattern", "uniqueItems")


def without_texts(value, names=False):
    """`names`: the keys are members' names, not words of the schema."""
    if isinstance(value, dict):
        return {k: without_texts(v, k == "properties" and not names) for k, v in value.items() if names or k not in TEXTS}
    return [without_texts(v) for v in value] if isinstance(value, list) else value


class Comparison:
    """What in a new document breaks clients of an old one: `breaks`, as texts."""

    def __init__(self, old, new):
        self.old, self.new, self.breaks, self._seen = old, new, [], set()
        self._names = set(self._all_names(old))
        for path, methods in old["paths"].items():
            for method, operation in methods.items():
                self._operation(f"{method.upper()} {path}", operation, new["paths"].get(path, {}).get(method))

    def _all_names(self, value):
        """Names of members and words of choices, of the old document."""
        if isinstance(value, dict):
            yield from value.get("properties", {}) if isinstance(value.get("properties"), dict) else ()
            yield from map(str, value.get("enum", ()) if isinstance(value.get("enum"), list) else ())
            for inner in value.values():
                yield from self._all_names(inner)
        elif isinstance(value, list):
            for inner in value:
                yield from self._all_names(inner)

    def _tell(self, where, what):
        if f"{where}: {what}" not in self.breaks:
            self.breaks.append(f"{where}: {what}")

    @staticmethod
    def _resolved(document, value):
        while isinstance(value, dict) and "$ref" in value:
            target = document
            for name in value["$ref"].split("/")[1:]:
                target = target[name]
            value = target
        return value

    def _operation(self, where, old, new):
        if new is None:
            return self._tell(where, "is gone")
        old_parameters, new_parameters = ({p["name"]: p for p in (self._resolved(document, q) for q in operation.get("parameters", ()))}
                                          for document, operation in ((self.old, old), (self.new, new)))
        for name in old_parameters.keys() - new_parameters.keys():
            self._tell(where, f"parameter {name} is gone")
        for name, parameter in new_parameters.items():
            if parameter.get("required") and not old_parameters.get(name, {}).get("required"):
                self._tell(where, f"parameter {name} is required now")
        self._content(where, old.get("requestBody", {}), new.get("requestBody", {}), self._request)
        for status, answer in old["responses"].items():
            if status not in new["responses"]:
                self._tell(where, f"answer {status} is gone")
                continue
            old_answer, new_answer = self._resolved(self.old, answer), self._resolved(self.new, new["responses"][status])
            for header in old_answer.get("headers", {}).keys() - new_answer.get("headers", {}).keys():
                self._tell(where, f"header {header} of answer {status} is gone")
            self._content(f"{where} {status}", old_answer, new_answer, self._answer)

    def _content(self, where, old, new, compare):
        for media_type, content in old.get("content", {}).items():
            if media_type not in new.get("content", {}):
                self._tell(where, f"{media_type} is gone")
            elif "schema" in content:
                compare(where, content["schema"], new["content"][media_type].get("schema", {}))

    def _pair(self, kind, old, new):
        """Both schemas without references; nothing if they were compared before."""
        key = (kind, json.dumps(old, sort_keys=True), json.dumps(new, sort_keys=True))
        if key in self._seen:
            return None
        self._seen.add(key)
        return self._resolved(self.old, old), self._resolved(self.new, new)

    @staticmethod
    def _types(schema):
        types = schema.get("type", ())
        return {types} if isinstance(types, str) else set(types)

    @staticmethod
    def _choices(schema):
        return {json.dumps(v) for v in schema.get("enum", [schema["const"]] if "const" in schema else [])}

    @staticmethod
    def _alternatives(schema):
        return [a for word in ("anyOf", "oneOf") for a in schema.get(word, ())]

    def _request(self, where, old, new):
        """The new schema must accept what the old one accepts, with the same meaning."""
        pair = self._pair("request", old, new)
        if pair is None:
            return
        old, new = pair
        self._compare(where, "_request", old, new)
        for word, looser in BOUNDS.items():
            if word in new and (word not in old or looser * (new[word] - old[word]) < 0):
                self._tell(where, f"{word} is {new[word]}, not {old.get(word, 'unbounded')}")
        for word in ("default", "format"):
            if word in old and old[word] != new.get(word):
                self._tell(where, f"{word} is {new.get(word)}, not {old[word]}")
        known = [json.dumps(self._of_old_names(c), sort_keys=True) for c in self._conditions(old)]
        for condition in self._conditions(new):
            kept = self._of_old_names(condition)
            if kept and json.dumps(kept, sort_keys=True) not in known:
                self._tell(where, f"has another condition: {json.dumps(condition)[:200]}")

    def _answer(self, where, old, new):
        """The old schema must describe what the new one allows."""
        pair = self._pair("answer", old, new)
        if pair is None:
            return
        # The resolved request is compared as a request.
        old, new = ({**schema, "properties": {k: v for k, v in schema.get("properties", {}).items() if k != "request"}} for schema in pair)
        self._compare(where, "_answer", old, new)

    def _compare(self, where, kind, old, new):
        """What holds for requests and answers alike: what one side sends, the other must take."""
        asked = kind == "_request"
        sent, taken = (old, new) if asked else (new, old)
        if self._types(taken) and not self._types(sent) <= self._types(taken) | ({"integer"} if "number" in self._types(taken) else set()):
            self._tell(where, f"{'takes' if asked else 'is'} {new.get('type')}, not {old.get('type')}")
        if self._choices(taken) and (more := self._choices(sent) - self._choices(taken)):
            self._tell(where, f"{'does not take' if asked else 'may be'} {', '.join(sorted(more))}")
        if old.get("x-unit") != new.get("x-unit"):
            self._tell(where, f"x-unit is {new.get('x-unit')}, not {old.get('x-unit')}")
        compare = getattr(self, kind)
        self._members(where, old, new, compare)
        for name in set(taken.get("required", ())) - set(sent.get("required", ())):
            self._tell(where, f"{name} {'is required now' if asked else 'may be missing'}")
        self._items(where, old, new, compare)
        self._each_has_one(where, self._alternatives(sent), self._alternatives(taken),
                           lambda s, t: self._breaks_of(*((s, t) if asked else (t, s)), kind))

    def _members(self, where, old, new, compare):
        for name, schema in old.get("properties", {}).items():
            if name in new.get("properties", {}):
                compare(f"{where} /{name}", schema, new["properties"][name])
            else:
                self._tell(where, f"{name} is gone")
        if isinstance(old.get("additionalProperties"), dict):
            compare(f"{where} /*", old["additionalProperties"], new.get("additionalProperties", {}))

    def _items(self, where, old, new, compare):
        if isinstance(old.get("items"), dict) and isinstance(new.get("items"), dict):
            compare(f"{where} []", old["items"], new["items"])
        for i, (a, b) in enumerate(zip(old.get("prefixItems", ()), new.get("prefixItems", ()))):
            compare(f"{where} [{i}]", a, b)

    def _breaks_of(self, old, new, kind):
        """What breaks between two alternatives."""
        inner = copy.copy(self)
        inner.breaks, inner._seen = [], set()
        getattr(inner, kind)("", old, new)
        return inner.breaks

    def _each_has_one(self, where, these, those, breaks):
        if not those or not these:
            return
        for a in these:
            if all(breaks(a, b) for b in those):
                self._tell(where, f"has no alternative for {json.dumps(a)[:200]}")

    @staticmethod
    def _conditions(schema):
        """Conditions across members; those of oneOf and anyOf are alternatives."""
        return schema.get("allOf", []) + [{word: schema[word]} for word in CONDITIONS if word in schema and word != "allOf"]

    def _of_old_names(self, condition):
        """A condition without what it says of members and words that the old document has not."""
        if isinstance(condition, list):
            kept = [self._of_old_names(c) for c in condition]
            return [c for c in kept if c not in ({}, [], None)]
        if not isinstance(condition, dict):
            return condition
        if any(isinstance(asked.get("const"), str) and asked["const"] not in self._names
               for asked in condition.get("if", {}).get("properties", {}).values()):
            return {}  # of a model that the old document has not
        out = {}
        for word, value in condition.items():
            if word == "required":
                value = [name for name in value if name in self._names]
            elif word in ("properties", "dependentSchemas"):
                value = {name: self._of_old_names(inner) for name, inner in value.items() if name in self._names}
                value = {name: inner for name, inner in value.items() if inner not in ({}, None)}
            elif word == "enum":
                value = [v for v in value if str(v) in self._names]
            else:
                value = self._of_old_names(value)
            if value not in ({}, [], None):
                out[word] = value
        return {} if "if" in out and "then" not in out else out


def served():
    service = Service("--deadline-s", "60")  # the default, which the document names
    document = json.loads(service.ask("GET", "/openapi.json")[2])
    service.expect_clean_stop()
    return without_texts(document)


@functools.cache  # a process for each command
def commands(*words):
    """Options by command, those of commands within commands included."""
    text = subprocess.run([harness.BINARY, *words, "--help"], check=True, stdout=subprocess.PIPE, text=True).stdout
    head, _, below = text.partition("\nSubcommands:")
    found = {" ".join(words): sorted(re.findall(r"^ *(?:-\w,)?(--[a-z0-9-]+)", head, re.M))}
    for name in re.findall(r"^  ([a-z][a-z-]*) ", below, re.M):
        found |= commands(*words, name)
    return found


def names():
    """Commands with their options, and metrics with their types."""
    service = Service()
    metrics = service.ask("GET", "/metrics")[2].decode()
    service.expect_clean_stop()
    return {"commands": commands(), "metrics": dict(sorted(re.findall(r"^# TYPE (\S+) (\S+)$", metrics, re.M)))}


def gone(old, new):
    """Commands, options and metrics of `old` that `new` has not, or a metric of another type."""
    for command, options in old["commands"].items():
        if command not in new["commands"]:
            yield f"command {command}"
        yield from (f"{command} {option}".strip() for option in options if option not in new["commands"].get(command, options))
    yield from (f"metric {name}, a {kind}" for name, kind in old["metrics"].items() if new["metrics"].get(name) != kind)


def frozen(path=FROZEN):
    with open(path) as file:
        return json.load(file)


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "1", "--columns", "1", "--ppd", "16")


def write():
    setUpModule()
    for path, new, breaks_of in ((FROZEN, served(), lambda old, new: Comparison(old, new).breaks), (NAMES, names(), gone)):
        if os.path.exists(path) and (breaks := list(breaks_of(frozen(path), new))):
            sys.exit("\n".join(breaks))
        with open(path, "w") as file:
            json.dump(new, file, indent=1)
            file.write("\n")
    tearDownModule()


class Compatibility(unittest.TestCase):
    def test_nothing_breaks(self):
        document = served()
        self.assertEqual(Comparison(frozen(), document).breaks, [])
        self.assertEqual(document, frozen(), "compatible, but not in the file: compatibility_test.py --write")

    def test_no_name_is_gone(self):
        said = names()
        self.assertGreater(len(said["metrics"]), 30)
        self.assertEqual(list(gone(frozen(NAMES), said)), [])
        self.assertEqual(said, frozen(NAMES), "compatible, but not in the file: compatibility_test.py --write")

    def test_the_manual_has_each_command(self):
        with open(MANUAL) as file:
            page = file.read()
        listed = page[page.index(".SH COMMANDS"):page.index(".SH CONFIGURATION")]
        for words in map(str.split, filter(None, commands())):
            self.assertRegex(listed, rf"(?m)^\.TP\n\.B {words[0]}$")
            self.assertRegex(listed, rf"(?m)^\.BR? {words[-1]}\b")

    def test_names_that_go_are_found(self):
        less = copy.deepcopy(frozen(NAMES))
        less["commands"].pop("ask")
        less["commands"]["serve"].remove("--port")
        less["metrics"]["selenograph_errors_total"] = "gauge"
        self.assertEqual(list(gone(frozen(NAMES), less)), ["serve --port", "command ask", "metric selenograph_errors_total, a counter"])
        less["metrics"]["selenograph_errors_total"] = "counter"
        self.assertEqual(list(gone(less, frozen(NAMES))), [])

    def changed(self, change):
        document = copy.deepcopy(frozen())
        change(document["components"]["schemas"], document)
        return Comparison(frozen(), document).breaks

    def test_breaking_changes_are_found(self):
        def set_at(schema, member, word, value):
            return lambda schemas, _: schemas[schema]["properties"][member].update({word: value})

        changes = {
            "FrameRequest: sun": lambda s, _: s["FrameRequest"]["properties"].pop("sun"),
            "width": set_at("Camera", "width", "maximum", 100),
            "bit_depth: default": set_at("Detector", "bit_depth", "default", 12),
            "f_number: x-unit": set_at("Optics", "f_number", "x-unit", "mm"),
            "fov_deg is required": lambda s, _: s["Camera"].setdefault("required", []).append("fov_deg"),
            "does not take": lambda s, _: s["FrameRequest"]["properties"]["visibility"]["enum"].pop(),
            "is gone": lambda _, d: d["paths"].pop("/v1/heights"),
            "image/tiff is gone": lambda _, d: d["paths"]["/v1/maps"]["post"]["responses"]["200"]["content"].pop("image/tiff"),
            "another condition": lambda s, _: s["Camera"]["allOf"].append({"not": {"required": ["fx", "width"]}}),
            "sun_mean is gone": lambda s, _: s["IlluminationAnswer"]["properties"]["places"]["items"]["properties"].pop("sun_mean"),
            "meta may be missing": lambda s, _: s["IlluminationAnswer"]["required"].remove("meta"),
        }
        for text, change in changes.items():
            with self.subTest(text):
                breaks = self.changed(change)
                self.assertTrue(any(text.split(": ")[-1] in b for b in breaks), breaks)

    def test_compatible_changes_pass(self):
        def new_model(schemas, _):
            schemas["Reflectance"]["properties"]["model"]["enum"].append("akimov")
            schemas["Reflectance"]["properties"]["nu"] = {"type": "number"}
            for condition in schemas["Reflectance"]["allOf"]:
                condition["then"].setdefault("not", {"anyOf": []})["anyOf"].append({"required": ["nu"]})
            schemas["Reflectance"]["allOf"].append({"if": {"properties": {"model": {"const": "akimov"}}, "required": ["model"]},
                                                    "then": {"not": {"anyOf": [{"required": ["w"]}]}}})

        changes = (
            lambda s, _: s["FrameRequest"]["properties"].update({"fog": {"type": "object"}}),
            lambda s, _: s["Camera"]["properties"]["width"].update({"maximum": 1e9}),
            new_model,
            lambda _, d: d["paths"].update({"/v1/tides": {"get": {"responses": {}}}}),
            lambda s, _: s["IlluminationAnswer"]["properties"].update({"moonquakes": {"type": "integer"}}),
            lambda s, _: s["Camera"]["allOf"].pop(),
        )
        for i, change in enumerate(changes):
            with self.subTest(i):
                self.assertEqual(self.changed(change), [])


if __name__ == "__main__":
    write() if "--write" in sys.argv else harness.main()
