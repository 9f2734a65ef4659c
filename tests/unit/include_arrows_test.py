"""Includes point downwards, no two files include each other, no folder is crowded, each foreign library has one home,
no line is too long; pages about the code name what exists.

Reads the sources; needs no build:   python3 tests/unit/include_arrows_test.py
"""

import pathlib
import re
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]

# Capabilities of the engine: each includes floors below all of them, and another capability only along an arrow here.
# An arrow leads down this list.
CAPABILITIES = {
    "engine/frames": {"engine/sky", "engine/rays"},
    "engine/horizons": {"engine/sky"},
    "engine/maps": {"engine/hazard"},
    "engine/lidar": {"engine/rays"},
    "engine/limb": {"engine/rays"},
    "engine/sky": {"engine/rays"},
    "engine/hazard": set(),
    "engine/rays": set(),
}
# Folders with sources, top floor first: a file may include files of its own folder and of the folders below.
FLOORS = [
    "server", "server/commands", "server/campaign", "server/service", "server/http",
    "api", "api/document", "api/endpoints", "api/answers", "api/requests", "api/requests/parts",
    "api/schema", "api/assets", "api/encode", "api/json", "api/message",
    "engine/verify", "engine",
    *CAPABILITIES,
    "engine/cache", "engine/sensor", "engine/visibility/zbuffer", "engine/visibility/raytrace",
    "engine/visibility/image", "engine/visibility/meshes", "engine/visibility/objects", "engine/visibility/points",
    "engine/visibility/embree", "engine/indirect", "engine/relief", "engine/scene", "engine/radiometry", "engine/camera",
    "engine/frame", "engine/support",
    "dem/map_error", "dem/detail", "dem/terrain", "dem/pyramid", "dem/posts", "dem/catalogue", "dem/value_maps", "dem/sample", "dem/gdal",
    "dem/files", "dem/grid", "dem/base",
]
ROOMS = ["server", "api", "engine", "dem"]
# Programs of their own, which use the service as a client does.
CLIENTS = "api/clients/"
# File pairs (a header and its source count as one) that a folder may hold.
MOST_PAIRS = 24

# What a foreign header is called, and the files that may include it: a folder (with a slash) or a pair of files.
LIBRARIES = [
    (r"embree\d/", ["engine/visibility/embree/embree"]),
    (r"(gdal|ogr|cpl_)", ["dem/gdal/"]),
    (r"httplib", ["server/http/http_server", "server/http/connection"]),
    (r"hwy/", ["engine/", "dem/posts/post_kernels", "dem/grid/normal_kernels", "dem/value_maps/value_map_kernels",
               "dem/detail/detail_kernels"]),
    (r"assimp/", ["engine/visibility/meshes/mesh_file"]),
    (r"erfa", ["engine/sky/"]),
    (r"GeographicLib/", ["server/commands/place"]),
    (r"libnova/", ["engine/sky/sky_observer"]),
    (r"OpenImageIO/", ["api/encode/encode_image"]),
    (r"zip\.h", ["api/"]),
    (r"nlohmann/", ["api/", "server/"]),
    (r"archive", ["server/campaign/tar"]),
    (r"spdlog/", ["api/", "server/"]),
    (r"xxhash", ["dem/base/hash"]),
    (r"jemalloc/", ["engine/support/heap"]),
    (r"CLI/", ["server/commands/command_line", "server/commands/config", "server/commands/options"]),
]
# Costly to compile: never in a header.
IN_SOURCES_ONLY = r"(CLI/|spdlog/(?!fwd))"
LONGEST_LINE = 120
# Written by the program, a paragraph per line.
WRITTEN = ("api/requests.md",)

# Pages about the code: a name there is a file, a word of the sources, or a test.
PAGES_OF_NAMES = ("engine/architecture.md", "engine/threads.md", "engine/glossary.md",
                  "engine/scene/level_of_detail.md")
QUOTED = re.compile(r"`([^`\n]+)`")
PICTURE = re.compile(r"```mermaid\n(.*?)```", re.DOTALL)
# In a picture: a folder, a qualified name, one in snake_case or in CamelCase.
DRAWN = re.compile(r"(?:server|api|engine|dem)(?:/\w+)+|(?:\w+::)+\w+|[a-z]+(?:_[a-z]+)+|(?:[A-Z][a-z]+){2,}")
PATH = re.compile(r"[\w./-]*/[\w./-]*|\w+\.(?:h|cpp|md|py)")
TEST_NAME = re.compile(r"(\w+)\.(\w+)")
NAMESPACES = {"api", "engine", "dem"}
CODE_NAME = re.compile(r"[A-Za-z_]\w*(?:::\w+)*")

