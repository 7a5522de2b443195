"""Writes the tables and figures of success rates from the committed episodes in examples/paper_table/episodes.parquet.

    python examples/results_table.py
    python examples/results_table.py --add outputs/benchmark --protocol published-100

A row an episode: protocol, method, task, seed and CPU seconds of the training, seed of the start, `reached`, `held`,
and steps to the first success. --add takes over the last checkpoints of a benchmark (`gcdt benchmark --points 1
--first_seed 400000`) into that file first.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd

import surrol_gym
from lerobot_gcdt.benchmark.report import in_order, plot_bars, sensor_columns, success_latex, success_rates
from lerobot_gcdt.evaluation.checkpoints import keep_episodes
from lerobot_gcdt.hub.documents import write_section

ROOT = Path(__file__).parent.parent
EPISODES = ROOT / "examples/paper_table/episodes.parquet"
README, RESULTS, NOTES = ROOT / "README.md", ROOT / "docs/results.md", EPISODES.with_name("notes.md")
PROTOCOLS = ("published-large", "published-100", "plain-100", "interactive", "rivals", "ablation")
BASES = {"rivals": ("scratch", "perceptron"), "ablation": ("scratch",)}
"""Methods of published-100 that stand beside those of protocols with the same demonstrations, in the same tasks."""

METHODS = {
    "generalist": "generalist",
    "tuned": "fine-tuned",
    "pretrained": "GCDT, pretrained",
    "scratch": "GCDT for one task",
    "perceptron": "perceptron",
    "expert": "scripted expert",
    "dt_goal": "DT with the goal",
    "dt": "DT without the goal",
    "act": "ACT",
    "diffusion": "Diffusion Policy",
    "vinn": "VINN",
    "iql": "IQL",
    "plas": "PLAS",
    "four_tokens": "four tokens a step",
    "clock": "told its time-to-goal",
    "context_100": "100 steps of context",
    "last": "last weights",
    "spread": "spread starts",
    "longer": "longer limit while recording",
    "expert_200": "GCDT, 200 demonstrations instead",
}
"""The methods in the order of their columns, and what they are called there."""

DEMONSTRATIONS = {
    "plain-100": "100 demonstrations without pushes",
    "published-100": "100 demonstrations",
    "published-large": "440 demonstrations",
}
"""What the README shows of each of these protocols: some methods, where they were tried in all tasks."""

IN_README = ("generalist", "scratch", "perceptron")

STARTS = range(400_000, 400_200)
PAPER = (1.00, 0.95, 1.00, 0.84, 0.74, 0.42, 1.00, 0.48, 0.30, 0.37)  # Fu et al. 2024, table II
KEY = ["protocol", "method", "task", "training_seed", "seed"]
COLUMNS = [*KEY[:-1], "seconds", "seed", "reached", "held", "steps"]


def protocols() -> Iterator[tuple[str, pd.DataFrame]]:
    """Yields the protocols that there are episodes of, and their success rates in the order of tasks and methods."""
    episodes = pd.read_parquet(EPISODES).assign(step=1, demonstrations=0)  # the protocol tells them
    parts = [episodes]
    for protocol, methods in BASES.items():
        tasks = set(episodes.task[episodes.protocol == protocol])
        base = (episodes.protocol == "published-100") & episodes.method.isin(methods) & episodes.task.isin(tasks)
        parts.append(episodes[base].assign(protocol=protocol))
    for protocol, rows in in_order(pd.concat(parts), [*METHODS]).groupby("protocol"):
        yield protocol, success_rates(rows)


def tables() -> Iterator[tuple[Path, str, str]]:
    """Yields the documents, the names of their sections, and what these should hold."""
    whole: dict[str, pd.DataFrame] = {}
    for protocol, rates in protocols():
        by_method = {method: rates[rates.method == method].set_index("task") for method in METHODS}
        columns = {METHODS[method]: rows for method, rows in by_method.items() if len(rows)}
        yield NOTES if protocol == "ablation" else RESULTS, protocol, _table(columns, _with_interval)
        for method in IN_README if protocol in DEMONSTRATIONS else ():
            if len(by_method[method]) == len(PAPER):
                whole[f"{METHODS[method]}, {DEMONSTRATIONS[protocol]}"] = by_method[method]
    yield README, "results", _table(whole, _pair)


def _table(columns: dict[str, pd.DataFrame], write: Callable[[pd.Series], str]) -> str:
    """Writes a table with a column for each of some rates by task."""
    lines = [f"| task | {' | '.join(columns)} | GCDT in the paper |", "| --- |" + " --- |" * (len(columns) + 1)]
    for task, paper in zip(surrol_gym.TASKS, PAPER, strict=True):
        cells = [write(rates.loc[task]) if task in rates.index else "" for rates in columns.values()]
        if any(cells):
            lines.append(f"| {task} | {' | '.join(cells)} | {_short(paper)} |")
    means = [_pair(rates[["reached", "held"]].mean()) if len(rates) == len(PAPER) else "" for rates in columns.values()]
    if any(means):
        lines.append(f"| mean | {' | '.join(means)} | {_short(sum(PAPER) / len(PAPER))} |")
    return "\n".join(lines) + "\n"


def _pair(rates: pd.Series) -> str:
    return f"{_short(rates.reached)} / {_short(rates.held)}"


def _with_interval(rates: pd.Series) -> str:
    several = f", {rates.trainings:.0f} trainings" if rates.trainings > 1 else ""
    return f"{_pair(rates)} ({_short(rates.held_low)}-{_short(rates.held_high)}{several})"


def _short(rate: float) -> str:
    return f"{rate:.2f}".removeprefix("0")


def add(benchmark: Path, protocol: str) -> None:
    """Takes over the test episodes of a benchmark's last checkpoints; what is there stays as it is.

    Raises:
        ValueError: They are of other methods than ``METHODS``, of several numbers of demonstrations, or of imperfect
            sensors.
    """
    rows = pd.read_parquet(benchmark / "episodes.parquet")
    rows = rows[rows.seed.isin(STARTS)]
    if unknown := set(rows.method) - set(METHODS):
        raise ValueError(
            f"{benchmark} is of methods called {', '.join(sorted(unknown))}; the tables have {', '.join(METHODS)}."
        )
    if (rows.groupby(["method", "task"]).demonstrations.nunique() > 1).any():
        raise ValueError(f"{benchmark} compares several numbers of demonstrations; a protocol is for one.")
    if sensor_columns(rows):
        raise ValueError(f"{benchmark} is of imperfect sensors; the protocols are for perfect ones.")
    last = rows.groupby(["method", "task", "training_seed"]).step.transform("max")
    rows = rows[rows.step == last].assign(protocol=protocol)
    keep_episodes(EPISODES, rows[COLUMNS], KEY)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--add", type=Path, help="output folder of a benchmark")
    parser.add_argument("--protocol", choices=PROTOCOLS, help="what it was trained on")
    options = parser.parse_args()
    if options.add and not options.protocol:
        parser.error(f"--add {options.add} needs a --protocol: {', '.join(PROTOCOLS)}")
    if options.add:
        try:
            add(options.add, options.protocol)
        except (ValueError, OSError) as error:
            parser.error(str(error))
    for document, section, text in tables():
        write_section(document, section, text)
    for protocol, rates in protocols():
        named = rates.assign(method=rates.method.map(METHODS))
        plot_bars(named, EPISODES.with_name(f"{protocol}.png"))
        EPISODES.with_name(f"{protocol}.tex").write_text(success_latex(named))


if __name__ == "__main__":
    main()
