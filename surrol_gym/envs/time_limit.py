"""The time limit of episodes that can be restored."""

from typing import Any

import gymnasium as gym


class RestorableTimeLimit(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Truncates an episode at its own time limit, wherever ``set_state`` went meanwhile.

    Gymnasium's ``TimeLimit``, which this wrapper lies around, holds the limit but counts the steps since a reset.
    """

    def __init__(self, env: gym.Env):
        gym.utils.RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the environment; see ``gymnasium.Env.step``."""
        observation, reward, terminated, _, info = self.env.step(action)
        limit = self.env.spec.max_episode_steps
        truncated = limit is not None and self.unwrapped.elapsed_steps >= limit
        return observation, reward, terminated, truncated, info
