"""The time limit of episodes that can be restored."""

from typing import TYPE_CHECKING, Any

import gymnasium as gym

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
