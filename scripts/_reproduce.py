#!/usr/bin/python3 -B
"""Runs the odometry over KITTI and EuRoC sequences, with the paper's method and with this package's
own, and compares errors and times with each other and with published ones: report.md with the
paper's tables and figures, and results.csv.

A run that was interrupted goes on where it was when it is started again. GNU parallel runs the
sequences, here or on several machines.
"""
# Only the standard library here: the rest is installed by scripts/build.
import argparse
import base64
import fcntl
import io
import json
import os
import re
import select
import shlex
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
import xml.etree.ElementTree as ElementTree
import zlib
from typing import Any, Dict, IO, Iterator, List, NamedTuple, Optional

from _sequences import (LAYOUTS, METHODS, REPORT_FILES, RESULT_FILES, RESULT_MARK, SCRIPTS,
                        InputError, Sequence, Task, count_frames, find_ground_truth, fingerprint,
                        is_whole, layout_of, load_figures, program_fingerprint, read_json,
                        result_folder, write_text)
from _workspace import script_workspace

REPOSITORY = os.path.dirname(SCRIPTS)
SEARCH_DEPTH = 3
TIMEOUT_S = 60.0
PARALLEL = ('parallel', '--plain', '--will-cite')
TEST_SEQUENCE = re.compile('1[1-9]|2[01]')  # of KITTI; their ground truth is not public
SSH = ('setpriv --pdeathsig TERM ssh -o BatchMode=yes -o ConnectTimeout=10 '
       '-o ServerAliveInterval=10 -o ServerAliveCountMax=3')

EPILOG = """\
KITTI_DIR: the odometry data set (sequences/00 ... 10, poses/00.txt ...). EUROC_DIR: the folders
MH_01_easy ... V2_03_difficult, each with mav0. Instead of either: one sequence, any folder that
has sequences of that kind inside, or - for none.

METHOD: 'paper' is the method of the paper (config/paper.yaml), 'default' this package with its
default parameters. With both, every table and figure has both; a method that is run later into the
same folder is added to the one before.

Output folder: report.md (tables and figures), results.csv, figure_5.png ... figure_9.png,
residuals.png, segment_errors.png; sequences/NAME/METHOD: trajectory.tum, trajectory.kitti,
frames.csv, summary.json, evaluation.json, report.html, images; joblog: what GNU parallel ran when and where.
Sequences with a result are not run again; those with problems are. scripts/report_sequences DIR
makes the report again, at any time.

--hosts FILE names machines, one a line, as GNU parallel's --sshloginfile does:

    2/alice@fast.example.org     two sequences at a time on that machine
    alice@large.example.org      as many as it has cores; needs GNU parallel there as well
    1/:                          one at a time on this machine

Each must let you in by ssh without a password, and have the data and the package, built, at the
same paths as here (a shared folder is the simplest); another build is refused. The sequences of a
machine that is down or goes down are given to the others.

Environment: POINT_LINE_ODOMETRY_BIN, the folder of offline_odometry to use with --no-build.
Exit code: 0 all is well, 1 some sequences had problems (the report says which), 2 nothing could be
run, 130 interrupted.
"""


class Run(NamedTuple):
    """What the results depend on, the folder of the programs, and where the results go."""
    output: str
    settings: Dict[str, Any]
    programs: str


