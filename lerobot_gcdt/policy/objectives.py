"""The training objectives: action prediction, and auxiliary ones that are registered by name.

The paper's four are mean squared errors over real steps (Fu et al. 2024, section III-C). Each is built so that its
answer cannot be reached from what its head reads: by leaving tokens out of the sequence, by the causal order of those
that stay, or by hiding them. Targets are standardised, but for actions.

A further objective is a module that calls ``register_objective``; ``--policy.objectives='{"its_name": 0.1}'`` gives it
a weight. Only policies that name it have its heads, so checkpoints from before load as they are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, distributed, nn

from lerobot_gcdt.data.draws import combine, uniform
from lerobot_gcdt.data.sequences import Sequences
from lerobot_gcdt.keys import ACTION, GOAL, STATE, TIME_TO_GOAL
from lerobot_gcdt.policy.tokens import ORDER, kind_name

if TYPE_CHECKING:
    from lerobot_gcdt.policy.modeling_gcdt import GCDTPolicy

_HIDE = 100
"""Random numbers from here on decide what is hidden; smaller ones are the trajectory bank's."""


@dataclass(frozen=True)
class Objective:
    """An auxiliary objective of pretraining.

    Attributes:
        loss: Takes the policy and packed trajectories (``lerobot_gcdt.data.sequences.Sequences``) and returns a
            scalar; see ``mean_error``.
        heads: Takes the sizes of observation, goal and action of a task and the size of a token, and returns the
            modules that ``policy.modules_of(task)`` then has for this task, by their names.
    """

    loss: Callable[["GCDTPolicy", Sequences], Tensor]
    heads: Callable[[list[int], int], dict[str, nn.Module]]


OBJECTIVES: dict[str, Objective] = {}
"""The registered objectives, by name."""


def register_objective(
    name: str,
    loss: Callable[["GCDTPolicy", Sequences], Tensor],
    heads: Callable[[list[int], int], dict[str, nn.Module]],
) -> None:
    """Registers an auxiliary objective.

    Args:
        name: Its name in the configuration; ``<name>_loss`` is what training logs.
        loss: See ``Objective``.
        heads: See ``Objective``.

    Raises:
        ValueError: Another objective has this name.
    """
    if name in OBJECTIVES:
        raise ValueError(f"There is an objective {name!r} already; give this one another name.")
    OBJECTIVES[name] = Objective(loss, heads)


def action_errors(policy: "GCDTPolicy", sequences: Sequences, states: Tensor | None = None) -> Tensor:
    """Action prediction: a_t from time-to-goal, goal and observation up to t and actions up to t - 1.

    Args:
        policy: The policy.
        sequences: Packed trajectories.
        states: As ``policy.predict_actions`` takes them.

    Returns:
        The error of each real step, shape (N,).
    """
    predicted = policy.predict_actions(sequences, states)  # (R, S, A), 0 where a task has fewer numbers, as in the data
    error = predicted - sequences.items[ACTION][..., : predicted.shape[-1]]
    return (error.square().sum(-1) / policy.action_sizes[sequences.task])[sequences.real]


def dynamics_loss(policy: "GCDTPolicy", sequences: Sequences) -> Tensor:
    """Forward dynamics: o_t from observations and actions up to t - 1; no time-to-goal, no goal.

    Args:
        policy: The policy.
        sequences: Packed trajectories.

    Returns:
        The mean error, a scalar; 0 where no piece has two steps.
    """
    after_action = policy.encode(sequences, (STATE, ACTION))[:, :, 1]
    known = (sequences.segment[:, 1:] == sequences.segment[:, :-1]) & sequences.real[:, 1:]
    # What step t - 1 has seen stands where the observation of t will be compared.
    before = after_action.roll(1, dims=1)
    where = torch.nn.functional.pad(known, (1, 0))
    return mean_error(policy, sequences, STATE, before, where, lambda modules, x: modules.dynamics_head(x))


def time_to_goal_loss(policy: "GCDTPolicy", sequences: Sequences) -> Tensor:
    """Time-to-goal prediction: from goal and observation up to t and actions up to t - 1; no time-to-goal.

    Where a step is one token, actions are left out, because that of t would be in it.

    Args:
        policy: The policy.
        sequences: Packed trajectories.

    Returns:
        The mean error, a scalar.
    """
    keys = (GOAL, STATE) if policy.config.one_token else (GOAL, STATE, ACTION)
    at_observation = policy.encode(sequences, keys)[:, :, keys.index(STATE)]
    return time_to_goal_error(policy, sequences, at_observation, sequences.real)


def time_to_goal_error(policy: "GCDTPolicy", sequences: Sequences, states: Tensor, where: Tensor) -> Tensor:
    """The mean error of time-to-goal as it is predicted from hidden states of some steps.

    Args:
        policy: The policy.
        sequences: Packed trajectories, R rows of S steps.
        states: Hidden states that have not seen time-to-goal, shape (R, S, width).
        where: The steps, booleans of shape (R, S).

    Returns:
        A scalar; 0 where there are no steps.
    """
    return mean_error(policy, sequences, TIME_TO_GOAL, states, where, lambda modules, x: modules.time_to_goal_head(x))


