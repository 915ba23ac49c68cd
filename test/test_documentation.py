#!/usr/bin/env python3
"""README, CONTRIBUTING and doc/: tables are those of the programs, links lead somewhere, names exist,
and every command is run; of those that start a desktop, build or take long the arguments are
checked. The block "as a node" of doc/interface.md is run by test_first_steps."""

import glob
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

import rospy
import yaml
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from doctor_fixture import SUBJECTS, parse
from document_fixture import (DOCUMENTS, REPOSITORY, anchors, blocks, code_spans, commands, links,
                              read_document)
from ros_fixture import RosTest
from tool_fixture import find_program, make_kitti, run, wait_until, write

SCRIPTS = os.path.join(REPOSITORY, "scripts")
TOOLS = ("offline_odometry", "check_calibration", "dataset_to_bag", "evaluate_trajectory",
         "synthetic_world", "benchmark", "doctor", "report_run")
ROSRUN = "rosrun point_line_odometry "
RECORDING = "~/.ros/recordings/"
FRAMES = 6

# Ends a Python script as soon as it has parsed its arguments.
PARSE_ONLY = """
import argparse, os, runpy, sys
parse = argparse.ArgumentParser.parse_args
def parse_only(parser, *arguments):
    parse(parser, *arguments)
    sys.exit(0)
argparse.ArgumentParser.parse_args = parse_only
sys.argv = sys.argv[1:]
sys.path.insert(0, os.path.dirname(sys.argv[0]))
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def shell(command, folder, environment=None):
    return subprocess.run(["bash", "-c", command], cwd=folder, env=environment,
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          universal_newlines=True, timeout=300)


def is_live(command):
    """Whether a command needs a running odometry."""
    return (command.startswith(("rosservice ", "rosrun dynamic_reconfigure ", "rosrun tf2_ros "))
            or command.startswith((ROSRUN + "doctor --ns", ROSRUN + "check_calibration live"))
            or RECORDING in command)


def is_run_as_first_step(command):
    """Whether test_first_steps runs it."""
    return (command.startswith("rosparam ")
            or command == "ROS_NAMESPACE=stereo " + ROSRUN + "stereo_odometry")


class TableTest(unittest.TestCase):
    """Blocks that scripts/update_docs makes."""

    def update_docs(self, *arguments):
        environment = dict(os.environ,
                           POINT_LINE_ODOMETRY_BIN=os.path.dirname(find_program("offline_odometry")))
        return shell("scripts/update_docs " + " ".join(map(shlex.quote, arguments)), REPOSITORY,
                     environment)

    def test_tables_are_those_of_the_programs(self):
        result = self.update_docs("--check")
        self.assertEqual((result.returncode, result.stdout, result.stderr), (0, "", ""))
        made = "".join(map(read_document, DOCUMENTS))
        for program in ("offline_odometry", "synthetic_world"):
            self.assertIn(f"<!-- made by: {program} --print-parameters -->\n", made)

    def test_stale_table_is_found_and_updated(self):
        folder = tempfile.mkdtemp(prefix="point_line_documents_")
        self.addCleanup(shutil.rmtree, folder)
        path = os.path.join(folder, "parameters.md")
        text = read_document("doc/parameters.md")
        write(path, text.replace("| `lines/max_count` | 300 |", "| `lines/max_count` | 301 |"))
        stale = self.update_docs("--check", path)
        self.assertEqual(stale.returncode, 1)
        self.assertIn("not up to date", stale.stdout)
        self.assertEqual(self.update_docs(path).returncode, 0)
        with open(path, encoding="utf-8") as file:
            self.assertEqual(file.read(), text)


class LinkTest(unittest.TestCase):
    def test_links_lead_somewhere(self):
        for name in DOCUMENTS:
            self.assertGreater(len(anchors(name)), 0, name)
            for link in links(name):
                if link.startswith(("http://", "https://")):
                    continue
                with self.subTest(document=name, link=link):
                    target, _, anchor = link.partition("#")
                    path = os.path.normpath(os.path.join(os.path.dirname(name), target))
                    path = path if target else name
                    self.assertTrue(os.path.exists(os.path.join(REPOSITORY, path)), path)
                    if anchor:
                        self.assertIn(anchor, anchors(path))

    def test_readme_is_one_page_and_leads_to_all_documents(self):
        self.assertLessEqual(len(read_document("README.md").splitlines()), 150)
        self.assertGreater(len(DOCUMENTS), 8)
        self.assertEqual(set(DOCUMENTS) - set(links("README.md")) - {"README.md"}, set())


class NameTest(unittest.TestCase):
    """Files, parameters and options that documents name."""

    @classmethod
    def setUpClass(cls):
        table = run("offline_odometry", "--print-parameters").stdout
        rows = re.findall(r"^\| `(\S+)` \| (.*?) \| (.*?) \|", table, re.MULTILINE)
        cls.ranges = {name: choices for name, _, choices in rows}

    def check(self, pattern, check):
        """Runs check(*groups) for each code span that fits the pattern."""
        count = 0
        for name in DOCUMENTS:
            for span in code_spans(name):
                match = re.fullmatch(pattern, span)
                if match:
                    count += 1
                    with self.subTest(document=name, span=span):
                        check(*match.groups())
        self.assertGreater(count, 2, pattern)

    def test_reasons(self):
        """Each reason of a state is explained, and no other."""
        source = read_document("src/odometry/frame_result.cpp")
        names = re.findall(r'case TrackingReason::\w+:\s+return "(\w+)"', source)
        self.assertGreater(len(names), 10)
        states = read_document("doc/interface.md").split("\n## States\n")[1]
        rows = [line.split("|")[1] for line in states.split("\n## ")[0].splitlines()
                if line.startswith("| `")]
        self.assertEqual(sorted(re.findall(r"`(\w+)`", " ".join(rows))),
                         sorted(set(names) - {"none"}))

    def test_files(self):
        def exists(path):
            self.assertTrue(glob.glob(os.path.join(REPOSITORY, path)), path)
        self.check(r"((?:config|doc|include|launch|msg|rviz|scripts|src|srv|test)/[\w./*-]+)", exists)

    def test_launch_files(self):
        names = set(os.listdir(os.path.join(REPOSITORY, "launch")))
        self.check(r"(\w+\.launch)", lambda name: self.assertIn(name, names))

    def test_parameters(self):
        groups = {name.split("/")[0] for name in self.ranges if "/" in name}

        topics = r"(left|right)/(image_\w+|mask_image|camera_info)"

        def check(name, _, value):
            if re.fullmatch(topics, name):
                return
            self.assertIn(name, self.ranges)
            if value and re.search("[a-z]", self.ranges[name]):
                self.assertIn(value, self.ranges[name].split(", "))
        self.check(r"((?:{})/\w+)(: (\w+))?".format("|".join(groups)), check)

    def test_options(self):
        """Of the programs and scripts that prose names."""
        for name in DOCUMENTS:
            for span in code_spans(name):
                match = re.match(r"(?:rosrun point_line_odometry )?(scripts/)?(\w+)\b", span)
                options = re.findall(r"--[a-z][a-z_-]+", span)
                if not match or not options or match.group(2) not in (*TOOLS, *os.listdir(SCRIPTS)):
                    continue
                with self.subTest(document=name, span=span):
                    text = (self.text_of_script(match.group(2)) if match.group(1)
                            else run(match.group(2), "--help").stdout)
                    for option in options:
                        self.assertIn(option, text)

    @staticmethod
    def text_of_script(name):
        text = ""
        for path in (name, f"_{name}.py"):
            path = os.path.join(SCRIPTS, path)
            if os.path.exists(path):
                with open(path, encoding="utf-8") as file:
                    text += file.read()
        return text

    def test_report_of_the_doctor(self):
        reports = [block for block in blocks("doc/doctor.md", "text") if "left image" in block]
        self.assertEqual(len(reports), 1)
        self.assertEqual(list(parse(reports[0])), SUBJECTS)


class CommandTest(unittest.TestCase):
    """Every command of every document, in a folder that has what they name."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="point_line_documents_")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        make_kitti(cls.path("SEQUENCE_FOLDER"))
        for arguments in (("synthetic_world", cls.path("V1_01_easy"), "--scene", "corridor",
                           "--frames", FRAMES), ("dataset_to_bag", cls.path("SEQUENCE_FOLDER"),
                                                 cls.path("drive.bag"))):
            result = run(*arguments)
            assert result.returncode == 0, result.stderr
        os.symlink(os.path.join(REPOSITORY, "config"), cls.path("config"))
        write(cls.path("own.yaml"), "lines: {max_count: 200}\n")

    @classmethod
    def path(cls, *names):
        return os.path.join(cls.folder, *names)

    def test_commands(self):
        checks = [(ROSRUN + r"(\w+) ?(.*)", self.run_tool),
                  (r"roslaunch point_line_odometry (\S+) ?(.*)", self.check_launch),
                  (r"scripts/(\w+) ?(.*)", self.check_script),
                  (r"(?:export \S+=|source )()().*", lambda *_: None),
                  (r"ROS_NAMESPACE=stereo " + ROSRUN + r"(synthetic_stereo) (.*)",
                   self.check_camera),
                  (r"cmake (-S) (\S+) -B \S+ (.*)", self.check_configuration),
                  (r"(?:cmake --build|\(cd build && ctest|build_examples/minimal)()().*",
                   lambda *_: None),  # scripts/test_without_ros
                  (r"git clone (REPOSITORY) (\S+) && cd (\S+)", self.clone)]
        count = 0
        for name in DOCUMENTS:
            for command in commands(name):
                if is_live(command) or is_run_as_first_step(command):
                    continue
                count += 1
                with self.subTest(document=name, command=command):
                    fits = [(match, check) for match, check in
                            ((re.fullmatch(pattern, command), check) for pattern, check in checks)
                            if match]
                    self.assertEqual(len(fits), 1, "no check fits this command")
                    match, check = fits[0]
                    check(*match.groups())
        self.assertGreater(count, 25)

    def run_tool(self, tool, arguments):
        """Runs it for real, on some frames."""
        self.assertIn(tool, TOOLS)
        arguments = re.sub(r"--frames \d+", f"--frames {FRAMES}", arguments)
        extra = {"offline_odometry": f" --max-frames {FRAMES}",
                 "benchmark": f" --frames {FRAMES}" if "--summary" in arguments
                 else " --benchmark_list_tests"}
        result = shell(shlex.quote(find_program(tool)) + " " + arguments + extra.get(tool, ""),
                       self.folder)
        # The doctor may find a fault in the bag, which is no fault of the command.
        codes = (0, 1) if tool == "doctor" else (0,)
        self.assertIn(result.returncode, codes, result.stderr)
        self.assertNotEqual(result.stdout, "")

    def check_launch(self, name, arguments):
        """All but starting it: the file takes these arguments, and its parameters can be read."""
        known = {node.get("name") for node in ElementTree.parse(
            os.path.join(REPOSITORY, "launch", name)).getroot().findall("arg")
            if node.get("value") is None}
        for argument in re.findall(r"(\w+):=", arguments):
            self.assertIn(argument, known)
        result = shell(f"roslaunch --dump-params point_line_odometry {name} {arguments}",
                       self.folder)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("/stereo_odometry/", result.stdout)

    def check_script(self, name, arguments):
        """That it takes these arguments; of shell scripts, that their description has them."""
        path = os.path.join(SCRIPTS, name)
        self.assertTrue(os.access(path, os.X_OK), path)
        python = path if "python" in self.first_line(path) else os.path.join(SCRIPTS, f"_{name}.py")
        if os.path.exists(python):
            result = subprocess.run([sys.executable, "-c", PARSE_ONLY, python,
                                     *shlex.split(arguments)], stdout=subprocess.PIPE,
                                    stderr=subprocess.STDOUT, universal_newlines=True, timeout=60)
            self.assertEqual(result.returncode, 0, result.stdout)
            return
        with open(path, encoding="utf-8") as file:
            description = file.read().partition("\nset ")[0]
        for word in shlex.split(arguments):
            self.assertTrue(word.isdigit() or word in description, word)

    @staticmethod
    def first_line(path):
        with open(path, encoding="utf-8") as file:
            return file.readline()

    def check_configuration(self, _, folder, arguments):
        """scripts/test_without_ros runs it, with these settings."""
        self.assertTrue(os.path.isfile(os.path.join(REPOSITORY, folder, "CMakeLists.txt")), folder)
        script = NameTest.text_of_script("test_without_ros")
        for setting in re.findall(r"-D\w+=", arguments):
            self.assertIn(setting, script)

    def check_camera(self, _, arguments):
        """Its parameters; LiveCommandTest starts it."""
        table = run("synthetic_world", "--print-parameters").stdout
        for argument in shlex.split(arguments):
            self.assertIn("| `{}` |".format(argument.partition(":=")[0].lstrip("_")), table)

    def clone(self, placeholder, *folders):
        if shutil.which("git") is None:
            self.skipTest("no git")
        result = shell(f"git init -q {placeholder} && git clone -q {placeholder} {folders[0]} && "
                       f"cd {folders[1]}", self.folder)
        self.assertEqual(result.returncode, 0, result.stderr)


