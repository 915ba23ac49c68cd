#!/usr/bin/python3
"""Tests of scripts/evaluate_trajectory; run: /usr/bin/python3 test/test_evaluate_trajectory.py."""
import importlib.machinery
import importlib.util
import json
import os
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
SCRIPT = os.path.join(ROOT, 'scripts', 'evaluate_trajectory')
DATA = os.environ.get('POINT_LINE_ODOMETRY_DATA', os.path.join(ROOT, '..', 'shared', 'data'))
LENGTHS_M = [5.0, 10.0, 20.0, 50.0] + [100.0 * k for k in range(1, 9)]


def load_script():
    """The script as a module, without leaving compiled files next to it."""
    sys.dont_write_bytecode = True
    loader = importlib.machinery.SourceFileLoader('evaluate_trajectory', SCRIPT)
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
    loader.exec_module(module)
    return module


ev = load_script()


def rotation(axis, angle_rad):
    """(3, 3) rotation about the coordinate axis 0, 1 or 2."""
    R = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i] = R[j, j] = np.cos(angle_rad)
    R[j, i], R[i, j] = np.sin(angle_rad), -np.sin(angle_rad)
    return R


def straight_line(frames, step_m):
    """(n, 4, 4) poses along +z, one per step."""
    positions = np.outer(np.arange(frames) * step_m, [0.0, 0.0, 1.0])
    return ev.make_poses(np.tile(np.eye(3), (frames, 1, 1)), positions)


def winding_path(frames, seed):
    """(n, 4, 4) seeded smooth poses, about 1 m per frame, turning about all axes."""
    random = np.random.RandomState(seed)
    poses = np.zeros((frames, 4, 4))
    poses[0] = np.eye(4)
    rates = np.cumsum(random.normal(0, 0.004, (frames, 3)), axis=0)
    for k in range(1, frames):
        step = np.eye(4)
        x, y, z = rates[k]
        step[:3, :3] = rotation(0, x) @ rotation(1, y) @ rotation(2, z)
        step[:3, 3] = [0.05, -0.02, 1.0]
        poses[k] = poses[k - 1] @ step
    return poses


def rigid(seed):
    """(4, 4) arbitrary rigid transform."""
    random = np.random.RandomState(seed)
    T = np.eye(4)
    T[:3, :3] = rotation(0, random.uniform(-3, 3)) @ rotation(1, random.uniform(-3, 3))
    T[:3, 3] = random.uniform(-50, 50, 3)
    return T


def quaternions(poses):
    """(n, 4) quaternions x y z w of rotations below 180 degrees."""
    R = poses[:, :3, :3]
    w = np.sqrt(np.maximum(0, 1 + np.trace(R, axis1=1, axis2=2))) / 2
    skew = R - np.swapaxes(R, 1, 2)
    v = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    return np.column_stack([v / (4 * w[:, None]), w])


def tum_text(poses, stamps_s):
    """TUM rows with a comment."""
    table = np.column_stack([stamps_s, poses[:, :3, 3], quaternions(poses)])
    return '# stamp tx ty tz qx qy qz qw\n' + ''.join(
        ' '.join(f'{value:.12f}' for value in row) + '\n' for row in table)


def kitti_text(poses):
    """KITTI rows."""
    return ''.join(' '.join(f'{value:.12e}' for value in pose[:3].ravel()) + '\n' for pose in poses)


def euroc_text(poses, stamps_s, header='#timestamp,p_x [m],p_y,p_z,q_w [],q_x,q_y,q_z,v_x,v_y'):
    """EuRoC ground truth rows with two further columns."""
    rows = [header] if header else []
    for stamp, position, q in zip(stamps_s, poses[:, :3, 3], quaternions(poses)):
        numbers = ','.join(f'{value:.12f}' for value in [*position, q[3], q[0], q[1], q[2]])
        rows.append(f'{int(round(stamp * 1e9))},{numbers},0,0')
    return '\n'.join(rows) + '\n'


def run_script(*arguments, **environment):
    """The finished process of the script."""
    return subprocess.run(['/usr/bin/python3', SCRIPT, *arguments], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, universal_newlines=True,
                          env=dict(os.environ, **environment))


