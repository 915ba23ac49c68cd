#!/usr/bin/env python3
"""What distributors need of the repository: package.xml for bloom, packaging/debian, one version."""

import json
import os
import re
import subprocess
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

REPOSITORY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))

# Packages of ROS Noetic that this one uses; their names are keys.
NOETIC = """catkin compressed_image_transport cv_bridge diagnostic_msgs diagnostic_updater
dynamic_reconfigure geometry_msgs image_geometry image_proc image_transport message_filters
message_generation message_runtime nav_msgs nodelet pluginlib rosbag rosbash roscpp rosgraph_msgs
roslaunch rospy rostest rosunit rviz sensor_msgs std_msgs std_srvs tf2 tf2_eigen tf2_msgs tf2_ros
visualization_msgs""".split()
# Keys of rosdep/base.yaml and rosdep/python.yaml that are defined for Ubuntu 20.04, with its package.
ROSDEP = {"benchmark": "libbenchmark-dev", "boost": "libboost-all-dev", "eigen": "libeigen3-dev",
          "iproute2": "iproute2", "libceres-dev": "libceres-dev", "libopencv-dev": "libopencv-dev",
          "nlohmann-json-dev": "nlohmann-json3-dev", "python3-matplotlib": "python3-matplotlib",
          "python3-numpy": "python3-numpy", "python3-yaml": "python3-yaml",
          "yaml-cpp": "libyaml-cpp-dev"}
# Dependencies of programs and tests only.
FOR_TESTS = {"benchmark", "compressed_image_transport", "image_geometry", "image_proc", "iproute2",
             "rospy", "rosunit", "rostest"}


def text(*path):
    with open(os.path.join(REPOSITORY, *path), encoding="utf-8") as file:
        return file.read()


def paragraph(control, head):
    return next(part for part in control.split("\n\n") if part.startswith(head))


def names(field, part):
    """The packages of a field, without versions."""
    value = re.search(rf"^{field}:((?:.|\n[ \t])*)", part, re.MULTILINE).group(1)
    return {re.split(r"[ (]", name.strip())[0] for name in value.split(",")}


class PackageTest(unittest.TestCase):
    def setUp(self):
        self.xml = ElementTree.fromstring(text("package.xml"))
        self.version = self.xml.findtext("version")
        self.control = text("packaging", "debian", "control")

    def test_every_dependency_is_known_to_noetic(self):
        keys = {node.text for node in self.xml if node.tag.endswith("depend")}
        self.assertEqual(keys - set(NOETIC) - set(ROSDEP), set())
        self.assertGreater(len(keys), 20)

    def test_test_dependencies_are_optional(self):
        for name in FOR_TESTS:
            tags = {node.tag for node in self.xml if node.text == name}
            self.assertEqual(tags, {"test_depend"}, name)

    def test_bloom_finds_licence_urls_and_version(self):
        licence = self.xml.find("license")
        self.assertEqual(licence.text, "BSD-3-Clause")
        self.assertTrue(os.path.isfile(os.path.join(REPOSITORY, licence.get("file"))))
        self.assertEqual({url.get("type") for url in self.xml.findall("url")},
                         {"website", "repository", "bugtracker"})
        self.assertRegex(self.version, r"^\d+\.\d+\.\d+$")
        self.assertFalse(os.path.exists(os.path.join(REPOSITORY, "debian")),
                         "bloom makes its own debian/")

    def test_changelog_has_a_section_of_the_version(self):
        sections = re.findall(r"^(.+)\n-{3,}$", text("CHANGELOG.rst"), re.MULTILINE)
        self.assertIn(sections[0].split()[0], {self.version, "Forthcoming"})
        released = [name for name in sections if name != "Forthcoming"]
        self.assertRegex(released[0], rf"^{re.escape(self.version)} \(\d{{4}}-\d\d-\d\d\)$")

    def test_nothing_is_downloaded_by_the_build(self):
        build = [os.path.join(folder, name)
                 for folder in (".", "cmake", "test", "examples", "packaging/debian")
                 for name in os.listdir(os.path.join(REPOSITORY, folder))
                 if name in ("CMakeLists.txt", "rules") or name.endswith(".cmake")]
        self.assertGreater(len(build), 3)
        for name in build:
            self.assertNotRegex(text(name), r"FetchContent|ExternalProject|file\(DOWNLOAD|curl|wget"
                                r"|git clone|https?://(?!www\.debian)", name)

    def test_debian_builds_what_setup_installs(self):
        """Each build dependency is one that scripts/setup installs: so tests run on the same."""
        setup = set(text("scripts", "setup").split())
        own = {"debhelper-compat", "dh-python", "python3"}
        self.assertEqual(names("Build-Depends", paragraph(self.control, "Source:")) - setup - own,
                         set())

    def compiler_calls(self, *options):
        """Of a build as debhelper's, whose type is None."""
        with tempfile.TemporaryDirectory() as build:
            subprocess.run(["cmake", "-S", REPOSITORY, "-B", build, "-DCMAKE_BUILD_TYPE=None",
                            "-DCMAKE_CXX_FLAGS=-O2", "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON",
                            "-DCMAKE_DISABLE_FIND_PACKAGE_catkin=ON",
                            "-DPOINT_LINE_ODOMETRY_UNITY_BUILD=OFF", *options],
                           stdout=subprocess.DEVNULL, check=True)
            with open(os.path.join(build, "compile_commands.json"), encoding="utf-8") as file:
                calls = [entry["command"] for entry in json.load(file)]
        self.assertGreater(len(calls), 100)
        return calls

    def test_packages_are_optimised(self):
        for call in self.compiler_calls("-DCATKIN_BUILD_BINARY_PACKAGE=ON"):
            self.assertRegex(call, r"-DNDEBUG .*-O2 .*-O3 ")
        self.assertIn("-DCATKIN_BUILD_BINARY_PACKAGE=ON", text("packaging", "debian", "rules"))

    def test_other_builds_have_the_flags_they_are_given(self):
        """Such as those of scripts/sanitize and scripts/fuzz, with assertions."""
        for call in self.compiler_calls():
            self.assertNotRegex(call, r"NDEBUG|-O3")

    def test_package_needs_no_compiler_and_no_headers(self):
        depends = names("Depends", paragraph(self.control, "Package:"))
        self.assertEqual({name for name in depends if name.endswith("-dev")}, set())
        self.assertIn("${shlibs:Depends}", depends)
        self.assertIn("CATKIN_ENABLE_TESTING=OFF", text("packaging", "debian", "rules"))

    def test_tools_of_developers_are_not_installed(self):
        installed = re.findall(r"install\((?:TARGETS|PROGRAMS|FILES|DIRECTORY)[^)]*\)",
                               text("CMakeLists.txt"))
        self.assertGreater(len(installed), 5)
        for call in installed:
            self.assertNotRegex(call, "benchmark|soak|fuzz|scripts/test", call)

    def test_offline_odometry_tells_the_version(self):
        from tool_fixture import find_program
        result = subprocess.run([find_program("offline_odometry"), "--version"],
                                stdout=subprocess.PIPE, universal_newlines=True, check=True)
        self.assertIn(f"point_line_odometry) {self.version}\n", result.stdout)
        self.assertRegex(result.stdout, "reads bags of version .*, recordings of format 1")


if __name__ == "__main__":
    unittest.main()
