#!/usr/bin/python3 -B
"""Runs the odometry on the synthetic camera's stream, with random faults between the two, and
checks that its process does not grow, odom does not jump and no number is NaN.
"""
import argparse
import os
import random
import re
import shutil
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from typing import Any, Dict, List, Optional, Tuple

import message_filters
import rosgraph
import rospy
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from _demo_drive import START_S, POLL_S, free_port, start, stop
from _soak_faults import Frame, Injector
from _soak_checks import Answer, JumpWatch, ProcessSample, Run, report
from point_line_odometry.msg import OdometryInfo, StereoFeatures
from point_line_odometry.srv import ResetToPose

EPILOG = """\
Faults: dropped frames and gaps, missing topics, stamps that differ, repeat, come late or jump, dark,
covered, blurred and frozen images, malformed messages, wrong and changing calibrations, bursts;
in addition, reset, reset_to_pose, pause and resume are called, and topics are subscribed to and
unsubscribed from.
The same seed draws the same faults.

Exit code: 0 all checks passed, 1 one failed, 2 the run was not possible.
"""
STATES = {getattr(OdometryInfo, name): name for name in ('INITIALIZING', 'OK', 'DEGRADED', 'LOST')}
SAMPLE_S = 1.0
QUIET_S = 6.0       # without faults at the end
TIMEOUT_S = 30.0    # without an answer: the odometry is stuck
CALLS = ('reset', 'reset_to_pose', 'pause', 'paths')
ODOMETRY = '/stereo/stereo_odometry'
MANAGER = '/stereo/manager'


class SoakError(Exception):
    """Why the run is not possible."""


