"""Evaluation: policies, tasks and seeds in, one row an episode out."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import torch
from lerobot.utils.constants import OBS_IMAGES
from tqdm import tqdm

from lerobot_gcdt.environment.policy_input import check_processed, observation_batch
from lerobot_gcdt.environment.surrol_env import CameraPictures
from lerobot_gcdt.evaluation.tasks import check_starts
from surrol_gym.registry import find_task, task_name, task_spec
from surrol_gym.wrappers import IDEAL, complete_sensors, imperfect


def evaluate(
    policy: Any,
    tasks: Iterable[str],
    seeds: Iterable[int],
    batch_size: int = 25,
    on_batch: Callable[[pd.DataFrame], None] | None = None,
    sensors: Mapping[str, Any] | None = None,
) -> pd.DataFrame:
    """Runs a policy from seeded starts, every episode to its time limit.

    Args:
        policy: As ``lerobot_gcdt.evaluation.load_policy`` returns it, or anything else with LeRobot's ``reset()`` and
            ``select_action(batch)`` that takes observations and returns actions as they are, without normalisation.
        tasks: Names of tasks; see ``surrol_gym.find_task``.
        seeds: Seed of the reset of each episode; the same for every task.
        batch_size: Episodes that run side by side. It has no influence on their outcome beyond rounding.
        on_batch: Called with the rows of every batch that is finished.
        sensors: Arguments of ``surrol_gym.wrappers.ImperfectSensors``, through which the policy sees, and of
            ``NoisyActions``, through which it acts; None for neither.

    Returns:
        A row an episode: ``task``, ``seed``, ``reached`` (success at any step), ``held`` (success at the last step),
        ``steps`` (to the first success, NaN without one), and ``achieved_goal`` and ``desired_goal`` at the end (lists,
        su), by the truth. Where one of ``sensors`` is not perfect, each of them adds a column.

    Raises:
        ValueError: A task is unknown, a seed is negative, there are none, the batch size is not positive, sensors are
            out of range, or the policy needs its processors.
    """
    tasks, seeds = list(tasks), list(seeds)
    check_starts(tasks, seeds)
    if batch_size < 1:
        raise ValueError(f"batch_size must be positive, got {batch_size}.")
    described = complete_sensors(sensors, IDEAL)
    columns = {} if described == IDEAL else described
    finished = []
    with tqdm(total=len(tasks) * len(seeds), unit="episode") as bar:
        for task in tasks:
            bar.set_description(f"Evaluating {task}")
            for start in range(0, len(seeds), batch_size):
                batch = seeds[start : start + batch_size]
                outcome = rollout(policy, task, batch, sensors=sensors)
                finished.append(_rows(task_name(find_task(task)), batch, *outcome).assign(**columns))
                if on_batch:
                    on_batch(finished[-1])
                bar.update(len(batch))
    return pd.concat(finished, ignore_index=True)


def _rows(task: str, seeds: list[int], success: np.ndarray, last: dict[str, np.ndarray]) -> pd.DataFrame:
    """The rows of one batch."""
    reached = success.any(0)
    return pd.DataFrame(
        {
            "task": task,
            "seed": seeds,
            "reached": reached,
            "held": success[-1],
            "steps": np.where(reached, np.argmax(success, 0) + 1.0, np.nan),
            "achieved_goal": last["achieved_goal"].tolist(),
            "desired_goal": last["desired_goal"].tolist(),
        }
    )


def rollout(
    policy: Any,
    task: str,
    seeds: list[int],
    watch: Callable[[gym.vector.SyncVectorEnv], None] | None = None,
    sensors: Mapping[str, Any] | None = None,
    **options: Any,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Runs one episode a seed, side by side, to the time limit.

    Args:
        policy: As ``evaluate`` takes it.
        task: Name of the task.
        seeds: Seed of the reset of each episode.
        watch: Called with the vector environment before the first step and after each.
        sensors: As ``evaluate`` takes them.
        **options: Arguments of ``gym.make``.

    Returns:
        Success after each step, booleans (T, B), and the last observation, without imperfections, arrays (B, size).

    Raises:
        ValueError: The policy needs its processors, or sensors are out of range.
    """
    check_processed(policy)
    env_id = find_task(task)
    limit = task_spec(env_id).max_episode_steps
    assert limit is not None  # every task is registered with one
    pictures = getattr(getattr(policy, "config", None), "image_features", {})

    def make() -> gym.Env:
        env = gym.make(env_id, disable_env_checker=True, **options)
        if pictures:
            [size] = {feature.shape[-1] for feature in pictures.values()}
            env = CameraPictures(env, [key.removeprefix(f"{OBS_IMAGES}.") for key in pictures], size)
        return imperfect(env, sensors)

    envs = gym.vector.SyncVectorEnv([make] * len(seeds))
    try:
        sentence = envs.get_attr("task_description")[0]
        observation, _ = envs.reset(seed=[*seeds])
        policy.reset()
        success = []
        for _ in range(limit):
            if watch:
                watch(envs)
            with torch.no_grad():
                action = policy.select_action(observation_batch(policy, observation, sentence))
            observation, _, _, _, info = envs.step(action.cpu().numpy())
            success.append(info["is_success"])
        if watch:
            watch(envs)
    finally:
        envs.close()
    return np.stack(success), info.get("true_observation", observation)
