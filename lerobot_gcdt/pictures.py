"""What people look at: films of a policy, the training curve, achieved against desired goals."""

from collections.abc import Iterable
from pathlib import Path

import gymnasium as gym
import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import torch
from lerobot.utils.io_utils import write_video
from tqdm import tqdm

from lerobot_gcdt.evaluation import observation_batch

REACHED, MISSED = "#1a7f5a", "#c0392b"


def film(policy, task: str, seeds: Iterable[int], path: str | Path, size: int = 384) -> Path:
    """Films a policy, one episode after the other.

    Args:
        policy: Anything with LeRobot's ``reset()`` and ``select_action(batch)``.
        task: Name of the task.
        seeds: Seed of the reset of each episode.
        path: The mp4 file to write.
        size: Width and height of the picture, pixels; even.

    Returns:
        The path.
    """
    env = gym.make(f"surrol/{task}-v0", render_mode="rgb_array", width=size, height=size)
    frames = []
    try:
        for seed in tqdm(list(seeds), desc="Filming", unit="episode"):
            observation, _ = env.reset(seed=seed)
            policy.reset()
            truncated = False
            while not truncated:
                frames.append(env.render())
                row = {key: value[None] for key, value in observation.items()}
                batch = observation_batch(policy, row, env.unwrapped.task_description)
                with torch.no_grad():
                    action = policy.select_action(batch)[0].cpu().numpy()
                observation, _, _, truncated, _ = env.step(action)
            frames += [env.render()] * 5
    finally:
        env.close()
    # Twice the speed of the simulation, whose step is 0.2 s.
    write_video(path, frames, fps=2 * env.metadata["render_fps"])
    return Path(path)


def plot_training(curve: pd.DataFrame, path: str | Path) -> Path:
    """Plots a training curve.

    Args:
        curve: Columns ``step`` and ``loss``.
        path: The PNG file to write.

    Returns:
        The path.
    """
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    axes.semilogy(curve.step, curve.loss, color="#24557a", marker="." if len(curve) < 100 else None)
    axes.set(xlabel="optimiser step", ylabel="mean squared error of the action", title="Training")
    axes.grid(alpha=0.3, which="both")
    return _save(figure, path)


def plot_goals(episodes: pd.DataFrame, path: str | Path) -> Path:
    """Plots where the episodes of one task ended against where they should have.

    Args:
        episodes: Rows of ``lerobot_gcdt.evaluation.evaluate``.
        path: The PNG file to write.

    Returns:
        The path.
    """
    achieved, desired = (np.stack(episodes[key].to_list()) for key in ("achieved_goal", "desired_goal"))
    distance = np.linalg.norm(achieved - desired, axis=-1)
    held = episodes.held.to_numpy()
    figure, (above, ranked) = plt.subplots(1, 2, figsize=(9.5, 4.4), layout="constrained")
    for mask, color, label in ((held, REACHED, "held at the end"), (~held, MISSED, "not held")):
        for start, end in zip(desired[mask], achieved[mask], strict=True):
            above.plot([start[0], end[0]], [start[1], end[1]], color=color, linewidth=1)
        above.scatter(desired[mask, 0], desired[mask, 1], s=26, facecolor="none", edgecolor=color)
        above.scatter(achieved[mask, 0], achieved[mask, 1], s=8, color=color, label=f"{label} ({mask.sum()})")
    above.set(xlabel="x (su)", ylabel="y (su)", title="Goals (circles) and where the object ended (dots)")
    above.set_aspect("equal")
    above.legend(loc="upper right", fontsize=8)
    order = np.argsort(distance)
    ranked.bar(np.arange(len(order)), distance[order], color=np.where(held[order], REACHED, MISSED), width=1)
    ranked.set(xlabel="episode, by distance", ylabel="distance from the goal at the end (su)", yscale="log")
    ranked.set_title("Distance at the end (1 su = 0.2 m)")
    return _save(figure, path)


def _save(figure, path: str | Path) -> Path:
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return Path(path)
