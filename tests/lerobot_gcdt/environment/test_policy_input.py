"""What policies see of an observation."""

import numpy as np
import torch

from lerobot_gcdt.environment.policy_input import observation_batch


def test_an_observation_becomes_float32_tensors_under_the_keys_of_the_dataset():
    rng = np.random.default_rng(0)
    sizes = {"observation": 7, "achieved_goal": 3, "desired_goal": 3}
    observation = {key: rng.random((2, size), dtype=np.float32) for key, size in sizes.items()}
    batch = observation_batch(None, observation, "Reach.")
    for key, source in (
        ("observation.state", "observation"),
        ("observation.achieved_goal", "achieved_goal"),
        ("observation.goal", "desired_goal"),
        ("observation.environment_state", "desired_goal"),
    ):
        assert batch[key].dtype == torch.float32
        np.testing.assert_array_equal(batch[key], observation[source])
    assert batch["task"] == ["Reach.", "Reach."]
