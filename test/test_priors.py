#!/usr/bin/env python3
"""The nodelet with other sources of motion: another odometry in tf (guess_frame_id) and the wheels' topic
(prior_odom), in order, late, missing and faulty. Faults never harm the odometry by images; they are counted and named."""

import collections
import math
import threading
import time
import unittest

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from point_line_odometry.msg import OdometryInfo
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

from ros_fixture import RosTest, WallCamera
from tool_fixture import wait_until

STEP_M = WallCamera.STEP_M
PERIOD_S = WallCamera.PERIOD_S
FRAMES = 30
FIRST_STAMP_S = 1000.0
WAIT_S = 0.1  # of a frame, at most

Drive = collections.namedtuple("Drive", "positions priors states seconds")


def stamp_of(frame):
    return rospy.Time.from_sec(round(FIRST_STAMP_S + frame * PERIOD_S, 6))


def transform(frame, parent="wheel_odom"):
    """Of the base in another odometry: the camera moves to the right, which is -y."""
    message = TransformStamped()
    message.header.stamp, message.header.frame_id = stamp_of(frame), parent
    message.child_frame_id = "base_link"
    message.transform.translation.y = -STEP_M * frame
    message.transform.rotation.w = 1.0
    return message


def wheel_pose(frame, body="base_link"):
    """By wheels; between the images, too."""
    message = Odometry()
    message.header.stamp, message.header.frame_id = stamp_of(frame), "wheel_odom"
    message.child_frame_id = body
    message.pose.pose.position.y = -STEP_M * frame
    message.pose.pose.orientation.w = 1.0
    return message


