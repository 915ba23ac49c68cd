"""Shared by the tests with a real roscore: programs that run with it, nodelet managers, a camera."""

import os
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time
import unittest

import numpy as np
import rospy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from nodelet.srv import NodeletLoad, NodeletUnload
from point_line_odometry.msg import OdometryInfo
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from tool_fixture import START_UP_S, wait_until

REPOSITORY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Host:
    """Programs of one computer: their output is kept in `folder`, and all end with close().

    `prefix` is put before every command, for example to run it in another network namespace.
    """

    def __init__(self, folder, master, address="127.0.0.1", prefix=()):
        self.folder = folder
        self.prefix = list(prefix)
        self.environment = dict(os.environ, ROS_MASTER_URI=master, ROS_IP=address,
                                ROS_LOG_DIR=os.path.join(folder, "log"))
        self.environment.pop("ROS_HOSTNAME", None)
        self.processes = []

    def start(self, command, name, environment=None):
        with open(self.log_file(name), "w") as log:
            process = subprocess.Popen(self.prefix + command,
                                       env=dict(self.environment, **(environment or {})), stdout=log,
                                       stderr=subprocess.STDOUT, start_new_session=True)
        self.processes.append(process)
        return process

    def log_file(self, name):
        return os.path.join(self.folder, name + ".log")

    def log(self, name):
        with open(self.log_file(name), errors="replace") as log:
            return log.read()

    def start_roscore(self):
        port = self.environment["ROS_MASTER_URI"].rpartition(":")[2]
        self.start(["roscore", "-p", port], "roscore")
        if not wait_until(self.has_master):
            raise RuntimeError("roscore did not come up: " + self.log("roscore"))

    def has_master(self):
        command = self.prefix + ["rosparam", "get", "/run_id"]
        return subprocess.run(command, env=self.environment, stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL).returncode == 0

    @staticmethod
    def end(process, timeout_s=30):
        """Ctrl-C for the process and its children. Returns the exit code."""
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(timeout=timeout_s)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        return process.returncode

    @classmethod
    def end_recording(cls, recorder, bag):
        """Ctrl-C for `rosbag record`. The recording process renames the bag after that script has ended."""
        cls.end(recorder)
        if not wait_until(lambda: os.path.exists(bag)):
            raise RuntimeError(f"rosbag record leaves no {bag}")

    def close(self):
        for process in reversed(self.processes):
            self.end(process)


def local_host(folder):
    """A host with a port of its own for the roscore, which still has to be started."""
    return Host(folder, f"http://127.0.0.1:{free_port()}")


class Manager:
    """A nodelet manager as a process."""

    def __init__(self, host, name="manager", environment=None):
        self.name = name
        self.host = host
        self.process = host.start(["rosrun", "nodelet", "nodelet", "manager", f"__name:={name}"],
                                  name, environment)
        rospy.wait_for_service(f"/{name}/load_nodelet", timeout=START_UP_S)

    def load(self, name, kind, parameters=None, remappings=None):
        """Loads a nodelet, with its parameters instead of all that were set before. All names are
        absolute, with a leading slash."""
        if rospy.has_param(name):
            rospy.delete_param(name)
        for key, value in (parameters or {}).items():
            rospy.set_param(f"{name}/{key}", value)
        sources, targets = list((remappings or {}).keys()), list((remappings or {}).values())
        try:
            answer = rospy.ServiceProxy(f"/{self.name}/load_nodelet", NodeletLoad)(
                name, kind, sources, targets, [], "")
        except rospy.ServiceException:  # older nodelets answer so if they cannot
            answer = None
        if answer is None or not answer.success:
            raise RuntimeError(f"{kind} was not loaded: {self.log()[-3000:]}")

    def load_odometry(self, name, parameters=None, remappings=None):
        self.load(name, "point_line_odometry/StereoOdometry", parameters, remappings)

    def unload(self, name):
        """Returns the time that it took [s]."""
        begin = time.monotonic()
        answer = rospy.ServiceProxy(f"/{self.name}/unload_nodelet", NodeletUnload)(name)
        if not answer.success:
            raise RuntimeError(f"{name} was not unloaded: {self.log()[-3000:]}")
        return time.monotonic() - begin

    def log(self):
        return self.host.log(self.name)

    def usage(self):
        """Resident memory [kB], threads and open files of the process."""
        folder = f"/proc/{self.process.pid}"
        with open(folder + "/status") as status:
            rows = dict(row.split(":", 1) for row in status)
        return {"rss_kb": int(rows["VmRSS"].split()[0]), "threads": int(rows["Threads"]),
                "files": len(os.listdir(folder + "/fd"))}

    def end(self):
        return self.host.end(self.process)