def parse_arguments(arguments: Optional[List[str]]) -> argparse.Namespace:
    """The command line."""
    def positive(text: str) -> int:
        if not text.isdigit() or int(text) < 1:
            raise argparse.ArgumentTypeError('give a number from 1')
        return int(text)

    parser = argparse.ArgumentParser(prog='reproduce', description=__doc__, epilog=EPILOG,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('kitti', metavar='KITTI_DIR', help="folder with KITTI sequences, or '-'")
    parser.add_argument('euroc', metavar='EUROC_DIR', help="folder with EuRoC sequences, or '-'")
    parser.add_argument('--method', choices=(*METHODS, 'both'), default='both',
                        help='what to run (default: %(default)s)')
    parser.add_argument('-o', '--output', metavar='DIR', default='reproduced',
                        help='folder for the results (default: ./%(default)s)')
    parser.add_argument('--jobs', metavar='N', type=positive,
                        help='sequences that run in parallel on a machine (default: as many as '
                             'it has cores); for true times per frame give 1')
    parser.add_argument('--hosts', metavar='FILE', help='spread the sequences over the machines '
                                                        'named in this file, see below')
    for layout in LAYOUTS:
        name = layout.lower()
        parser.add_argument(f'--{name}-config', metavar='FILE', dest=f'{layout}_config',
                            help=f"parameters of the method 'default' for {layout} (default: "
                                 f'config/{name}.yaml)')
    parser.add_argument('--fresh', action='store_true',
                        help='discard the results in the output folder, and start again')
    parser.add_argument('--no-build', action='store_true',
                        help='use the programs as they are, without scripts/build')
    options = parser.parse_args(arguments)
    if options.method == 'paper' and (options.KITTI_config or options.EuRoC_config):
        parser.error("--kitti-config and --euroc-config are for the method 'default'")
    options.methods = METHODS if options.method == 'both' else (options.method,)
    return options


def config_file(options: argparse.Namespace, method: str, layout: str) -> str:
    """The file with the parameters of a method."""
    given = getattr(options, f'{layout}_config') if method == 'default' else None
    name = layout.lower() if method == 'default' else method
    return os.path.abspath(given or os.path.join(REPOSITORY, 'config', f'{name}.yaml'))


def name_of(folder: str) -> str:
    """The name that a sequence goes by: that of its folder."""
    path = os.path.abspath(folder)
    return os.path.basename(os.path.dirname(path) if os.path.basename(path) == 'mav0' else path)


def search(folder: str, layout: str, depth: int = SEARCH_DEPTH) -> Iterator[Sequence]:
    """The sequences of a layout that a folder is or holds, some levels down, sorted by path."""
    found = layout_of(folder)
    if found:
        if found == layout:
            yield Sequence(name_of(folder), os.path.abspath(folder), layout)
    elif depth > 0:
        try:
            with os.scandir(folder) as entries:
                inner = sorted(entry.path for entry in entries
                               if entry.is_dir() and not entry.name.startswith('.'))
        except PermissionError:
            print(f'left out, as it may not be read: {folder}')
            return
        for path in inner:
            yield from search(path, layout, depth - 1)


def has_ground_truth(sequence: Sequence) -> bool:
    """Whether its trajectory can be scored."""
    try:
        find_ground_truth(sequence.folder, sequence.layout)
    except InputError:
        return False
    return True


def find_sequences(options: argparse.Namespace) -> List[Sequence]:
    """The sequences in both folders of the command line; InputError if there are none."""
    found: List[Sequence] = []
    for layout, folder in zip(LAYOUTS, (options.kitti, options.euroc)):
        if folder == '-':
            continue
        if not os.path.isdir(folder):
            raise InputError(f"folder {folder} does not exist: give the folder of the {layout} "
                             "data set, or '-'")
        inside = list(search(folder, layout))
        closed = [each for each in inside if layout == 'KITTI'
                  and TEST_SEQUENCE.fullmatch(each.name) and not has_ground_truth(each)]
        if closed:
            print(f'left out, as their ground truth is not public: KITTI '
                  f'{", ".join(each.name for each in closed)}')
        found += [each for each in inside if each not in closed]
        if not inside:
            print(f'no {layout} sequence in {folder}')
    if not found:
        raise InputError("no sequence found: KITTI's folders have image_0, image_1, calib.txt and "
                         "times.txt, EuRoC's have mav0; give the folders that hold them")
    by_name: Dict[str, str] = {}
    for each in found:
        other = by_name.setdefault(each.name, each.folder)
        if other != each.folder:
            raise InputError(f'two sequences have the name {each.name}: {other} and {each.folder}; '
                             'run them into different folders with -o')
    return found


def check_parallel() -> None:
    """Raises InputError unless the parallel in PATH is GNU's."""
    try:
        text = subprocess.run(['parallel', '--version'], stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              universal_newlines=True).stdout
    except OSError:
        text = ''
    if not text.startswith('GNU parallel'):
        raise InputError('GNU parallel is missing: install it, e.g. apt-get install parallel')


def prepare_programs(options: argparse.Namespace) -> str:
    """Builds the package unless told not to; the folder of its programs."""
    built = os.path.join(script_workspace(), 'devel', 'lib', 'point_line_odometry')
    if options.no_build:
        return os.path.abspath(os.environ.get('POINT_LINE_ODOMETRY_BIN', built))
    if subprocess.run([os.path.join(SCRIPTS, 'build')]).returncode != 0:
        raise InputError('the package could not be built: see the messages above')
    return built


def make_settings(options: argparse.Namespace, sequences: List[Sequence],
                  programs: str) -> Dict[str, Any]:
    """What the results depend on, as in settings.json."""
    version = ElementTree.parse(os.path.join(REPOSITORY, 'package.xml')).findtext('version')
    layouts = sorted({each.layout for each in sequences})

    def describe_config(method: str, layout: str) -> Dict[str, str]:
        path = config_file(options, method, layout)
        return {'file': path, 'fingerprint': fingerprint([path])}
    return {'version': version, 'program': program_fingerprint(programs),
            'configurations': {method: {layout: describe_config(method, layout)
                                        for layout in layouts} for method in options.methods},
            'sequences': {each.name: {'folder': each.folder, 'layout': each.layout,
                                      'methods': list(options.methods)} for each in sequences}}


def find_difference(old: Dict[str, Any], new: Dict[str, Any]) -> Optional[str]:
    """The difference between the settings of older results and the current ones; None if none."""
    if old.get('program') != new['program']:
        return 'another build of the programs'
    for method, layouts in new['configurations'].items():
        for layout, now in layouts.items():
            before = old['configurations'].get(method, {}).get(layout, now)
            if before['fingerprint'] != now['fingerprint']:
                return (f"other parameters of the method '{method}' for {layout} "
                        f'({before["file"]}, since changed or replaced)')
    for name, now in new['sequences'].items():
        before = old['sequences'].get(name, now)
        if any(before[key] != now[key] for key in ('folder', 'layout')):
            return f'another sequence {name} ({before["folder"]})'
    return None


def merge_settings(old: Dict[str, Any], new: Dict[str, Any]) -> Dict[str, Any]:
    """The new settings with what only the old ones name."""
    configurations = {**old.get('configurations', {})}
    for method, layouts in new['configurations'].items():
        configurations[method] = {**configurations.get(method, {}), **layouts}
    sequences = {**old.get('sequences', {})}
    for name, now in new['sequences'].items():
        methods = {*sequences.get(name, now)['methods'], *now['methods']}
        sequences[name] = {**now, 'methods': [each for each in METHODS if each in methods]}
    return {**new, 'configurations': configurations, 'sequences': sequences}


def lock(output: str) -> IO[str]:
    """Makes the output folder ours as long as this process lives."""
    try:
        os.makedirs(output, exist_ok=True)
        stream = open(os.path.join(output, '.lock'), 'w')
    except OSError as error:
        raise InputError(f'cannot write into {output}: {error.strerror}; give a folder with -o '
                         'where you may write')
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        raise InputError(f'another run writes into {output}: wait for its end, or give another '
                         'folder with -o')
    return stream


def remove_results(output: str) -> None:
    """Removes the results of a run; the settings last, as they mark the folder as ours."""
    shutil.rmtree(os.path.join(output, 'sequences'), ignore_errors=True)
    for name in (*REPORT_FILES, 'joblog', '.joblog.part', '.hosts', 'settings.json'):
        if os.path.exists(os.path.join(output, name)):
            os.remove(os.path.join(output, name))


def open_output(run: Run, fresh: bool) -> None:
    """Prepares the output folder; InputError if what it has does not fit to this run."""
    path = os.path.join(run.output, 'settings.json')
    old = read_json(path)
    if not old and set(os.listdir(run.output)) - {'.lock', 'settings.json.part'}:
        raise InputError(f'{run.output} has files, but was not made by this script: give another '
                         'folder with -o')
    if fresh and old:
        remove_results(run.output)
        old = {}
    difference = find_difference(old, run.settings) if old else None
    if difference:
        raise InputError(f'the results in {run.output} are of {difference}: start again with '
                         '--fresh, or give another folder with -o')
    merged = merge_settings(old, run.settings)
    write_text(path, json.dumps(merged, indent=2, sort_keys=True) + '\n')
    os.makedirs(os.path.join(run.output, 'sequences'), exist_ok=True)
    for name in os.listdir(os.path.join(run.output, 'sequences')):
        if name.endswith('.part'):
            shutil.rmtree(os.path.join(run.output, 'sequences', name))
    keep_joblog(run.output)


def keep_joblog(output: str) -> None:
    """Appends the lines of the latest start's joblog to those of the starts before."""
    latest, path = os.path.join(output, '.joblog.part'), os.path.join(output, 'joblog')
    if not os.path.exists(latest):
        return
    with open(latest, encoding='utf-8') as stream:
        lines = [line for line in stream if line.endswith('\n')]
    if os.path.exists(path):
        with open(path, encoding='utf-8') as stream:
            lines = stream.readlines() + lines[1:]
    write_text(path, ''.join(lines))
    os.remove(latest)


def task_arguments(run: Run, task: Task) -> List[str]:
    """Arguments of run_sequence: name, method, folder, parameters, and their fingerprint."""
    config = run.settings['configurations'][task.method][task.sequence.layout]
    return [task.sequence.name, task.method, task.sequence.folder, config['file'],
            config['fingerprint']]


def job(run: Run, arguments: List[str], *options: str) -> str:
    """The command for the shell that runs a sequence; the arguments must be quoted already."""
    programs = ['--programs', run.programs, '--program-fingerprint', run.settings['program']]
    script = shlex.quote(os.path.join(SCRIPTS, 'run_sequence'))
    return ' '.join([script, *arguments, *map(shlex.quote, programs), *options])


def read_hosts(path: str) -> List[str]:
    """The machines that the file names, one a line; InputError if none."""
    try:
        with open(path, encoding='utf-8', errors='replace') as stream:
            lines = [line.strip() for line in stream]
    except OSError as error:
        raise InputError(f'cannot read {path}: {error.strerror}; check --hosts')
    hosts = [line for line in lines if line and not line.startswith('#')]
    if not hosts:
        raise InputError(f'{path} names no machine: write one a line, see --help')
    return hosts


def find_usable(run: Run, hosts: List[str], task: Task) -> List[str]:
    """The machines that answer and can do the task; prints why the others cannot."""
    command = [*PARALLEL, '--nonall', '--sshloginfile', '-', '--ssh', SSH,
               job(run, list(map(shlex.quote, task_arguments(run, task))), '--check')]
    checks = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, universal_newlines=True)
              for _ in hosts]
    usable = []
    for host, check in zip(hosts, checks):
        answer = check.communicate(host + '\n')[0].strip()
        if check.returncode == 0:
            usable.append(host)
        else:
            print(f'machine {host} is left out: {answer or "it does not answer"}', flush=True)
    if not usable:
        raise InputError('none of the machines can be used: correct the problems above, then start '
                         'again')
    return usable


