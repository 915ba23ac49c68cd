"""The figures of the report that scripts/report_sequences makes, both methods next to each other."""
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from _report_results import Entry, Report, Result
from _sequences import load_script

page = load_script('report_run')

COLOURS = {'paper': 'tab:blue', 'default': 'tab:orange'}
PUBLISHED_COLOURS = ('0.35', '0.6', '0.8')
DPI = 130
IMAGE_DPI = 100
LEGEND = 0.4  # inches

# Axes of charts of errors: figures of whole sequences and of pieces, label.
WHOLE_ERRORS = (('t_rel', 'translation error [%]'), ('r_rel', 'rotation error [deg/100 m]'))
PIECE_ERRORS = tuple(('short_' + key, label) for key, label in WHOLE_ERRORS)


def new_figure(width: float, height: float, dpi: int = DPI) -> Any:
    """A figure of this size in inches."""
    # Matplotlib is imported only where it is used: it may print about its cache on import.
    from matplotlib.figure import Figure
    return Figure(figsize=(width, height), dpi=dpi, constrained_layout=True)


def colour_of(report: Report, method: str) -> str:
    """Blue for a single method, as in the paper."""
    return COLOURS[method] if len(report.methods) > 1 else 'tab:blue'


def draw_images(report: Report, layout: str) -> Optional[Any]:
    """Figures 5 and 8: the features on an image from the middle of each sequence, which has a row,
    and each method a column."""
    from matplotlib.image import imread
    entries = report.of_layout(layout)
    if not entries:
        return None
    images = {(entry.name, method): imread(entry.runs[method].image)
                for entry in entries for method in entry.runs}
    columns, width = len(report.methods), 7.0
    heights = [max(width * images[entry.name, method].shape[0]
                   / images[entry.name, method].shape[1] for method in entry.runs) + 0.35
               for entry in entries]
    figure = new_figure(width * columns, sum(heights), IMAGE_DPI)
    grid = figure.add_gridspec(len(entries), columns, height_ratios=heights)
    for row, entry in enumerate(entries):
        for column, method in enumerate(report.methods):
            if method not in entry.runs:
                continue
            axes = figure.add_subplot(grid[row, column])
            axes.imshow(images[entry.name, method], interpolation='bilinear')
            axes.set_title(f'{entry.name}, {method}', fontsize=9)
            axes.axis('off')
    return figure


