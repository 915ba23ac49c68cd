#!/usr/bin/env python3
"""scripts/soak: its checks, the faults that it draws, and a short run."""

import math
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image

REPOSITORY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
SCRIPTS = os.path.join(REPOSITORY, "scripts")
sys.path.insert(0, SCRIPTS)

import _soak_faults as faults  # noqa: E402
import _soak_checks as checks  # noqa: E402

PERIOD_S, SPEED = 0.1, 1.0


def answer(stamp_s, x_m, speed=SPEED, state="OK", sigma=0.01, yaw=0.0):
    return checks.Answer(stamp_s, (x_m, 0.0, 0.0),
                        (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
                        (speed, 0.0, 0.0, 0.0, 0.0, 0.0), (sigma,) * 6, state)


def drive(count, change=None):
    """Answers of a straight drive; change(k, answer) may give another one."""
    answers = [answer(100.0 + k * PERIOD_S, k * PERIOD_S * SPEED) for k in range(count)]
    return [change(k, each) if change else each for k, each in enumerate(answers)]


def watch(answers, announced=()):
    watching = checks.JumpWatch()
    for k, each in enumerate(answers):
        watching.add(each, k in announced)
    return watching


def samples(minutes=30.0, mb_per_min=0.0, files_per_min=0.0, threads=12):
    rng = np.random.default_rng(1)
    return [checks.ProcessSample(t, 80.0 + mb_per_min * t / 60.0 + rng.normal(0.0, 0.2)
                                + 10.0 * min(t / 30.0, 1.0),
                                int(40 + files_per_min * t / 60.0) + int(rng.integers(0, 4)), threads)
            for t in np.arange(0.0, 60.0 * minutes, 1.0)]


def run(**changes):
    values = {"samples": samples(), "watch": watch(drive(50)), "states": {"OK": 50}, "changes": 1,
              "counters": {"processed": 50, "exceptions": 0}, "faults": {"black": 2}, "ended": "",
              "recovered": True}
    values.update(changes)
    return checks.Run(**values)


class JumpTest(unittest.TestCase):
    def jumps(self, change=None, announced=()):
        return watch(drive(20, change), announced).num_jumps

    def test_a_drive_has_none(self):
        self.assertEqual(self.jumps(), 0)

    def test_a_step_beyond_the_motion(self):
        self.assertEqual(self.jumps(lambda k, a: a if k < 9 else a._replace(
            position=(a.position[0] + 0.3, 0.0, 0.0))), 1)

    def test_a_step_to_the_origin(self):
        self.assertEqual(self.jumps(lambda k, a: a if k < 9 else a._replace(
            position=(a.position[0] - 0.9, 0.0, 0.0))), 1)

    def test_a_turn_beyond_the_motion(self):
        turned = answer(0.0, 0.0, yaw=0.3).rotation
        self.assertEqual(self.jumps(lambda k, a: a if k < 9 else a._replace(rotation=turned)), 1)

    def test_what_the_covariance_explains_is_none(self):
        self.assertEqual(self.jumps(lambda k, a: a if k < 9 else a._replace(
            position=(a.position[0] + 0.1, 0.0, 0.0), twist_sigma=(0.5,) * 6)), 0)

    def test_a_requested_reset_is_none(self):
        moved = (lambda k, a: a if k < 9 else a._replace(
            position=(a.position[0] + 5.0, 0.0, 0.0),
            state="INITIALIZING" if k == 9 else "OK"))
        self.assertEqual(self.jumps(moved, announced=(9,)), 0)
        self.assertEqual(self.jumps(moved), 1)

    def test_the_pose_is_kept_when_tracking_is_reset(self):
        self.assertEqual(self.jumps(lambda k, a: a if k != 19 else a._replace(
            state="INITIALIZING", position=drive(20)[18].position)), 0)
        self.assertEqual(self.jumps(lambda k, a: a if k != 19 else a._replace(
            state="INITIALIZING", position=(a.position[0] + 1.0, 0.0, 0.0))), 1)

    def test_the_pose_is_kept_when_the_clock_jumps(self):
        self.assertEqual(self.jumps(lambda k, a: a if k < 19 else a._replace(
            stamp_s=5.0, position=(a.position[0] - 1.0, 0.0, 0.0))), 1)

    def test_the_motion_is_that_in_the_axes_of_the_base(self):
        sideways = drive(3, lambda k, a: a._replace(
            position=(0.0, a.position[0], 0.0), rotation=answer(0.0, 0.0, yaw=math.pi / 2).rotation))
        self.assertEqual(watch(sideways).num_jumps, 0)

    def test_not_a_number(self):
        for field, value in (("position", (math.nan, 0.0, 0.0)), ("twist_sigma", (math.inf,) * 6)):
            spoiled = watch(drive(20, lambda k, a, f=field, v=value: a if k != 7 else
                                  a._replace(**{f: v})))
            self.assertEqual((spoiled.num_not_finite, spoiled.num_jumps), (1, 0))


class GrowthTest(unittest.TestCase):
    def failed(self, **changes):
        text, passed = checks.report(run(**changes))
        names = [line[6:].split("  ")[0] for line in text.splitlines() if line.startswith("FAIL  ")]
        self.assertEqual(passed, not names)
        self.assertTrue(text.endswith("PASS" if passed else "FAIL"))
        return names

    def test_all_is_well(self):
        self.assertEqual(self.failed(), [])

    def test_memory(self):
        self.assertEqual(self.failed(samples=samples(mb_per_min=0.2)), ["memory does not grow"])
        self.assertAlmostEqual(checks.growth_of(samples(mb_per_min=0.2)).rss_mb_per_min, 0.2, 2)

    def test_files(self):
        self.assertEqual(self.failed(samples=samples(files_per_min=2.0)),
                         ["open files do not grow"])

    def test_threads(self):
        grown = [each._replace(threads=12 + i // 60) for i, each in enumerate(samples())]
        self.assertEqual(self.failed(samples=grown), ["threads do not grow"])

    def test_a_short_run_is_not_evaluated(self):
        short = samples(minutes=10.0, mb_per_min=9.0)
        self.assertEqual(self.failed(samples=short), [])
        self.assertIn("not evaluated", checks.report(run(samples=short))[0])

    def test_the_rest(self):
        jumped = watch(drive(9, lambda k, a: a if k < 5 else a._replace(position=(9.0, 0.0, 0.0))))
        self.assertEqual(self.failed(watch=jumped), ["jumps of odom"])
        spoiled = watch([answer(1.0, math.nan)])
        self.assertEqual(self.failed(watch=spoiled), ["numbers that are not finite"])
        self.assertEqual(self.failed(counters={"exceptions": 1}), ["exceptions"])
        self.assertEqual(self.failed(ended="it crashed"), ["the process lives"])
        self.assertEqual(self.failed(recovered=False), ["tracks again after the last fault"])
        self.assertEqual(self.failed(watch=watch([])), ["frames are answered"])


class FaultTest(unittest.TestCase):
    def setUp(self):
        image = Image(height=8, width=6, step=6, encoding="mono8", data=bytes(range(48)))
        image.header.stamp = rospy.Time(1700000000, 5)
        info = CameraInfo(header=image.header, height=8, width=6, D=[0.1], K=[1.0] * 9,
                          P=[1.0, 0.0, 3.0, -1.0] + [0.0] * 8)
        self.frame = faults.Frame(image, faults.changed(image, data=bytes(range(48, 0, -1))), info,
                                  faults.changed(info, P=[1.0] * 12))

    def draw(self, seed):
        injector = faults.Injector(seed)
        names = []
        for k in range(3000):
            injector.apply(self.frame, 0.1 * k)
            names.append(injector.name)
        return names, injector.counts

    def test_the_seed_says_which(self):
        self.assertEqual(self.draw(3), self.draw(3))
        self.assertNotEqual(self.draw(3)[0], self.draw(4)[0])

    def test_all_are_drawn_in_time(self):
        injector = faults.Injector(1)
        for k in range(30000):
            injector.apply(self.frame, 0.1 * k)
        self.assertEqual(set(injector.counts), set(faults.KINDS) | set(faults.JUMPS_S))

    def test_each_changes_something_and_not_the_messages_given(self):
        before = str(self.frame)
        for name, kind in faults.KINDS.items():
            fault = kind.make(faults.random.Random(1))
            given = [self.frame._replace(left=faults.changed(self.frame.left, data=bytes(range(1, 49))))
                     if k else self.frame for k in range(2)]
            got = [each for frame in given for each in fault(frame)]
            self.assertNotEqual([str(each) for each in got], [str(each) for each in given], name)
        self.assertEqual(str(self.frame), before)

    def test_quiet(self):
        injector = faults.Injector(1)
        for k in range(300):
            self.assertEqual(len(injector.apply(self.frame, 0.1 * k, quiet=True)), 1)
        self.assertEqual(injector.counts, {})

    def test_stamps(self):
        later = faults.restamped(self.frame.left, 1.5)
        self.assertEqual((later.header.stamp - self.frame.left.header.stamp).to_sec(), 1.5)


class RunTest(unittest.TestCase):
    def soak(self, *arguments):
        folder = tempfile.mkdtemp(prefix="point_line_soak_test_")
        self.addCleanup(shutil.rmtree, folder)
        log = os.path.join(folder, "log")
        result = subprocess.run(
            ["/usr/bin/python3", "-B", os.path.join(SCRIPTS, "_soak.py"), "--log", log, *arguments],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True, timeout=120)
        said = result.stdout + result.stderr
        if os.path.exists(log):
            with open(log, errors="replace") as stream:
                said += stream.read()[-3000:]
        return result, said

    def test_half_a_minute(self):
        result, said = self.soak("0.5", "--seed", "2")
        self.assertEqual(result.returncode, 0, said)
        for words in ("PASS  jumps of odom", "PASS  numbers that are not finite", "faults", "not evaluated"):
            self.assertIn(words, result.stdout)
        self.assertTrue(result.stdout.rstrip().endswith("PASS"))

    def test_wrong_arguments(self):
        result, _ = self.soak("-1")
        self.assertEqual(result.returncode, 2)


if __name__ == "__main__":
    unittest.main()