def parse_arguments(arguments: Optional[List[str]]) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(prog='soak', description=__doc__, epilog=EPILOG,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('minutes', type=float, nargs='?', default=30.0)
    parser.add_argument('--seed', type=int, default=1, help='of the faults and the world (1)')
    parser.add_argument('--scene', default='corridor', choices=('corridor', 'indoor'))
    parser.add_argument('--rate', type=float, default=10.0, metavar='HZ',
                        help='frames of the camera per second (10)')
    parser.add_argument('--log', metavar='FILE', help='keep the log of the programs')
    parser.add_argument('--samples', metavar='FILE',
                        help='memory, files and threads at each second, as CSV')
    options = parser.parse_args(arguments)
    if not options.minutes > 0.0:
        parser.error('give a number of minutes above 0')
    return options


class Camera:
    """Relays the camera's messages to the odometry, with faults."""

    TOPICS = {'left/image_raw': Image, 'right/image_raw': Image,
              'left/camera_info': CameraInfo, 'right/camera_info': CameraInfo}

    def __init__(self, injector: Injector) -> None:
        self.quiet = False
        self._injector = injector
        self._publishers = [rospy.Publisher('/stereo/' + name, kind, queue_size=20)
                            for name, kind in self.TOPICS.items()]
        subscribers = [message_filters.Subscriber('/camera/' + name, kind, buff_size=1 << 24)
                       for name, kind in self.TOPICS.items()]
        self._synchronizer = message_filters.TimeSynchronizer(subscribers, 20)
        self._synchronizer.registerCallback(self._take)

    @property
    def fault(self) -> str:
        """Name of the current fault."""
        return self._injector.name

    def _take(self, *messages: Any) -> None:
        for frame in self._injector.apply(Frame(*messages), time.monotonic(), self.quiet):
            for publisher, message in zip(self._publishers, frame):
                if message is not None:
                    publisher.publish(message)


class Listener:
    """Subscribes to the odometry's results; its memory is bounded."""

    def __init__(self, camera: Camera) -> None:
        self.watch = JumpWatch()
        self.states: Dict[str, int] = {}
        self.changes = 0
        self.counters: Dict[str, int] = {}
        self.last_answer_s = time.monotonic()
        self.state = ''
        self._camera = camera
        self._lock = threading.Lock()
        self._announced = False
        self._waiting: Dict[Any, Dict[str, Any]] = {}
        self._last_fault = ''
        self._subscribers = [
            rospy.Subscriber('/stereo/odom', Odometry, self._take, 'odom', queue_size=100),
            rospy.Subscriber('/stereo/info', OdometryInfo, self._take, 'info', queue_size=100),
            rospy.Subscriber('/tf', TFMessage, self._take_tf, queue_size=100)]

    def announce(self) -> None:
        """To be called before the pose is set."""
        with self._lock:
            self._announced = True

    def _take(self, message: Any, name: str) -> None:
        with self._lock:
            self._last_fault = self._camera.fault or self._last_fault
            stamp = message.header.stamp.to_nsec()
            if name == 'info':
                self._count(message)
            pair = self._waiting.setdefault(stamp, {})
            pair[name] = message
            if len(pair) == 2:
                del self._waiting[stamp]
                self._check(pair['odom'], STATES[pair['info'].state])
            elif len(self._waiting) > 50:  # infos of frames that were refused
                del self._waiting[next(iter(self._waiting))]

    def _count(self, info: Any) -> None:
        for name in ('processed', 'dropped', 'rejected'):
            self.counters[name] = getattr(info, 'frames_' + name)
        self.counters['exceptions'] = info.exceptions

    def _check(self, odom: Any, state: str) -> None:
        self.last_answer_s = time.monotonic()
        self.states[state] = self.states.get(state, 0) + 1
        self.changes += state != self.state
        self.state = state
        # A reset takes effect with a frame that is the first one.
        announced = self._announced and state == 'INITIALIZING'
        if announced:
            self._announced = False
        self.watch.add(answer_of(odom, state), announced, self._last_fault)

    def _take_tf(self, message: Any) -> None:
        with self._lock:
            for each in message.transforms:
                numbers = numbers_of(each.transform.translation, each.transform.rotation)
                self.watch.num_not_finite += any(n != n or abs(n) == float('inf') for n in numbers)


def numbers_of(*parts: Any) -> List[float]:
    """The numbers of vectors and quaternions, in the order of their slots."""
    return [getattr(part, name) for part in parts for name in part.__slots__]


def answer_of(odom: Any, state: str) -> Answer:
    """The values of a message of odom that are checked."""
    sigma = [max(odom.twist.covariance[7 * i], 0.0) ** 0.5 for i in range(6)]
    if any(number != number for number in odom.pose.covariance):
        sigma[0] = float('nan')
    return Answer(odom.header.stamp.to_nsec() * 1e-9, numbers_of(odom.pose.pose.position),
                  numbers_of(odom.pose.pose.orientation),
                  numbers_of(odom.twist.twist.linear, odom.twist.twist.angular), sigma, state)


class Operator:
    """Calls services, and subscribes to topics for a while, at random."""

    LOOKED_AT = {'lines': MarkerArray, 'points': PointCloud2, 'features': StereoFeatures,
                 'features_image': Image, 'path': Path}

    def __init__(self, seed: int, listener: Listener) -> None:
        self.counts: Dict[str, int] = {}
        self._rng = random.Random(seed + 1)
        self._listener = listener
        self._next_s = time.monotonic() + 5.0
        self._then: Optional[Tuple[float, Any]] = None  # what ends the present action, and when

    def act(self, now_s: float, quiet: bool) -> None:
        """To be called often."""
        if self._then and (now_s > self._then[0] or quiet):
            self._then[1]()
            self._then = None
        if self._then or quiet or now_s < self._next_s:
            return
        self._next_s = now_s + self._rng.uniform(3.0, 12.0)
        name = self._rng.choice(CALLS)
        self.counts[name] = self.counts.get(name, 0) + 1
        getattr(self, '_' + name)(now_s + self._rng.uniform(0.1, 2.5))

    def _reset(self, _: float) -> None:
        self._listener.announce()
        call('reset', Trigger)

    def _reset_to_pose(self, _: float) -> None:
        self._listener.announce()
        request = ResetToPose._request_class()  # pylint: disable=protected-access
        request.pose.position.x = self._rng.uniform(-9.0, 9.0)
        request.pose.orientation.w = 1.0
        call('reset_to_pose', ResetToPose, request)

    def _pause(self, until_s: float) -> None:
        call('pause', Trigger)
        self._then = until_s, lambda: call('resume', Trigger)

    def _paths(self, until_s: float) -> None:
        subscribers = [rospy.Subscriber('/stereo/' + name, kind, lambda _: None)
                       for name, kind in self.LOOKED_AT.items()]

        def leave() -> None:
            for each in subscribers:
                each.unregister()
        self._then = until_s, leave


def call(name: str, kind: Any, *arguments: Any) -> None:
    """Calls a service of the odometry; a failure is one of the run."""
    rospy.ServiceProxy(f'{ODOMETRY}/{name}', kind)(*arguments)


def sample(pid: int, time_s: float) -> ProcessSample:
    """Resident set, open files and threads of a process."""
    with open(f'/proc/{pid}/status', encoding='ascii') as stream:
        status = stream.read()

    def number(name: str) -> int:
        return int(re.search(rf'^{name}:\s+(\d+)', status, re.MULTILINE).group(1))
    return ProcessSample(time_s, number('VmRSS') / 1024.0, len(os.listdir(f'/proc/{pid}/fd')),
                         number('Threads'))


def pid_of(node: str) -> int:
    """Process of a node, once it is there."""
    master = rosgraph.Master('/soak')
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        try:
            code, _, pid = rospy.core.xmlrpcapi(master.lookupNode(node)).getPid('/soak')
            if code == 1:
                return pid
        except (rosgraph.MasterException, OSError):
            pass
        time.sleep(POLL_S)
    raise SoakError(f'{node} does not start: see the log (--log FILE)')


def soak(options: argparse.Namespace, launch: Any) -> Run:
    """Runs for the given time."""
    injector = Injector(options.seed)
    camera = Camera(injector)
    listener = Listener(camera)
    pid = pid_of(MANAGER)
    operator = Operator(options.seed, listener)
    samples: List[ProcessSample] = []
    begin = time.monotonic()
    end = begin + 60.0 * options.minutes
    ended = ''
    while time.monotonic() < end and not ended:
        time.sleep(POLL_S)
        now = time.monotonic()
        camera.quiet = now > end - QUIET_S
        if launch.poll() is not None or not os.path.exists(f'/proc/{pid}/fd'):
            ended = 'a program has ended by itself: see the log (--log FILE)'
        elif now - listener.last_answer_s > TIMEOUT_S:
            ended = f'no answer for {TIMEOUT_S:.0f} s, after the fault: {camera.fault}'
        else:
            try:
                operator.act(now, camera.quiet)
            except rospy.ServiceException as error:
                ended = f'a service of the odometry failed: {error}'
            if not samples or now - begin - samples[-1].time_s >= SAMPLE_S:
                samples.append(sample(pid, now - begin))
                show(samples[-1], listener, end - now)
    return Run(samples, listener.watch, listener.states, listener.changes, listener.counters,
               {**injector.counts, **operator.counts}, ended, listener.state == 'OK')


def show(last: ProcessSample, listener: Listener, left_s: float) -> None:
    """Shows the progress on a terminal."""
    if sys.stdout.isatty():
        print(f'\r\033[K{left_s / 60.0:.1f} minutes left, {last.rss_mb:.1f} MB, {last.files} files, '
              f'{listener.watch.num_answers} answers, {listener.watch.num_jumps} jumps, '
              f'{listener.state}', end='', flush=True)


def run(options: argparse.Namespace, folder: str) -> Run:
    """A roscore of its own, the camera and the odometry, and the run."""
    port = free_port()
    os.environ['ROS_MASTER_URI'] = f'http://localhost:{port}'
    os.environ['ROS_LOG_DIR'] = os.path.join(folder, 'ros')
    log = options.log or os.path.join(folder, 'log')
    here = os.path.dirname(os.path.realpath(__file__))
    with ExitStack() as cleanup:
        launch = start(['roslaunch', '-p', str(port), os.path.join(here, 'soak.launch'),
                        f'scene:={options.scene}', f'seed:={options.seed}',
                        f'frame_rate_hz:={options.rate}'], log)
        cleanup.callback(stop, launch)
        deadline = time.monotonic() + START_S
        while not rosgraph.is_master_online():
            if launch.poll() is not None or time.monotonic() > deadline:
                raise SoakError('roslaunch does not start: see the log (--log FILE)')
            time.sleep(POLL_S)
        rospy.init_node('soak', log_level=rospy.FATAL, disable_rostime=True, disable_rosout=True,
                        disable_signals=True)
        cleanup.callback(rospy.signal_shutdown, 'the run is over')
        return soak(options, launch)


def write_samples(path: str, samples: List[ProcessSample]) -> None:
    """A row for each sample."""
    with open(path, 'w', encoding='ascii') as stream:
        stream.write(','.join(ProcessSample._fields) + '\n')
        stream.writelines(','.join(f'{value:g}' for value in each) + '\n' for each in samples)


def main(arguments: Optional[List[str]] = None) -> int:
    """Runs, and prints the report."""
    options = parse_arguments(arguments)
    folder = tempfile.mkdtemp(prefix='point_line_soak_')
    try:
        if options.samples:
            write_samples(options.samples, [])  # before the long run, whether it can be written
        seen = run(options, folder)
        text, passed = report(seen)
        if options.samples:
            write_samples(options.samples, seen.samples)
    except (SoakError, OSError) as error:
        print(f'soak: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print(('\r\033[K' if sys.stdout.isatty() else '') + text)
    return 0 if passed else 1


if __name__ == '__main__':
    sys.exit(main())
