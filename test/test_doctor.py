#!/usr/bin/env python3
"""The doctor from its users' view: the tool on bags, with a good input, and with faults that keep the
odometry from working."""

import copy
import os
import re
import shutil
import tempfile
import unittest

import genpy
import rosbag

from doctor_fixture import SUBJECTS, SUBJECTS_WITH_IMU, ReportChecks, parse
from tool_fixture import data_folder, run


class BagTest(unittest.TestCase, ReportChecks):
    """On a bag of dataset_to_bag: a drive through the built-in street."""

    subjects = SUBJECTS_WITH_IMU

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="point_line_doctor_")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.made = os.path.join(cls.folder, "made.bag")
        run("dataset_to_bag", "synthetic:street,frames=6", cls.made, "--quiet").check_returncode()

    def make_bag(self, change):
        """The bag with each message replaced by the list change(topic, message)."""
        changed = os.path.join(self.folder, "changed.bag")
        with rosbag.Bag(self.made) as source, rosbag.Bag(changed, "w") as target:
            for topic, message, stamp in source.read_messages():
                for new_topic, new_message in change(topic, message):
                    target.write(new_topic, new_message, stamp)
        return changed

    def check_bag(self, bag, failed, *options):
        result = run("doctor", bag, *options)
        self.check_result(result, failed)
        return parse(result.stdout)

    def test_healthy(self):
        lines = self.check_bag(self.made, {})
        self.assertEqual({level for level, _ in lines.values()}, {"ok"})
        self.assertIn("6 messages, 10.0 Hz", lines["left image"][1])
        self.assertIn("1241 x 376 mono8", lines["images"][1])
        self.assertIn("0.5372 m", lines["baseline"][1])

    def test_swapped_topics(self):
        def swap(topic, message):
            other = {"left": "right", "right": "left"}
            parts = topic.split("/")
            if parts[1] == "stereo":
                parts[2] = other.get(parts[2], parts[2])  # not that of the IMU
            return [("/".join(parts), message)]
        self.check_bag(self.make_bag(swap), {
            "calibration": ("ERROR", "swapped", "exchange"),
            "disparity": ("ERROR", "left and right cameras are swapped", "exchange"),
        })

    def test_swapped_images_alone(self):
        def swap(topic, message):
            other = {"/stereo/left/image_rect": "/stereo/right/image_rect",
                     "/stereo/right/image_rect": "/stereo/left/image_rect"}
            return [(other.get(topic, topic), message)]
        self.check_bag(self.make_bag(swap), {"disparity": ("ERROR", "swapped")})

    def test_missing_topics(self):
        for side, kind in (("left", "image_rect"), ("right", "image_rect"),
                           ("left", "camera_info"), ("right", "camera_info")):
            with self.subTest(side=side, kind=kind):
                missing = f"/stereo/{side}/{kind}"
                bag = self.make_bag(lambda topic, message, missing=missing:
                                    [(topic, message)] if topic != missing else [])
                subject = side + (" image" if kind == "image_rect" else " camera_info")
                self.check_bag(bag, {subject: ("ERROR", "nothing arrives on " + missing)})

    def test_unsynchronised_stamps(self):
        def delay(topic, message):
            if "/right/" in topic:
                message.header.stamp += genpy.Duration(0.012)
            return [(topic, message)]
        bag = self.make_bag(delay)
        self.check_bag(bag, {"stamps": ("ERROR", "differ by 12.0 ms", "approximate_sync to true")})
        self.check_bag(bag, {}, "--approximate-sync", "0.02")
        self.check_bag(bag, {"stamps": ("ERROR", "12.0 ms", "raise approximate_sync_max_interval_s")},
                     "--approximate-sync", "0.005")

    def test_vertical_disparity(self):
        def shift(topic, message):
            if topic == "/stereo/right/image_rect":
                rows = 5 * message.step
                message.data = message.data[-rows:] + message.data[:-rows]
            return [(topic, message)]
        lines = self.check_bag(self.make_bag(shift), {
            "rectification": ("WARN", "images are not rectified", "set rectify")})
        apart = float(re.search(r"points is ([\d.]+) px", lines["rectification"][1]).group(1))
        self.assertAlmostEqual(apart, 5.0, delta=0.2)

    def test_blank_images(self):
        def blank(topic, message):
            if topic == "/stereo/left/image_rect":
                message.data = bytes(len(message.data))
            return [(topic, message)]
        self.check_bag(self.make_bag(blank), {"images": ("WARN", "left image has hardly", "lens")})

    def test_bad_calibration(self):
        def spoil(topic, message):
            if topic == "/stereo/right/camera_info":
                message.P = [0.0] * 12
            return [(topic, message)]
        self.check_bag(self.make_bag(spoil), {
            "calibration": ("ERROR", "right/camera_info: P is all zero", "camera_calibration")})

    def test_one_bad_pair_among_good_ones(self):
        def change_of(index, ending, change):
            seen = []

            def apply(topic, message):
                if topic.endswith(ending):
                    seen.append(topic)
                    if len(seen) == index:
                        change(message)
                return [(topic, message)]
            return apply

        def cut(message):
            message.data = message.data[:100]

        def double(message):
            message.P = [2.0 * p for p in message.P]
        lines = self.check_bag(self.make_bag(change_of(3, "left/image_rect", cut)), {
            "images": ("WARN", "some pairs cannot be used", "data has 100 bytes")})
        self.assertEqual(lines["speed"][0], "ok")
        lines = self.check_bag(self.make_bag(change_of(6, "left/camera_info", double)), {
            "calibration": ("WARN", "left/camera_info: P is not the same", "one driver")})
        self.assertEqual(lines["rectification"][0], "ok")

    def test_masks_of_the_bag_are_used(self):
        def add_mask(topic, message):
            if not topic.endswith("image_rect"):
                return [(topic, message)]
            mask = copy.deepcopy(message)
            rows = mask.height // 2
            mask.data = b"\xff" * (rows * mask.step) + bytes((mask.height - rows) * mask.step)
            return [(topic, message), (topic.replace("image_rect", "mask_image"), mask)]
        result = run("doctor", self.make_bag(add_mask))
        self.assertEqual(result.stderr, "")
        self.assertRegex(result.stdout, r"ok +masks +.*50 %")

    def test_images_begin_later_than_their_calibration(self):
        def early(topic, message):
            return [(topic, message)]
        bag = self.make_bag(early)
        with rosbag.Bag(self.made) as source, rosbag.Bag(bag, "w") as target:
            for topic, message, stamp in source.read_messages():
                if topic.endswith("left/camera_info"):
                    target.write(topic, message, stamp - genpy.Duration(0.9))
                target.write(topic, message, stamp)
        self.check_bag(bag, {}, "--seconds", "0.6")

    def test_missing_transform(self):
        bag = self.make_bag(lambda topic, message: [(topic, message)] if "tf" not in topic else [])
        self.check_bag(bag, {"tf": ("WARN", "no transform from base_link to left_camera",
                                  "static_transform_publisher")})
        self.check_bag(bag, {}, "--base-frame", "left_camera")

    def test_rectify_before_the_bag(self):
        raw = os.path.join(self.folder, "raw.bag")
        run("dataset_to_bag", "synthetic:corridor,frames=6", raw, "--quiet").check_returncode()
        for options in ([raw], [raw, "--rectify"], ["--rectify", raw], ["--rectify=true", raw]):
            self.check_result(run("doctor", *options), {})
        result = run("doctor", "--rectify=false", raw)
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertEqual(parse(result.stdout)["rectification"][0], "WARN")
        result = run("doctor", "--rectify=perhaps", raw)
        self.assertEqual((result.returncode, result.stdout), (2, ""))
        self.assertIn("--rectify", result.stderr)

    def test_other_names(self):
        bag = self.make_bag(lambda topic, message:
                            [(topic.replace("/stereo/", "/pair/"), message)])
        self.check_bag(bag, {})

    def test_one_of_two_cameras(self):
        def add_rear(topic, message):
            both = [(topic, message)]
            if topic.startswith("/stereo/"):
                rear = copy.deepcopy(message)
                if topic == "/stereo/right/image_rect":
                    rear.data = bytes(len(rear.data))
                both.append((topic.replace("/stereo/", "/rear/"), rear))
            return both
        bag = self.make_bag(add_rear)
        self.check_bag(bag, {})
        result = run("doctor", bag, "--ns", "rear")
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertIn("/rear/right/image_rect", result.stdout)
        self.assertNotIn("/stereo/right/image_rect", result.stdout)

    def test_what_cannot_be_checked(self):
        none = os.path.join(self.folder, "none.bag")
        for words, *arguments in (("does not exist", none), ("--transport", none, "--transport", "raw"),
                                  ("--right-topic", self.made, "--left-topic", "/a/img"),
                                  ("is for bags", "--left-topic", "/a"), ("--seconds", none, "--seconds", "0"),
                                  ("--approximate-sync", none, "--approximate-sync", "7"),
                                  ("--help", none, "--no-such-option")):
            result = run("doctor", *arguments)
            self.assertEqual((result.returncode, result.stdout), (2, ""))
            self.assertIn(words, result.stderr)
        self.assertIn("Exit code", run("doctor", "--help").stdout)


