"""The report of the demo on its recordings: trajectories, errors, the table and the images."""
import csv
import io
import json
import os
from typing import Any, Dict, List, NamedTuple, Optional

import numpy as np
import rosbag

from _sequences import load_script, write_text

report = load_script('report_run')
evaluation = report.evaluation

ODOMETRY = '/stereo/odom'
TRUTH = '/ground_truth/odom'
INFO = '/stereo/info'
IMAGE = '/stereo/features_image'
STATES = ('INITIALIZING', 'OK', 'DEGRADED', 'LOST')

SCENE_FILES = ('trajectory.png', 'features.png', 'errors.png', 'times.png', 'estimate.tum',
               'groundtruth.tum')
SUMMARY_FILES = ('overview.png', 'results.csv', 'results.json')

# Rows of the table: figure, meaning, decimals.
ROWS = [('frames', 'frames', 0), ('path_m', 'path length [m]', 1),
        ('short_t_rel', 'translation error over 5-50 m [%]', 2),
        ('short_r_rel', 'rotation error over 5-50 m [deg/100 m]', 2),
        ('t_rel', 'translation error over 100-800 m [%]', 2),
        ('r_rel', 'rotation error over 100-800 m [deg/100 m]', 2),
        ('ate_m', 'absolute trajectory error, RMSE [m]', 4),
        ('end_percent', 'end error [% of the path]', 2),
        ('frame_deg', 'rotation error per frame, RMSE [deg]', 4),
        ('time_ms', 'time per frame, median [ms]', 1),
        ('ok', 'frames OK', 0), ('degraded', 'frames DEGRADED', 0), ('lost', 'frames LOST', 0)]

NOTE = ("Times are the odometry's own, measured while the next images were rendered on the same "
        'processor.')


class SceneError(Exception):
    """Why a scene has no result, or only a part of one; the text is one sentence."""


class Recording(NamedTuple):
    """What a bag has: lines of TUM files by stamp [ns], the OdometryInfo of each frame, and an
    image of features (height, width, 3) RGB if there is one."""
    estimate: Dict[int, str]
    ground_truth: Dict[int, str]
    infos: List[Any]
    image: Optional[np.ndarray]


class Scene(NamedTuple):
    """A scene's results: figures of the table, evaluate_trajectory's result and matched poses, and
    the recording."""
    figures: Dict[str, Any]
    scores: Dict[str, Any]
    matches: Any
    recording: Recording


def file_names(scenes: List[str]) -> List[str]:
    """All files that a demo of these scenes writes."""
    return [f'{scene}_{name}' for scene in scenes for name in SCENE_FILES] + list(SUMMARY_FILES)


def tum_line(message: Any) -> str:
    """A nav_msgs/Odometry as a line of a TUM file: stamp, position, quaternion x y z w."""
    stamp, pose = message.header.stamp, message.pose.pose
    numbers = [pose.position.x, pose.position.y, pose.position.z, pose.orientation.x,
               pose.orientation.y, pose.orientation.z, pose.orientation.w]
    return f'{stamp.secs}.{stamp.nsecs:09} ' + ' '.join(f'{number:.9f}' for number in numbers)


def to_image(message: Any) -> np.ndarray:
    """A bgr8 sensor_msgs/Image as an array (height, width, 3) RGB."""
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    return rows[:, :3 * message.width].reshape(message.height, message.width, 3)[:, :, ::-1]


def read_recording(path: str) -> Recording:
    """Reads a bag by the stamps in the messages' headers."""
    recording = Recording({}, {}, [], None)
    with rosbag.Bag(path) as bag:
        for topic, message, _ in bag.read_messages([ODOMETRY, TRUTH, INFO, IMAGE]):
            stamp_ns = message.header.stamp.to_nsec()
            if topic == ODOMETRY:
                recording.estimate[stamp_ns] = tum_line(message)
            elif topic == TRUTH:
                recording.ground_truth[stamp_ns] = tum_line(message)
            elif topic == INFO:
                recording.infos.append(message)
            else:
                recording = recording._replace(image=to_image(message))
    return recording


def write_tum(path: str, lines: Dict[int, str]) -> None:
    """Writes the lines in the order of their stamps."""
    write_text(path, '\n'.join(lines[stamp_ns] for stamp_ns in sorted(lines)) + '\n')


def count_missing(recording: Recording, frames: int) -> int:
    """Number of frames without an estimate: of `frames`, or with 0 of those until the last estimate."""
    if frames:
        return frames - len(recording.estimate)
    latest = max(recording.estimate, default=0)
    return sum(1 for stamp in recording.ground_truth if stamp <= latest) - len(recording.estimate)


