"""What the tests of baselines that learn from rewards share."""

import pytest
import torch

from lerobot_gcdt.keys import ACHIEVED_GOAL, GOAL, STATE


@pytest.fixture
def observation():
    """Random observations of NeedlePick, of which there are four."""
    return {STATE: torch.randn(4, 19), GOAL: torch.randn(4, 3), ACHIEVED_GOAL: torch.randn(4, 3)}


@pytest.fixture(scope="session")
def train():
    """Trains a policy for some steps, and returns it in evaluation mode."""

    def train(policy, steps):
        optimiser = torch.optim.AdamW(policy.get_optim_params(), lr=3e-3)
        policy.train()
        for _ in range(steps):
            policy.forward({"index": torch.arange(0, 200, 50)})[0].backward()
            optimiser.step()
            optimiser.zero_grad()
        return policy.eval()

    return train
