"""The tables and the figures of a benchmark of learning, from its episodes."""

from collections.abc import Sequence
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure  # without pyplot: the backend of a notebook or a script stays as it is
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

import surrol_gym
from lerobot_gcdt.evaluation.statistics import trainings_interval
from surrol_gym.wrappers import IDEAL

FIGURES = ("held", "reached")
POINT = ["task", "method", "demonstrations", "step"]
"""Columns that tell the points of trainings apart, where their seeds do not count; beside them those of ``IDEAL``."""

COLOURS = (
    *("#24557a", "#c0392b", "#1a7f5a", "#b8860b", "#6c3483", "#566573", "#ca6f9e", "#17202a"),
    *("#e67e22", "#48c9b0", "#8fbce6", "#7e5109"),
)

ROW = 16
"""Width of a row of bars at most, inches."""


def write_report(episodes: pd.DataFrame, output: Path) -> None:
    """Writes ``success.md``, ``success.tex``, ``success.png`` and ``bars.png`` into a folder.

    Where a method learned from several numbers of demonstrations, ``demonstrations.png`` shows them; the others but the
    first are of the largest number.

    Args:
        episodes: What ``lerobot_gcdt.benchmark.learning.Benchmark.run`` returns.
        output: The folder.
    """
    rates = success_rates(episodes)
    most = rates[rates.demonstrations == rates.groupby(["task", "method"]).demonstrations.transform("max")]
    (output / "success.md").write_text(success_table(rates))
    (output / "success.tex").write_text(success_latex(most))
    plot_success(most, output / "success.png")
    plot_bars(most, output / "bars.png")
    if len(most) < len(rates):
        plot_demonstrations(rates, output / "demonstrations.png")


def success_rates(episodes: pd.DataFrame) -> pd.DataFrame:
    """Computes success rates with 95 % intervals (``lerobot_gcdt.evaluation.statistics.trainings_interval``).

    Args:
        episodes: What ``lerobot_gcdt.benchmark.learning.Benchmark.run`` returns.

    Returns:
        A row for each ``task``, ``method``, number of ``demonstrations``, ``step`` and setting of imperfect sensors:
        number of ``trainings`` and of ``starts`` (the fewest of a training), mean ``seconds``, and ``held`` and
        ``reached``, means over the trainings, with the bounds ``held_low``, ``held_high``, ``reached_low`` and
        ``reached_high``.
    """
    rows = []
    columns = [*POINT, *sensor_columns(episodes)]
    for key, point in episodes.groupby(columns, sort=False):
        trainings = point.groupby("training_seed")
        starts = int(trainings.size().min())
        row = dict(zip(columns, key, strict=True)) | {"trainings": len(trainings), "starts": starts}
        row["seconds"] = trainings.seconds.first().mean()
        for figure in FIGURES:
            each = trainings[figure].mean()
            row[figure] = each.mean()
            row[f"{figure}_low"], row[f"{figure}_high"] = trainings_interval(each.tolist(), starts)
        rows.append(row)
    return pd.DataFrame(rows)


def in_order(episodes: pd.DataFrame, methods: Sequence[str]) -> pd.DataFrame:
    """Sorts episodes by task, in the usual order, and method, so that tables and figures have that order.

    Args:
        episodes: As ``success_rates`` takes them.
        methods: The methods in their order.
    """
    places = {"task": list(surrol_gym.TASKS), "method": list(methods)}
    return episodes.sort_values([*places], kind="stable", key=lambda column: column.map(places[column.name].index))


def at_the_end(rates: pd.DataFrame) -> pd.DataFrame:
    """Takes the last point of each task, method, number of demonstrations and setting of sensors, in their order.

    Args:
        rates: As ``success_rates`` returns them.
    """
    return rates.loc[rates.groupby([*POINT[:-1], *sensor_columns(rates)], sort=False).step.idxmax()]


def sensor_columns(rows: pd.DataFrame) -> list[str]:
    """Returns the columns that tell settings of imperfect sensors, which episodes of perfect ones do not have.

    Args:
        rows: Episodes or rates.
    """
    return [name for name in IDEAL if name in rows]


def success_table(rates: pd.DataFrame) -> str:
    """Returns the success at the end of the trainings as Markdown.

    Args:
        rates: As ``success_rates`` returns them.
    """
    imperfect = [name for name in sensor_columns(rates) if (rates[name] != IDEAL[name]).any()]
    names = ["task", "method", *imperfect, "demonstrations", "trainings", "starts", "steps", "seconds", *FIGURES[::-1]]
    lines = [f"| {' | '.join(names)} |", "|" + " --- |" * len(names)]
    for end in at_the_end(rates).to_dict("records"):
        counts = " | ".join(f"{end[name]:g}" for name in (*imperfect, "demonstrations", "trainings", "starts", "step"))
        success = " | ".join(
            f"{end[figure]:.2f} ({end[f'{figure}_low']:.2f}-{end[f'{figure}_high']:.2f})"
            for figure in ("reached", "held")
        )
        lines.append(f"| {end['task']} | {end['method']} | {counts} | {end['seconds']:.0f} | {success} |")
    return "\n".join(lines) + "\n"


def success_latex(rates: pd.DataFrame) -> str:
    """Returns the success at the end of the trainings as a LaTeX table (package booktabs): ``reached`` / ``held``.

    Args:
        rates: As ``success_rates`` returns them.
    """
    ends = at_the_end(rates)
    cells = ends.assign(cell=[f"{end.reached:.2f} / {end.held:.2f}" for end in ends.itertuples()])
    table = cells.pivot(index="task", columns="method", values="cell")
    table = table.loc[ends.task.unique(), ends.method.unique()].fillna("")
    return table.rename_axis(index=None, columns="reached / held").to_latex(escape=True)


