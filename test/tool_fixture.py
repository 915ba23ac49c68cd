"""What tests share that need no ROS system: a small sequence, and how programs are run."""

import os
import random
import shutil
import struct
import subprocess
import tempfile
import time
import unittest
import zlib

import rosbag

WIDTH, HEIGHT = 320, 160
FOCAL_PX, BASELINE_M, DEPTH_M = 200.0, 0.4, 8.0
FRAMES = 4
START_UP_S = 60.0


def wait_until(condition, timeout_s=START_UP_S):
    """True as soon as the condition is; False after the timeout."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def find_program(name):
    folder = os.environ.get("POINT_LINE_ODOMETRY_BIN")
    if not folder:
        command = ["catkin_find", "--first-only", "--libexec", "point_line_odometry", name]
        folder = os.path.dirname(subprocess.run(command, stdout=subprocess.PIPE, check=True,
                                                universal_newlines=True).stdout.strip())
    program = os.path.join(folder, name)
    if not os.path.isfile(program):
        raise RuntimeError(f"{program} is missing: build it and set POINT_LINE_ODOMETRY_BIN")
    return program


def data_folder(name):
    """Folder of a real sequence; skips the test if it is not there."""
    repository = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
    default = os.path.join(repository, "..", "shared", "data")
    folder = os.path.join(os.environ.get("POINT_LINE_ODOMETRY_DATA", default), name)
    if not os.path.isdir(folder):
        raise unittest.SkipTest(f"no data: set POINT_LINE_ODOMETRY_DATA to the folder of {name}")
    return folder


def run(name, *arguments):
    return subprocess.run([find_program(name), *map(str, arguments)], stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, universal_newlines=True, timeout=1200)


def write_png(path, rows):
    """Writes rows of bytes as an 8 bit grey PNG."""
    def chunk(kind, data):
        checksum = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + checksum
    header = struct.pack(">IIBBBBB", len(rows[0]), len(rows), 8, 0, 0, 0, 0)
    pixels = zlib.compress(b"".join(b"\0" + row for row in rows))
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels)
                   + chunk(b"IEND", b""))


def make_wall():
    """A wall of random tiles, wider than the image."""
    tiles = random.Random(5)
    tile = 8
    rows = []
    for _ in range(HEIGHT // tile):
        row = b"".join(bytes([tiles.randrange(256)]) * tile for _ in range(2 * WIDTH // tile))
        rows += [row] * tile
    return rows


def make_kitti(folder):
    """A camera that moves to the right along a wall."""
    disparity = int(FOCAL_PX * BASELINE_M / DEPTH_M)
    wall = make_wall()
    for side in (0, 1):
        os.makedirs(os.path.join(folder, f"image_{side}"))
        for i in range(FRAMES):
            begin = 40 + 3 * i + side * disparity
            write_png(os.path.join(folder, f"image_{side}", f"{i:06}.png"),
                      [row[begin:begin + WIDTH] for row in wall])
    projection = "{0} 0 160 {1} 0 {0} 80 0 0 0 1 0"
    left = projection.format(FOCAL_PX, 0)
    right = projection.format(FOCAL_PX, -FOCAL_PX * BASELINE_M)
    write(os.path.join(folder, "calib.txt"), f"P0: {left}\nP1: {right}\n")
    write(os.path.join(folder, "times.txt"), "".join(f"{0.1 * i:.6e}\n" for i in range(FRAMES)))
    write(os.path.join(folder, "poses.txt"),
          "".join(f"1 0 0 {0.12 * i} 0 1 0 0 0 0 1 0\n" for i in range(FRAMES)))


def write(path, text):
    with open(path, "w") as file:
        file.write(text)


def read(path):
    with open(path, "rb") as file:
        return file.read()


def cut_off(path):
    content = read(path)
    with open(path, "wb") as file:
        file.write(content[:len(content) // 2])


class ToolTest(unittest.TestCase):
    def setUp(self):
        self.root = tempfile.mkdtemp(prefix="point_line_tools_")
        self.addCleanup(shutil.rmtree, self.root)
        self.kitti = self.path("kitti")
        make_kitti(self.kitti)

    def path(self, *names):
        return os.path.join(self.root, *names)

    def succeed(self, name, *arguments):
        result = run(name, *arguments)
        self.assertEqual(result.returncode, 0, result.stderr)
        return result

    def refuse(self, words, name, *arguments):
        """Asserts exit code 2, one line on stderr with the words, and that no file came or went."""
        before = self.listing()
        result = run(name, *arguments)
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertEqual(result.stdout, "")
        self.assertTrue(result.stderr.startswith(name + ": "), result.stderr)
        self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
        for word in words if isinstance(words, list) else [words]:
            self.assertIn(word, result.stderr)
        self.assertEqual(self.listing(), before)

    def listing(self):
        return sorted(os.path.join(folder, name)
                      for folder, folders, files in os.walk(self.root) for name in folders + files)

    def make_bag(self, change=None):
        """The KITTI folder as a bag; change(topic, message) gives the (topic, message)s to keep."""
        bag = self.path("made.bag")
        self.succeed("dataset_to_bag", self.kitti, bag, "--quiet")
        if change is None:
            return bag
        changed = self.path("changed.bag")
        with rosbag.Bag(bag) as source, rosbag.Bag(changed, "w") as target:
            for topic, message, stamp in source.read_messages():
                for new_topic, new_message in change(topic, message):
                    target.write(new_topic, new_message, stamp)
        return changed

    def offline(self, source, name, *options):
        self.succeed("offline_odometry", source, "-o", self.path(name), "--quiet", *options)
        return self.path(name)

    def assertSameFile(self, name, folder_a, folder_b):
        self.assertEqual(read(os.path.join(folder_a, name)), read(os.path.join(folder_b, name)))

    def assertSameNumbers(self, name, folder_a, folder_b):
        """As assertSameFile, but for the last digits of numbers."""
        numbers_a, numbers_b = (read(os.path.join(folder, name)).split()
                                for folder in (folder_a, folder_b))
        self.assertEqual(len(numbers_a), len(numbers_b))
        for a, b in zip(numbers_a, numbers_b):
            self.assertAlmostEqual(float(a), float(b), places=8)
