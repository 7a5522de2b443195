"""Which episodes of a dataset are trained on.

LeRobot hands a policy the metadata of its dataset, which say neither that the dataset was opened with some of its
episodes only (`--dataset.episodes`, `--dataset.eval_split`) nor that it is streamed. A policy that reads whole episodes
by itself has to know both. So every dataset that is opened after the import of this module notes them in its metadata,
and metadata without a note are refused.
"""

import functools
from collections.abc import Callable
from typing import Any

from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.datasets.streaming_dataset import StreamingLeRobotDataset

_NOTE, _STREAMED = "opened_episodes", "streamed"


def opened_episodes(meta: LeRobotDatasetMetadata) -> list[int] | None:
    """Returns the episodes that the dataset of some metadata was opened with, None for all.

    Args:
        meta: Metadata of a dataset, or metadata that were opened by themselves and stand for all episodes.

    Raises:
        ValueError: The dataset is streamed, or was opened before ``lerobot_gcdt`` was imported.
    """
    if not hasattr(meta, _NOTE):
        raise ValueError(
            f"Nothing tells which episodes of {meta.repo_id} are trained on: open it, as a LeRobotDataset, after "
            "`import lerobot_gcdt`."
        )
    note = getattr(meta, _NOTE)
    if note == _STREAMED:
        raise ValueError(
            "Whole trajectories are read into memory, so a streamed dataset cannot be trained on; pass "
            "--dataset.streaming=false."
        )
    return note


def _note_when_opened(kind: Any, note: Callable) -> None:
    """Lets objects of a class note something once they are made."""
    original = kind.__init__

    @functools.wraps(original)
    def __init__(self: Any, *args: Any, **kwargs: Any) -> None:
        original(self, *args, **kwargs)
        note(self)

    kind.__init__ = __init__


_note_when_opened(LeRobotDatasetMetadata, lambda meta: setattr(meta, _NOTE, None))
_note_when_opened(LeRobotDataset, lambda dataset: setattr(dataset.meta, _NOTE, dataset.episodes))
_note_when_opened(StreamingLeRobotDataset, lambda dataset: setattr(dataset.meta, _NOTE, _STREAMED))
