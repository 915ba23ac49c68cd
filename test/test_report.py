#!/usr/bin/env python3
"""Tests of the page about a run: offline_odometry --report and report_run."""

import json
import os
import re
import shutil
import struct
import subprocess
import unittest
import zlib
from html.parser import HTMLParser

from tool_fixture import ToolTest, find_program, read, run

SECTIONS = ["Figures", "States", "Parameters that were changed", "Trajectory", "Error", "Speed",
            "Features and inliers", "Local map", "Times per stage", "Weighted residuals",
            "Covariance", "Errors by their covariances (NEES)", "Frames that were not OK"]
DARK = "synthetic:corridor,seed=4,frames=30,lights_out_at_s=1,lights_out_s=0.5"
VOID = {"meta", "img"}


class Page(HTMLParser):
    """Headings, what is referred to, and whether elements are closed in order."""

    def __init__(self, text):
        super().__init__()
        self.headings, self.references, self.open, self.tags = [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        self.references += [value for name, value in attrs
                            if name in ("src", "href", "xlink:href", "data", "action")]

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-1:]}"
        self.open.pop()

    def handle_data(self, data):
        if self.open[-1:] == ["h2"]:
            self.headings.append(data)


def read_png(path):
    """Width, height and bytes of an 8 bit PNG's filtered rows."""
    data, position, pixels = read(path), 8, b""
    while position < len(data):
        size, kind = struct.unpack(">I4s", data[position:position + 8])
        if kind == b"IDAT":
            pixels += data[position + 8:position + 8 + size]
        position += 12 + size
    return struct.unpack(">II", data[16:24]), zlib.decompress(pixels)


class ReportTest(ToolTest):
    def make(self, source, name, *options):
        output = self.offline(source, name, "--report", *options)
        return output, read(os.path.join(output, "report.html")).decode()

    def test_page_of_a_run_that_loses_its_way(self):
        output, text = self.make(DARK, "dark", "--set", "points/max_per_cell=9")
        page = Page(text)
        self.assertEqual(page.headings, SECTIONS)
        self.assertEqual(page.open, [])
        self.assertNotIn("script", page.tags)
        self.assertEqual(page.tags.count("svg"), 9)
        for reference in page.references:
            self.assertRegex(reference, r"^(#|data:image/jpeg;base64,)")
        self.assertNotRegex(re.sub(r'xmlns(:xlink)?="[^"]*"', "", text), r"https?://")
        self.assertIn("points/max_per_cell", text)
        with open(os.path.join(output, "summary.json")) as file:
            summary = json.load(file)
        self.assertEqual(summary["changed_parameters"], {"points/max_per_cell": "9"})
        self.assertGreater(summary["states"]["degraded"] + summary["lost"], 5)
        self.assertIn("point_line_odometry " + summary["version"], text)
        images = sorted(os.listdir(os.path.join(output, "thumbnails")))
        self.assertEqual(page.tags.count("img"), len(images))
        self.assertEqual(images[0], "000000.jpg")
        self.assertGreater(len(images), 5)
        self.assertLessEqual(len(images), 32)
        # What the page is made of gives the same page again.
        shutil.copy(os.path.join(output, "report.html"), self.path("first.html"))
        self.succeed("report_run", output)
        self.assertEqual(read(os.path.join(output, "report.html")), read(self.path("first.html")))

    def test_without_truth_and_with_two_frames(self):
        output, _ = self.make("synthetic:corridor,seed=4,frames=2", "short")
        os.remove(os.path.join(output, "groundtruth.tum"))
        os.remove(os.path.join(output, "uncertainty.csv"))
        self.succeed("report_run", output)
        headings = Page(read(os.path.join(output, "report.html")).decode()).headings
        self.assertEqual(headings, [name for name in SECTIONS if name not in (
            "Error", "Covariance", "Errors by their covariances (NEES)")])

    def test_names_are_shown_as_they_are(self):
        folder = self.path("<b>A&B")
        shutil.copytree(self.kitti, folder)
        _, text = self.make(folder, "escaped")
        self.assertIn("&lt;b&gt;A&amp;B", text)
        self.assertNotIn("<b>A", text)

    def test_what_is_no_run_is_refused(self):
        os.makedirs(self.path("empty"))
        result = run("report_run", self.path("empty"))
        self.assertEqual(result.returncode, 2)
        self.assertIn("give the folder", result.stderr)
        self.assertEqual(os.listdir(self.path("empty")), [])

    def test_damaged_results_are_refused_in_one_sentence(self):
        output, _ = self.make("synthetic:corridor,seed=4,frames=4", "whole")

        def cut_frames(folder):
            name = os.path.join(folder, "frames.csv")
            text = read(name).decode()
            with open(name, "w") as file:
                file.write(text[:-200])

        def drop_pose(folder):
            name = os.path.join(folder, "trajectory.tum")
            rows = read(name).decode().splitlines(True)
            with open(name, "w") as file:
                file.writelines(rows[:-1])

        def write_summary(text):
            def apply(folder):
                with open(os.path.join(folder, "summary.json"), "w") as file:
                    file.write(text)
            return apply
        for i, damage in enumerate((cut_frames, drop_pose, write_summary("[]"),
                                    write_summary('{"input": "x"}'), write_summary("{"))):
            folder = self.path(f"damaged_{i}")
            shutil.copytree(output, folder)
            damage(folder)
            result = run("report_run", folder)
            self.assertEqual(result.returncode, 2, result.stderr)
            self.assertRegex(result.stderr, r"\Areport_run: .*\n\Z")

    def test_results_are_complete_without_matplotlib(self):
        no_matplotlib = self.path("modules")
        os.makedirs(no_matplotlib)
        with open(os.path.join(no_matplotlib, "matplotlib.py"), "w") as file:
            file.write("raise ImportError('no matplotlib here')\n")
        result = subprocess.run(
            [find_program("offline_odometry"), self.kitti, "-o", self.path("out"), "--quiet",
             "--report"], env=dict(os.environ, PYTHONPATH=no_matplotlib), stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, universal_newlines=True, timeout=300)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertIn("python3-matplotlib", result.stderr)
        self.assertIn("results are complete", result.stderr)
        self.assertNotIn("Traceback", result.stderr)
        self.assertIn("trajectory.tum", os.listdir(self.path("out")))

    def test_in_a_browser(self):
        browser = shutil.which("chromium") or shutil.which("chromium-browser")
        if not browser:
            raise unittest.SkipTest("no chromium: scripts/setup --checks installs it")
        output, _ = self.make(DARK, "seen")
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                   "--enable-logging=stderr", "--user-data-dir=" + self.path("profile")]
        page = "file://" + os.path.join(output, "report.html")
        for width in (400, 1280):
            image = self.path(f"{width}.png")
            result = subprocess.run(command + [f"--window-size={width},2400",
                                               "--screenshot=" + image, page],
                                    stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                    universal_newlines=True, timeout=120)
            self.assertTrue(os.path.isfile(image), result.stderr[-2000:])
            # Whatever the page's own security policy refuses is told here, too.
            self.assertNotIn("CONSOLE", result.stderr)
            size, pixels = read_png(image)
            self.assertEqual(size, (width, 2400))
            # Bytes of rows that are not one colour: curves and text.
            self.assertGreater(len(zlib.compress(pixels)), 30000)


if __name__ == "__main__":
    unittest.main()
