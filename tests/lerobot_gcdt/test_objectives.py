"""The action objective."""

import pytest
import torch

from lerobot_gcdt.objectives import action_loss
from lerobot_gcdt.trajectories import ACTION, Sequences


def packed():
    """Two trajectories of 2 and 1 steps in one row, and a padded step."""
    actions = torch.tensor([[[1.0, 1.0], [0.0, 0.0], [0.5, 0.5], [9.0, 9.0]]])
    segment = torch.tensor([[0, 0, 1, -1]])
    return Sequences({ACTION: actions}, torch.zeros(1, 4), segment, torch.zeros(1, 4))


def test_it_is_the_mean_squared_error_over_real_steps():
    prediction = torch.zeros(1, 4, 2)
    assert action_loss(prediction, packed(), 2).item() == pytest.approx((1 + 0 + 0.25) / 3)


def test_padding_has_no_gradient():
    prediction = torch.zeros(1, 4, 2, requires_grad=True)
    action_loss(prediction, packed(), 2).backward()
    assert (prediction.grad[0, 3] == 0).all()
    assert (prediction.grad[0, 0] != 0).all()


def test_unreduced_it_is_the_mean_of_each_trajectory():
    assert action_loss(torch.zeros(1, 4, 2), packed(), 2, reduction="none").tolist() == [0.5, 0.25]
