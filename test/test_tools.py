#!/usr/bin/env python3
"""Tests of offline_odometry, dataset_to_bag and synthetic_world as their users run them.

The programs are looked for in the folder POINT_LINE_ODOMETRY_BIN, else by catkin_find. Real
sequences are looked for in POINT_LINE_ODOMETRY_DATA, else in ../shared/data beside the
repository; without them the tests that need them are skipped.
"""

import copy
import csv
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import time
import unittest

import rosbag
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import String

from tool_fixture import (BASELINE_M, FOCAL_PX, FRAMES, HEIGHT, WIDTH, ToolTest, cut_off,
                          data_folder, find_program, read, write, write_png)

RESULTS = ["frames.csv", "groundtruth.tum", "summary.json", "trajectory.kitti",
           "trajectory.tum", "uncertainty.csv"]


class OfflineOdometryTest(ToolTest):
    def test_writes_all_results(self):
        output = self.offline(self.kitti, "out")
        self.assertEqual(sorted(os.listdir(output)), RESULTS)
        with open(os.path.join(output, "frames.csv")) as file:
            rows = list(csv.DictReader(file))
        self.assertEqual(len(rows), FRAMES)
        self.assertEqual(rows[1]["stamp_s"], "0.100000000")
        self.assertEqual(rows[0]["state"], "initializing")
        for column in ("reason", "points_left", "line_inliers", "rms_px", "detect_ms", "total_ms",
                       "decode_ms", "rectify_ms"):
            self.assertIn(column, rows[0])
        with open(os.path.join(output, "summary.json")) as file:
            summary = json.load(file)
        self.assertEqual(summary["frames"], FRAMES)
        self.assertEqual(sum(summary["states"].values()), FRAMES)
        self.assertEqual(summary["failed_windows"], 0)
        self.assertEqual(set(summary["times"]["total_ms"]), {"mean", "median", "p95", "max"})
        self.assertGreater(summary["peak_memory_MB"], 1.0)
        correction_px = summary["stereo_correction_rms_px"]
        self.assertEqual(set(correction_px), {"disparity", "rows"})
        self.assertLess(max(correction_px.values()), 0.3)
        residuals = summary["weighted_residuals"]
        self.assertEqual(residuals["bin_width"], 0.25)
        for kind, rows in (("points", 3), ("lines", 4)):
            self.assertEqual(residuals[kind]["size"] % rows, 0)
            self.assertEqual(sum(residuals[kind]["counts"]), residuals[kind]["size"])
            self.assertLess(residuals[kind]["variance"], 4.0)

    def test_target_frame_time(self):
        source = "synthetic:corridor,frames=12"
        budgets, without_features = [], []
        for target_ms in (0, 0.01, 10000):
            output = self.offline(source, f"to_{target_ms}", "--target-frame-time", target_ms)
            with open(os.path.join(output, "frames.csv")) as file:
                rows = list(csv.DictReader(file))
            budgets.append([float(row["feature_budget"]) for row in rows])
            without_features.append([i for i, row in enumerate(rows) if row["points_left"] == "0"])
        self.assertEqual(budgets[0], [1.0] * 12)
        # Of both kinds of frames in turns as many of each count.
        self.assertEqual(budgets[1], [1.0] * 5 + [0.5] * 6 + [0.25])
        self.assertEqual(budgets[2], [1.0] * 12)
        self.assertEqual(without_features, [[], [6, 8, 10], []])
        self.refuse("--target-frame-time", "offline_odometry", source, "-o", self.path("out"),
                    "--target-frame-time", "-1")

    def test_first_pose_is_identity(self):
        output = self.offline(self.kitti, "out")
        first = read(os.path.join(output, "trajectory.kitti")).split(b"\n")[0]
        self.assertEqual([float(x) for x in first.split()], [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0])

    def test_ground_truth_is_of_the_time_of_the_run(self):
        output = self.offline(self.kitti, "out", "--max-frames", 2)
        self.assertEqual(read(os.path.join(output, "groundtruth.tum")),
                         b"0.000000000 0.000000000 0.000000000 0.000000000 "
                         b"0.000000000 0.000000000 0.000000000 1.000000000\n"
                         b"0.100000000 0.120000000 0.000000000 0.000000000 "
                         b"0.000000000 0.000000000 0.000000000 1.000000000\n")

    def test_ground_truth_of_an_older_run_is_removed(self):
        self.offline(self.kitti, "out")
        os.remove(os.path.join(self.kitti, "poses.txt"))
        self.assertNotIn("groundtruth.tum", os.listdir(self.offline(self.kitti, "out")))

    def test_replaces_only_what_it_has_written(self):
        output = self.path("out")
        os.makedirs(os.path.join(output, "features"))
        for name in ("groundtruth.tum", "notes.txt", os.path.join("features", "notes.txt")):
            write(os.path.join(output, name), "mine")
        arguments = ("offline_odometry", self.kitti, "-o", output, "--quiet")
        self.refuse(["groundtruth.tum' exists already", "remove it"], *arguments)
        os.remove(os.path.join(output, "groundtruth.tum"))
        self.refuse(["features' exists already"], *arguments, "--features-images", 1)
        self.succeed(*arguments)
        self.assertEqual(read(os.path.join(output, "notes.txt")), b"mine")
        self.assertEqual(read(os.path.join(output, "features", "notes.txt")), b"mine")
        self.assertEqual(sorted(os.listdir(output)), sorted(RESULTS + ["features", "notes.txt"]))
        shutil.rmtree(os.path.join(output, "features"))
        self.succeed(*arguments, "--features-images", 1)
        self.assertEqual(len(os.listdir(os.path.join(output, "features"))), FRAMES)
        write(os.path.join(output, "report.html"), "of that run")
        self.succeed(*arguments)  # nothing of the run before is left beside its results
        self.assertEqual(sorted(os.listdir(output)), sorted(RESULTS + ["notes.txt"]))

    def test_frames_that_are_refused_are_named_and_left_out(self):
        write(os.path.join(self.kitti, "times.txt"), "0.0\n0.1\n0.1\n0.2\n")
        output = self.path("out")
        result = self.succeed("offline_odometry", self.kitti, "-o", output)
        self.assertIn("1 frames were not accepted by the odometry: stamp_not_newer", result.stderr)
        self.assertIn("1 stamp_not_newer", result.stdout)
        self.assertEqual(self.stamps(output), [0.0, 0.1, 0.2])
        with open(os.path.join(output, "summary.json")) as file:
            summary = json.load(file)
        self.assertEqual((summary["frames"], summary["refused_frames"]),
                         (FRAMES - 1, {"stamp_not_newer": 1}))
        self.assertEqual(len(summary["warnings"]), 1)
        self.succeed("evaluate_trajectory", "--groundtruth",
                     os.path.join(output, "groundtruth.tum"), "--estimate",
                     os.path.join(output, "trajectory.tum"))
        write(os.path.join(self.kitti, "times.txt"), "0.3\n0.2\n0.1\n0.0\n")
        result = self.succeed("offline_odometry", self.kitti, "-o", output, "--quiet")
        self.assertIn("3 frames were not accepted", result.stderr)

    def test_refuses_options_for_another_kind_of_input(self):
        for options in (("--left-topic", "/a"), ("--approximate-sync", 0.01), ("--imu-topic", "/a"),
                        ("--wheel-topic", "/a"), ("--mask-images",)):
            self.refuse([options[0], "is for bags"], "offline_odometry", self.kitti, "-o",
                        self.path("out"), *options)

    def test_prints_table_and_progress(self):
        result = self.succeed("offline_odometry", self.kitti, "-o", self.path("out"))
        self.assertIn("median", result.stdout)
        self.assertIn("point_inliers", result.stdout)
        self.assertIn(f"{FRAMES} frames", result.stdout)

    def test_quiet_prints_nothing(self):
        result = self.succeed("offline_odometry", self.kitti, "-o", self.path("out"), "--quiet")
        self.assertEqual(result.stdout + result.stderr, "")

    def test_two_runs_give_the_same_bytes(self):
        first, second = self.offline(self.kitti, "a"), self.offline(self.kitti, "b")
        self.assertSameFile("trajectory.tum", first, second)
        self.assertSameFile("trajectory.kitti", first, second)

    def test_bag_and_folder_give_the_same_bytes(self):
        for compression in ("none", "lz4", "bz2"):
            bag = self.path(compression + ".bag")
            self.succeed("dataset_to_bag", self.kitti, bag, "--quiet", "--compression", compression)
            self.assertSameFile("trajectory.kitti", self.offline(self.kitti, "a"),
                                self.offline(bag, "b"))

    def test_max_frames(self):
        output = self.offline(self.kitti, "out", "--max-frames", 2)
        self.assertEqual(read(os.path.join(output, "trajectory.tum")).count(b"\n"), 2)

    def stamps(self, folder):
        rows = read(os.path.join(folder, "trajectory.tum")).decode().splitlines()
        return [float(row.split()[0]) for row in rows]

    def test_every(self):
        self.assertEqual(self.stamps(self.offline(self.kitti, "two", "--every", 2)), [0.0, 0.2])
        self.assertEqual(self.stamps(self.offline(self.kitti, "three", "--every", 3)), [0.0, 0.3])
        for n in (FRAMES, 1000):
            self.assertEqual(self.stamps(self.offline(self.kitti, "first", "--every", n)), [0.0])
        output = self.offline(self.kitti, "both", "--every", 2, "--max-frames", 1)
        self.assertEqual(self.stamps(output), [0.0])
        self.assertSameFile("trajectory.tum", self.offline(self.kitti, "a"),
                            self.offline(self.kitti, "b", "--every", 1))

    def test_every_skips_frames_without_reading_them(self):
        whole = self.offline(self.kitti, "a", "--every", 2)
        cut_off(os.path.join(self.kitti, "image_1", "000001.png"))
        self.assertSameFile("trajectory.kitti", whole, self.offline(self.kitti, "b", "--every", 2))

    def test_every_of_a_bag_and_of_the_world(self):
        self.assertSameFile("trajectory.kitti", self.offline(self.kitti, "a", "--every", 2),
                            self.offline(self.make_bag(), "b", "--every", 2))
        world = self.offline("synthetic:corridor,frames=5", "c", "--every", 2)
        self.assertEqual(self.stamps(world), [0.0, 0.1, 0.2])
        with open(os.path.join(world, "summary.json")) as file:
            self.assertEqual(json.load(file)["states"], {"initializing": 1, "ok": 2})

    def image_size(self, folder):
        """Width and height of the feature image of the first frame."""
        header = read(os.path.join(folder, "features", "000000.png"))[16:24]
        return struct.unpack(">II", header)

    def test_scale(self):
        for factor in (0.5, 1.0, 1.7, 2):
            output = self.offline(self.kitti, "out", "--scale", factor, "--features-images", 1)
            expected = (round(factor * WIDTH), round(factor * HEIGHT))
            self.assertEqual(self.image_size(output), expected)

    def test_scale_changes_neither_the_camera_nor_the_path(self):
        # 0.12 m a frame to the right, along a wall, with calibrated and raw images of any size.
        for factor in (0.8, 1.5):
            output = self.offline(self.kitti, "out", "--scale", factor)
            last = read(os.path.join(output, "trajectory.kitti")).decode().splitlines()[-1]
            pose = [float(number) for number in last.split()]
            self.assertAlmostEqual(pose[3], 0.12 * (FRAMES - 1), delta=0.01)
            self.assertAlmostEqual(pose[7], 0.0, delta=0.01)
            self.assertAlmostEqual(pose[11], 0.0, delta=0.03)
        world = self.offline("synthetic:indoor,frames=4", "world", "--scale", 0.6)
        result = self.succeed("evaluate_trajectory", "--json", "--groundtruth",
                              os.path.join(world, "groundtruth.tum"),
                              "--estimate", os.path.join(world, "trajectory.tum"))
        self.assertLess(json.loads(result.stdout)["ate_m"]["rmse"], 0.002)

    def test_features_images(self):
        output = self.offline(self.kitti, "out", "--features-images", 2)
        self.assertEqual(sorted(os.listdir(os.path.join(output, "features"))),
                         ["000000.png", "000002.png"])

    # --- --priors

    def prior_row(self, start, end, sigma=0.01):
        """The true motion between two of the frames, or stamps."""
        stamps = [stamp if isinstance(stamp, str) else f"{0.1 * stamp:.9f}" for stamp in (start, end)]
        return " ".join([*stamps, "0.12 0 0 0 0 0 1", *[str(sigma)] * 6]) + "\n"

    def with_priors(self, rows, name, *options):
        """A run with a prior file; its summary, and what it has said."""
        write(self.path("priors.txt"), "".join(rows))
        result = self.succeed("offline_odometry", self.kitti, "-o", self.path(name), "--quiet",
                              "--priors", self.path("priors.txt"), *options)
        with open(self.path(name, "summary.json")) as file:
            return json.load(file), result.stderr

    def test_priors(self):
        rows = ["# the motions of all frames\n", *(self.prior_row(i, i + 1) for i in range(FRAMES - 1))]
        summary, said = self.with_priors(rows, "out")
        self.assertEqual(said, "")
        self.assertEqual(summary["priors"], {"none": 1, "used": FRAMES - 1})
        self.assertEqual(summary["prior_file"], {"rows": FRAMES - 1, "unmatched": []})
        summary, said = self.with_priors(rows, "fewer", "--max-frames", "2")
        self.assertEqual(said, "")
        self.assertEqual(summary["prior_file"], {"rows": 1, "unmatched": []})
        self.assertNotIn("prior_file", json.loads(read(os.path.join(
            self.offline(self.kitti, "without"), "summary.json"))))

    def test_priors_that_match_no_frames_are_named(self):
        rows = [self.prior_row(0, 1), self.prior_row("0.100000000", "0.200000400"),
                self.prior_row(1, 3), self.prior_row("7.5", "7.6")]
        summary, said = self.with_priors(rows, "out")
        self.assertEqual(summary["priors"], {"none": 2, "used": 1, "invalid": 1})
        unmatched = [["0.100000000", "0.200000400"], ["0.100000000", "0.300000000"],
                     ["7.500000000", "7.600000000"]]
        self.assertEqual(summary["prior_file"], {"rows": 4, "unmatched": unmatched})
        self.assertEqual(said.count("\n"), 1, said)
        self.assertTrue(said.startswith("offline_odometry: warning: 3 of 4 rows"), said)
        for words in ("priors.txt", "0.100000000 to 0.200000400", "7.500000000 to 7.600000000",
                      "0 and 400 ns away"):
            self.assertIn(words, said)

    def test_refuses_priors_of_which_none_matches(self):
        every = [self.prior_row(i, i + 1) for i in range(FRAMES - 1)]
        cases = [([self.prior_row("0.2000001", "0.3000001")], (), "1 of 1 rows"),
                 (every, ("--every", "2"), "3 of 3 rows"), ([], (), "has no row"),
                 (every + every[:1], (), "a second motion that ends at the same stamp")]
        for rows, options, words in cases:
            with self.subTest(words=words):
                write(self.path("priors.txt"), "".join(rows))
                self.refuse([words, "priors.txt"], "offline_odometry", self.kitti,
                            "-o", self.path("out"), "--quiet",
                            "--priors", self.path("priors.txt"), *options)

    def test_replaces_older_results(self):
        self.offline(self.kitti, "out", "--features-images", 1)
        output = self.offline(self.kitti, "out", "--features-images", 2, "--max-frames", 2)
        self.assertEqual(sorted(os.listdir(output)), ["features"] + RESULTS)
        self.assertEqual(os.listdir(os.path.join(output, "features")), ["000000.png"])

    def test_settings_override_the_file(self):
        config = self.path("config.yaml")
        write(config, "odom_frame_id: odom\nlines:\n  enabled: false\npoints:\n  enabled: true\n")
        output = self.offline(self.kitti, "out", "--config", config,
                              "--set", "points/enabled=false", "--set", "lines/enabled=true")
        with open(os.path.join(output, "frames.csv")) as file:
            row = next(csv.DictReader(file))
        self.assertEqual(row["points_left"], "0")
        self.assertNotEqual(row["lines_left"], "0")

    def test_summary_has_the_parameters_of_the_run(self):
        def parameters(name, *options):
            output = self.offline(self.kitti, name, *options)
            with open(os.path.join(output, "summary.json")) as file:
                return json.load(file)["parameters"]
        default = parameters("default")
        table = self.succeed("offline_odometry", "--print-parameters").stdout.split("\nThe node")[0]
        self.assertEqual(list(default),
                         sorted(re.findall(r"^\| `(.*?)` \|", table, re.MULTILINE)))
        changed = parameters("changed", "--set", "window/size=0", "--set", "motion/huber_delta=0.3")
        self.assertEqual({name: value for name, value in changed.items() if value != default[name]},
                         {"window/size": "0", "motion/huber_delta": changed["motion/huber_delta"]})
        self.assertAlmostEqual(float(changed["motion/huber_delta"]), 0.3)
        same = parameters("same", *(word for name, value in changed.items()
                                    for word in ("--set", f"{name}={value}")))
        self.assertEqual(same, changed)

    def test_print_parameters(self):
        text = self.succeed("offline_odometry", "--print-parameters").stdout
        core, node = (re.findall(r"^\|.*$", part, re.MULTILINE) for part in text.split("\nThe node"))
        for table, name in ((core, "points/cell_size_px"), (node, "recorder/frames")):
            self.assertEqual(table[0], "| name | default | range | unit | meaning |")
            self.assertEqual(len([row for row in table if row.startswith(f"| `{name}` |")]), 1)
            self.assertEqual({row.count("|") for row in table}, {6})

    def test_help(self):
        self.assertIn("usage: offline_odometry INPUT -o DIR",
                      self.succeed("offline_odometry", "--help").stdout)

    def test_refuses_bad_arguments(self):
        output = self.path("out")
        self.refuse("--help", "offline_odometry", self.kitti, "-o", output, "--colour")
        self.refuse("no input", "offline_odometry", "-o", output)
        self.refuse("-o DIR", "offline_odometry", self.kitti)
        for option in (["--max-frames", "0"], ["--max-frames=-1"], ["--max-frames", "many"],
                       ["--features-images", "0"], ["--approximate-sync", "nan"],
                       ["--every", "0"], ["--every=-2"], ["--every", "1.5"], ["--every", "few"],
                       ["--scale", "0"], ["--scale=-1"], ["--scale", "0.09"], ["--scale", "10.1"],
                       ["--scale", "nan"], ["--scale", "half"]):
            name = option[0].split("=")[0]
            self.refuse(name, "offline_odometry", self.kitti, "-o", output, *option)

    def test_refuses_bad_masks(self):
        def refuse(words, file):
            self.refuse(words, "offline_odometry", self.kitti, "-o", self.path("out"),
                        "--right-mask", file)
        refuse(["right mask", "cannot be read"], self.path("no_such.png"))
        text = self.path("text.png")
        write(text, "no image")
        refuse(["right mask", "cannot be read"], text)
        small = self.path("small.png")
        write_png(small, [bytes(3)] * 2)
        refuse([f"right mask '{small}' is 3 x 2", f"{WIDTH} x {HEIGHT}"], small)

    def test_refuses_a_bag_without_masks(self):
        self.refuse(["no masks", "left/mask_image"], "offline_odometry", self.make_bag(), "-o",
                    self.path("out"), "--mask-images")

    def test_refuses_bad_parameters(self):
        def refuse(words, *options):
            self.refuse(words, "offline_odometry", self.kitti, "-o", self.path("out"), *options)
        refuse("'nothing/here'", "--set", "nothing/here=1")
        refuse("points/levels", "--set", "points/levels=1.5")
        refuse("points/levels is 99", "--set", "points/levels=99")
        refuse("true or false", "--set", "lines/enabled=yes")
        refuse("name=value", "--set", "lines/enabled")
        refuse("gone.yaml", "--config", self.path("gone.yaml"))
        refuse("does not exist", "--config", self.root)
        write(self.path("bad.yaml"), "points:\n  cells: 3\n")
        refuse(["bad.yaml", "points/cells"], "--config", self.path("bad.yaml"))
        write(self.path("broken.yaml"), "points: [1, 2\n")
        refuse("broken.yaml", "--config", self.path("broken.yaml"))

    def test_warns_of_retired_parameters(self):
        config = self.path("old.yaml")
        write(config, "motion: {max_iterations: 20}\nlines:\n  enabled: false\n")
        expected = self.offline(self.kitti, "new", "--max-frames", 2, "--set", "lines/enabled=false")
        result = self.succeed("offline_odometry", self.kitti, "-o", self.path("old"),
                              "--max-frames", "2", "--config", config,
                              "--set", "window/max_iterations=7", "--quiet")
        for name in ("motion/max_iterations", "window/max_iterations"):
            self.assertEqual(result.stderr.count(f"warning: parameter {name} is ignored"), 1)
        self.assertEqual(len(result.stderr.splitlines()), 2, result.stderr)
        self.assertSameFile("trajectory.tum", expected, self.path("old"))

    def test_refuses_bad_folders(self):
        def refuse(words):
            self.refuse(words, "offline_odometry", self.kitti, "-o", self.path("out"))
        cut_off(os.path.join(self.kitti, "image_1", "000002.png"))
        refuse(["000002.png", "cannot be decoded"])
        os.remove(os.path.join(self.kitti, "image_1", "000002.png"))
        refuse(["is truncated", "image_1 3"])
        shutil.rmtree(self.kitti)
        refuse("does not exist")
        os.mkdir(self.kitti)
        refuse("holds no data set")

    def test_leaves_older_results_alone_when_it_fails(self):
        output = self.offline(self.kitti, "out", "--features-images", 1)
        before = read(os.path.join(output, "frames.csv"))
        cut_off(os.path.join(self.kitti, "image_0", "000003.png"))
        self.refuse("000003.png", "offline_odometry", self.kitti, "-o", output, "--quiet",
                    "--features-images", 1)
        self.assertEqual(read(os.path.join(output, "frames.csv")), before)

    def test_refuses_output_that_cannot_be_written(self):
        self.refuse("calib.txt", "offline_odometry", self.kitti, "-o",
                    os.path.join(self.kitti, "calib.txt", "out"))