class ImuBagTest(unittest.TestCase, ReportChecks):
    """On a bag of a flight through the built-in rooms, whose IMU is changed."""

    subjects = SUBJECTS_WITH_IMU

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="point_line_doctor_")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.made = os.path.join(cls.folder, "made.bag")
        run("dataset_to_bag", "synthetic:indoor,seed=3,frames=70", cls.made,
            "--quiet").check_returncode()

    def line_of(self, change):
        """The line on the IMU, with change(message) of its samples; all others are well."""
        changed = os.path.join(self.folder, "changed.bag")
        with rosbag.Bag(self.made) as source, rosbag.Bag(changed, "w") as target:
            for topic, message, stamp in source.read_messages():
                if topic == "/stereo/imu":
                    change(message)
                target.write(topic, message, stamp)
        result = run("doctor", changed)
        lines = parse(result.stdout)
        self.assertEqual(list(lines), self.subjects, result.stdout)
        for subject in set(lines) - {"imu", "speed"}:
            self.assertEqual(lines[subject][0], "ok", result.stdout)
        return lines["imu"]

    def test_right_axes(self):
        level, text = self.line_of(lambda message: None)
        self.assertEqual(level, "ok", text)
        self.assertIn("rates fit the images", text)
        self.assertIn("200.0 Hz", text)

    def test_axes_turned_by_90_degrees(self):
        def turn(message):
            for vector in (message.angular_velocity, message.linear_acceleration):
                vector.x, vector.y, vector.z = -vector.y, vector.x, vector.z
        level, text = self.line_of(turn)
        self.assertEqual(level, "WARN", text)
        self.assertIn("x = -y, y = x, z = z", text)
        self.assertIn("yaw -1.5708 pitch 0.0000 roll 0.0000", text.replace("-0.0000", "0.0000"))

    def test_axes_of_another_convention(self):
        def turn(message):  # x forward instead of z forward
            vector = message.angular_velocity
            vector.x, vector.y, vector.z = vector.z, -vector.x, -vector.y
        level, text = self.line_of(turn)
        self.assertEqual(level, "WARN", text)
        self.assertIn("x = z, y = -x, z = -y", text)

    def test_stamps_of_another_clock(self):
        def delay(message):
            message.header.stamp += genpy.Duration.from_sec(0.15)
        level, text = self.line_of(delay)
        self.assertEqual(level, "WARN", text)
        self.assertRegex(text, "its stamps are 1[456][0-9] ms later")

    def test_saturated(self):
        def clip(message):
            vector = message.angular_velocity
            vector.x, vector.y, vector.z = (max(-1.5, min(1.5, 10.0 * value))
                                            for value in (vector.x, vector.y, vector.z))
        level, text = self.line_of(clip)
        self.assertEqual(level, "WARN", text)
        self.assertIn("saturated", text)


