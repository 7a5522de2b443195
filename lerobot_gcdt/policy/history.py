"""What a policy remembers of running episodes."""

import torch
from torch import Tensor

from lerobot_gcdt.policy.transformer import KeyValueCache


class History:
    """Keys and values of the last tokens in every layer, the steps that these belong to, and what came of the last.

    ``last_action`` is the last action of each episode, and ``last_state`` the hidden state of its last observation, if
    it has not seen time-to-goal, shape (B, W).

    Args:
        tasks: Task sentence of each episode.
        layers: Layers of the transformer.
        slots: Tokens that are kept; older ones are overwritten.
        device: Where the tensors live.
    """

    def __init__(self, tasks: list[str], layers: int, slots: int, device: torch.device):
        self.tasks = tasks
        self.caches = [KeyValueCache(slots) for _ in range(layers)]
        self.step = 0
        self.last_action: Tensor | None = None
        self.last_state: Tensor | None = None
        self._tokens = 0
        self._token_step = torch.zeros(slots, dtype=torch.long, device=device)

    def add(self, steps: list[int], context_length: int) -> Tensor:
        """Notes new tokens, whose keys and values the caches are about to get.

        Args:
            steps: The step of each, in their order.
            context_length: Steps that a token may attend to, its own included.

        Returns:
            What they may attend to, booleans of shape (1, 1, new tokens, kept tokens).
        """
        device = self._token_step.device
        slots = (torch.arange(len(steps), device=device) + self._tokens) % len(self._token_step)
        self._token_step[slots] = torch.tensor(steps, device=device)
        self._tokens += len(steps)
        kept = self._token_step[: self._tokens]
        allowed = self._token_step[slots][:, None] - kept[None, :] < context_length
        allowed[:, slots] &= torch.ones(len(steps), len(steps), dtype=torch.bool, device=device).tril()
        return allowed[None, None]

    def forget(self, count: int) -> None:
        """Forgets the last tokens, as if they had not been added."""
        self._tokens -= count
        for cache in self.caches:
            cache.forget(count)
