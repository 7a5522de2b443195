"""Success rates come with honest intervals."""

import pandas as pd
import pytest
from scipy.stats import binomtest

from lerobot_gcdt.evaluation import describe
from lerobot_gcdt.evaluation.statistics import wilson_interval


@pytest.mark.parametrize(("successes", "trials"), [(0, 1), (1, 1), (0, 20), (20, 20), (1, 7), (95, 100), (499, 1000)])
def test_the_interval_is_wilsons(successes, trials):
    reference = binomtest(successes, trials).proportion_ci(confidence_level=0.95, method="wilson")
    assert wilson_interval(successes, trials) == pytest.approx((reference.low, reference.high), abs=1e-6)


def test_the_description_tells_rates_intervals_starts_and_seeds():
    outcomes = {"reached": [True] * 30 + [False] * 10, "held": [True] * 20 + [False] * 20}
    episodes = pd.DataFrame({"task": "NeedlePick", "seed": range(500, 540), **outcomes})
    reached, held = describe(episodes).splitlines()
    for line, successes in ((reached, 30), (held, 20)):
        low, high = wilson_interval(successes, 40)
        assert "NeedlePick" in line and f"{successes / 40:.2f}" in line
        assert f"{low:.3f}-{high:.3f}" in line
        assert "40 starts" in line and "seeds 500-539" in line
    assert "reached" in reached and "held" in held


def test_runs_of_seeds_are_told_apart():
    seeds = [101, 100, 7, 8, 9]
    described = describe(pd.DataFrame({"task": "NeedlePick", "seed": seeds, "reached": True, "held": True}))
    assert [line.partition(" starts, ")[2] for line in described.splitlines()[::2]] == ["seeds 7-9)", "seeds 100-101)"]


def test_the_description_has_lines_for_every_task():
    rows = {"task": ["NeedleReach", "NeedlePick"], "seed": [0, 0], "reached": [True, True], "held": [True, False]}
    described = describe(pd.DataFrame(rows)).splitlines()
    assert [line.split()[0] for line in described] == ["NeedleReach", "NeedleReach", "NeedlePick", "NeedlePick"]
