"""Windows of frames for LeRobot's own policies, read from memory."""

from collections.abc import Iterator
from contextlib import contextmanager

import datasets
import torch
from lerobot.configs.train import TrainPipelineConfig
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.scripts import lerobot_train
from torch import Tensor


class Column:
    """A column of a dataset, of which some rows are asked for at a time.

    Args:
        rows: The column, shape (N, ...).
    """

    def __init__(self, rows: Tensor):
        self._rows = rows

    def __getitem__(self, indices: list[int]) -> tuple[Tensor, ...]:
        return self._rows[indices].unbind()


class RowsInMemory:
    """The rows of a dataset, whose columns of numbers are read once, when they are first asked for.

    `datasets` copies the description of the whole dataset whenever rows of a column are read, and LeRobot reads so
    each window of each column by itself. ``lerobot_gcdt.benchmark.speed`` tells what that costs.

    Args:
        rows: What LeRobot reads, with its transform.
    """

    def __init__(self, rows: datasets.Dataset):
        self._rows = rows
        self._numbers = {name for name, feature in rows.features.items() if _of_numbers(feature)}
        self._columns: dict[str, Column] = {}

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, which: str | int | list[int]) -> Column | dict | datasets.Column:
        if not isinstance(which, str) or which not in self._numbers:
            return self._rows[which]
        if which not in self._columns:
            self._columns[which] = Column(torch.stack(self._rows.select_columns([which])[:][which]))
        return self._columns[which]


@contextmanager
def windows_from_memory() -> Iterator[None]:
    """Lets `lerobot-train`, in this process, read the windows that policies learn from by ``RowsInMemory``.

    It has no option for that. What a policy is given stays the same.
    """
    make = lerobot_train.make_train_eval_datasets

    def make_in_memory(config: TrainPipelineConfig) -> tuple:
        dataset, evaluated = make(config)
        if isinstance(dataset, LeRobotDataset) and dataset.reader.delta_indices is not None:
            dataset.reader.hf_dataset = RowsInMemory(dataset.reader.hf_dataset)
        return dataset, evaluated

    lerobot_train.make_train_eval_datasets = make_in_memory
    try:
        yield
    finally:
        lerobot_train.make_train_eval_datasets = make


def _of_numbers(feature: object) -> bool:
    """Whether a column holds numbers or lists of them, and not texts or pictures."""
    while isinstance(feature, datasets.List):
        feature = feature.feature
    return isinstance(feature, datasets.Value) and feature.dtype.startswith(("float", "int", "uint", "bool"))
