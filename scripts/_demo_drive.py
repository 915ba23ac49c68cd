"""Drives through a synthetic world in a roscore of its own and records the results of the odometry.

No message is lost: the camera begins when the recorder has subscribed to all topics, and sends a
frame when the recorder has all messages of the one before.
"""
import os
import re
import signal
import socket
import subprocess
import threading
import time
from collections import defaultdict
from contextlib import ExitStack, contextmanager
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Set

import rosbag
import rosgraph
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image

from _demo_report import IMAGE, INFO, ODOMETRY, TRUTH, SceneError
from point_line_odometry.msg import OdometryInfo

ANSWER = '/demo_recorder/recorded'
START_S = 60.0    # for roscore
STALL_S = 60.0    # longest time between frames
END_S = 30.0      # roslaunch gives its nodes 17 s
POLL_S = 0.1
FASTEST = 100.0   # as fast as the computer can

# Debian 11's rospy calls this method at its end, which Debian 11's Python does not have any more.
if not hasattr(threading.Thread, 'isAlive'):
    setattr(threading.Thread, 'isAlive', threading.Thread.is_alive)


class Drive(NamedTuple):
    """A drive through a scene; frames 0: until rviz is closed. Without a seed the world's own."""
    scene: str
    seed: Optional[int]
    frames: int
    rviz: bool


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ignores signals while something is being ended."""
    numbers = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
    handlers = {number: signal.signal(number, signal.SIG_IGN) for number in numbers}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def start(command: List[str], log_path: str) -> Any:
    """Starts a program in a session of its own; it ends if this process dies."""
    with open(log_path, 'w', encoding='utf-8') as log:
        return subprocess.Popen(['setpriv', '--pdeathsig', 'INT', *command],
                                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                                start_new_session=True)


def stop(process: Any) -> None:
    """Ends a roslaunch or roscore, and waits until all that it has started has ended."""
    with uninterrupted():
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def free_port() -> int:
    """A port that nobody listens to."""
    with socket.socket() as probe:
        probe.bind(('', 0))
        return probe.getsockname()[1]


def launch_command(drive: Drive) -> List[str]:
    """The roslaunch of camera, odometry and rviz, with the camera waiting for the recorder."""
    arguments = {'scene': drive.scene, 'frames': drive.frames,
                 'exit_when_done': str(drive.frames > 0).lower(), 'rviz': str(drive.rviz).lower(),
                 'rate': 1.0 if drive.rviz else FASTEST, 'delay': 0.0, 'lockstep_topic': ANSWER}
    if drive.seed is not None:
        arguments['seed'] = drive.seed
    return (['roslaunch', 'point_line_odometry', 'demo.launch']
            + [f'{name}:={value}' for name, value in arguments.items()])


class Recorder:
    """Writes the messages of every frame into a bag, and one image of features: that with many points
    and line segments."""

    TYPES = {ODOMETRY: Odometry, TRUTH: Odometry, INFO: OdometryInfo}

    def __init__(self, path: str) -> None:
        self.num_frames = 0
        self._lock = threading.Lock()
        self._bag: Optional[rosbag.Bag] = rosbag.Bag(path, 'w')
        self._arrived: Dict[Any, Set[str]] = defaultdict(set)
        self._richness: Dict[Any, int] = {}  # by stamp, of the latest frame
        self._image: Optional[Image] = None
        self._best_richness = -1
        self._answers: Optional[rospy.Publisher] = None
        self._subscribers = [rospy.Subscriber(topic, kind, self._take, callback_args=topic)
                             for topic, kind in self.TYPES.items()]
        self._subscribers.append(rospy.Subscriber(IMAGE, Image, self._take_image, queue_size=1,
                                                  buff_size=1 << 24))

    def begin_when_ready(self) -> None:
        """Lets the camera begin once every topic is connected; it waits for this publisher."""
        if self._answers is None and all(each.get_num_connections() for each in self._subscribers):
            self._answers = rospy.Publisher(ANSWER, Odometry, queue_size=10)

    def close(self) -> None:
        """Completes the bag."""
        for each in self._subscribers:
            each.unregister()
        if self._answers is not None:
            self._answers.unregister()
        with self._lock:
            bag, self._bag = self._bag, None
        if bag is not None:
            if self._image is not None:
                bag.write(IMAGE, self._image, self._image.header.stamp)
            bag.close()

    def _take(self, message: Any, topic: str) -> None:
        stamp = message.header.stamp
        with self._lock:
            if self._bag is None:
                return
            self._bag.write(topic, message, stamp)
            if topic == INFO:
                self._richness = {stamp: message.point_inliers * message.line_inliers}
            self._arrived[stamp].add(topic)
            if len(self._arrived[stamp]) < len(self.TYPES):
                return
            del self._arrived[stamp]
            self.num_frames += 1
        if self._answers is not None:
            self._answers.publish(Odometry(header=message.header))

    def _take_image(self, message: Image) -> None:
        with self._lock:
            richness = self._richness.get(message.header.stamp, 0)
            if richness > self._best_richness:
                self._image, self._best_richness = message, richness


class Graph:
    """A roscore of its own on a free port, with the recorder's node; a context manager.

    `folder` takes the bags and logs.
    """

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._cleanup = ExitStack()

    def __enter__(self) -> 'Graph':
        port = free_port()
        os.environ['ROS_MASTER_URI'] = f'http://localhost:{port}'
        os.environ['ROS_LOG_DIR'] = os.path.join(self._folder, 'ros')
        with self._cleanup:
            roscore = start(['roscore', '-p', str(port)], self._log_path('roscore'))
            self._cleanup.callback(stop, roscore)
            self._wait_for_master(roscore)
            rospy.init_node('demo_recorder', anonymous=True, log_level=rospy.FATAL,
                            disable_rostime=True, disable_rosout=True, disable_signals=True)
            self._cleanup.callback(rospy.signal_shutdown, 'the demo ends')
            self._cleanup = self._cleanup.pop_all()
        return self

    def __exit__(self, *_: Any) -> None:
        self._cleanup.close()

    def bag(self, scene: str) -> str:
        """Path of the bag recorded in a scene."""
        return os.path.join(self._folder, scene + '.bag')

    def log(self, scene: str) -> str:
        """The log of the programs in a scene."""
        with open(self._log_path(scene), encoding='utf-8', errors='replace') as stream:
            return stream.read()

    def drive(self, drive: Drive, show: Callable[[str], None]) -> str:
        """Records a drive into its bag; returns a summary. `show` is called with the progress."""
        begin = time.monotonic()
        with ExitStack() as cleanup:
            recorder = Recorder(self.bag(drive.scene))
            cleanup.callback(recorder.close)
            launch = start(launch_command(drive), self._log_path(drive.scene))
            cleanup.callback(stop, launch)
            try:
                self._watch(launch, recorder, drive, show)
            except KeyboardInterrupt:
                if not drive.rviz:
                    raise
        return f'{recorder.num_frames} frames in {time.monotonic() - begin:.0f} s'

    def _watch(self, launch: Any, recorder: Recorder, drive: Drive,
               show: Callable[[str], None]) -> None:
        """Returns when all has ended by itself, or rviz has."""
        first = latest = time.monotonic()
        num_frames = 0
        while launch.poll() is None:
            time.sleep(POLL_S)
            recorder.begin_when_ready()
            now = time.monotonic()
            if recorder.num_frames != num_frames:
                first = first if num_frames else now
                latest, num_frames = now, recorder.num_frames
            if now - latest > STALL_S:
                raise SceneError(f'no frame came for {STALL_S:.0f} s after {num_frames} frames')
            if drive.rviz and re.search(r'\[rviz-\d+\] process has', self.log(drive.scene)):
                return
            show(describe(num_frames, drive.frames, latest - first))

    def _log_path(self, scene: str) -> str:
        return os.path.join(self._folder, scene + '.log')

    def _wait_for_master(self, roscore: Any) -> None:
        deadline = time.monotonic() + START_S
        while not rosgraph.is_master_online():
            if roscore.poll() is not None or time.monotonic() > deadline:
                raise SceneError('roscore does not start: see the output of "roscore -p 0"')
            time.sleep(POLL_S)


def describe(done: int, total: int, duration_s: float) -> str:
    """The progress of a drive as text."""
    if done == 0:
        return 'starting'
    speed = f', {done / duration_s:.1f} frames/s' if duration_s > 1.0 else ''
    if not total:
        return f'{done} frames{speed}; close rviz or press Ctrl-C to end the drive'
    width = 40
    bar = '#' * (width * done // total)
    return f'[{bar:<{width}}] {done}/{total} frames{speed}'