def draw_trajectory(axes: Any, report: Report, entry: Entry) -> None:
    """The true trajectory and those of all methods in the ground truth's two widest axes."""
    for method, result in entry.runs.items():
        ground_truth = result.positions[:, :3]
        shown = sorted(np.argsort(-np.ptp(ground_truth, axis=0), kind='stable')[:2])
        axes.plot(*result.positions[:, 3:][:, shown].T, color=colour_of(report, method),
                  linewidth=1.4, label=f'estimate, {method}')
    axes.plot(*ground_truth[:, shown].T, 'k--', linewidth=1.0, label='ground truth')
    axes.set_aspect('equal', adjustable='datalim')
    axes.set_title(entry.name, fontsize=9)
    axes.set_xlabel(f'{"xyz"[shown[0]]} [m]', fontsize=8)
    axes.set_ylabel(f'{"xyz"[shown[1]]} [m]', fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(True, linewidth=0.4, alpha=0.5)


def draw_trajectories(report: Report, layout: str) -> Optional[Any]:
    """Figures 7 and 9: the trajectories of all sequences of a data set."""
    entries = report.of_layout(layout)
    if not entries:
        return None
    columns = min(len(entries), 4)
    rows = -(-len(entries) // columns)
    figure = new_figure(max(3.2 * columns, 5.0), 3.0 * rows + LEGEND)
    grid = figure.add_gridspec(rows + 1, columns, height_ratios=[3.0] * rows + [LEGEND])
    for index, entry in enumerate(entries):
        axes = figure.add_subplot(grid[index // columns, index % columns])
        draw_trajectory(axes, report, entry)
    add_legend(figure, grid[rows, :])
    return figure


def add_legend(figure: Any, cell: Any) -> None:
    """One legend for all axes, with each label once, in a cell of the grid."""
    found: Dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            found.setdefault(label, handle)
    axes = figure.add_subplot(cell)
    axes.axis('off')
    axes.legend(list(found.values()), list(found), loc='center', ncol=len(found), fontsize=9,
                frameon=False)


def chart_rows(report: Report) -> List[Tuple[str, List[Entry], Any]]:
    """Rows of figure 6: title, sequences and figures."""
    pieces = [each for each in report.of_layout('KITTI')
              if not each.is_benchmark and each.any_figure('short_segments')]
    rows = [('segments of 100-800 m', report.benchmark('KITTI'), WHOLE_ERRORS),
            ('pieces of sequences: segments of 5-50 m', pieces, PIECE_ERRORS)]
    return [row for row in rows if row[1]]


Series = Tuple[str, str, List[Any]]


def chart_series(report: Report, entries: List[Entry], key: str) -> List[Series]:
    """Name, colour and values of the bars of a chart."""
    series = [(method, colour_of(report, method), [each.figure(method, key) for each in entries])
              for method in report.methods]
    if not entries[0].is_benchmark:
        return series
    colours = iter(PUBLISHED_COLOURS)
    for system in report.published['KITTI']['systems']:
        values = [system.get('sequences', {}).get(each.name, {}).get(key) for each in entries]
        if any(value is not None for value in values):
            series.append((system['name'], next(colours, '0.9'), values))
    return series


def draw_bars(axes: Any, entries: List[Entry], series: List[Series]) -> None:
    """A group of bars for each sequence."""
    width = 0.8 / len(series)
    for index, (name, colour, values) in enumerate(series):
        places = np.arange(len(entries)) + (index - (len(series) - 1) / 2) * width
        heights = [0.0 if value is None else value for value in values]
        axes.bar(places, heights, width, color=colour, label=name)
    axes.set_xticks(range(len(entries)))
    is_long = any(len(each.name) > 4 for each in entries)
    axes.set_xticklabels([each.name for each in entries], fontsize=8,
                         rotation=20 if is_long else 0, ha='right' if is_long else 'center')
    axes.grid(True, axis='y', linewidth=0.5, alpha=0.5)


def draw_chart(report: Report) -> Optional[Any]:
    """Figure 6: the errors of each KITTI sequence as bars, those of both methods and of published
    systems next to each other, and the paper's mean as a line."""
    rows = chart_rows(report)
    if not rows:
        return None
    paper = next(each for each in report.published['KITTI']['systems'] if each.get('mean'))
    figure = new_figure(12.0, 3.6 * len(rows) + LEGEND)
    grid = figure.add_gridspec(len(rows) + 1, 2, height_ratios=[3.6] * len(rows) + [LEGEND])
    for row, (title, entries, errors) in enumerate(rows):
        for column, (key, label) in enumerate(errors):
            axes = figure.add_subplot(grid[row, column])
            draw_bars(axes, entries, chart_series(report, entries, key))
            if key in paper['mean'] and entries[0].is_benchmark:
                axes.axhline(paper['mean'][key], color='k', linestyle='--', linewidth=1.0,
                             label=f'{paper["name"]}, mean of all')
            axes.set_title(title, fontsize=9)
            axes.set_ylabel(label)
    add_legend(figure, grid[len(rows), :])
    return figure


def draw_lengths(axes: Any, lines: List[Tuple[str, Dict[str, Any], Result]], key: str) -> None:
    """Errors over segment length; lines are the sequences' names, styles and results."""
    for name, style, result in lines:
        rows = [row for row in result.per_length if row['segments']]
        axes.plot([row['length_m'] for row in rows], [row[key] for row in rows], marker='o',
                  markersize=3, linewidth=1.1, label=name, **style)
    lengths = sorted({row['length_m'] for _, _, result in lines for row in result.per_length
                      if row['segments']})
    axes.set_xscale('log')
    ticks = [length for length in lengths if length in (5, 10, 20, 50, 100, 200, 400, 800)]
    axes.minorticks_off()
    axes.set_xticks(ticks)
    axes.set_xticklabels([f'{length:g}' for length in ticks])
    axes.grid(True, linewidth=0.5, alpha=0.5)


def set_decades(axes: Any, values: List[float]) -> None:
    """A logarithmic y axis of whole decades, as one run that is lost has much larger errors."""
    exponents = np.log10([value for value in values if value > 0.0] or [1.0])
    axes.set_yscale('log')
    axes.set_ylim(10 ** np.floor(exponents.min()), 10 ** np.ceil(exponents.max() + 1e-9))


def draw_segment_errors(report: Report) -> Optional[Any]:
    """The errors over segment length, a row for a method; None without segments."""
    from matplotlib import cm
    styles = {entry.name: {'color': cm.tab20(index % 20), 'linestyle': '-' if index < 20 else '--'}
              for index, entry in enumerate(report.entries)}

    def lines_of(method: str) -> List[Tuple[str, Dict[str, Any], Result]]:
        results = [(entry.name, styles[entry.name], entry.runs[method])
                   for entry in report.entries if method in entry.runs]
        return [each for each in results if any(row['segments'] for row in each[2].per_length)]
    methods = [each for each in report.methods if lines_of(each)]
    if not methods:
        return None
    figure = new_figure(11.0, 3.9 * len(methods))
    grid = figure.add_gridspec(len(methods), 2)
    first: Dict[str, Any] = {}
    for row, method in enumerate(methods):
        for column, (key, label) in enumerate([('t_rel_percent', WHOLE_ERRORS[0][1]),
                                               ('r_rel_deg_per_100m', WHOLE_ERRORS[1][1])]):
            axes = figure.add_subplot(grid[row, column], sharey=first.get(key))
            first.setdefault(key, axes)
            draw_lengths(axes, lines_of(method), key)
            axes.set(xlabel='segment length [m]', ylabel=label)
            axes.set_title(method, fontsize=9)
        axes.legend(fontsize=7, loc='center left', bbox_to_anchor=(1.02, 0.5), frameon=False)
    for key, axes in first.items():
        set_decades(axes, [row[key] for _, result in report.results() for row in result.per_length
                           if row['segments']])
    return figure


def draw_residuals(report: Report) -> Optional[Any]:
    """The weighted residuals of all runs."""
    if not report.entries:
        return None
    methods = report.methods
    places = [(entry, method) for entry in report.entries for method in methods]
    columns = min(len(places), 4)
    rows = -(-len(places) // columns)
    figure = new_figure(3.2 * columns + 0.3, 2.4 * rows + 0.4)
    grid = figure.add_gridspec(rows, columns)
    for index, (entry, method) in enumerate(places):
        if method not in entry.runs:
            continue
        axes = figure.add_subplot(grid[index // columns, index % columns])
        page.draw_residuals(axes, entry.runs[method].residuals)
        axes.set_title(f'{entry.name}, {method}', fontsize=9)
    return figure


def draw_all(report: Report) -> Dict[str, Optional[Any]]:
    """All figures by their files; None where there is nothing to draw."""
    return {'figure_5.png': draw_images(report, 'KITTI'), 'figure_6.png': draw_chart(report),
            'figure_7.png': draw_trajectories(report, 'KITTI'),
            'figure_8.png': draw_images(report, 'EuRoC'),
            'figure_9.png': draw_trajectories(report, 'EuRoC'),
            'segment_errors.png': draw_segment_errors(report),
            'residuals.png': draw_residuals(report)}
