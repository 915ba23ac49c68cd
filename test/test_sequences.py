#!/usr/bin/env python3
"""Runs offline_odometry on real sequences and in the built-in world and holds its errors to bounds.

Bounds are 1.3 times what was measured when they were set; the comments give that and, for the
sequences of files, what the best peers reach on the same images. Programs and data are found as in
test_tools.py; sequences that are absent are skipped.
"""

import json
import os
import shutil
import subprocess
import tempfile
import unittest

from tool_fixture import data_folder, run

EVALUATE = os.path.join(os.path.dirname(os.path.dirname(os.path.realpath(__file__))),
                        "scripts", "evaluate_trajectory")


def odometry(sequence, output, *options):
    """Runs the odometry, which must not write to the terminal; its summary."""
    result = run("offline_odometry", sequence, "-o", output, "--quiet", *options)
    if result.returncode != 0 or result.stderr:
        raise AssertionError(result.stderr)
    with open(os.path.join(output, "summary.json")) as file:
        return json.load(file)


def ground_truth(sequence, output):
    """Options of evaluate_trajectory: the ground truth and the estimate to be compared with it."""
    estimate = os.path.join(output, "trajectory.tum")
    if sequence.startswith("synthetic:"):
        return ["--groundtruth", os.path.join(output, "groundtruth.tum"), "--estimate", estimate]
    kitti = os.path.join(sequence, "poses.txt")
    if os.path.isfile(kitti):
        return ["--groundtruth", kitti, "--estimate", os.path.join(output, "trajectory.kitti")]
    return ["--groundtruth", os.path.join(sequence, "groundtruth_cam0.tum"),
            "--estimate", estimate, "--body-to-camera", "none"]


def evaluate(sequence, output):
    """Errors of a trajectory as {name: value}."""
    command = [EVALUATE, *ground_truth(sequence, output), "--json"]
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=120,
                            universal_newlines=True)
    if result.returncode != 0:
        raise AssertionError(result.stderr)
    scores = json.loads(result.stdout)
    return {"matched_frames": scores["matched_frames"],
            "t_percent": scores["short"]["t_rel_percent"],
            "r_deg_per_100m": scores["short"]["r_rel_deg_per_100m"],
            "ate_m": scores["ate_m"]["rmse"],
            "rpe_r_deg": scores["per_frame"]["rotation_rmse_deg"],
            "end_percent": scores["end_error"]["percent_of_path"]}


class ErrorTest(unittest.TestCase):
    """Errors on a sequence: the name of a folder of the real data, or synthetic:SCENE,..."""

    def setUp(self):
        self.root = tempfile.mkdtemp(prefix="point_line_sequences_")
        self.addCleanup(shutil.rmtree, self.root)

    def scores(self, name, *options):
        sequence = name if name.startswith("synthetic:") else data_folder(name)
        output = os.path.join(self.root, f"run{len(os.listdir(self.root))}")
        summary = odometry(sequence, output, *options)
        return summary, evaluate(sequence, output)

    def check(self, name, frames, bounds):
        summary, errors = self.scores(name)
        print(f"\n{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in errors.items()
                                        if value is not None), flush=True)
        self.assertEqual(summary["frames"], frames)
        self.assertEqual(errors["matched_frames"], frames)
        self.assertEqual(summary["states"], {"initializing": 1, "ok": frames - 1})
        self.assertEqual(summary["failed_windows"], 0)
        for key, bound in bounds.items():
            with self.subTest(error=key):
                self.assertLess(errors[key], bound)
        # True weights give 1. Measured: points 0.93 ... 1.27, lines 0.66 ... 1.19.
        for kind in ("points", "lines"):
            with self.subTest(residuals=kind):
                variance = summary["weighted_residuals"][kind]["variance"]
                self.assertTrue(0.5 < variance < 1.6, variance)

    def check_that_lines_help(self, name, factors):
        """Points alone are worse than points and lines by factors {error: factor}."""
        _, both = self.scores(name)
        _, points = self.scores(name, "--set", "lines/enabled=false")
        print(f"\n{name}, points alone: " + ", ".join(
            f"{key} {points[key]:.4f} against {both[key]:.4f}" for key in factors), flush=True)
        for key, factor in factors.items():
            with self.subTest(error=key):
                self.assertGreater(points[key], factor * both[key])