def score(recording: Recording, frames: int, ground_truth_path: str, estimate_path: str) -> Scene:
    """The figures of a recording; the trajectories are in these files already."""
    arguments = ['--groundtruth', ground_truth_path, '--estimate', estimate_path]
    try:
        matches, scores = evaluation.run(evaluation.parse_arguments(arguments))
    except evaluation.InputError as error:
        raise SceneError(f'the trajectory cannot be evaluated: {error}')
    states = [STATES[info.state] for info in recording.infos]
    figures = {
        'frames': len(recording.estimate), 'missing': count_missing(recording, frames),
        'path_m': scores['path_length_m'],
        'short_t_rel': scores['short']['t_rel_percent'],
        'short_r_rel': scores['short']['r_rel_deg_per_100m'],
        't_rel': scores['kitti']['t_rel_percent'],
        'r_rel': scores['kitti']['r_rel_deg_per_100m'],
        'ate_m': scores['ate_m']['rmse'], 'end_percent': scores['end_error']['percent_of_path'],
        'frame_deg': scores['per_frame']['rotation_rmse_deg'],
        'time_ms': float(np.median([info.total_ms for info in recording.infos])),
        **{name.lower(): states.count(name) for name in STATES}}
    return Scene(figures, scores, matches, recording)


def find_problems(scene: Scene) -> List[str]:
    """Problems of a scene, as text."""
    problems = []
    figures = scene.figures
    if figures['missing']:
        problems.append(f'{figures["missing"]} of {figures["frames"] + figures["missing"]} frames '
                        'were not answered by the odometry')
    if figures['lost']:
        reasons = sorted({info.reason for info in scene.recording.infos
                          if STATES[info.state] == 'LOST'})
        problems.append(f'the odometry was lost in {figures["lost"]} frames '
                        f'({", ".join(reasons)})')
    return problems


def number(value: Any, decimals: int) -> str:
    """A cell of the table."""
    return '-' if value is None else f'{value:.{decimals}f}'


def format_table(scenes: Dict[str, Scene]) -> str:
    """The figures as aligned text, a column for a scene; rows that no scene has are left away."""
    width = max(len(text) for _, text, _ in ROWS) + 2
    lines = [' ' * width + ''.join(f'{name:>10}' for name in scenes)]
    for key, text, decimals in ROWS:
        values = [scene.figures[key] for scene in scenes.values()]
        if any(value is not None for value in values):
            lines.append(f'{text:<{width}}'
                         + ''.join(f'{number(value, decimals):>10}' for value in values))
    return '\n'.join(lines + ['', NOTE])


def stage_times(infos: List[Any]) -> Dict[str, np.ndarray]:
    """Times of each stage over the frames [ms], and the rest of the total."""
    stages = {name: np.array([info.stage_ms[i] for info in infos])
              for i, name in enumerate(infos[0].stage_names)}
    return report.parts_of_total(stages, np.array([info.total_ms for info in infos]))


def plot_times(infos: List[Any]) -> Any:
    """Figure of the times: a box for each stage and the total, and their stack over the frames."""
    from matplotlib.figure import Figure
    times = stage_times(infos)
    times['total'] = sum(times.values())
    figure = Figure(figsize=(9.0, 7.4), dpi=130, tight_layout=True)
    axes = figure.add_subplot(2, 1, 1)
    axes.boxplot(list(times.values())[::-1], vert=False, widths=0.6, showfliers=False)
    axes.set_yticklabels([f'{name}, {np.median(values):.1f} ms'
                          for name, values in times.items()][::-1])
    axes.set_xlabel('time [ms]; box: half of the frames, line: median')
    axes.set_xlim(left=0)
    axes.grid(True, axis='x', linewidth=0.5, alpha=0.5)
    report.draw_times(figure.add_subplot(2, 1, 2), stage_times(infos))
    return figure


