"""The arms as a dVRK reports them, each number named as in Open-H-Embodiment.

Open-H-Embodiment (github.com/open-h/open-h-embodiment) is the norm for LeRobot datasets of surgical robots. Its dVRK
data hold of each arm the position of the tool tip, its quaternion and the opening angle of the jaws. A further
description of the state beside ``observation.state`` is called ``observation.cartesian_state`` there.
"""

import numpy as np

from lerobot_gcdt.keys import CARTESIAN_STATE
from surrol_gym.envs.psm_env import Mount, PSMEnv
from surrol_gym.psm import kinematics
from surrol_gym.psm.arm import TIP_OFFSET, Arm, euler_to_matrix, matrix_to_quaternion
from surrol_gym.units import to_metres


def describe_cartesian_state(env_class: type[PSMEnv]) -> dict[str, dict[str, str]]:
    """Names the numbers of ``observe_cartesian_state``, with what a card says of them."""
    pose = [f"pose.position.{axis}" for axis in "xyz"] + [f"pose.orientation.{axis}" for axis in "xyzw"]
    arm = dict.fromkeys((*pose, "jaw"), "") | {
        pose[0]: "in the base frame of an arm: tool tip (m), its quaternion; jaws (rad)"
    }
    arms = range(1, len(env_class.mounts) + 1)
    return {CARTESIAN_STATE: {f"psm{number}_{name}": content for number in arms for name, content in arm.items()}}


def observe_cartesian_state(env: PSMEnv) -> dict[str, np.ndarray]:
    """Measures the arms as a dVRK does: from their joints, each in its own base frame.

    The base frame of a PSM lies in its remote centre of motion.

    Args:
        env: The environment, unwrapped; what it simulates is not changed.

    Returns:
        Of ``observation.cartesian_state``, for each arm the position of the tool tip, metres, its quaternion
        (x, y, z, w) and the opening angle of the jaws, radians; shape (8 * arms,), float32.
    """
    numbers = [_measure(arm, mount) for arm, mount in zip(env.arms, env.mounts, strict=True)]
    return {CARTESIAN_STATE: np.concatenate(numbers, dtype=np.float32)}


def _measure(arm: Arm, mount: Mount) -> np.ndarray:
    position, rotation = kinematics.forward(arm.joints())
    tip = position + to_metres(TIP_OFFSET) * rotation[:, 1]
    quaternion = matrix_to_quaternion(rotation @ kinematics.TIP_AXES)
    # Two quaternions stand for every orientation. The one nearer to that of the start does not jump during an episode.
    to_base = euler_to_matrix((0, 0, -mount.base_yaw))
    start = matrix_to_quaternion(to_base @ euler_to_matrix(mount.start_euler) @ kinematics.TIP_AXES)
    start *= np.sign(start[np.abs(start).argmax()])
    return np.concatenate([tip, quaternion * np.copysign(1.0, quaternion @ start), [arm.jaw_angle()]])
