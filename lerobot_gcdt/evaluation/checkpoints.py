"""Evaluating checkpoints: every episode is kept beside the checkpoint, and none is run twice."""

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from filelock import FileLock
from huggingface_hub import hf_hub_download
from huggingface_hub.constants import SAFETENSORS_SINGLE_FILE

from lerobot_gcdt.evaluation.loading import load_policy
from lerobot_gcdt.evaluation.rollout import evaluate
from lerobot_gcdt.evaluation.tasks import check_starts, tasks_of
from surrol_gym.registry import find_task, task_name
from surrol_gym.wrappers import IDEAL, complete_sensors


def episodes_file(checkpoint: str | Path) -> Path:
    """Returns the file that keeps a checkpoint's episodes, beside its folder ``pretrained_model``."""
    return Path(checkpoint).resolve().parent / "episodes.parquet"


def evaluate_checkpoint(
    checkpoint: str | Path,
    tasks: Sequence[str] | None = None,
    seeds: Sequence[int] = range(100_000, 100_100),
    batch_size: int = 25,
    file: str | Path | None = None,
    sensors: Mapping[str, Any] | None = None,
) -> pd.DataFrame:
    """Evaluates a checkpoint, on those of the starts that none of its kept episodes has.

    Every batch is kept as soon as it is finished, so an evaluation that was interrupted goes on. What was kept is never
    removed.

    Args:
        checkpoint: Folder ``pretrained_model`` of a checkpoint of `lerobot-train`; with a file, any folder of a policy,
            or a repository on the Hub.
        tasks: Names of tasks, of which those count that the policy knows; None for all that it knows.
        seeds: Seeds of the starts. Demonstrations count up from 0; those from 100000 on are for reporting.
        batch_size: Episodes that run side by side.
        file: Parquet file that keeps the episodes of this checkpoint alone, of one kind of sensors; None for the one
            beside it, which is for perfect ones.
        sensors: As ``lerobot_gcdt.evaluation.evaluate`` takes them.

    Returns:
        The episodes of these tasks and seeds, rows of ``lerobot_gcdt.evaluation.evaluate``, each task once; ``policy``
        tells whose they are, the beginning of a digest of the weights, in all but those that earlier versions kept.

    Raises:
        ValueError: There is no file, and the folder is none of `lerobot-train`; a task or a number is bad, the policy
            does not know the tasks, or the file is for other sensors or keeps episodes of another policy.
    """
    if file is None and Path(checkpoint).resolve().name != "pretrained_model":
        raise ValueError(
            f"{checkpoint} is no folder pretrained_model, beside which its episodes could be kept; say where to keep "
            "them, as in --episodes episodes.parquet."
        )
    file = Path(file) if file else episodes_file(checkpoint)
    described = complete_sensors(sensors, IDEAL)
    for_others = described != IDEAL and file.resolve() == episodes_file(checkpoint)
    if for_others or keeps_other_sensors(file, described):
        told = ", ".join(f"{name} {value:g}" for name, value in described.items())
        raise ValueError(f"{file} is not for episodes of sensors with {told}; name another file with --episodes.")
    tasks, policy = tasks_of(checkpoint, tasks), None
    check_starts(tasks, seeds)
    weights = _weights(checkpoint)
    if others := set(_read(file).reindex(columns=["policy"]).policy.dropna()) - {weights}:
        raise ValueError(
            f"{file} keeps episodes of the policy {', '.join(others)}, and {checkpoint} is {weights}; name another "
            "file with --episodes."
        )
    names = {task_name(find_task(task)): task for task in tasks}
    for name, task in names.items():
        kept = _read(file)
        if missing := sorted(set(seeds) - set(kept.seed[kept.task == name])):
            policy = policy or load_policy(checkpoint)
            evaluate(
                *(policy, [task], missing, batch_size),
                on_batch=lambda episodes: keep_episodes(file, episodes.assign(policy=weights)),
                sensors=sensors,
            )
    asked = pd.MultiIndex.from_product([names, seeds], names=["task", "seed"])
    return _read(file).set_index(["task", "seed"]).loc[asked].reset_index()


def keeps_other_sensors(file: Path, sensors: Mapping[str, Any]) -> bool:
    """Returns whether a file keeps episodes of other sensors than these, all arguments of them."""
    kept = _read(file).reindex(columns=[*IDEAL]).fillna(IDEAL)
    return not (kept == pd.Series(sensors)).all(axis=None)


def _weights(checkpoint: str | Path) -> str:
    """What tells a policy from others: the beginning of a digest of its weights."""
    file = Path(checkpoint) / SAFETENSORS_SINGLE_FILE
    found = file if file.exists() else hf_hub_download(str(checkpoint), SAFETENSORS_SINGLE_FILE)
    with open(found, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()[:12]


def _read(file: Path) -> pd.DataFrame:
    """The kept episodes; ValueError names a file of another kind."""
    if not file.exists():
        return pd.DataFrame(columns=["task", "seed"])
    try:
        kept = pd.read_parquet(file)
    except ValueError as error:
        raise ValueError(f"{file} is no Parquet file that keeps episodes; name another one.") from error
    if not {"task", "seed"} <= {*kept}:
        raise ValueError(f"{file} keeps {', '.join(map(str, kept))}, but no episodes; name another file.")
    return kept


def keep_episodes(file: Path, episodes: pd.DataFrame, key: Sequence[str] = ("task", "seed")) -> None:
    """Adds episodes to those in a Parquet file; another process may do so at the same time.

    Args:
        file: The file.
        episodes: Rows of ``lerobot_gcdt.evaluation.evaluate``, maybe with further columns.
        key: Columns that tell episodes apart; of one that is there already, the row that is there stays.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(file.with_suffix(".lock")):
        if file.exists():
            episodes = pd.concat([pd.read_parquet(file), episodes]).drop_duplicates([*key], ignore_index=True)
        unfinished = file.with_suffix(".unfinished")
        episodes.to_parquet(unfinished)
        os.replace(unfinished, file)
