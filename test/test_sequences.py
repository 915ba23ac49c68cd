#!/usr/bin/env python3
"""Runs offline_odometry on real sequences and in the built-in world and checks bounds of its errors.

Bounds are 1.3 times what was measured when they were set; the comments give that and, for the
sequences of files, what the best peers reach on the same images. Programs and data are found as in
test_tools.py; sequences that are absent are skipped.
"""

import csv
import json
import math
import os
import random
import shutil
import subprocess
import tempfile
import unittest

from tool_fixture import data_folder, find_program, run, write

SCRIPTS = os.path.join(os.path.dirname(os.path.dirname(os.path.realpath(__file__))), "scripts")
EVALUATE = os.path.join(SCRIPTS, "evaluate_trajectory")
CHECK_UNCERTAINTY = os.path.join(SCRIPTS, "check_uncertainty")


def odometry(sequence, output, *options):
    """Runs the odometry, which must not write to the terminal; its summary."""
    result = run("offline_odometry", sequence, "-o", output, "--quiet", *options)
    if result.returncode != 0 or result.stderr:
        raise AssertionError(result.stderr)
    with open(os.path.join(output, "summary.json")) as file:
        return json.load(file)


def ground_truth(sequence, output, every):
    """Options of evaluate_trajectory: the ground truth and the estimate to be compared with it."""
    estimate = os.path.join(output, "trajectory.tum")
    if sequence.startswith("synthetic:"):
        return ["--groundtruth", os.path.join(output, "groundtruth.tum"), "--estimate", estimate]
    kitti = os.path.join(sequence, "poses.txt")
    if every == 1 and os.path.isfile(kitti):  # without stamps: a pose for each frame
        return ["--groundtruth", kitti, "--estimate", os.path.join(output, "trajectory.kitti")]
    return ["--groundtruth", os.path.join(sequence, "groundtruth_cam0.tum"),
            "--estimate", estimate, "--body-to-camera", "none"]


def evaluate(sequence, output, every=1):
    """Errors of a trajectory of every Nth frame as {name: value}."""
    command = [EVALUATE, *ground_truth(sequence, output, every), "--json"]
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
            "rpe_t_m": scores["per_frame"]["translation_rmse_m"],
            "end_percent": scores["end_error"]["percent_of_path"]}


def count_frames(sequence):
    """Of KITTI's layout."""
    with open(os.path.join(sequence, "times.txt")) as file:
        return len(file.read().split())


def link_kitti(source, kept, folder):
    """Links to some frames of a sequence of KITTI's layout."""
    with open(os.path.join(source, "times.txt")) as file:
        times = file.read().split()
    for camera in ("image_0", "image_1"):
        os.makedirs(os.path.join(folder, camera))
        for i, k in enumerate(kept):
            os.symlink(os.path.join(source, camera, f"{k:06}.png"),
                       os.path.join(folder, camera, f"{i:06}.png"))
    write(os.path.join(folder, "times.txt"), "".join(times[k] + "\n" for k in kept))
    os.symlink(os.path.join(source, "calib.txt"), os.path.join(folder, "calib.txt"))


def link_euroc(source, kept, folder):
    """Links to a sequence of EuRoC's layout, whose list has some of its frames."""
    for camera in ("cam0", "cam1"):
        there, here = (os.path.join(root, "mav0", camera) for root in (source, folder))
        os.makedirs(here)
        for name in ("data", "sensor.yaml"):
            os.symlink(os.path.join(there, name), os.path.join(here, name))
        with open(os.path.join(there, "data.csv")) as file:
            header, *rows = file.read().splitlines(keepends=True)
        write(os.path.join(here, "data.csv"), header + "".join(rows[k] for k in kept))


def root_mean_square(values):
    return math.sqrt(sum(value * value for value in values) / len(values))


