"""The goal-conditioned decision transformer and the SurRoL environments as LeRobot plugins.

Importing the package registers the policy type ``gcdt`` and the environment type ``surrol``.
"""

from pathlib import Path

import surrol_gym  # noqa: F401 (registers the environment ids)
from lerobot_gcdt.baselines.modeling_bc import BCPolicy
from lerobot_gcdt.configuration_gcdt import GCDTConfig
from lerobot_gcdt.modeling_gcdt import GCDTPolicy
from lerobot_gcdt.processor_gcdt import make_gcdt_pre_post_processors
from lerobot_gcdt.surrol_env import SurRoLEnvConfig

GENERALIST = Path(__file__).parent / "generalist"
"""Checkpoint that comes with the package, for ``GCDTPolicy.from_pretrained``: one policy for all ten tasks."""

__all__ = ["GENERALIST", "BCPolicy", "GCDTConfig", "GCDTPolicy", "SurRoLEnvConfig", "make_gcdt_pre_post_processors"]
