"""The training objectives: mean squared errors over real steps (Fu et al. 2024, section III-C)."""

import torch
from torch import Tensor

from lerobot_gcdt.trajectories import ACTION, Sequences


def action_loss(prediction: Tensor, sequences: Sequences, count: int, reduction: str = "mean") -> Tensor:
    """Compares predicted with demonstrated actions.

    Args:
        prediction: Actions, shape (R, S, A).
        sequences: The packed trajectories that they belong to.
        count: Number of trajectories.
        reduction: ``"mean"`` over all steps, or ``"none"`` for the mean of each trajectory.

    Returns:
        The loss, a scalar or of shape (count,).
    """
    real = sequences.real
    error = (prediction[real] - sequences.items[ACTION][real]).square().mean(-1)  # (real steps,)
    if reduction == "mean":
        return error.mean()
    segment = sequences.segment[real]
    total = torch.zeros(count, device=error.device).index_add(0, segment, error)
    return total / torch.bincount(segment, minlength=count)
