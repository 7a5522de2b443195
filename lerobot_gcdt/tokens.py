"""Task-specific tokenizers and heads (Fu et al. 2024, section III-A)."""

import re

import torch
from torch import Tensor, nn

from lerobot_gcdt.trajectories import ACHIEVED_GOAL, ACTION, GOAL, STATE, TIME_TO_GOAL

ORDER = (TIME_TO_GOAL, GOAL, STATE, ACTION)
"""Order of the four tokens of a step."""


class ItemTokenizer(nn.Module):
    """Turns one kind of item into tokens: standardised, mapped linearly, layer-normalised.

    Args:
        size: Numbers in an item.
        width: Size of a token.
    """

    def __init__(self, size: int, width: int):
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("std", torch.ones(size))
        self.linear = nn.Linear(size, width)
        self.norm = nn.LayerNorm(width)

    def fit(self, items: Tensor) -> None:
        """Takes mean and standard deviation from items of shape (N, size); constant numbers are only centred."""
        std, mean = torch.std_mean(items, dim=0)
        self.mean.copy_(mean)
        self.std.copy_(torch.where(std > 1e-4, std, 1.0))

    def forward(self, items: Tensor) -> Tensor:
        """Tokens (..., width) of items (..., size); numbers beyond the size are padding."""
        return self.norm(self.linear((items[..., : len(self.mean)] - self.mean) / self.std))


class TaskModules(nn.Module):
    """What one task has of its own: a tokenizer for each kind of item and the action head.

    Args:
        dims: Sizes of observation, goal and action.
        width: Size of a token.
        relative_goal: Whether goal tokens also hold what is left to the goal.
    """

    def __init__(self, dims: list[int], width: int, relative_goal: bool = True):
        super().__init__()
        state, goal, action = dims
        self.goal_size = goal
        self.relative_goal = relative_goal
        self.time_to_goal = ItemTokenizer(1, width)
        self.goal = ItemTokenizer(2 * goal if relative_goal else goal, width)
        self.state = ItemTokenizer(state, width)
        self.action = ItemTokenizer(action, width)
        self.action_head = nn.Linear(width, action)

    def tokenize(self, key: str, items: dict[str, Tensor]) -> Tensor:
        """Makes the tokens of one kind.

        Args:
            key: Dataset key of the kind.
            items: Items by dataset key, each of shape (..., size); a goal is tokenised together with the achieved one.

        Returns:
            Shape (..., width).
        """
        return self._tokenizer(key)(self._content(key, items))

    def fit(self, items: dict[str, Tensor]) -> None:
        """Takes the normalisation from items of the task, each of shape (N, size); actions stay as they are."""
        for key in (TIME_TO_GOAL, GOAL, STATE):
            self._tokenizer(key).fit(self._content(key, items))

    def _tokenizer(self, key: str) -> ItemTokenizer:
        return {TIME_TO_GOAL: self.time_to_goal, GOAL: self.goal, STATE: self.state, ACTION: self.action}[key]

    def _content(self, key: str, items: dict[str, Tensor]) -> Tensor:
        if key != GOAL or not self.relative_goal:
            return items[key]
        goal, achieved = items[GOAL][..., : self.goal_size], items[ACHIEVED_GOAL][..., : self.goal_size]
        return torch.cat([goal, goal - achieved], dim=-1)

    def predict_action(self, hidden: Tensor) -> Tensor:
        """Maps the hidden states of observation tokens, shape (..., width), to actions in [-1, 1]."""
        return torch.tanh(self.action_head(hidden))


def module_key(sentence: str) -> str:
    """Turns a task sentence into a name that a module may have."""
    return re.sub(r"[^a-z0-9]+", "_", sentence.lower()).strip("_")
