"""From observations of the simulator to what policies of LeRobot's take."""

from typing import Any

import numpy as np
from lerobot.configs.types import NormalizationMode
from lerobot.envs.utils import preprocess_observation
from lerobot.policies.pretrained import PreTrainedPolicy

from lerobot_gcdt.environment.surrol_env import SurRoLObservations


def check_processed(policy: Any) -> None:
    """Raises ValueError for a policy that leaves normalisation to processors and comes without them."""
    if isinstance(policy, PreTrainedPolicy) and any(
        mode is not NormalizationMode.IDENTITY for mode in policy.config.normalization_mapping.values()
    ):
        raise ValueError(
            f"A bare {type(policy).__name__} takes and returns normalised numbers, so its actions would be wrong; "
            "pass lerobot_gcdt.evaluation.load_policy(its checkpoint), which adds its processors."
        )


def observation_batch(policy: Any, observation: dict[str, np.ndarray], sentence: str) -> dict:
    """Turns a batched observation of a ``surrol/`` environment into what LeRobot's policies take.

    Args:
        policy: The policy; the tensors go to the device of its configuration, if it has one.
        observation: Arrays of shape (B, size), as vector environments give them.
        sentence: The environment's ``task_description``.

    Returns:
        ``observation.*`` tensors and ``task``, a sentence for each row.
    """
    device = getattr(getattr(policy, "config", None), "device", "cpu")
    batch = SurRoLObservations().observation(preprocess_observation(observation))
    return {key: value.to(device) for key, value in batch.items()} | {
        "task": [sentence] * len(observation["observation"])
    }
