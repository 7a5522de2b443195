"""The trajectory bank: a whole dataset as tensors, and pieces of episodes, hindsight and packing by index.

LeRobot's loader decodes a window of 50 steps for 64 samples in more than a second; a gather from memory takes a
millisecond. The policy therefore asks the loader for single frames and looks the rest up here by their ``index``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from torch import Tensor

from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.data.draws import combine, uniform
from lerobot_gcdt.data.opened_episodes import opened_episodes
from lerobot_gcdt.data.sequences import Sequences
from lerobot_gcdt.data.task_layouts import task_layouts
from lerobot_gcdt.keys import ACHIEVED_GOAL, GOAL, REQUIRED_KEYS, STATE, TIME_TO_GOAL

# What a random number is for; others are in policy/objectives.py.
_TASK, _FRAME, _RELABEL, _CUT = range(4)


@dataclass
class Pieces:
    """Pieces of episodes, before they are cut and packed; tensors of shape (P,).

    Attributes:
        first: Index of the first frame.
        last: Index of the last frame.
        source: Which frame of the batch asked for the piece.
        key: What random numbers for the piece are drawn by.
    """

    first: Tensor
    last: Tensor
    source: Tensor
    key: Tensor


class TrajectoryBank:
    """All frames of a LeRobot dataset in memory.

    Args:
        root: Folder of the dataset; its ``data/`` parquet files are read once.
        device: Where the tensors live.
        training_episodes: Episodes that ``draw_pieces`` chooses from, None for all.
        goal_in_state: Where the observations of a task repeat its desired goal, by the task's index.

    Raises:
        FileNotFoundError: There are no data files.
        ValueError: Frames are missing or out of order.
    """

    def __init__(
        self,
        root: str | Path,
        device: str | torch.device = "cpu",
        training_episodes: list[int] | None = None,
        goal_in_state: Mapping[int, list[int]] | None = None,
    ):
        names = (*REQUIRED_KEYS, "index", "episode_index", "frame_index", "task_index")
        column = {name: torch.tensor(values, device=device) for name, values in read_columns(root, names).items()}
        _check_complete(column, Path(root))
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
        order = torch.nonzero(training).flatten()
        self._training_frames = order[self.task[order].argsort(stable=True)]  # task after task
        self._frames_of_task = self.task[order].unique(return_counts=True)[1]
        self._goal_in_state = {
            i: torch.tensor(places, device=device) for i, places in (goal_in_state or {}).items() if places
        }

    @classmethod
    def of(cls, meta: LeRobotDatasetMetadata, device: str | torch.device) -> "TrajectoryBank":
        """Reads the dataset whose metadata LeRobot hands to a policy; draws only from the episodes it trains on.

        Args:
            meta: The metadata.
            device: Where the tensors live.

        Raises:
            ValueError: One of ``REQUIRED_KEYS`` or frames are missing, or it cannot be known which episodes or numbers
                are whose (``lerobot_gcdt.data.opened_episodes``, ``lerobot_gcdt.data.task_layouts``).
            FileNotFoundError: There are no data files.
        """
        missing = [key for key in REQUIRED_KEYS if key not in meta.features]
        if missing:
            raise ValueError(
                f"The dataset in {meta.root} lacks {', '.join(missing)}; this policy needs {', '.join(REQUIRED_KEYS)}. "
                "Record one with `gcdt record`."
            )
        layouts = task_layouts(meta)
        goal_in_state = {int(meta.tasks.task_index[task]): layout.goal_in_state for task, layout in layouts.items()}
        bank = cls(meta.root, device, opened_episodes(meta), goal_in_state)
        if len(bank) != meta.total_frames:
            raise ValueError(
                f"{meta.root} holds {len(bank)} of the {meta.total_frames} frames of {meta.repo_id}; download the "
                "whole dataset again."
            )
        return bank

    def __len__(self) -> int:
        return len(self.timestep)

    def to(self, device: str | torch.device) -> "TrajectoryBank":
        """Moves the tensors to a device, if they are not there already; returns the bank."""
        if self.timestep.device != torch.device(device):
            for name, value in vars(self).items():
                if isinstance(value, Tensor):
                    setattr(self, name, value.to(device))
                else:
                    value.update({key: tensor.to(device) for key, tensor in value.items()})
        return self

    def training_starts(self, task: int) -> Tensor:
        """Returns the first frames of the episodes of one task that are trained on."""
        frames = self._training_frames
        return frames[(self.timestep[frames] == 0) & (self.task[frames] == task)]

    def expected_steps(self, task: int) -> float:
        """Returns the mean time-to-goal at the start of the training episodes of one task, steps."""
        return float(self.items[TIME_TO_GOAL][self.training_starts(task)].mean())

    def pieces(self, index: Tensor, length: int) -> Pieces:
        """Cuts the episodes of frames into pieces of some length; the last piece of each may be shorter.

        Args:
            index: Frames, shape (B,).
            length: Steps of a piece.

        Returns:
            All pieces of the episode of each frame.
        """
        source, number = self._numbered(index, length)
        return self._pieces(self.first[index][source] + number * length, length, source, combine(index[source], number))

    def draw_pieces(self, index: Tensor, length: int, step: Tensor | int, count: int | None = None) -> Pieces:
        """Draws pieces for training: of each task alike, however large its share of the dataset, and of any episode.

        What is drawn follows from the optimiser step and the frames of the batch, one by one
        (``lerobot_gcdt.data.draws``).

        Args:
            index: Frames, shape (B,).
            length: Steps of a piece.
            step: Number of the optimiser step, so that the same frames draw anew in every epoch.
            count: Pieces for each frame; None for as many as its episode has.

        Returns:
            The pieces.
        """
        if count is None:
            source, number = self._numbered(index, length)
        else:
            source = torch.arange(len(index), device=index.device).repeat_interleave(count)
            number = torch.arange(count, device=index.device).repeat(len(index))
        key = combine(step, index[source], number)
        sizes = self._frames_of_task
        task = (uniform(key, _TASK) * len(sizes)).long()
        place = (uniform(key, _FRAME) * sizes[task]).long()
        frame = self._training_frames[(sizes.cumsum(0) - sizes)[task] + place]
        return self._pieces(frame - self.timestep[frame] % length, length, source, key)

    def draw_cuts(self, pieces: Pieces, hindsight_ratio: float) -> Tensor:
        """Draws the frames in whose achieved goals pieces are relabelled in hindsight.

        Each is uniform over what its episode holds from the piece's first frame on. With whole episodes as pieces and
        a ratio of 1 this is the paper's mix (Fu et al. 2024, section III-B): every truncation of a demonstration, and
        in place of the empty one the demonstration itself.

        Args:
            pieces: The pieces.
            hindsight_ratio: Probability of relabelling.

        Returns:
            Frames, shape (P,); the first frame of a piece stands for no relabelling.
        """
        first = pieces.first
        ahead = (uniform(pieces.key, _CUT) * (self.last[first] - first + 1)).long()
        return torch.where(uniform(pieces.key, _RELABEL) < hindsight_ratio, first + ahead, first)

    def sequences(self, pieces: Pieces, cuts: Tensor | None = None) -> Sequences:
        """Relabels pieces of episodes and packs them into rows.

        A relabelled piece ends before its cut and has the cut's achieved goal as the goal of *every* step, also where
        its observations repeat the goal; time-to-goal counts down to the cut. (The action at the cut leaves the goal
        and is no part of the way there.) Other pieces keep their goal.

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
        relabelled = cut > first[segment]
        hindsight = relabelled[..., None]
        items[GOAL] = torch.where(hindsight, self.items[ACHIEVED_GOAL][cut], items[GOAL])
        items[TIME_TO_GOAL] = torch.where(hindsight, (cut - frames)[..., None], items[TIME_TO_GOAL])
        task = self.task[frames]
        for i, places in self._goal_in_state.items():
            rows, columns = torch.nonzero(relabelled & (task == i), as_tuple=True)
            items[STATE][rows[:, None], columns[:, None], places] = items[GOAL][rows, columns, : len(places)]
        source, key = pieces.source[segment], pieces.key[segment]
        return Sequences(items, self.timestep[frames], segment, source, key, task, relabelled)

    def _numbered(self, index: Tensor, length: int) -> tuple[Tensor, Tensor]:
        """Numbers the pieces of the episode of each frame: frame and number, from 0, of each piece."""
        counts = (self.last[index] - self.first[index]) // length + 1
        source = torch.repeat_interleave(torch.arange(len(index), device=index.device), counts)
        return source, torch.arange(len(source), device=index.device) - (counts.cumsum(0) - counts)[source]

    def _pieces(self, first: Tensor, length: int, source: Tensor, key: Tensor) -> Pieces:
        return Pieces(first, torch.minimum(first + length - 1, self.last[first]), source, key)


