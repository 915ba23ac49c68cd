#!/usr/bin/env python3
"""The doctor from its users' view: the tool on a live synthetic camera, and the report of the nodelet."""

import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

import rosbag

from doctor_fixture import SUBJECTS, SUBJECTS_OF_NODE, ReportChecks, parse
from ros_fixture import REPOSITORY, local_host
from tool_fixture import find_program, run, wait_until

LIVE_S = 60.0


class SystemTest(unittest.TestCase):
    """With a roscore of its own."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="point_line_doctor_")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.system = local_host(cls.folder)
        cls.addClassCleanup(cls.system.close)
        cls.system.start_roscore()


class LiveTest(SystemTest, ReportChecks):
    """The synthetic camera, the tool and the nodelet."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.camera = cls.system.start(
            [find_program("synthetic_stereo"), "__ns:=stereo", "__name:=camera", "_scene:=street",
             "_wait_for_subscribers:=false", "_frame_rate_hz:=2"], "camera")
        if not wait_until(lambda: parse(cls.doctor().stdout)["left image"][0] == "ok"):
            raise RuntimeError("no images: " + cls.system.log("camera"))

    @classmethod
    def doctor(cls, *arguments):
        return subprocess.run([find_program("doctor"), "--seconds", "6", *arguments],
                              env=cls.system.environment, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, universal_newlines=True, timeout=LIVE_S)

    def check_live(self, failed, *arguments):
        result = self.doctor(*arguments)
        self.check(result.stdout, failed)
        self.assertEqual(result.returncode, 1 if failed else 0, result.stdout + result.stderr)

    def run_node(self, ns="stereo", player=None):
        """The odometry's node for a while; returns its log, the messages of its topic doctor, and
        its last status of each kind."""
        record = os.path.join(self.folder, "doctor.bag")
        recorder = self.system.start(
            ["rosbag", "record", "-O", record, f"/{ns}/doctor", "/diagnostics"], "record_doctor")
        time.sleep(2.0)
        processes = [self.system.start([find_program("stereo_odometry"), f"__ns:={ns}"], "node")]
        if player:
            time.sleep(1.0)
            processes.append(self.system.start(player, "player"))
        time.sleep(12.0)
        for process in reversed(processes):
            self.system.end(process)
        self.system.end_recording(recorder, record)
        reports, diagnostics = [], {}
        with rosbag.Bag(record) as bag:
            for topic, message, _ in bag.read_messages():
                if topic.endswith("/doctor"):
                    reports.append(message)
                for status in message.status if topic == "/diagnostics" else []:
                    diagnostics[status.name.rpartition(": ")[2]] = status
        os.remove(record)
        return self.system.log("node"), reports, diagnostics

    def test_healthy(self):
        self.check_live({})

    def test_swapped_topics(self):
        swap = [f"{a}/{name}:={b}/{name}" for a, b in (("left", "right"), ("right", "left"))
                for name in ("image_rect", "camera_info")]
        swap = ["/stereo/" + s.replace(":=", ":=/stereo/") for s in swap]
        self.check_live({"calibration": ("ERROR", "swapped"), "disparity": ("ERROR", "swapped")},
                     *swap)

    def test_takes_the_topics_of_the_node(self):
        """A launch file gives the node the topics of a driver with other names."""
        topics = [f"{side}/{name}:=/stereo/{side}/{name}" for side in ("left", "right")
                  for name in ("image_rect", "camera_info")]
        node = self.system.start([find_program("stereo_odometry"), "__ns:=driven", *topics], "driven")
        try:
            self.assertTrue(wait_until(lambda: subprocess.run(
                ["rosparam", "get", "/driven/stereo_odometry/remappings/right_camera_info"],
                env=self.system.environment, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL).returncode == 0))
            self.check_live({}, "--ns", "driven")
        finally:
            self.system.end(node)
        self.check_live({}, "--ns", "driven")

    def test_missing_topics(self):
        self.check_live({"left image": ("ERROR", "/stereo/left/image_raw", "set rectify to false"),
                      "right image": ("ERROR", "/stereo/right/image_raw", "set rectify to false")},
                     "--rectify")
        nothing = "nothing arrives on /elsewhere/"
        self.check_live({subject: ("ERROR", nothing) for subject in SUBJECTS[:4]}, "--ns", "elsewhere")

    def test_missing_transform(self):
        self.check_live({"tf": ("ERROR", "no transform from robot to left_camera")},
                     "--base-frame", "robot")

    def test_another_publisher_of_the_same_frame(self):
        """As wheel odometry does; before the odometry runs, and by its node."""
        message = ("{transforms: [{header: {frame_id: odom}, child_frame_id: base_link, "
                   "transform: {rotation: {w: 1.0}}}]}")
        wheels = self.system.start(["rostopic", "pub", "-r", "20", "/tf", "tf2_msgs/TFMessage",
                                    message, "__name:=wheels"], "wheels")
        self.addCleanup(self.system.end, wheels)
        time.sleep(1.0)
        words = "wheels publishes the pose of base_link in odom"
        self.check_live({"tf": ("WARN", words, "publish_tf: false")})
        _, reports, _ = self.run_node()
        line = reports[-1].status[SUBJECTS_OF_NODE.index("tf")]
        self.assertEqual(line.level, 2, line)
        self.assertIn(words, line.message)

    def test_nodelet_reports_that_all_is_well(self):
        log, reports, diagnostics = self.run_node()
        self.assertEqual(log.count("s after the start"), len(reports))
        self.assertRegex(log, r"doctor, [2-4] s after the start: all is well")
        last = reports[-1]
        self.assertEqual([status.name.partition(": ")[2] for status in last.status],
                         SUBJECTS_OF_NODE)
        self.assertEqual({status.level for status in last.status}, {0}, last)
        values = {value.key: value.value for name in ("input", "calibration")
                  for value in diagnostics[name].values}
        for key in ("left image rate [1/s]", "skew of left and right [ms]", "baseline [m]",
                    "vertical disparity, absolute [px]", "disparity [px]",
                    "time per frame [ms]"):
            self.assertIn(key, values)
        self.assertLess(float(values["vertical disparity, absolute [px]"]), 0.5)

    def test_nodelet_reports_that_nothing_arrives_and_recovers(self):
        os.kill(self.camera.pid, signal.SIGSTOP)
        self.addCleanup(os.kill, self.camera.pid, signal.SIGCONT)
        resume = subprocess.Popen(["bash", "-c", f"sleep 7; kill -CONT {self.camera.pid}"])
        self.addCleanup(resume.wait)
        log, reports, _ = self.run_node()
        self.assertGreaterEqual(len(reports), 2, log)
        self.assertLessEqual(len(reports), 4, "it does not spam")
        first, last = reports[0], reports[-1]
        self.assertEqual([status.level for status in first.status[:2]], [2, 2])
        self.assertIn("nothing arrives on /stereo/left/image_rect", first.status[0].message)
        self.assertEqual(first.status[5].level, 3, "images are not known yet")
        self.assertEqual([status.level for status in last.status[:2]], [0, 0], log)

    def test_nodelet_warns_of_vertical_disparity(self):
        made, shifted = (os.path.join(self.folder, name) for name in ("made.bag", "shifted.bag"))
        result = run("dataset_to_bag", "synthetic:street,frames=20", made, "--namespace", "shifted",
                     "--quiet")
        self.assertEqual(result.returncode, 0, result.stderr)
        with rosbag.Bag(made) as source, rosbag.Bag(shifted, "w") as target:
            for topic, message, stamp in source.read_messages():
                if topic == "/shifted/right/image_rect":
                    message.data = message.data[4 * message.step:] + bytes(4 * message.step)
                target.write(topic, message, stamp)
        log, reports, diagnostics = self.run_node(
            "shifted", ["rosbag", "play", "-q", "-r", "0.3", shifted])
        calibration = diagnostics["calibration"]
        self.assertGreaterEqual(calibration.level, 1, calibration)
        match = re.search(r"images are not rectified: vertical disparity of matched points is ([\d.]+) px",
                          calibration.message)
        self.assertIsNotNone(match, calibration)
        self.assertAlmostEqual(float(match.group(1)), 4.0, delta=0.3)
        self.assertEqual(reports[-1].status[SUBJECTS_OF_NODE.index("rectification")].level, 1,
                         reports[-1])
        self.assertIn("images are not rectified", log)


