"""Driving the arms with a keyboard: from the keys that are pressed to an action.

Keys are named by what they write, ``"w"``, or by their own name, ``"shift"`` and ``"enter"``, whoever reads them: the
window of ``python -m surrol_gym.play``, or a keyboard teleoperator of LeRobot's.
"""

from collections.abc import Collection

import numpy as np

from surrol_gym.envs.psm_env import PSMEnv
from surrol_gym.experts import CLOSE, OPEN

SPEED, FINE = 0.5, 0.1
"""Size of a motion, in units of a full action, and the same while shift is held: 5 and 1 mm, or half of a turn."""

MOTIONS = {"w": (0, -1), "s": (0, 1), "a": (1, -1), "d": (1, 1), "f": (2, -1), "r": (2, 1), "e": (3, -1), "q": (3, 1)}
"""Which number of an arm's action a key changes, and its sign. The cameras look along -x, so ``"w"`` leads away."""

JAWS = {"c": CLOSE, "v": OPEN}
"""What the jaws do from the moment a key is pressed until the other one is."""

SLOW, AGAIN = "shift", "enter"
"""The key that makes motions fine, and the one that begins the episode anew."""

HELP = """\
  W S   away from you, towards you        Q E   turn the tool
  A D   left, right                       C V   close, open the jaws
  R F   up, down                          1 2   the arm that the keys move, if there are two
  Shift finer                             Enter begin anew       Esc stop
Time stands still while no key is down."""


class Hands:
    """Makes actions of one or two arms from pressed keys; the jaws stay as they were told.

    Args:
        env_class: The task's environment, which knows its arms.
    """

    def __init__(self, env_class: type[PSMEnv]):
        self._arms = len(env_class.mounts)
        self.reset()

    def reset(self) -> None:
        """Goes back to the first arm and to closed jaws, as episodes begin."""
        self._arm, self._jaws = 0, [CLOSE] * self._arms

    def act(self, pressed: Collection[str]) -> np.ndarray:
        """Returns the action, shape (5 * arms,), float32; keys that mean nothing are not looked at."""
        action = np.zeros((self._arms, 5), dtype=np.float32)
        for number in range(self._arms):
            if str(number + 1) in pressed:
                self._arm = number
        for key in JAWS.keys() & pressed:
            self._jaws[self._arm] = JAWS[key]
        for key in MOTIONS.keys() & pressed:
            place, sign = MOTIONS[key]
            action[self._arm, place] += sign * (FINE if SLOW in pressed else SPEED)
        action[:, 4] = self._jaws
        return action.ravel()
