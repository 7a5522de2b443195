"""The goal-conditioned decision transformer and the SurRoL environments as LeRobot plugins.

Importing the package registers the policy types ``gcdt``, ``bc``, ``dt``, ``vinn``, ``iql`` and ``plas``; where
PyBullet is installed also the environment type ``surrol``, the robot types ``surrol_psm`` and ``dvrk_psm``, and the
teleoperator type ``psm_keyboard``. Policies are trained and loaded without it.
"""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lerobot_gcdt.baselines.configuration_iql import IQLConfig
from lerobot_gcdt.baselines.modeling_bc import BCPolicy
from lerobot_gcdt.baselines.modeling_dt import DTPolicy
from lerobot_gcdt.baselines.modeling_plas import PLASPolicy
from lerobot_gcdt.baselines.modeling_vinn import VINNPolicy
from lerobot_gcdt.policy.configuration_gcdt import GCDTConfig
from lerobot_gcdt.policy.modeling_gcdt import GCDTPolicy
from lerobot_gcdt.policy.processor_gcdt import make_gcdt_pre_post_processors

GENERALIST = Path(__file__).parent / "generalist"
"""Checkpoint that comes with the package, for ``GCDTPolicy.from_pretrained``: one policy for all ten tasks."""

__all__ = [
    "GENERALIST",
    "BCPolicy",
    "DTPolicy",
    "GCDTConfig",
    "GCDTPolicy",
    "IQLConfig",
    "PLASPolicy",
    "VINNPolicy",
    "make_gcdt_pre_post_processors",
]

if find_spec("pybullet"):  # which is loaded when an environment is made, not before
    from lerobot_gcdt.environment.surrol_env import SurRoLEnvConfig  # noqa: F401
    from lerobot_gcdt.robot.config_dvrk_psm import DVRKPSMConfig  # noqa: F401
    from lerobot_gcdt.robot.config_psm_keyboard import PSMKeyboardConfig  # noqa: F401
    from lerobot_gcdt.robot.config_surrol_psm import SurRoLPSMConfig  # noqa: F401

    __all__ += ["DVRKPSMConfig", "PSMKeyboardConfig", "SurRoLEnvConfig", "SurRoLPSMConfig"]


def __getattr__(name: str) -> Any:
    if name == "IQLPolicy":  # needs torchrl, which takes seconds to import
        from lerobot_gcdt.baselines.modeling_iql import IQLPolicy

        return IQLPolicy
    if name == "SurRoLEnvConfig":
        raise ImportError("The environment type surrol needs PyBullet, which is not installed: `pip install pybullet`.")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