class RealSequences(ErrorTest):
    def test_kitti_raw_0926_0001(self):
        self.check("kitti_raw_0926_0001", 108, {
            "t_percent": 0.85,  # measured 0.654; ORB-SLAM2 0.718, viso2 1.211
            "r_deg_per_100m": 0.26,  # measured 0.202; Basalt 0.235, ORB-SLAM2 0.409, viso2 1.232
            "ate_m": 0.083,  # measured 0.0640; PL-StVO 0.099, ORB-SLAM2 0.114, viso2 0.304
            "rpe_r_deg": 0.018,  # measured 0.0141; Basalt 0.0152, PL-StVO 0.0231, viso2 0.0296
            "end_percent": 0.36,  # measured 0.272; PL-StVO 0.22, ORB-SLAM2 0.36, viso2 1.08
        })

    def test_kitti_06_000_050(self):
        self.check("kitti_06_000-050", 51, {
            "t_percent": 0.82,  # measured 0.634; ORB-SLAM2 0.636, viso2 0.988, PL-StVO 1.167
            "r_deg_per_100m": 2.1,  # measured 1.61; Basalt 1.631, ORB-SLAM2 1.784, viso2 2.958
            "ate_m": 0.042,  # measured 0.0318; ORB-SLAM2 0.050, viso2 0.120, PL-StVO 0.142
            "rpe_r_deg": 0.076,  # measured 0.0584; Basalt 0.0588, PL-StVO 0.0628, ORB-SLAM2 0.0675
            "end_percent": 1.1,  # measured 0.872; ORB-SLAM2 1.03, viso2 1.06, PL-StVO 1.09
        })

    def test_euroc_mh_01_000_099(self):
        self.check("euroc_MH_01_000-099", 100, {
            "ate_m": 0.0045,  # measured 0.00345; PL-StVO 0.0037, ORB-SLAM2 0.0040, viso2 0.0057
            "rpe_r_deg": 0.011,  # measured 0.00794; Basalt 0.0120, PL-StVO 0.0150, viso2 0.0549
            "end_percent": 0.63,  # measured 0.479; PL-StVO 0.51, ORB-SLAM2 0.57, viso2 1.39
        })

    def test_rendered_town(self):
        self.check("rendered_town", 125, {
            "t_percent": 0.031,  # measured 0.0202; viso2 0.275, ORB-SLAM2 0.535, PL-StVO 0.629
            "r_deg_per_100m": 0.048,  # measured 0.0316; ORB-SLAM2 0.248, PL-StVO 0.659, viso2 0.713
            "ate_m": 0.007,  # measured 0.00466; viso2 0.059, PL-StVO 0.157, ORB-SLAM2 0.175
            "rpe_r_deg": 0.0021,  # measured 0.00137; ORB-SLAM2 0.0175, viso2 0.0220
            "end_percent": 0.021,  # measured 0.0136; viso2 0.20, ORB-SLAM2 0.47, PL-StVO 0.66
        })

    def test_rendered_lowtexture(self):
        self.check("rendered_lowtexture", 100, {
            "ate_m": 0.013,  # measured 0.0113; PL-StVO 0.033, viso2 0.063, ORB-SLAM2 lost
            "rpe_r_deg": 0.013,  # measured 0.01; PL-StVO 0.045, viso2 0.104
            "end_percent": 0.91,  # measured 0.693; PL-StVO 4.1, viso2 7.1
        })

    def test_lines_help_where_corners_are_few(self):
        # Measured 0.0285 / 0.0113 m = 2.5 and 0.0301 / 0.0100 deg = 3.0; PL-StVO 5.3 and 5.1.
        self.check_that_lines_help("rendered_lowtexture", {"ate_m": 1.5, "rpe_r_deg": 2.1})


class BuiltInWorld(ErrorTest):
    """The bounds have more room here, up to twice what was measured: the errors are small enough for
    another version of OpenCV or Ceres to show."""

    def test_street(self):
        self.check("synthetic:street,seed=1,frames=100", 100, {
            "t_percent": 0.046,  # measured 0.0226
            "r_deg_per_100m": 0.086,  # measured 0.0505
            "ate_m": 0.0065,  # measured 0.00325
            "rpe_r_deg": 0.0028,  # measured 0.00151
        })

    def test_street_with_traffic(self):
        self.check("synthetic:street,seed=2,frames=100,moving_objects=8,noise=3", 100, {
            "t_percent": 0.057,  # measured 0.0331
            "r_deg_per_100m": 0.098,  # measured 0.049
            "ate_m": 0.007,  # measured 0.00349
            "rpe_r_deg": 0.003,  # measured 0.00176
        })

    def test_indoor(self):
        self.check("synthetic:indoor,seed=1,frames=150", 150, {
            "t_percent": 0.061,  # measured 0.0305
            "ate_m": 0.0015,  # measured 0.000724
            "rpe_r_deg": 0.0044,  # measured 0.00259
        })

    def test_indoor_dark_and_blurred(self):
        self.check("synthetic:indoor,seed=2,frames=150,motion_blur_ms=10,exposure_ev=-1.5", 150, {
            "t_percent": 0.085,  # measured 0.0423
            "ate_m": 0.002,  # measured 0.001
            "rpe_r_deg": 0.0067,  # measured 0.0041
        })

    def test_corridor(self):
        self.check("synthetic:corridor,seed=1,frames=250", 250, {
            "t_percent": 0.15,  # measured 0.0731
            "ate_m": 0.0066,  # measured 0.00381
            "rpe_r_deg": 0.019,  # measured 0.00922
        })

    def test_lines_help_in_the_corridor(self):
        # Measured 0.0271 / 0.0088 deg = 3.1. The position is as good with points alone on these 12 m
        # (0.0058 and 0.0056 m); over 29 m and five worlds, see the README.
        self.check_that_lines_help("synthetic:corridor,seed=2,frames=250", {"rpe_r_deg": 2.0})


if __name__ == "__main__":
    unittest.main()
