#!/usr/bin/env python3
"""Parts of scripts/demo that need no roscore: arguments, figures, table, images, problems."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import rosbag
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image

SCRIPTS = os.path.join(os.path.dirname(os.path.dirname(os.path.realpath(__file__))), "scripts")
sys.path.insert(0, SCRIPTS)

import _demo as demo  # noqa: E402
import _demo_drive as drive  # noqa: E402
import _demo_report as report  # noqa: E402
from point_line_odometry.msg import OdometryInfo  # noqa: E402

STEP_M, SCALE = 0.5, 1.01  # of the true motion; of the estimate


def odometry(stamp, x_m):
    message = Odometry()
    message.header.stamp = stamp
    message.pose.pose.position.x = x_m
    message.pose.pose.orientation.w = 1.0
    return message


def info(stamp, state):
    message = OdometryInfo(state=state, total_ms=30.0)
    message.header.stamp = stamp
    message.reason = "" if state == OdometryInfo.OK else "too_few_matches"
    message.stage_names, message.stage_ms = ["detect", "estimate"], [20.0, 9.0]
    return message


def image(stamp):
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:, :, 0] = 255
    message = Image(height=40, width=60, step=180, encoding="bgr8", data=pixels.tobytes())
    message.header.stamp = stamp
    return message


class FolderTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="point_line_demo_")
        self.addCleanup(shutil.rmtree, self.folder)

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def write(self, name, text):
        os.makedirs(os.path.dirname(self.path(name)), exist_ok=True)
        with open(self.path(name), "w") as stream:
            stream.write(text)

    def read(self, name):
        with open(self.path(name)) as stream:
            return stream.read()

    def record(self, frames, skipped=(), lost=()):
        """A bag of a straight drive, some of whose frames have no odometry, or are lost."""
        bag = self.path("drive.bag")
        with rosbag.Bag(bag, "w") as stream:
            for frame in range(frames):
                stamp = rospy.Time(1, 0) + rospy.Duration(0, 100000000 * frame)
                stream.write(report.TRUTH, odometry(stamp, STEP_M * frame), stamp)
                state = OdometryInfo.LOST if frame in lost else OdometryInfo.OK
                stream.write(report.INFO, info(stamp, state), stamp)
                if frame not in skipped:
                    stream.write(report.ODOMETRY, odometry(stamp, SCALE * STEP_M * frame), stamp)
            stream.write(report.IMAGE, image(stamp), stamp)
        return bag

    def report(self, frames, **options):
        return report.report_scene("street", frames, self.record(frames, **options), self.folder)


class ReportTest(FolderTest):
    def test_trajectories_have_the_stamps_of_the_headers(self):
        self.report(30)
        lines = self.read("street_estimate.tum").splitlines()
        self.assertEqual(len(lines), 30)
        self.assertEqual(lines[11], "2.100000000 5.555000000 0.000000000 0.000000000 0.000000000 "
                                    "0.000000000 0.000000000 1.000000000")
        self.assertEqual(self.read("street_groundtruth.tum").splitlines()[11].split()[:2],
                         ["2.100000000", "5.500000000"])

    def test_figures(self):
        figures = self.report(30).figures
        self.assertAlmostEqual(figures["path_m"], 14.5)
        self.assertAlmostEqual(figures["end_percent"], 1.0)
        # A segment ends at the first frame beyond its length.
        self.assertTrue(1.0 < figures["short_t_rel"] < 1.2)
        self.assertEqual(figures["time_ms"], 30.0)
        counts = [figures[name] for name in ("frames", "ok", "degraded", "lost", "missing")]
        self.assertEqual(counts, [30, 30, 0, 0, 0])
        self.assertIsNone(figures["t_rel"])

    def test_all_files_are_written(self):
        scene = self.report(30)
        report.write_summaries({"street": scene}, self.folder)
        names = report.file_names(["street"])
        self.assertEqual(sorted(names), sorted(set(os.listdir(self.folder)) - {"drive.bag"}))
        for name in names:
            if name.endswith(".png"):
                with open(self.path(name), "rb") as stream:
                    self.assertEqual(stream.read(4), b"\x89PNG")
        self.assertEqual(json.loads(self.read("results.json"))["street"]["frames"], 30)
        heading, row = (line.split(",") for line in self.read("results.csv").splitlines())
        self.assertEqual(dict(zip(heading, row))["scene"], "street")
        self.assertEqual(dict(zip(heading, row))["t_rel"], "")

    def test_colours_are_red_green_blue(self):
        image = report.read_recording(self.record(2)).image
        self.assertEqual(image.shape, (40, 60, 3))
        self.assertEqual(image[0, 0].tolist(), [0, 0, 255])

    def test_table_has_a_column_for_a_scene(self):
        scene = self.report(30)
        lines = report.format_table({"street": scene, "corridor": scene}).splitlines()
        self.assertEqual(lines[0].split(), ["street", "corridor"])
        rows = {line[:45].strip(): line[45:].split() for line in lines[1:]}
        self.assertEqual(rows["path length [m]"], ["14.5", "14.5"])
        self.assertEqual(rows["frames OK"], ["30", "30"])
        self.assertNotIn("100-800 m", "\n".join(lines))

    def test_times_of_the_stages_and_the_rest(self):
        times = report.stage_times(report.read_recording(self.record(3)).infos)
        self.assertEqual({name: values.tolist() for name, values in times.items()},
                         {"detect": [20.0] * 3, "estimate": [9.0] * 3, "rest": [1.0] * 3})


class ProblemTest(FolderTest):
    def problems(self, *arguments, **options):
        return report.find_problems(self.report(*arguments, **options))

    def test_none(self):
        self.assertEqual(self.problems(5), [])

    def test_missing_frames(self):
        problems = self.problems(8, skipped=(0, 3))
        self.assertEqual(len(problems), 1)
        self.assertIn("2 of 8 frames", problems[0])

    def test_missing_frames_of_a_drive_without_an_end(self):
        recording = report.read_recording(self.record(8, skipped=(2, 7)))
        self.assertEqual(report.count_missing(recording, 0), 1)

    def test_lost(self):
        problems = self.problems(8, lost=(4, 5))
        self.assertEqual(problems, ["the odometry was lost in 2 frames (too_few_matches)"])

    def test_no_trajectory(self):
        with self.assertRaisesRegex(report.SceneError, "only 1 of 3 frames"):
            self.report(3, skipped=(0, 1))


class ArgumentTest(FolderTest):
    def refuse(self, words, *arguments):
        """Asserts exit code 2 and a last line with the words, before anything is installed."""
        environment = {name: value for name, value in os.environ.items() if name != "DISPLAY"}
        result = subprocess.run([os.path.join(SCRIPTS, "demo"), *arguments], stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, universal_newlines=True, env=environment)
        self.assertEqual((result.returncode, result.stdout), (2, ""))
        self.assertRegex(result.stderr.splitlines()[-1], "^demo: ")
        self.assertIn(words, result.stderr)

    def test_wrong_arguments(self):
        self.refuse("invalid choice: 'town'", "--scene", "town")
        self.refuse("give a number from 2", "--frames", "1")
        self.refuse("give a number from 0", "--seed", "-1")
        self.refuse("give --scene once", "--rviz", "--scene", "street", "--scene", "indoor")

    def test_no_display(self):
        self.refuse("DISPLAY is not set", "--rviz")

    def test_output_is_no_folder(self):
        self.write("file", "")
        self.refuse("no folder where you may write", "-o", self.path("file", "results"))

    def test_scenes(self):
        self.assertEqual(demo.parse_arguments([]).scenes, ["street", "indoor", "corridor"])
        self.assertEqual(demo.parse_arguments(["--rviz"]).scenes, ["street"])
        self.assertEqual(demo.parse_arguments(["--scene", "indoor"] * 2).scenes, ["indoor"])


class DriveTest(FolderTest):
    def test_launch(self):
        command = drive.launch_command(drive.Drive("indoor", 7, 20, False))
        self.assertEqual(command[:3], ["roslaunch", "point_line_odometry", "demo.launch"])
        for argument in ("scene:=indoor", "seed:=7", "frames:=20", "exit_when_done:=true",
                         "rviz:=false"):
            self.assertIn(argument, command)
        endless = drive.launch_command(drive.Drive("street", None, 0, True))
        for argument in ("exit_when_done:=false", "rviz:=true"):
            self.assertIn(argument, endless)
        self.assertNotIn("seed", " ".join(endless))

    def test_progress(self):
        self.assertEqual(drive.describe(0, 10, 0.0), "starting")
        self.assertIn("] 5/10 frames, 2.5 frames/s", drive.describe(5, 10, 2.0))
        self.assertIn("close rviz", drive.describe(5, 0, 2.0))

    def test_excerpt_of_a_log(self):
        self.assertEqual(demo.excerpt("one\n\033[31m[FATAL] two\033[0m\n\nthree\n"),
                         "  [FATAL] two\n")
        self.assertEqual(demo.excerpt("one\n\ntwo\n"), "  one\n  two\n")

    def test_results_replace_earlier_ones(self):
        self.write("new/overview.png", "new")
        self.write("old/overview.png", "old")
        self.write("old/indoor_times.png", "old")
        self.write("old/notes.txt", "mine")
        demo.publish(self.path("new"), self.path("old"), report.file_names(list(demo.FRAMES)))
        self.assertEqual(sorted(os.listdir(self.path("old"))), ["notes.txt", "overview.png"])
        self.assertEqual(self.read("old/overview.png"), "new")


if __name__ == "__main__":
    unittest.main()