class SideBySideTest(SystemTest):
    """A USB camera that shows both images in one, which the nodelet SideBySide cuts in two."""

    # Moves the images by some columns, as a driver that begins in the middle of a row.
    MOVE = """
import rospy
from sensor_msgs.msg import Image
def move(image):
    shift, step, data = 3 * 50, image.step, image.data
    rows = [data[i * step:(i + 1) * step] for i in range(image.height)]
    image.data = b"".join(row[shift:] + row[:shift] for row in rows)
    publisher.publish(image)
rospy.init_node("move")
publisher = rospy.Publisher("/moved/image_raw", Image, queue_size=2)
rospy.Subscriber("/usb_cam/image_raw", Image, move)
rospy.spin()
"""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.system.start([find_program("synthetic_stereo"), "__name:=camera", "_as:=stereo_usb",
                          "_scene:=indoor", "_wait_for_subscribers:=false", "_frame_rate_hz:=3"],
                         "camera")
        cls.system.start(["/usr/bin/python3", "-c", cls.MOVE], "move")

    def check_cut(self, ns, image, swap):
        """The lines on images that are cut so."""
        files = [os.path.join(REPOSITORY, "config", "cameras", f"stereo_usb_{side}.yaml")
                 for side in ("left", "right")]
        cut = self.system.start(
            ["rosrun", "nodelet", "nodelet", "standalone", "point_line_odometry/SideBySide",
             f"__ns:={ns}", "__name:=cut", f"image_raw:={image}", f"_swap:={swap}",
             f"_left_calibration:={files[0]}", f"_right_calibration:={files[1]}"], ns)
        self.addCleanup(self.system.end, cut)
        lines = {}

        def measured():
            nonlocal lines
            result = subprocess.run(
                [find_program("doctor"), "--ns", ns, "--rectify", "--seconds", "5"],
                env=self.system.environment, stdout=subprocess.PIPE, universal_newlines=True,
                timeout=LIVE_S)
            lines = parse(result.stdout)
            return lines.get("disparity", "?")[0] != "?"
        self.assertTrue(wait_until(measured), self.system.log(ns))
        return lines

    def test_right_halves(self):
        lines = self.check_cut("right_halves", "/usb_cam/image_raw", "false")
        for subject in ("images", "rectification", "disparity"):
            self.assertEqual(lines[subject][0], "ok", lines[subject][1])

    def test_wrong_halves(self):
        level, text = self.check_cut("wrong_halves", "/usb_cam/image_raw", "true")["disparity"]
        self.assertEqual(level, "ERROR", text)
        self.assertIn("left and right cameras are swapped", text)
        self.assertIn("halves of a side-by-side image: swap:=true", text)

    def test_wrong_column(self):
        level, text = self.check_cut("wrong_column", "/moved/image_raw", "false")["images"]
        self.assertEqual(level, "ERROR", text)
        self.assertIn("at column 590: they are halves of a side-by-side image", text)


class NoMasterTest(unittest.TestCase):
    def test_says_that_there_is_no_master(self):
        environment = dict(os.environ, ROS_MASTER_URI="http://127.0.0.1:1")
        result = subprocess.run([find_program("doctor")], env=environment, stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, universal_newlines=True, timeout=LIVE_S)
        self.assertEqual(result.returncode, 2)
        self.assertIn("no ROS master answers at http://127.0.0.1:1", result.stderr)


if __name__ == "__main__":
    unittest.main()
