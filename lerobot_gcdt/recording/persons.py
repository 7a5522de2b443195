"""Recordings in which a person acts instead of the expert."""

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from lerobot_gcdt.recording.features import Extras
from surrol_gym.by_hand import Command, act_out


@dataclass(frozen=True)
class Person:
    """Somebody at a teleoperator.

    Attributes:
        name: What ``meta/surrol.json`` calls the teleoperator.
        command: What they command at any moment.
        window: Whether a window shows them the scene.
    """

    name: str
    command: Command
    window: bool = True

    def run_episode(self, env: gym.Env, seed: int, extras: Extras) -> dict[str, np.ndarray]:
        """Lets the person act out one episode, until the goal has been held for a second.

        Args:
            env: The environment.
            seed: Seed of the reset.
            extras: What to observe beside the environment's own observation.

        Returns:
            As ``lerobot_gcdt.recording.episodes.run_episode``, for as many steps as the person took; nothing is
            added to their actions.

        Raises:
            Stop: The person wants to stop.
        """
        noted = _Noted(env, extras)
        act_out(noted, seed, self.command)
        return {key: np.stack([frame[key] for frame in noted.frames]) for key in noted.frames[0]}


class _Noted(gym.Wrapper):
    """Notes the frames of an episode."""

    def __init__(self, env: gym.Env, extras: Extras):
        super().__init__(env)
        self._extras = extras
        self.frames: list[dict[str, Any]] = []

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        self.frames = []
        self._seen, info = self.env.reset(**options)
        return self._seen, info

    def step(self, action: np.ndarray) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        frame = self._seen | self._extras.observe(self.env) | {"action": action, "disturbance": np.zeros_like(action)}
        self._seen, reward, terminated, truncated, info = self.env.step(action)
        self.frames.append(frame | {"reward": np.float32(reward), "success": info["is_success"]})
        return self._seen, reward, terminated, truncated, info
