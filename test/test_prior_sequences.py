#!/usr/bin/env python3
"""Motion priors on real and rendered sequences: true rotations with a gyroscope's noise on every 6th frame, and priors
that are wrong in every second frame. The noise has fixed seeds. Programs and data are found as in test_tools.py;
sequences that are absent are skipped."""

import os
import unittest

import numpy as np

from test_sequences import ErrorTest, root_mean_square
from tool_fixture import data_folder, write

# Frames of each sequence, and of every 6th of them.
FRAMES = {"kitti_raw_0926_0001": (108, 18), "kitti_06_000-050": (51, 9),
          "euroc_MH_01_000-099": (100, 17), "rendered_town": (125, 21),
          "rendered_lowtexture": (100, 17), "rendered_plaster": (50, 9)}
DRIVES = {"kitti_raw_0926_0001", "kitti_06_000-050", "rendered_town"}

GYROSCOPE_NOISE = 1.7e-4  # of EuRoC's ADIS16448 [rad/s/sqrt(Hz)]
GYROSCOPE_SCALE = 0.005  # share of the angle, as priors/gyroscope.cpp takes it
WRONG_RATE = np.deg2rad(5.0)  # [rad/s]


def to_rotation(q):
    """Of a unit quaternion x, y, z, w."""
    x, y, z, w = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def to_quaternion(R):
    """Of a rotation of less than 180 degrees: x, y, z, w."""
    w = 0.5 * np.sqrt(1.0 + np.trace(R))
    return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 4 * w * w]) / (4 * w)


def turn(vector):
    """The rotation by a rotation vector [rad]."""
    angle = np.linalg.norm(vector)
    axis = vector / max(angle, 1e-12)
    return to_rotation(np.append(np.sin(angle / 2) * axis, np.cos(angle / 2)))


def angle_of(R):
    return 2 * np.arctan2(np.linalg.norm(to_quaternion(R)[:3]), to_quaternion(R)[3])


def stamps_of(folder):
    """Of the frames, as texts with all nanoseconds: those of EuRoC do not fit into a float."""
    euroc = os.path.join(folder, "mav0", "cam0", "data.csv")
    if os.path.isfile(euroc):
        with open(euroc) as file:
            nanoseconds = [line.split(",")[0].strip() for line in file if line[0] != "#"]
        return [f"{text[:-9]}.{text[-9:]}" for text in nanoseconds]
    with open(os.path.join(folder, "times.txt")) as file:
        return [f"{float(text):.9f}" for text in file.read().split()]


def true_motions(folder, every):
    """The motion of the left camera between every Nth frames: (from, to, dt_s, rotation, translation)."""
    stamps = stamps_of(folder)[::every]
    truth = np.loadtxt(os.path.join(folder, "groundtruth_cam0.tum"))
    poses = []
    for stamp in stamps:
        row = truth[np.argmin(np.abs(truth[:, 0] - float(stamp)))]
        if abs(row[0] - float(stamp)) > 2e-3:
            raise AssertionError(f"no ground truth at {stamp}")
        poses.append((to_rotation(row[4:8]), row[1:4]))
    for k in range(1, len(stamps)):
        (R_a, t_a), (R_b, t_b) = poses[k - 1], poses[k]
        yield (stamps[k - 1], stamps[k], float(stamps[k]) - float(stamps[k - 1]),
               R_a.T @ R_b, R_a.T @ (t_b - t_a))


def row_of(start, end, translation, R, sigma_m, sigma_rad):
    numbers = [*translation, *to_quaternion(R), *[sigma_m] * 3, *[sigma_rad] * 3]
    return " ".join([start, end, *(f"{number:.9g}" for number in numbers)]) + "\n"


# Which of the priors: every second one is wrong.
BOTH, RIGHT, WRONG = (0, 1), (0,), (1,)


def gyroscope_rows(folder, every, wrong_rate=0.0, seed=0, which=BOTH):
    """Rotations alone, those of every second frame wrong by a rate about an axis that is drawn."""
    draw = np.random.default_rng(seed)
    for k, (start, end, dt, R, _) in enumerate(true_motions(folder, every)):
        noise = GYROSCOPE_NOISE * np.sqrt(dt)
        sigma = np.hypot(noise, GYROSCOPE_SCALE * angle_of(R))
        axis = draw.normal(size=3)
        R = R @ turn(noise * draw.normal(size=3))
        if k % 2:
            R = R @ turn(wrong_rate * dt * axis / np.linalg.norm(axis))
        if k % 2 in which:
            yield row_of(start, end, np.zeros(3), R, 0.0, sigma)