INCLUDE = re.compile(r'^\s*#\s*include\s*(?:"([^"]+)"|<([^>]+)>)')

# At the left border: members are indented, forward declarations end in a semicolon.
CLASS = re.compile(r"^(?:class|struct|union|enum class|enum) (?:alignas\(\w+\) )?(\w+)\b(?!.*;\s*$)")
NAMESPACE = re.compile(r"^namespace (\S+) \{")


def folder_of(path):
    return path.rsplit("/", 1)[0]


def pair_of(path):
    return path.rsplit(".", 1)[0]


def may_hold(path, places):
    return any(path.startswith(place) if place.endswith("/") else pair_of(path) == place for place in places)


def fault(path, own, foreign):
    """Why a file must not have an include, or None."""
    if own:
        here, there = folder_of(path), folder_of(own)
        for folder in (here, there):
            if folder not in FLOORS:
                return f"{folder}/ is on no floor"
        beside = here != there and there in CAPABILITIES and there not in CAPABILITIES.get(here, CAPABILITIES)
        upward = FLOORS.index(there) < FLOORS.index(here)
        return f"{here}/ must not include {there}/" if upward or beside else None
    if path.endswith(".h") and re.match(IN_SOURCES_ONLY, foreign):
        return f"<{foreign}> does not belong into a header"
    for header, places in LIBRARIES:
        if re.match(header, foreign) and not may_hold(path, places):
            return f"<{foreign}> belongs into {' or '.join(places)}"
    return None


def sources(root):
    """Paths of all sources, below the root."""
    for room in ROOMS:
        for file in sorted((root / room).rglob("*")):
            path = file.relative_to(root).as_posix()
            if file.suffix in (".h", ".cpp", ".hpp") and not path.startswith(CLIENTS):
                yield path


def includes(root):
    """(path, line number, own header or None, foreign header or None) of all includes."""
    for path in sources(root):
        for number, line in enumerate((root / path).read_text(encoding="utf-8").splitlines(), 1):
            include = INCLUDE.match(line)
            if include:
                yield path, number, include[1], include[2]


def faults(root):
    found = []
    for path, number, own, foreign in includes(root):
        why = fault(path, own, foreign)
        if why:
            found.append(f"{path}:{number}: {why}")
    return found


def cycle(root):
    """File pairs that include each other in a circle, in the order of their includes; empty: there is none."""
    below = {}
    for path, _, own, _ in includes(root):
        if own and pair_of(own) != pair_of(path):
            below.setdefault(pair_of(path), set()).add(pair_of(own))
    done, way = set(), []

    def walk(pair):
        if pair in way:
            return way[way.index(pair):]
        if pair in done:
            return []
        way.append(pair)
        for other in sorted(below.get(pair, ())):
            found = walk(other)
            if found:
                return found
        done.add(way.pop())
        return []

    for pair in sorted(below):
        found = walk(pair)
        if found:
            return found
    return []


def crowded(root):
    """Folders with more file pairs than MOST_PAIRS, and how many they hold."""
    pairs = {}
    for path in sources(root):
        pairs.setdefault(folder_of(path), set()).add(pair_of(path))
    return {folder: len(held) for folder, held in pairs.items() if len(held) > MOST_PAIRS}


def defined_twice(root):
    """Two definitions of one class in the headers: the linker takes one of their functions for both, in silence."""
    places = {}
    for path in sources(root):
        namespace = ""
        for number, line in enumerate((root / path).read_text(encoding="utf-8").splitlines(), 1):
            opened, defined = NAMESPACE.match(line), CLASS.match(line)
            if opened:
                namespace = opened[1]
            elif defined and path.endswith(".h"):
                places.setdefault(f"{namespace}::{defined[1]}", []).append(f"{path}:{number}")
    return [f"{name} at {', '.join(where)}" for name, where in sorted(places.items()) if len(where) > 1]


def is_long(path, line):
    """Tables and pictures in Markdown may be long: they cannot be broken."""
    return len(line) > LONGEST_LINE and not (path.endswith(".md") and line.lstrip().startswith(("|", "![")))


