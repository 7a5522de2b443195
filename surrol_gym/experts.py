"""Scripted experts: feedback laws from an observation to an action.

A task says where its arm should be next, from nothing but the observation (``expert_target``); the expert turns that
into an action. Because no waypoint counter exists, it can start from any state, corrects until the residual is gone
and returns to an earlier phase when a grasp fails.
"""

from dataclasses import dataclass

import numpy as np

from surrol_gym.envs.psm_env import STEP_SIZE

NEAR_GAIN, NEAR = 0.5, 0.03
"""Share of a small offset that one step covers, and how small that is, su.

A learner hardly sees actions below its noise. Covering half of what is left in each step keeps the last corrections
large enough to be learned; covering that much from afar would make the arm jerk.
"""


@dataclass(frozen=True)
class Target:
    """Where a task's plan wants its arm.

    Attributes:
        offset: From link 5 to where it should be, shape (3,), su.
        turn: Rotation about the vertical that is left to do, radians.
        jaw: Gripper action: negative closes.
        gain: Share of a large offset that one step covers; near the target it rises to ``NEAR_GAIN``.
        speed: Largest action along an axis.
    """

    offset: np.ndarray
    turn: float = 0.0
    jaw: float = -0.5
    gain: float = 0.153
    speed: float = 1.0


class Expert:
    """Executes the plan of one single-arm task.

    Args:
        env: The environment, wrapped or not; only its constants are read.
    """

    _TURN_LIMIT = 0.4

    def __init__(self, env):
        self._env = env.unwrapped

    def act(self, observation):
        """Returns the action for an observation of the environment, shape (5,), float32, in [-1, 1]."""
        target = self._env.expert_target(observation)
        distance = np.abs(target.offset).max()
        gain = target.gain + (NEAR_GAIN - target.gain) * np.exp(-distance / NEAR)
        motion = target.offset * min(gain / STEP_SIZE, target.speed / max(distance, 1e-12))
        turn = np.clip(target.turn, -self._TURN_LIMIT, self._TURN_LIMIT)
        return np.array([*motion, turn, target.jaw], dtype=np.float32)


def make_expert(env):
    """Makes the scripted expert of an environment.

    Args:
        env: A ``surrol/...`` environment, wrapped or not.

    Returns:
        An object whose ``act(observation)`` returns an action. It keeps no state between calls.

    Raises:
        TypeError: The environment is not one of ``surrol_gym``.
    """
    if not hasattr(env.unwrapped, "expert_target"):
        raise TypeError(f"{env} has no scripted expert; make one of the surrol/ environments.")
    return Expert(env)
