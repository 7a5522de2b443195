"""What takes long to show: ``pytest -m study tests/lerobot_gcdt/recording/test_studies.py``."""

from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest

import surrol_gym
from lerobot_gcdt.recording.collection import PUBLISHED_DISTURB
from lerobot_gcdt.recording.episodes import run_episode

pytestmark = pytest.mark.study

SHORT_OF_TIME = {"PegTransfer": 0.8, "BiPegTransfer": 0.8, "BiPegBoard": 0.75, "MatchBoardPanel": 0.65}
"""Share of the episodes in which experts succeed that a push in every fifth step keeps too long; 0.95 elsewhere."""


@pytest.mark.parametrize("task", surrol_gym.TASKS)
def test_experts_succeed_in_most_episodes_in_which_the_arms_are_pushed(task, seeds):
    with closing(gym.make(f"surrol/{task}-v0")) as env:
        played = [run_episode(env, seed, PUBLISHED_DISTURB)["success"] for seed in seeds(60_000, 200)]
    firsts = [1 + successes.argmax() for successes in played if successes.any()]
    print(f"{task}: {len(firsts)} of {len(played)} succeeded, first at step {np.mean(firsts):.1f} on average")
    assert len(firsts) >= SHORT_OF_TIME.get(task, 0.95) * len(played)
