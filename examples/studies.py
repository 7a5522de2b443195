"""Draws the studies of the results from their committed episodes, examples/paper_table/STUDY.parquet.

    python examples/studies.py
    python examples/studies.py --add outputs/curves --study curves

curves: success against seconds of training.
demonstrations: success against the number of demonstrations.
memory: success against the noise of positions and angles that policies learned with, which grow together.
robustness: success against imperfections that policies did not learn with.

--add takes over all validation episodes of a benchmark (`gcdt benchmark` without --first_seed), or for robustness those
of examples/robustness.py, into the file first. Each study is a figure beside its file and a table in docs/results.md.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import robustness

from lerobot_gcdt.benchmark.report import (
    in_order,
    plot_demonstrations,
    plot_noise,
    plot_success,
    sensor_columns,
    success_rates,
    success_table,
)
from lerobot_gcdt.evaluation.checkpoints import keep_episodes
from lerobot_gcdt.hub.documents import write_section
from surrol_gym.wrappers import IDEAL

ROOT = Path(__file__).parent.parent
STUDIES, RESULTS = ROOT / "examples/paper_table", ROOT / "docs/results.md"
OF_SENSORS = ("memory",)
STARTS = range(20_000, 20_200)
KEY = ["task", "method", "demonstrations", "training_seed", "step", "seed"]
COLUMNS = [*KEY[:-1], "seconds", "seed", "reached", "held", "steps"]
OF_ROBUSTNESS = [*robustness.POINT, "training", "task", "seed"]


def rates_of(episodes: pd.DataFrame) -> pd.DataFrame:
    """Returns the success rates of a benchmark, tasks in their usual order, methods in that of their arrival."""
    methods, settings = [*episodes.method.unique()], [*sensor_columns(episodes), "demonstrations", "step"]
    return success_rates(in_order(episodes.sort_values(settings, kind="stable"), methods))


class Study(NamedTuple):
    """What a study shows: rates of its episodes, and a figure and a table of these rates."""

    plot: Callable[[pd.DataFrame, Path], None]
    rates: Callable[[pd.DataFrame], pd.DataFrame] = rates_of
    table: Callable[[pd.DataFrame], str] = success_table


SHOWN = {
    "curves": Study(plot_success),
    "demonstrations": Study(plot_demonstrations),
    "memory": Study(plot_noise),
    "robustness": Study(robustness.plot, robustness.held_rates, robustness.table),
}


def add(outputs: Path, study: str) -> None:
    """Takes over the validation episodes of a benchmark or of examples/robustness.py; what is there stays as it is.

    Raises:
        ValueError: They are of imperfect sensors and the study is of perfect ones, or the other way round.
    """
    file, rows = STUDIES / f"{study}.parquet", pd.read_parquet(outputs / "episodes.parquet")
    if study == "robustness":
        return keep_episodes(file, rows, OF_ROBUSTNESS)
    sensors = [*IDEAL] if study in OF_SENSORS else []
    if sensor_columns(rows) != sensors:
        raise ValueError(f"{outputs} and {study} are not both of {'imperfect' if sensors else 'perfect'} sensors.")
    keep_episodes(file, rows.loc[rows.seed.isin(STARTS), sensors + COLUMNS], sensors + KEY)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--add", type=Path, help="output folder of a benchmark or of robustness.py")
    parser.add_argument("--study", choices=[*SHOWN], help="what it is for")
    options = parser.parse_args()
    if bool(options.add) != bool(options.study):
        parser.error(f"--add and --study belong together; studies are {', '.join(SHOWN)}")
    if options.add:
        try:
            add(options.add, options.study)
        except (ValueError, OSError) as error:
            parser.error(str(error))
    for name, study in SHOWN.items():
        rates = study.rates(pd.read_parquet(STUDIES / f"{name}.parquet"))
        study.plot(rates, STUDIES / f"{name}.png")
        write_section(RESULTS, name, study.table(rates))


if __name__ == "__main__":
    main()
