"""Writes the README's table of success rates from the episodes in examples/paper_table/episodes.parquet.

    python examples/results_table.py

A row an episode: method, task, seed of the start, `reached`, `held`, and steps to the first success.
"""

import argparse
from pathlib import Path

import pandas as pd

import surrol_gym
from lerobot_gcdt.hub.documents import write_section

ROOT = Path(__file__).parent.parent
EPISODES = ROOT / "examples/paper_table/episodes.parquet"
PAPER = (1.00, 0.95, 1.00, 0.84, 0.74, 0.42, 1.00, 0.48, 0.30, 0.37)  # Fu et al. 2024, table II


def table() -> str:
    """Returns success rates, reached / held, by task and method as Markdown."""
    episodes = pd.read_parquet(EPISODES)
    rates = episodes.groupby(["method", "task"])[["reached", "held"]].mean()
    lines = ["| task | generalist | perceptron | GCDT in the paper |", "| --- | --- | --- | --- |"]
    for task, paper in zip(surrol_gym.TASKS, PAPER, strict=True):
        ours = [_pair(rates.loc[method, task]) for method in ("generalist", "perceptron")]
        lines.append(f"| {task} | {' | '.join(ours)} | {_short(paper)} |")
    means = [_pair(rates.loc[method].mean()) for method in ("generalist", "perceptron")]
    lines.append(f"| mean | {' | '.join(means)} | {_short(sum(PAPER) / len(PAPER))} |")
    return "\n".join(lines) + "\n"


def _pair(rates: pd.Series) -> str:
    return f"{_short(rates.reached)} / {_short(rates.held)}"


def _short(rate: float) -> str:
    return f"{rate:.2f}".removeprefix("0")


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    write_section(ROOT / "README.md", "results", table())


if __name__ == "__main__":
    main()
