"""Draws the studies of the results from their committed episodes, examples/paper_table/STUDY.parquet.

    python examples/studies.py
    python examples/studies.py --add outputs/curves --study curves

curves: success against seconds of training.
memory: success against the noise of positions and angles that policies learned with, which grow together.

--add takes over all validation episodes of a benchmark (`gcdt benchmark` without --first_seed) into the file first.
Each study is a figure beside its file and a table in docs/results.md.
"""

import argparse
from pathlib import Path

import pandas as pd

from lerobot_gcdt.benchmark.report import (
    in_order,
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
FIGURES = {"curves": plot_success, "memory": plot_noise}
OF_SENSORS = ("memory",)
STARTS = range(20_000, 20_200)
KEY = ["task", "method", "demonstrations", "training_seed", "step", "seed"]
COLUMNS = [*KEY[:-1], "seconds", "seed", "reached", "held", "steps"]


def add(benchmark: Path, study: str) -> None:
    """Takes over the validation episodes of a benchmark; what is there stays as it is.

    Raises:
        ValueError: They are of imperfect sensors and the study is of perfect ones, or the other way round.
    """
    rows = pd.read_parquet(benchmark / "episodes.parquet")
    sensors = [*IDEAL] if study in OF_SENSORS else []
    if sensor_columns(rows) != sensors:
        raise ValueError(f"{benchmark} and {study} are not both of {'imperfect' if sensors else 'perfect'} sensors.")
    keep_episodes(STUDIES / f"{study}.parquet", rows.loc[rows.seed.isin(STARTS), sensors + COLUMNS], sensors + KEY)


def rates_of(study: str) -> pd.DataFrame:
    """Returns the success rates of a study, tasks in their usual order, methods in that of their arrival."""
    episodes = pd.read_parquet(STUDIES / f"{study}.parquet")
    methods, settings = [*episodes.method.unique()], [*sensor_columns(episodes), "demonstrations", "step"]
    return success_rates(in_order(episodes.sort_values(settings, kind="stable"), methods))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--add", type=Path, help="output folder of a benchmark")
    parser.add_argument("--study", choices=[*FIGURES], help="what it is for")
    options = parser.parse_args()
    if bool(options.add) != bool(options.study):
        parser.error(f"--add and --study belong together; studies are {', '.join(FIGURES)}")
    if options.add:
        try:
            add(options.add, options.study)
        except (ValueError, OSError) as error:
            parser.error(str(error))
    for study, plot in FIGURES.items():
        rates = rates_of(study)
        plot(rates, STUDIES / f"{study}.png")
        write_section(RESULTS, study, success_table(rates))


if __name__ == "__main__":
    main()
