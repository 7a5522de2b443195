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
FOUND = ["reached", "held", "steps"]
COLUMNS = [*KEY[:-1], "seconds", "seed", *FOUND]
OF_ROBUSTNESS = [*robustness.POINT, "training", "task", "seed"]


def rates_of(episodes: pd.DataFrame) -> pd.DataFrame:
    """Returns the success rates of a benchmark, tasks in their usual order, methods in that of their arrival."""
    methods, settings = [*episodes.method.unique()], [*sensor_columns(episodes), "demonstrations", "step"]
    return success_rates(in_order(episodes.sort_values(settings, kind="stable"), methods))


class Study(NamedTuple):
    """What a study keeps of episodes, told apart by a key, and the rates, the figure and the table that it shows."""

    plot: Callable[[pd.DataFrame, Path], None]
    rates: Callable[[pd.DataFrame], pd.DataFrame] = rates_of
    table: Callable[[pd.DataFrame], str] = success_table
    key: list[str] = KEY
    columns: list[str] = COLUMNS


SHOWN = {
    "curves": Study(plot_success),
    "demonstrations": Study(plot_demonstrations),
    "memory": Study(plot_noise),
    "robustness": Study(
        *(robustness.plot, robustness.held_rates, robustness.table), OF_ROBUSTNESS, [*OF_ROBUSTNESS, *FOUND]
    ),
}


def add(outputs: Path, name: str) -> None:
    """Takes over the validation episodes of a benchmark or of examples/robustness.py; what is there stays as it is.

    Raises:
        ValueError: They are of imperfect sensors and the study is of perfect ones, or the other way round; or they do
            not tell what the study keeps.
    """
    study, rows = SHOWN[name], pd.read_parquet(outputs / "episodes.parquet")
    sensors = [*IDEAL] if name in OF_SENSORS else []
    if sensor_columns(rows) != sensors:
        raise ValueError(f"{outputs} and {name} are not both of {'imperfect' if sensors else 'perfect'} sensors.")
    if missing := [column for column in study.columns if column not in rows]:
        raise ValueError(f"The episodes of {outputs} do not tell {', '.join(missing)}, so they are not for {name}.")
    rows = rows.loc[rows.seed.isin(STARTS), sensors + study.columns]
    keep_episodes(STUDIES / f"{name}.parquet", rows, sensors + study.key)


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
