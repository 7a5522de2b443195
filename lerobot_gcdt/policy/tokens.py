"""Task-specific tokenizers and heads (Fu et al. 2024, section III-A)."""

import hashlib
import re
from collections.abc import Iterable
from typing import cast

import torch
from torch import Tensor, nn

from lerobot_gcdt.data.statistics import mean_and_std
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, STATE, TIME_TO_GOAL

ORDER = (TIME_TO_GOAL, GOAL, STATE, ACTION)
"""Order of the four tokens of a step."""


class ItemTokenizer(nn.Module):
    """Turns one kind of item into tokens: standardised, mapped linearly, and layer-normalised if that is asked for.

    Args:
        size: Numbers in an item.
        width: Size of a token.
        normalised: Whether tokens are layer-normalised.
    """

    mean: Tensor
    std: Tensor

    def __init__(self, size: int, width: int, normalised: bool = True):
        super().__init__()
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("std", torch.ones(size))
        self.linear = nn.Linear(size, width)
        self.norm = nn.LayerNorm(width) if normalised else nn.Identity()

    def fit(self, items: Tensor) -> None:
        """Takes mean and standard deviation from items of shape (N, size)."""
        mean, std = mean_and_std(items[:, : len(self.mean)])
        self.mean.copy_(mean)
        self.std.copy_(std)

    def standardise(self, items: Tensor) -> Tensor:
        """Standardised items (..., size); numbers beyond the size are padding."""
        return (items[..., : len(self.mean)] - self.mean) / self.std

    def forward(self, items: Tensor) -> Tensor:
        """Tokens (..., width) of items (..., size)."""
        return self.norm(self.linear(self.standardise(items)))


class TaskModules(nn.Module):
    """What one task has of its own: a tokenizer for each kind of item, and heads.

    The head of the actions is there from the start; those of the auxiliary objectives are added under their names.

    Args:
        dims: Sizes of observation, goal and action.
        width: Size of a token.
        relative_goal: Whether goal tokens also hold what is left to the goal.
        normalised: Whether tokens are layer-normalised.
    """

    def __init__(self, dims: list[int], width: int, relative_goal: bool = True, normalised: bool = True):
        super().__init__()
        state, goal, action = dims
        self.goal_size = goal
        self.relative_goal = relative_goal
        goal_content = 2 * goal if relative_goal else goal
        sizes = {TIME_TO_GOAL: 1, GOAL: goal_content, STATE: state, ACTION: action}
        self.tokenizers = nn.ModuleDict(
            {kind_name(key): ItemTokenizer(size, width, normalised) for key, size in sizes.items()}
        )
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

    def target(self, key: str, items: dict[str, Tensor]) -> Tensor:
        """Returns what a head has to predict of one kind: the item itself, standardised, shape (..., size)."""
        goal_size = self.goal_size if key == GOAL else None
        return self._tokenizer(key).standardise(self._content(key, items))[..., :goal_size]

    def predict_action(self, hidden: Tensor) -> Tensor:
        """Maps the hidden states of observation tokens, shape (..., width), to actions in [-1, 1]."""
        return torch.tanh(self.action_head(hidden))

    def predict_time_to_goal(self, hidden: Tensor) -> Tensor:
        """Maps hidden states that have not seen time-to-goal, shape (..., width), to it, steps, shape (..., 1)."""
        tokenizer = self._tokenizer(TIME_TO_GOAL)
        standardised = self.get_submodule("time_to_goal_head")(hidden)
        return (standardised * tokenizer.std + tokenizer.mean).clamp(min=0.0)

    def _tokenizer(self, key: str) -> ItemTokenizer:
        return cast(ItemTokenizer, self.tokenizers[kind_name(key)])

    def _content(self, key: str, items: dict[str, Tensor]) -> Tensor:
        if key != GOAL or not self.relative_goal:
            return items[key]
        goal, achieved = items[GOAL][..., : self.goal_size], items[ACHIEVED_GOAL][..., : self.goal_size]
        return torch.cat([goal, goal - achieved], dim=-1)


def module_names(sentences: Iterable[str]) -> dict[str, str]:
    """Gives each task sentence the name of its modules.

    Args:
        sentences: The sentences of a policy, in the order in which it came to know them.

    Returns:
        Names by sentence: its words, or with a hash where these are none, have a meaning in PyTorch, or belong to an
        earlier sentence that differs in punctuation or case.
    """
    names: dict[str, str] = {}
    for sentence in sentences:
        name = re.sub(r"[^a-z0-9]+", "_", sentence.lower()).strip("_")
        if not name or hasattr(nn.ModuleDict(), name) or name in names.values():
            name = f"{name}_{hashlib.sha256(sentence.encode()).hexdigest()[:8]}".lstrip("_")
        names[sentence] = name
    return names


def kind_name(key: str) -> str:
    """Returns the name of the modules of one kind of item, by its dataset key."""
    return key.removeprefix("observation.")
