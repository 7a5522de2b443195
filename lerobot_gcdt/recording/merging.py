"""Merging the datasets of several tasks into one, for cross-task training.

LeRobot merges datasets whose features are equal. The tasks' are not: so each dataset is first copied with its vectors
padded with zeros to the size of the largest one, and the merged metadata keep the layout of each task
(``lerobot_gcdt.data.task_layouts``). Columns that only some tasks can have, such as videos, are left out.
"""

import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import datasets
import numpy as np
from lerobot.datasets.aggregate import aggregate_datasets
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.utils.constants import DEFAULT_FEATURES
from tqdm import tqdm

from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.data.task_layouts import TaskLayout, padded_names, table_of, task_layouts
from lerobot_gcdt.keys import COLUMNS, PADDED, STATE
from lerobot_gcdt.locking import alone_in
from lerobot_gcdt.recording.facts import RECORDING_FILE
from lerobot_gcdt.recording.features import vector_feature
from lerobot_gcdt.recording.writing import save_episode, tidy_statistics


def merge(roots: Sequence[str | Path], root: str | Path) -> Path:
    """Merges datasets of ``gcdt record`` into one whose vectors are as long as the longest of them.

    The columns are ``lerobot_gcdt.keys.COLUMNS``; a line is printed for every other column that a dataset has.

    Args:
        roots: Folders of the datasets.
        root: Folder of the merged dataset. An interrupted merge keeps the copies that are whole, and goes on.

    Returns:
        The folder.

    Raises:
        OSError: Another process merges into the folder.
        ValueError: There are fewer than two datasets, one was not recorded by ``gcdt record`` or does not fit, or the
            folder exists.
    """
    sources, root = [Path(r) for r in roots], Path(root)
    if len(sources) < 2 or len({source.name for source in sources}) < len(sources):
        raise ValueError(f"Merging takes two or more folders of different names, got {list(map(str, sources))}.")
    for source in sources:
        if not (source / RECORDING_FILE).exists():
            raise ValueError(f"{source} is no dataset of `gcdt record`: {RECORDING_FILE} is missing there.")
    metas = [LeRobotDatasetMetadata(f"local/{source.name}", root=source) for source in sources]
    lacked = sorted({key for meta in metas for key in COLUMNS if key not in meta.features})
    if lacked:
        raise ValueError(f"Not every dataset has {', '.join(lacked)}; record them with `gcdt record`.")
    features = _padded_features(metas)
    parts = root.with_name(root.name + ".merging")
    with alone_in(parts):
        if root.exists():
            raise ValueError(f"{root} exists already; choose another folder or remove it.")
        for meta in metas:
            left_out = sorted(set(meta.features) - {*COLUMNS, *DEFAULT_FEATURES})
            if left_out:
                print(f"Left out of {root}: {', '.join(left_out)} of {meta.root}.")
        datasets.disable_progress_bars()
        folder = parts / "copies"  # of their own: a dataset may have any name
        folder.mkdir(exist_ok=True)
        copies = [
            _padded_copy(meta, features, folder / source.name, parts / "unfinished")
            for source, meta in tqdm(zip(sources, metas, strict=True), total=len(metas), desc="Padding", unit="dataset")
        ]
        whole = parts / "merged"
        shutil.rmtree(whole, ignore_errors=True)
        # Not merge_datasets, which opens the result afterwards and looks for a decoder of films.
        aggregate_datasets([f"local/{copy.name}" for copy in copies], f"local/{root.name}", copies, whole)
        tidy_statistics(whole)
        facts = {"merged_from": [json.loads((source / RECORDING_FILE).read_text()) for source in sources]}
        (whole / RECORDING_FILE).write_text(json.dumps(facts, indent=2) + "\n")
        os.replace(whole, root)
        for done in parts.glob("*/"):
            shutil.rmtree(done)
    return root


def _padded_features(metas: Sequence[LeRobotDatasetMetadata]) -> dict[str, dict]:
    """Returns LeRobot's description of the merged columns, with the natural layout of every task.

    Raises:
        ValueError: One task has different layouts.
    """
    features = {
        key: vector_feature(padded_names(key, max(meta.features[key]["shape"][0] for meta in metas)))
        if key in PADDED
        else {name: metas[0].features[key][name] for name in ("dtype", "shape", "names")}
        for key in COLUMNS
    }
    layouts: dict[str, TaskLayout] = {}
    for meta in metas:
        for task, layout in task_layouts(meta).items():
            if layouts.setdefault(task, layout) != layout:
                raise ValueError(
                    f"The task {task!r} has other numbers in {meta.root} than in the datasets before it: {layout}, not "
                    f"{layouts[task]}. Leave it out, or record it again with another task_description."
                )
    features[STATE] |= table_of(layouts)
    return features


def _padded_copy(meta: LeRobotDatasetMetadata, features: dict[str, dict], copy: Path, building: Path) -> Path:
    """Copies a dataset with its vectors padded, by way of a folder for what is not whole yet.

    A copy for the same merger that is there already is whole.
    """
    note = json.dumps([json.loads((meta.root / RECORDING_FILE).read_text()), features])
    if copy.exists():
        if (copy / RECORDING_FILE).exists() and (copy / RECORDING_FILE).read_text() == note:
            return copy
        shutil.rmtree(copy)
    shutil.rmtree(building, ignore_errors=True)
    dataset = LeRobotDataset.create(
        f"local/{copy.name}",
        fps=meta.fps,
        features=features,
        root=building,
        robot_type=meta.robot_type,
        use_videos=False,
        video_backend="pyav",
    )
    columns = read_columns(meta.root, (*COLUMNS, "episode_index", "task_index"))
    episodes = columns["episode_index"]
    sentences = list(meta.tasks.sort_values("task_index").index)
    for i, episode in enumerate(episodes):
        frame = {key: _padded(columns[key][i : i + 1].reshape(-1), features[key]["shape"][0]) for key in COLUMNS}
        dataset.add_frame(frame | {"task": sentences[columns["task_index"][i]]})
        if i + 1 == len(episodes) or episodes[i + 1] != episode:
            save_episode(dataset)
    dataset.finalize()
    (building / RECORDING_FILE).write_text(note)
    os.replace(building, copy)
    return copy


def _padded(vector: np.ndarray, size: int) -> np.ndarray:
    return np.pad(vector, (0, size - len(vector)))