def wheel_rows(folder, wrong_factor, seed=0, which=BOTH):
    """Motions as of wheels: 2 % of noise of the distance, deviations of 5 %, and in every second frame a
    distance that is wrong by a factor."""
    draw = np.random.default_rng(seed)
    for k, (start, end, _, R, translation) in enumerate(true_motions(folder, 1)):
        factor = (1.0 + 0.02 * draw.normal()) * (wrong_factor if k % 2 else 1.0)
        sigma_m = max(0.05 * np.linalg.norm(translation), 1e-4)
        if k % 2 in which:
            yield row_of(start, end, factor * translation, R, sigma_m,
                         np.hypot(0.05 * angle_of(R), 5e-4))


class PriorSequenceTest(ErrorTest):
    def with_priors(self, name, rows, every=1):
        path = os.path.join(self.root, "priors.txt")
        write(path, "".join(rows))
        summary, errors = self.scores(name, "--priors", path, every=every)
        os.remove(path)
        self.assertEqual(summary["prior_file"]["unmatched"], [])
        return summary, errors

    def print_errors(self, text, errors):
        print(f"\n{text}: " + ", ".join(f"{key} {value:.4g}" for key, value in errors.items()
                                        if value is not None), flush=True)


class TrueRotations(PriorSequenceTest):
    """Every 6th frame with the true rotation and a gyroscope's noise: no frame is lost, and rotations get better.

    Positions do not all. With five seeds of the noise the ATE of the town is 0.0131 to 0.0170 m, 0.0125 without: the
    prior's 0.008 deg are more than the images' error of 0.004 deg. On KITTI raw it grows by up to 4 %, by the scale that
    most of it is."""

    def check_rotations(self, name, **bounds):
        frames = FRAMES[name][1]
        rows = gyroscope_rows(data_folder(name), 6)
        summary, errors = self.with_priors(name, rows, 6)
        self.print_errors(f"{name}, every 6th, with true rotations", errors)
        self.assertEqual(summary["states"], {"initializing": 1, "ok": frames - 1})
        self.assertGreaterEqual(summary["priors"].get("used", 0), bounds.pop("used"))
        for key, bound in bounds.items():
            with self.subTest(error=key):
                self.assertLess(errors[key], bound)

    # Bounds are 1.1 times what was measured with five seeds at most; comments say what it is without.

    def test_kitti_raw_0926_0001(self):
        self.check_rotations("kitti_raw_0926_0001", used=15, rpe_r_deg=0.0171,  # 0.0155; 0.0172 without
                             r_deg_per_100m=0.216,  # 0.203; 0.216 without
                             ate_m=0.209)  # 0.190; 0.184 without

    def test_kitti_06_000_050(self):
        # The ground truth disagrees with the images (46 standard deviations, RMS): three or four are rejected.
        self.check_rotations("kitti_06_000-050", used=4, r_deg_per_100m=2.31,  # 2.10; 2.14 without
                             ate_m=0.140)  # 0.127; 0.115 without

    def test_euroc_mh_01_000_099(self):
        self.check_rotations("euroc_MH_01_000-099", used=15, rpe_r_deg=0.0340,  # 0.0309; 0.0319 without
                             ate_m=0.0037)  # 0.00334; 0.00338 without

    def test_rendered_town(self):
        self.check_rotations("rendered_town", used=20, r_deg_per_100m=0.062,  # 0.0564; 0.0576 without
                             ate_m=0.0187)  # 0.0170; 0.0125 without

    def test_rendered_lowtexture(self):
        self.check_rotations("rendered_lowtexture", used=16, rpe_r_deg=0.0237,  # 0.0215; 0.0241 without
                             ate_m=0.0061)  # 0.0055; 0.0056 without

    def test_rendered_plaster(self):
        """Eight motions are few: root mean squares over the starts at each of the first six frames."""
        name = "rendered_plaster"
        errors = []
        for start in range(6):
            folder = self.with_frames(name, range(start, FRAMES[name][0], 6))
            summary, error = self.with_priors(folder, gyroscope_rows(folder, 1))
            self.assertEqual(set(summary["states"]), {"initializing", "ok"}, start)
            self.assertGreaterEqual(summary["priors"].get("used", 0), 5)
            errors.append(error)
        rms = {key: root_mean_square([error[key] for error in errors]) for key in ("ate_m", "rpe_r_deg")}
        self.print_errors(f"{name}, every 6th, with true rotations, six starts", rms)
        self.assertLess(rms["rpe_r_deg"], 0.0632)  # 0.0575
        self.assertLess(rms["ate_m"], 0.0104)  # 0.0094