class BagInputTest(ToolTest):
    def refuse_bag(self, words, bag, *options):
        self.refuse(words, "offline_odometry", bag, "-o", self.path("out"), "--quiet", *options)

    def test_refuses_what_is_no_bag(self):
        write(self.path("text.bag"), "no bag")
        self.refuse_bag(["text.bag", "cannot be read"], self.path("text.bag"))
        write(self.path("empty.bag"), "")
        self.refuse_bag(["empty.bag", "cannot be read"], self.path("empty.bag"))
        self.refuse_bag(["gone.bag", "does not exist"], self.path("gone.bag"))

    def test_refuses_bag_that_is_cut_off(self):
        bag = self.make_bag()
        cut_off(bag)
        self.refuse_bag(["made.bag", "rosbag reindex"], bag)

    def test_refuses_bag_with_damaged_images(self):
        bag = self.path("lz4.bag")
        self.succeed("dataset_to_bag", self.kitti, bag, "--quiet", "--compression", "lz4")
        content = bytearray(read(bag))
        for i in range(len(content) // 2, len(content) // 2 + 50):
            content[i] ^= 0x55
        with open(bag, "wb") as file:
            file.write(content)
        self.refuse_bag("lz4.bag", bag)

    def test_refuses_bag_without_the_right_camera(self):
        self.refuse_bag(["--left-topic", "/stereo/left/image_rect"],
                        self.make_bag(lambda t, m: [] if "right" in t else [(t, m)]))

    def test_refuses_bag_without_camera_info(self):
        self.refuse_bag("/stereo/left/camera_info",
                        self.make_bag(lambda t, m: [] if "camera_info" in t else [(t, m)]))

    def test_refuses_topic_that_is_not_there(self):
        self.refuse_bag(["'/nix/left/image'", "/stereo/left/image_rect"], self.make_bag(),
                        "--left-topic", "/nix/left/image")

    def test_refuses_bag_with_two_pairs_unless_one_is_named(self):
        bag = self.make_bag(lambda t, m: [("/a" + t, m), ("/b" + t, m)])
        self.refuse_bag(["several stereo pairs", "/b/stereo/left/image_rect"], bag)
        output = self.offline(bag, "out", "--left-topic", "/b/stereo/left/image_rect")
        self.assertEqual(read(os.path.join(output, "trajectory.tum")).count(b"\n"), FRAMES)

    def test_finds_the_only_pair_in_another_name_space(self):
        bag = self.make_bag(lambda t, m: [("/robot" + t, m)])
        self.assertSameFile("trajectory.kitti", self.offline(bag, "a"),
                            self.offline(self.kitti, "b"))

    def test_pairs_by_stamps(self):
        def later(topic, message):
            if topic.endswith("right/image_rect"):
                message.header.stamp.nsecs += 1000000
            return [(topic, message)]
        bag = self.make_bag(later)
        self.refuse_bag("--approximate-sync", bag)
        for interval in (0.002, 0.0011):  # with the latter the last pair waits for a nearer partner
            output = self.offline(bag, "out", "--approximate-sync", interval)
            self.assertEqual(read(os.path.join(output, "trajectory.tum")).count(b"\n"), FRAMES)

    def test_passes_over_images_without_partner(self):
        seen = []

        def drop(topic, message):
            seen.append(topic)
            lonely = topic.endswith("right/image_rect") and seen.count(topic) == 2
            return [] if lonely else [(topic, message)]
        output = self.offline(self.make_bag(drop), "out")
        with open(os.path.join(output, "summary.json")) as file:
            summary = json.load(file)
        self.assertEqual((summary["frames"], summary["unpaired_images"]), (FRAMES - 1, 1))

    def warnings_of(self, bag, *options):
        """(number of frames, what is printed on stderr) of a run on a bag."""
        output = self.path("out")
        result = self.succeed("offline_odometry", bag, "-o", output, "--quiet", *options)
        with open(os.path.join(output, "summary.json")) as file:
            summary = json.load(file)
        for warning in summary["warnings"]:
            self.assertIn(warning, result.stderr)
        return summary["frames"], "\n".join(summary["warnings"])

    def test_pairs_nearest_stamps(self):
        """The left camera begins a frame late: each left image has a right one of the same stamp."""
        seen = []

        def late(topic, message):
            seen.append(topic)
            first = topic.endswith("left/image_rect") and seen.count(topic) == 1
            return [] if first else [(topic, message)]
        bag = self.make_bag(late)
        exact = self.offline(bag, "exact")
        self.assertSameFile("trajectory.kitti", exact,
                            self.offline(bag, "near", "--approximate-sync", 0.11))

    def test_a_wild_stamp_costs_one_pair(self):
        for seconds in (4000000000, 4294967295, 1700000000):
            for options in ((), ("--approximate-sync", 0.02)):
                for index in (1, 2, FRAMES):
                    with self.subTest(seconds=seconds, options=options, index=index):
                        seen = []

                        def wild(topic, message, seen=seen, index=index, seconds=seconds):
                            seen.append(topic)
                            if topic.endswith("left/image_rect") and seen.count(topic) == index:
                                message.header.stamp.secs = seconds
                            return [(topic, message)]
                        frames, warnings = self.warnings_of(self.make_bag(wild), *options)
                        self.assertEqual(frames, FRAMES - 1)
                        self.assertIn("1 images are not used for their stamps", warnings)
                        self.assertIn(f"/stereo/left/image_rect: stamp {seconds}", warnings)

    def test_a_pause_before_the_end_costs_nothing(self):
        def pause(topic, message):
            if topic.startswith("/stereo") and message.header.stamp.to_sec() > 1.15:
                message.header.stamp.secs += 3
            return [(topic, message)]
        frames, warnings = self.warnings_of(self.make_bag(pause))
        self.assertEqual((frames, warnings), (FRAMES, ""))

    def test_a_damaged_image_costs_one_pair(self):
        seen = []

        def damage(topic, message):
            seen.append(topic)
            if topic.endswith("left/image_rect") and seen.count(topic) == 3:
                message.data = message.data[:100]
            return [(topic, message)]
        frames, warnings = self.warnings_of(self.make_bag(damage))
        self.assertEqual(frames, FRAMES - 1)
        self.assertIn("1 pairs are not used", warnings)
        self.assertIn("1.2", warnings)  # its stamp

    def test_one_other_calibration_changes_nothing(self):
        seen = []

        def change(topic, message):
            seen.append(topic)
            if topic.endswith("right/camera_info") and seen.count(topic) == 3:
                message.P = [2.0 * p for p in message.P]
            return [(topic, message)]
        frames, warnings = self.warnings_of(self.make_bag(change))
        self.assertEqual(frames, FRAMES)
        self.assertIn("P on '/stereo/right/camera_info'", warnings)

    def test_compressed_images_are_named(self):
        def compress(topic, message):
            if not topic.endswith("image_rect"):
                return [(topic, message)]
            return [(topic + "/compressed", CompressedImage(header=message.header, format="jpeg"))]
        self.refuse_bag(["/stereo/left/image_rect/compressed", "republish"],
                        self.make_bag(compress))

    def test_one_of_two_imus(self):
        """That in the camera's namespace, or the one that is named."""
        bag = self.path("imus.bag")
        self.succeed("dataset_to_bag", "synthetic:street,frames=6", self.path("one.bag"), "--quiet")
        use = ("--set", "imu/enabled=true")
        alone = self.offline(self.path("one.bag"), "alone", *use)
        for other, options in (("/base/imu", ()), ("/stereo/imu", ("--imu-topic", "/front/imu"))):
            with rosbag.Bag(self.path("one.bag")) as source, rosbag.Bag(bag, "w") as target:
                for topic, message, stamp in source.read_messages():
                    if topic == "/stereo/imu" and options:
                        target.write("/front/imu", message, stamp)
                    elif topic == "/stereo/imu":
                        target.write(topic, message, stamp)
                    if topic != "/stereo/imu":
                        target.write(topic, message, stamp)
                        continue
                    turned = copy.deepcopy(message)
                    turned.angular_velocity.z += 1.0
                    target.write(other, turned, stamp)
            self.assertSameFile("trajectory.tum", alone, self.offline(bag, "two", *use, *options))
        self.refuse_bag(["no IMU '/nix'", "/front/imu"], bag, *use, "--imu-topic", "/nix")

    def test_refuses_unknown_encoding(self):
        def bayer(topic, message):
            if "image" in topic:
                message.encoding = "bayer_rggb8"
            return [(topic, message)]
        self.refuse_bag("bayer_rggb8", self.make_bag(bayer))

    def test_refuses_uncalibrated_camera(self):
        def uncalibrated(topic, message):
            if "camera_info" in topic:
                message.P = [0.0] * 12
            return [(topic, message)]
        self.refuse_bag(["camera_info", "P"], self.make_bag(uncalibrated))

    def test_refuses_changing_calibration(self):
        def changing(topic, message):
            if "camera_info" in topic and message.header.stamp.to_sec() > 1.05:
                message.P = [2.0 * p for p in message.P]
            return [(topic, message)]
        self.refuse_bag("changes its calibration", self.make_bag(changing))


class DatasetToBagTest(ToolTest):
    def test_content(self):
        result = self.succeed("dataset_to_bag", self.kitti, self.path("out.bag"))
        self.assertIn("shifted by 1 s", result.stdout)
        self.assertEqual(os.listdir(self.root).count("out.bag.part"), 0)
        messages = {}
        with rosbag.Bag(self.path("out.bag")) as bag:
            for topic, message, stamp in bag.read_messages():
                messages.setdefault(topic, []).append(message)
                if topic.startswith("/stereo"):
                    self.assertEqual(stamp, message.header.stamp)
            latched = {c.topic for c in bag._get_connections() if c.header.get("latching") == b"1"}
        self.assertEqual(latched, {"/tf_static", "/ground_truth/path"})
        for side in ("left", "right"):
            images = messages[f"/stereo/{side}/image_rect"]
            infos = messages[f"/stereo/{side}/camera_info"]
            self.assertEqual((len(images), len(infos)), (FRAMES, FRAMES))
            self.assertEqual(images[1].header.stamp.to_nsec(), 1100000000)
            self.assertEqual(infos[1].header.stamp.to_nsec(), 1100000000)
            self.assertEqual(images[0].encoding, "mono8")
            self.assertEqual((images[0].width, images[0].height), (WIDTH, HEIGHT))
            self.assertEqual(images[0].header.frame_id, f"{side}_camera")
            self.assertEqual(infos[0].R, (1, 0, 0, 0, 1, 0, 0, 0, 1))
            self.assertEqual(infos[0].K[0], FOCAL_PX)
        self.assertEqual(messages["/stereo/right/camera_info"][0].P[3], -FOCAL_PX * BASELINE_M)
        self.check_tf(messages["/tf_static"][0].transforms)
        self.check_path(messages["/ground_truth/path"][0])

    def check_tf(self, transforms):
        names = [(t.header.frame_id, t.child_frame_id) for t in transforms]
        self.assertEqual(names, [("base_link", "left_camera"), ("left_camera", "right_camera")])
        q = transforms[0].transform.rotation
        self.assertEqual((q.x, q.y, q.z, q.w), (-0.5, 0.5, -0.5, 0.5))
        self.assertAlmostEqual(transforms[1].transform.translation.x, BASELINE_M)

    def check_path(self, path):
        self.assertEqual((path.header.frame_id, len(path.poses)), ("odom", FRAMES))
        last = path.poses[-1].pose.position  # to the right of the camera is -y of the base
        self.assertAlmostEqual(last.x, 0.0)
        self.assertAlmostEqual(last.y, -0.12 * (FRAMES - 1))
        self.assertAlmostEqual(path.poses[0].pose.orientation.w, 1.0)

    def test_options(self):
        self.succeed("dataset_to_bag", self.kitti, self.path("out.bag"), "--quiet",
                     "--namespace", "/car/front/", "--compression", "bz2", "--max-frames", 2)
        with rosbag.Bag(self.path("out.bag")) as bag:
            topics = bag.get_type_and_topic_info().topics
            self.assertEqual(topics["/car/front/left/image_rect"].message_count, 2)
            self.assertEqual(bag.get_compression_info().compression, "bz2")

    def test_every(self):
        def images(bag):
            with rosbag.Bag(bag) as messages:
                return [(stamp.to_nsec(), message.data)
                        for _, message, stamp in messages.read_messages("/stereo/left/image_rect")]
        every = images(self.make_bag())
        self.succeed("dataset_to_bag", self.kitti, self.path("two.bag"), "--quiet", "--every", 2)
        self.assertEqual(images(self.path("two.bag")), every[::2])
        self.succeed("dataset_to_bag", self.kitti, self.path("three.bag"), "--quiet", "--every", 3,
                     "--max-frames", 1)
        self.assertEqual(images(self.path("three.bag")), every[:1])
        self.assertSameFile("trajectory.kitti", self.offline(self.path("two.bag"), "a"),
                            self.offline(self.kitti, "b", "--every", 2))

    def test_duration_is_that_of_the_messages(self):
        # A pair fills a chunk of the bag, so that the path after the last one had a chunk of its
        # own, with the first stamp.
        bag = self.path("street.bag")
        for frames in (1, 4):
            self.succeed("dataset_to_bag", f"synthetic:street,frames={frames}", bag, "--quiet")
            with rosbag.Bag(bag) as messages:
                others = [stamp.to_sec() for topic, _, stamp in messages.read_messages()
                          if topic != "/ground_truth/path"]  # IMU and wheels begin before the images
                self.assertAlmostEqual(min(others), messages.get_start_time(), places=6)
                self.assertAlmostEqual(max(others), messages.get_end_time(), places=6)
                (_, path, stamp), = messages.read_messages("/ground_truth/path")
                first = next(iter(messages.read_messages("/stereo/left/image_rect")))
            self.assertEqual(len(path.poses), frames)
            self.assertEqual(stamp, first.timestamp)

    def test_help(self):
        self.assertIn("usage: dataset_to_bag DATASET OUT.bag",
                      self.succeed("dataset_to_bag", "--help").stdout)

    def test_refuses_bad_input(self):
        bag = self.path("out.bag")
        self.refuse("no data set", "dataset_to_bag")
        self.refuse("no bag", "dataset_to_bag", self.kitti)
        self.refuse("--help", "dataset_to_bag", self.kitti, bag, "--colour")
        self.refuse("'zip'", "dataset_to_bag", self.kitti, bag, "--compression", "zip")
        self.refuse("--max-frames", "dataset_to_bag", self.kitti, bag, "--max-frames", 0)
        for value in (0, -3, "1.5", "few"):
            self.refuse("--every", "dataset_to_bag", self.kitti, bag, f"--every={value}")
        self.refuse("name space", "dataset_to_bag", self.kitti, bag, "--namespace", "a b")
        self.refuse("cannot be written", "dataset_to_bag", self.kitti, self.path("nix", "out.bag"))
        self.refuse("does not exist", "dataset_to_bag", self.path("nix"), bag)
        self.refuse("exists already", "dataset_to_bag", self.kitti, self.kitti)

    def test_replaces_only_its_own_bags(self):
        bag = self.path("mine.bag")
        with rosbag.Bag(bag, "w") as mine:
            mine.write("/notes", String("mine"))
        before = read(bag)
        for tool, source in (("dataset_to_bag", self.kitti), ("dataset_to_bag", "synthetic:street")):
            self.refuse(["mine.bag' exists already", "remove it"], tool, source, bag, "--quiet",
                        "--max-frames", 1)
        self.assertEqual(read(bag), before)
        for _ in range(2):
            self.succeed("dataset_to_bag", self.kitti, self.path("own.bag"), "--quiet")

    def test_failure_leaves_the_older_bag(self):
        bag = self.make_bag()
        before = read(bag)
        cut_off(os.path.join(self.kitti, "image_0", "000003.png"))
        self.refuse("000003.png", "dataset_to_bag", self.kitti, bag, "--quiet")
        self.assertEqual(read(bag), before)

    def test_bag_of_a_run_that_was_killed_is_refused_with_the_cure(self):
        part = self.path("killed.bag.part")
        command = [find_program("dataset_to_bag"), data_folder("rendered_town"),
                   self.path("killed.bag"), "--compression", "bz2", "--quiet"]
        with subprocess.Popen(command) as process:
            deadline = time.monotonic() + 30.0
            while not (os.path.exists(part) and os.path.getsize(part) > 1000000):
                self.assertLess(time.monotonic(), deadline)
                time.sleep(0.01)
            process.kill()
        self.assertFalse(os.path.exists(self.path("killed.bag")))
        self.refuse(["was not closed", "rosbag reindex"], "offline_odometry", part,
                    "-o", self.path("out"))


class SyntheticWorldTest(ToolTest):
    FRAMES = 4

    def make(self, name, *options):
        self.succeed("synthetic_world", self.path(name), "--quiet", "--frames", self.FRAMES,
                     *options)
        return self.path(name)

    def check_same_everywhere(self, scene):
        """A folder, a bag and the world itself give the same trajectory; returns its results."""
        options = ["seed=3", "noise=2.5", f"frames={self.FRAMES}"]
        direct = self.offline(",".join(["synthetic:" + scene] + options), "direct")
        options = ["--scene", scene, "--seed", 3, "--noise", 2.5]
        folder = self.offline(self.make("folder", *options), "from_folder")
        bag = self.offline(self.make("world.bag", *options), "from_bag")
        self.assertSameFile("trajectory.kitti", direct, bag)
        for name in ("trajectory.kitti", "trajectory.tum", "groundtruth.tum"):
            self.assertSameNumbers(name, direct, folder)
        with open(os.path.join(direct, "summary.json")) as file:
            self.assertEqual(json.load(file)["states"], {"initializing": 1, "ok": self.FRAMES - 1})
        self.check_accuracy(direct, os.path.join(direct, "groundtruth.tum"))
        return folder

    def check_accuracy(self, output, ground_truth):
        result = self.succeed("evaluate_trajectory", "--json", "--groundtruth", ground_truth,
                              "--estimate", os.path.join(output, "trajectory.tum"))
        self.assertLess(json.loads(result.stdout)["ate_m"]["rmse"], 0.02)

    def test_street(self):
        self.check_same_everywhere("street")
        self.assertEqual(sorted(os.listdir(self.path("folder"))),
                         ["calib.txt", "image_0", "image_1", "poses.txt", "synthetic_world.yaml",
                          "times.txt"])
        self.assertEqual(sorted(os.listdir(self.path("folder", "image_1"))),
                         [f"{i:06}.png" for i in range(self.FRAMES)])

    def test_bonnet_is_masked_by_files_topics_and_directly(self):
        """The same masks give the same trajectory, another one than without."""
        options = ["--scene", "street", "--seed", 3, "--bonnet", 1.5]
        source = f"synthetic:street,seed=3,bonnet=1.5,frames={self.FRAMES}"
        direct = self.offline(source, "direct", "--mask-images")
        without = self.offline(source, "without")
        folder = self.make("folder", *options)
        files = ["--left-mask", os.path.join(folder, "mask_left.png"),
                 "--right-mask", os.path.join(folder, "mask_right.png")]
        from_files = self.offline(folder, "from_files", *files)
        bag = self.make("world.bag", *options)
        from_bag = self.offline(bag, "from_bag", "--mask-images")
        self.succeed("dataset_to_bag", folder, self.path("of_folder.bag"), "--quiet", *files)
        converted = self.offline(self.path("of_folder.bag"), "converted", "--mask-images")
        self.assertSameFile("trajectory.kitti", direct, from_bag)
        self.assertSameNumbers("trajectory.kitti", direct, from_files)
        self.assertSameFile("trajectory.kitti", from_files, converted)
        self.assertNotEqual(read(os.path.join(direct, "trajectory.kitti")),
                            read(os.path.join(without, "trajectory.kitti")))
        self.assertSameFile("trajectory.kitti", without, self.offline(bag, "bag_without"))
        self.check_accuracy(direct, os.path.join(direct, "groundtruth.tum"))

    def test_scaled_images_have_scaled_masks(self):
        source = f"synthetic:street,bonnet=1,frames={self.FRAMES}"
        masked = self.offline(source, "masked", "--mask-images", "--scale", 0.5)
        self.check_accuracy(masked, os.path.join(masked, "groundtruth.tum"))

    def test_corridor(self):
        output = self.check_same_everywhere("corridor")
        ground_truth = self.path("folder", "mav0", "state_groundtruth_estimate0", "data.csv")
        self.check_accuracy(output, ground_truth)

    def test_bag_is_that_of_the_folder(self):
        for scene, left_out in (("street", "/stereo/imu"), ("corridor", None)):
            contents = []
            for source in (f"synthetic:{scene},frames={self.FRAMES}",
                           self.make(scene, "--scene", scene)):
                name = self.path("a.bag")
                self.succeed("dataset_to_bag", source, name, "--quiet")
                with rosbag.Bag(name) as bag:
                    contents.append([(topic, stamp, getattr(message, "data", None),
                                      getattr(message, "angular_velocity", None))
                                     for topic, message, stamp in bag.read_messages()
                                     # Folders have no wheels, KITTI's layout has no IMU and
                                     # EuRoC's no stamps before 0.
                                     if topic not in (left_out, "/wheel_odom") and stamp.to_sec() >= 1.0])
            self.assertTrue(contents[0] == contents[1])
            topics = {topic for topic, *_ in contents[0]}
            self.assertIn("/ground_truth/path", topics)
            self.assertEqual("/stereo/imu" in topics, left_out is None)

    def test_same_options_give_the_same_bytes(self):
        image = os.path.join("image_1", "000003.png")
        self.assertSameFile(image, self.make("a"), self.make("b"))
        self.assertNotEqual(read(self.path("a", image)),
                            read(os.path.join(self.make("c", "--seed", 2), image)))

    def test_replaces_its_own_folder(self):
        folder = self.make("folder")
        self.make("folder", "--scene", "corridor")
        self.assertEqual(sorted(os.listdir(folder)), ["mav0", "synthetic_world.yaml"])
        with open(os.path.join(folder, "synthetic_world.yaml")) as file:
            self.assertIn("scene: corridor\n", file.read())
        os.mkdir(self.path("empty"))
        self.make("empty")
        os.rename(folder, self.path("killed.part"))  # as a run that was killed leaves it
        self.make("killed")
        self.assertEqual(sorted(os.listdir(self.root)), ["empty", "killed", "kitti"])

    def test_follows_a_path(self):
        write(self.path("path.tum"), "# forward, and 0.2 m to the right\n5 0 0 0 0 0 0 1\n"
              "5.3 0.2 0 0.6 0 0 0 1\n")
        output = self.offline(f"synthetic:street,path={self.path('path.tum')}", "out")
        rows = read(os.path.join(output, "groundtruth.tum")).decode().splitlines()
        self.assertEqual(len(rows), 4)
        last = [float(number) for number in rows[-1].split()]
        for number, expected in zip(last, [0.3, 0.2, 0, 0.6, 0, 0, 0, 1]):
            self.assertAlmostEqual(number, expected, places=6)

    def test_length(self):
        source = f"synthetic:street,length=3,path={self.path('path.tum')}"
        write(self.path("path.tum"), "0 0 0 0 0 0 0 1\n10 0 0 100 0 0 0 1\n")  # 1 m a frame
        output = self.offline(source, "out")
        self.assertEqual(read(os.path.join(output, "trajectory.tum")).count(b"\n"), 4)

    def test_print_parameters(self):
        table = self.succeed("synthetic_world", "--print-parameters").stdout
        self.assertIn("| `noise` | -1 | -1 ... 50 | grey levels |", table)
        self.assertIn("| `scene` | street | street, indoor, corridor, plaster |", table)

    def test_help(self):
        text = self.succeed("synthetic_world", "--help").stdout
        self.assertIn("usage: synthetic_world OUT", text)
        self.assertIn("--motion_blur_ms", text)

    def test_refuses_bad_options(self):
        out = self.path("out")
        self.refuse("no output", "synthetic_world")
        for words, *options in (
                ("--help", "--colour", 3), ("noise", "--noise", "much"),
                (["noise is 99", "seed is -1"], "--noise", 99, "--seed", -1),
                (["'moon'", "corridor"], "--scene", "moon"), ("frames is 0", "--frames", 0),
                ("both frames and length", "--frames", 5, "--length", 5),
                ("'zip'", "--format", "zip"), ("choose kitti or bag", "--format", "euroc"),
                ("choose euroc or bag", "--format", "kitti", "--scene", "indoor"),
                ("--compression is for bags", "--compression", "lz4"),
                ("gone.tum", "--path", self.path("gone.tum"))):
            self.refuse(words, "synthetic_world", out, *options)
        write(self.path("bad.tum"), "1 2 3\n")
        self.refuse(["bad.tum", "line 1"], "synthetic_world", out, "--path", self.path("bad.tum"))

    def test_refuses_bad_names(self):
        for words, name in (("'moon'", "synthetic:moon"), ("'blur'", "synthetic:blur=3"),
                            ("'noise'", "synthetic:street,noise"),
                            ("noise is 99", "synthetic:noise=99")):
            self.refuse(words, "offline_odometry", name, "-o", self.path("out"))
            self.refuse(words, "dataset_to_bag", name, self.path("out.bag"))

    def test_never_touches_what_it_has_not_written(self):
        self.refuse("not written by this program", "synthetic_world", self.kitti)
        self.refuse("calib.txt", "synthetic_world", os.path.join(self.kitti, "calib.txt"))
        os.rename(self.kitti, self.path("out.part"))
        self.refuse("out.part", "synthetic_world", self.path("out"))

    def test_refuses_output_that_cannot_be_written(self):
        self.refuse("cannot be written", "synthetic_world",
                    os.path.join(self.kitti, "calib.txt", "out"))
        self.refuse("cannot be written", "synthetic_world", self.path("nix", "out.bag"))

    def test_interruption_leaves_nothing(self):
        """Neither a new result nor a change of an older one, and the caller sees the signal."""
        self.make("older")
        before = self.listing()
        world = "synthetic:street,frames=1000"
        for command in (["synthetic_world", self.path("new"), "--frames", 1000],
                        ["synthetic_world", self.path("older"), "--frames", 1000],
                        ["synthetic_world", self.path("new.bag"), "--frames", 1000],
                        ["dataset_to_bag", world, self.path("new.bag")],
                        ["offline_odometry", world, "-o", self.path("results")]):
            for number in (signal.SIGINT, signal.SIGTERM):
                result = self.interrupt(command, number)
                self.assertEqual(result.returncode, -number)
                self.assertIn("interrupted", result.stderr)
                self.assertEqual(self.listing(), before)

    def interrupt(self, command, number):
        """Sends the signal when something has been written."""
        before = self.listing()
        command = [find_program(command[0])] + [str(argument) for argument in command[1:]]
        # Whoever runs the tests in the background may have had SIGINT ignored, which is inherited.
        with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE,
                              universal_newlines=True,
                              preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
                              ) as process:
            deadline = time.monotonic() + 30.0
            while self.listing() == before:
                self.assertLess(time.monotonic(), deadline)
                time.sleep(0.01)
            process.send_signal(number)
            _, errors = process.communicate(timeout=30)
        return subprocess.CompletedProcess(command, process.returncode, "", errors)


class RealDataTest(ToolTest):
    def check(self, name):
        folder = data_folder(name)
        bag = self.path("real.bag")
        self.succeed("dataset_to_bag", folder, bag, "--max-frames", 12, "--quiet")
        first = self.offline(folder, "a", "--max-frames", 12)
        second = self.offline(folder, "b", "--max-frames", 12)
        from_bag = self.offline(bag, "c")
        self.assertSameFile("trajectory.kitti", first, second)
        self.assertSameFile("trajectory.kitti", first, from_bag)
        with open(os.path.join(first, "summary.json")) as file:
            self.assertEqual(json.load(file)["states"], {"initializing": 1, "ok": 11})

    def test_kitti(self):
        self.check("kitti_06_000-050")

    def test_euroc(self):
        self.check("euroc_MH_01_000-099")


if __name__ == "__main__":
    own = [argument for argument in sys.argv[1:] if not argument.startswith("--gtest_output")]
    unittest.main(argv=sys.argv[:1] + own)
