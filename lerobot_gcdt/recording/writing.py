"""Writing datasets, at the speed of LeRobot's writer less a search that finds nothing."""

import json
import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import datasets
import gymnasium as gym
import numpy as np
from lerobot.datasets import dataset_writer
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_gcdt.keys import TIME_TO_GOAL
from lerobot_gcdt.recording.facts import RECORDING_FILE
from lerobot_gcdt.recording.features import Extras, describe_columns
from surrol_gym.envs.psm_env import unwrapped

EMBED = "embed_images"
"""Function of LeRobot 0.6.1's writer that goes through an episode row by row for pictures to put into the rows."""


def save_episode(dataset: LeRobotDataset, **options: Any) -> None:
    """Saves the episode whose frames were added last.

    Rows without pictures, as ours are (films are files of their own), are not searched for any, which at 3 ms a row
    takes three quarters of the time. A LeRobot without this search is left alone.

    Args:
        dataset: The dataset.
        **options: Arguments of ``LeRobotDataset.save_episode``.
    """
    search = getattr(dataset_writer, EMBED, None)
    if search is None or any(feature["dtype"] == "image" for feature in dataset.meta.features.values()):
        dataset.save_episode(**options)
        return
    setattr(dataset_writer, EMBED, lambda rows: rows)
    try:
        dataset.save_episode(**options)
    finally:
        setattr(dataset_writer, EMBED, search)


def build_dataset(
    env: gym.Env, extras: Extras, episodes: Iterable[dict[str, np.ndarray]], facts: dict, building: Path, root: Path
) -> None:
    """Writes episodes as a LeRobot dataset beside its final place and moves it there in one step.

    Args:
        env: The task's environment.
        extras: What the episodes hold beside what all do.
        episodes: What ``to_columns`` gives of each.
        facts: What ``meta/surrol.json`` says; the steps to success are added.
        building: Where the dataset is written; what an interrupted call left there is removed.
        root: Folder of the dataset.
    """
    shutil.rmtree(building, ignore_errors=True)
    datasets.disable_progress_bars()
    dataset = LeRobotDataset.create(
        f"local/{root.name}",
        fps=env.metadata["render_fps"],
        features=describe_columns(env, extras),
        root=building,
        robot_type="dvrk_psm",
        use_videos=bool(extras.cameras),
        video_backend="pyav",
    )
    steps = []
    for columns in episodes:
        steps.append(int(columns[TIME_TO_GOAL][0, 0]))
        for t in range(len(columns[TIME_TO_GOAL])):
            frame = {key: values[t] for key, values in columns.items()}
            dataset.add_frame(frame | {"task": unwrapped(env).task_description})
        save_episode(dataset, parallel_encoding=False)  # that would fork, which a worker of `--all` may not
    dataset.finalize()
    tidy_statistics(building)
    (building / RECORDING_FILE).write_text(json.dumps(facts | {"steps_to_success": steps}, indent=2) + "\n")
    root.parent.mkdir(parents=True, exist_ok=True)
    os.replace(building, root)


def tidy_statistics(root: Path) -> None:
    """Brings a dataset's statistics into order, and makes those of constants exact.

    LeRobot writes them in the order of a set, which differs by process. It rounds the mean of what never changes and
    finds a deviation, so that a goal's constant, normalised by them, would be as large as 191 instead of 0.
    """
    path = root / "meta/stats.json"
    statistics = json.loads(path.read_text())
    for column in statistics.values():
        least = np.array(column["min"])
        constant = least == np.array(column["max"])
        for name, exact in (("mean", least), ("std", 0.0)):
            column[name] = np.where(constant, exact, column[name]).tolist()
    path.write_text(json.dumps(statistics, indent=4, sort_keys=True) + "\n")
