"""LeRobot's keyboard as a teleoperator of arms: it also turns the tool, and moves either of two arms."""

from typing import Any

from lerobot.teleoperators.keyboard import KeyboardTeleop
from lerobot.utils.decorators import check_if_not_connected

from lerobot_gcdt.robot.config_psm_keyboard import PSMKeyboardConfig
from lerobot_gcdt.robot.names import BEGIN, action_names
from surrol_gym.keyboard import AGAIN, Hands
from surrol_gym.registry import env_class


class PSMKeyboard(KeyboardTeleop):
    """Makes actions of a task from the keys of ``surrol_gym.keyboard``, which LeRobot's listener hears.

    The listener hears all keys of the X server, whichever window they are meant for. Enter asks the simulated robot for
    the next episode; Esc disconnects.

    Args:
        config: The configuration.
    """

    config_class = PSMKeyboardConfig
    name = "psm_keyboard"

    def __init__(self, config: PSMKeyboardConfig):
        super().__init__(config)
        task = env_class(config.task)
        self._names, self._hands = action_names(task), Hands(task)
        self._down: set[str] = set()

    @property
    def action_features(self) -> dict[str, type]:
        """The robot's."""
        return dict.fromkeys(self._names, float)

    @property
    def is_calibrated(self) -> bool:
        """Always: there is nothing to calibrate."""
        return True

    @check_if_not_connected
    def get_action(self) -> dict[str, Any]:
        """Returns what the keys command that are down, or were since the last call."""
        pressed = self._pressed()
        if AGAIN in pressed:
            self._hands.reset()
        numbers = dict(zip(self._names, self._hands.act(pressed).tolist(), strict=True))
        return numbers | ({BEGIN: 1.0} if AGAIN in pressed else {})

    def _pressed(self) -> set[str]:
        pressed = set()
        while not self.event_queue.empty():
            key, is_down = self.event_queue.get_nowait()
            if not is_down:
                self._down.discard(_name(key))
            elif _name(key) not in self._down:  # otherwise a key that is held repeats itself
                self._down.add(_name(key))
                pressed.add(_name(key))
        return pressed | self._down


def _name(key: Any) -> str:
    """The name of a key as ``surrol_gym.keyboard`` has it; the listener gives letters as text, capitals with shift."""
    return key.lower() if isinstance(key, str) else getattr(key, "name", "").removesuffix("_r")
