"""Episodes as their arms saw them: what each was sent to, and where its tip went."""

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

import surrol_gym
from lerobot_gcdt.evaluation.rollout import rollout
from surrol_gym.bullet import TIME_STEP
from surrol_gym.envs.goal_env import SUB_STEPS
from surrol_gym.envs.psm_env import Mount, PSMEnv, unwrapped
from surrol_gym.registry import env_class, task_name
from surrol_gym.units import to_metres

STEP = SUB_STEPS * TIME_STEP
"""Duration of a control step, seconds."""


@dataclass(frozen=True)
class Episode:
    """One episode of T steps and A arms.

    Attributes:
        task: Name of the task.
        seed: Seed of the reset.
        source: Who acted: ``expert``, or the name of a policy.
        mounts: Where the arms stand.
        joints: Joints that each arm was sent to, at the start and in each step, metres and radians, (T + 1, A, 6).
        jaws: Opening angle that its jaws were sent to, radians, (T + 1, A).
        tips: Where its jaw tips were measured, metres, world frame, (T + 1, A, 3).
        success: Whether the task was solved after each step, (T,).
    """

    task: str
    seed: int
    source: str
    mounts: tuple[Mount, ...]
    joints: np.ndarray
    jaws: np.ndarray
    tips: np.ndarray
    success: np.ndarray


def play(task: str, seed: int, policy: Any = None, source: str = "expert") -> Episode:
    """Plays one episode to the time limit.

    Args:
        task: Name of the task; see ``surrol_gym.find_task``.
        seed: Seed of the reset.
        policy: As ``lerobot_gcdt.evaluation.evaluate`` takes it; None for the scripted expert.
        source: What the episode says of who acted.

    Returns:
        The episode.

    Raises:
        ValueError: The task is unknown, the seed is negative, or the policy needs its processors.
    """
    env_id = surrol_gym.find_task(task)
    if seed < 0:
        raise ValueError(f"Seeds count from 0, got {seed}.")
    moments: list[tuple[np.ndarray, ...]] = []
    if policy is None:
        success = _play_expert(env_id, seed, moments)
    else:
        outcome, _ = rollout(policy, task, [seed], lambda envs: moments.append(_moment(unwrapped(envs.envs[0]))))
        success = outcome[:, 0]
    joints, jaws, tips = (np.stack(column) for column in zip(*moments, strict=True))
    return Episode(task_name(env_id), seed, source, env_class(task).mounts, joints, jaws, tips, success)


def _play_expert(env_id: str, seed: int, moments: list[tuple[np.ndarray, ...]]) -> np.ndarray:
    env = gym.make(env_id)
    try:
        expert = surrol_gym.make_expert(env)
        observation, _ = env.reset(seed=seed)
        moments.append(_moment(unwrapped(env)))
        success, truncated = [], False
        while not truncated:
            observation, _, _, truncated, info = env.step(expert.act(observation))
            moments.append(_moment(unwrapped(env)))
            success.append(info["is_success"])
        return np.array(success)
    finally:
        env.close()


def _moment(task: PSMEnv) -> tuple[np.ndarray, ...]:
    return (
        np.array([arm.get_state() for arm in task.arms]),
        np.array([arm.jaw_target for arm in task.arms]),
        to_metres([arm.tip() for arm in task.arms]),
    )