class SequenceBagTest(unittest.TestCase, ReportChecks):
    """What the motion in consecutive images tells."""

    subjects = SUBJECTS_WITH_IMU

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="point_line_doctor_")
        self.addCleanup(shutil.rmtree, self.folder)

    def make_bag(self, source, *options):
        bag = os.path.join(self.folder, "made.bag")
        run("dataset_to_bag", source, bag, *options, "--quiet").check_returncode()
        return bag

    def make_late(self, bag, ticks, every):
        """Each `every`th left image, with the right one that comes `ticks` images later, which
        gets its stamp."""
        late = os.path.join(self.folder, "late.bag")
        frames = {}
        with rosbag.Bag(bag) as source:
            for topic, message, _ in source.read_messages(["/stereo/left/image_raw",
                                                           "/stereo/right/image_raw"]):
                frames.setdefault(topic, []).append(message)
        stamps = [message.header.stamp for message in frames["/stereo/left/image_raw"]][::every]
        right = frames["/stereo/right/image_raw"][ticks::every]
        with rosbag.Bag(bag) as source, rosbag.Bag(late, "w") as target:
            for topic, message, time_ in source.read_messages():
                if topic == "/stereo/right/image_raw":
                    continue
                if topic == "/stereo/imu" or "tf" in topic:
                    target.write(topic, message, time_)
                elif message.header.stamp in stamps:
                    target.write(topic, message, time_)
            for stamp, message in zip(stamps, right):
                message.header.stamp = stamp
                target.write("/stereo/right/image_raw", message, stamp)
        return late

    def test_right_images_that_are_late(self):
        bag = self.make_bag("synthetic:indoor,frame_rate_hz=200,frames=300")
        result = run("doctor", self.make_late(bag, 0, 10))
        self.check(result.stdout, {})
        self.assertIn("at the same time", parse(result.stdout)["trigger"][1])
        result = run("doctor", self.make_late(bag, 2, 10))
        lines = parse(result.stdout)
        level, text = lines["trigger"]
        self.assertEqual(level, "WARN", result.stdout)
        delay_ms = float(re.search(r"taken ([\d.]+) ms after the left ones", text).group(1))
        self.assertAlmostEqual(delay_ms, 10.0, delta=0.7)
        self.assertIn("hardware synchronisation", text)
        self.assertEqual(lines["projector"][0], "ok")
        self.assertEqual(result.returncode, 1)

    def test_rolling_shutter(self):
        bag = self.make_bag("synthetic:indoor,rotation=4,frames=60,rolling_shutter_ms=25")
        lines = parse(run("doctor", bag).stdout)
        level, text = lines["shutter"]
        self.assertEqual(level, "WARN", text)
        read_out_ms = float(re.search(r"the last one ([\d.]+) ms after the first", text).group(1))
        self.assertAlmostEqual(read_out_ms, 25.0, delta=5.0)
        self.assertIn("set tracking/rolling_shutter_ms to ", text)
        self.assertEqual(lines["trigger"][0], "ok", lines["trigger"][1])
        bag = self.make_bag("synthetic:indoor,rotation=4,frames=60")
        self.assertEqual(parse(run("doctor", bag).stdout)["shutter"][0], "ok")

    def test_real_cameras_have_no_fault(self):
        for name in ("kitti_raw_0926_0001", "kitti_06_000-050", "euroc_MH_01_000-099",
                     "rendered_town", "rendered_lowtexture", "rendered_plaster"):
            with self.subTest(sequence=name):
                bag = self.make_bag(data_folder(name), "--max-frames", "40")
                result = run("doctor", bag)
                self.assertIn(result.returncode, (0, 1), result.stderr)
                lines = parse(result.stdout)
                self.assertEqual([name for name in lines if name != "imu"], SUBJECTS)
                for subject, (level, text) in lines.items():
                    if subject in ("images", "calibration", "rectification", "disparity"):
                        self.assertEqual(level, "ok", subject + ": " + text)
                    elif subject != "speed":  # of this computer
                        self.assertIn(level, ("ok", "?"), subject + ": " + text)


if __name__ == "__main__":
    unittest.main()
