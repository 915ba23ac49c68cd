"""The checks of a soak run: jumps of odom, numbers that are NaN, growth of the process."""
import math
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from _sequences import load_script

evaluation = load_script('evaluate_trajectory')

# A step of odom may differ from twist x dt by three standard deviations of the twist, and by the
# part of a prediction's error that the odometry corrects in each step: 20 % of the motion, 0.1 m/s, 0.1 rad/s.
SIGMAS = 3.0
SHARE = 0.25
SPEED = 0.12
NOISE = 0.005  # [m], [rad]

WARM_UP_S = 300.0    # not evaluated: buffers, and the allocator's own, fill up to their bounds
EVALUATED_S = 900.0  # shortest time over which growth is evaluated: the allocator's own changes,
GROWTH_MB = 3.0      # of as much, last some minutes
LINE = '{:<36}{}'


class Answer(NamedTuple):
    """A message of odom with the state of info; position [m], quaternion x y z w, twist linear
    and angular in the base [m/s, rad/s] with its standard deviations."""
    stamp_s: float
    position: Sequence[float]
    rotation: Sequence[float]
    twist: Sequence[float]
    twist_sigma: Sequence[float]
    state: str


class ProcessSample(NamedTuple):
    """The odometry's process at a time."""
    time_s: float
    rss_mb: float
    files: int
    threads: int


def is_finite(answer: Answer) -> bool:
    """True if all published numbers are finite."""
    return all(math.isfinite(number) for numbers in answer[1:5] for number in numbers)


def step_between(a: Answer, b: Answer) -> Tuple[np.ndarray, np.ndarray]:
    """Translation along the base's mean axes, and rotation, from a to b."""
    rotations = evaluation.quaternions_to_rotations(np.array([a.rotation, b.rotation]))
    rotation_a = rotations[0]
    turn = evaluation.rotation_vectors((rotation_a.T @ rotations[1])[None])[0]
    translation = rotation_a.T @ (np.array(b.position) - np.array(a.position))
    return translation - 0.5 * np.cross(turn, translation), turn


def unexplained(a: Answer, b: Answer) -> Optional[str]:
    """Description of the jump in the step from a to b; None if there is none.

    Where no time has passed, or tracking was reset, the pose must have been kept.
    """
    dt_s = b.stamp_s - a.stamp_s
    kept = dt_s <= 0.0 or b.state == 'INITIALIZING'
    span_s = 0.0 if kept else dt_s
    for name, step, part in zip('m rad'.split(), step_between(a, b), (slice(0, 3), slice(3, 6))):
        twist = np.array(b.twist[part])
        sigma = np.hypot(a.twist_sigma[part], b.twist_sigma[part])
        allowed = (SIGMAS * np.linalg.norm(sigma) + SHARE * np.linalg.norm(twist)) * span_s
        allowed += SPEED * min(max(dt_s, 0.0), 1.0) + NOISE
        error = np.linalg.norm(step - twist * span_s)
        if not error <= allowed:
            return f'{error:.3f} {name} beyond the motion, of {allowed:.3f} allowed, in {dt_s:.2f} s'
    return None


class JumpWatch:
    """Checks the answers in turn; its memory is bounded."""

    def __init__(self) -> None:
        self.num_answers = self.num_not_finite = self.num_jumps = 0
        self.jumps: List[str] = []  # descriptions of the first ones
        self._last: Optional[Answer] = None

    def add(self, answer: Answer, announced: bool, fault: str = '') -> None:
        """`announced`: a reset was requested since the last answer."""
        self.num_answers += 1
        if not is_finite(answer):
            self.num_not_finite += 1
            return
        last, self._last = self._last, answer
        if last is None or announced:
            return
        words = unexplained(last, answer)
        if words is None:
            return
        self.num_jumps += 1
        if len(self.jumps) < 10:
            self.jumps.append(f'{words}; {last.state} -> {answer.state}, last fault: {fault}')