class ErrorTest(unittest.TestCase):
    """Errors on a sequence: the name of a folder of the real data, a folder of its own, or
    synthetic:SCENE,..."""

    def setUp(self):
        self.root = tempfile.mkdtemp(prefix="point_line_sequences_")
        self.addCleanup(shutil.rmtree, self.root)

    def scores(self, name, *options, every=1):
        is_name = not name.startswith(("synthetic:", self.root))
        sequence = data_folder(name) if is_name else name
        output = os.path.join(self.root, f"run{len(os.listdir(self.root))}")
        # Two tests run at a time: the bits are those of any number of threads.
        summary = odometry(sequence, output, "--every", every, "--set", "tracking/threads=1", *options)
        return summary, evaluate(sequence, output, every)

    def with_frames(self, name, kept):
        """A folder of its own with links to some frames of a sequence."""
        source = data_folder(name)
        folder = tempfile.mkdtemp(dir=self.root)
        if os.path.isdir(os.path.join(source, "mav0")):
            link_euroc(source, kept, folder)
        else:
            link_kitti(source, kept, folder)
        os.symlink(os.path.join(source, "groundtruth_cam0.tum"),
                   os.path.join(folder, "groundtruth_cam0.tum"))
        return folder

    def check_errors(self, name, frames, bounds, every=1, scale=1.0):
        """Every frame but the first has a motion, and errors keep to {error: bound}; the summary and the errors."""
        summary, errors = self.scores(name, "--scale", scale, every=every)
        print(f"\n{name}, every {every}, scale {scale:g}: " + ", ".join(
            f"{key} {value:.4g}" for key, value in errors.items() if value is not None), flush=True)
        self.assertEqual(summary["frames"], frames)
        self.assertEqual(errors["matched_frames"], frames)
        self.assertEqual(summary["states"], {"initializing": 1, "ok": frames - 1})
        for key, bound in bounds.items():
            with self.subTest(every=every, error=key):
                self.assertLess(errors[key], bound)
        return summary, errors

    def check(self, name, frames, bounds):
        summary, _ = self.check_errors(name, frames, bounds)
        self.assertEqual(summary["failed_windows"], 0)
        # Correct weights give 1. Measured: points 0.96 ... 1.13, lines 0.64 ... 1.20.
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
            "t_percent": 0.8,  # measured 0.618; ORB-SLAM2 0.718, viso2 1.211
            "r_deg_per_100m": 0.26,  # measured 0.200; Basalt 0.235, ORB-SLAM2 0.409, viso2 1.232
            "ate_m": 0.062,  # measured 0.0474; PL-StVO 0.099, ORB-SLAM2 0.114, viso2 0.304
            "rpe_r_deg": 0.018,  # measured 0.0142; Basalt 0.0152, PL-StVO 0.0231, viso2 0.0296
            "end_percent": 0.34,  # measured 0.260; PL-StVO 0.22, ORB-SLAM2 0.36, viso2 1.08
        })

    def test_kitti_06_000_050(self):
        self.check("kitti_06_000-050", 51, {
            "t_percent": 0.81,  # measured 0.620; ORB-SLAM2 0.636, viso2 0.988, PL-StVO 1.167
            "r_deg_per_100m": 2.0,  # measured 1.57; Basalt 1.631, ORB-SLAM2 1.784, viso2 2.958
            "ate_m": 0.0346,  # measured 0.0266; ORB-SLAM2 0.050, viso2 0.120, PL-StVO 0.142
            "rpe_r_deg": 0.076,  # measured 0.0586; Basalt 0.0588, PL-StVO 0.0628, ORB-SLAM2 0.0675
            "end_percent": 1.1,  # measured 0.879; ORB-SLAM2 1.03, viso2 1.06, PL-StVO 1.09
        })

    def test_euroc_mh_01_000_099(self):
        self.check("euroc_MH_01_000-099", 100, {
            "ate_m": 0.0044,  # measured 0.00342; PL-StVO 0.0037, ORB-SLAM2 0.0040, viso2 0.0057
            "rpe_r_deg": 0.0104,  # measured 0.00797; Basalt 0.0120, PL-StVO 0.0150, viso2 0.0549
            "end_percent": 0.63,  # measured 0.481; PL-StVO 0.51, ORB-SLAM2 0.57, viso2 1.39
        })

    def test_rendered_town(self):
        self.check("rendered_town", 125, {
            "t_percent": 0.0235,  # measured 0.0181; viso2 0.275, ORB-SLAM2 0.535, PL-StVO 0.629
            "r_deg_per_100m": 0.042,  # measured 0.0326; ORB-SLAM2 0.248, PL-StVO 0.659, viso2 0.713
            "ate_m": 0.005,  # measured 0.00382; viso2 0.059, PL-StVO 0.157, ORB-SLAM2 0.175
            "rpe_r_deg": 0.00175,  # measured 0.00135; ORB-SLAM2 0.0175, viso2 0.0220
            "end_percent": 0.016,  # measured 0.0122; viso2 0.20, ORB-SLAM2 0.47, PL-StVO 0.66
        })

    def test_rendered_lowtexture(self):
        self.check("rendered_lowtexture", 100, {
            "ate_m": 0.0033,  # measured 0.00233; PL-StVO 0.033, viso2 0.063, ORB-SLAM2 lost
            "rpe_r_deg": 0.0087,  # measured 0.00648; PL-StVO 0.045, viso2 0.104
            "end_percent": 0.25,  # measured 0.113; PL-StVO 4.1, viso2 7.1
        })

    def test_lines_help_where_corners_are_few(self):
        # Measured 0.0046 / 0.0023 m = 1.97 and 0.0085 / 0.0065 deg = 1.31; PL-StVO 5.3 and 5.1. It was
        # 2.5 and 3.0 before points of coarser levels were added, which improve points alone most.
        self.check_that_lines_help("rendered_lowtexture", {"ate_m": 1.1, "rpe_r_deg": 1.15})