class FileTest(unittest.TestCase):
    """A test with a folder of its own."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def write(self, name, text):
        """Path of a new file with the text."""
        path = os.path.join(self.folder, name)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, 'w') as stream:
            stream.write(text)
        return path


class GoldenValues(unittest.TestCase):
    """Published results of KITTI 00, evaluated by others."""

    def check(self, name, t_rel, r_rel, ate):
        folder = os.path.join(DATA, 'trajectories')
        ground_truth = os.path.join(folder, 'kitti_00_groundtruth.txt')
        if not os.path.isfile(ground_truth):
            self.skipTest('no trajectories in the data folder; set POINT_LINE_ODOMETRY_DATA')
        estimate = os.path.join(folder, name)
        matches = ev.match(ev.read_trajectory(ground_truth), ev.read_trajectory(estimate))
        result = ev.evaluate(matches, LENGTHS_M)
        self.assertEqual(f'{result["kitti"]["t_rel_percent"]:.3f}', t_rel)
        self.assertEqual(f'{result["kitti"]["r_rel_deg_per_100m"]:.3f}', r_rel)
        self.assertEqual(f'{result["ate_m"]["rmse"]:.6f}', ate)

    def test_orb_slam2(self):
        self.check('kitti_00_orb_slam2.txt', '0.700', '0.254', '1.303450')

    def test_s_ptam(self):
        self.check('kitti_00_s_ptam.txt', '1.487', '0.558', '3.738488')

    def test_euroc_body_ground_truth_agrees_with_that_of_the_camera(self):
        folder = os.path.join(DATA, 'euroc_MH_01_000-099')
        ground_truth = os.path.join(folder, 'mav0', 'state_groundtruth_estimate0', 'data.csv')
        if not os.path.isfile(ground_truth):
            self.skipTest('no EuRoC piece in the data folder; set POINT_LINE_ODOMETRY_DATA')
        camera = os.path.join(folder, 'groundtruth_cam0.tum')
        options = ev.parse_arguments(['--groundtruth', ground_truth, '--estimate', camera])
        _, result = ev.run(options)
        self.assertEqual(result['matched_frames'], 100)
        self.assertLess(result['ate_m']['max'], 1e-6)
        self.assertLess(result['per_frame']['rotation_rmse_deg'], 1e-4)


class KnownErrors(unittest.TestCase):
    """Trajectories with known errors."""

    def test_identical(self):
        poses = winding_path(400, seed=1)
        result = ev.evaluate(ev.Matches(poses, poses, ''), LENGTHS_M)
        self.assertLess(result['kitti']['t_rel_percent'], 1e-9)
        self.assertLess(result['short']['r_rel_deg_per_100m'], 1e-6)
        self.assertLess(result['ate_m']['max'], 1e-9)
        self.assertLess(result['end_error']['m'], 1e-9)

    def test_scale_error_of_one_percent(self):
        step_m = 0.5 * (1 + 1e-9)  # 200 steps are just longer than 100 m
        ground_truth = straight_line(2001, step_m)
        estimate = straight_line(2001, 1.01 * step_m)
        result = ev.evaluate(ev.Matches(ground_truth, estimate, ''), LENGTHS_M)
        self.assertAlmostEqual(result['kitti']['t_rel_percent'], 1.0, places=6)
        self.assertAlmostEqual(result['short']['t_rel_percent'], 1.0, places=6)
        self.assertEqual(result['kitti']['r_rel_deg_per_100m'], 0.0)
        self.assertAlmostEqual(result['per_frame']['translation_rmse_m'], 0.005, places=9)
        self.assertAlmostEqual(result['end_error']['m'], 10.0, places=6)
        self.assertAlmostEqual(result['end_error']['percent_of_path'], 1.0, places=9)
        # Aligned at the middle: the error grows evenly to 5 m at both ends; its mean is 2.5 m.
        self.assertAlmostEqual(result['ate_m']['max'], 5.0, places=6)
        self.assertAlmostEqual(result['ate_m']['mean'], 2.5, delta=0.002)
        self.assertAlmostEqual(result['ate_m']['rmse'], 5 / np.sqrt(3), delta=0.002)

    def test_segment_ends_at_the_first_frame_beyond_its_length(self):
        ground_truth, estimate = straight_line(102, 1.0), straight_line(102, 1.01)
        errors = ev.segment_errors(ev.Matches(ground_truth, estimate, ''), 100.0, 1,
                                   ev.rotation_angles)
        self.assertEqual(len(errors), 1)  # 0 -> 101: frame 100 is exactly 100 m away, not beyond
        self.assertAlmostEqual(errors[0, 0], 1.01, places=9)

    def test_counts_of_segments(self):
        line = straight_line(301, 1.0)
        result = ev.evaluate(ev.Matches(line, line, ''), [50.0, 100.0, 200.0, 400.0])
        counts = {row['length_m']: row['segments'] for group in ('short', 'kitti')
                  for row in result[group]['per_length']}
        self.assertEqual(counts, {50.0: 250, 100.0: 20, 200.0: 10, 400.0: 0})
        self.assertEqual(result['kitti']['segments'], 30)
        self.assertIsNone(result['kitti']['per_length'][2]['t_rel_percent'])

    def test_constant_yaw_drift(self):
        drift_deg = 0.01  # per frame of 1 m: 1 deg/100 m
        ground_truth = straight_line(1001, 1.0)
        estimate = [np.eye(4)]
        step = np.eye(4)
        step[:3, :3] = rotation(1, np.radians(drift_deg))
        step[2, 3] = 1.0
        for _ in range(1000):
            estimate.append(estimate[-1] @ step)
        matches = ev.Matches(ground_truth, np.array(estimate), '')
        result = ev.evaluate(matches, LENGTHS_M)
        self.assertAlmostEqual(result['per_frame']['rotation_rmse_deg'], drift_deg, places=9)
        self.assertLess(result['per_frame']['translation_rmse_m'], 1e-9)
        for row in result['short']['per_length'] + result['kitti']['per_length']:
            frames = row['length_m'] + 1  # the first frame beyond
            self.assertAlmostEqual(row['r_rel_deg_per_100m'],
                                   frames * drift_deg * 100 / row['length_m'], places=6)
        # 1000 chords of 1 m, each turned by drift_deg: chord over the arc of 10 deg.
        turn = np.radians(drift_deg)
        end = sum(np.exp(1j * turn * k) for k in range(1000))
        self.assertAlmostEqual(result['end_error']['m'], abs(end - 1000), places=6)

    def test_absolute_error_ignores_a_rigid_transform(self):
        ground_truth = winding_path(300, seed=2)
        estimate = ground_truth.copy()
        estimate[:, :3, 3] += np.random.RandomState(3).normal(0, 0.1, (300, 3))
        expected = ev.absolute_errors(ev.Matches(ground_truth, estimate, ''))
        for seed in range(5):
            T = rigid(seed)
            np.testing.assert_allclose(ev.absolute_errors(ev.Matches(T @ ground_truth, estimate, '')),
                                       expected, atol=1e-9)
            np.testing.assert_allclose(ev.absolute_errors(ev.Matches(ground_truth, T @ estimate, '')),
                                       expected, atol=1e-9)
            moved = ev.align_first(ev.Matches(ground_truth, T @ estimate, ''))
            np.testing.assert_allclose(moved, ev.align_first(ev.Matches(ground_truth, estimate, '')),
                                       atol=1e-9)

    def test_alignment_does_not_scale_or_mirror(self):
        points = np.random.RandomState(4).normal(0, 1, (50, 3))
        T = ev.align_rigid(points, points * [-1, 1, 1])
        self.assertAlmostEqual(np.linalg.det(T[:3, :3]), 1.0, places=12)
        T = ev.align_rigid(points, 2 * points + [1, 2, 3])
        np.testing.assert_allclose(T[:3, :3], np.eye(3), atol=1e-12)

    def test_stationary(self):
        poses = straight_line(5, 0.0)
        result = ev.evaluate(ev.Matches(poses, poses, ''), LENGTHS_M)
        self.assertEqual(result['path_length_m'], 0.0)
        self.assertIsNone(result['end_error']['percent_of_path'])

    def test_small_angles_are_exact(self):
        R = np.array([rotation(axis, 1e-9) for axis in range(3)] + [rotation(1, np.pi)])
        np.testing.assert_allclose(ev.rotation_angles(R), [1e-9, 1e-9, 1e-9, np.pi], rtol=1e-6)


class Formats(FileTest):
    """Reading and association."""

    def setUp(self):
        super().setUp()
        self.poses = winding_path(40, seed=5)
        self.stamps = 1403636584.75 + 0.1 * np.arange(40)

    def test_detection(self):
        for kind, text in (('TUM', tum_text(self.poses, self.stamps)),
                           ('KITTI', kitti_text(self.poses)),
                           ('EuRoC', euroc_text(self.poses, self.stamps)),
                           ('EuRoC', euroc_text(self.poses, self.stamps, 'timestamp, x, y')),
                           ('EuRoC', euroc_text(self.poses, self.stamps, None)),
                           ('TUM', tum_text(self.poses, self.stamps).replace('\n', '\r\n') + '\n')):
            trajectory = ev.read_trajectory(self.write('file', text))
            self.assertEqual(trajectory.format, kind)
            np.testing.assert_allclose(trajectory.poses, self.poses, atol=1e-9)
            if kind == 'KITTI':
                self.assertIsNone(trajectory.stamps)
            else:
                np.testing.assert_allclose(trajectory.stamps, self.stamps, rtol=0, atol=1e-6)

    def test_mixed_formats_agree(self):
        times = self.write('times.txt', ''.join(f'{stamp:.9f}\n' for stamp in self.stamps))
        files = {'TUM': self.write('a.txt', tum_text(self.poses, self.stamps)),
                 'KITTI': self.write('b.txt', kitti_text(self.poses)),
                 'EuRoC': self.write('c.csv', euroc_text(self.poses, self.stamps))}
        for ground_truth in files:
            for estimate in files:
                for extra in ([], ['--times', times]):
                    if extra and 'KITTI' not in (ground_truth, estimate):
                        continue
                    options = ev.parse_arguments(['--groundtruth', files[ground_truth], '--estimate',
                                                  files[estimate]] + extra)
                    _, result = ev.run(options)
                    self.assertEqual(result['matched_frames'], 40, (ground_truth, estimate))
                    self.assertLess(result['ate_m']['max'], 1e-9, (ground_truth, estimate))

    def test_times_select_the_frames_of_a_shorter_estimate(self):
        times = self.write('times.txt', ''.join(f'{stamp:.9f}\n' for stamp in self.stamps))
        ground_truth = self.write('truth.txt', kitti_text(self.poses))
        estimate = self.write('estimate.txt', tum_text(self.poses[7:30], self.stamps[7:30]))
        matches, result = ev.run(ev.parse_arguments(
            ['--groundtruth', ground_truth, '--estimate', estimate, '--times', times]))
        np.testing.assert_allclose(matches.ground_truth, self.poses[7:30], atol=1e-9)
        self.assertEqual(result['matching'], 'by stamp: 23 same stamp')

    def match(self, ground_truth_stamps, ground_truth_poses, stamps, poses):
        return ev.match(ev.Trajectory('t', 'TUM', np.asarray(ground_truth_stamps, float),
                                      ground_truth_poses),
                        ev.Trajectory('e', 'TUM', np.asarray(stamps, float), poses))

    def test_dense_ground_truth_is_interpolated(self):
        # Constant turn rate and speed: linear position and slerp are exact.
        def poses_at(times):
            R = np.array([rotation(1, 0.3 * time) for time in times])
            return ev.make_poses(R, np.outer(times, [1.0, 2.0, 3.0]))
        dense, sparse = np.arange(0, 4, 0.03), np.arange(0.5, 3.5, 0.1)
        matches = self.match(dense, poses_at(dense), sparse, poses_at(sparse))
        self.assertEqual(len(matches.ground_truth), len(sparse))
        np.testing.assert_allclose(matches.ground_truth, poses_at(sparse), atol=1e-9)

    def test_sparse_ground_truth_is_matched_to_the_nearest_frame_once(self):
        wanted = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97, 1.02, 1.1, 1.2])
        estimate = straight_line(2, 1.0)[[0] * len(wanted)]
        estimate[:, 2, 3] = wanted
        matches = self.match([0.01, 1.0, 2.0], straight_line(3, 1.0), wanted, estimate)
        self.assertEqual(matches.method, 'by stamp: 2 nearest')
        np.testing.assert_allclose(matches.ground_truth[:, 2, 3], [0, 1])
        np.testing.assert_allclose(matches.estimate[:, 2, 3], [0, 1.02])

    def test_slower_ground_truth_is_interpolated(self):
        """10 Hz of GNSS for a camera of 30 Hz that moves at 10 m/s: a perfect estimate has no error."""
        known = np.arange(0, 100) / 9.97
        wanted = np.arange(0, 290) / 30.0
        poses = [straight_line(2, 1.0)[[0] * len(stamps)] for stamps in (known, wanted)]
        for trajectory, stamps in zip(poses, (known, wanted)):
            trajectory[:, 2, 3] = 10.0 * stamps
        matches = self.match(known, poses[0], wanted, poses[1])
        self.assertEqual(len(matches.stamps), len(wanted))
        np.testing.assert_allclose(matches.ground_truth[:, 2, 3], matches.estimate[:, 2, 3], atol=1e-4)

    def test_frames_outside_the_ground_truth_or_in_its_gap_are_left_out(self):
        known = np.concatenate([np.arange(10, 20), np.arange(30, 40)])
        ground_truth = straight_line(50, 1.0)[known]
        matches = self.match(known, ground_truth, np.arange(0, 50) + 0.0, straight_line(50, 1.0))
        np.testing.assert_allclose(matches.estimate[:, 2, 3], known)
        np.testing.assert_allclose(matches.ground_truth[:, 2, 3], known)

    def test_body_to_camera(self):
        T_body_camera = rigid(8)
        numbers = ', '.join(f'{value:.15g}' for value in T_body_camera.ravel())
        sensor = f'sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{numbers}]\n'
        camera = self.write('camera.txt', tum_text(self.poses, self.stamps))
        body_text = euroc_text(self.poses @ ev.inverse(T_body_camera[None]), self.stamps)
        body = self.write('mav0/state_groundtruth_estimate0/data.csv', body_text)
        yaml = self.write('mav0/cam0/sensor.yaml', sensor)
        opencv_yaml = self.write('opencv.yaml', '%YAML:1.0\n' + sensor)
        moved = self.write('elsewhere.csv', body_text)
        for ground_truth, extra, exact in ((body, [], True),
                                           (body, ['--body-to-camera', 'none'], False),
                                           (moved, [], False),
                                           (moved, ['--body-to-camera', yaml], True),
                                           (moved, ['--body-to-camera', opencv_yaml], True)):
            _, result = ev.run(ev.parse_arguments(
                ['--groundtruth', ground_truth, '--estimate', camera] + extra))
            self.assertEqual(result['ate_m']['max'] < 1e-6, exact, (ground_truth, extra))
            self.assertEqual(len(result['notes']), int(exact))


class OwnUncertainty(unittest.TestCase):
    """Errors in their own standard deviations."""

    FRAMES = 400

    def uncertainty(self, twist_factor=1.0, state='ok'):
        """Matches and uncertainty of noisy motions whose covariance is that of their noise, divided
        by the square of a factor."""
        random = np.random.RandomState(3)
        ground_truth = winding_path(self.FRAMES, 4)
        stamps = 0.1 * np.arange(self.FRAMES)
        root = np.diag([0.01, 0.02, 0.05, 0.001, 0.002, 0.003]) @ (
            np.eye(6) + 0.3 * random.normal(size=(6, 6)))
        motions = ev.inverse(ground_truth[:-1]) @ ground_truth[1:]
        over_s = np.full(self.FRAMES, 0.1)
        twist = np.zeros((self.FRAMES, 6))
        twist[1:] = (ev.mean_velocities(motions, over_s[1:])
                     + random.normal(size=(self.FRAMES - 1, 6)) @ root.T / 0.1)
        covariance = root @ root.T / 0.01 / twist_factor ** 2
        rigid_pose = rigid(5)
        matches = ev.Matches(rigid_pose @ ground_truth, ground_truth, '', stamps)
        states = ['initializing'] + [state] * (self.FRAMES - 1)
        return matches, ev.Uncertainty(stamps, states, over_s, twist,
                                       np.tile(covariance, (self.FRAMES, 1, 1)),
                                       np.tile(np.eye(6), (self.FRAMES, 1, 1)))

    def test_correct_covariances(self):
        result = ev.evaluate_uncertainty(*self.uncertainty())
        self.assertEqual(result['motion']['frames'], self.FRAMES - 1)
        self.assertAlmostEqual(result['motion']['rms_sigma'], 1.0, delta=0.05)
        self.assertEqual(result['motion']['beyond_6_sigma'], 0)
        self.assertLess(result['pose']['max_sigma'], 1e-6)  # whatever the worlds are

    def test_covariances_that_are_too_small(self):
        result = ev.evaluate_uncertainty(*self.uncertainty(5.0))['motion']
        self.assertAlmostEqual(result['rms_sigma'], 5.0, delta=0.25)
        self.assertGreater(result['beyond_6_sigma'], 100)
        self.assertGreater(result['beyond_6_sigma'], result['axis_beyond_6_sigma'])
        self.assertEqual(result['worst'][0]['sigma'], result['max_sigma'])

    def test_frames_without_a_velocity_do_not_count(self):
        matches, uncertainty = self.uncertainty()
        uncertainty.over_s[100] = 0.0
        result = ev.evaluate_uncertainty(matches, uncertainty)['motion']
        self.assertEqual(result['frames'], self.FRAMES - 2)
        self.assertTrue(np.isfinite(result['max_sigma']))

    def test_only_frames_with_state_ok_count(self):
        result = ev.evaluate_uncertainty(*self.uncertainty(5.0, 'degraded'))
        self.assertEqual(result['motion'], {'frames': 0})
        self.assertEqual(len(ev.uncertainty_lines(result)), 4)


class BadInput(FileTest):
    """One sentence on stderr, exit code 2, no traceback."""

    def setUp(self):
        super().setUp()
        self.poses = winding_path(20, seed=6)
        self.tum = tum_text(self.poses, np.arange(20) * 0.1)
        self.good = self.write('good.txt', self.tum)

    def refuse(self, *words, estimate=None, ground_truth=None, extra=()):
        """Runs the script and checks that its one line of complaint has the words."""
        process = run_script('--groundtruth', ground_truth or self.good, '--estimate',
                             estimate or self.good, *extra)
        self.assertEqual(process.returncode, 2, process.stderr)
        self.assertEqual(process.stdout, '')
        self.assertEqual(process.stderr.count('\n'), 1, process.stderr)
        self.assertNotIn('Traceback', process.stderr)
        for word in words:
            self.assertIn(word, process.stderr)

    def changed(self, line, change):
        """Path of the good file with one line (from 1) changed."""
        lines = self.tum.splitlines()
        lines[line - 1] = change(lines[line - 1].split())
        return self.write('bad.txt', '\n'.join(lines) + '\n')

    def test_files(self):
        self.refuse('missing.txt', 'No such file',
                    estimate=os.path.join(self.folder, 'missing.txt'))
        self.refuse('Is a directory', estimate=self.folder)
        self.refuse('no data', estimate=self.write('empty.txt', ''))
        self.refuse('no data', ground_truth=self.write('comments.txt', '# stamp\n\n'))
        self.refuse('no data', ground_truth=self.write('header.csv', 'timestamp,x,y\n'))
        self.refuse('words.txt:1', estimate=self.write('words.txt', 'this is no trajectory\n'))
        self.refuse('fewer than 2', estimate=self.write('one.txt', self.tum.splitlines()[1]))

    def test_rows(self):
        self.refuse('bad.txt:5', '7 columns', estimate=self.changed(5, lambda x: ' '.join(x[:7])))
        self.refuse('bad.txt:6', '9 columns',
                    ground_truth=self.changed(6, lambda x: ' '.join(x + ['1'])))
        self.refuse('bad.txt:7', 'numbers',
                    estimate=self.changed(7, lambda x: ' '.join(['a'] + x[1:])))
        for value in ('nan', 'inf', '-inf'):
            self.refuse('bad.txt:8', 'finite',
                        estimate=self.changed(8, lambda x: ' '.join([x[0], value] + x[2:])))
        self.refuse('bad.txt:9', 'quaternion',
                    estimate=self.changed(9, lambda x: ' '.join(x[:4] + ['0', '0', '0', '0'])))
        self.refuse('bad.txt:10', 'later',
                    estimate=self.changed(10, lambda x: ' '.join(['0.0'] + x[1:])))

    def test_rotation_blocks(self):
        for name, change in (('scaled', lambda R: 1.1 * R), ('mirrored', lambda R: -R),
                             ('zero', lambda R: 0 * R)):
            poses = self.poses.copy()
            poses[3, :3, :3] = change(poses[3, :3, :3])
            self.refuse(f'{name}.txt:4', 'rotation matrix',
                        estimate=self.write(f'{name}.txt', kitti_text(poses)))

    def test_association(self):
        late = self.write('late.txt', tum_text(self.poses, 1000 + np.arange(20) * 0.1))
        self.refuse('only 0 of 20', 'clock', estimate=late)
        short = self.write('short.txt', kitti_text(self.poses[:15]))
        self.refuse('15 rows', '--times', estimate=short)
        times = self.write('times.txt', '0.0\n0.1\n')
        self.refuse('times.txt', '2 stamps', estimate=short, extra=('--times', times))
        self.refuse('leave it out', extra=('--times', times))
        self.refuse('good.txt:2', '8 columns', estimate=short, extra=('--times', self.good))

    def test_sensor_yaml(self):
        broken = self.write('broken.yaml', 'T_BS: {data: [1, 2, 3]}\n')
        self.refuse('broken.yaml', '16 numbers', extra=('--body-to-camera', broken))
        self.refuse('no.yaml', 'No such file', extra=('--body-to-camera', 'no.yaml'))
        numbers = ', '.join(str(value) for value in 2 * np.eye(4).ravel())
        scaled = self.write('scaled.yaml', f'T_BS: {{data: [{numbers}]}}\n')
        self.refuse('scaled.yaml', 'rigid', extra=('--body-to-camera', scaled))
        self.refuse('text.yaml', extra=('--body-to-camera', self.write('text.yaml', '{: [')))

    def test_output_folder(self):
        self.refuse('cannot write', extra=('-o', self.good))

    def test_arguments(self):
        for extra in (('--segments', '0'), ('--segments', 'a,b'), ('--segments', 'nan')):
            process = run_script('--groundtruth', self.good, '--estimate', self.good, *extra)
            self.assertEqual(process.returncode, 2)
            self.assertIn('positive lengths', process.stderr)
            self.assertNotIn('Traceback', process.stderr)


class Output(FileTest):
    """The table, the JSON and the files."""

    def setUp(self):
        super().setUp()
        ground_truth = winding_path(150, seed=7)
        estimate = ground_truth.copy()
        estimate[:, :3, 3] *= 1.01
        self.arguments = ['--groundtruth', self.write('truth.txt', kitti_text(ground_truth)),
                          '--estimate', self.write('estimate.txt', kitti_text(estimate))]

    def check_png(self, path):
        """A PNG of some size whose pixel data unpack to the size its header gives."""
        with open(path, 'rb') as stream:
            content = stream.read()
        self.assertEqual(content[:8], b'\x89PNG\r\n\x1a\n')
        width, height, depth, colour = struct.unpack('>IIBB', content[16:26])
        self.assertGreater(min(width, height), 300)
        self.assertEqual((depth, colour), (8, 6))
        place, packed = 8, b''
        while place < len(content):
            size, kind = struct.unpack('>I4s', content[place:place + 8])
            packed += content[place + 8:place + 8 + size] if kind == b'IDAT' else b''
            place += size + 12
        self.assertEqual(len(zlib.decompress(packed)), height * (4 * width + 1))

    def test_table(self):
        process = run_script(*self.arguments)
        self.assertEqual((process.returncode, process.stderr), (0, ''))
        for word in ('150 of 150 (row by row)', 'path length', 't_rel [%]', 'r_rel [deg/100 m]',
                     'absolute error [m]', '% of the path', 'all from 100 m (KITTI)'):
            self.assertIn(word, process.stdout)

    def test_json_and_files(self):
        folder = os.path.join(self.folder, 'new', 'report')
        process = run_script(*self.arguments, '--json', '-o', folder)
        self.assertEqual(process.returncode, 0, process.stderr)
        self.assertEqual(sorted(os.listdir(folder)),
                         ['errors.png', 'evaluation.json', 'trajectory.png'])
        printed = json.loads(process.stdout)
        with open(os.path.join(folder, 'evaluation.json')) as stream:
            self.assertEqual(json.load(stream), printed)
        self.assertEqual(set(printed), {
            'ground_truth', 'estimate', 'notes', 'matching', 'matched_frames', 'path_length_m',
            'kitti', 'short', 'ate_m', 'per_frame', 'end_error'})
        for name in ('trajectory.png', 'errors.png'):
            self.check_png(os.path.join(folder, name))

    def test_json_without_matplotlib(self):
        self.write('matplotlib.py', "raise ImportError('no matplotlib here')\n")
        folder = os.path.join(self.folder, 'report')
        process = run_script(*self.arguments, '-o', folder, PYTHONPATH=self.folder)
        self.assertEqual(process.returncode, 2)
        self.assertRegex(process.stderr, '^evaluate_trajectory: .*python3-matplotlib')
        self.assertEqual(os.listdir(folder), ['evaluation.json'])

    def test_uncertainty_by_the_names_of_its_columns(self):
        names = ['new', 'state', 'stamp_s', 'twist_over_s', *(f'twist_{i}' for i in range(6))]
        names += [f'{of}_covariance_{i}{j}' for of in ('pose', 'twist')
                  for i in range(6) for j in range(i, 6)]
        row = ['?', 'ok', '7.5', '0.1', *'123456', *['4'] * 21, *['9'] * 21]
        path = self.write('uncertainty.csv', ','.join(names) + '\n' + ','.join(row) + '\n')
        uncertainty = ev.read_uncertainty(path)
        self.assertEqual((uncertainty.stamps[0], uncertainty.states), (7.5, ['ok']))
        np.testing.assert_array_equal(uncertainty.twist, [[1, 2, 3, 4, 5, 6]])
        np.testing.assert_array_equal(uncertainty.pose_covariance[0], np.full((6, 6), 4.0))
        np.testing.assert_array_equal(uncertainty.twist_covariance[0], np.full((6, 6), 9.0))
        path = self.write('short.csv', ','.join(names[:-1]) + '\n' + ','.join(row[:-1]) + '\n')
        with self.assertRaisesRegex(ev.InputError, 'no column twist_covariance_55'):
            ev.read_uncertainty(path)

    def test_plots_without_any_segment(self):
        folder = os.path.join(self.folder, 'report')
        process = run_script(*self.arguments, '--segments', '5000', '-o', folder)
        self.assertEqual(process.returncode, 0, process.stderr)
        self.check_png(os.path.join(folder, 'errors.png'))

    def test_plots_at_a_standstill(self):
        still = self.write('still.txt', kitti_text(straight_line(5, 0.0)))
        process = run_script('--groundtruth', still, '--estimate', still, '-o', self.folder)
        self.assertEqual((process.returncode, process.stderr), (0, ''))
        self.check_png(os.path.join(self.folder, 'trajectory.png'))

    def test_chosen_segments(self):
        process = run_script(*self.arguments, '--segments', '100,30', '--json')
        result = json.loads(process.stdout)
        self.assertEqual([row['length_m'] for row in result['short']['per_length']], [30.0])
        self.assertEqual([row['length_m'] for row in result['kitti']['per_length']], [100.0])


if __name__ == '__main__':
    unittest.main()
