#!/usr/bin/env python3
"""The odometry in a real roscore: rosbag play or the demo, the nodelet by its launch file, rosbag
record.

Every frame must arrive as odometry, and the trajectory must be that of offline_odometry. Real
sequences are looked for as in test_tools.py; REPLAY_SEQUENCES (names, with spaces between) and
REPLAY_RATE choose others.
"""

import os
import shutil
import tempfile
import time
import unittest

import numpy as np
import rosbag

from ros_fixture import REPOSITORY, local_host
from tool_fixture import START_UP_S, data_folder, find_program, run

RECORDED = ["/stereo/odom", "/stereo/info", "/tf", "/tf_static", "/ground_truth/odom"]
FRAME_S = 3.0  # at most, of a demo


def rotation(q):
    x, y, z, w = q
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def transform(p, q):
    T = np.eye(4)
    T[:3, :3] = rotation(q)
    T[:3, 3] = p
    return T


def xyz(v):
    return v.x, v.y, v.z


def xyzw(q):
    return q.x, q.y, q.z, q.w


class Recording:
    """A roscore of its own with a recorder and everything that a launch file starts."""

    def __init__(self, folder):
        self.folder = folder
        self.host = local_host(folder)
        self.host.start_roscore()
        self.bag = os.path.join(folder, "recorded.bag")
        self.recorder = self.host.start(["rosbag", "record", "-O", self.bag] + RECORDED, "record")
        self.launch = None

    def record(self, launch_file, arguments, done, timeout_s):
        """Runs the launch file until done() or the timeout; self.bag is whole then."""
        self.launch = self.host.start(["roslaunch", "point_line_odometry", launch_file, "rviz:=false"]
                                      + arguments, "launch")
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline and not done():
            time.sleep(0.5)
        time.sleep(2.0)
        self.host.end_recording(self.recorder, self.bag)
        self.host.end(self.launch)

    def log(self):
        return self.host.log("launch")

    def player_done(self):
        before = self.log().partition("process has finished cleanly")[0]
        return "player" in before.rpartition("\n")[2]

    def launch_done(self):
        return self.launch.poll() is not None

    def close(self):
        self.host.close()

    def camera_poses(self, topic):
        """Stamps [ns] and poses of the left camera, the first one identity, from a topic of base
        poses and the static tf."""
        with rosbag.Bag(self.bag) as bag:
            mounting = next(t.transform for _, message, _ in bag.read_messages("/tf_static")
                            for t in message.transforms if t.child_frame_id == "left_camera")
            T_base_camera = transform(xyz(mounting.translation), xyzw(mounting.rotation))
            stamps, poses = [], []
            for _, message, _ in bag.read_messages(topic):
                pose = message.pose.pose
                T_odom_base = transform(xyz(pose.position), xyzw(pose.orientation))
                stamps.append(message.header.stamp.to_nsec())
                poses.append(np.linalg.inv(T_base_camera) @ T_odom_base @ T_base_camera)
        return stamps, [np.linalg.inv(poses[0]) @ pose for pose in poses]


def rosbag_seconds(path):
    with rosbag.Bag(path) as bag:
        return bag.get_end_time() - bag.get_start_time()


def read_tum(path):
    """Stamps [ns] and poses."""
    rows = np.loadtxt(path)
    return ([int(round(row[0] * 1e9)) for row in rows],
            [transform(row[1:4], row[4:]) for row in rows])


