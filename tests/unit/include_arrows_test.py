"""Includes point downwards, each foreign library is behind one pair of files, and a class has one definition.

Reads the sources; needs no build:   python3 tests/unit/include_arrows_test.py
"""

import pathlib
import re
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Top floor first: a file may include what is on its own floor or below.
ROOMS = ["server", "api", "engine", "dem"]
# "": the files that lie in engine/ itself (renderer, render_frame, ray_queries, budget, ...).
ENGINE_FLOORS = ["verify", "", "sensor", "visibility", "scene", "radiometry", "camera", "frame", "support"]

# What a foreign header is called, and the files that may include it: a folder (with a slash) or a pair of files.
LIBRARIES = [
    (r"embree\d/", ["engine/visibility/embree/embree"]),
    (r"(gdal|ogr|cpl_)", ["dem/gdal/"]),
    (r"httplib", ["server/http/http_server"]),
    (r"hwy/", ["engine/", "dem/posts/post_kernels", "dem/grid/normal_kernels", "dem/value_maps/value_map_kernels",
               "dem/detail/detail_kernels"]),
    (r"assimp/", ["engine/visibility/meshes/mesh_file"]),
    (r"erfa", ["engine/radiometry/ephemeris"]),
    (r"GeographicLib/", ["dem/"]),
    (r"(OpenImageIO/|zip\.h)", ["api/"]),
    (r"nlohmann/", ["api/", "server/", "engine/visibility/meshes/mesh_recentre"]),
    (r"openssl/", ["server/campaign/sha256"]),
    (r"archive", ["server/campaign/tar"]),
    (r"spdlog/", ["api/", "server/"]),
]

INCLUDE = re.compile(r'^\s*#\s*include\s*(?:"([^"]+)"|<([^>]+)>)')

# At the left border: members are indented, forward declarations end in a semicolon.
CLASS = re.compile(r"^(?:class|struct|union|enum class|enum) (?:alignas\(\w+\) )?(\w+)\b(?!.*;\s*$)")
NAMESPACE = re.compile(r"^namespace (\S+) \{")


def floor_of(path):
    """Of an engine file: which of ENGINE_FLOORS, None if none."""
    folder = path.split("/")[1] if path.count("/") > 1 else ""
    return ENGINE_FLOORS.index(folder) if folder in ENGINE_FLOORS else None


def may_hold(path, places):
    stem = path.rsplit(".", 1)[0]
    return any(path.startswith(place) if place.endswith("/") else stem == place for place in places)


def fault(path, own, foreign):
    """Why a file must not have an include, or None."""
    room = path.split("/")[0]
    if own:
        other = own.split("/")[0]
        if other not in ROOMS:
            return f"{own} is in no room: {', '.join(ROOMS)}"
        if ROOMS.index(other) < ROOMS.index(room):
            return f"{room}/ must not include {other}/"
        if room == other == "engine":
            here, there = floor_of(path), floor_of(own)
            if here is None or there is None:
                return f"{path if here is None else own} is on no floor of the engine"
            if there < here:
                return f"engine/{ENGINE_FLOORS[here]} must not include engine/{ENGINE_FLOORS[there]}"
        return None
    for header, places in LIBRARIES:
        if re.match(header, foreign) and not may_hold(path, places):
            return f"<{foreign}> belongs into {' or '.join(places)}"
    return None


def faults(root):
    found = []
    for room in ROOMS:
        for file in sorted((root / room).rglob("*")):
            if file.suffix not in (".h", ".cpp"):
                continue
            path = file.relative_to(root).as_posix()
            for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
                include = INCLUDE.match(line)
                why = include and fault(path, include[1], include[2])
                if why:
                    found.append(f"{path}:{number}: {why}")
    return found


def defined_twice(root):
    """Two definitions of one class in the headers: the linker takes one of their functions for both, in silence."""
    places = {}
    for room in ROOMS:
        for file in sorted((root / room).rglob("*.h")):
            namespace = ""
            for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
                opened, defined = NAMESPACE.match(line), CLASS.match(line)
                if opened:
                    namespace = opened[1]
                elif defined:
                    place = f"{file.relative_to(root).as_posix()}:{number}"
                    places.setdefault(f"{namespace}::{defined[1]}", []).append(place)
    return [f"{name} at {', '.join(where)}" for name, where in sorted(places.items()) if len(where) > 1]


class IncludeArrows(unittest.TestCase):
    def test_includes_point_downwards(self):
        found = faults(ROOT)
        self.assertEqual(found, [], "\n" + "\n".join(found))

    def test_a_class_has_one_definition(self):
        found = defined_twice(ROOT)
        self.assertEqual(found, [], "\n" + "\n".join(found))

    def test_a_second_definition_is_found(self):
        files = {
            "dem/a.h": "namespace selenograph::dem {\nclass Crater;\nstruct Crater {\n};\nstruct Pit {};\n}",
            "dem/deep/b.h": "namespace selenograph::dem {\nclass Crater final : Base {\n  struct Row {};\n};\n}",
            "dem/deep/c.h": "namespace selenograph::dem::deep {\nstruct Pit {\n};\nenum class Pit2 { kRow };\n}",
        }
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for path, text in files.items():
                (root / path).parent.mkdir(parents=True, exist_ok=True)
                (root / path).write_text(text, encoding="utf-8")
            found = defined_twice(root)
        self.assertEqual(found, ["selenograph::dem::Crater at dem/a.h:3, dem/deep/b.h:2"])

    def test_the_rules_match_the_folders(self):
        for room in ROOMS:
            self.assertTrue((ROOT / room).is_dir(), f"no folder {room}/")
        folders = {p.name for p in (ROOT / "engine").iterdir() if p.is_dir()}
        self.assertEqual(folders, set(ENGINE_FLOORS) - {""})
        for _, places in LIBRARIES:
            for place in places:
                there = (ROOT / place).is_dir() if place.endswith("/") else (ROOT / f"{place}.cpp").is_file()
                self.assertTrue(there, f"no {place}")

    def test_what_is_wrong_is_found(self):
        wrong = {
            "dem/support/cache.h": '#include "engine/renderer.h"',
            "engine/scene/mesh.h": '#include "engine/visibility/points/scene.h"',
            "engine/camera/view.cpp": '  #  include "engine/budget.h"',
            "engine/renderer.cpp": '#include "api/json/json_reader.h"',
            "engine/gui/window.cpp": '#include "engine/renderer.h"',
            "api/service.cpp": "#include <httplib.h>",
            "engine/verify/bare_kernel.cpp": "#include <embree4/rtcore.h>",
            "engine/visibility/points/scene.cpp": "#include <gdal_priv.h>",
            "dem/raster.cpp": "#include <hwy/highway.h>",
        }
        right = {
            "server/main.cpp": '#include "dem/support/cache.h"',
            "engine/verify/sweep.cpp": '#include "engine/renderer.h"',
            "engine/budget.cpp": '#include "engine/sensor/sensor.h"',
            "engine/visibility/embree/embree.cpp": "#include <embree4/rtcore.h>",
            "engine/camera/lens.cpp": '// #include "engine/renderer.h"\n#include <hwy/highway.h>',
        }
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for path, text in (wrong | right).items():
                (root / path).parent.mkdir(parents=True, exist_ok=True)
                (root / path).write_text("// A file.\n" + text + "\n", encoding="utf-8")
            found = faults(root)
        self.assertEqual(sorted(line.split(": ")[0] for line in found), sorted(f"{path}:2" for path in wrong))


if __name__ == "__main__":
    unittest.main()
