"""A robot's vector holds the goals behind the observation, and what a policy cannot act on is refused."""

import pytest
import torch

from lerobot_gcdt.data.acting_batch import tasks_of, with_goals

TASKS = {"Reach.": [7, 3, 5], "Pick.": [19, 3, 5]}


def robots(task, size):
    return {"observation.state": torch.arange(float(size))[None], "task": task}


@pytest.mark.parametrize("task", ["Reach.", ["Reach."]])
def test_the_goals_are_taken_out(task):
    batch = with_goals(robots(task, 13), TASKS)
    assert batch["observation.state"].tolist() == [list(range(7))]
    assert batch["observation.goal"].tolist() == [[7, 8, 9]]
    assert batch["observation.achieved_goal"].tolist() == [[10, 11, 12]]


@pytest.mark.parametrize(
    "batch",
    [robots("Reach.", 7), robots("Reach.", 12), robots(["Reach.", "Pick."], 13)],
    ids=["no goals", "another size", "two tasks"],
)
def test_what_is_no_robots_state_stays_as_it_is(batch):
    assert with_goals(batch, TASKS) is batch


def test_goals_that_are_there_stay():
    batch = robots("Reach.", 13) | {"observation.goal": torch.zeros(1, 3)}
    assert with_goals(batch, TASKS) is batch


def test_an_unknown_task_is_named():
    with pytest.raises(KeyError, match="Unknown task 'Cut.'; this policy knows .*'Reach.'"):
        with_goals(robots("Cut.", 13), TASKS)


def test_goals_of_a_single_frame_get_the_batch_dimension_of_its_observation():
    goals = {"observation.goal": torch.zeros(3), "observation.achieved_goal": torch.ones(3)}
    batch = with_goals(robots(["Reach."], 7) | goals, TASKS)
    assert tasks_of(batch, TASKS) == ["Reach."]
    assert batch["observation.achieved_goal"].tolist() == [[1, 1, 1]]
