"""The checkpoint that comes with the package: small, safe, and at home in all ten tasks."""

import gymnasium as gym
import numpy as np
import pytest

import surrol_gym
from lerobot_gcdt import GENERALIST, GCDTPolicy
from lerobot_gcdt.evaluation import evaluate
from lerobot_gcdt.hub.checks import check_card, check_checkpoint


@pytest.fixture(scope="module")
def generalist():
    return GCDTPolicy.from_pretrained(GENERALIST).eval()


def test_it_is_small_and_whole_and_has_its_card():
    assert sum(file.stat().st_size for file in GENERALIST.iterdir()) < 10_000_000
    check_checkpoint(GENERALIST)
    check_card((GENERALIST / "README.md").read_text(), "model")


@pytest.mark.parametrize("task", surrol_gym.TASKS)
def test_it_knows_every_task_by_its_sentence(generalist, task):
    env = gym.make(f"surrol/{task}-v0").unwrapped
    sizes = [len(names) for names in (env.observation_names, env.goal_names, env.action_names)]
    env.close()
    assert generalist.config.task_dims[env.task_description] == sizes


@pytest.mark.parametrize("task", ["NeedleReach", "PegTransfer", "BiPegBoard"])
def test_it_succeeds_in_most_episodes(generalist, task):
    assert evaluate(generalist, [task], range(8)).held.sum() >= 6


def test_its_card_tells_of_all_tasks():
    card = (GENERALIST / "README.md").read_text()
    rows = [line.split("|")[1].strip() for line in card.splitlines() if "| 200 | 400000-400199 |" in line]
    assert rows == list(surrol_gym.TASKS)


def test_numbers_of_its_weights_are_finite(generalist):
    assert all(np.isfinite(value.numpy()).all() for value in generalist.state_dict().values())