class WallCamera:
    """A rectified stereo camera that moves to the right along a wall of random tiles with random
    spots, and has small images: points and lines."""

    WIDTH, HEIGHT = 320, 160
    FOCAL_PX, BASELINE_M, DEPTH_M = 200.0, 0.4, 8.0
    PIXELS_PER_STEP = 3
    STEP_M = PIXELS_PER_STEP * DEPTH_M / FOCAL_PX
    PERIOD_S = 0.1
    FRAME = "left_camera"

    def __init__(self):
        random = np.random.RandomState(5)
        tile_px = 20
        tiles = np.kron(random.randint(60, 196, (self.HEIGHT // tile_px, 800 // tile_px)),
                        np.ones((tile_px, tile_px)))
        noise = random.normal(0.0, 30.0, tiles.shape)
        spots = sum(np.roll(noise, (dy, dx), (0, 1)) for dy in (-1, 0, 1) for dx in (-1, 0, 1)) / 3.0
        self.wall = np.clip(tiles + spots, 0, 255).astype(np.uint8)

    def messages(self, step, stamp):
        """(name within the camera's namespace, message) of the stereo pair at step * STEP_M."""
        disparity = round(self.FOCAL_PX * self.BASELINE_M / self.DEPTH_M)
        for side, offset, baseline in (("left", 0, 0.0), ("right", disparity, self.BASELINE_M)):
            begin = 150 + self.PIXELS_PER_STEP * step + offset
            image = Image(height=self.HEIGHT, width=self.WIDTH, encoding="mono8", step=self.WIDTH)
            image.data = self.wall[:, begin:begin + self.WIDTH].tobytes()
            info = CameraInfo(height=self.HEIGHT, width=self.WIDTH)
            info.P = [self.FOCAL_PX, 0, self.WIDTH / 2, -self.FOCAL_PX * baseline,
                      0, self.FOCAL_PX, self.HEIGHT / 2, 0, 0, 0, 1, 0]
            for message in (image, info):
                message.header.stamp = stamp
                message.header.frame_id = self.FRAME
            yield f"{side}/image_rect", image
            yield f"{side}/camera_info", info

    @classmethod
    def mounting(cls):
        """tf of the camera, which looks along the x axis of the robot."""
        transform = TransformStamped()
        transform.header.frame_id, transform.child_frame_id = "base_link", cls.FRAME
        q = transform.transform.rotation
        q.x, q.y, q.z, q.w = -0.5, 0.5, -0.5, 0.5
        return TFMessage([transform])

    @staticmethod
    def to_and_fro(frame):
        """Steps 0 ... 30 and back again, for ever."""
        return 30 - abs(frame % 60 - 30)


class LiveCamera:
    """A WallCamera that publishes in real time from a thread until stop()."""

    def __init__(self, namespace, rate_hz=20.0, step_of=WallCamera.to_and_fro):
        self.camera = WallCamera()
        self.step_of = step_of
        self.rate_hz = rate_hz
        self.publishers = {}
        for side in ("left", "right"):
            for name, kind in (("image_rect", Image), ("camera_info", CameraInfo)):
                topic = f"{side}/{name}"
                self.publishers[topic] = rospy.Publisher(f"{namespace}/{topic}", kind,
                                                         queue_size=10)
        self.mounting = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        self.mounting.publish(WallCamera.mounting())
        self.running = True
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        for frame in range(10 ** 9):
            if not self.running:
                return
            stamp = rospy.Time.from_sec(time.time())
            for topic, message in self.camera.messages(self.step_of(frame), stamp):
                self.publishers[topic].publish(message)
            time.sleep(1.0 / self.rate_hz)

    def stop(self):
        self.running = False
        self.thread.join()
        for publisher in self.publishers.values():
            publisher.unregister()
        self.mounting.unregister()


class Listener:
    """Keeps what an odometry publishes on odom and info."""

    def __init__(self, namespace):
        self.odometry, self.infos = [], []
        self.subscribers = [
            rospy.Subscriber(namespace + "/odom", Odometry, self.odometry.append),
            rospy.Subscriber(namespace + "/info", OdometryInfo, self.infos.append)]

    def wait_for_connection(self):
        """Waits until each topic has a publisher."""
        if not wait_until(lambda: all(subscriber.get_num_connections() == 1
                                      for subscriber in self.subscribers)):
            raise RuntimeError("the listener has no publisher")

    def wait_for(self, count, timeout_s=START_UP_S):
        """True once `count` more odometry messages have come."""
        goal = len(self.odometry) + count
        return wait_until(lambda: len(self.odometry) >= goal, timeout_s)

    def quiet(self, quiet_s=1.0):
        """Returns when no message has come for a while."""
        count = -1
        while count != len(self.infos):
            count = len(self.infos)
            time.sleep(quiet_s)

    def clear(self):
        del self.odometry[:], self.infos[:]

    def poses(self):
        """Rows of stamp [ns], position and quaternion."""
        rows = []
        for message in self.odometry:
            p, q = message.pose.pose.position, message.pose.pose.orientation
            rows.append((message.header.stamp.to_nsec(), p.x, p.y, p.z, q.x, q.y, q.z, q.w))
        return rows

    def close(self):
        while self.subscribers:
            self.subscribers.pop().unregister()


def call_trigger(service):
    answer = rospy.ServiceProxy(service, Trigger)()
    if not answer.success:
        raise RuntimeError(f"{service}: {answer.message}")


class RosTest(unittest.TestCase):
    """Tests that share a roscore, of which this process is a node."""

    EXTRA_PACKAGES = ()  # folders that go on the ROS_PACKAGE_PATH

    @classmethod
    def setUpClass(cls):
        folder = tempfile.mkdtemp(prefix="point_line_ros_")
        cls.addClassCleanup(shutil.rmtree, folder, ignore_errors=True)
        os.environ["ROS_PACKAGE_PATH"] = ":".join(
            [*cls.EXTRA_PACKAGES, os.environ.get("ROS_PACKAGE_PATH", "")])
        cls.host = local_host(folder)
        cls.addClassCleanup(cls.host.close)
        cls.host.start_roscore()
        os.environ.update(cls.host.environment)
        os.environ.pop("ROS_HOSTNAME", None)
        rospy.init_node("test", disable_signals=True)

    def start_manager(self, name="manager", environment=None):
        manager = Manager(self.host, name, environment)
        self.addCleanup(manager.end)
        return manager

    def start_manager_in_simulated_time(self):
        rospy.set_param("/use_sim_time", True)
        self.addCleanup(rospy.delete_param, "/use_sim_time")
        return self.start_manager()

    def listen(self, namespace):
        listener = Listener(namespace)
        self.addCleanup(listener.close)
        return listener

    def start_camera(self, namespace, **options):
        camera = LiveCamera(namespace, **options)
        self.addCleanup(camera.stop)
        return camera
