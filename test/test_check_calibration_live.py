#!/usr/bin/env python3
"""check_calibration with a running camera, as its users run it."""

import os
import shutil
import subprocess
import tempfile
import unittest

from ros_fixture import local_host
from tool_fixture import find_program


class LiveCalibrationTest(unittest.TestCase):
    """A roscore of its own and the synthetic camera."""

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="point_line_calibration_")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.system = local_host(self.folder)
        self.addCleanup(self.system.close)

    def check(self, *arguments):
        return subprocess.run(
            [find_program("check_calibration"), "live", "--quiet", *arguments], timeout=120,
            env=self.system.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            universal_newlines=True)

    def test_live_camera(self):
        result = self.check()
        self.assertEqual(result.returncode, 2)
        self.assertIn("no ROS master answers", result.stderr)
        self.system.start_roscore()
        result = self.check("--ns", "absent")
        self.assertEqual(result.returncode, 2)
        self.assertIn("/absent/left/image_rect", result.stderr)
        self.system.start([find_program("synthetic_stereo"), "__ns:=/front", "__name:=camera",
                           "_scene:=street", "_wait_for_subscribers:=false", "_frame_rate_hz:=4"],
                          "camera")
        output = os.path.join(self.folder, "out")
        result = self.check("--ns", "front", "--seconds", "8", "-o", output, "--write")
        self.assertEqual(result.returncode, 0, result.stderr + self.system.log("camera"))
        self.assertIn("nothing to be corrected", result.stdout)
        self.assertEqual(sorted(os.listdir(output)), ["calibration.png", "left.yaml", "right.yaml"])


if __name__ == "__main__":
    unittest.main()