class SlowCameras(ErrorTest):
    """Every Nth frame: cars go 2 to 6 m and flights turn by up to 20 degrees between frames. Only
    where no peer is named was none measured."""

    def check_every(self, name, cases):
        """Cases {n: (frames, {error: bound})}."""
        for every, (frames, bounds) in cases.items():
            summary, _ = self.check_errors(name, frames, bounds, every)
            with self.subTest(every=every):
                self.assertEqual(summary["failed_windows"], 0)
            # Measured: points 0.93 ... 1.34, lines 0.69 ... 1.72.
            for kind in ("points", "lines"):
                with self.subTest(every=every, residuals=kind):
                    variance = summary["weighted_residuals"][kind]["variance"]
                    self.assertTrue(0.5 < variance < 2.3, variance)

    def check_not_lost(self, name, frames, every=6, ate_m=None):
        summary, errors = self.scores(name, every=every)
        self.assertEqual(summary["states"], {"initializing": 1, "ok": frames - 1})
        if ate_m is not None:
            self.assertLess(errors["ate_m"], ate_m)

    def test_kitti_raw_0926_0001(self):
        self.check_every("kitti_raw_0926_0001", {
            2: (54, {"t_percent": 0.74,  # measured 0.570
                     "ate_m": 0.063}),  # measured 0.0482
            3: (36, {"t_percent": 0.69,  # measured 0.531; ORB-SLAM2 0.73, PL-StVO 1.4, viso2 1.6
                     "ate_m": 0.061}),  # measured 0.0466; ORB-SLAM2 0.066, PL-StVO 0.28
            4: (27, {"t_percent": 0.92,  # measured 0.778 (1.18 times); ORB-SLAM2 0.92, viso2 2.1
                     "ate_m": 0.12})})  # measured 0.0955; ORB-SLAM2 0.12, viso2 0.41, PL-StVO 0.71
        self.check_not_lost("kitti_raw_0926_0001", 18)

    def test_kitti_06_000_050(self):
        self.check_every("kitti_06_000-050", {
            2: (26, {"t_percent": 0.98,  # measured 0.748
                     "ate_m": 0.049}),  # measured 0.0418 (1.17 times)
            3: (17, {"t_percent": 0.9,  # measured 0.730; ORB-SLAM2 0.90, PL-StVO 1.6, viso2 1.6
                     "ate_m": 0.043}),  # measured 0.0330; ORB-SLAM2 0.062, PL-StVO 0.13
            4: (13, {"t_percent": 1.03,  # measured 0.932 (1.1 times); ORB-SLAM2 1.03, PL-StVO 2.1
                     "ate_m": 0.0478})})  # measured 0.0368; ORB-SLAM2 0.048
        self.check_not_lost("kitti_06_000-050", 9)

    def test_euroc_mh_01_000_099(self):
        self.check_every("euroc_MH_01_000-099", {
            2: (50, {"ate_m": 0.0045,  # measured 0.00347
                     "rpe_r_deg": 0.0175}),  # measured 0.0135
            3: (34, {"ate_m": 0.004,  # measured 0.00355 (1.13 times); PL-StVO 0.0040, viso2 0.0051
                     "rpe_r_deg": 0.025}),  # measured 0.0192
            # 1.3 times would be more than PL-StVO's 0.0032 here, from which it hardly differs.
            4: (25, {"ate_m": 0.0042,  # measured 0.00320; PL-StVO 0.0032, viso2 0.0038
                     "rpe_r_deg": 0.031})})  # measured 0.0239
        self.check_not_lost("euroc_MH_01_000-099", 17)

    def test_rendered_town(self):
        self.check_every("rendered_town", {
            2: (63, {"t_percent": 0.0334,  # measured 0.0257
                     "ate_m": 0.005}),  # measured 0.00386
            3: (42, {"t_percent": 0.0464,  # measured 0.0357
                     "ate_m": 0.0065}),  # measured 0.00498
            4: (32, {"t_percent": 0.068,  # measured 0.0525; ORB-SLAM2 1.0, viso2 1.5, PL-StVO 12
                     "ate_m": 0.0092})})  # measured 0.00705; viso2 0.20, ORB-SLAM2 0.30
        self.check_not_lost("rendered_town", 21)

    def test_rendered_lowtexture(self):
        self.check_every("rendered_lowtexture", {
            2: (50, {"ate_m": 0.0075,  # measured 0.0053
                     "rpe_r_deg": 0.0120}),  # measured 0.0090
            3: (34, {"ate_m": 0.0057,  # measured 0.0040
                     "rpe_r_deg": 0.0150}),  # measured 0.0111
            4: (25, {"ate_m": 0.0082,  # measured 0.0058
                     "rpe_r_deg": 0.0200})})  # measured 0.0146
        self.check_not_lost("rendered_lowtexture", 17, ate_m=0.0093)  # measured 0.0066
        self.check_not_lost("rendered_lowtexture", 13, every=8, ate_m=0.0054)  # measured 0.0038

    def test_rendered_plaster(self):
        self.check_not_lost("rendered_plaster", 9, ate_m=0.027)  # measured 0.0190
        self.check_not_lost("rendered_plaster", 7, every=8, ate_m=0.0115)  # measured 0.0082