def slope(times: Sequence[float], values: Sequence[float]) -> float:
    """Median slope between samples (Theil and Sen), of at most a few hundred of them."""
    stride = max(1, len(times) // 300)
    t, v = np.array(times[::stride]), np.array(values[::stride])
    first, second = np.triu_indices(len(t), 1)
    return float(np.median((v[second] - v[first]) / (t[second] - t[first])))


class Growth(NamedTuple):
    """Growth of the process after the warm-up; evaluated only if that is long enough."""
    evaluated: bool
    rss_mb_per_min: float
    rss_mb: float      # over the evaluated time
    files: int         # fewest of the last third more than of the first
    threads: int


def growth_of(samples: Sequence[ProcessSample]) -> Growth:
    """The growth in the samples."""
    begin = samples[0].time_s + WARM_UP_S if samples else 0.0
    late = [sample for sample in samples if sample.time_s >= begin]
    span_s = late[-1].time_s - late[0].time_s if late else 0.0
    if span_s < EVALUATED_S:
        return Growth(False, 0.0, 0.0, 0, 0)
    per_s = slope([each.time_s for each in late], [each.rss_mb for each in late])
    third = len(late) // 3

    def fewest(name: str) -> int:
        first, last = ([getattr(each, name) for each in part]
                       for part in (late[:third], late[-third:]))
        return min(last) - min(first)
    return Growth(True, 60.0 * per_s, per_s * span_s, fewest('files'), fewest('threads'))


class Run(NamedTuple):
    """The measurements of a soak run."""
    samples: List[ProcessSample]
    watch: JumpWatch
    states: Dict[str, int]    # answers by state
    changes: int              # of the state
    counters: Dict[str, int]  # of info: processed, dropped, rejected, exceptions
    faults: Dict[str, int]
    ended: str                # why it ended early; empty if it did not
    recovered: bool           # the state was OK when the faults were over


def checks_of(run: Run) -> List[Tuple[str, bool, str]]:
    """Name, passed, figure."""
    growth = growth_of(run.samples)
    watch = run.watch
    exceptions = run.counters.get('exceptions', 0)
    not_evaluated = f'not evaluated in less than {(WARM_UP_S + EVALUATED_S) / 60.0:.0f} minutes'
    return [
        ('the process lives', not run.ended, run.ended or 'yes'),
        ('frames are answered', watch.num_answers > 0, str(watch.num_answers)),
        ('numbers that are not finite', watch.num_not_finite == 0, str(watch.num_not_finite)),
        ('jumps of odom', watch.num_jumps == 0, str(watch.num_jumps)),
        ('exceptions', exceptions == 0, str(exceptions)),
        ('tracks again after the last fault', run.recovered, 'yes' if run.recovered else 'no'),
        ('memory does not grow', growth.rss_mb <= GROWTH_MB,
         f'{growth.rss_mb_per_min:+.3f} MB/min, {growth.rss_mb:+.2f} MB' if growth.evaluated
         else not_evaluated),
        ('open files do not grow', growth.files <= 0,
         f'{growth.files:+d}' if growth.evaluated else not_evaluated),
        ('threads do not grow', growth.threads <= 0,
         f'{growth.threads:+d}' if growth.evaluated else not_evaluated),
    ]


def report(run: Run) -> Tuple[str, bool]:
    """The report as text, and whether all is well."""
    lines = []
    if run.samples:
        first, last = run.samples[0], run.samples[-1]
        lines += [LINE.format('minutes', f'{(last.time_s - first.time_s) / 60.0:.1f}'),
                  LINE.format('resident memory [MB]', f'{first.rss_mb:.1f} ... {last.rss_mb:.1f}'),
                  LINE.format('open files', f'{first.files} ... {last.files}'),
                  LINE.format('threads', f'{first.threads} ... {last.threads}')]
    lines.append(LINE.format('answers by state', counted(run.states)))
    lines.append(LINE.format('changes of state', run.changes))
    lines.append(LINE.format('frames', counted(run.counters)))
    lines.append(LINE.format('faults', f'{sum(run.faults.values())}: ' + counted(run.faults)))
    lines.append('')
    lines += [f'jump: {words}' for words in run.watch.jumps]
    checks = checks_of(run)
    lines += [('PASS  ' if passed else 'FAIL  ') + LINE.format(name, figure)
              for name, passed, figure in checks]
    passed = all(passed for _, passed, _ in checks)
    lines.append('\nPASS' if passed else '\nFAIL')
    return '\n'.join(lines), passed


def counted(counts: Dict[str, int]) -> str:
    """Counts in one line."""
    return ', '.join(f'{name} {count}' for name, count in sorted(counts.items())) or 'none'
