#!/usr/bin/env python3
"""The benchmark: its rows, its results as JSON, and what it refuses."""

import json
import os
import signal
import subprocess
import time
import unittest

from tool_fixture import ToolTest, find_program, run

STAGES = ["cv_lsd", "cv_orb", "gradient", "lines_from_gradient", "lines", "line_descriptors",
          "points", "match_stereo", "triangulate", "match_circular", "correspondences", "estimate",
          "fuse", "features_stereo"]
SEGMENTS = ["all_ours", "all_cv_lsd", "n_longest_ours", "n_longest_cv_lsd"]
NO_YARDSTICK = "no line segment detector"


class Benchmark(ToolTest):
    def measure(self, *arguments):
        """The rows of a quick run over the small sequence, by name without the input's."""
        out = self.path("result.json")
        self.succeed("benchmark", "--data", self.kitti, "--benchmark_min_time=0.01",
                     f"--benchmark_out={out}", *arguments)
        with open(out) as file:
            rows = json.load(file)["benchmarks"]
        self.assertFalse(os.path.exists(out + ".part"))
        names = [row["name"].split("/iterations")[0].replace("/manual_time", "") for row in rows]
        return {name.split("/", 1)[1]: row for name, row in zip(names, rows)}

    def test_every_input_has_all_rows(self):
        result = self.succeed("benchmark", "--data", self.kitti, "--benchmark_list_tests")
        expected = STAGES + ["frame"] + [f"segments/{name}" for name in SEGMENTS]
        names = [line.split("/iterations")[0].replace("/manual_time", "")
                 for line in result.stdout.splitlines()]
        self.assertEqual(sorted(names), sorted(f"{source}/{name}" for name in expected
                                               for source in ("street", "indoor", "kitti")))

    def test_rows_have_their_counters(self):
        rows = self.measure("--benchmark_filter=^kitti/")
        self.assertEqual(len(rows), len(STAGES) + 1 + len(SEGMENTS))
        with_yardstick = NO_YARDSTICK not in rows["cv_lsd"].get("error_message", "")
        for name in STAGES + ["frame"]:
            row = rows[name]
            if "error_message" in row:
                self.assertIn(NO_YARDSTICK, row["error_message"])
                continue
            self.assertGreater(row["median_ms"], 0.0, name)
            self.assertGreaterEqual(row["p95_ms"], row["median_ms"], name)
            self.assertEqual("vs_lsd" in row, with_yardstick, name)
            self.assertEqual("cpu_vs_lsd" in row, with_yardstick, name)
            if name not in ("cv_orb", "points"):  # the wall's crossings are no corners for FAST
                self.assertGreater(row["found"], 0, name)
        self.assertEqual(rows["frame"]["ok"], 1.0)
        self.assertLessEqual(rows["frame"]["detect"], rows["frame"]["p95_ms"])
        ours = rows["segments/all_ours"]
        self.assertGreater(ours["segments"], 10)
        for share in ("right", "next", "right_tracked", "next_tracked", "on_edge"):
            self.assertGreater(ours[share], 0.5, share)
            self.assertLessEqual(ours[share], 1.0, share)
        self.assertLess(ours["offset_med"], 0.3)

    def test_parameters_can_be_set(self):
        rows = self.measure("--benchmark_filter=^kitti/lines/", "--set", "lines/max_count=7")
        self.assertEqual(rows["lines"]["found"], 7)

    def test_sequences_are_found_by_the_variable(self):
        os.mkdir(self.path("no_sequence"))
        command = [find_program("benchmark"), "--benchmark_list_tests"]
        environment = dict(os.environ, POINT_LINE_ODOMETRY_DATA=self.root)
        names = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True,
                               universal_newlines=True).stdout.splitlines()
        self.assertEqual({name.split("/")[0] for name in names}, {"street", "indoor", "kitti"})

    def test_refuses_what_it_cannot_use(self):
        self.refuse("unrecognised option '--fast'", "benchmark", "--fast")
        self.refuse("--benchmark_fast", "benchmark", "--benchmark_fast=1")
        self.refuse("does not exist", "benchmark", "--data", self.path("nothing"))
        self.refuse("--frames", "benchmark", "--frames", "2")
        self.refuse("lines/nothing", "benchmark", "--set", "lines/nothing=1")
        self.refuse("two inputs", "benchmark", "--data", self.kitti, self.kitti)
        self.refuse("cannot be made", "benchmark",
                    f"--benchmark_out={self.kitti}/calib.txt/result.json")

    def test_a_filter_that_fits_no_row_is_an_error(self):
        out = self.path("result.json")
        result = run("benchmark", "--benchmark_filter=nothing", f"--benchmark_out={out}")
        self.assertEqual(result.returncode, 2)
        self.assertIn("no row fits", result.stderr)
        self.assertFalse(os.path.exists(out) or os.path.exists(out + ".part"))

    def test_an_interruption_leaves_no_result(self):
        out = self.path("result.json")
        process = subprocess.Popen(
            [find_program("benchmark"), "--data", self.kitti, "--benchmark_filter=^kitti/lines/",
             "--benchmark_min_time=60", f"--benchmark_out={out}"],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, universal_newlines=True)
        while not os.path.exists(out + ".part"):
            time.sleep(0.05)
        time.sleep(1.0)
        process.send_signal(signal.SIGTERM)
        _, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, -signal.SIGTERM)
        self.assertIn("interrupted, nothing is written", error)
        self.assertFalse(os.path.exists(out) or os.path.exists(out + ".part"))


if __name__ == "__main__":
    unittest.main()
