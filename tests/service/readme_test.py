#!/usr/bin/env python3
"""Runs every snippet of the front page and the guides against the service as deploy/quickstart starts it.

Blocks of Python run in order in one namespace; when the request that they build has changed, the service must answer it. Of
shell blocks each command runs by itself; SUBSTITUTES lists what stands there for the reader's own data. A block
after the comment <!-- not run: reason --> is left out. A failure names page and line.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import unittest

import harness
from harness import REPOSITORY, tearDownModule

PAGES = ("README.md", "api/guide.md", "dem/tiles.md", "engine/verify/errors.md", "engine/verify/speed.md")  # in this order
ADDRESS = "127.0.0.1:8080"
PLACE = ("--ppd", "256")  # the sample terrain where quickstart has it, but coarser

# The reader's own data and choices, and what stands for them here.
SUBSTITUTES = {"/data/kaguya": "dem", "/data/global.tif": "dem", "PATH": "dem", "DIR": "out", "LAT,LON": "-6.5,39.5"}
# Options for commands that take minutes or do not end.
CHEAPER = {
    ("verify", "accuracy"): ["--scenes", "nadir", "--size-px", "32", "--repetitions", "1", "--reference-samples", "1"],
    ("verify", "roundtrip"): ["--posts", "64"],
    ("sample",): list(PLACE),
}
# Commands of the project that are not run, and why.
NOT_RUN = {"deploy/quickstart": "installs packages; its service is what this test starts",
           "deploy/test": "runs this test"}


def blocks(page):
    """(language, (page, number of the first line in it), lines) of all fenced blocks that are to be run."""
    with open(os.path.join(REPOSITORY, page)) as file:
        text = file.read()
    found, language, left_out, before = [], None, False, ""
    for number, line in enumerate(text.splitlines(), 1):
        if language is not None:
            if line.strip() == "```":
                language = None
            elif not left_out:
                found[-1][2].append(line)
        elif line.startswith("```"):
            language, left_out = line[3:].strip(), before.startswith("<!-- not run:")
            if not left_out:
                found.append((language, (page, number + 1), []))
        if line.strip():
            before = line.strip()
    return found


def quickstarts_service():
    """The options that deploy/quickstart gives to serve."""
    with open(os.path.join(REPOSITORY, "deploy", "quickstart")) as file:
        text = file.read().replace("\\\n", " ")
    line = re.search(r'^"\$root/build/selenograph" serve (.*?)&?$', text, re.M)[1]
    for name, value in (("root", REPOSITORY), ("sample", harness.path("dem")), ("port", "0"), ("data", harness.path("cache"))):
        line = line.replace("$" + name, value)
    assert "$" not in line, line
    return shlex.split(line)


def setUpModule():
    harness.set_up()
    harness.sample("dem", *PLACE)
    os.symlink(os.path.join(REPOSITORY, "deploy"), harness.path("deploy"))
    os.mkdir(harness.path("build"))
    os.symlink(os.path.abspath(harness.BINARY), harness.path("build", "selenograph"))
    shutil.copy(os.path.join(REPOSITORY, "deploy", "examples", "example-request.json"), harness.path("request.json"))
    ReadmeTest.service = harness.Service(options=quickstarts_service())


class ReadmeTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.blocks = [block for page in PAGES for block in blocks(page)]
        cls.here = f"{cls.service.host}:{cls.service.port}"

    def run_command(self, place, line):
        command = re.sub(r"\s+#.*$", "", line).replace(ADDRESS, self.here)
        words = [SUBSTITUTES.get(word, word) for word in shlex.split(command)]
        if words[0] in NOT_RUN:
            return
        self.assertIn(words[0], ("curl", "build/selenograph"), f"{place}: no rule says how to run {line!r}")
        if words[0] == "curl":
            words[1:1] = ["-sS", "--fail-with-body"]
        for start, options in CHEAPER.items():
            if tuple(words[1:1 + len(start)]) == start:
                words += options
        if words[1] == "serve":
            options = [harness.path(word) if word == "dem" else word for word in words[2:]]
            service = harness.Service(options=[*options, "--port", "0", "--cache-dir", harness.path("cache")])
            self.assertEqual(service.stop(), 0, place)
            return
        # What has no --dem would make the sample terrain.
        environment = {**os.environ, "SELENOGRAPH_CACHE_DIR": harness.path("cache")}
        if words[1] in ("ask", "batch", "ingest", "info", "verify") and "--dem" not in words and words[1:3] != ["verify", "mertis"]:
            words += ["--dem", "dem"]
        done = subprocess.run(words, cwd=harness.path(), env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                              timeout=harness.PATIENCE_S * 5)
        self.assertEqual(done.returncode, 0, f"{place}: {shlex.join(words)}\n{done.stdout[-2000:]}")
        for option in ("-o", "--output"):
            if option in words:
                written = harness.path(words[words.index(option) + 1])
                self.assertTrue(os.path.exists(written), f"{place}: {written} was not written")

    def test_shell_blocks(self):
        count = 0
        for language, (page, first), lines in self.blocks:
            if language not in ("sh", "bash", "shell"):
                continue
            joined = ""
            for number, line in enumerate(lines, first):
                joined += line.removesuffix("\\")
                if line.endswith("\\"):
                    continue
                if joined.strip() and not joined.lstrip().startswith("#"):
                    count += 1
                    with self.subTest(f"{page}:{number}: {joined}"):
                        self.run_command(f"{page}:{number}", joined)
                joined = ""
        self.assertGreater(count, 1)

    def test_python_blocks(self):
        namespace, asked, count = {"__name__": "readme"}, None, 0
        os.chdir(harness.path())
        for language, (page, first), lines in self.blocks:
            if language != "python":
                continue
            count += 1
            source = "\n" * (first - 1) + "\n".join(lines).replace(ADDRESS, self.here)
            try:
                exec(compile(source, page, "exec"), namespace)
            except Exception as error:
                raise AssertionError(f"the Python block at {page}:{first} fails") from error
            request = json.dumps(namespace.get("request"))
            if request != asked:
                status, _, body = self.service.frame(namespace["request"], "application/x-npz")
                self.assertEqual(status, 200, f"the request of {page}:{first}: {body[:500]}")
                asked = request
        self.assertGreater(count, 1)

    def test_the_front_page_names_all_calls_and_products(self):
        document = json.loads(self.service.ask("GET", "/openapi.json")[2])
        with open(os.path.join(REPOSITORY, "README.md")) as file:
            rows = [line.split(" | ") for line in file if line.startswith("| ")]
        calls = [row[0] for row in rows if row[0].startswith(("| `POST", "| `GET"))]
        named = set(re.findall(r"`(?:[A-Z]+ )?(/[^`]+)`", " ".join(calls)))
        self.assertEqual(named | {"/v1/frames/{hash}/meta"}, set(document["paths"]))
        products = document["components"]["schemas"]["FrameRequest"]["properties"]["products"]["items"]["enum"]
        truth = next(row[1] for row in rows if row[0] == "| truth per pixel")
        self.assertEqual(set(re.findall(r"`(\w+)`", truth)) | {"image", "radiance"}, set(products))

    def test_each_walk_is_run_by_the_test_that_the_front_page_names(self):
        with open(os.path.join(REPOSITORY, "README.md")) as file:
            walks = re.findall(r"\]\(([^)]+)\) \| `(?:service|slow)\.(\w+)` \|$", file.read(), re.M)
        self.assertGreaterEqual(len(walks), 5)
        folders = ("tests/service", "api/clients/tests", "deploy/navigation")
        for page, test in walks:
            file = test.removesuffix("_test") + "_test.py"
            found = [os.path.join(REPOSITORY, folder, file) for folder in folders
                     if os.path.exists(os.path.join(REPOSITORY, folder, file))]
            self.assertEqual(len(found), 1, test)
            with open(found[0]) as source:
                # Its name, or that of its folder or of its programs.
                self.assertRegex(source.read(), re.escape(os.path.basename(page)) + "|" + os.path.basename(os.path.dirname(page)))

    def test_json_blocks_are_json(self):
        for language, place, lines in self.blocks:
            if language == "json":
                with self.subTest(place):
                    json.loads("\n".join(lines))

    def test_every_block_says_what_it_is(self):
        for language, place, _ in self.blocks:
            self.assertIn(language, ("sh", "bash", "shell", "python", "json", "toml", "text"), place)


if __name__ == "__main__":
    harness.main()
