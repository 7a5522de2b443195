"""Means and standard deviations as all policies of this package take them."""

import torch
from torch import Tensor

SMALLEST_STD = 0.01
"""Smallest standard deviation that is scaled to one, su or radians: an angle that a task holds constant trembles by
1e-4 in the demonstrations and by a hundred times as much when something goes wrong."""


def mean_and_std(items: Tensor) -> tuple[Tensor, Tensor]:
    """Computes what standardises items.

    Args:
        items: Shape (N, size).

    Returns:
        The mean and the standard deviation, ``SMALLEST_STD`` at least, of each number, shape (size,).
    """
    std, mean = torch.std_mean(items, dim=0)
    return mean, std.clamp(min=SMALLEST_STD)


def mean_of_each(errors: Tensor, source: Tensor, count: int) -> Tensor:
    """Averages the errors of steps over the frames of the batch that they came from.

    Args:
        errors: Shape (N,).
        source: Which frame each step came from, shape (N,).
        count: Frames of the batch, each of which has steps.

    Returns:
        Shape (count,).
    """
    total = torch.zeros(count, device=errors.device).index_add(0, source, errors)
    return total / torch.bincount(source, minlength=count)
