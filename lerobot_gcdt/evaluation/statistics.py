"""Success rates of evaluated episodes, with intervals."""

from collections.abc import Iterator, Sequence
from math import sqrt
from statistics import stdev

import pandas as pd

WILSON_Z = 1.959964
"""Quantile of the normal distribution for 95 % intervals."""

STUDENT_T = (12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262)
"""Those of Student's distribution with 1 to 9 degrees of freedom."""


def wilson_interval(successes: float, trials: int) -> tuple[float, float]:
    """Computes the Wilson score interval of a success rate, 95 %.

    Args:
        successes: Number of successes.
        trials: Number of trials, at least 1.

    Returns:
        Lower and upper bound.
    """
    rate, z2 = successes / trials, WILSON_Z**2
    centre = rate + z2 / (2 * trials)
    spread = WILSON_Z * sqrt(rate * (1 - rate) / trials + z2 / (4 * trials**2))
    return max(0.0, (centre - spread) / (1 + z2 / trials)), min(1.0, (centre + spread) / (1 + z2 / trials))


def trainings_interval(rates: Sequence[float], starts: int) -> tuple[float, float]:
    """Computes an interval of the mean success rate of several trainings, 95 %.

    It is, on either side, the wider one of two: Student's of the mean, because trainings of the same method differ; and
    Wilson's of the mean, because all of them share their starts, so that more trainings do not narrow it. A single
    training has only Wilson's.

    Args:
        rates: Success rate of each training.
        starts: Number of starts that each was evaluated on, at least 1.

    Returns:
        Lower and upper bound, within [0, 1].
    """
    mean = sum(rates) / len(rates)
    low, high = wilson_interval(mean * starts, starts)
    if len(rates) > 1:
        quantile = STUDENT_T[min(len(rates) - 1, len(STUDENT_T)) - 1]
        spread = quantile * stdev(rates) / sqrt(len(rates))
        low, high = max(0.0, min(low, mean - spread)), min(1.0, max(high, mean + spread))
    return low, high


def by_starts(episodes: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Splits the episodes of ``evaluate`` by task and by runs of consecutive seeds.

    So starts that a policy was chosen on and starts that it is reported on are not thrown together.

    Args:
        episodes: Rows of ``evaluate``.

    Yields:
        Name of the task, the seeds, such as ``100000-100099``, and their rows.
    """
    for task, rows in episodes.groupby("task", sort=False):
        rows = rows.sort_values("seed")
        for _, run in rows.groupby((rows.seed.diff() > 1).cumsum()):
            yield task, f"{run.seed.min()}-{run.seed.max()}", run


def describe(episodes: pd.DataFrame) -> str:
    """Describes the episodes of ``evaluate``: success rates with intervals, a line a task, run of seeds and figure."""
    lines = []
    for task, seeds, rows in by_starts(episodes):
        for figure in ("reached", "held"):
            low, high = wilson_interval(int(rows[figure].sum()), len(rows))
            lines.append(
                f"{task} {figure:7} {rows[figure].mean():.2f}  (95 % interval {low:.3f}-{high:.3f}, "
                f"{len(rows)} starts, seeds {seeds})"
            )
    return "\n".join(lines)
