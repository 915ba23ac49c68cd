#!/usr/bin/env python3
"""The nodelet under load and in its manager: two at once, loaded and unloaded while
images flow, told to end, reset, replayed at all speeds, paused, overloaded.
"""

import math
import os
import signal
import time
import unittest

import numpy as np
import rosbag
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from point_line_odometry.msg import OdometryInfo
from std_srvs.srv import SetBool

from ros_fixture import RosTest, WallCamera, call_trigger
from tool_fixture import wait_until

STEP_M = WallCamera.STEP_M


class LifecycleTest(RosTest):
    def check_healthy(self, infos):
        self.assertGreater(len(infos), 0)
        self.assertEqual(infos[-1].exceptions, 0)
        self.assertEqual(infos[-1].frames_rejected, 0)
        states = [info.state for info in infos[1:]]
        self.assertEqual(set(states), {OdometryInfo.OK}, [info.reason for info in infos])

    # --- Loading and ending

    def test_two_instances_in_one_manager(self):
        """Each uses its own camera only: one moves right, the other left."""
        manager = self.start_manager()
        listeners = {}
        for namespace in ("/one", "/two"):
            manager.load_odometry(namespace + "/odometry", {"odom_frame_id": "odom" + namespace,
                                                            "publish_tf": False})
            listeners[namespace] = self.listen(namespace)
        self.start_camera("/one", rate_hz=10.0, step_of=lambda k: min(k, 90))
        self.start_camera("/two", rate_hz=10.0, step_of=lambda k: max(60 - k, -30))
        for namespace, direction in (("/one", -1.0), ("/two", 1.0)):  # right is -y of base_link
            listener = listeners[namespace]
            self.assertTrue(wait_until(
                lambda: min(len(listener.infos), len(listener.odometry)) > 20), manager.log()[-3000:])
            self.check_healthy(listener.infos[:20])
            first, last = listener.odometry[0], listener.odometry[19]
            moved = last.pose.pose.position.y - first.pose.pose.position.y
            self.assertGreater(direction * moved, 18 * STEP_M)
            self.assertEqual(first.header.frame_id, "odom" + namespace)
        manager.unload("/one/odometry")
        self.assertTrue(listeners["/two"].wait_for(10), "it has stopped with the other")

    def test_a_hundred_loads_while_images_flow(self):
        """The process does not grow, and unloading waits for the current frame at most."""
        # One heap for all threads: with one for each, the process settles only after a number of loads
        # that depends on which threads meet.
        manager = self.start_manager(environment={"MALLOC_ARENA_MAX": "1"})
        listener = self.listen("/stereo")
        self.start_camera("/stereo", rate_hz=40.0)
        most_rounds, span, part = 330, 80, 20
        bounds = {"rss_kb": 30.0, "threads": 0.0, "files": 0.0}  # per load
        usages, unload_s = [], []

        def growth():
            """Per load, between the lowest of the first and of the last few among the last loads."""
            last = usages[-span:]
            lowest = [{key: min(usage[key] for usage in few) for key in bounds}
                      for few in (last[:part], last[-part:])]
            return {key: (lowest[1][key] - lowest[0][key]) / (span - part) for key in bounds}

        def at_rest():
            return len(usages) >= span and all(growth()[key] <= bounds[key] for key in bounds)

        # The heap grows in the first loads by up to 8 MB, and comes to rest after 30 to 60 of them.
        # What leaks never comes to rest. An image is 360 kB, a state of the odometry 2 MB.
        while len(usages) < most_rounds and not at_rest():
            manager.load_odometry("/stereo/odometry", {"queue_size": 2})
            self.assertTrue(listener.wait_for(2), f"round {len(usages)}: {manager.log()[-3000:]}")
            unload_s.append(manager.unload("/stereo/odometry"))
            listener.clear()
            usages.append(manager.usage())
        print(f"{len(usages)} loads, growth per load: {growth()}, at the end {usages[-1]}; unloading "
              f"took up to {max(unload_s):.2f} s")
        self.assertTrue(at_rest(), f"the process grows with each load: {growth()}")
        self.assertLess(max(unload_s), 3.0)
        self.assertIsNone(manager.process.poll(), manager.log()[-3000:])

    def test_manager_ends_cleanly_while_images_flow(self):
        self.start_camera("/stereo", rate_hz=40.0)
        listener = self.listen("/stereo")
        for _ in range(3):
            manager = self.start_manager()
            manager.load_odometry("/stereo/odometry")
            self.assertTrue(listener.wait_for(5), manager.log()[-3000:])
            time.sleep(1.5)  # nodelet's manager aborts if told to end in the first second of a load
            os.kill(manager.process.pid, signal.SIGINT)
            self.assertEqual(manager.process.wait(timeout=20), 0, manager.log()[-3000:])
            for word in ("terminate", "abort", "Assertion", "Segmentation"):
                self.assertNotIn(word, manager.log())

    def test_node_ends_cleanly_while_images_flow(self):
        self.start_camera("/stereo", rate_hz=40.0)
        listener = self.listen("/stereo")
        process = self.host.start(["rosrun", "point_line_odometry", "stereo_odometry",
                                   "__name:=node", "__ns:=/stereo"], "node")
        self.addCleanup(self.host.end, process)
        self.assertTrue(listener.wait_for(5), self.host.log("node"))
        os.kill(process.pid, signal.SIGINT)
        self.assertEqual(process.wait(timeout=20), 0, self.host.log("node"))

    # --- Requests between frames

    def test_reset_and_pause_during_frames(self):
        manager = self.start_manager()
        listener = self.listen("/stereo")
        self.start_camera("/stereo", rate_hz=40.0)
        manager.load_odometry("/stereo/odometry", {"initial_pose/x": 2.0})
        self.assertTrue(listener.wait_for(5), manager.log()[-3000:])
        resets = 20
        for k in range(resets):
            call_trigger("/stereo/odometry/reset")
            if k % 5 == 0:
                call_trigger("/stereo/odometry/pause")
                call_trigger("/stereo/odometry/resume")
            self.assertTrue(listener.wait_for(2), f"reset {k}: {manager.log()[-3000:]}")
        manager.unload("/stereo/odometry")
        listener.quiet(0.5)
        infos, odometry = listener.infos[:], listener.odometry[:]
        begun = {info.header.stamp for info in infos if info.state == OdometryInfo.INITIALIZING}
        self.assertGreaterEqual(len(begun), resets)
        starts = [message.pose.pose.position for message in odometry
                  if message.header.stamp in begun]
        self.assertGreaterEqual(len(starts), resets)
        for start in starts:
            self.assertEqual((start.x, start.y, start.z), (2.0, 0.0, 0.0))
        self.assertEqual(infos[-1].exceptions, 0, manager.log()[-3000:])
        self.assertEqual({info.state for info in infos},
                         {OdometryInfo.INITIALIZING, OdometryInfo.OK})

    # --- Load

    def test_overload_drops_the_oldest_frames_and_counts_them(self):
        frames = 300
        bag = self.write_bag("overload", frames)
        manager = self.start_manager_in_simulated_time()
        listener = self.listen("/stereo")
        sets = self.count_sets()
        manager.load_odometry("/stereo/odometry", {"queue_size": 1, "tracking/threads": 1})
        self.play(bag, "-r", "100")  # 1000 frames per second
        listener.quiet()
        last = listener.infos[-1]
        print(f"overload: {last.frames_processed} of {frames} frames processed, "
              f"{last.frames_dropped} dropped")
        self.assertGreater(last.frames_dropped, 0)
        self.assertEqual(listener.odometry[-1].header.stamp, self.stamp(frames - 1),
                         "the newest frame is the one that is not dropped")
        stamps = [message.header.stamp for message in listener.odometry]
        self.assertEqual(stamps, sorted(set(stamps)))
        self.assertEqual(last.frames_rejected + last.exceptions, 0)
        accounted = last.frames_processed + last.frames_dropped
        self.assertTrue(wait_until(lambda: sets and sets[-1] == accounted, 5.0),
                        f"{sets[-1:]} sets came, {accounted} were processed or dropped")

    def test_adaptive_feature_budget(self):
        """A target that no computer reaches takes the features down to a fifth, no further, and
        tracks every second frame without any; one that every computer reaches changes nothing."""
        manager = self.start_manager()
        listener = self.listen("/stereo")
        self.start_camera("/stereo", rate_hz=40.0)
        for target_ms, budget in ((0.01, 0.2), (10000.0, 1.0), (0.0, 1.0)):
            with self.subTest(target_ms=target_ms):
                manager.load_odometry("/stereo/odometry", {"target_frame_time_ms": target_ms})
                self.assertTrue(listener.wait_for(40), manager.log()[-3000:])
                manager.unload("/stereo/odometry")
                infos = listener.infos[:]
                listener.clear()
                # One of the instance before may have been on its way still.
                first = [info.reason for info in infos].index("first_frame")
                infos = infos[first:]
                self.check_healthy(infos)
                self.assertEqual(infos[0].feature_budget, 1.0)
                self.assertAlmostEqual(infos[-1].feature_budget, budget)
                few = 0.5 * infos[0].points_left
                detected = [info.points_left for info in infos if info.points_left > 0]
                self.assertEqual(detected[-1] < few, budget < 1.0)
                self.assertEqual(len(detected) < len(infos), budget < 1.0)

    # --- Replay

    def test_replay_at_all_speeds_is_the_same(self):
        """rosbag play -r 0.2, -r 5 and with a pause: the same odometry, bit for bit. In a loop it
        is reset when the clock jumps back, without whatever frame is torn apart by the jump."""
        frames = 25
        bag = self.write_bag("replay", frames)
        manager = self.start_manager_in_simulated_time()

        def replay(done, *options):
            # A new one each time: rospy may take long to see that the last odometry is gone.
            listener = self.listen("/stereo")
            manager.load_odometry("/stereo/odometry", {"queue_size": 100})
            listener.wait_for_connection()
            self.play(bag, *options, done=done and (lambda: done(listener)))
            listener.quiet()
            manager.unload("/stereo/odometry")
            listener.close()
            last = listener.infos[-1]
            self.assertEqual(last.frames_dropped + last.frames_rejected + last.exceptions, 0,
                             manager.log()[-3000:])
            return listener.poses()

        def pause_and_end(_):
            for seconds, pause in ((1.0, False), (0.5, True), (2.0, False)):  # it begins paused
                time.sleep(seconds)
                rospy.ServiceProxy("/player/pause_playback", SetBool)(pause)

        once = replay(None, "-r", "5")
        self.assertEqual(len(once), frames)
        expected = (0.0, -WallCamera.to_and_fro(frames - 1) * STEP_M, 0.0)
        self.assertLess(math.dist(once[-1][1:4], expected), 0.1)
        self.assertEqual(replay(None, "-r", "0.2"), once)
        self.assertEqual(replay(pause_and_end, "-r", "2", "--pause"), once)

        def loop_four_times(listener):
            wait_until(lambda: len(listener.odometry) >= 4 * frames)

        looped = replay(loop_four_times, "-r", "5", "-l")
        self.assertEqual(looped[:frames - 2], once[:frames - 2])
        begins = [i for i in range(1, len(looped)) if looped[i][0] <= looped[i - 1][0]]
        self.assertGreaterEqual(len(begins), 3)
        reference = {pose[0]: np.array(pose[1:4]) for pose in once}
        for begin, end in zip(begins, begins[1:]):
            self.assertGreaterEqual(end - begin, frames - 3)
            self.assertEqual(looped[begin][1:], (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            expected = reference[looped[end - 1][0]] - reference[looped[begin][0]]
            difference = np.array(looped[end - 1][1:4]) - expected
            self.assertLess(np.linalg.norm(difference), 0.01)

    # --- Helpers

    @staticmethod
    def stamp(frame):
        return rospy.Time(100) + rospy.Duration(WallCamera.PERIOD_S * frame)

    def write_bag(self, name, frames):
        """A bag of a WallCamera at 10 frames per second."""
        path = os.path.join(self.host.folder, name + ".bag")
        camera = WallCamera()
        with rosbag.Bag(path, "w") as bag:
            bag.write("/tf_static", WallCamera.mounting(), self.stamp(0))
            for frame in range(frames):
                stamp = self.stamp(frame)
                for topic, message in camera.messages(WallCamera.to_and_fro(frame), stamp):
                    bag.write("/stereo/" + topic, message, stamp)
        return path

    def play(self, bag, *options, done=None):
        """Plays the bag to its end, or until done() returns if that is given and it loops."""
        process = self.host.start(["rosbag", "play", "--clock", "--quiet", "--wait-for-subscribers",
                                   *options, bag, "__name:=player"], "player")
        self.addCleanup(self.host.end, process)
        if done:
            rospy.wait_for_service("/player/pause_playback", timeout=20.0)
            done()
        if "-l" in options:
            self.host.end(process)
        else:
            self.assertEqual(process.wait(timeout=120), 0, self.host.log("player"))

    def count_sets(self):
        """A list to which the number of synchronised sets is added whenever it is reported."""
        counts = []

        def take(message):
            for status in message.status:
                counts.extend(int(value.value) for value in status.values
                              if value.key == "synchronised sets")

        subscriber = rospy.Subscriber("/diagnostics", DiagnosticArray, take)
        self.addCleanup(subscriber.unregister)
        return counts


if __name__ == "__main__":
    unittest.main()
