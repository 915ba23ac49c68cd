"""Faults of a stereo camera's messages, drawn at random from a seed.

A fault is a function that is called with the messages of every stereo frame while it lasts, and
returns those that are to be published instead, in their order.
"""
import random
from typing import Callable, Dict, List, NamedTuple, Optional

import numpy as np
import rospy
from sensor_msgs.msg import CameraInfo, Image


class Frame(NamedTuple):
    """The messages of a stereo frame; None for a missing one."""
    left: Optional[Image]
    right: Optional[Image]
    left_info: Optional[CameraInfo]
    right_info: Optional[CameraInfo]


Fault = Callable[[Frame], List[Frame]]


def changed(message, **fields):
    """A copy of a message with other fields."""
    values = {name: getattr(message, name) for name in message.__slots__}
    values.update(fields)
    return type(message)(**values)


def restamped(message, shift_s: float):
    """A copy of a message with another stamp."""
    header = message.header
    stamp = rospy.Time(0, header.stamp.to_nsec() + int(shift_s * 1e9))
    return changed(message, header=type(header)(header.seq, stamp, header.frame_id))


def on_images(frame: Frame, change: Callable[[Image], Image], sides: str) -> Frame:
    """The frame with images of some sides changed."""
    return frame._replace(**{side: change(getattr(frame, side)) for side in sides.split()})


def on_infos(frame: Frame, change: Callable[[CameraInfo], CameraInfo]) -> Frame:
    """The frame with both infos changed."""
    return frame._replace(left_info=change(frame.left_info), right_info=change(frame.right_info))


def pixels_of(image: Image) -> np.ndarray:
    """A view of a mono8 image."""
    return np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, :image.width]


def with_pixels(image: Image, pixels: np.ndarray) -> Image:
    """The image with other pixels, of the same number."""
    return changed(image, step=image.width, data=np.ascontiguousarray(pixels, np.uint8).tobytes())


def filled(value: int) -> Callable[[Image], Image]:
    """Makes all pixels the same."""
    return lambda image: changed(image, data=bytes([value]) * len(image.data))