def _pack(lengths: list[int], device: torch.device) -> tuple[Tensor, Tensor]:
    """Packs sequences into rows as long as the longest one, longest first, each into the first row with room.

    Returns:
        Which sequence each slot belongs to (-1: none) and the step within it, both of shape (rows, longest).
    """
    capacity = max(lengths)
    if min(lengths) == capacity:
        shape = len(lengths), capacity
        number, step = (torch.arange(size, device=device) for size in shape)
        return number[:, None].expand(shape), step.expand(shape)
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
    for r, packed in enumerate(rows):
        start = 0
        for i in packed:
            segment[r, start : start + lengths[i]] = i
            offset[r, start : start + lengths[i]] = np.arange(lengths[i])
            start += lengths[i]
    return torch.from_numpy(segment).to(device), torch.from_numpy(offset).to(device)


def _check_complete(column: dict[str, Tensor], root: Path) -> None:
    """Raises if the frames are not all there, in order and in whole episodes: they are looked up by their place."""
    index, step, episode = (column[name] for name in ("index", "frame_index", "episode_index"))
    place = torch.arange(len(index), device=index.device)
    starts = torch.cat([episode.new_ones(1), episode.diff()]) != 0
    expected = place - torch.where(starts, place, 0).cummax(0).values
    if not (torch.equal(index, place) and torch.equal(step, expected)):
        wrong = int(torch.nonzero((index != place) | (step != expected))[0])
        raise ValueError(
            f"The frames in {root / 'data'} are incomplete or out of order: row {wrong} is frame {int(index[wrong])} "
            f"of the dataset and {int(step[wrong])} of episode {int(episode[wrong])}. Download the whole dataset again."
        )


def _two_dimensional(x: Tensor) -> Tensor:
    return x if x.ndim == 2 else x[:, None]
