"""The trajectory bank: a whole dataset as tensors, and pieces of episodes, hindsight and packing by index.

LeRobot's loader decodes a window of 50 steps for 64 samples in more than a second; a gather from memory takes a
millisecond. The policy therefore asks the loader for single frames and looks the rest up here by their ``index``.
"""

from dataclasses import dataclass
from functools import cached_property
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
    """Pieces of trajectories packed side by side into rows: R rows of S steps.

    Attributes:
        items: What each step holds, by dataset key: tensors of shape (R, S, size); time-to-goal has size 1.
        timestep: Step within its episode, shape (R, S).
        segment: Which piece a step belongs to, shape (R, S); -1 marks padding.
        source: Which frame of the batch the piece came from, shape (R, S).
        task: Index of the step's task in the dataset, shape (R, S).
    """

    items: dict[str, Tensor]
    timestep: Tensor
    segment: Tensor
    source: Tensor
    task: Tensor

    @property
    def real(self) -> Tensor:
        """Marks the steps that are no padding, shape (R, S)."""
        return self.segment >= 0

    @cached_property
    def by_task(self) -> dict[int, tuple[Tensor, Tensor]]:
        """Positions of the real steps of each task present, as indices into (R, S)."""
        present = self.task[self.real].unique().tolist()
        return {i: torch.nonzero(self.real & (self.task == i), as_tuple=True) for i in present}


@dataclass
class Pieces:
    """Pieces of episodes, before they are cut and packed; tensors of shape (P,).

    Attributes:
        first: Index of the first frame.
        last: Index of the last frame.
        source: Which frame of the batch asked for the piece.
    """

    first: Tensor
    last: Tensor
    source: Tensor


