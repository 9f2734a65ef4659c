"""Comments are sentences, statements stand alone, names say what they hold: what of that can be counted.

Reads the sources; needs no build:   python3 tests/unit/voice_test.py
"""

import pathlib
import re
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
ROOMS = ["server", "api", "engine", "dem"]

# First words of a comment that hide its subject.
FRAGMENT = re.compile(r"(Of|What|Where|Whether|Who|Whose|Which|Those|That|How|Whichever|As many|As if|By which|From which"
                      r"|In which|To which|With which|Than|Nor|Else)\b")
# Names that tell neither what a thing is nor what a function does.
EMPTY = set("kept asked met some look looked meet most least seen known all go way place one other many few beside beyond "
            "within told said taken given wanted whole part".split())
# Such names that are words of the field or of C++, by file.
WORDS_OF_THE_FIELD = {
    # The other operand of a comparison, of a move.
    "engine/cache/preparation.cpp": {"other"}, "engine/cache/preparation.h": {"other"},
    "server/service/admission.cpp": {"other"}, "server/service/admission.h": {"other"},
    "engine/limb/limb_in_view.cpp": {"other"},
    # Parts of a mesh, which have materials of their own.
    "engine/scene/object_shape.h": {"part", "place"}, "engine/visibility/objects/objects_in_frame.h": {"part"},
    # A search around a position, as in databases.
    "engine/sky/star_catalogue.h": {"within"},
    # Members that api/ and many tests use.
    "engine/limb/limb_in_view.h": {"known"},
    "engine/frame/map.h": {"look"}, "engine/rays/ray_queries.h": {"place"},
    "engine/verify/difference_statistics.h": {"all"}, "engine/verify/round_trip.h": {"place"},
}

COMMENT_LINE = re.compile(r"^\s*//(?!/)\s?(.*)$")
TRAILING_COMMENT = re.compile(r"[;{,)]\s+// (.*)$")
FOR_TOOLS = re.compile(r"(NOLINT|clang-format|namespace)")
DECLARATION = re.compile(r"(?:^|[(,;{ ])(?:const )?(?:auto|bool|int|double|float|std::[\w:<>, *&]+"
                         r"|[A-Z]\w+(?:<[\w:<>, *&]+>)?)[ *&]+(\w+)\s*(?=[=;,){(\[])")
BRACKETS = re.compile(r"\([^()]*\)|\[[^\[\]]*\]|\{[^{}]*\}|<[\w:, *&]*>")
# A declaration may name several variables.
DECLARES = re.compile(r"\s*(const|auto|static|using|return|throw|case|double|float|int|bool|std::|template"
                      r"|[\w:]+@? [*&]?\w+ ?[=,;@])")
ASSIGNS_OR_CALLS = re.compile(r"\s*(?:if @ |else |for @ )?(?:(?:\+\+|--)\w"
                              r"|[*]?[\w.:@>-]+(?:@|\s*[-+*/|&]?=[^=]|\+\+|--))")


def is_joined(code):
    """Whether a line holds statements that commas join. What stands in brackets does not count."""
    code = re.sub(r'"(?:[^"\\]|\\.)*"', "@", code.rstrip())
    while BRACKETS.search(code):
        code = BRACKETS.sub("@", code)
    if not code.endswith(";") or re.search(r"[(){}]", code) or DECLARES.match(code):
        return False
    statements = code.rstrip(";").split(",")
    return len(statements) > 1 and all(ASSIGNS_OR_CALLS.match(statement.strip()) for statement in statements)


def comments(lines):
    """(line number, text) of each block of comments, and of each comment behind code."""
    first, text = 0, []
    for number, line in enumerate([*lines, ""], 1):
        comment = COMMENT_LINE.match(line)
        if comment:
            first = first or number
            text.append(comment[1])
            continue
        if first:
            yield first, " ".join(text)
            first, text = 0, []
        trailing = TRAILING_COMMENT.search(line)
        if trailing:
            yield number, trailing[1]


def faults_of(path, text):
    lines = text.split("\n")
    for number, comment in comments(lines):
        if FRAGMENT.match(comment) and not FOR_TOOLS.match(comment):
            yield f"{path}:{number}: a comment without a subject: {comment[:60]}"
    for number, line in enumerate(lines, 1):
        code = line.split("//")[0]
        if is_joined(code):
            yield f"{path}:{number}: statements joined by a comma: {code.strip()[:60]}"
        for name in DECLARATION.findall(code):
            if name in EMPTY and name not in WORDS_OF_THE_FIELD.get(path, {}):
                yield f"{path}:{number}: a name that says nothing: {name}"


def faults(root):
    return [fault for room in ROOMS for file in sorted((root / room).rglob("*")) if file.suffix in (".h", ".cpp", ".hpp")
            for fault in faults_of(file.relative_to(root).as_posix(), file.read_text(encoding="utf-8"))]


class Voice(unittest.TestCase):
    def test_the_code_speaks_in_sentences(self):
        found = faults(ROOT)
        self.assertEqual(found, [], "\n" + "\n".join(found))

    def test_faults_are_found(self):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "dem" / "a.h"
            file.parent.mkdir()
            file.write_text("// Of the whole\n// block.\nint rows = 0;  // which are kept\nint a = 1, b = 2;\na = f(1, 2), b = 3;\n"
                            "if (a) f(b), ++a;\nf(a, b);\nfor (; a; ++a, --b) f(a);\nint kept = 0;\nvoid g(double way);\n"
                            "c = {1,\n     2};\n")
            numbers = [int(fault.split(":")[1]) for fault in faults(pathlib.Path(folder))]
        self.assertEqual(numbers, [1, 5, 6, 9, 10])


if __name__ == "__main__":
    unittest.main()
