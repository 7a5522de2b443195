"""Scripted experts: feedback laws from an observation to an action.

A task's law says where its arms should be next, from nothing but the observation, which it reads by names; ``Expert``
turns that into an action. Because no waypoint counter exists, it can start from any state, corrects until the residual
is gone and returns to an earlier phase when a grasp fails.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, exp
from typing import Any

import gymnasium as gym
import numpy as np

from surrol_gym.envs.goal_env import Observation, Reading
from surrol_gym.envs.psm_env import STEP_SIZE, PSMEnv
from surrol_gym.registry import find_law

OPEN, CLOSE = 0.5, -0.5
"""Gripper actions."""

NEAR_GAIN, NEAR = 0.5, 0.03
"""Share of a small offset that one step covers, and how small that is, su.

A learner hardly sees actions below its noise. Covering half of what is left in each step keeps the last corrections
large enough to be learned; covering that much from afar would make the arm jerk.
"""


@dataclass(frozen=True)
class Target:
    """Where a law wants an arm.

    Attributes:
        offset: From link 5 to where it should be, shape (3,), su.
        turn: Rotation of the tool that is left to do, radians.
        jaw: Gripper action: negative closes.
        gain: Share of a large offset that one step covers; near the target it rises to at least ``NEAR_GAIN``.
        speed: Largest action along an axis.
        turn_speed: Largest turning action.
    """

    offset: np.ndarray
    turn: float = 0.0
    jaw: float = CLOSE
    gain: float = 0.153
    speed: float = 1.0
    turn_speed: float = 0.4


Law = Callable[[Reading], Target | tuple[Target, ...]]
"""What a task's expert does: from what is seen to the target of each arm."""


def grasp(
    to_grasp: np.ndarray, turn: float = 0.0, hover: float = 0.025, aligned: float = 0.004, **kwargs: Any
) -> Target:
    """Approaches an object from above with open jaws, and closes them on it.

    The tool sinks only as far as it is aligned, so a disturbed descent corrects itself on the way.

    Args:
        to_grasp: From link 5 to where it should be when the jaws close, shape (3,), su.
        turn: Rotation of the tool that is left to do, radians.
        hover: Height above the grasp at which the tool waits until it is aligned, su.
        aligned: Misalignment below which the jaws close, su; 0.05 su of it count as one radian.
        **kwargs: Further attributes of the target.

    Returns:
        The ``Target``.
    """
    misalignment = max(np.hypot(to_grasp[0], to_grasp[1]), 0.05 * abs(turn))
    if misalignment < aligned and abs(to_grasp[2]) < aligned:
        return Target(to_grasp, turn, CLOSE, **kwargs)
    clearance = np.clip(3 * (misalignment - aligned), 0.0, hover)
    return Target(to_grasp + (0.0, 0.0, clearance), turn, OPEN, **kwargs)


def nearest_yaw(yaw: float, period: float = 2 * np.pi, middle: float = np.pi / 4) -> float:
    """Finds the yaw, of all that differ by the period, that is nearest to a middle one.

    Args:
        yaw: Of a tool that points down, radians. Beyond half a turn observed ones jump by a whole turn.
        period: ``2 * np.pi``, or ``np.pi`` where it does not matter which jaw is on which side.
        middle: By default the yaw from which the tool can turn about as far to either side.
    """
    return (yaw - middle + period / 2) % period - period / 2 + middle


def heading(y: float, x: float) -> np.float64:
    """Returns the angle of the direction (x, y), radians, to the same last digit on every processor."""
    return np.float64(atan2(y, x))


class Expert:
    """Executes the law of one task.

    Args:
        env_class: The environment, which knows the names of an observation's numbers.
        law: See ``surrol_gym.register_task``.
    """

    def __init__(self, env_class: type[PSMEnv], law: Law):
        self._read, self._law = env_class.read, law

    def act(self, observation: Observation) -> np.ndarray:
        """Returns the action for an observation of the environment, shape (5,) or (10,), float32, in [-1, 1]."""
        targets = self._law(self._read(observation))
        if isinstance(targets, Target):
            targets = (targets,)
        return np.concatenate([_action(target) for target in targets], dtype=np.float32)


def _action(target: Target) -> tuple[float, ...]:
    distance = np.abs(target.offset).max()
    gain = target.gain + max(0.0, NEAR_GAIN - target.gain) * exp(-distance / NEAR)
    motion = target.offset * min(gain / STEP_SIZE, target.speed / max(distance, 1e-12))
    return *motion, np.clip(target.turn, -target.turn_speed, target.turn_speed), target.jaw


def make_expert(env: gym.Env) -> Expert:
    """Makes the scripted expert of an environment.

    Args:
        env: A ``surrol/...`` environment, wrapped or not.

    Returns:
        An object whose ``act(observation)`` returns an action. It keeps no state between calls.

    Raises:
        TypeError: The environment is none of a registered task, or that has no expert.
    """
    task = env.unwrapped
    law = find_law(type(task))
    if law is None or not isinstance(task, PSMEnv):
        raise TypeError(f"{env} has no scripted expert; make an environment that was registered with one.")
    return Expert(type(task), law)
