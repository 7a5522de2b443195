"""Success rates come with honest intervals."""

import pandas as pd
import pytest
from scipy.stats import binomtest, t

from lerobot_gcdt.evaluation import describe
from lerobot_gcdt.evaluation.statistics import trainings_interval, wilson_interval


@pytest.mark.parametrize(("successes", "trials"), [(0, 1), (1, 1), (0, 20), (20, 20), (1, 7), (95, 100), (499, 1000)])
def test_the_interval_is_wilsons(successes, trials):
    reference = binomtest(successes, trials).proportion_ci(confidence_level=0.95, method="wilson")
    assert wilson_interval(successes, trials) == pytest.approx((reference.low, reference.high), abs=1e-6)


def test_a_single_training_has_the_interval_of_its_starts():
    assert trainings_interval([0.75], 40) == wilson_interval(30, 40)


@pytest.mark.parametrize("trainings", [2, 3, 10])
def test_trainings_that_differ_have_students_interval_within_0_and_1(trainings):
    rates = [0.3, 0.7] + [0.5] * (trainings - 2)
    reference = t.interval(0.95, trainings - 1, 0.5, pd.Series(rates).sem())
    low, high = trainings_interval(rates, 10_000)
    assert (low, high) == pytest.approx((max(0, reference[0]), min(1, reference[1])), abs=1e-4)


def test_trainings_that_agree_know_no_more_of_the_starts_than_one():
    assert trainings_interval([0.75] * 5, 40) == wilson_interval(30, 40)


def test_more_than_ten_trainings_count_as_ten():
    rates = [0.3, 0.7] * 10
    low, high = trainings_interval(rates, 10_000)
    assert high - low == pytest.approx(2 * t.ppf(0.975, 9) * pd.Series(rates).sem(), abs=1e-4)


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