def long_lines(root):
    """Too long lines of C++ in the four rooms, of CMake and of Markdown."""
    files = list(sources(root))
    for file in sorted([*root.rglob("CMakeLists.txt"), *root.rglob("*.cmake"), *root.rglob("*.md")]):
        path = file.relative_to(root).as_posix()
        if not path.startswith(("build", ".")) and path not in WRITTEN:
            files.append(path)
    return [f"{path}:{number}" for path in files
            for number, line in enumerate((root / path).read_text(encoding="utf-8").splitlines(), 1)
            if is_long(path, line)]


def names_of(page):
    """Names of code on a page, in backticks and in pictures."""
    for picture in PICTURE.findall(page):
        yield from DRAWN.findall(picture)
    for quoted in QUOTED.findall(re.sub(r"```.*?```", "", page, flags=re.DOTALL)):
        yield quoted.removesuffix("()")


def unknown_names(root):
    """Names on PAGES_OF_NAMES of files, functions, types and tests that do not exist."""
    code = {path: set(re.findall(r"\w+", re.sub(r"//.*", "", (root / path).read_text(encoding="utf-8"))))
            for path in sources(root)}
    tests = [path for kind in ("cpp", "py") for path in (root / "tests").rglob(f"*_test.{kind}")]
    cases = {".".join(case) for path in tests
             for case in re.findall(r"TEST(?:_F|_P)?\((\w+), (\w+)\)", path.read_text(encoding="utf-8"))}
    files = {f"{path.parent.name}.{path.stem.removesuffix('_test')}" for path in tests}

    def exists(name, page):
        if PATH.fullmatch(name):
            return any((folder / name).exists() for folder in (root, page.parent))
        if TEST_NAME.fullmatch(name):
            return name in cases | files
        if not CODE_NAME.fullmatch(name):
            return True
        return any(set(name.split("::")) - NAMESPACES <= words for words in code.values())

    return [f"{page}: {name}" for page in PAGES_OF_NAMES
            for name in names_of((root / page).read_text(encoding="utf-8")) if not exists(name, root / page)]


