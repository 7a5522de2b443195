"""Configuration of the keyboard that moves arms."""

from dataclasses import dataclass

from lerobot.teleoperators import TeleoperatorConfig

from lerobot_gcdt.errors import OptionError
from surrol_gym.registry import env_class


@TeleoperatorConfig.register_subclass("psm_keyboard")
@dataclass(kw_only=True)
class PSMKeyboardConfig(TeleoperatorConfig):
    """Teleoperator type ``psm_keyboard``: ``--teleop.type=psm_keyboard --teleop.task=NeedlePick``.

    Attributes:
        task: Name of the task, which tells what an action's numbers are called; the robot's.

    Raises:
        OptionError: The task is unknown.
    """

    task: str = "NeedlePick"

    def __post_init__(self) -> None:
        try:
            env_class(self.task)
        except ValueError as error:
            raise OptionError(f"teleop.task: {error}") from None