def make_command(run: Run, options: argparse.Namespace, todo: List[Task]) -> List[str]:
    """GNU parallel's command line; it reads the tasks, every argument ended by a 0."""
    places = [f'{{{i}}}' for i in range(1, 1 + len(task_arguments(run, todo[0])))]
    command = ['setpriv', '--pdeathsig', 'INT', *PARALLEL, '--null', '--max-args',
               str(len(places)), '--joblog', os.path.join(run.output, '.joblog.part')]
    if options.jobs:
        command += ['--jobs', str(options.jobs)]
    if options.hosts:
        hosts = find_usable(run, read_hosts(options.hosts), todo[0])
        path = os.path.join(run.output, '.hosts')
        write_text(path, '\n'.join(hosts) + '\n')
        # Jobs that fail on a machine that has gone down are tried on every other one.
        command += ['--sshloginfile', path, '--ssh', SSH, '--retries', str(1 + len(hosts))]
    return [*command, job(run, places)]


def read_lines(stream: IO[bytes]) -> Iterator[Optional[bytes]]:
    """Lines as they arrive, and None after each timeout."""
    pending = b''
    while True:
        if not select.select([stream], [], [], TIMEOUT_S)[0]:
            yield None
            continue
        block = os.read(stream.fileno(), 1 << 20)
        if not block:
            return
        *lines, pending = (pending + block).split(b'\n')
        yield from lines


