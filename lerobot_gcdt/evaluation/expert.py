"""The scripted experts as policies: what those who learn from their demonstrations are held against."""

from collections.abc import Mapping

import torch
from torch import Tensor

from lerobot_gcdt.keys import ACHIEVED_GOAL, GOAL, STATE
from surrol_gym.experts import Expert
from surrol_gym.registry import env_class, find_law


class ExpertPolicy:
    """The expert of a task; it acts by what the policies of the task see.

    Args:
        task: Name of the task.

    Raises:
        ValueError: The task is unknown, or has no expert.
    """

    def __init__(self, task: str):
        environment = env_class(task)
        law = find_law(environment)
        if law is None:
            raise ValueError(f"{task} has no scripted expert.")
        self._expert = Expert(environment, law)

    def reset(self) -> None:
        """Does nothing: an expert keeps no state."""

    def select_action(self, batch: Mapping[str, Tensor]) -> Tensor:
        """Returns the action for each row of ``observation.*``, shape (B, A)."""
        rows = zip(*(batch[key].numpy() for key in (STATE, ACHIEVED_GOAL, GOAL)), strict=True)
        names = ("observation", "achieved_goal", "desired_goal")
        actions = [self._expert.act(dict(zip(names, row, strict=True))) for row in rows]
        return torch.stack([torch.from_numpy(action) for action in actions])
