"""What people look at: pictures of the tasks, films of a policy, the training curve, achieved against desired goals."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
from lerobot.utils.io_utils import write_video
from matplotlib.figure import Figure  # without pyplot: the backend of a notebook or a script stays as it is
from PIL import Image, ImageDraw
from tqdm import tqdm

import surrol_gym
from lerobot_gcdt.evaluation.rollout import rollout
from surrol_gym.envs.goal_env import GoalEnv
from surrol_gym.envs.psm_env import unwrapped
from surrol_gym.registry import find_law

REACHED, MISSED = "#1a7f5a", "#c0392b"


def film(
    policy: Any,
    task: str,
    seeds: Iterable[int],
    path: str | Path,
    size: int = 384,
    sensors: Mapping[str, Any] | None = None,
) -> list[bool]:
    """Films a policy, one episode after the other, at twice the speed of the simulation.

    Args:
        policy: As ``lerobot_gcdt.evaluation.evaluate`` takes it.
        task: Name of the task.
        seeds: Seed of the reset of each episode.
        path: The mp4 file to write.
        size: Width and height of the picture, pixels; even.
        sensors: As ``lerobot_gcdt.evaluation.evaluate`` takes them; the film shows the truth.

    Returns:
        Whether each episode ended in success.
    """
    frames, ended_well = [], []
    for seed in tqdm(list(seeds), desc="Filming", unit="episode"):
        captioned, succeeded = _episode(policy, task, seed, size, sensors)
        frames += [*captioned, *[captioned[-1]] * 5]
        ended_well.append(succeeded)
    write_video(path, frames, fps=2 * GoalEnv.metadata["render_fps"])
    return ended_well


def strips(policy: Any, task: str, seeds: Iterable[int], path: str | Path, columns: int = 6, size: int = 256) -> Path:
    """Draws episodes as strips of pictures, one below the other, from the first step to the last.

    Args:
        policy: As ``lerobot_gcdt.evaluation.evaluate`` takes it.
        task: Name of the task.
        seeds: Seed of the reset of each episode.
        path: The picture file to write, such as a PNG.
        columns: Pictures an episode, evenly spaced in time.
        size: Width and height of each, pixels.

    Returns:
        The path.
    """
    rows = []
    for seed in tqdm(list(seeds), desc="Drawing", unit="episode"):
        captioned, _ = _episode(policy, task, seed, size)
        chosen = np.linspace(0, len(captioned) - 1, columns).round().astype(int)
        rows.append(np.concatenate([captioned[t] for t in chosen], axis=1))
    Image.fromarray(np.concatenate(rows)).save(path)
    return Path(path)


def halfway(task: str, width: int = 320, height: int = 240) -> Image.Image:
    """Draws a task at the moment at which the expert, from seed 0, is half way to its first success.

    An expert that misses the goal is drawn half way to the time limit, and a task without an expert at its start.

    Args:
        task: Name of the task.
        width: Pixels.
        height: Pixels.

    Returns:
        The picture.
    """
    env = gym.make(surrol_gym.find_task(task))
    try:
        observation, _ = env.reset(seed=0)
        if find_law(type(unwrapped(env))):
            expert, actions, ended = surrol_gym.make_expert(env), [], False
            while not ended:
                actions.append(expert.act(observation))
                observation, _, _, truncated, info = env.step(actions[-1])
                ended = truncated or info["is_success"]
            env.reset(seed=0)
            for action in actions[: len(actions) // 2]:
                env.step(action)
        picture = Image.fromarray(unwrapped(env).picture("closeup", 2 * width, 2 * height))
    finally:
        env.close()
    return picture.resize((width, height), Image.Resampling.LANCZOS)


def plot_training(curve: pd.DataFrame, path: str | Path) -> Path:
    """Plots a training curve.

    Args:
        curve: Columns ``step`` and ``loss``.
        path: The PNG file to write.

    Returns:
        The path.
    """
    figure = Figure(figsize=(6, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.semilogy(curve.step, curve.loss, color="#24557a", marker="." if len(curve) < 100 else None)
    axes.set(xlabel="optimiser step", ylabel="training loss", title="Training")
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
    figure = Figure(figsize=(9.5, 4.4), layout="constrained")
    above, ranked = figure.subplots(1, 2)
    for mask, color, label in ((held, REACHED, "held at the end"), (~held, MISSED, "not held")):
        for start, end in zip(desired[mask], achieved[mask], strict=True):
            above.plot([start[0], end[0]], [start[1], end[1]], color=color, linewidth=1)
        above.scatter(desired[mask, 0], desired[mask, 1], s=26, facecolor="none", edgecolor=color)
        above.scatter(achieved[mask, 0], achieved[mask, 1], s=8, color=color, label=f"{label} ({mask.sum()})")
    above.set(xlabel="x (su)", ylabel="y (su)", title="Goals (circles), where objects ended (dots)")
    above.set_aspect("equal")
    order = np.argsort(distance)
    ranked.bar(np.arange(len(order)), distance[order], color=np.where(held[order], REACHED, MISSED), width=1)
    ranked.set(xlabel="episode, by distance", ylabel="distance from the goal at the end (su)", yscale="log")
    ranked.set_title("Distance at the end (1 su = 0.2 m)")
    figure.legend(loc="outside lower center", ncols=2, fontsize=9)
    return _save(figure, path)


def _episode(
    policy: Any, task: str, seed: int, size: int, sensors: Mapping[str, Any] | None = None
) -> tuple[list[np.ndarray], bool]:
    """Runs an episode; returns a captioned picture of every state, and whether it ended in success."""
    look = {"render_mode": "rgb_array", "width": size, "height": size}
    pictures: list[Any] = []
    success, _ = rollout(policy, task, [seed], lambda envs: pictures.append(envs.render()[0]), sensors, **look)
    succeeded = [False, *success[:, 0]]
    captioned = [
        _caption(picture, f"{task}, seed {seed}, step {t}", succeeded[t]) for t, picture in enumerate(pictures)
    ]
    return captioned, bool(succeeded[-1])


def _caption(picture: np.ndarray, text: str, success: bool) -> np.ndarray:
    """Writes a line onto a bar along the lower edge of a picture; the bar is green in success."""
    height, width = picture.shape[:2]
    bar = height // 16
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, height - bar, width, height), fill=REACHED if success else "#333333")
    draw.text((bar // 3, height - bar // 2), text, fill="white", font_size=0.75 * bar, anchor="lm")
    return np.asarray(image)


def _save(figure: Figure, path: str | Path) -> Path:
    figure.savefig(path, dpi=130)
    return Path(path)
