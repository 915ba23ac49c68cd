#!/usr/bin/python3 -B
"""Installs and builds the package, drives a stereo camera through synthetic worlds in a roscore of
its own, and shows the results of the odometry: a table, and images in a folder.
"""
import argparse
import ctypes
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any, Callable, Dict, List, NoReturn, Optional

from _workspace import script_workspace

# Only the standard library here: the rest is installed by this script.

REPOSITORY = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
WORKSPACE = script_workspace()
END_SIGNALS = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
FRAMES = {'street': 250, 'indoor': 250, 'corridor': 400}
EXCERPT_LINES = 15
LINE_PERIOD_S = 10.0

EPILOG = """\
Folder: overview.png, all in one image; for every scene SCENE_trajectory.png, SCENE_errors.png,
SCENE_times.png, SCENE_features.png, SCENE_estimate.tum and SCENE_groundtruth.tum; results.csv and
results.json. An earlier demo's files are replaced once the new ones are complete.

The camera waits for the odometry, so that a slow computer makes the drive slower but not worse:
the same scene, seed and frames give the same trajectory everywhere.

Exit code: 0 all is well, 1 a scene failed or the odometry was lost, 2 the demo cannot be run,
130 interrupted.
"""


class DemoError(Exception):
    """Why the demo cannot be run; the text is one sentence with a hint."""


class Display:
    """Shows the progress of the demo: numbered steps with the time since the start, and below each a
    line that a terminal rewrites; without a terminal it is printed every ten seconds."""

    def __init__(self, num_steps: int) -> None:
        self._begin = time.monotonic()
        self._num_steps, self._step = num_steps, 0
        self._shown = 0.0
        self._is_terminal = sys.stdout.isatty()

    def step(self, title: str) -> None:
        """Begins the next step."""
        self._step += 1
        self.say(f'\n=== {self._step}/{self._num_steps}  {title}  [{self.elapsed()}]')
        self._shown = time.monotonic()

    def elapsed(self) -> str:
        """Time since the start."""
        return '{}:{:02}'.format(*divmod(int(time.monotonic() - self._begin), 60))

    def show(self, text: str) -> None:
        """Shows the state of the step, unless something was shown just before."""
        now = time.monotonic()
        if now - self._shown < (0.1 if self._is_terminal else LINE_PERIOD_S):
            return
        self._shown = now
        if self._is_terminal:
            width = shutil.get_terminal_size().columns - 1
            sys.stdout.write('\r\033[K' + text[:width])
            sys.stdout.flush()
        else:
            print(text, flush=True)

    def say(self, text: str) -> None:
        """Prints a permanent line."""
        print(('\r\033[K' if self._is_terminal else '') + text, flush=True)


def parse_arguments(arguments: Optional[List[str]]) -> argparse.Namespace:
    """The command line."""
    def number(lowest: int, highest: int) -> Callable[[str], int]:
        def parse(text: str) -> int:
            if not re.fullmatch('[0-9]{1,9}', text) or not lowest <= int(text) <= highest:
                raise argparse.ArgumentTypeError(f'give a number from {lowest} to {highest}')
            return int(text)
        return parse

    parser = argparse.ArgumentParser(prog='demo', description=__doc__, epilog=EPILOG,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--scene', action='append', choices=list(FRAMES), dest='scenes',
                        help='scene to drive through; may be given more than once (default: all)')
    parser.add_argument('--rviz', action='store_true',
                        help='drive through one scene (default: street) without end and show it '
                             'in rviz; closing rviz, or Ctrl-C, ends the drive')
    parser.add_argument('--seed', metavar='N', type=number(0, 1000000),
                        help='each seed gives a different world')
    parser.add_argument('--frames', metavar='N', type=number(2, 1000000),
                        help='number of frames after which to end each drive (default: '
                             + ', '.join(f'{name} {count}' for name, count in FRAMES.items()) + ')')
    parser.add_argument('-o', '--output', metavar='DIR', default='demo_results',
                        help='folder for the results (default: ./%(default)s)')
    options = parser.parse_args(arguments)
    scenes = options.scenes or (['street'] if options.rviz else list(FRAMES))
    options.scenes = list(dict.fromkeys(scenes))
    if options.rviz and len(options.scenes) > 1:
        parser.error('--rviz shows one scene: give --scene once')
    return options


