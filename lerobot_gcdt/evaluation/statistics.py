"""Success rates of evaluated episodes, with intervals."""

from math import sqrt

import pandas as pd

WILSON_Z = 1.959964
"""Quantile of the normal distribution for 95 % intervals."""


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
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


def describe(episodes: pd.DataFrame) -> str:
    """Describes the episodes of ``evaluate``: success rates with intervals, a line a task and figure."""
    lines = []
    for task, rows in episodes.groupby("task", sort=False):
        for figure in ("reached", "held"):
            low, high = wilson_interval(int(rows[figure].sum()), len(rows))
            lines.append(
                f"{task} {figure:7} {rows[figure].mean():.2f}  (95 % interval {low:.3f}-{high:.3f}, "
                f"{len(rows)} starts, seeds {rows.seed.min()}-{rows.seed.max()})"
            )
    return "\n".join(lines)
