#!/usr/bin/env python3
"""examples/ as a package of its own, built with this one: its nodelet beside the odometry in a
manager. scripts/test_without_ros builds and runs the other example."""

import math
import os
import shutil
import subprocess
import tempfile
import unittest

import rospy
from point_line_odometry.msg import StereoFeatures
from ros_fixture import REPOSITORY, RosTest
from tool_fixture import wait_until
from sensor_msgs.msg import Range

EXAMPLES = os.path.join(REPOSITORY, "examples")


def build(folder):
    """Builds the package with the point_line_odometry of this environment; its devel space."""
    devel = os.path.join(folder, "devel")
    for command in (["cmake", "-S", EXAMPLES, "-B", folder, "-DCATKIN_DEVEL_PREFIX=" + devel,
                     "-DPYTHON_EXECUTABLE=/usr/bin/python3", "-DCMAKE_CXX_FLAGS=-Wall -Werror"],
                    ["cmake", "--build", folder, "--", "-j2"]):
        result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                universal_newlines=True)
        if result.returncode != 0:
            raise RuntimeError(f"{' '.join(command)}:\n{result.stdout}")
    return devel


class ExamplesTest(RosTest):
    EXTRA_PACKAGES = (EXAMPLES,)

    @classmethod
    def setUpClass(cls):
        folder = tempfile.mkdtemp(prefix="point_line_examples_")
        cls.addClassCleanup(shutil.rmtree, folder, ignore_errors=True)
        devel = build(folder)
        cls.minimal = os.path.join(folder, "minimal")
        # Where pluginlib looks for the library.
        os.environ["CMAKE_PREFIX_PATH"] = devel + ":" + os.environ["CMAKE_PREFIX_PATH"]
        super().setUpClass()

    def test_minimal_links_the_library(self):
        self.assertTrue(os.access(self.minimal, os.X_OK))
        result = subprocess.run([self.minimal], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                universal_newlines=True)
        self.assertEqual(result.returncode, 2)
        self.assertIn("usage: minimal", result.stderr)

    def test_the_consumer_gets_the_features(self):
        features, ranges = {}, {}
        for topic, kind, kept in (("features", StereoFeatures, features),
                                  ("consumer/nearest", Range, ranges)):
            subscriber = rospy.Subscriber(
                "/stereo/" + topic, kind,
                lambda message, kept=kept: kept.update({message.header.stamp: message}))
            self.addCleanup(subscriber.unregister)
        manager = self.start_manager()
        manager.load_odometry("/stereo/odometry")
        manager.load("/stereo/consumer", "point_line_odometry_examples/NodeletConsumer",
                     {"max_range": 50.0})
        self.start_camera("/stereo")
        wanted = 20

        def both():
            return sorted(stamp for stamp in features if stamp in ranges)

        self.assertTrue(wait_until(lambda: len(both()) >= wanted), manager.log()[-3000:])
        seen = 0
        for stamp in both():
            distances = [math.sqrt(p.x ** 2 + p.y ** 2 + p.z ** 2)
                         for p in self.still(features[stamp]) if p.z > 0.0]
            near = [distance for distance in distances if distance <= 50.0]
            message = ranges[stamp]
            self.assertEqual(message.header.frame_id, features[stamp].header.frame_id)
            if near:
                self.assertAlmostEqual(message.range, min(near), delta=1e-4)
                self.assertAlmostEqual(message.range, 8.0, delta=2.0)  # the wall
                seen += 1
            else:
                self.assertEqual(message.range, math.inf)
        self.assertGreater(seen, wanted // 2)

    @staticmethod
    def still(features):
        """Places of the features that agree with the motion of the camera."""
        yield from (point.point for point in features.points if point.inlier)
        for line in features.lines:
            if line.inlier:
                yield from (line.start, line.end)


if __name__ == "__main__":
    unittest.main()
