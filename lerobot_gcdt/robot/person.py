"""A person at one of LeRobot's teleoperators, who acts in a recording."""

import numpy as np
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig, make_teleoperator_from_config
from lerobot.teleoperators.gamepad import GamepadTeleopConfig
from lerobot.teleoperators.keyboard import KeyboardEndEffectorTeleopConfig
from lerobot.utils.import_utils import is_package_available
from lerobot.utils.keyboard_input import pynput_can_capture

from lerobot_gcdt.recording import Person
from lerobot_gcdt.robot.config_psm_keyboard import PSMKeyboardConfig
from lerobot_gcdt.robot.config_surrol_psm import SurRoLPSMConfig
from lerobot_gcdt.robot.names import BEGIN, ActionReader
from surrol_gym.by_hand import BeginAgain, Stop
from surrol_gym.keyboard import HELP
from surrol_gym.registry import env_class

TELEOPERATORS = ("keyboard", "keyboard_ee", "gamepad")
"""What a person may act with: our keyboard, and those of LeRobot's that give deltas of an end effector."""


class TeleoperatorCommand:
    """What a person commands with a connected teleoperator of LeRobot's.

    Args:
        teleoperator: The teleoperator.
        reader: What reads its actions.
    """

    def __init__(self, teleoperator: Teleoperator, reader: ActionReader):
        self._teleoperator, self._reader = teleoperator, reader

    def __call__(self) -> np.ndarray:
        """Returns the action of this moment.

        Raises:
            BeginAgain: The person wants to begin the episode anew.
            Stop: The teleoperator was disconnected, as Esc does with a keyboard.
        """
        if not self._teleoperator.is_connected:
            raise Stop
        action = self._teleoperator.get_action()
        if action.get(BEGIN):
            raise BeginAgain
        return self._reader.read(action)


def seat(teleoperator: str, task: str) -> Person:
    """Connects a teleoperator, and says what its keys do.

    Args:
        teleoperator: One of ``TELEOPERATORS``.
        task: Name of the task; see ``surrol_gym.find_task``.

    Returns:
        The person at it.

    Raises:
        ValueError: The task has two arms, which the teleoperator cannot move.
        RuntimeError: The teleoperator does not work here.
    """
    moved = env_class(task)
    config: TeleoperatorConfig
    if teleoperator == "gamepad":
        config, away = GamepadTeleopConfig(), "+x"
    else:
        config = PSMKeyboardConfig(task=task) if teleoperator == "keyboard" else KeyboardEndEffectorTeleopConfig()
        away = "-y"
        if not is_package_available("pynput") or not pynput_can_capture():
            raise RuntimeError(
                f"The teleoperator {teleoperator} needs pynput (`pip install 'lerobot[core_scripts]'`) and an X "
                "display, not Wayland, to hear keys; `python -m surrol_gym.play` needs neither, but records nothing."
            )
    if teleoperator != "keyboard" and len(moved.mounts) > 1:
        raise ValueError(f"{teleoperator} moves one arm, and {moved.task} has {len(moved.mounts)}; take keyboard.")
    made = make_teleoperator_from_config(config)
    made.connect()
    print(f"{moved.task}: {moved.task_description}")
    print(HELP if teleoperator == "keyboard" else f"LeRobot's {teleoperator}: see docs/robots.md.", flush=True)
    return Person(teleoperator, TeleoperatorCommand(made, ActionReader(moved, away, SurRoLPSMConfig.delta_scale)))