class TrajectoryBank:
    """All frames of a LeRobot dataset in memory.

    Args:
        root: Folder of the dataset; its ``data/`` parquet files are read once.
        device: Where the tensors live.
        training_episodes: Episodes that ``even`` may choose from, None for all.

    Raises:
        FileNotFoundError: There are no data files, as with ``--dataset.streaming=true``.
        KeyError: The dataset lacks one of ``REQUIRED_KEYS``.
    """

    def __init__(
        self, root: str | Path, device: str | torch.device = "cpu", training_episodes: list[int] | None = None
    ):
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
            name: torch.from_numpy(np.concatenate([to_array(table[name]) for table in tables])).to(device)
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
        training = torch.ones(n, dtype=torch.bool, device=device)
        if training_episodes is not None:
            training = torch.isin(self.episode, torch.tensor(training_episodes, device=device))
        self._training_order = torch.nonzero(training).flatten()
        self._training_frames = [
            torch.nonzero(training & (self.task == i)).flatten() for i in self.task[training].unique().tolist()
        ]

    def __len__(self) -> int:
        return len(self.timestep)

    def expected_steps(self, task: int) -> float:
        """Returns the mean time-to-goal at the start of the episodes of one task, steps."""
        starts = (self.timestep == 0) & (self.task == task)
        return float(self.items[TIME_TO_GOAL][starts].mean())

    def even(self, index: Tensor) -> Tensor:
        """Spreads frames evenly over the tasks, whatever the sizes of their shares of the dataset.

        The frames for training in their order are cut into as many equal stretches as there are tasks, and each
        stretch is laid over one task. Frames that the loader draws uniformly so become uniform over the tasks, and
        over the frames of each.

        Args:
            index: Frames for training, shape (B,).

        Returns:
            Frames for training, shape (B,).
        """
        by_task = self._training_frames
        if len(by_task) == 1:
            return index
        place = torch.searchsorted(self._training_order, index) * len(by_task)
        count = len(self._training_order)
        stretch, within = place // count, place % count
        return torch.stack([frames[within * len(frames) // count] for frames in by_task])[
            stretch, torch.arange(len(index), device=index.device)
        ]

    def pieces(self, index: Tensor, length: int) -> Pieces:
        """Cuts the episodes of frames into pieces of some length; the last piece of each may be shorter.

        Args:
            index: Frames, shape (B,).
            length: Steps of a piece.

        Returns:
            All pieces of the episode of each frame.
        """
        first, last = self.first[index], self.last[index]
        counts = (last - first) // length + 1
        source = torch.repeat_interleave(torch.arange(len(index), device=index.device), counts)
        number = torch.arange(len(source), device=index.device) - (counts.cumsum(0) - counts)[source]
        start = first[source] + number * length
        return Pieces(start, torch.minimum(start + length - 1, last[source]), source)

    def draw_cuts(self, pieces: Pieces, hindsight_ratio: float, generator: torch.Generator | None = None) -> Tensor:
        """Draws the frames in whose achieved goals pieces are relabelled in hindsight.

        Each is uniform over what its episode holds from the piece's first frame on. With whole episodes as pieces and
        a ratio of 1 this is the paper's mix (Fu et al. 2024, section III-B): every truncation of a demonstration, and
        in place of the empty one the demonstration itself.

        Args:
            pieces: The pieces.
            hindsight_ratio: Probability of relabelling.
            generator: Where the randomness comes from, on the CPU.

        Returns:
            Frames, shape (P,); the first frame of a piece stands for no relabelling.
        """
        first = pieces.first
        draw = torch.rand(2, len(first), generator=generator).to(first.device)
        ahead = (draw[0] * (self.last[first] - first + 1)).long()
        return torch.where(draw[1] < hindsight_ratio, first + ahead, first)

    def sequences(self, pieces: Pieces, cuts: Tensor | None = None) -> Sequences:
        """Relabels pieces of episodes and packs them into rows.

        A relabelled piece ends before its cut and has the cut's achieved goal as the goal of *every* step;
        time-to-goal counts down to the cut. (The action at the cut leaves the goal and is no part of the way there.)
        Other pieces keep their goal.

        Args:
            pieces: The pieces.
            cuts: Frames as ``draw_cuts`` gives them, shape (P,); None relabels nothing.

        Returns:
            The packed pieces; segment i is piece i.
        """
        first, last = pieces.first, pieces.last
        cuts = first if cuts is None else cuts
        last = torch.where(cuts > first, torch.minimum(last, cuts - 1), last)
        segment, offset = _pack((last - first + 1).tolist(), first.device)
        frames = (first[segment] + offset).clamp(max=len(self) - 1)
        items = {key: value[frames] for key, value in self.items.items()}
        cut = cuts[segment]
        hindsight = (cut > first[segment])[..., None]
        items[GOAL] = torch.where(hindsight, self.items[ACHIEVED_GOAL][cut], items[GOAL])
        items[TIME_TO_GOAL] = torch.where(hindsight, (cut - frames)[..., None], items[TIME_TO_GOAL])
        return Sequences(items, self.timestep[frames], segment, pieces.source[segment], self.task[frames])


def _pack(lengths: list[int], device: torch.device) -> tuple[Tensor, Tensor]:
    """Packs sequences into rows as long as the longest one, longest first, each into the first row with room.

    Returns:
        Which sequence each slot belongs to (-1: none) and the step within it, both of shape (rows, longest).
    """
    capacity = max(lengths)
    if min(lengths) == capacity:
        shape = len(lengths), capacity
        segment = torch.arange(len(lengths), device=device)[:, None].expand(shape)
        return segment, torch.arange(capacity, device=device).expand(shape)
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


def to_array(column) -> np.ndarray:
    """A parquet column as an array: (N,) for scalars, (N, size) for lists."""
    array = column.combine_chunks()
    if hasattr(array, "flatten") and str(array.type).startswith(("list", "fixed_size_list", "large_list")):
        return array.flatten().to_numpy(zero_copy_only=False).reshape(len(array), -1)
    return array.to_numpy(zero_copy_only=False)


def _two_dimensional(x: Tensor) -> Tensor:
    return x if x.ndim == 2 else x[:, None]