class IncludeArrows(unittest.TestCase):
    def test_includes_point_downwards(self):
        found = faults(ROOT)
        self.assertEqual(found, [], "\n" + "\n".join(found))

    def test_no_files_include_each_other(self):
        found = cycle(ROOT)
        self.assertEqual(found, [], "\n" + " ->\n".join(found + found[:1]))

    def test_no_folder_is_crowded(self):
        self.assertEqual(crowded(ROOT), {})

    def test_lines_fit_the_screen(self):
        self.assertEqual(long_lines(ROOT), [])

    def test_long_lines_are_found(self):
        files = {"dem/a.h": "x" * 121, "CMakeLists.txt": "x" * 120, "dem/x.cmake": "x" * 121,
                 "README.md": "| " + "x" * 121 + "\n![" + "x" * 121 + "\n" + "x" * 121}
        self.assertEqual(self.result_of(long_lines, files), ["dem/a.h:1", "README.md:3", "dem/x.cmake:1"])

    def test_links_between_pages_lead_somewhere(self):
        for page in ROOT.rglob("*.md"):
            if page.relative_to(ROOT).parts[0].startswith(("build", ".")):
                continue
            for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
                if "://" not in link:
                    self.assertTrue((page.parent / link).exists(), f"{page}: {link}")

    def test_pages_name_what_exists(self):
        self.assertEqual(unknown_names(ROOT), [])

    def test_a_wrong_name_is_found(self):
        files = {page: "" for page in PAGES_OF_NAMES} | {
            "dem/grid/a.h": "struct Block { int level(); };  // once Brick",
            "tests/unit/mesh_test.cpp": "TEST_F(Mesh, IsClosed) {",
            "engine/glossary.md": "`Block::level`, `Block()`, `Brick`, `Block::rank`, `dem/grid/a.h`, `dem/grid/b.h`\n"
                                  "`Mesh.IsClosed`, `Mesh.IsOpen`, `unit.mesh`, `unit.brick`, `two words`\n"
                                  "```mermaid\na[\"dem/grid: Block\"] --> b[\"dem/void, find_brick\"]\n```",
        }
        names = [line.split(": ")[1] for line in self.result_of(unknown_names, files)]
        self.assertEqual(names, ["dem/void", "find_brick", "Brick", "Block::rank", "dem/grid/b.h", "Mesh.IsOpen", "unit.brick"])

    def test_a_cycle_is_found(self):
        files = {
            "dem/grid/a.h": '#include "dem/grid/b.h"',
            "dem/grid/b.cpp": '#include "dem/grid/b.h"\n#include "dem/grid/c.h"',
            "dem/grid/c.h": '#include "dem/grid/a.h"',
            "dem/grid/d.h": '#include "dem/grid/a.h"',
        }
        self.assertEqual(self.result_of(cycle, files), ["dem/grid/a", "dem/grid/b", "dem/grid/c"])
        del files["dem/grid/c.h"]
        self.assertEqual(self.result_of(cycle, files), [])

    def test_a_crowded_folder_is_found(self):
        files = {f"dem/grid/file{i}.{kind}": "" for i in range(MOST_PAIRS) for kind in ("h", "cpp")}
        self.assertEqual(self.result_of(crowded, files), {})
        files["dem/grid/one_more.h"] = ""
        self.assertEqual(self.result_of(crowded, files), {"dem/grid": MOST_PAIRS + 1})

    @staticmethod
    def result_of(check, files):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for path, text in files.items():
                (root / path).parent.mkdir(parents=True, exist_ok=True)
                (root / path).write_text(text + "\n", encoding="utf-8")
            return check(root)

    def test_a_class_has_one_definition(self):
        found = defined_twice(ROOT)
        self.assertEqual(found, [], "\n" + "\n".join(found))

    def test_a_second_definition_is_found(self):
        files = {
            "dem/a.h": "namespace selenograph::dem {\nclass Crater;\nstruct Crater {\n};\nstruct Pit {};\n}",
            "dem/deep/b.h": "namespace selenograph::dem {\nclass Crater final : Base {\n  struct Row {};\n};\n}",
            "dem/deep/c.h": "namespace selenograph::dem::deep {\nstruct Pit {\n};\nenum class Pit2 { kRow };\n}",
        }
        found = self.result_of(defined_twice, files)
        self.assertEqual(found, ["selenograph::dem::Crater at dem/a.h:3, dem/deep/b.h:2"])

    def test_the_rules_match_the_folders(self):
        self.assertEqual({folder_of(path) for path in sources(ROOT)}, set(FLOORS))
        for _, places in LIBRARIES:
            for place in places:
                there = (ROOT / place).is_dir() if place.endswith("/") else any(ROOT.glob(place + ".*"))
                self.assertTrue(there, f"no {place}")

    def test_wrong_includes_are_found(self):
        wrong = {
            "dem/base/cache.h": '#include "engine/renderer.h"',
            "engine/scene/mesh.h": '#include "engine/visibility/points/scene.h"',
            "engine/camera/view.cpp": '  #  include "engine/cache/budget.h"',
            "engine/renderer.cpp": '#include "api/json/json_reader.h"',
            "engine/gui/window.cpp": '#include "engine/renderer.h"',
            "engine/lidar/echo.cpp": '#include "engine/sky/magnitudes.h"',
            "api/message/problem.h": '#include "api/service.h"',
            "api/service.cpp": "#include <httplib.h>",
            "engine/verify/bare_kernel.cpp": "#include <embree4/rtcore.h>",
            "engine/visibility/points/scene.cpp": "#include <gdal_priv.h>",
            "engine/visibility/meshes/mesh_file.cpp": "#include <nlohmann/json.hpp>",
            "dem/files/raster.cpp": "#include <hwy/highway.h>",
            "dem/files/stamp.cpp": "#include <xxhash.h>",
        }
        right = {
            "server/main.cpp": '#include "dem/base/cache.h"',
            "engine/verify/sweep.cpp": '#include "engine/renderer.h"',
            "engine/frames/render_frame.cpp": '#include "engine/sky/sky_image.h"',
            "engine/visibility/embree/embree.cpp": "#include <embree4/rtcore.h>",
            "engine/camera/lens.cpp": '// #include "engine/renderer.h"\n#include <hwy/highway.h>',
            "api/clients/cpp/example.cpp": "#include <httplib.h>",
        }
        files = {path: "// A file.\n" + text for path, text in (wrong | right).items()}
        found = self.result_of(faults, files)
        self.assertEqual(sorted(line.split(": ")[0] for line in found), sorted(f"{path}:2" for path in wrong))


if __name__ == "__main__":
    unittest.main()