def flush_to_disk(path: str) -> None:
    """Waits until a file or folder is on the disk, so that it outlives a power cut."""
    descriptor = os.open(path, os.O_RDONLY)
    os.fsync(descriptor)
    os.close(descriptor)


def unpack(line: bytes) -> Dict[str, bytes]:
    """The files of a result that a job has printed; none if the line is something else."""
    files: Dict[str, bytes] = {}
    if line.startswith(RESULT_MARK.encode()):
        try:
            packed = io.BytesIO(base64.b64decode(line[len(RESULT_MARK):]))
            with tarfile.open(fileobj=packed, mode='r:gz') as archive:
                for member in archive:
                    content = archive.extractfile(member)
                    if content and member.name in RESULT_FILES:
                        files[member.name] = content.read()
        except (ValueError, EOFError, zlib.error, OSError, tarfile.TarError):
            print('a result came damaged: its sequence is run again at the next start')
            return {}
    return files


def store(run: Run, files: Dict[str, bytes]) -> Optional[Dict[str, Any]]:
    """Puts the files of a result into its folder, all at once; its sequence.json, None if the files
    are not of a sequence of this run."""
    if not files:
        return None
    temporary = os.path.join(run.output, 'sequences', f'{os.getpid()}.part')
    shutil.rmtree(temporary, ignore_errors=True)
    os.mkdir(temporary)
    for name, content in files.items():
        with open(os.path.join(temporary, name), 'wb') as stream:
            stream.write(content)
        flush_to_disk(stream.name)
    record = read_json(os.path.join(temporary, 'sequence.json'))
    if (record.get('name') not in run.settings['sequences']
            or record.get('method') not in run.settings['configurations']):
        shutil.rmtree(temporary)
        return None
    flush_to_disk(temporary)
    folder = result_folder(run.output, record['name'], record['method'])
    os.makedirs(os.path.dirname(folder), exist_ok=True)
    shutil.rmtree(folder, ignore_errors=True)
    os.rename(temporary, folder)
    flush_to_disk(os.path.dirname(folder))
    return record


