"""An episode is the expert's, pushed or not, and repeats from its seed."""

import gymnasium as gym
import numpy as np
import pytest

import surrol_gym
from lerobot_gcdt.recording import episodes
from lerobot_gcdt.recording.episodes import run_episode
from surrol_gym.envs.psm_env import Mount

DOWNWARD = (Mount(start_position=(2.5, 0.25, 3.6)),)
"""One arm whose tool points down."""


class Executed(gym.Wrapper):
    """Notes the actions that reach the environment."""

    def __init__(self, env):
        super().__init__(env)
        self.actions = []

    def step(self, action):
        self.actions.append(action)
        return super().step(action)


@pytest.fixture(scope="module")
def disturbed():
    """A disturbed episode of NeedlePick and the actions that were executed in it."""
    env = Executed(gym.make("surrol/NeedlePick-v0"))
    episode = run_episode(env, 3, 0.5)
    env.close()
    return episode, np.stack(env.actions)


def test_a_disturbed_episode_records_what_the_expert_wanted(disturbed):
    episode, _ = disturbed
    env = gym.make("surrol/NeedlePick-v0")
    expert = surrol_gym.make_expert(env)
    env.close()
    for t, action in enumerate(episode["action"]):
        seen = {key: episode[key][t] for key in ("observation", "achieved_goal", "desired_goal")}
        np.testing.assert_array_equal(expert.act(seen), action)


def test_pushes_are_bounded_never_downwards_and_leave_the_jaws_alone(disturbed):
    episode, executed = disturbed
    pushes = episode["disturbance"]
    np.testing.assert_array_equal(episode["action"] + pushes, executed)
    assert np.any(pushes)
    assert np.abs(pushes).max() <= 0.5
    assert pushes[:, 2].min() >= 0
    assert not pushes[:, 4].any()


def test_most_steps_of_a_disturbed_episode_are_not_pushed(disturbed):
    episode, executed = disturbed
    assert np.mean(np.any(executed != episode["action"], axis=1)) < 0.5


def test_a_disturbed_episode_repeats_from_its_seed(disturbed):
    env = gym.make("surrol/NeedlePick-v0")
    again = run_episode(env, 3, 0.5)
    env.close()
    for key, values in disturbed[0].items():
        np.testing.assert_array_equal(again[key], values)


def test_whether_the_first_step_is_pushed_does_not_follow_from_the_start():
    env = gym.make("surrol/GauzeRetrieve-v0", max_episode_steps=1)
    starts = [run_episode(env, seed, 0.3) for seed in range(200)]
    env.close()
    pushed = np.array([start["disturbance"].any() for start in starts])
    gauze_x = np.array([start["achieved_goal"][0, 0] for start in starts])
    assert gauze_x[pushed].min() < np.quantile(gauze_x, 0.25)
    assert gauze_x[pushed].max() > np.quantile(gauze_x, 0.75)


def test_pushes_never_go_down_nor_move_the_jaws():
    rng = np.random.default_rng(0)
    pushes = np.stack([episodes._push(rng, DOWNWARD) for _ in range(2000)])
    assert (pushes[:, 2] >= 0).all() and (pushes[:, 4] == 0).all()
    assert (pushes[:, 0] < 0).any() and (pushes[:, 0] > 0).any()


def test_two_arms_are_pushed_apart_from_each_other_and_never_where_their_jaws_point():
    mounts = gym.make("surrol/NeedleRegrasp-v0").unwrapped.mounts  # both point along x
    rng = np.random.default_rng(0)
    pushes = np.stack([episodes._push(rng, mounts) for _ in range(2000)]).reshape(-1, 2, 5)
    assert (pushes[..., 0] <= 1e-9).all() and (pushes[..., 4] == 0).all()
    assert (pushes[..., 2] < 0).any(axis=0).all() and (pushes[..., 2] > 0).any(axis=0).all()
    pushed = pushes.any(axis=2)
    assert (pushed[:, 0] & ~pushed[:, 1]).any() and (pushed[:, 1] & ~pushed[:, 0]).any()


def test_a_fifth_of_the_steps_is_pushed():
    rng = np.random.default_rng(0)
    assert np.mean([episodes._push(rng, DOWNWARD).any() for _ in range(4000)]) == pytest.approx(0.2, abs=0.02)