def plot_bars(rates: pd.DataFrame, path: Path) -> None:
    """Plots the success at the end of the trainings: bars for ``held`` with their intervals, dots for ``reached``.

    Args:
        rates: As ``success_rates`` returns them.
        path: The PNG file to write.
    """
    ends = at_the_end(rates)
    tasks, methods = list(ends.task.unique()), list(ends.method.unique())
    of_a_task = 0.5 + 0.22 * len(methods)
    a_row = ceil(len(tasks) / ceil(len(tasks) * of_a_task / (ROW - 2)))
    begins = range(0, len(tasks), a_row)
    figure = Figure(figsize=(2 + a_row * of_a_task, 0.4 + 3.2 * len(begins)), layout="constrained")
    for axes, first in zip(figure.subplots(len(begins), squeeze=False).flat, begins, strict=True):
        _draw_bars(axes, ends, tasks[first : first + a_row], a_row, methods)
    _add_legend(figure)
    figure.savefig(path, dpi=130)


def _draw_bars(axes: Axes, ends: pd.DataFrame, tasks: list[str], places: int, methods: list[str]) -> None:
    """Draws the bars of some tasks, in a row that has places for so many."""
    width = 0.8 / len(methods)
    for i, method in enumerate(methods):
        of_method = ends[(ends.method == method) & ends.task.isin(tasks)]
        if of_method.empty:  # no bars, which would stand in the legend in another colour
            continue
        where = [tasks.index(task) + (i - (len(methods) - 1) / 2) * width for task in of_method.task]
        errors = np.array([of_method.held - of_method.held_low, of_method.held_high - of_method.held])
        errors = errors.clip(min=0)  # rounding makes -1e-16 of the 0 above a rate of 1
        colour = COLOURS[i % len(COLOURS)]
        axes.bar(where, of_method.held, 0.9 * width, yerr=errors, color=colour, ecolor="0.25", capsize=2, label=method)
        axes.plot(where, of_method.reached, "o", color="white", markeredgecolor="0.25", markersize=3)
    axes.set(xlim=(-0.6, places - 0.4), ylim=(0, 1.02), ylabel="success rate")
    axes.set_xticks(range(len(tasks)), tasks, rotation=25, ha="right")
    axes.grid(axis="y", alpha=0.3)
    axes.set_axisbelow(True)


def plot_success(rates: pd.DataFrame, path: Path) -> None:
    """Plots success against seconds of training, a panel a task: lines for ``held``, dashes for ``reached``.

    Args:
        rates: As ``success_rates`` returns them.
        path: The PNG file to write.
    """
    _plot_panels(rates, "seconds", "seconds of training (CPU time; wall time on a GPU)", path)


def plot_demonstrations(rates: pd.DataFrame, path: Path) -> None:
    """Plots success at the end of the trainings against the number of demonstrations, as ``plot_success`` does.

    Args:
        rates: As ``success_rates`` returns them.
        path: The PNG file to write.
    """
    _plot_panels(at_the_end(rates), "demonstrations", "demonstrations", path)


def plot_noise(rates: pd.DataFrame, path: Path) -> None:
    """Plots success at the end of the trainings against the noise of positions, as ``plot_success`` does.

    Args:
        rates: As ``success_rates`` returns them, of imperfect sensors.
        path: The PNG file to write.
    """
    _plot_panels(at_the_end(rates), "position_std", "noise of positions, standard deviation (su)", path, scale="linear")


def _plot_panels(rates: pd.DataFrame, column: str, label: str, path: Path, scale: str = "log") -> None:
    """Plots success against a column, a panel a task, a colour a method."""
    tasks = rates.task.unique()
    colours = {method: COLOURS[i % len(COLOURS)] for i, method in enumerate(rates.method.unique())}
    columns = min(len(tasks), 3)
    rows = ceil(len(tasks) / columns)
    figure = Figure(figsize=(1 + 4 * columns, 0.6 + 3.2 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).flat
    for task, axes in zip(tasks, panels, strict=False):
        for method, colour in colours.items():
            points = rates[(rates.task == task) & (rates.method == method)].sort_values(column)
            _draw(axes, points, column, method, colour)
        axes.set(title=task, xscale=scale, ylim=(-0.02, 1.02))
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)) if scale == "log" else MaxNLocator(5))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3)
    for axes in panels:  # left over
        axes.set_axis_off()
    figure.supxlabel(label, fontsize=10)
    figure.supylabel("success rate (held; dashes: reached)", fontsize=10)
    _add_legend(figure)
    figure.savefig(path, dpi=130)


def _add_legend(figure: Figure) -> None:
    """Adds a legend of all panels above them, in as many columns as find room."""
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    room = max(1, int(figure.get_figwidth() / (0.6 + 0.075 * max(map(len, handles)))))
    columns = ceil(len(handles) / ceil(len(handles) / room))
    figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=columns, fontsize=9)


def _draw(axes: Axes, points: pd.DataFrame, column: str, method: str, colour: str) -> None:
    where = points[column]
    level = len(points) and not where.any()  # of an expert, which did not learn
    for figure, dashes, strength in (("held", "-", 0.22), ("reached", "--", 0.1)):
        name = method if figure == "held" else f"_{method} {figure}"  # what begins like this is in no legend
        if level:
            axes.axhline(points[figure].item(), linestyle=dashes, color=colour, label=name)
            continue
        axes.plot(where, points[figure], dashes, color=colour, marker="o", markersize=3, label=name)
        low, high = points[f"{figure}_low"], points[f"{figure}_high"]
        axes.fill_between(where, low, high, color=colour, alpha=strength, linewidth=0)