def blurred(image: Image) -> Image:
    """Far out of focus: each pixel the mean of a square around it."""
    half = 30
    sums = np.pad(pixels_of(image).astype(np.int64), half, mode='edge').cumsum(0).cumsum(1)
    sums = np.pad(sums, ((1, 0), (1, 0)))
    side = 2 * half + 1
    square = sums[side:, side:] - sums[side:, :-side] - sums[:-side, side:] + sums[:-side, :-side]
    return with_pixels(image, square // side ** 2)


def lowered(image: Image) -> Image:
    """As of a camera that is mounted too high."""
    return with_pixels(image, np.roll(pixels_of(image), 4, axis=0))


def with_P(info: CameraInfo, index: int, value: float) -> CameraInfo:
    """The info with another number in P."""
    numbers = list(info.P)
    numbers[index] = value
    return changed(info, P=numbers)


class Freeze:
    """The camera repeats its last image with new stamps."""

    def __init__(self) -> None:
        self._first: Optional[Frame] = None

    def __call__(self, frame: Frame) -> List[Frame]:
        self._first = self._first or frame
        return [frame._replace(left=changed(frame.left, data=self._first.left.data),
                               right=changed(frame.right, data=self._first.right.data))]


class Burst:
    """Frames are delayed, and arrive all at once."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._held: List[Frame] = []

    def __call__(self, frame: Frame) -> List[Frame]:
        self._held.append(frame)
        if len(self._held) < self._size:
            return []
        held, self._held = self._held, []
        return held


class Exchange:
    """Every second frame comes after the one that follows it."""

    def __init__(self) -> None:
        self._held: Optional[Frame] = None

    def __call__(self, frame: Frame) -> List[Frame]:
        if self._held is None:
            self._held = frame
            return []
        held, self._held = self._held, None
        return [frame, held]


def nothing(_: Frame) -> List[Frame]:
    """All frames are dropped."""
    return []


def simple(change: Callable[[Frame], Frame]) -> Callable[[random.Random], Fault]:
    """A fault that is the same for every frame."""
    return lambda _: lambda frame: [change(frame)]


def shrunk(image: Image) -> Image:
    """An image of fewer rows, consistent in itself."""
    height = image.height // 2
    return changed(image, height=height, data=image.data[:height * image.step])


def noise(rng: random.Random) -> Fault:
    """White noise in both images."""
    generator = np.random.default_rng(rng.randrange(1 << 30))

    def noisy(image: Image) -> Image:
        return with_pixels(image, generator.integers(0, 256, (image.height, image.width), np.uint8))
    return lambda frame: [on_images(frame, noisy, 'left right')]


NAN = float('nan')
BOTH = 'left right'


class Kind(NamedTuple):
    """A kind of fault: how it is made, and how long it lasts [s]."""
    make: Callable[[random.Random], Fault]
    shortest_s: float = 0.0
    longest_s: float = 1.0


KINDS: Dict[str, Kind] = {
    'dropped': Kind(lambda _: nothing, 0.0, 0.8),
    'gap': Kind(lambda _: nothing, 1.2, 3.0),
    'left missing': Kind(simple(lambda f: f._replace(left=None)), 0.2, 3.0),
    'right missing': Kind(simple(lambda f: f._replace(right=None)), 0.2, 3.0),
    'info missing': Kind(simple(lambda f: f._replace(right_info=None)), 0.2, 2.0),
    'stamps differ': Kind(simple(lambda f: f._replace(right=restamped(f.right, 0.004)))),
    'twice': Kind(lambda _: lambda frame: [frame, frame]),
    'late': Kind(lambda _: Exchange()),
    'burst': Kind(lambda rng: Burst(rng.randint(3, 12)), 0.5, 3.0),
    'frozen': Kind(lambda _: Freeze(), 0.2, 2.0),
    'black': Kind(simple(lambda f: on_images(f, filled(0), BOTH)), 0.0, 2.0),
    'saturated': Kind(simple(lambda f: on_images(f, filled(255), BOTH)), 0.0, 2.0),
    'uniform': Kind(simple(lambda f: on_images(f, filled(127), BOTH))),
    'one covered': Kind(simple(lambda f: on_images(f, filled(0), 'right')), 0.0, 2.0),
    'blurred': Kind(simple(lambda f: on_images(f, blurred, BOTH))),
    'noise': Kind(noise),
    'not rectified': Kind(simple(lambda f: on_images(f, lowered, 'right'))),
    'images exchanged': Kind(simple(lambda f: f._replace(
        left=changed(f.left, data=f.right.data), right=changed(f.right, data=f.left.data)))),
    'encoding': Kind(simple(lambda f: on_images(
        f, lambda i: changed(i, encoding='nonsense'), 'left'))),
    'bayer': Kind(simple(lambda f: on_images(
        f, lambda i: changed(i, encoding='bayer_rggb8'), BOTH))),
    'no size': Kind(simple(lambda f: on_images(f, lambda i: changed(i, width=0), 'right'))),
    'step': Kind(simple(lambda f: on_images(f, lambda i: changed(i, step=i.step - 1), 'left'))),
    'cut off': Kind(simple(lambda f: on_images(f, lambda i: changed(i, data=i.data[:len(i.data) // 3]), BOTH))),
    'wide encoding': Kind(simple(lambda f: on_images(
        f, lambda i: changed(i, encoding='bgra8'), BOTH))),
    'another size': Kind(simple(lambda f: on_images(f, shrunk, 'right'))),
    'P all zero': Kind(simple(lambda f: on_infos(f, lambda i: changed(i, P=[0.0] * 12)))),
    'P of NaN': Kind(simple(lambda f: on_infos(f, lambda i: with_P(i, 2, NAN)))),
    'f negative': Kind(simple(lambda f: on_infos(f, lambda i: with_P(i, 0, -400.0)))),
    'same infos': Kind(simple(lambda f: f._replace(right_info=f.left_info))),
    'infos exchanged': Kind(simple(lambda f: f._replace(
        left_info=f.right_info, right_info=f.left_info))),
    'D of NaN': Kind(simple(lambda f: on_infos(f, lambda i: changed(i, D=[NAN] * len(i.D))))),
    'K all zero': Kind(simple(lambda f: on_infos(f, lambda i: changed(i, K=[0.0] * 9)))),
    'another calibration': Kind(simple(lambda f: on_infos(
        f, lambda i: with_P(i, 2, i.P[2] + 0.3))), 0.2, 4.0),
    'binned': Kind(simple(lambda f: on_infos(f, lambda i: changed(i, binning_x=2, binning_y=2)))),
}

JUMPS_S = {'clock back': (-900.0, -1.5), 'clock a little back': (-0.6, -0.1),
           'clock ahead': (0.2, 900.0)}


class Injector:
    """Passes frames on, from time to time with a fault; the same seed draws the same faults."""

    def __init__(self, seed: int, rest_s=(0.5, 3.0)) -> None:
        self._rng = random.Random(seed)
        self._rest_s = rest_s
        self._fault: Optional[Fault] = None
        self._until_s = 0.0  # end of the fault, or of the pause
        self._shift_s = 0.0
        self.name = ''  # of the current fault
        self.counts: Dict[str, int] = {}

    def apply(self, frame: Frame, now_s: float, quiet: bool = False) -> List[Frame]:
        """The messages to be published instead of a frame; no fault begins while `quiet`."""
        if now_s >= self._until_s:
            if self._fault is None and not quiet:
                self._begin(now_s)
            else:
                self._fault, self.name = None, ''
                self._until_s = now_s + self._rng.uniform(*self._rest_s)
        frames = self._fault(frame) if self._fault else [frame]
        return [Frame(*(message and restamped(message, self._shift_s) for message in each))
                for each in frames]

    def _begin(self, now_s: float) -> None:
        self.name = self._rng.choice(sorted(KINDS) + sorted(JUMPS_S))
        self.counts[self.name] = self.counts.get(self.name, 0) + 1
        if self.name in JUMPS_S:
            self._shift_s += self._rng.uniform(*JUMPS_S[self.name])
            self._until_s = now_s
            return
        kind = KINDS[self.name]
        self._fault = kind.make(self._rng)
        self._until_s = now_s + self._rng.uniform(kind.shortest_s, kind.longest_s)