class HalfTheSize(ErrorTest):
    """Images of half the width and height, which are enlarged for processing: without that the errors
    of rotations were 0.0037, 0.0158 and 0.0635 deg in the rendered ones."""

    def check_half(self, name, frames, bounds):
        self.check_errors(name, frames, bounds, scale=0.5)

    def test_kitti_raw_0926_0001(self):
        self.check_half("kitti_raw_0926_0001", 108, {"ate_m": 0.061,  # measured 0.0469
                                                     "rpe_r_deg": 0.0186})  # measured 0.0143

    def test_kitti_06_000_050(self):
        self.check_half("kitti_06_000-050", 51, {"ate_m": 0.0303,  # measured 0.0233
                                                 "rpe_r_deg": 0.0753})  # measured 0.0579

    def test_euroc_mh_01_000_099(self):
        self.check_half("euroc_MH_01_000-099", 100, {"ate_m": 0.0048,  # measured 0.0037
                                                     "rpe_r_deg": 0.0107})  # measured 0.0082

    def test_rendered_town(self):
        self.check_half("rendered_town", 125, {"ate_m": 0.0159,  # measured 0.0108
                                               "rpe_r_deg": 0.0026})  # measured 0.0020

    def test_rendered_lowtexture(self):
        self.check_half("rendered_lowtexture", 100, {"ate_m": 0.0079,  # measured 0.0061
                                                     "rpe_r_deg": 0.0126})  # measured 0.0097

    def test_rendered_plaster(self):
        self.check_half("rendered_plaster", 50, {"ate_m": 0.0125,  # measured 0.0089
                                                 "rpe_r_deg": 0.0384})  # measured 0.0284


class LightsOut(ErrorTest):
    """A room goes dark for two and a half seconds while the camera turns: only the gyroscope knows."""

    WORLD = "synthetic:indoor,seed=11,frames=120,lights_out_at_s=2.5,lights_out_s=2.5"

    def test_the_gyroscope_carries_the_pose(self):
        errors = {}
        for enabled, state in (("true", "degraded"), ("false", "lost")):
            summary, errors[enabled] = self.scores(self.WORLD, "--set", f"imu/enabled={enabled}")
            self.assertGreater(summary["states"].get(state, 0), 35)
            self.assertEqual("lost" in summary["states"], enabled == "false")
        print(f"\n{self.WORLD}: ATE {errors['true']['ate_m']:.4f} m with a gyroscope, "
              f"{errors['false']['ate_m']:.4f} m without", flush=True)
        # Measured 0.055 and 0.81.
        self.assertLess(errors["true"]["ate_m"], 0.25 * errors["false"]["ate_m"])


