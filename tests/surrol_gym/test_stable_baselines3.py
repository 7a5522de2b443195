"""Hindsight experience replay of Stable-Baselines3 runs on the environments as they are."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize


def learner(env, **kwargs):
    """SAC with hindsight, with the settings that are usual for reaching tasks."""
    return SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        gamma=0.95,
        learning_rate=1e-3,
        policy_kwargs={"net_arch": [64, 64]},
        seed=0,
        **kwargs,
    )


def test_hindsight_relabels_goals_with_our_rewards():
    env = gym.make("surrol/NeedleReach-v0")
    model = learner(env, learning_starts=100, batch_size=64, buffer_size=200)
    model.learn(200)
    batch = model.replay_buffer.sample(200)
    achieved, desired = (batch.next_observations[key].numpy() for key in ("achieved_goal", "desired_goal"))
    rewards = env.unwrapped.compute_reward(achieved, desired, {})
    np.testing.assert_array_equal(batch.rewards.numpy()[:, 0], rewards)
    assert set(rewards) == {-1.0, 0.0}, "some samples reached the goal that hindsight gave them"


def test_its_checker_has_no_complaint():
    env = gym.make("surrol/NeedleReach-v0")
    check_env(env)
    env.close()


@pytest.mark.study
def test_a_short_training_reaches_the_goals():
    env = VecNormalize(make_vec_env("surrol/NeedleReach-v0", 1, seed=0), norm_reward=False)
    model = learner(env, learning_starts=1000, batch_size=256)
    model.learn(10_000)
    env.training = False
    reached = 0
    observation = env.reset()
    for _ in range(10):
        success = False
        for _ in range(50):
            observation, _, _, info = env.step(model.predict(observation, deterministic=True)[0])
            success |= info[0]["is_success"]
        reached += success
    print(f"{reached} of 10 goals reached after 10,000 steps")
    assert reached >= 9
