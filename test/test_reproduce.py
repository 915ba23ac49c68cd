#!/usr/bin/env python3
"""Tests of scripts/reproduce as its users run it, on small sequences in both layouts."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import yaml

from tool_fixture import BASELINE_M, cut_off, find_program, make_kitti, read, write

REPOSITORY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
SCRIPTS = os.path.join(REPOSITORY, "scripts")
METHODS = ("paper", "default")
PUBLISHED = os.path.join(REPOSITORY, "doc", "published_results.yaml")
PERIOD_NS = 100000000

SENSOR = """\
T_BS: {{cols: 4, rows: 4, data: [0, -1, 0, 0.01, 1, 0, 0, {y}, 0, 0, 1, 0.03, 0, 0, 0, 1]}}
resolution: [320, 160]
intrinsics: [200, 200, 160, 80]
distortion_model: radial-tangential
distortion_coefficients: [0, 0, 0, 0]
"""


def make_euroc(folder):
    """The images of make_kitti as an EuRoC sequence whose camera is turned against the body."""
    source = folder + ".images"
    make_kitti(source)
    images = sorted(os.listdir(os.path.join(source, "image_0")))
    for side in (0, 1):
        camera = os.path.join(folder, "mav0", f"cam{side}")
        os.makedirs(os.path.join(camera, "data"))
        # The body's y axis is the camera's x axis.
        write(os.path.join(camera, "sensor.yaml"), SENSOR.format(y=0.02 + BASELINE_M * side))
        rows = "#timestamp [ns],filename\n"
        for i, image in enumerate(images):
            name = f"{PERIOD_NS * (i + 1)}.png"
            shutil.move(os.path.join(source, f"image_{side}", image),
                        os.path.join(camera, "data", name))
            rows += f"{name[:-4]},{name}\n"
        write(os.path.join(camera, "data.csv"), rows)
    ground_truth = "#timestamp,x,y,z,qw,qx,qy,qz\n" + "".join(
        f"{PERIOD_NS * (i + 1)},0,{0.12 * i},0,1,0,0,0\n" for i in range(len(images)))
    write_new(os.path.join(folder, "mav0", "state_groundtruth_estimate0", "data.csv"), ground_truth)
    shutil.rmtree(source)


def write_new(path, text):
    """Writes a file into a folder that may have to be made."""
    os.makedirs(os.path.dirname(path), exist_ok=True)
    write(path, text)


def make_data(root):
    """A KITTI data set as published, with a sequence that is cut off and a test sequence, and an
    EuRoC data set in a folder with a blank."""
    for name in ("00", "01", "02", "11"):
        make_kitti(os.path.join(root, "kitti", "sequences", name))
    for name in ("01", "11"):
        poses = os.path.join(root, "kitti", "sequences", name, "poses.txt")
        if name == "01":
            write_new(os.path.join(root, "kitti", "poses", "01.txt"), read(poses).decode())
        os.remove(poses)
    make_euroc(os.path.join(root, "euroc data", "V1_01_easy"))


def start(*arguments, programs=None, script="reproduce"):
    programs = programs or os.path.dirname(find_program("offline_odometry"))
    environment = dict(os.environ, POINT_LINE_ODOMETRY_BIN=programs, TMPDIR=ReproduceTest.scratch)
    return subprocess.Popen([os.path.join(SCRIPTS, script), *arguments], env=environment,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            universal_newlines=True)


def reproduce(*arguments, **options):
    with start(*arguments, **options) as process:
        output, errors = process.communicate(timeout=120)
    return subprocess.CompletedProcess(arguments, process.returncode, output, errors)


def load_json(*names):
    with open(os.path.join(*names), encoding="utf-8") as file:
        return json.load(file)


def rows_of(path):
    with open(path, encoding="utf-8", newline="") as file:
        return {(row["sequence"], row["method"]): row for row in csv.DictReader(file)}


def table_rows(report, first):
    """Cells of the rows of a report's tables that begin so."""
    return [cells_of(line) for line in report.splitlines() if line.startswith(f"| {first} |")]


