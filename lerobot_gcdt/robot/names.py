"""What the numbers of a robot are called: as in our datasets, with the endings that LeRobot's commands look for.

`lerobot-rollout` shows a policy only what ends in ``.pos`` or ``.vel``, and takes only such actions from it. So a
robot observes ``psm1_x.pos`` and takes ``psm1_dx.vel``, where a dataset says ``psm1_x`` and ``psm1_dx``. It has one
vector for all numbers, ``observation.state``; the goals stand behind the observation
(``lerobot_gcdt.data.acting_batch``).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from lerobot_gcdt.errors import OptionError
from surrol_gym.envs.goal_env import Observation
from surrol_gym.envs.psm_env import PSMEnv
from surrol_gym.experts import CLOSE, OPEN

POSITION, MOTION = ".pos", ".vel"
DELTAS = ("delta_x", "delta_y", "delta_z", "gripper")
"""What LeRobot's teleoperators that move an end effector say."""

AWAY = {"+x": (-1, 0), "-x": (1, 0), "+y": (0, -1), "-y": (0, 1)}
"""The direction of deltas that leads away from the person, and what world x gets of ``delta_x`` and ``delta_y``."""

BEGIN = "begin_anew"
"""What an action may hold beside its numbers: 1 begins the next episode."""


def observation_names(env_class: type[PSMEnv]) -> tuple[str, ...]:
    """Returns the names of a robot's numbers: the observation, the desired and the achieved goal."""
    goal = [name.removeprefix("goal_") for name in env_class.goal_names]
    wanted, achieved = ([f"{which}_goal.{name}" for name in goal] for which in ("desired", "achieved"))
    return tuple(name + POSITION for name in (*env_class.observation_names, *wanted, *achieved))


def arm_names(env_class: type[PSMEnv]) -> tuple[str, ...]:
    """Returns the names of those numbers that the arms themselves measure, seven of each."""
    return observation_names(env_class)[: 7 * len(env_class.mounts)]


def observation_numbers(env_class: type[PSMEnv], observation: Observation) -> dict[str, float]:
    """Returns the numbers of an observation by their names."""
    parts = (observation[key] for key in ("observation", "desired_goal", "achieved_goal"))
    return dict(zip(observation_names(env_class), np.concatenate([*parts]).tolist(), strict=True))


def action_names(env_class: type[PSMEnv]) -> tuple[str, ...]:
    """Returns the names of an action's numbers."""
    return tuple(name + (POSITION if name.endswith("gripper") else MOTION) for name in env_class.action_names)


class ActionReader:
    """Reads what LeRobot's commands send a robot.

    That is an action of the task, named as in ``action_names`` or as in our datasets; or, for a task of one arm, deltas
    of an end effector, as the teleoperators ``keyboard_ee`` and ``gamepad`` give them. Deltas do not turn the tool, and
    their gripper is 0 to close, 1 to stay and 2 to open.

    Args:
        env_class: The task.
        away: Which way deltas lead away from the person, one of ``AWAY``.
        scale: Size of a delta of 1, in units of a full action.

    Raises:
        OptionError: One of these is out of range.
    """

    def __init__(self, env_class: type[PSMEnv], away: str, scale: float):
        if away not in AWAY:
            raise OptionError(f"away says which delta leads away from you, one of {', '.join(AWAY)}; got {away!r}.")
        if not 0 < scale <= 1:
            raise OptionError(f"delta_scale is the size of a delta of 1, in (0, 1]; got {scale}.")
        self._task, self._away, self._scale = env_class.task, AWAY[away], scale
        self._names, self._known = env_class.action_names, action_names(env_class)
        self.reset()

    def reset(self) -> None:
        """Goes back to the start of an episode, where jaws are closed."""
        self._jaws = CLOSE

    def read(self, action: Mapping[str, Any]) -> np.ndarray:
        """Returns the action, shape (5 * arms,), float32.

        Raises:
            ValueError: The names are no action of this task.
        """
        if "delta_x" in action and len(self._names) == 5:
            return self._of_deltas(action)
        numbers = {name.removesuffix(POSITION).removesuffix(MOTION): value for name, value in action.items()}
        if not set(self._names) <= set(numbers):
            raise ValueError(
                f"An action of {self._task} has the numbers {', '.join(self._known)}"
                + (f", or {', '.join(DELTAS)}" if len(self._names) == 5 else "")
                + f"; got {', '.join(map(str, action)) or 'none'}."
            )
        return np.array([float(numbers[name]) for name in self._names], dtype=np.float32)

    def _of_deltas(self, action: Mapping[str, Any]) -> np.ndarray:
        x, y, z = (float(action[name]) for name in DELTAS[:3])
        # The other axis leads to the left, which is -y of the world, where away is -x.
        of_x, of_y = self._away
        world = (of_x * x + of_y * y, of_x * y - of_y * x, z)
        self._jaws = {0: CLOSE, 2: OPEN}.get(round(float(action.get("gripper", 1))), self._jaws)
        return np.array([*(self._scale * number for number in world), 0.0, self._jaws], dtype=np.float32)