class RecordingTest(unittest.TestCase):
    def setUp(self):
        find_program("offline_odometry")

    def make_recording(self):
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder, ignore_errors=True)
        recording = Recording(folder)
        self.addCleanup(recording.close)
        return recording

    def succeed(self, *command):
        result = run(*command)
        self.assertEqual(result.returncode, 0, result.stderr)

    def offline(self, source, output, dataset, *options):
        """The folder of the offline run on `source`, configured for kitti or euroc."""
        config = os.path.join(REPOSITORY, "config", dataset + ".yaml")
        self.succeed("offline_odometry", source, "-o", output, "--config", config, *options)
        return output

    def check_poses(self, recording, topic, trajectory):
        """Returns the largest difference of recorded poses and those of a file."""
        stamps, poses = recording.camera_poses(topic)
        expected_stamps, expected = read_tum(trajectory)
        self.assertEqual(len(stamps), len(expected), recording.log()[-3000:])
        for stamp, expected_stamp in zip(stamps, expected_stamps):
            self.assertAlmostEqual((stamp - stamps[0]) * 1e-9,
                                   (expected_stamp - expected_stamps[0]) * 1e-9, places=6)
        difference = max(np.abs(pose - ground_truth).max() for pose, ground_truth in zip(poses, expected))
        self.assertLess(difference, 1e-5)
        return difference


class ReplayTest(RecordingTest):
    def replay(self, sequence):
        source = data_folder(sequence)
        dataset = "euroc" if os.path.isdir(os.path.join(source, "mav0")) else "kitti"
        recording = self.make_recording()
        bag = os.path.join(recording.folder, "sequence.bag")
        self.succeed("dataset_to_bag", source, bag)
        offline = self.offline(bag, os.path.join(recording.folder, "offline"), dataset)
        rate = float(os.environ.get("REPLAY_RATE", "0.5"))
        recording.record(dataset + ".launch", [f"bag:={bag}", f"rate:={rate}"],
                         recording.player_done, rosbag_seconds(bag) / rate + START_UP_S)
        difference = self.check_poses(recording, "/stereo/odom",
                                      os.path.join(offline, "trajectory.tum"))
        print(f"{sequence}: rosbag play and the nodelet, largest difference from "
              f"offline_odometry {difference:.1e}")

    def test_sequences(self):
        sequences = os.environ.get("REPLAY_SEQUENCES", "kitti_06_000-050 rendered_lowtexture")
        for sequence in sequences.split():
            with self.subTest(sequence=sequence):
                self.replay(sequence)


class DemoTest(RecordingTest):
    def demo(self, scene, dataset, frames, arguments=(), settings=()):
        """The demo loses no frame, gives the offline trajectory, and ends by itself."""
        recording = self.make_recording()
        recording.record("demo.launch", [f"scene:={scene}", "seed:=3", f"frames:={frames}",
                                         "rate:=10", "exit_when_done:=true", *arguments],
                         recording.launch_done, START_UP_S + FRAME_S * frames)
        self.assertEqual(recording.launch.returncode, 0, recording.log()[-3000:])
        offline = self.offline(f"synthetic:{scene},seed=3,frames={frames}",
                               os.path.join(recording.folder, "offline"), dataset,
                               *(word for setting in settings for word in ("--set", setting)))
        difference = self.check_poses(recording, "/stereo/odom",
                                      os.path.join(offline, "trajectory.tum"))
        self.check_poses(recording, "/ground_truth/odom", os.path.join(offline, "groundtruth.tum"))
        if settings:  # motion priors
            with rosbag.Bag(recording.bag) as bag:
                uses = [info.prior for _, info, _ in bag.read_messages("/stereo/info")]
            self.assertEqual(uses, ["none"] + ["used"] * (frames - 1))
        print(f"demo, {scene}: largest difference from offline_odometry {difference:.1e}")

    def test_street(self):
        self.demo("street", "kitti", 40)

    def test_corridor(self):
        self.demo("corridor", "euroc", 15)

    def test_gyroscope(self):
        self.demo("corridor", "euroc", 40, ["imu:=true"], ["imu/enabled=true"])

    def test_wheels_and_floor(self):
        self.demo("street", "kitti", 15, ["prior_odom:=/wheel_odom", "planar:=true"],
                  ["wheels/enabled=true", "planar/enabled=true"])

    def test_gyroscope_and_wheels(self):
        self.demo("corridor", "euroc", 25, ["imu:=true", "prior_odom:=/wheel_odom"],
                  ["imu/enabled=true", "wheels/enabled=true"])


if __name__ == "__main__":
    unittest.main()
