#!/usr/bin/env python3
"""The pose of the odometry on a played camera is that of the built-in world."""

import sys
import time
import unittest

import numpy as np
import rospy
import rostest
from nav_msgs.msg import Odometry

FRAMES = 8
MAX_ERROR_M = 0.02


def position(message):
    p = message.pose.pose.position
    return np.array([p.x, p.y, p.z])


class CameraTest(unittest.TestCase):
    def setUp(self):
        self.estimated, self.true = {}, {}
        self.subscribers = [
            rospy.Subscriber("/stereo/odom", Odometry, self.keep, self.estimated),
            rospy.Subscriber("/ground_truth/odom", Odometry, self.keep, self.true)]

    @staticmethod
    def keep(message, messages):
        messages[message.header.stamp.to_nsec()] = message

    def test_pose_follows_the_camera(self):
        deadline = time.monotonic() + 40.0
        while len(self.common()) < FRAMES:
            self.assertLess(time.monotonic(), deadline,
                            f"{len(self.estimated)} poses, {len(self.true)} true ones")
            time.sleep(0.05)
        stamps = self.common()
        estimated = [position(self.estimated[stamp]) for stamp in stamps]
        true = [position(self.true[stamp]) for stamp in stamps]
        moved = np.linalg.norm(true[-1] - true[0])
        error = np.linalg.norm((estimated[-1] - estimated[0]) - (true[-1] - true[0]))
        self.assertGreater(moved, 0.05)
        self.assertLess(error, MAX_ERROR_M + 0.05 * moved)
        self.assertEqual(self.estimated[stamps[-1]].child_frame_id,
                         self.true[stamps[-1]].child_frame_id)

    def common(self):
        return sorted(set(self.estimated) & set(self.true))


if __name__ == "__main__":
    rospy.init_node("camera_test")
    rostest.rosrun("point_line_odometry", "camera_test", CameraTest, sys.argv)