class LiveCommandTest(RosTest):
    """Commands for a running odometry, on the built-in camera, both started as documents say."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.folder = tempfile.mkdtemp(prefix="point_line_documents_")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.host.environment["ROS_HOME"] = cls.folder
        camera, = (command for command in commands("doc/synthetic_world.md")
                   if "synthetic_stereo" in command)
        launch, = (command for command in commands("README.md")
                   if command.startswith("roslaunch point_line_odometry stereo_odometry.launch"))
        camera += " _frame_rate_hz:=5"  # for slow computers
        for name, command in (("launch", launch), ("camera", camera)):
            process = cls.host.start(["bash", "-c", "exec " + re.sub(r"^(\w+=\w+) ", r"env \1 ",
                                                                    command)], name)
            cls.addClassCleanup(cls.host.end, process)
        cls.messages = []
        cls.subscriber = rospy.Subscriber("/stereo/odom", Odometry, cls.messages.append)
        cls.addClassCleanup(cls.subscriber.unregister)

    def wait_for_odometry(self):
        count = len(self.messages)
        self.assertTrue(wait_until(lambda: len(self.messages) >= count + 3),
                        self.host.log("launch")[-3000:] + self.host.log("camera")[-1000:])

    def test_commands(self):
        self.wait_for_odometry()
        checks = {"rosservice": self.call_service, "dynamic_reconfigure": self.set_parameter,
                  "tf2_ros": self.publish_mounting, "offline_odometry": self.replay,
                  "doctor": self.run_doctor, "check_calibration": self.check_calibration}
        done = set()
        for name in DOCUMENTS:
            for command in filter(is_live, commands(name)):
                with self.subTest(document=name, command=command):
                    kind, = (kind for kind in checks if kind in command.split())
                    checks[kind](command)
                    done.add(kind)
        self.assertEqual(done, set(checks))
        self.wait_for_odometry()

    def execute(self, command, codes=(0,)):
        result = shell(command, self.folder, self.host.environment)
        self.assertIn(result.returncode, codes, result.stdout + result.stderr)
        return result.stdout

    def call_service(self, command):
        answer = yaml.safe_load(self.execute(command))
        self.assertTrue(answer["success"], answer)
        if "files" in answer:
            self.recording, = (file for file in answer["files"] if file.endswith(".yaml"))

    def set_parameter(self, command):
        *_, node, name, value = command.split()
        self.execute(command)
        self.assertEqual(rospy.get_param(node + "/" + name), yaml.safe_load(value))

    def publish_mounting(self, command):
        *_, base, camera = command.split()
        x = float(command.split()[3])
        found = []
        subscriber = rospy.Subscriber("/tf_static", TFMessage, lambda message: found.extend(
            (t.header.frame_id, t.child_frame_id, t.transform.translation.x)
            for t in message.transforms))
        self.addCleanup(subscriber.unregister)
        self.addCleanup(self.host.end, self.host.start(["bash", "-c", "exec " + command], "tf"))
        self.assertTrue(wait_until(lambda: (base, camera, x) in found), found)

    def run_doctor(self, command):
        self.assertEqual(list(parse(self.execute(command, (0, 1)))), SUBJECTS)

    def check_calibration(self, command):
        self.assertIn("the calibration agrees with the images", self.execute(command))

    def replay(self, command):
        """Of what dump_recording has written, in place of the recording that is named."""
        named = command[command.index(RECORDING):].split()[0]
        self.assertEqual(os.path.dirname(named).replace("~/.ros", self.folder),
                         os.path.dirname(self.recording))
        command = command.replace(named, self.recording).replace(
            ROSRUN + "offline_odometry", find_program("offline_odometry"))
        self.assertIn("recording", self.execute(command))


if __name__ == "__main__":
    unittest.main()
