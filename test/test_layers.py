#!/usr/bin/env python3
"""Includes point downwards only, no file includes itself through others, and what a header declares
is defined in the source of the same name."""

import os
import re
import tempfile
import unittest

REPOSITORY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
PACKAGE = "point_line_odometry"

# The folders of src/, each of which may include those before it. Up to checks: the core library.
LAYERS = ["common", "geometry", "features", "matching", "motion", "map", "odometry", "priors",
          "checks", "dataset", "world", "ros", "tools", "benchmark"]

# A public header belongs to the folder of its source. These have no source.
WITHOUT_SOURCE = {"prior_trust": "common", "tilt_correction": "common", "types": "common",
                  "version": "common"}

INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)
# Of what is no member, since it stands at the begin of a line: "Type name(...);" and "Type name(...) {".
FUNCTION = (r"^(?!inline|constexpr|using|return|namespace|template)[A-Za-z_][\w:<>,&* ]*[ &*](\w+)"
            r"\([^;{]*\)\s*")
DECLARATION = re.compile(FUNCTION + ";", re.MULTILINE)
DEFINITION = re.compile(FUNCTION + "{", re.MULTILINE)


class Sources:
    """The sources of a repository, by their names relative to it."""

    def __init__(self, root):
        self.root = root
        self.files = sorted(
            os.path.relpath(os.path.join(folder, name), root)
            for top in ("include", "src") for folder, _, names in os.walk(os.path.join(root, top))
            for name in names if name.endswith((".h", ".cpp")))

    def text(self, file):
        with open(os.path.join(self.root, file), encoding="utf-8") as stream:
            return stream.read()

    def includes(self, file):
        """The files of the repository that a file includes."""
        for name in INCLUDE.findall(self.text(file)):
            for folder in ("include", "src"):
                found = os.path.join(folder, name)
                if found in self.files:
                    yield found

    def source_of(self, header):
        """The source of the same name: beside the header, or anywhere for a public one."""
        name = os.path.splitext(os.path.basename(header))[0] + ".cpp"
        places = [file for file in self.files if os.path.basename(file) == name
                  and (header.startswith("include")
                       or os.path.dirname(file) == os.path.dirname(header))]
        return places[0] if places else None

    def layer(self, file):
        """The number of a file's folder in LAYERS."""
        if file.startswith("include"):
            name = os.path.splitext(os.path.basename(file))[0]
            source = self.source_of(file)
            folder = source.split(os.sep)[1] if source else WITHOUT_SOURCE[name]
        else:
            folder = file.split(os.sep)[1]
        return LAYERS.index(folder)

    def upward_includes(self):
        return [f"{file} includes {other}" for file in self.files for other in self.includes(file)
                if self.layer(other) > self.layer(file)]

    def cycle(self):
        """Files of which each includes the next and the last one the first; empty if there is no
        such cycle."""
        done, path = set(), []

        def visit(file):
            if file in path:
                return path[path.index(file):] + [file]
            if file in done:
                return []
            path.append(file)
            for other in self.includes(file):
                found = visit(other)
                if found:
                    return found
            done.add(path.pop())
            return []

        for file in self.files:
            found = visit(file)
            if found:
                return found
        return []

    def sources_without_header(self):
        headers = {os.path.splitext(os.path.basename(file))[0]
                   for file in self.files if file.endswith(".h")}
        return [file for file in self.files if file.endswith(".cpp")
                and os.path.splitext(os.path.basename(file))[0] not in headers
                and "\nint main(" not in self.text(file)]

    def defined_elsewhere(self):
        """Functions that a header declares and the source of its name does not define."""
        found = []
        for header in self.files:
            if not header.endswith(".h"):
                continue
            declared = set(DECLARATION.findall(self.text(header)))
            source = self.source_of(header)
            defined = set(DEFINITION.findall(self.text(source))) if source else set()
            found += [f"{header}: {name}()" for name in sorted(declared - defined)]
        return found


class Layers(unittest.TestCase):
    maxDiff = None
    sources = Sources(REPOSITORY)

    def test_every_folder_is_a_layer(self):
        folders = os.listdir(os.path.join(REPOSITORY, "src"))
        self.assertEqual(sorted(folders), sorted(LAYERS), "name a new folder here and in CONTRIBUTING")

    def test_includes_point_downwards(self):
        self.assertEqual(self.sources.upward_includes(), [])

    def test_no_cycle(self):
        self.assertEqual(self.sources.cycle(), [])

    def test_a_source_has_a_header_of_its_name(self):
        self.assertEqual(self.sources.sources_without_header(), [])

    def test_a_source_defines_what_its_header_declares(self):
        self.assertEqual(self.sources.defined_elsewhere(), [])


class TheTestCanFail(unittest.TestCase):
    def sources(self, files):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        for name, text in files.items():
            path = os.path.join(folder.name, name)
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, "w", encoding="utf-8") as stream:
                stream.write(text)
        return Sources(folder.name)

    def test_by_an_upward_include(self):
        sources = self.sources({"src/map/map.h": '#include "odometry/result.h"\n',
                                "src/odometry/result.h": '#include "common/join.h"\n',
                                "src/common/join.h": ""})
        self.assertEqual(sources.upward_includes(),
                         ["src/map/map.h includes src/odometry/result.h"])

    def test_by_an_upward_include_of_a_public_header(self):
        header = f"include/{PACKAGE}/result.h"
        sources = self.sources({header: "", "src/odometry/result.cpp": "",
                                "src/map/map.h": f'#include "{PACKAGE}/result.h"\n'})
        self.assertEqual(sources.upward_includes(), [f"src/map/map.h includes {header}"])

    def test_by_a_cycle(self):
        sources = self.sources({"src/map/a.h": '#include "map/b.h"\n',
                                "src/map/b.h": '#include "map/c.h"\n',
                                "src/map/c.h": '  #  include "map/b.h"\n'})
        self.assertEqual(sources.cycle(), ["src/map/b.h", "src/map/c.h", "src/map/b.h"])

    def test_by_a_source_without_a_header(self):
        sources = self.sources({"src/map/a.cpp": "", "src/tools/b.cpp": "\nint main() {}\n"})
        self.assertEqual(sources.sources_without_header(), ["src/map/a.cpp"])

    def test_by_a_function_that_is_defined_elsewhere(self):
        sources = self.sources({
            "src/map/a.h": "const A& f(int x);\n\nstd::vector<A> g(A a,\n    B b);\n"
                           "inline int h() { return 1; }\n",
            "src/map/a.cpp": "const A& f(int x) {\n}\n", "src/map/b.cpp": "std::vector<A> g(A a) {}\n"})
        self.assertEqual(sources.defined_elsewhere(), ["src/map/a.h: g()"])


if __name__ == "__main__":
    unittest.main()
