"""Draws how the success of policies falls where they see badly, late or seldom, or the arm does not do what it is told.

    python examples/robustness.py outputs/peg_transfer --task PegTransfer
    python examples/robustness.py one=outputs/one/0 one=outputs/one/1 hundred=outputs/hundred/0 --task PegTransfer

Trainings that share a name are of one policy, whose success is their mean. One thing at a time gets worse. Episodes are
kept beside the checkpoints, so that none is run twice, and those that are drawn also beside the figure.
examples/studies.py draws the committed ones.
"""

import argparse
import sys
from collections.abc import Sequence
from itertools import cycle, product
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from lerobot_gcdt.benchmark.report import COLOURS
from lerobot_gcdt.evaluation import evaluate_checkpoint
from lerobot_gcdt.evaluation.statistics import trainings_interval
from lerobot_gcdt.evaluation.tasks import check_starts, tasks_of
from lerobot_gcdt.training import existing_checkpoint

IMPERFECTIONS: dict[str, tuple[str, Sequence[float]]] = {
    "position_std": ("noise of positions (su)", (0.0025, 0.005, 0.01, 0.02)),
    "angle_std": ("noise of angles (rad)", (0.001, 0.0025, 0.005, 0.01)),
    "action_std": ("noise of actions (full actions)", (0.05, 0.1, 0.2, 0.4)),
    "delay": ("delay (steps)", (1, 2, 4)),
    "dropout": ("missed readings (share)", (0.25, 0.5, 0.75)),
}
"""What gets worse, one of the ``sensors`` of ``evaluate``: what it is called in tables and figures, and its levels."""

POINT = ["imperfection", "level", "policy"]


def run(policies: list[tuple[str, Path]], task: str, seeds: range) -> pd.DataFrame:
    """Evaluates checkpoints, with the names of their policies, at every level of every imperfection and without any.

    Returns:
        A row an episode: ``POINT``, ``training`` (of the policy, from 0), ``task``, ``seed``, ``reached``, ``held`` and
        ``steps``. Level 0 of every imperfection holds the same episodes.
    """
    settings = [(name, level) for name, (_, levels) in IMPERFECTIONS.items() for level in (0, *levels)]
    found, names = [], [policy for policy, _ in policies]
    for (place, (policy, checkpoint)), (name, level) in product(enumerate(policies), settings):
        file = checkpoint.parent / f"robustness/{name}_{level:g}.parquet" if level else None
        episodes = evaluate_checkpoint(checkpoint, [task], seeds, file=file, sensors={name: level})
        facts = {"imperfection": name, "level": float(level), "policy": policy, "training": names[:place].count(policy)}
        found.append(episodes.assign(**facts)[[*facts, "task", "seed", "reached", "held", "steps"]])
    return pd.concat(found, ignore_index=True)


def held_rates(episodes: pd.DataFrame) -> pd.DataFrame:
    """Returns the rate of ``held`` of each ``POINT``, with the bounds of its interval, ``low`` and ``high``."""
    rows = []
    for point, rest in episodes.groupby(POINT, sort=False):
        each = rest.groupby("training").held.mean()
        rows.append((*point, each.mean(), *trainings_interval(each.tolist(), rest.seed.nunique())))
    return pd.DataFrame(rows, columns=[*POINT, "held", "low", "high"])


def table(rates: pd.DataFrame) -> str:
    """Writes rates as Markdown, a column a policy."""
    lines = [f"| imperfection | level | {' | '.join(rates.policy.unique())} |"]
    lines.append("| --- " * lines[0].count(" | ") + "| --- |")
    for (name, level), rows in rates.groupby(POINT[:2], sort=False):
        cells = [f"{row.held:.2f} ({row.low:.2f}-{row.high:.2f})" for row in rows.itertuples()]
        lines.append(f"| {IMPERFECTIONS[name][0]} | {level:g} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def plot(rates: pd.DataFrame, path: Path) -> None:
    """Draws rates: a panel an imperfection, a line a policy, a band for its interval."""
    figure = Figure(figsize=(1 + 3.2 * len(IMPERFECTIONS), 3.6), layout="constrained")
    panels = figure.subplots(1, len(IMPERFECTIONS), squeeze=False, sharey=True).flat
    for axes, (name, lines) in zip(panels, rates.groupby("imperfection", sort=False), strict=True):
        for colour, (policy, line) in zip(cycle(COLOURS), lines.groupby("policy", sort=False), strict=False):
            axes.plot(line.level, line.held, color=colour, marker="o", markersize=3, label=policy)
            axes.fill_between(line.level, line.low, line.high, color=colour, alpha=0.2, linewidth=0)
        axes.set(xlabel=IMPERFECTIONS[name][0], ylim=(-0.02, 1.02))
        axes.grid(alpha=0.3)
    figure.supylabel("held", fontsize=10)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=8, fontsize=9)
    figure.savefig(path, dpi=130)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="+", metavar="[NAME=]TRAINING", help="training of a policy")
    parser.add_argument("--task", required=True, help="name of the task")
    parser.add_argument("--starts", type=int, default=100, help="episodes of each level (default 100)")
    parser.add_argument("--first_seed", type=int, default=20_000, help="seed of the first start (default 20000)")
    parser.add_argument("--output", type=Path, default=Path("outputs/robustness"), help="folder of the figure")
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.starts)
    policies = []
    try:
        check_starts([options.task], seeds)
        for text in options.policies:
            name, _, training = text.partition("=")
            policies.append((name, existing_checkpoint(training or name).resolve()))
            tasks_of(policies[-1][1], [options.task])
        episodes = run(policies, options.task, seeds)
    except (ValueError, OSError) as error:
        sys.exit(str(error))
    options.output.mkdir(parents=True, exist_ok=True)
    episodes.to_parquet(options.output / "episodes.parquet")
    rates = held_rates(episodes)
    plot(rates, options.output / "robustness.png")
    print(f"{options.task}, held at the end, from {len(seeds)} starts:\n\n{table(rates)}\nAll is in {options.output}.")


if __name__ == "__main__":
    main()