def reconstruction_loss(policy: "GCDTPolicy", sequences: Sequences, wanted: Tensor) -> Tensor:
    """Sequence reconstruction: hidden items of every kind from all the others, past and future.

    Args:
        policy: The policy.
        sequences: Packed trajectories.
        wanted: The items to hide and to predict, as ``draw_hidden`` gives them.

    Returns:
        The mean over the kinds of their mean errors, a scalar.
    """
    hidden = policy.encode(sequences, ORDER, causal=False, hidden=withheld(wanted, policy.config.relative_goal))
    losses = []
    for i, key in enumerate(ORDER):

        def head(modules: Any, states: Tensor, key: str = key) -> Tensor:
            return modules.reconstruction_heads[kind_name(key)](states)

        losses.append(mean_error(policy, sequences, key, hidden[:, :, i], wanted[:, :, i], head))
    return torch.stack(losses).mean()


def mean_over_processes(errors: Tensor) -> Tensor:
    """Averages errors so that the mean over all processes is the mean over the errors of all of them.

    A plain mean would give the steps of a process with short trajectories more weight than those of the others.

    Args:
        errors: Shape (N,).

    Returns:
        A scalar: the sum over the average number of errors of a process, 1 at least.
    """
    counted = torch.tensor(float(len(errors)), device=errors.device)
    if distributed.is_available() and distributed.is_initialized():
        distributed.all_reduce(counted)
        counted /= distributed.get_world_size()
    return errors.sum() / counted.clamp(min=1.0)


def draw_hidden(sequences: Sequences, step: Tensor | int, ratio: float) -> Tensor:
    """Draws items to hide.

    A goal is the same at every step of a trajectory and is therefore hidden in all of it or nowhere.

    Args:
        sequences: Packed trajectories.
        step: Number of the optimiser step, so that the same trajectories hide others in every epoch.
        ratio: Share of the items to hide.

    Returns:
        Booleans of shape (R, S, 4), in the order of the tokens.
    """
    kinds = torch.arange(len(ORDER), device=sequences.key.device)
    key = combine(step, sequences.key)
    wanted = uniform(key[..., None], sequences.timestep[..., None], _HIDE + kinds) < ratio
    wanted[:, :, ORDER.index(GOAL)] = uniform(key, _HIDE) < ratio
    return wanted & sequences.real[..., None]


def withheld(wanted: Tensor, relative_goal: bool) -> Tensor:
    """Adds to the items to hide the tokens that would give them away, shape (R, S, 4).

    A relative goal token holds a part of its step's observation, the achieved goal.
    """
    if not relative_goal:
        return wanted
    goal, state = ORDER.index(GOAL), ORDER.index(STATE)
    wanted = wanted.clone()
    wanted[:, :, goal] |= wanted[:, :, state]
    return wanted


def mean_error(
    policy: "GCDTPolicy",
    sequences: Sequences,
    key: str,
    hidden: Tensor,
    where: Tensor,
    head: Callable[[Any, Tensor], Tensor],
) -> Tensor:
    """Computes the mean squared error of one kind of item over some steps.

    Args:
        policy: The policy.
        sequences: Packed trajectories, R rows of S steps.
        key: Dataset key of the items, which are standardised but for actions.
        hidden: Hidden states to predict them from, shape (R, S, width).
        where: The steps, booleans of shape (R, S).
        head: Maps a task's modules and hidden states, shape (N, width), to items of the task, shape (N, size).

    Returns:
        A scalar; 0 where there are no steps.
    """
    errors = [hidden.new_zeros(0)]
    for task, (rows, columns) in sequences.by_task.items():
        chosen = where[rows, columns]
        steps = rows[chosen], columns[chosen]
        modules = policy.modules_of(task)
        target = modules.target(key, {k: value[steps] for k, value in sequences.items.items()})
        errors.append((head(modules, hidden[steps]) - target).square().mean(-1))
    return mean_over_processes(torch.cat(errors))


def _reconstruction(policy: "GCDTPolicy", sequences: Sequences) -> Tensor:
    """Sequence reconstruction of items that are drawn anew in every step."""
    wanted = draw_hidden(sequences, policy.training_step, policy.config.hidden_ratio)
    return reconstruction_loss(policy, sequences, wanted)


def _reconstruction_heads(dims: list[int], width: int) -> dict[str, nn.Module]:
    state, goal, action = dims
    sizes = {TIME_TO_GOAL: 1, GOAL: goal, STATE: state, ACTION: action}
    heads = {kind_name(key): nn.Linear(width, size) for key, size in sizes.items()}
    return {"reconstruction_heads": nn.ModuleDict(heads)}


register_objective("dynamics", dynamics_loss, lambda dims, width: {"dynamics_head": nn.Linear(width, dims[0])})
register_objective("time_to_goal", time_to_goal_loss, lambda _, width: {"time_to_goal_head": nn.Linear(width, 1)})
register_objective("reconstruction", _reconstruction, _reconstruction_heads)