class PriorsTest(RosTest):
    def setUp(self):
        self.tf, self.camera = {}, WallCamera()
        for topic in ("/tf", "/tf_static"):
            self.tf[topic] = self.publisher(topic, TFMessage, latch=topic == "/tf_static")
        self.tf["/tf_static"].publish(WallCamera.mounting())
        self.images = {}
        for side in ("left", "right"):
            for name, kind in (("image_rect", Image), ("camera_info", CameraInfo)):
                self.images[f"{side}/{name}"] = self.publisher(f"/stereo/{side}/{name}", kind)
        self.diagnostics = []
        subscriber = rospy.Subscriber("/diagnostics", DiagnosticArray, self.diagnostics.append)
        self.addCleanup(subscriber.unregister)

    def publisher(self, topic, kind, latch=False):
        publisher = rospy.Publisher(topic, kind, queue_size=100, latch=latch)
        self.addCleanup(publisher.unregister)
        return publisher

    def load(self, **parameters):
        """A new node; its listener."""
        manager = self.start_manager()
        listener = self.listen("/stereo")
        manager.load_odometry("/stereo/odometry", parameters)
        listener.wait_for_connection()
        for publisher in [*self.images.values(), *self.tf.values()]:
            self.assertTrue(wait_until(lambda: publisher.get_num_connections() > 0))
        return manager, listener

    @staticmethod
    def end(loaded):
        manager, listener = loaded
        manager.unload("/stereo/odometry")
        listener.close()
        manager.end()

    def drive(self, loaded, before=lambda frame: None, after=lambda frame: None):
        """Frame by frame. `before` and `after` the images of each something else may be sent."""
        manager, listener = loaded
        seconds = []
        for frame in range(FRAMES):
            before(frame)
            begin = time.monotonic()
            for topic, message in self.camera.messages(frame, stamp_of(frame)):
                self.images[topic].publish(message)
            after(frame)
            self.assertTrue(wait_until(lambda: len(listener.odometry) > frame and
                                       len(listener.infos) > frame, 20.0),
                            f"frame {frame}: {manager.log()[-3000:]}")
            seconds.append(time.monotonic() - begin)
        self.assertEqual(listener.infos[-1].exceptions, 0)
        self.assertEqual([message.header.stamp for message in listener.odometry],
                         [stamp_of(frame) for frame in range(FRAMES)])
        return Drive(np.array([row[1:] for row in listener.poses()]),
                     [info.prior for info in listener.infos],
                     {info.state for info in listener.infos[1:]}, seconds)

    _by_images = None

    def by_images(self):
        """The same drive without another source, once for all tests: every bit is the same each time."""
        if PriorsTest._by_images is None:
            PriorsTest._by_images = self.drive_by_images()
        return PriorsTest._by_images

    def drive_by_images(self):
        loaded = self.load()
        drive = self.drive(loaded)
        self.end(loaded)
        self.assertEqual(drive.states, {OdometryInfo.OK})
        truth = -STEP_M * (FRAMES - 1)
        self.assertAlmostEqual(drive.positions[-1][1], truth, delta=0.01 * abs(truth))
        return drive

    def check_unharmed(self, drive, images, share):
        """No pose is further off than a share of a step."""
        self.assertEqual(drive.states, {OdometryInfo.OK})
        difference = np.abs(drive.positions[:, :3] - images.positions[:, :3]).max()
        self.assertLess(difference, share * STEP_M)

    def status(self, name):
        statuses = [status for array in self.diagnostics[-5:] for status in array.status
                    if status.name.endswith(name)]
        return statuses[-1] if statuses else DiagnosticStatus()

    def wait_for_counts(self, counts):
        """Until the diagnostics name these faults of the wheels with these numbers."""
        def named():
            values = {value.key: value.value for value in self.status("input").values}
            prefix = "poses by wheels not used: "
            return {key[len(prefix):]: int(value) for key, value in values.items()
                    if key.startswith(prefix)}
        self.assertTrue(wait_until(lambda: named() == counts, 5.0), f"{named()}, not {counts}")

    def wait_for_warning(self, text):
        self.assertTrue(wait_until(lambda: text in self.status("input").message, 5.0),
                        self.status("input").message)
        self.assertGreaterEqual(self.status("input").level, DiagnosticStatus.WARN)

    # --- sources that never say anything

    def test_silent_sources_change_no_bit(self):
        images = self.by_images()
        for parameters in ({"imu/enabled": True}, {"wheels/enabled": True},
                           {"imu/enabled": True, "wheels/enabled": True}):
            with self.subTest(**parameters):
                loaded = self.load(**parameters)
                drive = self.drive(loaded)
                self.assertEqual(drive.states, {OdometryInfo.OK})
                self.assertEqual(set(drive.priors), {"none"})
                np.testing.assert_array_equal(drive.positions, images.positions)
                self.end(loaded)

    # --- guess_frame_id

    def send_later(self, frame, after_s):
        timer = threading.Timer(
            after_s, lambda: self.tf["/tf"].publish(TFMessage([transform(frame)])))
        timer.start()
        self.addCleanup(timer.join)

    def test_guess_of_a_live_tf(self):
        images = self.by_images()
        connections = []
        subscriber = rospy.Subscriber("/tf", TFMessage, lambda message: connections.extend(
            t for t in message.transforms if t.child_frame_id == "wheel_odom"))
        self.addCleanup(subscriber.unregister)
        drive = self.drive(self.load(guess_frame_id="wheel_odom"), before=lambda frame:
                           self.tf["/tf"].publish(TFMessage([transform(frame)])))
        self.check_unharmed(drive, images, 0.1)
        self.assertEqual(drive.priors, ["none"] + ["used"] * (FRAMES - 1))
        # odom -> wheel_odom -> base_link is the pose in odom.
        self.assertTrue(wait_until(lambda: len(connections) >= FRAMES, 5.0))
        for frame, link in enumerate(connections[:FRAMES]):
            self.assertEqual((link.header.frame_id, link.header.stamp), ("odom", stamp_of(frame)))
            self.assertAlmostEqual(link.transform.translation.y - STEP_M * frame,
                                   drive.positions[frame][1], delta=1e-6)
        self.wait_for_counts({})

    def test_guess_that_comes_after_the_images(self):
        """By less than a frame waits: it is used, whatever the load of the computer in most frames."""
        images = self.by_images()
        drive = self.drive(self.load(guess_frame_id="wheel_odom"),
                           after=lambda frame: self.send_later(frame, 0.02))
        self.check_unharmed(drive, images, 0.1)
        self.assertGreater(drive.priors.count("used"), FRAMES // 2, drive.priors)

    def test_guess_that_tf_does_not_have(self):
        """Missing, of another tree, or far too late: as without it to the last bit, and few frames wait."""
        images = self.by_images()
        sends = {"missing": lambda frame: None,
                 "unknown": lambda frame: self.tf["/tf"].publish(
                     TFMessage([transform(frame, "another_odom")])),
                 "late": lambda frame: frame > 4 and self.tf["/tf"].publish(
                     TFMessage([transform(frame - 4)]))}
        for name, send in sends.items():
            with self.subTest(guess=name):
                loaded = self.load(guess_frame_id="wheel_odom")
                try:
                    drive = self.drive(loaded, before=send)
                    self.wait_for_warning("tf has no wheel_odom -> base_link")
                    self.wait_for_counts({"missing in tf": FRAMES})
                finally:
                    self.end(loaded)
                self.assertEqual(drive.states, {OdometryInfo.OK})
                np.testing.assert_array_equal(drive.positions, images.positions)
                self.assertEqual(set(drive.priors), {"none"})
                waited = np.median(images.seconds) + WAIT_S / 2
                waits = sum(seconds >= waited for seconds in drive.seconds)
                self.assertLess(waits, FRAMES // 2, drive.seconds)

    def test_guess_that_is_interrupted(self):
        """tf stops for ten frames and comes back: the pose goes on, the guess is used again."""
        images = self.by_images()
        silent = range(8, 18)
        drive = self.drive(self.load(guess_frame_id="wheel_odom"), before=lambda frame:
                           frame in silent or
                           self.tf["/tf"].publish(TFMessage([transform(frame)])))
        self.check_unharmed(drive, images, 0.1)
        for frame in silent:
            self.assertEqual(drive.priors[frame], "none")
        self.assertEqual(drive.priors[-5:], ["used"] * 5)
        self.wait_for_counts({"missing in tf": len(silent)})

    # --- prior_odom

    def drive_with(self, poses_of, **parameters):
        """`poses_of` a frame: messages of the wheels that are sent before its images."""
        wheels = self.publisher("/stereo/prior_odom", Odometry)
        loaded = self.load(**{"wheels/enabled": True}, **parameters)
        self.assertTrue(wait_until(lambda: wheels.get_num_connections() > 0))

        def send(frame):
            for message in poses_of(frame):
                wheels.publish(message)
        return self.drive(loaded, before=send)

    @staticmethod
    def good(frame):
        """At 20 Hz, until the image's stamp."""
        return [wheel_pose(frame - 0.5), wheel_pose(frame)]

    def test_wheels(self):
        images = self.by_images()
        drive = self.drive_with(self.good)
        self.check_unharmed(drive, images, 0.1)
        self.assertEqual(drive.priors, ["none"] + ["used"] * (FRAMES - 1))
        self.wait_for_counts({})

    def check_faults(self, spoil, counts, least_used):
        """`spoil(frame, poses)` makes faulty what is sent for a frame."""
        images = self.by_images()
        drive = self.drive_with(lambda frame: spoil(frame, self.good(frame)))
        self.check_unharmed(drive, images, 0.1)
        self.assertGreaterEqual(drive.priors.count("used"), least_used, drive.priors)
        self.wait_for_counts(counts)
        return drive

    def test_wheels_with_poses_that_are_not_finite(self):
        def spoil(frame, poses):
            bad = wheel_pose(frame - 0.2)
            bad.pose.pose.position.x = (math.nan, math.inf, -math.inf)[frame % 3]
            no_rotation = wheel_pose(frame - 0.1)
            no_rotation.pose.pose.orientation.w = 0.0
            return [*poses[:1], bad, no_rotation, *poses[1:]]
        self.check_faults(spoil, {"no pose": 2 * FRAMES}, FRAMES - 1)

    def test_wheels_with_covariances_that_are_none(self):
        """Zero, negative, NaN, infinite and tiny ones count as not given."""
        def spoil(frame, poses):
            for pose in poses:
                pose.twist.covariance = [(0.0, -1.0, math.nan, 1e-300, -math.inf)[frame % 5]] * 36
            return poses
        self.check_faults(spoil, {}, FRAMES - 1)

    def test_wheels_in_another_order_and_twice(self):
        def spoil(frame, poses):
            return [*reversed(poses), *poses]
        self.check_faults(spoil, {"of a stamp twice": 2 * FRAMES}, FRAMES - 1)

    def test_wheels_with_stamps_that_jump(self):
        """Some by 100 s forwards, some by 100 s backwards: these are too late."""
        def spoil(frame, poses):
            jump = wheel_pose(frame)
            jump.header.stamp += rospy.Duration(100.0 if frame % 2 else -100.0)
            return [*poses[:1], jump, *poses[1:]]
        backwards = len(range(2, FRAMES, 2))  # the first is the oldest of all that are known
        self.check_faults(spoil, {"too late": backwards}, FRAMES - 3)

    def test_wheels_with_the_wrong_frame(self):
        """One message in between, then only such ones."""
        def spoil(frame, poses):
            return [*poses[:1], wheel_pose(frame - 0.2, "nowhere"), *poses[1:]]
        self.check_faults(spoil, {"of a frame that tf does not know": FRAMES}, FRAMES - 1)

    def test_wheels_of_a_frame_that_tf_does_not_know(self):
        images = self.by_images()
        drive = self.drive_with(lambda frame: [wheel_pose(frame, "nowhere")])
        np.testing.assert_array_equal(drive.positions, images.positions)
        self.assertEqual(set(drive.priors), {"none"})
        self.wait_for_counts({"of a frame that tf does not know": FRAMES})
        self.wait_for_warning("no transform from base_link to the frame 'nowhere'")

    def test_wheels_with_a_gap(self):
        silent = range(8, 18)  # a second
        drive = self.check_faults(lambda frame, poses: [] if frame in silent else poses, {},
                                  FRAMES - 1 - len(silent) - 2)
        for frame in silent[:-1]:
            self.assertEqual(drive.priors[frame], "none", frame)
        self.assertEqual(drive.priors[-5:], ["used"] * 5)

    def test_wheels_that_jump_and_lie(self):
        """A reset of the wheels' odometry is no motion; nor are wheels that spin believed."""
        def spoil(frame, poses):
            for pose in poses:
                if frame >= 10:
                    pose.pose.pose.position.x += 5.0
                if frame >= 20:
                    pose.pose.pose.position.y *= 3.0
            return poses
        drive = self.check_faults(spoil, {}, 15)
        self.assertNotEqual(drive.priors[10], "used")
        self.assertEqual({"used"} & set(drive.priors[20:]), set())
        self.wait_for_warning("disagrees with the images")


if __name__ == "__main__":
    unittest.main()