class LightsOutOnTheRoad(ErrorTest):
    """Three seconds without light on a road: wheels carry the pose, also where they slip or are wrong by 5 %."""

    WORLD = "synthetic:street,seed=7,frames=80,open_country=0.5"
    DARK = ",lights_out_at_s=3,lights_out_s=3"
    WHEELS = ("--set", "wheels/enabled=true", "--set", "planar/enabled=true")

    def test_wheels_carry_the_pose(self):
        _, without = self.scores(self.WORLD + self.DARK)
        summary, with_wheels = self.scores(self.WORLD + self.DARK, *self.WHEELS)
        self.assertGreater(summary["states"].get("degraded", 0), 25)
        self.assertNotIn("lost", summary["states"])
        _, scale = self.scores(self.WORLD + self.DARK + ",wheel_scale_error=0.05", *self.WHEELS)
        print(f"\n{self.WORLD + self.DARK}: ATE {without['ate_m']:.3f} m without, "
              f"{with_wheels['ate_m']:.3f} m with wheels, {scale['ate_m']:.3f} m with 5 % too much", flush=True)
        self.assertLess(with_wheels["ate_m"], 0.1 * without["ate_m"])
        self.assertLess(scale["ate_m"], 0.25 * without["ate_m"])

    def test_slip_does_no_harm_to_good_images(self):
        _, without = self.scores(self.WORLD)
        _, slipping = self.scores(self.WORLD + ",wheel_slip=0.3", *self.WHEELS)
        print(f"\n{self.WORLD}: ATE {without['ate_m']:.4f} m without, "
              f"{slipping['ate_m']:.4f} m with wheels that slip", flush=True)
        self.assertLess(slipping["ate_m"], 1.05 * without["ate_m"])


