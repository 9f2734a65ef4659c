"""The lists of files in READMEs hold every source of their folder, with the first sentence of its header.

Reads the sources; needs no build:   python3 tests/unit/file_tables_test.py [--write]
"""

import pathlib
import re
import sys
import tempfile
import textwrap
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
ROOMS = ["server", "api", "engine", "dem"]
# Programs of their own, with lists of their own.
CLIENTS = "api/clients/"
HEAD = "Files:\n\n"
LIST = re.compile(f"^{HEAD}(?:- `.*\n(?:  .*\n)*)*", re.MULTILINE)


def folders(root):
    """Files by folder and pair: a header and its source count as one, described by the header."""
    found = {}
    for room in ROOMS:
        for file in sorted((root / room).rglob("*")):
            if file.suffix in (".h", ".cpp") and not file.relative_to(root).as_posix().startswith(CLIENTS):
                pairs = found.setdefault(file.parent, {})
                if file.suffix == ".h" or file.stem not in pairs:
                    pairs[file.stem] = file
    return found


# What an item leaves out: a parenthesis, and a clause that explains.
ASIDE = re.compile(r" \(.*|, (?:which|because|as|where|so|whose|of which)\b.*")


def first_sentence(file):
    """What the comment at the top of a file begins with, up to a period, or to a colon after more than three words."""
    comment = []
    for line in file.read_text(encoding="utf-8").splitlines():
        if not line.startswith("//"):
            break
        comment.append(line[2:].strip())
    sentence = ASIDE.sub("", re.split(r"[.;](?:\s|$)", " ".join(comment))[0])
    start = sentence.partition(": ")[0]
    return (start if len(start.split()) > 3 else sentence).rstrip(":")


def file_list(pairs):
    items = (f"- `{name}`: {first_sentence(file)}" for name, file in sorted(pairs.items()))
    return HEAD + "".join(textwrap.fill(item, 120, subsequent_indent="  ", break_on_hyphens=False) + "\n" for item in items)


def stale(root):
    """READMEs whose list of files is missing or differs from the sources, with their text as it should be.

    A folder with a single pair needs no list. A README without one gets it at its end."""
    for folder, pairs in folders(root).items():
        page = folder / "README.md"
        if len(pairs) == 1:
            continue
        text = page.read_text(encoding="utf-8")
        made = file_list(pairs)
        new = LIST.sub(lambda _: made, text) if LIST.search(text) else f"{text.rstrip()}\n\n{made}"
        if new != text:
            yield page, new


def write():
    for page, text in stale(ROOT):
        page.write_text(text, encoding="utf-8")
        print(page.relative_to(ROOT))


class FileTables(unittest.TestCase):
    def test_lists_match_the_sources(self):
        pages = [page.relative_to(ROOT).as_posix() for page, _ in stale(ROOT)]
        self.assertEqual(pages, [], "written anew by: python3 tests/unit/file_tables_test.py --write")

    def test_a_stale_list_is_found(self):
        files = {
            "dem/a/one.h": "// One thing: its\n// parts; more.\n#pragma once\n",
            "dem/a/one.cpp": "// Not this.\n",
            "dem/a/two.cpp": "// Two things\n// in a row, which are two: more.\n",
            "dem/a/README.md": "# a\n\n" + HEAD + "- `gone`: what\n  went\n\nText.\n",
            "dem/b/one.h": "// Alone.\n",
        }
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for path, text in files.items():
                (root / path).parent.mkdir(parents=True, exist_ok=True)
                (root / path).write_text(text, encoding="utf-8")
            (page, text), = stale(root)
            items = "- `one`: One thing: its parts\n- `two`: Two things in a row\n"
            self.assertEqual(text, "# a\n\n" + HEAD + items + "\nText.\n")
            page.write_text(text, encoding="utf-8")
            self.assertEqual(list(stale(root)), [])


if __name__ == "__main__":
    write() if "--write" in sys.argv else unittest.main()
