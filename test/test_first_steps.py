#!/usr/bin/env python3
"""What a new user does with the documents at hand: programs by rosrun from a fresh shell, launch files
with another configuration, the node by itself, and the names that documents and examples promise."""

import os
import re
import shutil
import subprocess
import tempfile
import unittest

import rosgraph
import rospy
import yaml
from nav_msgs.msg import Odometry

from document_fixture import blocks, read_document
from ros_fixture import REPOSITORY, RosTest
from tool_fixture import find_program, make_kitti, run, wait_until, write

PACKAGE = "point_line_odometry"
TOOLS = ("offline_odometry", "dataset_to_bag", "doctor", "synthetic_world", "benchmark",
         "evaluate_trajectory", "report_run")
BASE = {name: os.environ[name] for name in ("HOME", "PATH") if name in os.environ}


def shell(script, environment):
    return subprocess.run(["bash", "-c", script], env=environment, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True,
                          timeout=60)


class WorkspaceTest(unittest.TestCase):
    def setUp(self):
        self.root = tempfile.mkdtemp(prefix="point_line_workspace_")
        self.addCleanup(shutil.rmtree, self.root)

    def path(self, *names):
        return os.path.join(self.root, *names)

    def test_rosrun_from_a_fresh_shell(self):
        setup = os.path.join(os.path.dirname(find_program("offline_odometry")), "..", "..",
                             "setup.bash")
        for tool in TOOLS:
            with self.subTest(tool=tool):
                result = shell(f"source '{setup}' && rosrun {PACKAGE} {tool} --help", BASE)
                self.assertEqual((result.returncode, result.stderr), (0, ""))
                self.assertIn("usage: ", result.stdout.lower())

    def link_package(self, name):
        """What scripts/build makes of the repository `name` in its workspace."""
        script = (f"source '{REPOSITORY}/scripts/_common.sh'; repository='{self.path(name)}'; "
                  "workspace=$repository/.workspace; link_package")
        result = shell("set -euo pipefail; " + script, BASE)
        self.assertEqual((result.returncode, result.stdout, result.stderr), (0, "", ""))
        folder = self.path(name, ".workspace", "src", PACKAGE)
        return {entry: os.path.realpath(os.path.join(folder, entry))
                for entry in os.listdir(folder)}

    def script_workspace(self, repository):
        """Where the scripts of a repository build."""
        result = shell(f"source '{REPOSITORY}/scripts/_common.sh'; repository='{repository}'; "
                       "script_workspace", BASE)
        self.assertEqual((result.returncode, result.stderr), (0, ""))
        return result.stdout.strip()

    def test_scripts_build_outside_of_a_package_in_a_workspace(self):
        """rosrun would find what is in the package's folder, too."""
        repository = self.path("src", "group", "repo")
        os.makedirs(repository)
        self.assertEqual(self.script_workspace(repository), os.path.join(repository, ".workspace"))
        for mark in (".catkin_workspace", ".catkin_tools", os.path.join("src", "CMakeLists.txt")):
            write(self.path(mark), "find_package(catkin)")
            self.assertEqual(self.script_workspace(repository), self.path("." + PACKAGE), mark)
            os.remove(self.path(mark))

    def test_package_of_the_workspace_does_not_hold_the_workspace(self):
        os.makedirs(self.path("repo", "src"))
        os.makedirs(self.path("repo", ".workspace", "src"))
        for name in ("CMakeLists.txt", "package.xml", "src/a.cpp"):
            write(self.path("repo", name), name)
        # The link that earlier versions made.
        os.symlink(self.path("repo"), self.path("repo", ".workspace", "src", PACKAGE))
        links = self.link_package("repo")
        self.assertEqual(set(links), {"CMakeLists.txt", "package.xml", "src"})
        self.assertEqual(links["src"], os.path.realpath(self.path("repo", "src")))
        found = subprocess.run(["find", "-L", self.path("repo", ".workspace", "src"), "-type", "f"],
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=True,
                               universal_newlines=True).stdout
        self.assertEqual(len(found.splitlines()), 3, found)

        # Again, with files that were added, changed and removed, and in another folder.
        package_xml = self.path("repo", ".workspace", "src", PACKAGE, "package.xml")
        before = os.stat(package_xml).st_mtime_ns
        self.link_package("repo")
        self.assertEqual(os.stat(package_xml).st_mtime_ns, before, "it would be configured again")
        os.remove(self.path("repo", "CMakeLists.txt"))
        write(self.path("repo", "package.xml"), "changed")
        os.mkdir(self.path("repo", "launch"))
        os.rename(self.path("repo"), self.path("moved"))
        links = self.link_package("moved")
        self.assertEqual({name for name in links if name != "package.xml"}, {"src", "launch"})
        self.assertEqual(links["src"], os.path.realpath(self.path("moved", "src")))
        with open(links["package.xml"], encoding="utf-8") as file:
            self.assertEqual(file.read(), "changed")


class LaunchFileTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="point_line_launch_")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def parameters(self, name, *arguments):
        """What the launch file sets, without starting anything."""
        result = subprocess.run(["roslaunch", "--dump-params", PACKAGE, name, "bag:=some.bag",
                                 *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                universal_newlines=True, timeout=60)
        self.assertEqual(result.returncode, 0, result.stderr)
        prefix = "/stereo/stereo_odometry/"
        return {key[len(prefix):]: value for key, value in yaml.safe_load(result.stdout).items()
                if key.startswith(prefix)}

    def configuration(self, name):
        """The parameters of a file in config/, by their whole names."""
        def flatten(node, path):
            for key, value in node.items():
                if isinstance(value, dict):
                    yield from flatten(value, path + key + "/")
                else:
                    yield path + key, value
        with open(os.path.join(REPOSITORY, "config", name), encoding="utf-8") as file:
            return dict(flatten(yaml.safe_load(file), ""))

    def test_data_sets_take_another_configuration(self):
        paper = os.path.join(REPOSITORY, "config", "paper.yaml")
        for dataset, raw in (("kitti", {}), ("euroc", {"rectify": True})):
            with self.subTest(dataset=dataset):
                launch = dataset + ".launch"
                self.assertEqual(self.parameters(launch), self.configuration(dataset + ".yaml"))
                self.assertEqual(self.parameters(launch, "config:=" + paper),
                                 {**self.configuration("paper.yaml"), **raw})

    def test_cameras_leave_the_parameters_of_a_file_and_take_all_arguments(self):
        own = os.path.join(self.folder, "own.yaml")
        write(own, "publish_tf: false\nodom_frame_id: visual_odom\n")
        launch = ("camera.launch", "camera:=zed", "config:=" + own)
        self.assertEqual(self.parameters(*launch),
                         {"publish_tf": False, "odom_frame_id": "visual_odom", "rectify": False,
                          "approximate_sync": False, "base_frame_id": "base_link"})
        given = self.parameters(*launch, "base_frame_id:=zed_base", "imu:=true", "planar:=true")
        self.assertEqual(given["base_frame_id"], "zed_base")
        self.assertTrue(given["imu/enabled"] and given["planar/enabled"], given)
        result = subprocess.run(
            ["roslaunch", "--args", "/stereo/stereo_odometry", PACKAGE, *launch,
             "driver_ns:=/front", "imu_topic:=/front/imu"],
            stdout=subprocess.PIPE, universal_newlines=True, timeout=60, check=True)
        for remapping in ("left/image_rect:=/front/left/image_rect_gray", "imu:=/front/imu",
                          "right/camera_info:=/front/right/camera_info"):
            self.assertIn(f" {remapping} ", result.stdout)

    def test_arguments_of_another_place(self):
        command = ["roslaunch", "--args", "/rviz", PACKAGE, "replay.launch", "bag:=some.bag"]
        for extra, words in (([], ["/stereo/lines:=stereo/lines"]),
                             (["ns:=front", "odom_frame_id:=world"],
                              ["/stereo/lines:=front/lines", "-f world"])):
            result = subprocess.run(command + extra, stdout=subprocess.PIPE,
                                    universal_newlines=True, timeout=60, check=True)
            for word in words:
                self.assertIn(f" {word} ", result.stdout)
        self.assertNotIn("-f", subprocess.run(command, stdout=subprocess.PIPE, check=True,
                                              universal_newlines=True).stdout.split())
        self.assertFalse(self.parameters("euroc.launch", "rectify:=false")["rectify"])

    # Arguments of stereo_odometry.launch: a value, and the parameter that it sets.
    PARAMETERS = {
        "rectify": (True, "rectify"), "approximate_sync": (True, "approximate_sync"),
        "approximate_sync_max_interval_s": (0.02, "approximate_sync_max_interval_s"),
        "image_transport": ("compressed", "image_transport"), "odom_frame_id": ("vo", "odom_frame_id"),
        "base_frame_id": ("robot", "base_frame_id"), "publish_tf": (False, "publish_tf"),
        "imu": (True, "imu/enabled"), "guess_frame_id": ("wheels", "guess_frame_id"),
        "planar": (True, "planar/enabled"), "on_time_jump": ("keep_pose", "on_time_jump"),
        "left_mask": ("/l.png", "left/mask"), "right_mask": ("/r.png", "right/mask"),
        "mask_images": ("left", "mask_images")}
    # Those that are names, and the remappings that they make; the values of left and right are parts of others.
    NAMES = {
        "left": ("front_left", "left/mask_image:=front_left/mask_image"),
        "right": ("front_right", "right/mask_image:=front_right/mask_image"),
        "left_image": ("/l/image", "left/image_raw:=/l/image"),
        "left_info": ("/l/info", "left/camera_info:=/l/info"),
        "right_image": ("/r/image", "right/image_rect:=/r/image"),
        "right_info": ("/r/info", "right/camera_info:=/r/info"),
        "imu_topic": ("/front/imu", "imu:=/front/imu"),
        "prior_odom": ("/wheels/odom", "prior_odom:=/wheels/odom")}

    def test_all_arguments_reach_the_node(self):
        text = read_document("launch/stereo_odometry.launch")
        declared = set(re.findall(r'<arg name="(\w+)" default=', text))
        self.assertEqual(declared, {*self.PARAMETERS, *self.NAMES, "ns", "manager", "config"})
        values = {name: str(value).lower() if isinstance(value, bool) else value
                  for name, (value, _) in {**self.PARAMETERS, **self.NAMES}.items()}
        arguments = [f"{name}:={value}" for name, value in values.items()]
        given = self.parameters("stereo_odometry.launch", *arguments)
        for value, parameter in self.PARAMETERS.values():
            self.assertEqual(given[parameter], value, parameter)
        self.assertTrue(given["wheels/enabled"])
        result = subprocess.run(["roslaunch", "--args", "/stereo/stereo_odometry", PACKAGE,
                                 "stereo_odometry.launch", *arguments], check=True,
                                stdout=subprocess.PIPE, universal_newlines=True, timeout=60)
        for _, remapping in self.NAMES.values():
            self.assertIn(f" {remapping} ", result.stdout.replace("\n", " "))

    def test_one_of_two_filters_has_the_wheels(self):
        def dump(*arguments):
            return subprocess.run(["roslaunch", "--dump-params", PACKAGE,
                                   "robot_localization.launch", *arguments],
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                  universal_newlines=True, timeout=60)
        for wheels, of_prior in (("prior", True), ("filter", False)):
            given = yaml.safe_load(dump("wheels:=" + wheels, "ns:=front").stdout)
            self.assertEqual(given["/ekf/odom0"], "front/odom", "in the namespace of the filter")
            self.assertEqual("/ekf/odom1" in given, not of_prior)
            self.assertEqual(given.get("/front/stereo_odometry/wheels/enabled", False), of_prior)
            self.assertFalse(given["/front/stereo_odometry/publish_tf"])
        refused = dump("wheels:=both")  # roslaunch 1.15 ends with 0 nevertheless
        self.assertEqual(refused.stdout, "")
        self.assertIn("'both'", refused.stderr)


class RunningNodeTest(RosTest):
    """With a roscore of its own."""

    def launch(self, *arguments):
        process = self.host.start(["roslaunch", PACKAGE, "stereo_odometry.launch", *arguments],
                                  "launch")
        self.addCleanup(self.host.end, process)

    def first_message(self, topic):
        """The first odometry there, while a camera publishes in /stereo."""
        messages = []
        subscriber = rospy.Subscriber(topic, Odometry, messages.append)
        self.addCleanup(subscriber.unregister)
        self.assertTrue(wait_until(lambda: messages), f"nothing comes on {topic}; "
                        + self.host.log("launch")[-3000:])
        return messages[0]

    def test_example_for_robot_localization(self):
        path = os.path.join(REPOSITORY, "config", "examples", "robot_localization.yaml")
        with open(path, encoding="utf-8") as file:
            example = yaml.safe_load(file)
        self.launch("publish_tf:=false")
        self.start_camera("/stereo")
        message = self.first_message(example["odom0"])
        self.assertEqual(message.header.frame_id, example["odom_frame"])
        self.assertEqual(message.child_frame_id, example["base_link_frame"])
        self.assertIn(example["world_frame"], (example["odom_frame"], example.get("map_frame")))
        self.assertEqual(len(example["odom0_config"]), 15)

    def test_names_in_the_documents(self):
        self.launch("imu:=true", "mask_images:=both", "prior_odom:=prior_odom")
        self.start_camera("/stereo")
        self.first_message("/stereo/odom")
        master = rosgraph.Master("/test")
        published, subscribed, services = master.getSystemState()
        has = {"pub": {name for name, _ in published}, "sub": {name for name, _ in subscribed},
               "srv": {name for name, _ in services}}
        types = dict(master.getTopicTypes())
        rows = re.findall(r"^\| (pub|sub|srv) \| (.*?) \| (.*?) \|",
                          read_document("doc/interface.md"), re.MULTILINE)
        self.assertGreater(len(rows), 15)
        short = re.findall(r"^\| (in|out) \| (.*?) \|", read_document("README.md"), re.MULTILINE)
        self.assertGreater(len(short), 5)
        rows += [({"in": "sub", "out": "pub"}[kind], names, "") for kind, names in short]
        for kind, names, type_name in rows:
            names = re.findall("`(.*?)`", names)
            first = names[0].rpartition("/")[0]
            for name in names:
                # `stereo_odometry/reset`, `pause`: the folder is that of the first one.
                name = name if "/" in name or not first or kind == "sub" else f"{first}/{name}"
                name = name if name.startswith("/") else "/stereo/" + name
                self.assertIn(name, has[kind])
                if kind != "srv" and "/" in type_name:
                    self.assertEqual(types[name], type_name, name)

    def test_node_by_rosrun_as_in_the_documents(self):
        # The lines of the block, with a bag that is played meanwhile.
        block, = (block for block in blocks("doc/interface.md", "bash")
                  if "rosrun point_line_odometry stereo_odometry" in block)
        *before, start = block.splitlines()
        folder = tempfile.mkdtemp(prefix="point_line_first_steps_")
        self.addCleanup(shutil.rmtree, folder)
        make_kitti(os.path.join(folder, "kitti"))
        bag = os.path.join(folder, "kitti.bag")
        self.assertEqual(run("dataset_to_bag", os.path.join(folder, "kitti"), bag).returncode, 0)
        self.addCleanup(rospy.delete_param, "/use_sim_time")
        self.addCleanup(rospy.delete_param, "/stereo/stereo_odometry")
        for line in before:
            result = shell(line, self.host.environment)
            self.assertEqual((result.returncode, result.stderr), (0, ""), line)
        self.assertTrue(rospy.get_param("/use_sim_time"))
        node = self.host.start(["bash", "-c", start], "launch")
        self.addCleanup(self.host.end, node)
        player = self.host.start(["rosbag", "play", "--clock", "--quiet", "--delay=3",
                                  bag], "player")
        self.addCleanup(self.host.end, player)
        self.assertEqual(self.first_message("/stereo/odom").header.frame_id, "odom")


if __name__ == "__main__":
    unittest.main()
