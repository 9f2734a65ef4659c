"""One version number in all places, and no recorded answer changes after the release of a version.

Reads the sources; needs no build:   python3 tests/unit/version_test.py
"""

import hashlib
import pathlib
import re
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
RECORD = "tests/service/same_bytes.json"


def text(path):
    return (ROOT / path).read_text(encoding="utf-8")


def found(path, pattern):
    match = re.search(pattern, text(path), re.M)
    assert match, f"{path} has nothing like {pattern}"
    return match


VERSION = found("api/clients/python/selenograph/version.py", r'^__version__ = "(\d+\.\d+\.\d+)"$')[1]
MAJOR = VERSION.split(".")[0]
STATED = {  # by file: the whole version, or the major one
    "CITATION.cff": (r"^version: (.+)$", VERSION),
    "deploy/campaigns/kubernetes/campaign.yaml": (r"image: .*/selenograph:(\S+)$", VERSION),
    "api/versions.md": (r"`Server: selenograph/(\S+)`", VERSION),
    "api/clients/cpp/selenograph_client.hpp": (r"kServiceMajorVersion = (\d+);", MAJOR),
    "api/clients/matlab/selenograph_call.m": (r"MAJOR_VERSION = (\d+);", MAJOR),
}


class Versions(unittest.TestCase):
    def test_all_state_the_same(self):
        for path, (pattern, version) in STATED.items():
            with self.subTest(path):
                self.assertEqual(found(path, pattern)[1], version)

    def test_paths_are_of_the_major_version(self):
        paths = set(re.findall(r'"(/v\d+)/', text("api/v1.openapi.json")))
        self.assertEqual(paths, {f"/v{MAJOR}"})

    def test_what_is_packaged_takes_it_from_there(self):
        self.assertIn("version.py", text("CMakeLists.txt"))
        self.assertRegex(text("api/clients/python/pyproject.toml"), r'attr = "selenograph\.version\.__version__"')

    def test_changelog_starts_with_it(self):
        headings = re.findall(r"^## (.+)$", text("CHANGELOG.md"), re.M)
        number = re.escape(VERSION)
        self.assertRegex(headings[0], rf"^(\[Unreleased\]: {number}|\[{number}\] - \d{{4}}-\d\d-\d\d)$")

    def test_a_released_version_keeps_its_answers(self):
        section = re.split(r"^## ", text("CHANGELOG.md"), flags=re.M)[1]
        if section.startswith("[Unreleased]"):
            return
        line = f"Recorded answers: `{hashlib.sha256((ROOT / RECORD).read_bytes()).hexdigest()[:12]}`."
        self.assertTrue(line in section, f"{RECORD} is not the release's. Answers change with a new minor version, whose "
                        f"section says why. Below the heading of a new release goes: {line}")


if __name__ == "__main__":
    unittest.main(verbosity=2)
