"""What a policy sees of a robot: LeRobot's commands put all of a robot's numbers into one vector."""

from collections.abc import Mapping, Sequence
from typing import Any

from lerobot_gcdt.keys import ACHIEVED_GOAL, GOAL, STATE


def with_goals(batch: dict[str, Any], task_dims: Mapping[str, Sequence[int]]) -> dict[str, Any]:
    """Takes the goals out of a robot's ``observation.state``, where they stand behind the observation.

    Args:
        batch: What ``select_action`` is given.
        task_dims: For each task sentence the sizes of observation, goal and action.

    Returns:
        The batch with ``observation.state``, ``observation.goal`` and ``observation.achieved_goal``; as it is where it
        has goals already, or a state of another size.
    """
    if GOAL in batch or STATE not in batch or "task" not in batch:
        return batch
    tasks = {batch["task"]} if isinstance(batch["task"], str) else set(batch["task"])
    sizes = {tuple(task_dims[task][:2]) for task in tasks if task in task_dims}
    if len(sizes) != 1:
        return batch
    [(size, goal)] = sizes
    state = batch[STATE]
    if state.shape[-1] != size + 2 * goal:
        return batch
    split = {STATE: state[..., :size], GOAL: state[..., size : size + goal], ACHIEVED_GOAL: state[..., size + goal :]}
    return batch | split
