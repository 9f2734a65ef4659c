#!/usr/bin/env python3
"""What compilations cost: as CMAKE_CXX_COMPILER_LAUNCHER it runs the compiler and appends a row to COMPILE_COSTS; with
the name of that file alone it prints the processor seconds of each layer, and the ten units that take longest.

usage: compile_costs.py COMPILER ARGUMENTS... | compile_costs.py --report FILE
"""

import collections
import os
import re
import resource
import subprocess
import sys


def compile_and_note(command):
    status = subprocess.call(command)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    unit = command[command.index("-o") + 1] if "-o" in command else "?"
    with open(os.environ["COMPILE_COSTS"], "a") as file:
        file.write(f"{used.ru_utime + used.ru_stime:.2f} {used.ru_maxrss // 1024} {unit}\n")
    return status


def layer_of(unit):
    found = re.search(r"selenograph(?:_(dem|engine|api|server|images))?\.dir", unit)
    return (found[1] or "main") if found else "rest"


def report(path):
    with open(path) as file:
        rows = [(float(seconds), int(mb), unit) for seconds, mb, unit in (line.split() for line in file)]
    layers = collections.Counter()
    for seconds, _, unit in rows:
        layers[layer_of(unit)] += seconds
    for layer, seconds in layers.most_common():
        print(f"{seconds:7.1f} s  {layer}")
    print(f"{sum(layers.values()):7.1f} s  all: user and system time of {len(rows)} compilations, "
          f"the largest of {max(mb for _, mb, _ in rows)} MB")
    for seconds, mb, unit in sorted(rows, reverse=True)[:10]:
        print(f"{seconds:7.1f} s {mb:5} MB  {unit}")


if __name__ == "__main__":
    if sys.argv[1] == "--report":
        report(sys.argv[2])
    else:
        sys.exit(compile_and_note(sys.argv[1:]))
