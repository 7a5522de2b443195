"""What a policy is given to act on, also by a robot: LeRobot's commands put all of its numbers into one vector."""

from collections.abc import Mapping, Sequence
from typing import Any

from lerobot_gcdt.data.task_layouts import sizes_of
from lerobot_gcdt.keys import ACHIEVED_GOAL, GOAL, STATE


def with_goals(batch: dict[str, Any], task_dims: Mapping[str, Sequence[int]]) -> dict[str, Any]:
    """Takes the goals out of a robot's ``observation.state``, where they stand behind the observation.

    Goals of a single frame get the batch dimension that LeRobot's processors give to its observation alone.

    Args:
        batch: What ``select_action`` is given.
        task_dims: For each task sentence the sizes of observation, goal and action.

    Returns:
        The batch with ``observation.state``, ``observation.goal`` and ``observation.achieved_goal``; otherwise as it is
        where it has goals already, or a state of another size.

    Raises:
        KeyError: A task sentence is unknown.
    """
    if STATE in batch and batch[STATE].ndim == 2:
        single = {key: batch[key][None] for key in (GOAL, ACHIEVED_GOAL) if key in batch and batch[key].ndim == 1}
        batch = batch | single if single else batch
    sizes = {tuple(sizes_of(task, task_dims)[:2]) for task in _tasks(batch)}
    if GOAL in batch or STATE not in batch or len(sizes) != 1:
        return batch
    [(size, goal)] = sizes
    state = batch[STATE]
    if state.shape[-1] != size + 2 * goal:
        return batch
    split = {STATE: state[..., :size], GOAL: state[..., size : size + goal], ACHIEVED_GOAL: state[..., size + goal :]}
    return batch | split


def tasks_of(batch: Mapping[str, Any], task_dims: Mapping[str, Sequence[int]]) -> list[str]:
    """Returns the task sentence of each row after checking that a policy can act on the batch.

    Args:
        batch: As ``with_goals`` returns it.
        task_dims: For each task sentence the sizes of observation, goal and action.

    Raises:
        KeyError: An observation is missing.
        ValueError: Observations have other sizes than the task's.
    """
    needed = (STATE, GOAL, ACHIEVED_GOAL, "task")
    missing = [key for key in needed if key not in batch]
    if missing:
        raise KeyError(f"select_action needs {', '.join(needed)}; the batch lacks {', '.join(missing)}.")
    tasks = _tasks(batch)
    for task in dict.fromkeys(tasks):
        state, goal, _ = sizes_of(task, task_dims)
        for key, size in ((STATE, state), (GOAL, goal), (ACHIEVED_GOAL, goal)):
            # Several tasks in one batch share a tensor, padded to the largest of them.
            width = batch[key].shape[-1] if len(set(tasks)) > 1 else size
            if batch[key].shape != (len(tasks), max(width, size)):
                raise ValueError(
                    f"{key} must have the shape ({len(tasks)}, {size}) for the task {task!r}, "
                    f"got {tuple(batch[key].shape)}."
                )
    return tasks


def _tasks(batch: Mapping[str, Any]) -> list[str]:
    tasks = batch.get("task", ())
    return [tasks] if isinstance(tasks, str) else list(tasks)
