"""The scripted experts behind a policy's interface."""

import pytest

from lerobot_gcdt.evaluation import evaluate
from lerobot_gcdt.evaluation.expert import ExpertPolicy


@pytest.mark.parametrize("task", ["NeedleReach", "BiPegBoard"])  # with one arm and with two
def test_the_expert_of_a_task_is_evaluated_like_a_policy(task):
    assert evaluate(ExpertPolicy(task), [task], [20_000, 20_001]).held.all()


def test_a_task_without_an_expert_is_named(monkeypatch):
    monkeypatch.setattr("lerobot_gcdt.evaluation.expert.find_law", lambda environment: None)
    with pytest.raises(ValueError, match="NeedleReach has no scripted expert"):
        ExpertPolicy("NeedleReach")
