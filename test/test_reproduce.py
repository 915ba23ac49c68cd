#!/usr/bin/env python3
"""Tests of scripts/reproduce as its users run it, on small sequences in both layouts."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

import yaml

from tool_fixture import BASELINE_M, cut_off, find_program, make_kitti, read, write

REPOSITORY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
SCRIPTS = os.path.join(REPOSITORY, "scripts")
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
    truth = "#timestamp,x,y,z,qw,qx,qy,qz\n" + "".join(
        f"{PERIOD_NS * (i + 1)},0,{0.12 * i},0,1,0,0,0\n" for i in range(len(images)))
    write_new(os.path.join(folder, "mav0", "state_groundtruth_estimate0", "data.csv"), truth)
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
        return {row["sequence"]: row for row in csv.DictReader(file)}


def table_rows(report, first):
    """Cells of the rows of a report's tables that begin so."""
    return [[cell.strip() for cell in line.strip("|").split("|")]
            for line in report.splitlines() if line.startswith(f"| {first} |")]


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
        """Names of the sequences in the joblog, one for every job."""
        lines = read(os.path.join(output, "joblog")).decode().splitlines()
        return [line.split("\t")[8].split()[1] for line in lines[1:]]

    def test_runs_all_sequences_and_names_the_damaged_one(self):
        self.assertEqual(self.first.returncode, 1, self.first.stdout + self.first.stderr)
        self.assertIn("not public: KITTI 11", self.first.stdout)
        self.assertIn("problems with 02", self.first.stdout)
        self.assertEqual(sorted(self.ran(self.output)), ["00", "01", "02", "V1_01_easy"])
        self.assertEqual(os.listdir(os.path.join(self.output, "sequences", "02")),
                         ["sequence.json"])
        report = read(os.path.join(self.output, "report.md")).decode()
        self.assertIn("3 of 4 sequences", report)
        self.assertRegex(report, r"\*\*02\*\*: offline_odometry: .*000002\.png")
        self.assertIn("**00** has 4 of 4541 frames", report)
        for name in re.findall(r"!\[[^]]*\]\(([^)]*)\)", report):
            self.assertEqual(read(os.path.join(self.output, name))[:4], b"\x89PNG")
        self.assertEqual(os.listdir(self.scratch), [])

    def test_figures_are_those_of_evaluate_trajectory(self):
        rows = rows_of(os.path.join(self.output, "results.csv"))
        self.assertEqual(set(rows), {"00", "01", "02", "V1_01_easy"})
        mav0 = os.path.join(self.euroc, "V1_01_easy", "mav0")
        for name, arguments in (
                ("00", ["--groundtruth", os.path.join(self.kitti, "sequences/00/poses.txt"),
                        "--estimate", os.path.join(self.output, "sequences/00/trajectory.kitti")]),
                ("V1_01_easy",
                 ["--groundtruth", os.path.join(mav0, "state_groundtruth_estimate0/data.csv"),
                  "--estimate", os.path.join(self.output, "sequences/V1_01_easy/trajectory.tum"),
                  "--body-to-camera", os.path.join(mav0, "cam0/sensor.yaml")])):
            scores = json.loads(reproduce(*arguments, "--json",
                                          script="evaluate_trajectory").stdout)
            self.assertEqual(float(rows[name]["ate_rmse"]), scores["ate_m"]["rmse"])
            self.assertEqual(float(rows[name]["path_m"]), scores["path_length_m"])
            self.assertEqual(float(rows[name]["frame_deg"]),
                             scores["per_frame"]["rotation_rmse_deg"])
            self.assertLess(scores["ate_m"]["rmse"], 0.01)  # of 0.36 m: the frames are right
            summary = load_json(self.output, "sequences", name, "summary.json")
            self.assertEqual(float(rows[name]["time_ms"]), summary["times"]["total_ms"]["median"])

    def test_goes_on_where_it_was(self):
        output = self.copy_output("again")
        before = {name: os.stat(os.path.join(output, "sequences", name)).st_ino
                  for name in ("00", "01", "V1_01_easy")}
        os.mkdir(os.path.join(output, "sequences", "1.part"))  # of a run that was killed
        result = self.run_into(output)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertEqual(self.ran(output)[4:], ["02"])
        self.assertEqual(self.run_into(output).returncode, 0)
        self.assertEqual(len(self.ran(output)), 5)
        os.remove(os.path.join(output, "sequences", "01", "frames.csv"))
        self.assertEqual(self.run_into(output).returncode, 0)
        self.assertEqual(self.ran(output)[5:], ["01"])
        for name in ("00", "V1_01_easy"):
            self.assertEqual(os.stat(os.path.join(output, "sequences", name)).st_ino, before[name])
        self.assertEqual(sorted(os.listdir(os.path.join(output, "sequences"))),
                         ["00", "01", "02", "V1_01_easy"])

    def test_refuses_results_of_other_settings(self):
        output, config = self.copy_output("other"), self.path("other.yaml")
        write(config, "points:\n  levels: 2\n")
        one = os.path.join(self.kitti, "sequences", "00")
        arguments = [one, "-", "-o", output, "--no-build"]
        self.refuse(["other parameters for KITTI", "--fresh"], *arguments, "--kitti-config", config)
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
        self.assertEqual(self.ran(output), ["00"])
        self.assertEqual(os.listdir(os.path.join(output, "sequences")), ["00"])

    def test_refuses_wrong_arguments(self):
        output = ["-o", self.path("none"), "--no-build"]
        self.refuse("no sequence found", "-", "-", *output)
        self.refuse(["no sequence found", "mav0"], "-", self.kitti, *output)
        self.refuse([self.path("gone"), "does not exist"], self.path("gone"), "-", *output)
        self.refuse("gone.yaml", self.kitti, "-", "--kitti-config", "gone.yaml", *output)
        self.refuse("--jobs", self.kitti, "-", "--jobs", "0", *output)
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
        result = reproduce(one, "-", "-o", output, "--no-build", "--hosts", hosts)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)
        self.assertIn("machine 2/ssh -p 1 127.0.0.1 is left out: ", result.stdout)
        self.assertEqual(self.ran(output), ["00"])
        self.assertEqual(read(os.path.join(output, "sequences/00/trajectory.tum")),
                         read(os.path.join(self.output, "sequences/00/trajectory.tum")))

    def make_benchmark(self, published):
        """An output folder as if all sequences of both benchmarks had been run, with t_rel 0.1 %,
        0.2 % ... and an absolute error of 0.01 m, 0.02 m ..."""
        output = self.copy_output("benchmark")
        settings = load_json(output, "settings.json")
        settings["sequences"] = {}
        template = self.path("template")
        shutil.move(os.path.join(output, "sequences", "00"), template)
        shutil.rmtree(os.path.join(output, "sequences"))
        for layout in ("KITTI", "EuRoC"):
            for i, (name, frames) in enumerate(published[layout]["frames"].items(), 1):
                folder = os.path.join(output, "sequences", name)
                shutil.copytree(template, folder)
                settings["sequences"][name] = {"folder": "/" + name, "layout": layout}
                self.change_json(folder, "sequence.json", layout=layout)
                self.change_json(folder, "summary.json", frames=frames)
                scores = load_json(folder, "evaluation.json")
                self.change_json(
                    folder, "evaluation.json", ate_m={"rmse": 0.01 * i},
                    kitti={**scores["kitti"], "t_rel_percent": 0.1 * i, "segments": 9,
                           "r_rel_deg_per_100m": 0.01 * i})
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
        report = read(os.path.join(output, "report.md")).decode()
        self.assertIn("22 of 22 sequences", report)
        self.assertNotIn("Short and other sequences", report)
        self.assertEqual(table_rows(report, "03")[0][:8],
                         ["03", "801", "0.40", "0.71", "0.70", "0.04", "0.18", "0.04"])
        self.assertEqual(table_rows(report, "V2_03_difficult")[0][:6],
                         ["V2_03_difficult", "1922", "0.110", "lost", "0.126", "-"])
        kitti, euroc = table_rows(report, "mean of 11")
        self.assertEqual(kitti[1:7], ["", "0.60", "0.72", "0.68", "0.06", "0.22"])
        self.assertEqual(euroc[2], "0.060")
        self.assertRegex(euroc[3], r"^0\.04[34] \(10\)$")  # V2_03 is lost
        kitti, euroc = table_rows(report, "this package")
        self.assertEqual((kitti[3:5], euroc[3]), (["0.600", "0.060"], "0.060"))
        self.assertEqual(table_rows(report, "Gao et al. 2021")[0][3:5], ["0.690", "0.200"])
        for layout in published:
            for system in published[layout]["systems"]:
                self.assertIn(f"{system['name']} on {layout}: {system['source']}", report)

    def test_published_figures_are_complete_and_fit_their_means(self):
        with open(PUBLISHED, encoding="utf-8") as file:
            published = yaml.safe_load(file)
        self.assertEqual(set(published), {"KITTI", "EuRoC"})
        for layout, keys in (("KITTI", {"t_rel", "r_rel"}), ("EuRoC", {"ate_rmse"})):
            names = set(published[layout]["frames"])
            self.assertEqual(len(names), 11)
            for system in published[layout]["systems"]:
                self.assertTrue(system["source"] and system["method"], system["name"])
                self.assertTrue("mean" in system or "sequences" in system, system["name"])
                self.assertLessEqual(set(system.get("sequences", {})), names)
                for figures in [system.get("mean", {}), *system.get("sequences", {}).values()]:
                    self.assertLessEqual(set(figures), keys)
                if "mean" in system and "sequences" in system:
                    self.assertEqual(set(system["sequences"]), names)
                    for key, mean in system["mean"].items():
                        values = [figures[key] for figures in system["sequences"].values()]
                        self.assertAlmostEqual(sum(values) / 11, mean, delta=0.0006)


if __name__ == "__main__":
    unittest.main()
