#!/usr/bin/env python3
"""The nodelet's flight recorder and parameters, while the synthetic camera publishes frames.

What is recorded must be replayed by offline_odometry to the same bits, from the middle of a drive,
after other parameters and after a loss.
"""

import glob
import json
import os
import shutil
import sys
import tempfile
import threading
import time
import unittest

import numpy as np
import rosbag
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.client import Client
from nodelet.srv import NodeletLoad, NodeletUnload
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Log

from tool_fixture import run, wait_until, write_png

# catkin's environment for tests is made before the messages' modules are, in a new workspace.
sys.path += [os.path.join(prefix, "lib", "python3", "dist-packages")
             for prefix in os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep)]

from point_line_odometry.msg import OdometryInfo  # noqa: E402
from point_line_odometry.srv import DumpRecording  # noqa: E402

NODE = "/stereo/odometry"
CAMERA = "/stereo/camera"
RING = 12
TIMEOUT_S = 60.0


class RecorderTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.folder)
        self.changed = threading.Condition()
        self.infos = []
        self.odometry = []
        for topic, kind, received in (("info", OdometryInfo, self.infos),
                                      ("odom", Odometry, self.odometry)):
            subscriber = rospy.Subscriber("/stereo/" + topic, kind, self.take, received)
            self.addCleanup(subscriber.unregister)
        rospy.set_param(CAMERA, {
            "scene": "corridor", "seed": 3, "publish_clock": True, "rate": 100.0,
            "lockstep_topic": "odom"})

    def take(self, message, received):
        with self.changed:
            received.append(message)
            self.changed.notify_all()

    def logs(self):
        """What is logged from now on; all that log are connected."""
        logs = []
        subscriber = rospy.Subscriber("/rosout", Log, self.take, logs)
        self.addCleanup(subscriber.unregister)

        def is_connected():
            publishers = dict(rospy.get_master().getSystemState()[2][0])["/rosout"]
            return subscriber.get_num_connections() >= len(publishers)

        self.assertTrue(wait_until(is_connected), "the log is not connected")
        return logs

    def wait(self, condition, what):
        with self.changed:
            self.assertTrue(self.changed.wait_for(condition, TIMEOUT_S), what)

    def wait_frames(self, count):
        end = len(self.infos) + count
        self.wait(lambda: len(self.infos) >= end, f"{count} more frames")

    def wait_state(self, state):
        begin = len(self.infos)
        self.wait(lambda: any(info.state == state for info in self.infos[begin:]), f"state {state}")

    def start(self, others=None, **recorder):
        settings = {"frames": RING, "folder": self.folder, "lost_period_s": 3600.0}
        rospy.set_param(NODE, dict(others or {}, rectify=True, recorder=dict(settings, **recorder)))
        self.load(NODE, "StereoOdometry")
        self.load(CAMERA, "SyntheticStereo")

    def load(self, name, kind):
        self.assertTrue(self.try_to_load(name, kind))
        self.addCleanup(self.unload, name)

    def try_to_load(self, name, kind):
        rospy.wait_for_service("/manager/load_nodelet", TIMEOUT_S)
        load = rospy.ServiceProxy("/manager/load_nodelet", NodeletLoad)
        try:
            return load(name, "point_line_odometry/" + kind, [], [], [], "").success
        except rospy.ServiceException:
            return False

    def unload(self, name):
        rospy.ServiceProxy("/manager/unload_nodelet", NodeletUnload)(name)
        rospy.delete_param(name)

    def client(self):
        client = Client(NODE, timeout=TIMEOUT_S)
        self.addCleanup(client.close)  # the next one in this process would miss latched messages
        return client

    def dump(self):
        rospy.wait_for_service(NODE + "/dump_recording", TIMEOUT_S)
        return rospy.ServiceProxy(NODE + "/dump_recording", DumpRecording)()

    def recordings(self, reason):
        return sorted(glob.glob(os.path.join(self.folder, "stereo_odometry", f"*-{reason}.yaml")))

    def wait_recording(self, reason):
        deadline = time.monotonic() + TIMEOUT_S
        while not self.recordings(reason):
            self.assertLess(time.monotonic(), deadline, f"no recording: {reason}")
            time.sleep(0.1)
        return self.recordings(reason)[0]

    def replay(self, recording, *options):
        """summary.json of offline_odometry."""
        output = os.path.join(self.folder, "replay")
        result = run("offline_odometry", recording, "-o", output, *options)
        self.assertEqual(result.returncode, 0, result.stderr)
        with open(os.path.join(output, "summary.json"), encoding="utf-8") as file:
            return json.load(file)

    def check_same(self, summary, frames):
        recording = summary["recording"]
        self.assertEqual(summary["frames"], frames)
        self.assertEqual(recording["frames"], frames)
        self.assertEqual(recording["equal_frames"], frames, recording)
        self.assertEqual(recording["max_distance_m"], 0.0)

    # --- Flight recorder

    def test_service_writes_what_is_replayed_to_the_same_bits(self):
        self.start()
        self.wait_frames(2 * RING + 3)
        answer = self.dump()
        self.assertTrue(answer.success, answer.message)
        self.assertGreaterEqual(answer.frames, RING // 2)
        self.assertLessEqual(answer.frames, RING)
        for file in answer.files:
            self.assertTrue(os.path.getsize(file) > 0, file)
        bag, yaml, state = answer.files
        self.check_same(self.replay(yaml), answer.frames)
        self.check_same(self.replay(yaml, "--set", "tracking/threads=1"), answer.frames)
        other = self.replay(yaml, "--set", "lines/enabled=false")
        self.assertEqual(other["recording"]["equal_frames"], 0)
        self.assertEqual(other["counts"]["lines_left"]["max"], 0.0)
        self.check_bag(bag, answer.frames)
        self.check_damage(yaml, state)

    def check_bag(self, bag, frames):
        published = {message.header.stamp: str(message.pose) for message in self.odometry}
        with rosbag.Bag(bag) as file:
            counts = {topic: info.message_count
                      for topic, info in file.get_type_and_topic_info().topics.items()}
            for _, message, _ in file.read_messages("/stereo/odom"):
                self.assertEqual(str(message.pose), published[message.header.stamp])
        for topic in ("left/image_raw", "right/image_raw", "left/camera_info", "right/camera_info",
                      "odom"):
            self.assertEqual(counts["/stereo/" + topic], frames, topic)
        self.assertEqual(counts["/tf_static"], 1)

    def check_damage(self, yaml, state):
        with open(state, "r+b") as file:
            file.seek(1000)
            byte = file.read(1)[0]
            file.seek(1000)
            file.write(bytes([byte ^ 1]))
        result = run("offline_odometry", yaml, "-o", os.path.join(self.folder, "refused"))
        self.assertEqual(result.returncode, 2)
        self.assertIn("damaged", result.stderr)

    def test_all_since_the_start_is_replayed(self):
        self.start(frames=1000)
        self.wait_frames(8)
        answer = self.dump()
        self.assertEqual(answer.frames, len(rosbag_stamps(answer.files[0])))
        self.check_same(self.replay(answer.files[1]), answer.frames)
        result = run("offline_odometry", answer.files[1], "-o", os.path.join(self.folder, "half"),
                     "--scale", "0.5")
        self.assertEqual(result.returncode, 2)
        self.assertIn("--scale", result.stderr)

    def test_lost_writes_once_and_other_parameters_are_replayed(self):
        self.start(frames=4 * RING)
        client = self.client()
        self.wait_frames(2 * RING)
        client.update_configuration({"tracking/max_speed_m_s": 0.01})
        self.wait_state(OdometryInfo.LOST)
        recording = self.wait_recording("lost")
        summary = self.replay(recording)
        self.check_same(summary, summary["frames"])
        self.assertEqual(summary["lost"], 1)
        self.assertGreater(summary["degraded"], 0)
        self.assertGreater(summary["states"].get("ok", 0), 0, "nothing before the change")
        client.update_configuration({"tracking/max_speed_m_s": 60.0})
        self.wait_state(OdometryInfo.OK)
        client.update_configuration({"tracking/max_speed_m_s": 0.01})
        self.wait_state(OdometryInfo.LOST)
        self.wait_frames(3)
        self.assertTrue(self.dump().success)  # after the recording of the loss
        self.assertEqual(self.recordings("lost"), [recording])

    def test_each_loss_writes_if_the_period_is_over(self):
        self.start(lost_period_s=0.0, max_files=1)
        client = self.client()
        self.wait_frames(3)
        recordings = []
        for _ in range(2):
            client.update_configuration({"tracking/max_speed_m_s": 0.01})
            self.wait_state(OdometryInfo.LOST)
            self.wait_frames(3)
            self.assertTrue(self.dump().success)
            recordings += self.recordings("lost")
            client.update_configuration({"tracking/max_speed_m_s": 60.0})
            self.wait_state(OdometryInfo.OK)
        self.assertEqual(len(set(recordings)), 2)
        self.assertEqual(len(self.recordings("lost")), 1)

    def test_switched_off(self):
        self.start(frames=0)
        self.wait_frames(2)
        answer = self.dump()
        self.assertFalse(answer.success)
        self.assertIn("recorder/frames", answer.message)

    def test_faults_of_the_disk_are_answered_and_tracking_goes_on(self):
        blocked = os.path.join(self.folder, "file")
        open(blocked, "w").close()
        self.start(folder=blocked)
        self.wait_frames(2)
        answer = self.dump()
        self.assertFalse(answer.success)
        self.assertIn(blocked, answer.message)
        self.wait_frames(2)
        self.assertEqual(self.infos[-1].exceptions, 0)

    # --- Masks

    def diagnostic(self, key):
        values = [value.value for array in self.diagnostics for status in array.status
                  for value in status.values if value.key == key]
        return values[-1] if values else None

    def start_with_masks(self, camera=None, **node):
        self.diagnostics = []
        subscriber = rospy.Subscriber("/diagnostics", DiagnosticArray, self.take, self.diagnostics)
        self.addCleanup(subscriber.unregister)
        rospy.set_param(CAMERA, dict(rospy.get_param(CAMERA), **(camera or {})))
        self.start(node)

    def test_masks_of_file_and_topics_are_used_and_replayed(self):
        mask = np.full((480, 752), 255, np.uint8)
        mask[:, :100] = 0
        file = os.path.join(self.folder, "left.png")
        write_png(file, [row.tobytes() for row in mask])
        self.start_with_masks({"bonnet": 1.0}, left={"mask": file}, mask_images="both",
                              mask_wait_s=10.0)
        self.wait_frames(RING)
        answer = self.dump()
        self.check_same(self.replay(answer.files[1]), answer.frames)
        with rosbag.Bag(answer.files[0]) as bag:
            counts = {topic: info.message_count
                      for topic, info in bag.get_type_and_topic_info().topics.items()}
            _, message, _ = next(bag.read_messages("/stereo/left/mask_image"))
        self.assertEqual(counts["/stereo/left/mask_image"], answer.frames)
        self.assertEqual(counts["/stereo/right/mask_image"], answer.frames)
        used = np.frombuffer(message.data, np.uint8).reshape(480, 752)
        self.assertTrue((used[:, :100] == 0).all())
        self.assertTrue((used[470, 200:500] == 0).all(), "the bonnet is not masked")
        self.assertTrue((used[:200, 100:] != 0).all())
        self.wait(lambda: self.diagnostic("masks missing") is not None, "diagnostics")
        # One or two frames may come before the masks' topics are connected.
        self.assertLessEqual(int(self.diagnostic("masks missing")), 4)

    def test_masks_that_do_not_come_do_not_block(self):
        self.start_with_masks(mask_images="both", mask_wait_s=0.05)
        self.wait_frames(10)
        self.assertTrue(all(info.state == OdometryInfo.OK for info in self.infos[1:]))
        self.assertEqual(self.infos[-1].frames_dropped, 0)
        self.wait(lambda: int(self.diagnostic("masks missing") or 0) >= 20, "the count")
        answer = self.dump()
        self.check_same(self.replay(answer.files[1]), answer.frames)

    def test_a_mask_of_the_wrong_size_is_named(self):
        logs = self.logs()
        file = os.path.join(self.folder, "small.png")
        write_png(file, [bytes(20)] * 10)
        self.start_with_masks({"lockstep_topic": ""}, right={"mask": file})
        wanted = f"right mask '{file}' is 20 x 10, but the camera's images are 752 x 480"
        self.wait(lambda: any(wanted in log.msg for log in logs), "the error")
        self.assertFalse(self.odometry)

    # --- Parameters at the start

    def test_names_everything_that_is_wrong_at_the_start(self):
        logs = self.logs()
        libraries = {"compressed": {"mode": "gray"}, "theora": {"post_processing_level": 1},
                     "diagnostic_period": 2.0, "num_worker_threads": 2}
        rospy.set_param(NODE, dict(
            libraries, no_such=1, deep={"er": {"name": 2}}, points={"levels": 99, "level": 3},
            recorder={"frames": -1, "frame": 5}, rectify="yes", motion={"huber_delta": -1.0}))
        deadline = time.monotonic() + TIMEOUT_S
        while not any("does not start" in log.msg for log in logs):
            self.assertLess(time.monotonic(), deadline, "the message does not come")
            self.assertFalse(self.try_to_load(NODE, "StereoOdometry"))
            time.sleep(0.5)
        text = next(log.msg for log in logs if "does not start" in log.msg)
        for word in ("unknown parameter ~no_such", "~deep/er/name", "~points/level;",
                     "points/levels is 99", "recorder/frames is -1", "~recorder/frame;",
                     "rectify must be", "motion/huber_delta is -1"):
            self.assertIn(word, text)
        for word in libraries:
            self.assertNotIn(word, text)
        rospy.delete_param(NODE)
        rospy.set_param(NODE, libraries)
        self.load(NODE, "StereoOdometry")

    def test_starts_with_retired_parameters_and_warns(self):
        logs = self.logs()
        self.start({"motion": {"max_iterations": 50, "min_matches": 9}})
        self.wait_frames(2)
        client = self.client()
        self.assertEqual(client.get_configuration(timeout=TIMEOUT_S)["motion/min_matches"], 9)
        answer = client.update_configuration({"window/max_iterations": 9, "motion/min_matches": 10})
        self.assertEqual((answer["window/max_iterations"], answer["motion/min_matches"]), (5, 10))
        for name in ("motion/max_iterations", "window/max_iterations"):
            self.wait(lambda: any(log.level == Log.WARN and f"parameter {name} is ignored" in log.msg
                                  for log in logs), f"warning of {name}")
        self.assertEqual(self.infos[-1].exceptions, 0)

    # --- dynamic_reconfigure

    def test_reconfigures_between_frames(self):
        self.start()
        client = self.client()
        self.wait_frames(5)
        self.assertGreater(self.infos[-1].lines_left, 30)
        answer = client.update_configuration({"lines/max_count": 30})
        self.assertEqual(answer["lines/max_count"], 30)
        self.assertEqual(rospy.get_param(NODE + "/lines/max_count"), 30)
        self.wait_frames(10)
        self.assertLessEqual(self.infos[-1].lines_left, 30)
        self.assertTrue(all(info.state == OdometryInfo.OK for info in self.infos[1:]))
        self.check_continuous()

    def check_continuous(self):
        places = [message.pose.pose.position for message in self.odometry]
        steps = [((b.x - a.x) ** 2 + (b.y - a.y) ** 2 + (b.z - a.z) ** 2) ** 0.5
                 for a, b in zip(places, places[1:])]
        usual = sorted(steps)[len(steps) // 2]
        self.assertLess(max(steps), 2.0 * usual)
        self.assertGreater(min(steps), 0.3 * usual)

    def test_refuses_what_is_not_allowed_and_shows_the_old_values(self):
        self.start()
        client = self.client()
        self.wait_frames(2)
        for wanted in ({"points/enabled": False, "lines/enabled": False},
                       {"points/levels": 9, "lines/max_count": 17},
                       {"motion/residual_images": "right"},
                       {"motion/huber_delta": float("nan")}):
            before = client.get_configuration(timeout=TIMEOUT_S)
            answer = client.update_configuration(wanted)
            for name in wanted:
                self.assertEqual(answer[name], before[name])
        self.wait_frames(2)
        self.assertEqual(self.infos[-1].exceptions, 0)
        self.assertGreater(self.infos[-1].points_left, 0)

    def test_describes_every_parameter_with_its_range(self):
        self.start()
        client = self.client()
        descriptions = {d["name"]: d for d in client.get_parameter_descriptions(TIMEOUT_S)}
        size = descriptions["window/size"]
        self.assertEqual((size["min"], size["max"], size["default"]), (0, 30, 5))
        self.assertIn("both", descriptions["motion/residual_images"]["edit_method"])
        self.assertGreater(len(descriptions), 40)


def rosbag_stamps(path):
    with rosbag.Bag(path) as bag:
        return [message.header.stamp for _, message, _ in bag.read_messages("/stereo/odom")]


if __name__ == "__main__":
    rospy.init_node("recorder_test")
    rostest.rosrun("point_line_odometry", "recorder_test", RecorderTest)
