"""A PSM in the simulated world: poses in, joint motors out."""

import numpy as np
import pybullet

from surrol_gym.psm import kinematics
from surrol_gym.units import to_metres, to_su

END_EFFECTOR = 5
"""Link whose pose is observed and commanded: the tool-yaw link, 0.051 su behind the jaw tips."""

JAWS = (6, 7)
TIP_OFFSET = 0.051
"""Distance from link 5 to the jaw tips along the tool, su (facts, section 1.2)."""

JAW_CLOSED, JAW_OPEN = 0.0, np.deg2rad(40)
DOWN = np.array([-np.pi / 2, 0.0, np.pi / 2])
"""Euler angles of a tool that points straight down with its jaws opening along the world's y axis."""

# Joint motors of PyBullet's defaults: 0.9 of the error is left after a sub-step (facts, section 1.5).
_POSITION_GAIN, _VELOCITY_GAIN = 0.1, 1.0
_JOINT_FORCE, _JAW_FORCE = 1e5, 2.0


class Arm:
    """One PSM.

    Args:
        world: The ``surrol_gym.bullet.World`` to load it into.
        base_position: Position of its base, metres, world frame.
        base_yaw: Rotation of its base about z, radians.
    """

    def __init__(self, world, base_position, base_yaw):
        self._client = world.client
        self.body = world.load("psm.urdf", to_su(base_position), base_yaw)
        c, s = np.cos(base_yaw), np.sin(base_yaw)
        self._rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        self._rcm = np.asarray(base_position) + self._rotation @ (0.0, 0.4864, 0.0)

    def reset(self, position, euler):
        """Puts link 5 at a pose at once, at rest, jaws closed, and lets the motors hold it there.

        Args:
            position: Position of link 5, shape (3,), su, world frame.
            euler: Its orientation, fixed-axis x-y-z, radians.

        Raises:
            JointLimitError: The pose is out of reach.
        """
        targets = self._solve(position, euler)
        for joint, target in enumerate((*targets, JAW_CLOSED, JAW_CLOSED)):
            self._client.resetJointState(self.body, joint, target)
        self._command(targets)
        self.command_jaws(JAW_CLOSED)

    def move_to(self, position, euler):
        """Sets the motors' targets to a pose of link 5; a joint that would pass its limit stops there.

        Args:
            position: Position of link 5, shape (3,), su, world frame.
            euler: Its orientation, fixed-axis x-y-z, radians.
        """
        self._command(self._solve(position, euler, near=self.joints(), on_limit="clip"))

    def command_jaws(self, angle):
        """Sets the target of the opening angle between the jaws, radians; the squeeze is limited to 2 N su."""
        self._client.setJointMotorControlArray(
            self.body,
            JAWS,
            pybullet.POSITION_CONTROL,
            targetPositions=(-angle / 2, angle / 2),
            positionGains=(_POSITION_GAIN,) * 2,
            velocityGains=(_VELOCITY_GAIN,) * 2,
            forces=(_JAW_FORCE,) * 2,
        )

    def pose(self):
        """Returns the position of link 5, shape (3,), su, and its Euler angles, shape (3,), world frame."""
        state = self._client.getLinkState(self.body, END_EFFECTOR, computeForwardKinematics=1)
        return np.array(state[4]), np.array(pybullet.getEulerFromQuaternion(state[5]))

    def tip(self):
        """Returns the point between the jaw tips, shape (3,), su, world frame."""
        state = self._client.getLinkState(self.body, END_EFFECTOR, computeForwardKinematics=1)
        return np.array(pybullet.multiplyTransforms(state[4], state[5], (0, TIP_OFFSET, 0), (0, 0, 0, 1))[0])

    def joints(self):
        """Returns the joint positions, shape (6,), metres and radians."""
        joints = np.array([state[0] for state in self._client.getJointStates(self.body, range(6))])
        joints[2] = to_metres(joints[2])
        return joints

    def jaw_angle(self):
        """Returns the opening angle between the jaws, radians."""
        jaw1, jaw2 = self._client.getJointStates(self.body, JAWS)
        return jaw2[0] - jaw1[0]

    def touches(self, body):
        """Returns for each jaw whether it touches a body."""
        links = {point[3] for point in self._client.getContactPoints(self.body, body)}
        return JAWS[0] in links, JAWS[1] in links

    def contact_force(self):
        """Returns the sum of the normal forces on the arm in the last sub-step, kg su / s^2."""
        return float(sum(point[9] for point in self._client.getContactPoints(self.body)))

    def _solve(self, position, euler, **options):
        """Joint positions in the simulation's units, su and radians, for a pose in the world."""
        rotation = self._rotation.T @ euler_to_matrix(euler)
        position = self._rotation.T @ (to_metres(position) - self._rcm)
        joints = kinematics.inverse(position, rotation, **options)
        joints[2] = to_su(joints[2])
        return joints

    def _command(self, targets):
        self._client.setJointMotorControlArray(
            self.body,
            range(6),
            pybullet.POSITION_CONTROL,
            targetPositions=targets,
            positionGains=(_POSITION_GAIN,) * 6,
            velocityGains=(_VELOCITY_GAIN,) * 6,
            forces=(_JOINT_FORCE,) * 6,
        )


def euler_to_matrix(euler):
    """Converts fixed-axis x-y-z Euler angles, shape (3,), radians, to a rotation matrix, shape (3, 3)."""
    return np.reshape(pybullet.getMatrixFromQuaternion(pybullet.getQuaternionFromEuler(euler)), (3, 3))