def check_options(options: argparse.Namespace) -> None:
    """Raises DemoError for options that would fail only later."""
    if options.rviz and not has_display():
        raise DemoError('--rviz needs a graphical display, and there is none (DISPLAY is '
                        f'{os.environ.get("DISPLAY") or "not set"}): start it in a desktop session '
                        'or with ssh -X, or leave --rviz away')
    path = os.path.abspath(options.output)
    while not os.path.lexists(path):
        path = os.path.dirname(path)
    if not (os.path.isdir(path) and os.access(path, os.W_OK | os.X_OK)):
        raise DemoError(f'cannot write into {options.output}: {path} is no folder where you may '
                        'write; give another one with -o')


def has_display() -> bool:
    """True if there is a display that can be used, or if that is unknown, without Xlib."""
    if not os.environ.get('DISPLAY'):
        return False
    try:
        xlib = ctypes.CDLL('libX11.so.6')
    except OSError:
        return True
    xlib.XOpenDisplay.restype = ctypes.c_void_p
    display = xlib.XOpenDisplay(None)
    if display:
        xlib.XCloseDisplay(ctypes.c_void_p(display))
    return bool(display)


def excerpt(log: str) -> str:
    """The lines of a log with errors, else its last ones; indented, without colours."""
    plain = re.sub('\033(\\[[0-9;]*m|\\][^\007]*\007)', '', log)
    lines = [line.rstrip() for line in plain.splitlines() if line.strip()]
    errors = [line for line in lines if re.search('error|fatal|has died', line, re.IGNORECASE)]
    return ''.join(f'  {line}\n' for line in (errors or lines)[-EXCERPT_LINES:])


def install(display: Display) -> None:
    """Installs what is missing; sudo may ask for the password on the terminal."""
    # In this session and process group, as otherwise sudo cannot read from the terminal.
    process = subprocess.Popen([os.path.join(REPOSITORY, 'scripts', 'setup')],
                               stdout=subprocess.PIPE, universal_newlines=True, errors='replace')
    try:
        show_output(process, display)
    finally:
        process.communicate()  # apt is not to be stopped halfway
    if process.returncode != 0:
        raise DemoError('the installation failed: see the message above, then start again')


def build(display: Display) -> None:
    """Builds the package; the output of the compiler goes to a file."""
    os.makedirs(WORKSPACE, exist_ok=True)
    log_path = os.path.join(WORKSPACE, 'demo_build.log')
    process = subprocess.Popen([os.path.join(REPOSITORY, 'scripts', 'build')],
                               stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, universal_newlines=True, errors='replace',
                               start_new_session=True)
    try:
        with open(log_path, 'w', encoding='utf-8') as log:
            show_output(process, display, log)
        process.wait()
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
            process.communicate()
    if process.returncode != 0:
        with open(log_path, encoding='utf-8') as log:
            complain(excerpt(log.read()))
        raise DemoError(f'the build failed: see {log_path}')


def show_output(process: Any, display: Display, log: Any = None) -> None:
    """Shows the lines of a process's output as they come, paths shortened, and keeps them."""
    for line in process.stdout:
        if log:
            log.write(line)
        text = re.sub(r'\S*/(?=\S)', '', line.strip())
        if re.search(r'\w', text):
            display.show(text)


def enter_workspace() -> None:
    """Sets the environment of the workspace in this process."""
    script = 'load() { source "$0"; }; load >&2 && exec env --null'
    command = ['bash', '-c', script, os.path.join(WORKSPACE, 'devel', 'setup.bash')]
    result = subprocess.run(command, stdout=subprocess.PIPE, check=True)
    for item in result.stdout.decode(errors='surrogateescape').split('\0'):
        name, _, value = item.partition('=')
        if name:
            os.environ[name] = value
    sys.path[1:1] = [path for path in os.environ.get('PYTHONPATH', '').split(':') if path]