class WrongPriors(PriorSequenceTest):
    """Wrong in every second frame, by 5 deg/s or by 30 % of the distance: they are rejected, and no figure is worse
    by more than 5 % than without priors, or than with the right half of them where that is worse. Figures are medians of
    five draws of the noise on the sequences of rooms, whose ATE is 2 to 5 mm: single ones have differed by half there. That
    of the town is 4 mm, and what happens to a frame of it does so with each noise, but not from each first frame on: it has
    been 11 % at most. On KITTI it has been 8 % at most."""

    DRAWS = {"rendered_lowtexture": 5, "rendered_plaster": 5, "euroc_MH_01_000-099": 3, "rendered_town": 5}
    DRAWN_STARTS = ("rendered_town",)
    FACTOR = 1.05

    def first_frame(self, name, draw):
        return draw if name in self.DRAWN_STARTS else 0

    def folder_of(self, name, draw):
        first = self.first_frame(name, draw)
        return self.with_frames(name, range(first, FRAMES[name][0])) if first else data_folder(name)

    def check_median(self, name, text, rows_of, folders, without):
        """rows_of(folder, which, seed); the folder of each draw, and {folder: errors without priors}."""
        keys = ["ate_m"] + (["t_percent", "r_deg_per_100m"] if name in DRIVES else ["rpe_r_deg"])
        _, right = self.with_priors(folders[0], rows_of(folders[0], RIGHT, 0))
        ratios = {key: [] for key in keys}
        for draw, folder in enumerate(folders):
            summary, errors = self.with_priors(folder, rows_of(folder, BOTH, draw))
            frames = FRAMES[name][0] - self.first_frame(name, draw)
            self.assertEqual(summary["states"], {"initializing": 1, "ok": frames - 1})
            self.assertGreaterEqual(summary["priors"]["rejected"], 3)
            self.assertGreaterEqual(summary["priors"]["suspended"], frames // 2)
            for key in keys:
                ratios[key].append(errors[key] / without[folder][key])
        for key in keys:
            median = float(np.median(ratios[key]))
            right_half = right[key] / without[folders[0]][key]
            print(f"\n{name}, {text}, {key} times that without: {median:.3f}, of",
                  " ".join(f"{ratio:.3f}" for ratio in sorted(ratios[key])),
                  f"; right half alone {right_half:.3f}", flush=True)
            with self.subTest(priors=text, error=key):
                self.assertLess(median, self.FACTOR * max(1.0, right_half))

    def check_wrong(self, name):
        folders = [self.folder_of(name, draw) for draw in range(self.DRAWS.get(name, 1))]
        without = {folder: self.scores(folder)[1] for folder in set(folders)}
        self.check_median(name, "rotations wrong by 5 deg/s", lambda folder, which, seed: gyroscope_rows(
            folder, 1, WRONG_RATE, seed, which), folders, without)
        self.check_median(name, "distances 30 % too long", lambda folder, which, seed: wheel_rows(
            folder, 1.3, seed, which), folders, without)

    def check_no_trace(self, name, rows):
        """Without the right ones between them, the wrong ones leave every bit as it is."""
        _, without = self.scores(name)
        summary, errors = self.with_priors(name, rows)
        self.assertNotIn("used", summary["priors"])
        self.assertEqual(errors, without)

    def test_kitti_raw_0926_0001(self):
        self.check_wrong("kitti_raw_0926_0001")

    def test_kitti_06_000_050(self):
        # Right priors are the ground truth's: 35 (RMS) of the images' standard deviations away from their motions.
        self.check_wrong("kitti_06_000-050")

    def test_the_wrong_half_alone_leaves_no_trace_on_kitti_06(self):
        name = "kitti_06_000-050"
        self.check_no_trace(name, wheel_rows(data_folder(name), 1.3, which=WRONG))

    def test_euroc_mh_01_000_099(self):
        self.check_wrong("euroc_MH_01_000-099")

    def test_rendered_town(self):
        self.check_wrong("rendered_town")

    def test_rendered_lowtexture(self):
        self.check_wrong("rendered_lowtexture")

    def test_rendered_plaster(self):
        self.check_wrong("rendered_plaster")

    def test_the_wrong_half_alone_leaves_no_trace_on_plaster(self):
        """Nor among its points of coarser levels, which are searched around what a prior predicts."""
        name = "rendered_plaster"
        self.check_no_trace(name, gyroscope_rows(data_folder(name), 1, WRONG_RATE, which=WRONG))


if __name__ == "__main__":
    unittest.main()
