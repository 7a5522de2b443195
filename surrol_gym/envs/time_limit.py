"""The time limit of episodes that can be restored."""

from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

if TYPE_CHECKING:
    from surrol_gym.envs.goal_env import GoalEnv


class RestorableTimeLimit(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Truncates an episode at its own time limit, wherever ``set_state`` went meanwhile.

    Gymnasium's ``TimeLimit``, which this wrapper lies around, holds the limit but counts the steps since a reset.
    """

    unwrapped: "GoalEnv"

    def __init__(self, env: gym.Env):
        gym.utils.RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the environment; see ``gymnasium.Env.step``."""
        observation, reward, terminated, _, info = self.env.step(action)
        spec = self.env.spec
        limit = spec.max_episode_steps if spec else None
        truncated = limit is not None and self.unwrapped.elapsed_steps >= limit
        return observation, reward, terminated, truncated, info

    # What learners ask of goal environments, also through this wrapper; see ``GoalEnv``.

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray | float:
        """Returns the reward of goals, shape (..., G)."""
        return self.unwrapped.compute_reward(achieved_goal, desired_goal, info)

    def compute_terminated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray | bool:
        """Returns whether goals, shape (..., G), end an episode."""
        return self.unwrapped.compute_terminated(achieved_goal, desired_goal, info)

    def compute_truncated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray | bool:
        """Returns whether goals, shape (..., G), truncate an episode."""
        return self.unwrapped.compute_truncated(achieved_goal, desired_goal, info)