def draw_scene(figure: Any, cells: Any, name: str, scene: Scene) -> None:
    """A row of the poster, into four cells of a grid."""
    axes = figure.add_subplot(cells[0, 0])
    axes.axis('off')
    axes.set_anchor('NW')
    axes.set_title(describe(name, scene), loc='left')
    if scene.recording.image is not None:
        axes.imshow(scene.recording.image, interpolation='bilinear')
    axes = figure.add_subplot(cells[0, 1])
    report.draw_trajectory(axes, evaluation.align_first(scene.matches)[:, :3, 3],
                           scene.matches.ground_truth[:, :3, 3])
    rows = scene.scores['short']['per_length'] + scene.scores['kitti']['per_length']
    errors = cells[0, 2].subgridspec(2, 1, hspace=0.45)
    for cell, key, label in ((errors[0, 0], 't_rel_percent', 'translation [%]'),
                             (errors[1, 0], 'r_rel_deg_per_100m', 'rotation [deg/100 m]')):
        axes = figure.add_subplot(cell)
        evaluation.plot_segment_errors(axes, rows, key, label)
        for text in (axes.yaxis.label, *axes.texts):
            text.set_fontsize(8)
    report.draw_times(figure.add_subplot(cells[0, 3]), stage_times(scene.recording.infos))


def row_height(scene: Scene) -> float:
    """Inches for a row of the poster: enough for an image of 7 inches' width with its title, and
    not too little for the rest."""
    image = scene.recording.image
    shape = (1, 3) if image is None else image.shape
    return min(max(7.0 * shape[0] / shape[1] + 1.3, 4.2), 5.4)


def plot_overview(scenes: Dict[str, Scene]) -> Any:
    """A poster: a row for a scene with an image, the trajectories, the errors and the times."""
    from matplotlib.figure import Figure
    heading = 0.5
    height = heading + sum(map(row_height, scenes.values()))
    figure = Figure(figsize=(20.0, height), dpi=110)
    figure.suptitle('point_line_odometry: stereo visual odometry with points and line segments, in '
                    'synthetic worlds', fontsize=18, y=1 - 0.3 * heading / height, va='top')
    top = height - heading
    for name, scene in scenes.items():
        bottom = top - row_height(scene)
        # Room for the title above and the labels below.
        cells = figure.add_gridspec(1, 4, width_ratios=[2.4, 1.3, 1.0, 1.3], wspace=0.2, left=0.01,
                                    right=0.99, top=(top - 0.7) / height,
                                    bottom=(bottom + 0.6) / height)
        draw_scene(figure, cells, name, scene)
        top = bottom
    return figure


def describe(name: str, scene: Scene) -> str:
    """A scene's figures in two lines."""
    figures = scene.figures
    end = number(figures['end_percent'], 2)
    return (f'{name}: {figures["frames"]} frames, {figures["path_m"]:.0f} m, '
            f'{figures["time_ms"]:.0f} ms per frame\n'
            f'end error {end} % of the path, absolute trajectory error {figures["ate_m"]:.3f} m')


def report_scene(name: str, frames: int, bag: str, folder: str) -> Scene:
    """Writes a scene's files; its results. SceneError if there are no two frames."""
    recording = read_recording(bag)
    if min(len(recording.estimate), len(recording.ground_truth), len(recording.infos)) < 2:
        of_frames = f' of {frames}' if frames else ''
        raise SceneError(f'the odometry answered only {len(recording.estimate)}{of_frames} frames')
    prefix = os.path.join(folder, name + '_')
    write_tum(prefix + 'estimate.tum', recording.estimate)
    write_tum(prefix + 'groundtruth.tum', recording.ground_truth)
    scene = score(recording, frames, prefix + 'groundtruth.tum', prefix + 'estimate.tum')
    evaluation.write_figure(prefix + 'trajectory.png', evaluation.plot_trajectory(scene.matches))
    evaluation.write_figure(prefix + 'errors.png',
                            evaluation.plot_errors(scene.matches, scene.scores))
    evaluation.write_figure(prefix + 'times.png', plot_times(recording.infos))
    if recording.image is not None:
        from matplotlib.image import imsave
        imsave(prefix + 'features.png', recording.image)
    return scene


def format_csv(scenes: Dict[str, Scene]) -> str:
    """results.csv: a row for every scene."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    keys = ['missing'] + [key for key, _, _ in ROWS]
    writer.writerow(['scene'] + keys)
    for name, scene in scenes.items():
        writer.writerow([name] + [scene.figures[key] for key in keys])
    return stream.getvalue()


def write_summaries(scenes: Dict[str, Scene], folder: str) -> None:
    """Writes the files on all scenes."""
    content = {name: {**scene.figures, 'per_length': scene.scores['short']['per_length']
                      + scene.scores['kitti']['per_length']} for name, scene in scenes.items()}
    write_text(os.path.join(folder, 'results.json'),
               json.dumps(content, indent=2, allow_nan=False) + '\n')
    write_text(os.path.join(folder, 'results.csv'), format_csv(scenes))
    evaluation.write_figure(os.path.join(folder, 'overview.png'), plot_overview(scenes))