class DroppedFrames(ErrorTest):
    """A computer that drops half of the frames, now one, now many in a row."""

    BURST = 60
    DRAWS = 5

    def half_of(self, num_frames, seed):
        """Half of the frames of each burst."""
        draw = random.Random(seed)
        kept = [0]
        for begin in range(1, num_frames, self.BURST):
            burst = range(begin, min(begin + self.BURST, num_frames))
            kept += sorted(draw.sample(burst, len(burst) // 2))
        return kept

    def check_half(self, name, ate_m):
        """The root mean square of the ATE of some draws: single ones are good or bad by chance."""
        ate, longest = [], []
        for seed in range(1, self.DRAWS + 1):
            kept = self.half_of(count_frames(data_folder(name)), seed)
            longest.append(max(b - a for a, b in zip(kept, kept[1:])))
            _, errors = self.check_errors(self.with_frames(name, kept), len(kept), {})
            ate.append(errors["ate_m"])
        self.assertGreaterEqual(min(longest), 4, "each draw must be hard")
        self.assertGreaterEqual(sorted(longest)[1], 5, "and all but one harder")
        rms = root_mean_square(ate)
        print(f"\n{name}, half of the frames dropped: ATE {rms:.4f} m, of",
              " ".join(f"{value:.4f}" for value in ate), flush=True)
        self.assertLess(rms, ate_m)

    def test_kitti_raw_0926_0001(self):
        self.check_half("kitti_raw_0926_0001", 0.066)  # measured 0.0508

    def test_kitti_06_000_050(self):
        self.check_half("kitti_06_000-050", 0.0368)  # measured 0.0335

    def test_rendered_town(self):
        self.check_half("rendered_town", 0.0095)  # measured 0.0073


class Gaps(ErrorTest):
    """A stream that stops for longer than tracking/max_frame_gap_s, while the camera moves on: the images show the
    motion. Where it was only looked for in the map, 17 of these 19 motions in the town were LOST (ATE 1.633 m), and 8
    of 15 on EuRoC (0.0239 m)."""

    FRAMES_BEFORE = 6

    def check_gaps(self, name, gap_frames, longest_gap_s, starts, ate_m):
        """None is lost, few are doubted; the root mean square of the ATE."""
        errors, doubted = [], 0
        for start in starts:
            kept = [*range(start, start + self.FRAMES_BEFORE), start + self.FRAMES_BEFORE - 1 + gap_frames]
            summary, scores = self.scores(self.with_frames(name, kept), "--set",
                                          f"tracking/max_frame_gap_s={longest_gap_s}")
            self.assertEqual(summary["frames"], self.FRAMES_BEFORE + 1)
            self.assertNotIn("lost", summary["states"], start)
            doubted += summary["states"].get("degraded", 0)
            errors.append(scores["ate_m"])
        rms = root_mean_square(errors)
        print(f"\n{name}, {len(errors)} gaps of {gap_frames} frames: ATE {rms:.4f} m, largest {max(errors):.4f} m, "
              f"{doubted} degraded", flush=True)
        self.assertLess(rms, ate_m)
        self.assertLessEqual(doubted, 0.2 * len(errors))

    def test_rendered_town(self):
        self.check_gaps("rendered_town", 5, 0.3, range(0, 114, 6), 0.0017)  # measured 0.0013

    def test_euroc_mh_01(self):
        self.check_gaps("euroc_MH_01_000-099", 5, 0.15, range(0, 90, 6), 0.0012)  # measured 0.0009


class FastStarts(ErrorTest):
    """The first motion of a fast car, from many starts. The stones of the town's road repeat every 8 m: where the
    first motion that was found was taken, 18 of the 30 at every 7th frame went 0.3 m back in place of 7.7 m on, 15 of
    them with state ok."""

    def first_motion(self, sequence):
        """Its state, and the error of its translation [m]. A motion that is doubted is warned of."""
        output = os.path.join(sequence, "output")
        result = run("offline_odometry", sequence, "-o", output, "--quiet", "--set", "tracking/threads=1")
        self.assertEqual(result.returncode, 0, result.stderr)
        with open(os.path.join(output, "frames.csv"), newline="") as file:
            state = list(csv.DictReader(file))[1]["state"]
        return state, evaluate(sequence, output)["rpe_t_m"]

    def check_starts(self, name, every, starts, rms_m):
        """All motions are right, by their root mean square; few are doubted."""
        errors, doubted = [], 0
        for start in starts:
            state, error_m = self.first_motion(self.with_frames(name, [start, start + every]))
            self.assertIn(state, ("ok", "degraded"), start)
            doubted += state == "degraded"
            errors.append(error_m)
        rms = root_mean_square(errors)
        print(f"\n{name}, {len(errors)} starts at every {every}th frame: {rms:.4f} m, largest {max(errors):.4f} m, "
              f"{doubted} degraded", flush=True)
        self.assertLess(rms, rms_m)
        self.assertLessEqual(doubted, 0.15 * len(errors))

    def test_rendered_town(self):
        self.check_starts("rendered_town", 7, range(0, 118, 4), 0.0216)  # measured 0.0166
        self.check_starts("rendered_town", 9, range(0, 116, 8), 0.0382)  # measured 0.0294

    def test_kitti_raw_0926_0001(self):
        self.check_starts("kitti_raw_0926_0001", 7, range(0, 101, 8), 0.243)  # measured 0.187


class DarkImages(ErrorTest):
    """Plastered walls in the dark, a fast flight: viso2's ATE is 0.125 m, those of PL-StVO are 0.69 m
    with 10 of 50 frames lost, ORB-SLAM2 loses 26. It was 1.36 m with 44 frames lost with FAST corners of
    the image alone, and 0.0109 m with those of coarser levels matched by descriptors."""

    def test_rendered_plaster(self):
        for every, frames, ate_m, rpe_r_deg in ((1, 50, 0.0105, 0.036),  # measured 0.0048, 0.0277
                                                (2, 25, 0.0155, 0.054)):  # measured 0.0102, 0.0337
            self.check_errors("rendered_plaster", frames,
                              {"ate_m": ate_m, "rpe_r_deg": rpe_r_deg}, every)

    def test_lines_do_no_harm(self):
        # ATE 0.0045 m with them and 0.0044 without, every 2nd frame 0.0119 and 0.0119; rotations 0.0241
        # and 0.0248 deg, every 2nd frame 0.0347 and 0.0351.
        for every in (1, 2):
            _, both = self.scores("rendered_plaster", every=every)
            _, points = self.scores("rendered_plaster", "--set", "lines/enabled=false", every=every)
            for key in ("ate_m", "rpe_r_deg"):
                with self.subTest(every=every, error=key):
                    self.assertLess(both[key], 1.5 * points[key])

    def test_fast_flight_of_the_built_in_world(self):
        # Turns of up to 100 deg/s, five degrees from frame to frame, and fifteen at every third.
        self.check_errors("synthetic:plaster,seed=1,frames=100", 100,
                          {"ate_m": 0.016, "rpe_r_deg": 0.056})  # measured 0.0071, 0.030
        self.check_errors("synthetic:plaster,seed=1,frames=240", 80,
                          {"ate_m": 0.072, "rpe_r_deg": 0.22}, every=3)  # 0.037, 0.096


class LittleInView(ErrorTest):
    """On top of a hill only clouds and the skyline are seen for seconds."""

    def test_translation_is_predicted(self):
        # Every 4th frame. Where far points gave no rotation, it was lost for 0.8 s; 14.2 m wrong where
        # the velocity of before was not used then.
        summary, errors = self.scores("synthetic:street,hill=1,seed=1,frames=120", every=4)
        print(f"\n{summary['states']}, ATE {errors['ate_m']:.4g} m", flush=True)
        self.assertEqual(errors["matched_frames"], 30)
        self.assertLess(errors["ate_m"], 0.5)  # measured 0.215
        self.assertGreater(summary["states"]["ok"], 15)  # measured 24


class OwnStandardDeviations(unittest.TestCase):
    """Few motions with state ok are wrong by more than six of their own standard deviations: of 730
    frames of the built-in worlds none when the bound was set. More than 10 000 frames take
    scripts/check_uncertainty half an hour."""

    def test_hard_scenes(self):
        command = [CHECK_UNCERTAINTY, "--short", "--allowed", "1"]
        result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                timeout=1800, universal_newlines=True,
                                env={**os.environ, "POINT_LINE_ODOMETRY_BIN": os.path.dirname(
                                    find_program("offline_odometry"))})
        print("\n" + result.stdout, flush=True)
        self.assertEqual(result.returncode, 0, result.stdout)


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
            "t_percent": 0.057,  # measured 0.0295
            "r_deg_per_100m": 0.098,  # measured 0.0633
            "ate_m": 0.007,  # measured 0.00367
            "rpe_r_deg": 0.003,  # measured 0.00168
        })

    def test_indoor(self):
        self.check("synthetic:indoor,seed=1,frames=150", 150, {
            "t_percent": 0.08,  # measured 0.0567, 0.0305 before calibrations were estimated faster
            "ate_m": 0.0018,  # measured 0.00121, 0.000724 before
            "rpe_r_deg": 0.0044,  # measured 0.00259
        })

    def test_indoor_dark_and_blurred(self):
        self.check("synthetic:indoor,seed=2,frames=150,motion_blur_ms=10,exposure_ev=-1.5", 150, {
            "t_percent": 0.14,  # measured 0.110, 0.0423 before
            "ate_m": 0.0031,  # measured 0.00236, 0.001 before
            "rpe_r_deg": 0.0067,  # measured 0.00385
        })

    def test_street_with_auto_exposure(self):
        # With patches aligned as if both images were exposed alike: 0.0100 m and 0.0025 deg.
        self.check("synthetic:street,seed=1,frames=100,exposure_jitter_ev=0.5", 100, {
            "ate_m": 0.0085,  # measured 0.0047
            "rpe_r_deg": 0.0022,  # measured 0.0017
        })

    def test_corridor(self):
        self.check("synthetic:corridor,seed=1,frames=250", 250, {
            "t_percent": 0.15,  # measured 0.0533
            "ate_m": 0.0066,  # measured 0.00248
            "rpe_r_deg": 0.018,  # measured 0.00872
        })

    def test_lines_help_in_the_corridor(self):
        # Measured 0.0440 / 0.0089 deg = 4.9 and 0.0081 / 0.0037 m = 2.2.
        self.check_that_lines_help("synthetic:corridor,seed=2,frames=250",
                                   {"rpe_r_deg": 2.5, "ate_m": 1.1})


if __name__ == "__main__":
    unittest.main()
