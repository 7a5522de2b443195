"""The arms as a dVRK reports them, each number named as in Open-H-Embodiment.

Open-H-Embodiment (github.com/open-h/open-h-embodiment) is the norm for LeRobot datasets of surgical robots. Its dVRK
data hold of each arm the position of the tool tip, its quaternion and the opening angle of the jaws. A further
description of the state beside ``observation.state`` is called ``observation.cartesian_state`` there.
"""

import numpy as np

from surrol_gym.envs.psm_env import Mount, PSMEnv
from surrol_gym.psm import kinematics
from surrol_gym.psm.arm import TIP_OFFSET, Arm, euler_to_matrix, matrix_to_quaternion
from surrol_gym.units import to_metres

_TIP_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Rotation from link 5 to the tool tip of the dVRK, whose z axis points along the jaws ("tooltip-offset" there)."""


def cartesian_state_names(arms: int) -> list[str]:
    """Returns the name of each number of ``cartesian_state``."""
    pose = [f"pose.position.{axis}" for axis in "xyz"] + [f"pose.orientation.{axis}" for axis in "xyzw"]
    return [f"psm{number}_{name}" for number in range(1, arms + 1) for name in (*pose, "jaw")]


def cartesian_state(env: PSMEnv) -> np.ndarray:
    """Measures the arms as a dVRK does: from their joints, each in its own base frame.

    The base frame of a PSM lies in its remote centre of motion.

    Args:
        env: The environment, unwrapped; what it simulates is not changed.

    Returns:
        For each arm the position of the tool tip, metres, its quaternion (x, y, z, w) and the opening angle of the
        jaws, radians; shape (8 * arms,), float32.
    """
    numbers = [_measure(arm, mount) for arm, mount in zip(env.arms, env.mounts, strict=True)]
    return np.concatenate(numbers, dtype=np.float32)


def _measure(arm: Arm, mount: Mount) -> np.ndarray:
    position, rotation = kinematics.forward(arm.joints())
    tip = position + to_metres(TIP_OFFSET) * rotation[:, 1]
    quaternion = matrix_to_quaternion(rotation @ _TIP_AXES)
    # Two quaternions stand for every orientation. The one nearer to that of the start does not jump during an episode.
    to_base = euler_to_matrix((0, 0, -mount.base_yaw))
    start = matrix_to_quaternion(to_base @ euler_to_matrix(mount.start_euler) @ _TIP_AXES)
    start *= np.sign(start[np.abs(start).argmax()])
    return np.concatenate([tip, quaternion * np.copysign(1.0, quaternion @ start), [arm.jaw_angle()]])
