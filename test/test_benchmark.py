#!/usr/bin/env python3
"""The benchmark: its rows, its results as JSON, and what it refuses."""

import json
import os
import re
import signal
import subprocess
import time
import unittest

from document_fixture import read_document
from tool_fixture import ToolTest, find_program, run

STAGES = ["cv_lsd", "cv_orb", "lines", "points", "match_stereo", "triangulate", "match_circular",
          "correspondences", "estimate", "fuse", "features_stereo"]
SEGMENTS = ["all_ours", "all_cv_lsd", "n_longest_ours", "n_longest_cv_lsd"]
NO_YARDSTICK = "no line segment detector"


def markdown_tables(text):
    """The tables, each as rows of cells, the headings first."""
    tables = [[]]
    for line in text.splitlines() + [""]:
        if line.startswith("|"):
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if set(line) - set("|-: "):
                tables[-1].append(cells)
        elif tables[-1]:
            tables.append([])
    return tables[:-1]


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

    def test_a_folder_stands_for_its_sequences(self):
        os.mkdir(self.path("no_sequence"))
        result = self.succeed("benchmark", "--data", self.root, "--benchmark_list_tests")
        self.assertEqual({name.split("/")[0] for name in result.stdout.splitlines()},
                         {"street", "indoor", "kitti"})

    def test_summary(self):
        result = self.succeed("benchmark", "--data", self.kitti, "--summary", "--frames", 4)
        self.assertIn("no sequence of about 1242 x 375 px is given", result.stderr)
        self.assertIn("no sequence of about 752 x 480 px is given", result.stderr)
        times, others, stages = markdown_tables(result.stdout)
        with_yardstick = NO_YARDSTICK not in result.stdout
        inputs = ("street, 1241 x 376", "indoor, 752 x 480", "kitti, 320 x 160")
        self.assertEqual(times[0][1::2], [name + ": ms" for name in inputs] + ["goal"])
        self.assertEqual(times[0][2::2], ["of cv LSD"] * 3)
        rows = {row[0]: row[1:] for row in times[1:]}
        for name in ("two threads", "one thread", "processor time, one thread"):
            lsd = "processor time, cv LSD" if "processor" in name else "cv LSD, one image"
            lsd_ms = rows[lsd][0::2][:3]
            for i in range(3):
                ms, ratio = rows[name][2 * i:2 * i + 2]
                self.assertGreater(float(ms), 0.0, name)
                if with_yardstick:  # both are rounded to 0.1 ms
                    self.assertAlmostEqual(float(ratio), float(ms) / float(lsd_ms[i]),
                                           delta=0.01 + 0.1 * (1 + float(ratio)) / float(lsd_ms[i]))
                else:
                    self.assertEqual(ratio, "")
        self.assertEqual([rows[name][-1] for name in ("two threads", "one thread")],
                         ["<= 0.25", "<= 0.45"])
        self.assertEqual(others[0][1:], [*inputs, "goal"])
        for row in others[1:]:
            large = row[0].startswith(("images 3 times", "the same in full"))
            for cell in row[1:-1]:
                if cell:
                    self.assertGreater(float(cell), 0.0, row[0])
            self.assertEqual([bool(cell) for cell in row[1:-1]], [True] + 2 * [not large], row[0])
        self.check_stages(stages)
        self.assertIn("\nStages that more threads do not speed up by a fifth: ", result.stdout)

    def check_stages(self, stages):
        names = [row[0] for row in stages[1:]]
        self.assertIn("detect", names)
        for column in (1, 2):
            times = [float(row[column]) for row in stages[1:]]
            self.assertEqual(names[-1], "whole frame")
            self.assertAlmostEqual(sum(times[:-1]), times[-1], delta=0.01 * len(times))

    def test_summary_of_a_drive(self):
        result = self.succeed("benchmark", "--data", self.kitti, "--summary", "--frames", 4,
                              "--drive", 12)
        drive = markdown_tables(result.stdout)[-1]
        self.assertEqual(drive[0][:3], ["driven [m]", "memory [MB]", "peak [MB]"])
        self.assertEqual(len(drive), 1 + 8)
        self.assertEqual(float(drive[-1][0]), 12.0)
        peaks = [float(row[2]) for row in drive[1:]]
        self.assertEqual(peaks, sorted(peaks))
        for row in drive[1:]:
            self.assertGreater(float(row[1]), 10.0)
            self.assertLessEqual(float(row[1]), float(row[2]) + 0.1)

    def test_documents_have_the_rows_of_the_summary(self):
        """Of the whole frame: the names of rows, and other systems' figures."""
        result = self.succeed("benchmark", "--data", self.kitti, "--summary", "--frames", 4)
        text = read_document("doc/results.md")
        documented = [row for table in markdown_tables(text) for row in table]
        names = {row[0] for row in documented}
        for table in markdown_tables(result.stdout)[:2]:
            for row in table[1:]:
                self.assertTrue(row[0] in names or re.fullmatch(r"\d+ threads", row[0]), row[0])
        for row in markdown_tables(result.stdout)[0][1:]:
            if row[1] == "":
                found, = (other for other in documented if other[0] == row[0])
                self.assertEqual(row[1:5], found[1:5])

    def test_refuses_what_it_cannot_use(self):
        self.refuse("unrecognised option '--fast'", "benchmark", "--fast")
        self.refuse("--benchmark_fast", "benchmark", "--benchmark_fast=1")
        self.refuse("does not exist", "benchmark", "--data", self.path("nothing"))
        self.refuse("--frames", "benchmark", "--frames", "2")
        self.refuse("--benchmark_", "benchmark", "--summary", "--benchmark_filter=frame")
        self.refuse("--drive", "benchmark", "--drive", "100")
        self.refuse("--drive", "benchmark", "--summary", "--drive", "0")
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