def describe(record: Dict[str, Any], folder: str) -> str:
    """The result of a sequence in a line."""
    begin = f'{record["name"]}, {record["method"]}, on {record["host"]}'
    if record['error'] is not None:
        return f'{begin}: {record["error"]}'
    figures = load_figures(folder)
    errors = [f'AT-RMSE {figures["ate_rmse"]:.4g} m']
    for span, prefix in (('100-800', ''), ('5-50', 'short_')):
        if figures[prefix + 'segments']:
            errors.insert(0, f'{figures[prefix + "t_rel"]:.2f} % and '
                             f'{figures[prefix + "r_rel"]:.2f} deg/100 m over {span} m')
            break
    return (f'{begin}: {", ".join(errors)}; {figures["frames"]} frames in {record["run_s"]:.0f} s, '
            f'{figures["time_ms"]:.0f} ms each')


def start_parallel(run: Run, options: argparse.Namespace, todo: List[Task]) -> Any:
    """GNU parallel at work on tasks; what the jobs print is to be read from its stdout."""
    command = make_command(run, options, todo)
    with tempfile.TemporaryFile() as tasks:
        for each in todo:
            tasks.write(b''.join(os.fsencode(argument) + b'\0'
                                 for argument in task_arguments(run, each)))
        tasks.seek(0)
        return subprocess.Popen(command, stdin=tasks, stdout=subprocess.PIPE,
                                env={**os.environ, 'PARALLEL_SHELL': '/bin/bash'})


