"""The trajectory bank: a whole dataset as tensors, and windows, hindsight and packing by index.

LeRobot's loader decodes a window of 50 steps for 64 samples in more than a second; a gather from memory takes a
millisecond. The policy therefore asks the loader for single frames and looks the rest up here by their ``index``.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import torch
from torch import Tensor

STATE = "observation.state"
GOAL = "observation.goal"
ACHIEVED_GOAL = "observation.achieved_goal"
TIME_TO_GOAL = "observation.time_to_goal"
ACTION = "action"
REQUIRED_KEYS = (STATE, GOAL, ACHIEVED_GOAL, TIME_TO_GOAL, ACTION)


@dataclass
class Sequences:
    """Trajectories packed side by side into rows: R rows of S steps.

    Attributes:
        items: What each step holds, by dataset key: tensors of shape (R, S, size); time-to-goal has size 1.
        timestep: Step within its episode, shape (R, S).
        segment: Which trajectory of the batch a step belongs to, shape (R, S); -1 marks padding.
        task: Index of the step's task in the dataset, shape (R, S).
    """

    items: dict[str, Tensor]
    timestep: Tensor
    segment: Tensor
    task: Tensor

    @property
    def real(self) -> Tensor:
        """Marks the steps that are no padding, shape (R, S)."""
        return self.segment >= 0


class TrajectoryBank:
    """All frames of a LeRobot dataset in memory.

    Args:
        root: Folder of the dataset; its ``data/`` parquet files are read once.
        device: Where the tensors live.

    Raises:
        FileNotFoundError: There are no data files, as with ``--dataset.streaming=true``.
        KeyError: The dataset lacks one of ``REQUIRED_KEYS``.
    """

    def __init__(self, root: str | Path, device: str | torch.device = "cpu"):
        files = sorted(Path(root).glob("data/*/*.parquet"))
        if not files:
            raise FileNotFoundError(
                f"No data files under {Path(root) / 'data'}: GCDT reads whole trajectories into memory, which a "
                "streamed dataset does not have. Train with --dataset.streaming=false."
            )
        missing = [key for key in REQUIRED_KEYS if key not in pq.read_schema(files[0]).names]
        if missing:
            raise KeyError(
                f"The dataset in {root} lacks {', '.join(missing)}; GCDT needs {', '.join(REQUIRED_KEYS)}. "
                "Record one with `gcdt record`."
            )
        columns = (*REQUIRED_KEYS, "episode_index", "frame_index", "task_index")
        tables = [pq.read_table(file, columns=list(columns)) for file in files]
        column = {
            name: torch.from_numpy(np.concatenate([_to_array(table[name]) for table in tables])).to(device)
            for name in columns
        }
        self.items: dict[str, Tensor] = {key: _two_dimensional(column[key]).float() for key in REQUIRED_KEYS}
        self.timestep: Tensor = column["frame_index"]
        self.episode: Tensor = column["episode_index"]
        self.task: Tensor = column["task_index"]
        n = len(self.timestep)
        self.first: Tensor = torch.arange(n, device=device) - self.timestep
        """Index of the first frame of each frame's episode, shape (N,)."""
        lengths = torch.bincount(self.episode, minlength=int(self.episode.max()) + 1)
        self.last: Tensor = self.first + lengths[self.episode] - 1
        """Index of the last frame of each frame's episode, shape (N,)."""

    def __len__(self) -> int:
        return len(self.timestep)

    def expected_steps(self, task: int) -> float:
        """Returns the mean time-to-goal at the start of the episodes of one task, steps."""
        starts = (self.timestep == 0) & (self.task == task)
        return float(self.items[TIME_TO_GOAL][starts].mean())

    def windows(self, index: Tensor, length: int) -> tuple[dict[str, Tensor], Tensor]:
        """Gathers the steps that lead up to frames, as LeRobot's ``delta_timestamps`` do.

        Args:
            index: Frames, shape (B,).
            length: Steps a window, its last being the frame itself.

        Returns:
            The items, each of shape (B, length, size), and what of them is padding, shape (B, length): steps before
            the episode repeat its first frame.
        """
        wanted = index[:, None] + torch.arange(1 - length, 1, device=index.device)
        first = self.first[index][:, None]
        frames = torch.maximum(wanted, first)
        return {key: value[frames] for key, value in self.items.items()}, wanted < first

    def sequences(self, index: Tensor, relabel: Tensor) -> Sequences:
        """Cuts trajectories and packs them into rows.

        A relabelled trajectory ends before its frame and has that frame's achieved goal as the goal of *every* step;
        time-to-goal counts down to it. (The action at the cut leaves the goal and is no part of the way there.) Other
        trajectories are whole and keep their goal (Fu et al. 2024, section III-B).

        Args:
            index: Frames, shape (B,). The first frame of an episode cannot be a cut: its trajectory stays whole.
            relabel: Which trajectories to relabel, booleans of shape (B,).

        Returns:
            The packed trajectories; segment i is the one of ``index[i]``.
        """
        relabel = relabel & (self.timestep[index] > 0)
        last = torch.where(relabel, index - 1, self.last[index])
        first = self.first[index]
        segment, offset = _pack((last - first + 1).tolist(), index.device)
        frames = (first[segment] + offset).clamp(max=len(self) - 1)
        items = {key: value[frames] for key, value in self.items.items()}
        hindsight = relabel[segment][..., None]
        items[GOAL] = torch.where(hindsight, self.items[ACHIEVED_GOAL][index][segment], items[GOAL])
        items[TIME_TO_GOAL] = torch.where(hindsight, (index[segment] - frames)[..., None], items[TIME_TO_GOAL])
        return Sequences(items, self.timestep[frames], segment, self.task[frames])


def _pack(lengths: list[int], device: torch.device) -> tuple[Tensor, Tensor]:
    """Packs sequences into rows as long as the longest one, longest first, each into the first row with room.

    Returns:
        Which sequence each slot belongs to (-1: none) and the step within it, both of shape (rows, longest).
    """
    capacity = max(lengths)
    rows: list[list[int]] = []
    room: list[int] = []
    for i in sorted(range(len(lengths)), key=lambda i: -lengths[i]):
        row = next((r for r, free in enumerate(room) if free >= lengths[i]), len(rows))
        if row == len(rows):
            rows.append([])
            room.append(capacity)
        rows[row].append(i)
        room[row] -= lengths[i]
    segment = np.full((len(rows), capacity), -1)
    offset = np.zeros((len(rows), capacity), dtype=np.int64)
    for r, row in enumerate(rows):
        start = 0
        for i in row:
            segment[r, start : start + lengths[i]] = i
            offset[r, start : start + lengths[i]] = np.arange(lengths[i])
            start += lengths[i]
    return torch.from_numpy(segment).to(device), torch.from_numpy(offset).to(device)


def _to_array(column) -> np.ndarray:
    """A parquet column as an array: (N,) for scalars, (N, size) for lists."""
    array = column.combine_chunks()
    if hasattr(array, "flatten") and str(array.type).startswith(("list", "fixed_size_list", "large_list")):
        return array.flatten().to_numpy(zero_copy_only=False).reshape(len(array), -1)
    return array.to_numpy(zero_copy_only=False)


def _two_dimensional(x: Tensor) -> Tensor:
    return x if x.ndim == 2 else x[:, None]