def cells_of(line):
    return [cell.strip() for cell in line.strip("|").split("|")]


def tables_of(report):
    """All tables of a report, rows as heading: cell."""
    tables = []
    for block in re.findall(r"(?:^\|.*\n)+", report, re.MULTILINE):
        heading, _, *rows = map(cells_of, block.splitlines())
        tables.append([dict(zip(heading, row)) for row in rows])
    return tables


def scripts_module(name):
    """A module of scripts/."""
    if SCRIPTS not in sys.path:
        sys.path.insert(0, SCRIPTS)
    return __import__(name)


class ReproduceTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = tempfile.mkdtemp(prefix="point_line_reproduce_")
        cls.addClassCleanup(shutil.rmtree, cls.root)
        cls.scratch = cls.path("scratch")
        os.mkdir(cls.scratch)
        make_data(cls.root)
        cls.kitti, cls.euroc = cls.path("kitti"), cls.path("euroc data")
        cls.damaged = cls.path("kitti", "sequences", "02", "image_1", "000002.png")
        whole = read(cls.damaged)
        cut_off(cls.damaged)
        cls.output = cls.path("out")
        cls.first = reproduce(cls.kitti, cls.euroc, "-o", cls.output, "--no-build")
        with open(cls.damaged, "wb") as file:
            file.write(whole)

    @classmethod
    def path(cls, *names):
        return os.path.join(cls.root, *names)

    def copy_output(self, name):
        return shutil.copytree(self.output, self.path(name))

    def run_into(self, output, *arguments):
        return reproduce(self.kitti, self.euroc, "-o", output, "--no-build", *arguments)

    def refuse(self, words, *arguments, script="reproduce", programs=None):
        """Asserts exit code 2 and a sentence with the words, and that no output folder was made."""
        result = reproduce(*arguments, script=script, programs=programs)
        self.assertEqual(result.returncode, 2, result.stdout + result.stderr)
        for word in words if isinstance(words, list) else [words]:
            self.assertIn(word, result.stderr)
        self.assertNotIn("Traceback", result.stderr)
        self.assertFalse(os.path.exists(self.path("none")))

    def ran(self, output):
        """Sequence and method of every job in the joblog."""
        lines = read(os.path.join(output, "joblog")).decode().splitlines()
        return [tuple(line.split("\t")[8].split()[1:3]) for line in lines[1:]]

    def report(self, output):
        return read(os.path.join(output, "report.md")).decode()

    def test_runs_all_sequences_and_names_the_damaged_one(self):
        self.assertEqual(self.first.returncode, 1, self.first.stdout + self.first.stderr)
        self.assertIn("not public: KITTI 11", self.first.stdout)
        self.assertIn("problems with 02 (paper), 02 (default)", self.first.stdout)
        self.assertEqual(sorted(self.ran(self.output)),
                         [(name, method) for name in ("00", "01", "02", "V1_01_easy")
                          for method in sorted(METHODS)])
        for method in METHODS:
            self.assertEqual(os.listdir(os.path.join(self.output, "sequences", "02", method)),
                             ["sequence.json"])
        report = self.report(self.output)
        self.assertIn("6 of 8 runs", report)
        self.assertRegex(report, r"\*\*02\*\*, paper: offline_odometry: .*000002\.png")
        self.assertIn("**00** has 4 of 4541 frames", report)
        images = re.findall(r"!\[[^]]*\]\(([^)]*)\)", report)
        for name in images:
            self.assertEqual(read(os.path.join(self.output, name))[:4], b"\x89PNG")
        # No error over segments: the path length is 0.36 m.
        self.assertEqual([name for name in images if "/" not in name],
                         ["figure_5.png", "figure_7.png", "figure_8.png", "figure_9.png",
                          "residuals.png"])
        self.assertEqual(os.listdir(self.scratch), [])

    def test_figures_are_those_of_evaluate_trajectory(self):
        rows = rows_of(os.path.join(self.output, "results.csv"))
        self.assertEqual(set(rows), {(name, method) for name in ("00", "01", "02", "V1_01_easy")
                                     for method in METHODS})
        mav0 = os.path.join(self.euroc, "V1_01_easy", "mav0")
        for name, ground_truth, file, more in (
                ("00", os.path.join(self.kitti, "sequences/00/poses.txt"), "trajectory.kitti", []),
                ("V1_01_easy", os.path.join(mav0, "state_groundtruth_estimate0/data.csv"),
                 "trajectory.tum", ["--body-to-camera", os.path.join(mav0, "cam0/sensor.yaml")])):
            for method in METHODS:
                row = rows[name, method]
                folder = os.path.join(self.output, "sequences", name, method)
                scores = json.loads(reproduce(
                    "--groundtruth", ground_truth, "--estimate", os.path.join(folder, file), "--json",
                    *more, script="evaluate_trajectory").stdout)
                self.assertEqual(float(row["ate_rmse"]), scores["ate_m"]["rmse"])
                self.assertEqual(float(row["path_m"]), scores["path_length_m"])
                self.assertEqual(float(row["frame_deg"]), scores["per_frame"]["rotation_rmse_deg"])
                # Of 0.36 m: the frames are right.
                self.assertLess(scores["ate_m"]["rmse"], 0.06 if method == "paper" else 0.02)
                summary = load_json(folder, "summary.json")
                self.assertEqual(float(row["time_ms"]), summary["times"]["total_ms"]["median"])

    def test_each_method_has_its_configuration(self):
        for name in ("00", "V1_01_easy"):
            paper, default = (load_json(self.output, "sequences", name, method, "summary.json")
                              ["parameters"] for method in METHODS)
            self.assertEqual((paper["window/size"], paper["motion/residual_images"]), ("0", "left"))
            self.assertEqual((default["window/size"], default["motion/residual_images"]),
                             ("5", "both"))
            self.assertNotEqual(*(read(os.path.join(self.output, "sequences", name, method,
                                                    "trajectory.tum")) for method in METHODS))
        report = self.report(self.output)
        self.assertRegex(report, r"(?m)^- \*\*paper\*\*: points and lines, frame to frame, "
                                 r"rotation fused\. Parameters: .*config/paper\.yaml")
        self.assertRegex(report, r"(?m)^- \*\*default\*\*: points and lines, landmarks, window of "
                                 r"5 keyframes, local map of 100\. Parameters: .*config/kitti\.yaml")

    def test_parameters_that_differ(self):
        table, = (table for table in tables_of(self.report(self.output)) if "parameter" in table[0])
        rows = {line["parameter"]: (line["paper"], line["default"]) for line in table}
        self.assertEqual(rows["window/size"], ("0", "5"))
        self.assertEqual(rows["motion/residual_images"], ("left", "both"))
        # kitti.yaml and euroc.yaml have limits of their own.
        self.assertEqual(rows["tracking/max_speed_m_s"][1], "50, 10")
        self.assertNotIn("tracking/threads", rows)

    def test_tables_have_the_numbers_of_the_results(self):
        rows = rows_of(os.path.join(self.output, "results.csv"))
        keys = {"AT-RMSE [m]": "ate_rmse", "per frame [mm]": "frame_mm",
                "per frame [deg]": "frame_deg", "time [ms]": "time_ms"}
        seen = 0
        for table in tables_of(self.report(self.output)):
            for line in table:
                for heading, cell in line.items():
                    method, _, figure = heading.partition(": ")
                    if figure in keys and "sequence" in line:
                        value = float(rows[line["sequence"], method][keys[figure]])
                        decimals = len(cell.partition(".")[2])
                        self.assertEqual(cell, f"{value:.{decimals}f}", (line["sequence"], heading))
                        seen += 1
        self.assertEqual(seen, 3 * 2 * len(keys))

    def test_times_of_the_stages(self):
        stages, = (table for table in tables_of(self.report(self.output)) if "stage" in table[0])
        for layout, names in (("KITTI", ("00", "01")), ("EuRoC", ("V1_01_easy",))):
            for method in METHODS:
                times = [load_json(self.output, "sequences", name, method, "summary.json")["times"]
                         for name in names]
                for line in stages:
                    medians = [each[line["stage"] + "_ms"]["median"] for each in times]
                    self.assertEqual(line[f"{layout}, {method} [ms]"],
                                     f"{sum(medians) / len(medians):.2f}")
        self.assertIn("total", [line["stage"] for line in stages])
        own, = table_rows(self.report(self.output), "this package, paper")
        totals = [load_json(self.output, "sequences", name, "paper", "summary.json")
                  ["times"]["total_ms"]["median"] for name in ("00", "01")]
        self.assertEqual(own[1], f"{sum(totals) / len(totals):.1f} (2 run)")

    def test_one_method_then_the_other(self):
        output = self.path("joined")
        one = os.path.join(self.kitti, "sequences", "00")
        config = self.path("points.yaml")
        write(config, "lines:\n  enabled: false\nwindow:\n  size: 0\n"
              "motion:\n  fuse_rotation: never\n")
        run = [one, "-", "-o", output, "--no-build", "--method"]
        result = reproduce(*run, "paper")
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertEqual(self.ran(output), [("00", "paper")])
        alone = self.report(output)
        self.assertIn("1 of 1 runs", alone)
        self.assertNotIn("| default", alone)
        self.assertNotIn("this package, default", alone)
        self.assertNotIn("00/default", alone)
        result = reproduce(*run, "default", "--kitti-config", config)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertEqual(self.ran(output), [("00", "paper"), ("00", "default")])
        both = self.report(output)
        self.assertIn("2 of 2 runs", both)
        self.assertIn("- **paper**: points and lines, frame to frame, rotation fused.", both)
        # The words come from the configuration that ran, not from the name.
        self.assertIn("- **default**: points, frame to frame.", both)
        self.assertEqual(set(rows_of(os.path.join(output, "results.csv"))),
                         {("00", method) for method in METHODS})

    def test_resumes_where_it_was(self):
        output = self.copy_output("again")
        before = {name: os.stat(os.path.join(output, "sequences", name)).st_ino
                  for name in ("00/paper", "00/default", "01/paper", "V1_01_easy/default")}
        os.mkdir(os.path.join(output, "sequences", "1.part"))  # of a run that was killed
        result = self.run_into(output)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertEqual(sorted(self.ran(output)[8:]), [("02", "default"), ("02", "paper")])
        self.assertEqual(self.run_into(output).returncode, 0)
        self.assertEqual(len(self.ran(output)), 10)
        os.remove(os.path.join(output, "sequences", "01", "default", "frames.csv"))
        self.assertEqual(self.run_into(output).returncode, 0)
        self.assertEqual(self.ran(output)[10:], [("01", "default")])
        for name, inode in before.items():
            self.assertEqual(os.stat(os.path.join(output, "sequences", name)).st_ino, inode)
        self.assertEqual(sorted(os.listdir(os.path.join(output, "sequences"))),
                         ["00", "01", "02", "V1_01_easy"])

    def test_refuses_results_of_other_settings(self):
        output, config = self.copy_output("other"), self.path("other.yaml")
        write(config, "points:\n  levels: 2\n")
        one = os.path.join(self.kitti, "sequences", "00")
        arguments = [one, "-", "-o", output, "--no-build", "--method", "default"]
        self.refuse(["other parameters of the method 'default' for KITTI", "--fresh"], *arguments,
                    "--kitti-config", config)
        programs = self.path("programs")
        os.mkdir(programs)
        shutil.copy(find_program("offline_odometry"), programs)
        with open(os.path.join(programs, "offline_odometry"), "ab") as file:
            file.write(b"\0")
        self.refuse(["another build", "--fresh"], *arguments, programs=programs)
        moved = shutil.copytree(one, self.path("moved", "00"))
        self.refuse(["another sequence 00", one], moved, *arguments[1:])
        result = reproduce(*arguments, "--kitti-config", config, "--fresh")
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertEqual(self.ran(output), [("00", "default")])
        self.assertEqual(os.listdir(os.path.join(output, "sequences")), ["00"])

    def test_refuses_wrong_arguments(self):
        output = ["-o", self.path("none"), "--no-build"]
        self.refuse("no sequence found", "-", "-", *output)
        self.refuse(["no sequence found", "mav0"], "-", self.kitti, *output)
        self.refuse([self.path("gone"), "does not exist"], self.path("gone"), "-", *output)
        self.refuse("gone.yaml", self.kitti, "-", "--kitti-config", "gone.yaml", *output)
        self.refuse("--jobs", self.kitti, "-", "--jobs", "0", *output)
        self.refuse("--method", self.kitti, "-", "--method", "fast", *output)
        self.refuse("method 'default'", self.kitti, "-", "--method", "paper", "--kitti-config",
                    os.path.join(REPOSITORY, "config", "kitti.yaml"), *output)
        self.refuse("--hosts", self.kitti, "-", "--hosts", self.path("gone"), *output)
        self.refuse("scripts/build", self.kitti, "-", *output, programs=self.root)
        self.refuse("not made by this script", self.kitti, "-", "-o", self.root, "--no-build")
        self.refuse("has no results", self.root, script="report_sequences")

    def test_interrupted_run_leaves_nothing(self):
        programs, output = self.path("slow"), self.path("interrupted")
        seconds = str(100000 + os.getpid())  # by which its process is known
        os.mkdir(programs)
        program = os.path.join(programs, "offline_odometry")
        write(program, "#!/bin/sh\ntouch started.part\nexec sleep " + seconds + "\n")
        os.chmod(program, 0o755)
        for number, code in ((signal.SIGTERM, 130), (signal.SIGKILL, -signal.SIGKILL)):
            with start(self.kitti, "-", "-o", output, "--no-build", programs=programs) as process:
                self.wait_until(lambda: self.running(seconds))
                process.send_signal(number)
                process.communicate(timeout=60)
            self.assertEqual(process.returncode, code)
            self.wait_until(lambda: not self.running(seconds))
            self.assertEqual(os.listdir(os.path.join(output, "sequences")), [])
        self.wait_until(lambda: not [name for name in os.listdir(self.scratch)
                                     if name.startswith("run_sequence_")])

    @staticmethod
    def running(word):
        """Whether a process has the word among its arguments."""
        for process in filter(str.isdigit, os.listdir("/proc")):
            try:
                if word.encode() in read(f"/proc/{process}/cmdline").split(b"\0"):
                    return True
            except OSError:
                pass
        return False

    def wait_until(self, condition):
        deadline = time.monotonic() + 60.0
        while not condition():
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.05)

    def test_leaves_out_machines_that_do_not_answer(self):
        hosts, output = self.path("hosts"), self.path("spread")
        write(hosts, "# two machines\n1/:\n2/ssh -p 1 127.0.0.1\n")
        one = os.path.join(self.kitti, "sequences", "00")
        result = reproduce(one, "-", "-o", output, "--no-build", "--hosts", hosts, "--method",
                           "paper")
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertIn("machine 2/ssh -p 1 127.0.0.1 is left out: ", result.stdout)
        self.assertEqual(self.ran(output), [("00", "paper")])
        self.assertEqual(read(os.path.join(output, "sequences/00/paper/trajectory.tum")),
                         read(os.path.join(self.output, "sequences/00/paper/trajectory.tum")))

    def make_benchmark(self, published):
        """An output folder as if all sequences of both benchmarks had been run: with the default
        t_rel is 0.1 %, 0.2 % ..., r_rel a tenth of it and the absolute error 0.01 m, 0.02 m ...;
        with the paper's method twice that."""
        output = self.copy_output("benchmark")
        self.addCleanup(shutil.rmtree, output)
        settings = load_json(output, "settings.json")
        settings["sequences"] = {}
        template = self.path("template")
        self.addCleanup(shutil.rmtree, template)
        shutil.move(os.path.join(output, "sequences", "00"), template)
        shutil.rmtree(os.path.join(output, "sequences"))
        for layout in ("KITTI", "EuRoC"):
            for i, (name, frames) in enumerate(published[layout]["frames"].items(), 1):
                shutil.copytree(template, os.path.join(output, "sequences", name))
                settings["sequences"][name] = {"folder": "/" + name, "layout": layout,
                                               "methods": list(METHODS)}
                for method, error in (("paper", 2 * i), ("default", i)):
                    folder = os.path.join(output, "sequences", name, method)
                    self.change_json(folder, "sequence.json", layout=layout)
                    self.change_json(folder, "summary.json", frames=frames)
                    scores = load_json(folder, "evaluation.json")
                    self.change_json(
                        folder, "evaluation.json", ate_m={"rmse": 0.01 * error},
                        kitti={**scores["kitti"], "t_rel_percent": 0.1 * error, "segments": 9,
                               "r_rel_deg_per_100m": 0.01 * error})
        write(os.path.join(output, "settings.json"), json.dumps(settings))
        return output

    def change_json(self, folder, name, **values):
        path = os.path.join(folder, name)
        write(path, json.dumps({**load_json(path), **values}))

    def test_tables_stand_beside_published_figures(self):
        with open(PUBLISHED, encoding="utf-8") as file:
            published = yaml.safe_load(file)
        output = self.make_benchmark(published)
        result = reproduce(output, script="report_sequences")
        self.assertEqual(result.returncode, 0, result.stderr)
        report = self.report(output)
        self.assertIn("44 of 44 runs", report)
        self.assertNotIn("Short and other sequences", report)
        for title in ("## Table 1: ", "## Table 2: ", "## Table 3: "):
            self.assertEqual(report.count(title), 1)
        tables = tables_of(report)
        kitti, euroc = (next(table for table in tables if table[0].get("sequence") == name)
                        for name in ("00", "MH_01_easy"))
        # Table 1 has the paper's columns, also those without a number.
        self.assertEqual(
            list(kitti[3].items()),
            [("sequence", "03"), ("frames", "801")]
            + [(name + ": t_rel [%]", cell) for name, cell in (
                ("paper", "0.80"), ("default", "0.40"), ("Gao et al. 2021", "not given"),
                ("ORB-SLAM2", "0.71"), ("PLSVO", "not given"), ("SOFT2", "not given"),
                ("SOFT-SLAM", "0.70"))]
            + [(name + ": r_rel [deg/100 m]", cell) for name, cell in (
                ("paper", "0.08"), ("default", "0.04"), ("Gao et al. 2021", "not given"),
                ("ORB-SLAM2", "0.18"), ("PLSVO", "not given"), ("SOFT2", "not given"))])
        self.assertEqual([kitti[-1][key + ": t_rel [%]"] for key in
                          ("paper", "default", "Gao et al. 2021", "ORB-SLAM2", "SOFT2")],
                         ["1.20", "0.60", "0.69", "0.72", "not given"])
        last = euroc[10]
        self.assertEqual([last["sequence"], last["frames"]], ["V2_03_difficult", "1922"])
        self.assertEqual([last[key + ": AT-RMSE [cm]"] for key in (
            "paper", "default", "Gao et al. 2021", "ORB-SLAM2", "PL-SLAM", "OV2SLAM fast")],
            ["22.0", "11.0", "not given", "lost", "12.6", "not given"])
        self.assertEqual(euroc[-1]["default: AT-RMSE [cm]"], "6.0")
        self.assertRegex(euroc[-1]["ORB-SLAM2: AT-RMSE [cm]"], r"^4\.[34] \(10\)$")  # V2_03 is lost
        kitti, time, euroc = table_rows(report, "this package, default")
        self.assertEqual((kitti[3:], euroc[3:]), (["0.600", "0.060"], ["6.00"]))
        kitti, time, euroc = table_rows(report, "Gao et al. 2021")
        self.assertEqual((kitti[3:], euroc[3:]), (["0.690", "0.200"], ["not given"]))
        self.assertEqual(time[1:], ["not given"] * 3)
        self.assertEqual(table_rows(report, "ORB-SLAM2")[1][1:], ["49", "42", "i7-4790"])
        for layout in published:
            for system in published[layout]["systems"]:
                self.assertIn(f"{system['name']} on {layout}: {system['source']}", report)

    def test_figures_show_the_numbers_of_the_results(self):
        with open(PUBLISHED, encoding="utf-8") as file:
            published = yaml.safe_load(file)
        output = self.make_benchmark(published)
        report = scripts_module("_report_results").read_report(output)
        figures = scripts_module("_report_figures")
        chart = figures.draw_chart(report)
        translation, rotation = chart.axes[:2]
        self.assertEqual(translation.get_ylabel(), "translation error [%]")
        self.assertEqual([label.get_text() for label in translation.get_xticklabels()],
                         sorted(published["KITTI"]["frames"]))
        for axes, key, unit in ((translation, "t_rel", 0.1), (rotation, "r_rel", 0.01)):
            bars = {each.get_label(): [bar.get_height() for bar in each]
                    for each in axes.containers}
            for method, factor in (("paper", 2), ("default", 1)):
                for i, height in enumerate(bars[method], 1):
                    self.assertAlmostEqual(height, factor * unit * i)
            orb_slam2 = next(each for each in published["KITTI"]["systems"]
                             if each["name"] == "ORB-SLAM2")["sequences"]
            self.assertEqual(bars["ORB-SLAM2"],
                             [orb_slam2[name][key] for name in sorted(orb_slam2)])
        line, = translation.lines
        self.assertEqual(list(line.get_ydata()), [0.69, 0.69])
        # Trajectories: those of the files, the estimates and then the ground truth.
        trajectories = figures.draw_trajectories(report, "KITTI")
        self.assertEqual(len([axes for axes in trajectories.axes if axes.lines]), 11)
        first = trajectories.axes[0]
        self.assertEqual([line.get_label() for line in first.lines],
                         ["estimate, paper", "estimate, default", "ground truth"])
        self.assertEqual([line.get_linestyle() for line in first.lines], ["-", "-", "--"])
        ground_truth = first.lines[2].get_xdata()
        self.assertAlmostEqual(ground_truth[-1] - ground_truth[0], 0.36)
        # Features: the image of each sequence and method.
        images = figures.draw_images(report, "EuRoC")
        self.assertEqual(len(images.axes), 22)
        self.assertEqual(images.axes[1].get_title(), "MH_01_easy, default")

    def test_published_figures_are_complete_and_fit_their_means(self):
        with open(PUBLISHED, encoding="utf-8") as file:
            published = yaml.safe_load(file)
        self.assertEqual(set(published), {"KITTI", "EuRoC"})
        for layout, keys in (("KITTI", {"t_rel", "r_rel"}), ("EuRoC", {"ate_rmse"})):
            names = set(published[layout]["frames"])
            self.assertEqual(len(names), 11)
            for system in published[layout]["systems"]:
                self.assertTrue(system["source"] and system["method"], system["name"])
                self.assertTrue({"mean", "sequences", "not_given"} & set(system), system["name"])
                self.assertLessEqual(set(system.get("sequences", {})), names)
                for figures in [system.get("mean", {}), *system.get("sequences", {}).values()]:
                    self.assertLessEqual(set(figures), keys)
                if "mean" in system and system.get("sequences"):
                    self.assertEqual(set(system["sequences"]), names)
                    for key, mean in system["mean"].items():
                        values = [figures[key] for figures in system["sequences"].values()]
                        self.assertAlmostEqual(sum(values) / 11, mean, delta=0.0006)


if __name__ == "__main__":
    unittest.main()