def run_tasks(run: Run, options: argparse.Namespace, todo: List[Task]) -> None:
    """Does tasks with GNU parallel and stores what comes back, each as soon as it is done."""
    process = start_parallel(run, options, todo)
    begin, done = time.monotonic(), 0
    try:
        for line in read_lines(process.stdout):
            if line is None:
                minutes = (time.monotonic() - begin) / 60
                print(f'... {done} of {len(todo)} done after {minutes:.0f} min', flush=True)
                continue
            record = store(run, unpack(line))
            if record:
                done += 1
                folder = result_folder(run.output, record['name'], record['method'])
                print(f'[{done}/{len(todo)}] {describe(record, folder)}', flush=True)
    finally:
        # On SIGTERM it ends its jobs here and on the other machines.
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait()
        keep_joblog(run.output)


def make_report(output: str) -> None:
    """Makes the report from what is in the output folder."""
    print('report: ', end='', flush=True)
    if subprocess.run([os.path.join(SCRIPTS, 'report_sequences'), output]).returncode != 0:
        raise InputError('the report could not be made: see the message above; then start again')


def reproduce(options: argparse.Namespace) -> int:
    """Exit code 0, or 1 if sequences had problems. InputError if nothing can be run."""
    sequences = find_sequences(options)
    fingerprint([config_file(options, method, layout)
                 for method in options.methods for layout in LAYOUTS])
    if options.hosts:
        read_hosts(options.hosts)
    programs = prepare_programs(options)
    check_parallel()
    settings = make_settings(options, sequences, programs)
    run = Run(os.path.abspath(options.output), settings, programs)
    with lock(run.output):
        open_output(run, options.fresh)

        tasks = [Task(each, method) for each in sequences for method in options.methods]

        def is_done(task: Task) -> bool:
            return is_whole(result_folder(run.output, task.sequence.name, task.method))
        todo = [each for each in tasks if not is_done(each)]
        todo.sort(key=lambda each: count_frames(each.sequence.folder, each.sequence.layout),
                  reverse=True)
        print(f'runs: {len(tasks)}, done before: {len(tasks) - len(todo)}', flush=True)
        if todo:
            run_tasks(run, options, todo)
        make_report(run.output)
        problems = [f'{each.sequence.name} ({each.method})' for each in tasks if not is_done(each)]
        if problems:
            print(f'problems with {", ".join(problems)}: see the report')
    return 1 if problems else 0


def main(arguments: Optional[List[str]] = None) -> int:
    """Exit code as in EPILOG; 2 comes with one sentence on stderr."""
    options = parse_arguments(arguments)

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt
    for number in (signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, interrupt)
    try:
        return reproduce(options)
    except InputError as error:
        print(f'reproduce: {error}', file=sys.stderr)
        return 2
    except OSError as error:
        print(f'reproduce: cannot write {error.filename or options.output}: {error.strerror}; '
              'make room, then start again: it goes on from here', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print('reproduce: interrupted; the same command goes on from here', file=sys.stderr)
        return 130


if __name__ == '__main__':
    sys.exit(main())
