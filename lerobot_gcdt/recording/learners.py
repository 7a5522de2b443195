"""Recordings in which a policy acts and the expert says what it should have done (DAgger, Ross et al. 2011)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import torch

from lerobot_gcdt.environment.policy_input import check_processed, observation_batch
from surrol_gym.envs.goal_env import Observation
from surrol_gym.envs.psm_env import unwrapped

TURNS = 3
"""Tells the random stream of whose turn it is from those of an episode's start and its pushes."""

Choose = Callable[[Observation, np.ndarray], np.ndarray]
"""Takes an observation and the expert's action, and returns the action of the step."""


@dataclass(frozen=True)
class Learner:
    """A policy that acts in the expert's place at the beginning of every episode.

    Attributes:
        policy: Anything with LeRobot's ``reset()`` and ``select_action(batch)`` that takes observations, without
            pictures, and returns actions as they are, without normalisation.
        name: What ``meta/surrol.json`` calls it: its folder or repository.
        mix: Probability that the expert's action is executed, in a step in which the policy acts.

    Raises:
        ValueError: The mix is not in [0, 1], or the policy needs pictures or its processors.
    """

    policy: Any
    name: str
    mix: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.mix <= 1:
            raise ValueError(f"The mix is a probability, in [0, 1]; got {self.mix}.")
        check_processed(self.policy)
        if pictures := list(getattr(getattr(self.policy, "config", None), "image_features", {})):
            raise ValueError(f"{self.name} sees {', '.join(pictures)}; only policies without pictures can act here.")

    def begin(self, env: gym.Env, seed: int) -> Choose:
        """Begins an episode.

        The policy acts from the start to a step that is drawn from all of the episode; from there on the expert acts
        alone, so that most episodes end in success. The policy sees every step until then, whoever acts.

        Args:
            env: The environment.
            seed: Seed of the episode, which draws whose turn it is.

        Returns:
            What chooses the action of every step.
        """
        task, rng = unwrapped(env), np.random.default_rng([seed, TURNS])
        assert env.spec and env.spec.max_episode_steps  # every task is registered with a time limit
        handover = rng.integers(1, env.spec.max_episode_steps + 1)
        self.policy.reset()

        def choose(observation: Observation, action: np.ndarray) -> np.ndarray:
            if task.elapsed_steps >= handover:
                return action
            rows = {key: numbers[None] for key, numbers in observation.items()}
            with torch.no_grad():
                chosen = self.policy.select_action(observation_batch(self.policy, rows, task.task_description))
            return action if rng.random() < self.mix else chosen[0].float().clamp(-1, 1).cpu().numpy()

        return choose