def run_scenes(options: argparse.Namespace, display: Display, scratch: str) -> List[str]:
    """Drives and reports; returns the problems. `scratch` is for incomplete files."""
    # Can be imported only now, after the installation.
    import _demo_drive as drive
    import _demo_report as report
    new = os.path.join(scratch, 'results')
    os.mkdir(new)
    results: Dict[str, Any] = {}
    problems: List[str] = []

    def run_scene(scene: str, graph: Any) -> None:
        frames = options.frames or (0 if options.rviz else FRAMES[scene])
        display.step(f'Driving: {scene}' + (f', {frames} frames' if frames else ''))
        request = drive.Drive(scene, options.seed, frames, options.rviz)
        try:
            summary = graph.drive(request, display.show)
            results[scene] = report.report_scene(scene, frames, graph.bag(scene), new)
            display.say(summary)
            found = report.find_problems(results[scene])
        except report.SceneError as error:
            found = [str(error)]
        if found:
            log = graph.log(scene)
            display.say(f'{scene} failed; from its log:\n{excerpt(log)}')
            problems.append(f'{scene}: {", ".join(found)}; see {keep_log(scene, log)}')

    try:
        with drive.Graph(scratch) as graph:
            for scene in options.scenes:
                run_scene(scene, graph)
    except report.SceneError as error:
        raise DemoError(str(error))
    display.step('Results')
    if results:
        report.write_summaries(results, new)
        ignore_signals()
        publish(new, options.output, report.file_names(list(FRAMES)))
        print('\n' + report.format_table(results), flush=True)
        print('\nNext, look at ' + os.path.join(options.output, 'overview.png')
              + ('.' if options.rviz else '; scripts/demo --rviz shows a drive live.'), flush=True)
    return problems


def keep_log(scene: str, text: str) -> str:
    """Keeps the log of a scene that failed; returns the path of the file."""
    path = os.path.join(WORKSPACE, f'demo_{scene}.log')
    with open(path, 'w', encoding='utf-8') as log:
        log.write(text)
    return path


def publish(source: str, target: str, names: List[str]) -> None:
    """Copies the files of a folder to another one, where they replace those of an earlier demo:
    `names` are all that a demo may write."""
    os.makedirs(target, exist_ok=True)
    for name in names:
        path = os.path.join(target, name)
        if os.path.exists(os.path.join(source, name)):
            shutil.copyfile(os.path.join(source, name), path + '.part')
            os.replace(path + '.part', path)
        elif os.path.exists(path):
            os.remove(path)


def run(options: argparse.Namespace) -> int:
    """Exit code 0, or 1 if something went wrong with a scene."""
    check_options(options)
    display = Display(3 + len(options.scenes))
    display.step('Installing what is missing')
    install(display)
    display.step('Building; the first time takes some minutes')
    build(display)
    enter_workspace()
    with tempfile.TemporaryDirectory(prefix='point_line_odometry_demo_') as scratch:
        problems = run_scenes(options, display, scratch)
    for problem in problems:
        complain(f'demo: {problem}')
    print(f'The demo took {display.elapsed()} minutes.')
    return 1 if problems else 0


def ignore_signals() -> None:
    """Ignores signals from now on, while the demo is ending."""
    for number in END_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def interrupt(*_: Any) -> NoReturn:
    """Ends the demo in an orderly way."""
    raise KeyboardInterrupt


def complain(text: str) -> None:
    """Prints on stderr, after what may be left of a line that the terminal rewrites."""
    if sys.stdout.isatty():
        sys.stdout.write('\r\033[K')
        sys.stdout.flush()
    print(text, file=sys.stderr)


def main(arguments: Optional[List[str]] = None) -> int:
    """Exit code as in EPILOG; 2 comes with one sentence on stderr."""
    options = parse_arguments(arguments)
    for number in END_SIGNALS:
        signal.signal(number, interrupt)
    try:
        return run(options)
    except DemoError as error:
        complain(f'demo: {error}')
        return 2
    except OSError as error:
        complain(f'demo: {error.filename or options.output}: {error.strerror}; make room or get '
                 'the right to write there, then start again')
        return 2
    except KeyboardInterrupt:
        complain('demo: interrupted; everything is stopped and nothing was written')
        return 130


if __name__ == '__main__':
    sys.exit(main())
