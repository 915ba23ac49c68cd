"""The data of the report of scripts/report_sequences: the results in an output folder of scripts/reproduce, by
sequence and method, and the published figures."""
import os
from typing import Any, Dict, List, NamedTuple, Tuple

import numpy as np
import yaml

from _sequences import (LAYOUTS, METHODS, SCRIPTS, InputError, is_whole, load_figures, read_json,
                        result_folder)

PUBLISHED = os.path.join(os.path.dirname(SCRIPTS), 'doc', 'published_results.yaml')
WHOLE_SHARE = 0.95  # of a sequence's frames; with fewer it is a piece


class Result(NamedTuple):
    """A run of a sequence with a method: its figures, sequence.json, errors over segment length,
    positions (n, 6) true and estimated [m], distributions of its weighted residuals, parameters,
    and the image of its features."""
    method: str
    figures: Dict[str, Any]
    record: Dict[str, Any]
    per_length: List[Dict[str, Any]]
    positions: np.ndarray
    residuals: Dict[str, Any]
    parameters: Dict[str, str]
    image: str


class Entry(NamedTuple):
    """A sequence with its results by method, and whether it is a whole one of the benchmark."""
    name: str
    layout: str
    runs: Dict[str, Result]
    is_benchmark: bool

    def figure(self, method: str, key: str) -> Any:
        """A figure of a method's run; None if there is no such run."""
        return self.runs[method].figures[key] if method in self.runs else None

    def any_figure(self, key: str) -> Any:
        """A figure that is the same for all methods."""
        return next(iter(self.runs.values())).figures[key]


class Report(NamedTuple):
    """All data of the report: sequences with results, methods that were run, problems (sequence,
    method, sentence), settings.json and the published figures."""
    entries: List[Entry]
    methods: List[str]
    problems: List[Tuple[str, str, str]]
    settings: Dict[str, Any]
    published: Dict[str, Any]

    def of_layout(self, layout: str) -> List[Entry]:
        """The sequences of a data set."""
        return [each for each in self.entries if each.layout == layout]

    def benchmark(self, layout: str) -> List[Entry]:
        """The whole sequences of a data set's benchmark."""
        return [each for each in self.of_layout(layout) if each.is_benchmark]

    def pieces(self) -> List[Entry]:
        """The sequences that are not, or not wholly, the benchmarks'."""
        return [each for each in self.entries if not each.is_benchmark]

    def results(self) -> List[Tuple[Entry, Result]]:
        """All results with their sequences."""
        return [(entry, result) for entry in self.entries for result in entry.runs.values()]


def read_published() -> Dict[str, Any]:
    """The published figures."""
    with open(PUBLISHED, encoding='utf-8') as stream:
        return yaml.safe_load(stream)


def read_result(method: str, folder: str) -> Result:
    """The complete result in a folder."""
    scores = read_json(os.path.join(folder, 'evaluation.json'))
    summary = read_json(os.path.join(folder, 'summary.json'))
    positions = np.loadtxt(os.path.join(folder, 'positions.csv'), delimiter=',', skiprows=1,
                           ndmin=2)
    return Result(method, load_figures(folder), read_json(os.path.join(folder, 'sequence.json')),
                  scores['short']['per_length'] + scores['kitti']['per_length'], positions,
                  summary['weighted_residuals'], summary['parameters'],
                  os.path.join(folder, 'features.png'))


def read_entry(output: str, name: str, setting: Dict[str, Any], published: Dict[str, Any],
               problems: List[Tuple[str, str, str]]) -> Entry:
    """A sequence with the results that are there; what is missing goes to the problems."""
    runs: Dict[str, Result] = {}
    for method in setting['methods']:
        folder = result_folder(output, name, method)
        if is_whole(folder):
            runs[method] = read_result(method, folder)
        else:
            error = read_json(os.path.join(folder, 'sequence.json')).get('error')
            problems.append((name, method, error or 'no result yet: start scripts/reproduce again'))
    frames = published[setting['layout']]['frames'].get(name)
    is_benchmark = frames is not None and all(
        each.figures['frames'] >= WHOLE_SHARE * frames for each in runs.values())
    return Entry(name, setting['layout'], runs, is_benchmark)


def read_report(output: str) -> Report:
    """The results in an output folder; InputError if it is not one."""
    settings = read_json(os.path.join(output, 'settings.json'))
    if not settings:
        raise InputError(f'{output} has no results: give an output folder of scripts/reproduce')
    published = read_published()
    problems: List[Tuple[str, str, str]] = []
    order = sorted(settings['sequences'].items(),
                   key=lambda item: (LAYOUTS.index(item[1]['layout']), item[0]))
    entries = [read_entry(output, name, setting, published, problems) for name, setting in order]
    entries = [each for each in entries if each.runs]
    methods = [each for each in METHODS if any(each in entry.runs for entry in entries)]
    return Report(entries, methods, problems, settings, published)


def describe_method(parameters: Dict[str, str]) -> str:
    """A short description of a configuration; parameters as in summary.json."""
    kinds = [kind for kind in ('points', 'lines') if parameters[kind + '/enabled'] == 'true']
    words = [' and '.join(kinds)]
    if parameters['window/size'] == '0':
        words.append('frame to frame')
        if parameters['motion/fuse_rotation'] != 'never':
            words.append('rotation fused')
    else:
        words.append(f'landmarks, window of {parameters["window/size"]} keyframes')
        if parameters['local_map/size'] != '0':
            words.append(f'local map of {parameters["local_map/size"]}')
    return ', '.join(words)


def describe_runs(report: Report, method: str, layout: str) -> str:
    """describe_method() of the configurations with which a method was run on a data set."""
    found = {describe_method(entry.runs[method].parameters)
             for entry in report.of_layout(layout) if method in entry.runs}
    return '; '.join(sorted(found))
