#!/usr/bin/env python3
"""Replays real sequences in a real roscore: rosbag play, the nodelet by its launch file, rosbag record.

Every frame must arrive as odometry, and the trajectory must be that of offline_odometry. Sequences are looked for as
in test_tools.py; REPLAY_SEQUENCES (names, with spaces between) and REPLAY_RATE choose others.
"""

import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import unittest

import numpy as np
import rosbag

from tool_fixture import data_folder, find_program, run

LAUNCH = {True: "euroc.launch", False: "kitti.launch"}
START_UP_S = 60.0


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


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


class Replay:
    """A roscore of its own with the recorder and everything that the launch file starts."""

    def __init__(self, folder):
        self.folder = folder
        port = free_port()
        self.environment = dict(os.environ, ROS_MASTER_URI=f"http://127.0.0.1:{port}", ROS_IP="127.0.0.1",
                                ROS_LOG_DIR=os.path.join(folder, "log"))
        self.environment.pop("ROS_HOSTNAME", None)
        self.processes = []
        self.start(["roscore", "-p", str(port)], "roscore")
        self.wait_for_master()

    def start(self, command, name):
        log = open(os.path.join(self.folder, name + ".log"), "w")
        process = subprocess.Popen(command, env=self.environment, stdout=log, stderr=subprocess.STDOUT,
                                   start_new_session=True)
        log.close()
        self.processes.append(process)
        return process

    def wait_for_master(self):
        deadline = time.monotonic() + START_UP_S
        while time.monotonic() < deadline:
            if subprocess.run(["rosparam", "get", "/run_id"], env=self.environment, stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL).returncode == 0:
                return
            time.sleep(0.2)
        raise RuntimeError("roscore did not come up")

    def record_odometry(self, bag, launch_file, rate):
        """The recorded topics' bag, after the player has finished."""
        recorded = os.path.join(self.folder, "recorded.bag")
        recorder = self.start(["rosbag", "record", "-O", recorded, "/stereo/odom", "/stereo/info", "/tf"], "record")
        launch = self.start(["roslaunch", "point_line_odometry", launch_file, f"bag:={bag}", "rviz:=false",
                             f"rate:={rate}"], "launch")
        end = rosbag_seconds(bag) / rate + START_UP_S
        deadline = time.monotonic() + end
        while time.monotonic() < deadline and not self.player_done():
            time.sleep(0.5)
        time.sleep(2.0)
        for process in (recorder, launch):
            os.killpg(process.pid, signal.SIGINT)
            process.wait(timeout=30)
        return recorded

    def player_done(self):
        with open(os.path.join(self.folder, "launch.log"), errors="replace") as log:
            return "player" in log.read().partition("process has finished cleanly")[0].rpartition("\n")[2]

    def close(self):
        for process in reversed(self.processes):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
                try:
                    process.wait(timeout=20)
                except subprocess.TimeoutExpired:
                    os.killpg(process.pid, signal.SIGKILL)
                    process.wait()


def rosbag_seconds(path):
    with rosbag.Bag(path) as bag:
        return bag.get_end_time() - bag.get_start_time()


def recorded_camera_poses(recorded, source):
    """Stamps and poses of the left camera, the first one identity, from odom and the static tf."""
    with rosbag.Bag(source) as bag:
        mounting = next(t.transform for _, message, _ in bag.read_messages("/tf_static") for t in message.transforms
                        if t.child_frame_id == "left_camera")
    T_base_camera = transform(xyz(mounting.translation), xyzw(mounting.rotation))
    stamps, poses = [], []
    with rosbag.Bag(recorded) as bag:
        for _, message, _ in bag.read_messages("/stereo/odom"):
            pose = message.pose.pose
            T_odom_base = transform(xyz(pose.position), xyzw(pose.orientation))
            stamps.append(message.header.stamp.to_nsec())
            poses.append(np.linalg.inv(T_base_camera) @ T_odom_base @ T_base_camera)
    return stamps, [np.linalg.inv(poses[0]) @ pose for pose in poses]


class ReplayTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        find_program("offline_odometry")

    def replay(self, sequence):
        source = data_folder(sequence)
        bag = os.path.join(self.folder, "sequence.bag")
        offline = os.path.join(self.folder, "offline")
        launch_file = LAUNCH[os.path.isdir(os.path.join(source, "mav0"))]
        config = os.path.join(os.path.dirname(os.path.dirname(os.path.realpath(__file__))), "config",
                              launch_file.replace(".launch", ".yaml"))
        for command in (("dataset_to_bag", source, bag), ("offline_odometry", bag, "-o", offline, "--config", config)):
            result = run(*command)
            self.assertEqual(result.returncode, 0, result.stderr)

        replay = Replay(self.folder)
        self.addCleanup(replay.close)
        recorded = replay.record_odometry(bag, launch_file, float(os.environ.get("REPLAY_RATE", "0.5")))
        stamps, poses = recorded_camera_poses(recorded, bag)
        expected = np.loadtxt(os.path.join(offline, "trajectory.kitti")).reshape(-1, 3, 4)
        with open(os.path.join(self.folder, "launch.log"), errors="replace") as log:
            self.assertEqual(len(stamps), len(expected), log.read()[-3000:])
        self.assertEqual(len(set(stamps)), len(stamps))
        difference = max(np.abs(pose[:3] - truth).max() for pose, truth in zip(poses, expected))
        self.assertLess(difference, 1e-5)
        print(f"{sequence}: {len(stamps)} frames through rosbag play and the nodelet, largest difference from "
              f"offline_odometry {difference:.1e}")

    def test_sequences(self):
        for sequence in os.environ.get("REPLAY_SEQUENCES", "kitti_06_000-050 rendered_lowtexture").split():
            with self.subTest(sequence=sequence):
                self.replay(sequence)


if __name__ == "__main__":
    unittest.main()
