"""Acting with an average of the weights over the last steps of training.

From one step of training to the next the success of a cloned policy changes far more than its error does, because small
errors grow along an episode. The average over many steps is steadier, and better than most of what it is an average of
(Block et al. 2024, arXiv 2310.11428).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import torch
from lerobot.configs.policies import PreTrainedConfig
from safetensors import safe_open
from safetensors.torch import save
from torch import Tensor, nn
from torch.optim.swa_utils import get_ema_multi_avg_fn

from lerobot_gcdt.errors import OptionError

RESTING = "resting"


@dataclass
class AveragedWeightsConfig(PreTrainedConfig):
    """What the configuration of a policy with ``AveragedWeights`` inherits, before ``SingleFrames``.

    Attributes:
        average_steps: Steps of training whose weights the policy acts with the average of; 0 for the last weights.
    """

    average_steps: int = 2_000

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.average_steps < 0:
            raise OptionError(f"policy.average_steps must not be negative, got {self.average_steps}.")


class AveragedWeights(nn.Module):
    """What a LeRobot policy inherits, before ``PreTrainedPolicy``, that acts with an average of its weights.

    In training mode its parameters are the ones that are being trained, in evaluation mode their average. The others
    rest in buffers. In files the average has the names of the parameters, whatever the mode was, so whoever reads only
    these has the policy that acts.
    """

    training_step: Tensor
    """Batches that training has seen, a buffer of the policy."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...  # as in LeRobot, which comes without types

    def keep_average(self, steps: int) -> None:
        """Begins an average with the present weights; the last thing that the constructor does.

        Args:
            steps: Steps that the average looks back on, or a ninth of those so far if they are fewer; 0 for none. Older
                weights fade exponentially. What begins with a checkpoint goes on with its average and its number of
                steps, so a short fine-tuning needs a smaller number.
        """
        self.average_steps = steps
        if not hasattr(self, RESTING):
            self.register_state_dict_post_hook(_name_by_role)
            self.register_load_state_dict_pre_hook(_take_by_role)
        self.resting = nn.Module()
        for name, parameter in self.named_parameters() if steps else ():
            self.resting.register_buffer(_name_at_rest(name), parameter.detach().clone())

    def average_weights(self) -> None:
        """Takes the present weights into the average; every step of training begins with it."""
        if not self.average_steps:
            return
        step = int(self.training_step)
        decay = min(1 - 1 / self.average_steps, (1 + step) / (10 + step))
        parameters, averages = zip(*self._pairs(), strict=True)
        get_ema_multi_avg_fn(decay)(averages, parameters, step)

    def train(self, mode: bool = True) -> Self:
        """Changes between the weights in training and their average, as the modes do."""
        if mode != self.training and self.average_steps:
            with torch.no_grad():
                for parameter, resting in self._pairs():
                    before = parameter.clone()
                    parameter.copy_(resting)
                    resting.copy_(before)
        return super().train(mode)

    def _pairs(self) -> list[tuple[Tensor, Tensor]]:
        """The parameters, and what rests of each."""
        parameters, resting = [*self.parameters()], [*self.resting.buffers()]
        if len(parameters) != len(resting):
            raise OptionError(
                f"The policy has {len(parameters)} parameters and an average of {len(resting)}; where adapters (PEFT) "
                "are trained, set policy.average_steps=0."
            )
        return [*zip(parameters, resting, strict=True)]


def without_resting(names: Iterable[str]) -> set[str]:
    """Returns the names in a policy's file that are no weights at rest."""
    return {name for name in names if not name.startswith(f"{RESTING}.")}


def acting_weights(file: Path) -> bytes | None:
    """Returns a policy's file without the weights at rest: half of it, and the same policy; None where none rest.

    Args:
        file: A ``model.safetensors``. Training goes on from what is returned with the average.
    """
    with safe_open(file, "pt") as stream:
        names = without_resting(stream.keys())
        if len(names) == len(stream.keys()):
            return None
        return save({name: stream.get_tensor(name) for name in sorted(names)}, stream.metadata())


def _name_at_rest(name: str) -> str:
    return name.replace(".", "/")  # a buffer's name holds no dots


def _names(policy: AveragedWeights, prefix: str) -> list[tuple[str, str]]:
    """The names of parameters and of what rests, in a state dictionary."""
    names = [name for name, _ in policy.named_parameters()]
    return [(prefix + name, f"{prefix}{RESTING}.{_name_at_rest(name)}") for name in names]


def _name_by_role(policy: AveragedWeights, state: dict[str, Any], prefix: str, *_: Any) -> None:
    """Gives the average the names of the parameters; a hook of ``state_dict``."""
    if policy.training and policy.average_steps:
        for name, resting in _names(policy, prefix):
            state[name], state[resting] = state[resting], state[name]


def _take_by_role(policy: AveragedWeights, state: dict[str, Any], prefix: str, *_: Any) -> None:
    """The reverse, a hook of ``load_state_dict``; older files and smaller ones hold nothing at rest."""
    for name, resting in _names(policy, prefix):
        if not policy.average_steps:
            state.pop(resting, None)
        elif name in state:
            average, in_training = state[name], state.get(resting, state[name])
            state[name], state[resting] = (in_training, average) if policy.training else (average, in_training)
