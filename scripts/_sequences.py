"""Shared by the scripts that run sequences and report on them: the files of a sequence, and the
files of a result."""
# Only the standard library here: the rest is installed by scripts/build.
import hashlib
import importlib.machinery
import importlib.util
import json
import os
import re
import subprocess
from typing import Any, Dict, List, NamedTuple, Optional

SCRIPTS = os.path.dirname(os.path.realpath(__file__))
LAYOUTS = ('KITTI', 'EuRoC')
METHODS = ('paper', 'default')  # of this package, in the order of the report

# What the result of a sequence consists of; of one with problems there is only the last.
RESULT_FILES = ('trajectory.tum', 'trajectory.kitti', 'frames.csv', 'summary.json',
                'evaluation.json', 'trajectory.png', 'errors.png', 'features.png', 'positions.csv',
                'report.html', 'sequence.json')
REPORT_FILES = ('report.md', 'results.csv', 'figure_5.png', 'figure_6.png', 'figure_7.png',
                'figure_8.png', 'figure_9.png', 'residuals.png', 'segment_errors.png')

# A line that run_sequence prints: this, then the folder of the result as tar.gz in base64.
RESULT_MARK = 'result of a sequence: '


def load_script(name: str) -> Any:
    """A script of this folder as a module."""
    loader = importlib.machinery.SourceFileLoader(name, os.path.join(SCRIPTS, name))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
    loader.exec_module(module)
    return module


class InputError(Exception):
    """Input that cannot be used; the text is one sentence with the cause and a hint."""


class Sequence(NamedTuple):
    """A folder with stereo images in KITTI's or EuRoC's layout."""
    name: str
    folder: str
    layout: str


class Task(NamedTuple):
    """What one job runs: a sequence, with the configuration of a method."""
    sequence: Sequence
    method: str


def result_folder(output: str, name: str, method: str) -> str:
    """The folder, within the output folder, with the result of a sequence and a method."""
    return os.path.join(output, 'sequences', name, method)


def layout_of(folder: str) -> Optional[str]:
    """The layout of a sequence's folder, as offline_odometry recognises it; None if it is not one."""
    def has(name: str) -> bool:
        return os.path.exists(os.path.join(folder, name))
    if has('mav0') or has('cam0'):
        return 'EuRoC'
    return 'KITTI' if has('image_0') or has('calib.txt') else None


def euroc_base(folder: str) -> str:
    """The folder with cam0 of an EuRoC sequence."""
    inner = os.path.join(folder, 'mav0')
    return inner if os.path.isdir(inner) else folder


def count_frames(folder: str, layout: str) -> int:
    """About how many frames a sequence has."""
    inner = ('image_0',) if layout == 'KITTI' else ('cam0', 'data')
    base = folder if layout == 'KITTI' else euroc_base(folder)
    try:
        return len(os.listdir(os.path.join(base, *inner)))
    except OSError:
        return 0


def find_ground_truth(folder: str, layout: str) -> str:
    """The file with the true poses: next to the images, or at its path in the published data set."""
    if layout == 'EuRoC':
        places = [os.path.join(euroc_base(folder), 'state_groundtruth_estimate0', 'data.csv')]
    else:
        sequences, name = os.path.split(os.path.realpath(folder))
        places = [os.path.join(folder, 'poses.txt'),
                  os.path.join(os.path.dirname(sequences), 'poses', name + '.txt')]
    for place in places:
        if os.path.isfile(place):
            return place
    raise InputError(f'ground truth is missing: put it into {" or ".join(places)}')


def fingerprint(paths: List[str]) -> str:
    """A short name for the content of files."""
    digest = hashlib.sha256()
    for path in paths:
        try:
            with open(path, 'rb') as stream:
                digest.update(hashlib.sha256(stream.read()).digest())
        except OSError as error:
            raise InputError(f'cannot read {path}: {error.strerror}; check the path')
    return digest.hexdigest()[:12]


def program_fingerprint(programs: str) -> str:
    """A short name for all that makes a result: offline_odometry in the folder, the package's
    libraries that it loads, and the scripts that run and evaluate it."""
    program = os.path.join(programs, 'offline_odometry')
    if not os.access(program, os.X_OK):
        raise InputError(f'{program} is missing: build the package with scripts/build')
    loaded = subprocess.run(['ldd', program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                            universal_newlines=True).stdout
    libraries = re.findall(r'=> (/.*/libpoint_line_odometry[^/]*) \(0x', loaded)
    scripts = ['run_sequence', '_sequences.py', 'evaluate_trajectory', 'report_run']
    return fingerprint([program] + sorted(libraries)
                       + [os.path.join(SCRIPTS, name) for name in scripts])


def read_json(path: str) -> Dict[str, Any]:
    """The object in a JSON file; empty if the file is missing or damaged."""
    try:
        with open(path, encoding='utf-8') as stream:
            content = json.load(stream)
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def write_text(path: str, text: str) -> None:
    """Writes a file under a temporary name and renames it when it is complete."""
    temporary = f'{path}.part'
    with open(temporary, 'w', encoding='utf-8') as stream:
        stream.write(text)
    os.replace(temporary, path)


def is_whole(folder: str) -> bool:
    """Whether a folder holds the complete result of a sequence without problems."""
    def has(name: str) -> bool:
        path = os.path.join(folder, name)
        return os.path.isfile(path) and os.path.getsize(path) > 0
    record = read_json(os.path.join(folder, 'sequence.json'))
    return bool(record) and record.get('error') is None and all(map(has, RESULT_FILES))


def load_figures(folder: str) -> Dict[str, Any]:
    """The figures of a complete result, by short names; None where there is no segment."""
    scores = read_json(os.path.join(folder, 'evaluation.json'))
    summary = read_json(os.path.join(folder, 'summary.json'))
    return {'frames': summary['frames'], 'degraded': summary['degraded'], 'lost': summary['lost'],
            'time_ms': summary['times']['total_ms']['median'],
            'stages_ms': {name[:-len('_ms')]: time['median']
                          for name, time in summary['times'].items()},
            'path_m': scores['path_length_m'], 'ate_rmse': scores['ate_m']['rmse'],
            't_rel': scores['kitti']['t_rel_percent'],
            'r_rel': scores['kitti']['r_rel_deg_per_100m'],
            'segments': scores['kitti']['segments'],
            'short_t_rel': scores['short']['t_rel_percent'],
            'short_r_rel': scores['short']['r_rel_deg_per_100m'],
            'short_segments': scores['short']['segments'],
            'frame_mm': 1000 * scores['per_frame']['translation_rmse_m'],
            'frame_deg': scores['per_frame']['rotation_rmse_deg']}
