#!/usr/bin/env python3
"""The API document without texts and examples is api/v1.openapi.json, the names of commands, their options and metrics are
api/v1.names.json: what changes for clients is in the diff of these files.

`compatibility_test.py --write` renews both.
"""

import functools
import json
import os
import re
import subprocess
import sys
import unittest

import harness
from harness import REPOSITORY, Service, tearDownModule

DOCUMENT = os.path.join(REPOSITORY, "api", "v1.openapi.json")
MANUAL = os.path.join(REPOSITORY, "deploy", "operation", "package", "selenograph.1")
NAMES = os.path.join(REPOSITORY, "api", "v1.names.json")
TEXTS = ("description", "summary", "title", "examples", "example", "info", "servers", "tags", "license")


def without_texts(value, names=False):
    """`names`: the keys are members' names, not words of the schema."""
    if isinstance(value, dict):
        return {k: without_texts(v, k == "properties" and not names) for k, v in value.items() if names or k not in TEXTS}
    return [without_texts(v) for v in value] if isinstance(value, list) else value


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


def recorded(path):
    with open(path) as file:
        return json.load(file)


def setUpModule():
    harness.set_up()
    harness.sample("dem", "--south-deg", "-1", "--west-deg", "29", "--rows", "1", "--columns", "1", "--ppd", "16")


def write():
    setUpModule()
    for path, new in ((DOCUMENT, served()), (NAMES, names())):
        with open(path, "w") as file:
            json.dump(new, file, indent=1)
            file.write("\n")
    tearDownModule()


class Compatibility(unittest.TestCase):
    def test_the_document_is_the_recorded_one(self):
        self.assertEqual(served(), recorded(DOCUMENT), "after a look at the changes: compatibility_test.py --write")

    def test_names_are_the_recorded_ones(self):
        said = names()
        self.assertGreater(len(said["metrics"]), 30)
        self.assertEqual(said, recorded(NAMES), "after a look at the changes: compatibility_test.py --write")

    def test_the_manual_has_each_command(self):
        with open(MANUAL) as file:
            page = file.read()
        listed = page[page.index(".SH COMMANDS"):page.index(".SH CONFIGURATION")]
        for words in map(str.split, filter(None, commands())):
            self.assertRegex(listed, rf"(?m)^\.TP\n\.B {words[0]}$")
            self.assertRegex(listed, rf"(?m)^\.BR? {words[-1]}\b")


if __name__ == "__main__":
    write() if "--write" in sys.argv else harness.main()
