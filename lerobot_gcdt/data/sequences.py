"""Pieces of trajectories, packed into rows for a transformer."""

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from lerobot_gcdt.data.task_layouts import sizes_of
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, REQUIRED_KEYS, STATE


@dataclass
class Sequences:
    """Pieces of trajectories packed side by side into rows: R rows of S steps.

    Attributes:
        items: What each step holds, by dataset key: tensors of shape (R, S, size); time-to-goal has size 1.
        timestep: Step within its episode, shape (R, S).
        segment: Which piece a step belongs to, shape (R, S); -1 marks padding.
        source: Which frame of the batch the piece came from, shape (R, S).
        key: What random numbers for the piece are drawn by, shape (R, S).
        task: Index of the step's task in the dataset, shape (R, S).
        relabelled: Whether a step's goal was replaced in hindsight, shape (R, S).
    """

    items: dict[str, Tensor]
    timestep: Tensor
    segment: Tensor
    source: Tensor
    key: Tensor
    task: Tensor
    relabelled: Tensor

    @classmethod
    def of_windows(cls, batch: dict, task_dims: dict[str, list[int]]) -> "Sequences":
        """Takes windows as a loader gives them: LeRobot's with ``delta_timestamps``, or another.

        Args:
            batch: ``REQUIRED_KEYS`` of shape (B, S, size), ``frame_index`` (B, S), ``index`` (B,), ``task``, a sentence
                for each row, and booleans ``action_is_pad`` (B, S) where windows reach beyond their episodes.
            task_dims: Sizes of observation, goal and action by task sentence; a task's index is its place here.

        Returns:
            A row and a segment a window.

        Raises:
            KeyError: The batch lacks something, or holds a task that is none of ``task_dims``.
            ValueError: Items have fewer numbers than a task needs.
        """
        needed = (*REQUIRED_KEYS, "frame_index", "index", "task")
        missing = [key for key in needed if key not in batch]
        if missing:
            raise KeyError(f"Windows must hold {', '.join(needed)}; the batch lacks {', '.join(missing)}.")
        for task in dict.fromkeys(batch["task"]):
            state, goal, action = sizes_of(task, task_dims)
            for key, size in ((STATE, state), (GOAL, goal), (ACHIEVED_GOAL, goal), (ACTION, action)):
                if batch[key].ndim != 3 or batch[key].shape[-1] < size:
                    raise ValueError(
                        f"{key} must have the shape (windows, steps, {size}) for the task {task!r}, "
                        f"got {tuple(batch[key].shape)}."
                    )
        timestep = batch["frame_index"]
        shape, device = timestep.shape, timestep.device
        row = torch.arange(shape[0], device=device)[:, None].expand(shape)
        padded = batch.get("action_is_pad", torch.zeros_like(timestep, dtype=torch.bool))
        places = {task: i for i, task in enumerate(task_dims)}
        task = torch.tensor([places[task] for task in batch["task"]], device=device)
        return cls(
            items={key: batch[key].float().reshape(*shape, -1) for key in REQUIRED_KEYS},
            timestep=timestep,
            segment=row.masked_fill(padded, -1),
            source=row,
            key=batch["index"][:, None].expand(shape),
            task=task[:, None].expand(shape),
            relabelled=torch.zeros_like(padded),
        )

    @property
    def real(self) -> Tensor:
        """Marks the steps that are no padding, shape (R, S)."""
        return self.segment >= 0

    @cached_property
    def by_task(self) -> dict[int, tuple[Tensor, ...]]:
        """Positions of the real steps of each task present, as indices into (R, S)."""
        present = self.task[self.real].unique().tolist()
        return {i: torch.nonzero(self.real & (self.task == i), as_tuple=True) for i in present}
