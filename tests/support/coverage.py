#!/usr/bin/env python3
"""Prints which lines and branches the tests have run, by folder, and the functions of which they have run least.

usage: coverage.py BUILD [--record]

BUILD was compiled with --coverage, and its tests have run: deploy/check coverage does both. A folder whose share is more
than 1 % below that of tests/coverage.json is an error; --record writes that file. Branches that only an exception takes are
not counted: nearly every call has one.
"""

import collections
import concurrent.futures
import json
import os
import subprocess
import sys

ROOT = os.path.realpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
RECORD = os.path.join(ROOT, "tests", "coverage.json")
FOLDERS = ("dem", "engine", "api", "server")
TOLERANCE = 0.01
LEAST_COVERED = 20


def read(data_file):
    """gcov's JSON of one object file: a document a line."""
    done = subprocess.run(["gcov", "--json-format", "--branch-probabilities", "--stdout", os.path.basename(data_file)],
                          cwd=os.path.dirname(data_file), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True)
    return [json.loads(line) for line in done.stdout.splitlines() if line.strip()]


def own(path, directory):
    """Path below the repository; nothing for files of others and of tests."""
    name = os.path.relpath(os.path.realpath(os.path.join(directory, path)), ROOT)
    return name if name.startswith(tuple(folder + os.sep for folder in FOLDERS)) and "clients" not in name else None


class Counts:
    """Executions by file and line, of all objects that contain it: a header's lines count once."""

    def __init__(self):
        self.lines, self.branches, self.functions = {}, {}, {}

    def add(self, document):
        for file in document["files"]:
            name = own(file["file"], document["current_working_directory"])
            if not name:
                continue
            for line in file["lines"]:
                at = (name, line["line_number"])
                self.lines[at] = self.lines.get(at, 0) + line["count"]
                taken = [branch["count"] for branch in line["branches"] if not branch["throw"]]
                before = self.branches.get(at, [])
                self.branches[at] = [a + b for a, b in zip(before, taken)] if len(before) == len(taken) else max(before, taken, key=len)
            for function in file["functions"]:
                self.functions[name, function["start_line"], function["end_line"]] = function["demangled_name"].split("(")[0]

    def least_covered(self):
        """(lines that did not run, lines, file, first line, function), the most first."""
        found = []
        for (name, first, last), function in self.functions.items():
            counts = [self.lines[name, number] for number in range(first, last + 1) if (name, number) in self.lines]
            found.append((counts.count(0), len(counts), name, first, function))
        return sorted(found, key=lambda row: -row[0])[:LEAST_COVERED]

    def by_folder(self):
        """[lines run, lines, branches taken, branches] by folder."""
        found = collections.defaultdict(lambda: [0, 0, 0, 0])
        for (name, number), count in self.lines.items():
            row, taken = found[os.path.dirname(name)], self.branches[name, number]
            for i, more in enumerate((count > 0, 1, sum(b > 0 for b in taken), len(taken))):
                row[i] += more
        return dict(sorted(found.items()))


def share(part, whole):
    return part / whole if whole else 1.0


def main(build, record):
    data = [os.path.join(folder, name) for folder, _, names in os.walk(build) for name in names if name.endswith(".gcda")]
    if not data:
        sys.exit(f"{build} has no counts: it was not compiled with --coverage, or no test has run")
    counts = Counts()
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for documents in pool.map(read, data):
            for document in documents:
                counts.add(document)
    shares = {folder: [round(share(row[0], row[1]), 4), round(share(row[2], row[3]), 4)] for folder, row in counts.by_folder().items()}
    print(f"{'folder':34}{'lines':>8}{'run':>8}{'branches':>10}{'taken':>8}")
    for folder, row in counts.by_folder().items():
        print(f"{folder:34}{row[1]:8}{shares[folder][0]:8.1%}{row[3]:10}{shares[folder][1]:8.1%}")
    print("\nmost lines that did not run, of a function's")
    for missed, lines, name, first, function in counts.least_covered():
        print(f"{missed:6} of {lines:4}  {name}:{first} {function}")
    if record:
        with open(RECORD, "w") as file:
            file.write("{\n" + ",\n".join(f' "{folder}": {json.dumps(pair)}' for folder, pair in shares.items()) + "\n}\n")
    if not os.path.exists(RECORD):
        print(f"\nno figures to compare with: {os.path.relpath(RECORD, ROOT)} is written by --record, after all tests")
        return 0
    with open(RECORD) as file:
        recorded = json.load(file)
    fallen = [f"{folder}: {kind} {now:.1%}, {then:.1%} recorded" for folder, pair in recorded.items()
              for kind, now, then in zip(("lines", "branches"), shares.get(folder, (0, 0)), pair) if now < then - TOLERANCE]
    print("\n".join(fallen))
    return 1 if fallen else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], "--record" in sys.argv[2:]))
