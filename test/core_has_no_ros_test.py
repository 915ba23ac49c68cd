#!/usr/bin/env python3
"""The core compiles without ROS: none of its files includes a header of it, directly or not."""

import os
import re
import unittest

REPOSITORY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
CORE_FOLDERS = ["include", "src/common", "src/features", "src/map", "src/matching", "src/geometry",
                "src/motion", "src/odometry", "src/dataset", "src/world"]
SHELL_FOLDERS = {"src/ros", "src/tools", "src/benchmark"}
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', re.MULTILINE)
ROS = re.compile(r"^(ros|roscpp|rosbag|tf|tf2|tf2_\w+|\w+_msgs|\w+_srvs|cv_bridge|image_transport"
                 r"|image_geometry|message_filters|nodelet|pluginlib|dynamic_reconfigure"
                 r"|diagnostic_updater|xmlrpcpp|class_loader|topic_tools|camera_info_manager)/")
# Generated from this package's msg and srv folders.
GENERATED = {os.path.splitext(name)[0] for folder in ("msg", "srv")
             for name in os.listdir(os.path.join(REPOSITORY, folder))}


def includes(path):
    with open(path, encoding="utf-8") as file:
        return INCLUDE.findall(file.read())


def is_ros(name):
    folder, base = os.path.split(name)
    generated = re.sub(r"(Request|Response)?\.h$", "", base)
    return bool(ROS.match(name)) or (folder == "point_line_odometry" and generated in GENERATED)


def find_in_project(name, including):
    """The file of this repository that an include means, or None."""
    for folder in (os.path.dirname(including), os.path.join(REPOSITORY, "include"),
                   os.path.join(REPOSITORY, "src")):
        path = os.path.normpath(os.path.join(folder, name))
        if os.path.isfile(path):
            return path
    return None


def core_files():
    return [os.path.join(folder, name)
            for root in CORE_FOLDERS
            for folder, _, names in os.walk(os.path.join(REPOSITORY, root))
            for name in names if name.endswith((".h", ".hpp", ".cpp"))]


class CoreHasNoRos(unittest.TestCase):
    def test_every_folder_is_core_or_shell(self):
        folders = {"src/" + name for name in os.listdir(os.path.join(REPOSITORY, "src"))}
        core = {folder for folder in CORE_FOLDERS if folder.startswith("src/")}
        self.assertEqual(folders, core | SHELL_FOLDERS,
                         "name a new folder here, and in CONTRIBUTING.md")

    def test_the_core_is_found(self):
        names = {os.path.basename(path) for path in core_files()}
        for name in ("stereo_odometry.h", "stereo_odometry.cpp", "line_detector.cpp",
                     "point_matcher.cpp", "pluecker.cpp", "residuals.h", "dataset.cpp"):
            self.assertIn(name, names)

    def test_no_include_leads_to_ros(self):
        seen = set()
        waiting = [(path, [path]) for path in core_files()]
        while waiting:
            path, way = waiting.pop()
            if path in seen:
                continue
            seen.add(path)
            for name in includes(path):
                chain = " -> ".join([os.path.relpath(step, REPOSITORY) for step in way] + [name])
                self.assertFalse(is_ros(name), chain)
                inner = find_in_project(name, path)
                if inner:
                    in_shell = inner.startswith(os.path.join(REPOSITORY, "src", "ros"))
                    self.assertFalse(in_shell, chain)
                    waiting.append((inner, way + [inner]))

    def test_the_core_library_links_no_ros(self):
        with open(os.path.join(REPOSITORY, "CMakeLists.txt"), encoding="utf-8") as file:
            text = file.read()
        core = re.search(r"add_library\(\$\{PROJECT_NAME\}\n.*?(?=add_library\()", text, re.DOTALL)
        self.assertIsNotNone(core)
        self.assertNotIn("catkin_", core.group(0))
        for source in re.findall(r"\bsrc/[\w/]+\.cpp", core.group(0)):
            self.assertIn(os.path.dirname(source), CORE_FOLDERS)

    def test_what_counts_as_ros(self):
        for name in ("ros/ros.h", "sensor_msgs/Image.h", "tf2_ros/buffer.h",
                     "cv_bridge/cv_bridge.h", "rosbag/bag.h", "point_line_odometry/OdometryInfo.h",
                     "point_line_odometry/ResetToPoseRequest.h"):
            self.assertTrue(is_ros(name), name)
        for name in ("vector", "opencv2/core.hpp", "Eigen/Core", "point_line_odometry/types.h"):
            self.assertFalse(is_ros(name), name)


if __name__ == "__main__":
    unittest.main()
