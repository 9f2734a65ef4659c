#!/usr/bin/env python3
"""The package says under which licences its parts are: deploy/operation/package/copyright (machine-readable, of Debian's
form) for what is in it, and the bill of materials that deploy/operation/package/spdx makes for the executable.
"""

import json
import os
import re
import shutil
import subprocess
import unittest

from harness import BINARY, REPOSITORY, main

PACKAGE = os.path.join(REPOSITORY, "deploy", "operation", "package")
# Packages that the build needs and nothing of which is in the executable, or only by another library of the list.
NOT_SHIPPED = {"zlib1g-dev": "cpp-httplib's", "libbrotli-dev": "cpp-httplib's"}
# In the executable if cpp-httplib's header calls it, as that of 0.18 does and that of 0.11 does not.
EITHER = {"libssl-dev"}


def paragraphs():
    with open(os.path.join(PACKAGE, "copyright")) as file:
        text = file.read()
    return [dict(re.findall(r"^([A-Za-z-]+):((?:.*)(?:\n[ \t].*)*)", part, re.M)) for part in text.split("\n\n")]


class Copyright(unittest.TestCase):
    def test_each_licence_has_its_text(self):
        texts = {p["License"].split("\n")[0].strip() for p in paragraphs() if "\n" in p.get("License", "")}
        for paragraph in paragraphs():
            for name in paragraph.get("License", "").split("\n")[0].split(" and "):
                if name.strip():
                    self.assertIn(name.strip(), texts)

    def test_files_exist(self):
        for paragraph in paragraphs():
            for name in paragraph.get("Files", "*").split():
                if name.startswith("share/selenograph/assets/"):
                    self.assertTrue(os.path.exists(os.path.join(REPOSITORY, "deploy", "assets", name.removeprefix("share/selenograph/assets/"))), name)

    def test_tables_in_the_program_have_their_sources(self):
        with open(os.path.join(PACKAGE, "copyright")) as file:
            text = file.read()
        folder = os.path.join(REPOSITORY, "engine", "radiometry")
        sources = {"astm_e490.csv": "ASTM E-490", "lime.csv": "LIME", "rolo.csv": "ROLO", "sato2014.csv": "Sato"}
        self.assertEqual({name for name in os.listdir(folder) if name.endswith(".csv")}, set(sources))
        for source in sources.values():
            self.assertIn(source, text)


@unittest.skipUnless(shutil.which("dpkg") and shutil.which("objdump"), "needs Debian's dpkg and binutils")
class BillOfMaterials(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        images = os.path.join(os.path.dirname(BINARY), "libselenograph_images.so")
        done = subprocess.run([os.path.join(PACKAGE, "spdx"), BINARY, images, "1.2.3"], check=True, stdout=subprocess.PIPE,
                              text=True)
        cls.document = json.loads(done.stdout)
        cls.packages = {p["name"]: p for p in cls.document["packages"]}

    def test_members_that_spdx_requires(self):
        for name in ("spdxVersion", "dataLicense", "SPDXID", "name", "documentNamespace", "creationInfo"):
            self.assertTrue(self.document[name], name)
        self.assertRegex(self.document["creationInfo"]["created"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")
        ids = {p["SPDXID"] for p in self.document["packages"]}
        self.assertEqual(len(ids), len(self.document["packages"]))
        for id_ in ids:
            self.assertRegex(id_, r"^SPDXRef-[A-Za-z0-9.-]+$")
        related = {r["relatedSpdxElement"] for r in self.document["relationships"]}
        self.assertEqual(related, ids)
        self.assertEqual(self.packages["selenograph"]["versionInfo"], "1.2.3")

    def test_all_libraries_of_the_build_are_in_it(self):
        with open(os.path.join(REPOSITORY, "deploy", "install-packages")) as file:
            needed = re.search(r"^build=\((.*?)^\)", file.read(), re.M | re.S)[1].split()
        libraries = [name for name in needed if name.startswith("lib") or name.endswith("-dev")]
        self.assertGreater(len(libraries), 20)

        def sources(names):
            said = subprocess.run(["dpkg-query", "-Wf", "${Package} ${source:Package}\n", *names], check=True, stdout=subprocess.PIPE, text=True)
            return dict(line.split() for line in said.stdout.splitlines())

        listed = set(sources(name for name in self.packages if name != "selenograph").values())
        for name, source in sources(set(libraries) - EITHER).items():
            self.assertNotEqual(source in listed, name in NOT_SHIPPED, name)

    def test_most_licences_are_known(self):
        licences = {name: p["licenseDeclared"] for name, p in self.packages.items()}
        self.assertEqual((licences["libeigen3-dev"], licences["nlohmann-json3-dev"]), ("MPL-2.0", "MIT"))
        self.assertLess(list(licences.values()).count("NOASSERTION"), len(licences) / 3)
        with open(os.path.join(PACKAGE, "copyright")) as file:
            text = file.read().replace("Expat", "MIT").lower()
        for relation in self.document["relationships"]:
            if relation["relationshipType"] == "STATIC_LINK":
                name = next(p["name"] for p in self.document["packages"] if p["SPDXID"] == relation["relatedSpdxElement"])
                self.assertIn(licences[name].lower(), text, name)


if __name__ == "__main__":
    main()
