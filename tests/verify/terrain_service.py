"""A service of the terrain that a comparison needs: its options, its start, and its answers as arrays."""

import json
import os
import pathlib
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "service"))
import harness

MOON_RADIUS_M = 1737400.0


class Unusable(Exception):
    """An input that cannot be compared, and why, in words for the user."""


def cell(value, form="{:.6g}"):
    """A number as text, nothing for NaN."""
    return "" if value != value else form.format(value)


def add_options(parser):
    parser.add_argument("--dem", action="append", default=[], metavar="PATH", help="terrain; may be given repeatedly")
    parser.add_argument("--assets-dir", metavar="DIR", help="assets folder, for its albedo maps and details")
    parser.add_argument("--cache-dir", metavar="DIR", help="keep pyramids in this folder")
    parser.add_argument("--binary", default=harness.BINARY or os.path.join(harness.REPOSITORY, "build", "selenograph"),
                        metavar="FILE", help="the executable; default: build/selenograph")
    parser.add_argument("-o", "--output", required=True, type=pathlib.Path, metavar="DIR",
                        help="write to this folder; created if missing")


def terrain_options(options):
    """The options of `serve` for the terrain of add_options()."""
    named = [("--dem", path) for path in options.dem]
    named += [("--assets-dir", options.assets_dir), ("--cache-dir", options.cache_dir)]
    return [word for name, value in named if value for word in (name, value)]


class TerrainService:
    """A running `selenograph serve`."""

    def __init__(self, binary, *words):
        try:
            self.service = harness.Service(options=["--port", "0", "--log-level", "error", *words], binary=binary)
        except (OSError, RuntimeError) as why:
            raise Unusable(str(why))

    def post(self, path, request, accept, what):
        status, _, body = self.service.post(path, request, accept)
        if status != 200:
            problem = json.loads(body)
            errors = "".join(f"; {error['pointer']}: {error['detail']}" for error in problem.get("errors", []))
            raise Unusable(f"{what}: {problem['detail']}{errors}")
        return body

    def arrays(self, path, request, what):
        """The answer's arrays by name, and `meta`. `what` names the request in errors."""
        return harness.arrays_of(self.post(path, request, "application/x-npz", what))

    def json(self, path, request, what):
        return json.loads(self.post(path, request, "application/json", what))


def run(main):
    """Runs a comparison with a temporary folder; returns its exit status, 2 for what cannot be compared."""
    harness.set_up()
    try:
        return main()
    except Unusable as why:
        print(f"{os.path.basename(sys.argv[0])}: {why}", file=sys.stderr)
        return 2
    finally:
        harness.tear_down()
