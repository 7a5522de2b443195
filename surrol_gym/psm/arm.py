"""A PSM in the simulated world: poses in, motion of its gripper out."""

from math import hypot
from typing import Any

import numpy as np
import pybullet

from surrol_gym.bullet import Vector, World
from surrol_gym.psm import kinematics
from surrol_gym.units import to_metres, to_su

END_EFFECTOR = -1
"""Index of link 5 in the simulated body: the tool-yaw link, whose pose is observed and commanded."""

JAWS = (0, 1)
TIP_OFFSET = round(float(to_su(kinematics.JAW_LENGTH)), 4)
"""Distance from link 5 to the jaw tips along the tool, su (docs/psm.md#link-5-and-the-tip)."""

JAW_CLOSED, JAW_OPEN = 0.0, np.deg2rad(40)
DOWN = np.array([-np.pi / 2, 0.0, np.pi / 2])
"""Euler angles of a tool that points straight down with its jaws opening along the world's y axis."""

# Jaw motors of PyBullet's defaults: 0.9 of the error is left after a sub-step (docs/psm.md#motors).
_JAW_GAINS, _JAW_FORCES = {"positionGains": (0.1, 0.1), "velocityGains": (1.0, 1.0)}, (2.0, 2.0)
_SMALLER_TURNS = (0.5, 0.25, 0.125, 0.0)
"""Shares of a turn that are tried where a joint's limit forbids the whole one."""

_HOLDING_FORCE = 500.0
"""Of the constraint on link 5, kg su / s^2: free motion needs less, and an arm pressed onto something yields to it."""


class Arm:
    """One PSM.

    Only its gripper is simulated: link 5 and the two jaws. The motors of the original are so strong that link 5 does
    what the closed-form kinematics say; a stiff constraint that takes it there costs a third of eight simulated joints
    and reaches the same poses. The rest of the arm is drawn, at the joints that the pose of link 5 needs.

    Args:
        world: The ``surrol_gym.bullet.World`` to load it into.
        base_position: Position of its base, metres, world frame.
        base_yaw: Rotation of its base about z, radians.
        look: URDF that pictures show.
        jaw_mass: Mass of each jaw, kg.

    Attributes:
        contact_force: Sum of the normal forces on the gripper when ``sense`` was called, kg su / s^2.
        jaw_target: Opening angle that the jaws were last sent to, radians.
    """

    def __init__(
        self, world: World, base_position: Vector, base_yaw: float, look: str = "psm.urdf", jaw_mass: float = 0.03
    ):
        self._client = world.client
        base = base_position, pybullet.getQuaternionFromEuler((0, 0, base_yaw))
        self._rcm = pybullet.multiplyTransforms(*base, (0, kinematics.RCM_OFFSET, 0), (0, 0, 0, 1))
        self._to_rcm = pybullet.invertTransform(*self._rcm)
        self._joints: np.ndarray = np.zeros(6)
        self._touching: set[tuple[int, int]] = set()
        self.contact_force = 0.0
        self.jaw_target = JAW_CLOSED
        self.body = world.load("psm_gripper.urdf", fixed=False, sleeps=False, drawn=False)
        for jaw in JAWS:
            self._client.changeDynamics(self.body, jaw, mass=jaw_mass)
        self._hold = self._client.createConstraint(
            self.body, END_EFFECTOR, -1, -1, pybullet.JOINT_FIXED, (0, 0, 0), (0, 0, 0), (0, 0, 0)
        )
        world.draw(look, to_su(base_position), base_yaw, joints=self._drawn_joints)

    def reset(self, position: Vector, euler: Vector, jaw: float = JAW_CLOSED) -> None:
        """Puts link 5 at a pose at once, at rest, and holds it there.

        Args:
            position: Position of link 5, shape (3,), su, world frame.
            euler: Its orientation, fixed-axis x-y-z, radians.
            jaw: Opening angle between the jaws, radians.

        Raises:
            JointLimitError: The pose is out of reach.
        """
        orientation = pybullet.getQuaternionFromEuler(euler)
        self._joints = self._solve(position, orientation)
        self._client.resetBasePositionAndOrientation(self.body, position, orientation)
        self._client.resetBaseVelocity(self.body, (0, 0, 0), (0, 0, 0))
        for joint, angle in zip(JAWS, (-jaw / 2, jaw / 2), strict=True):
            self._client.resetJointState(self.body, joint, angle)
        self._hold_at(position, orientation)
        self.command_jaws(jaw)

    def move_to(self, position: Vector, euler: Vector) -> None:
        """Moves link 5 towards a pose; a joint that would pass its limit stops there.

        The tool stops turning before this would move link 5 elsewhere.

        Args:
            position: Position of link 5, shape (3,), su, world frame.
            euler: Its orientation, fixed-axis x-y-z, radians.
        """
        orientation = pybullet.getQuaternionFromEuler(euler)
        try:
            self._joints = self._solve(position, orientation, near=self._joints)
        except kinematics.JointLimitError:
            position, orientation = self._nearest_in_reach(position, orientation)
        self._hold_at(position, orientation)

    def command_jaws(self, angle: float) -> None:
        """Sets the target of the opening angle between the jaws, radians; the squeeze is limited to 2 N su."""
        self.jaw_target = angle
        self._client.setJointMotorControlArray(
            self.body,
            JAWS,
            pybullet.POSITION_CONTROL,
            targetPositions=(-angle / 2, angle / 2),
            forces=_JAW_FORCES,
            **_JAW_GAINS,
        )

    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the position of link 5, shape (3,), su, and its Euler angles, shape (3,), world frame."""
        position, orientation = self._client.getBasePositionAndOrientation(self.body)
        return np.array(position), np.array(pybullet.getEulerFromQuaternion(orientation))

    def tip(self) -> np.ndarray:
        """Returns the point between the jaw tips, shape (3,), su, world frame."""
        pose = self._client.getBasePositionAndOrientation(self.body)
        return np.array(pybullet.multiplyTransforms(*pose, (0, TIP_OFFSET, 0), (0, 0, 0, 1))[0])

    def joints(self) -> np.ndarray:
        """Returns the joint positions, shape (6,), metres and radians."""
        position, orientation = self._client.getBasePositionAndOrientation(self.body)
        return self._solve(position, orientation, near=self._joints, on_limit="clip")

    def jaw_angle(self) -> float:
        """Returns the opening angle between the jaws, radians."""
        jaw1, jaw2 = self._client.getJointStates(self.body, JAWS)
        return jaw2[0] - jaw1[0]

    def sense(self) -> None:
        """Notes what the gripper touched in the last sub-step; call it before contacts are forgotten."""
        points = self._client.getContactPoints(self.body)
        self._touching = {(point[2], point[3]) for point in points}
        self.contact_force = float(sum(point[9] for point in points))

    def touches(self, body: int) -> tuple[bool, bool]:
        """Returns for each jaw whether it touched a body when ``sense`` was called."""
        return (body, JAWS[0]) in self._touching, (body, JAWS[1]) in self._touching

    def get_state(self) -> tuple[float, ...]:
        """Returns what the pose of link 5 does not tell: the joints it was last sent to, with the turns of the roll."""
        return tuple(self._joints.tolist())

    def set_state(self, state: tuple[float, ...]) -> None:
        """Restores ``get_state``; the world must be restored, too."""
        self._joints = np.array(state)

    def _solve(self, position: Vector, orientation: Vector, **options: Any) -> np.ndarray:
        """Joints of a pose in the world: position, su, and quaternion."""
        position, orientation = pybullet.multiplyTransforms(*self._to_rcm, to_metres(position), orientation)
        return kinematics.inverse(position, quaternion_to_matrix(orientation), **options)

    def _nearest_in_reach(self, position: Vector, orientation: Vector) -> tuple[Vector, Vector]:
        """Moves the joints as near to a pose as their limits allow; returns the pose that results."""
        orientation = self._turned_within_reach(position, orientation)
        self._joints = self._solve(position, orientation, near=self._joints, on_limit="clip")
        position, rotation = kinematics.forward(self._joints)
        position, orientation = pybullet.multiplyTransforms(*self._rcm, position, matrix_to_quaternion(rotation))
        return to_su(position), orientation

    def _turned_within_reach(self, position: Vector, orientation: Vector) -> Vector:
        """Turns from the measured orientation towards another as far as the joints can bring link 5 to the position.

        That does not depend on the last joint. Any other one that stopped alone would move the bent wrist.
        """
        measured = self._client.getBasePositionAndOrientation(self.body)[1]
        low, high = kinematics.JOINT_LIMITS[:-1].T
        wanted = orientation
        for share in _SMALLER_TURNS:
            joints = self._solve(position, orientation, near=self._joints, on_limit="ignore")[:-1]
            if ((low <= joints) & (joints <= high)).all():
                break
            orientation = pybullet.getQuaternionSlerp(measured, wanted, share)
        return orientation

    def _hold_at(self, position: Vector, orientation: Vector) -> None:
        self._client.changeConstraint(
            self._hold, position, jointChildFrameOrientation=orientation, maxForce=_HOLDING_FORCE
        )

    def _drawn_joints(self) -> list[float]:
        """Positions of the joints of the drawn arm, su and radians."""
        jaws = [state[0] for state in self._client.getJointStates(self.body, JAWS)]
        return [*(self.joints() * (1, 1, to_su(1.0), 1, 1, 1)), *jaws]


def euler_to_matrix(euler: Vector) -> np.ndarray:
    """Converts fixed-axis x-y-z Euler angles, shape (3,), radians, to a rotation matrix, shape (3, 3)."""
    return quaternion_to_matrix(pybullet.getQuaternionFromEuler(euler))


def quaternion_to_matrix(quaternion: Vector) -> np.ndarray:
    """Converts a quaternion (x, y, z, w) to a rotation matrix, shape (3, 3)."""
    return np.array(pybullet.getMatrixFromQuaternion(quaternion)).reshape(3, 3)  # faster than np.reshape


def matrix_to_quaternion(matrix: np.ndarray) -> np.ndarray:
    """Converts a rotation matrix, shape (3, 3), to a quaternion (x, y, z, w)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    # Four times the products of the quaternion's numbers, so that each row is a multiple of it.
    products = np.array(
        [
            [1 + xx - yy - zz, yx + xy, zx + xz, zy - yz],
            [yx + xy, 1 - xx + yy - zz, zy + yz, xz - zx],
            [zx + xz, zy + yz, 1 - xx - yy + zz, yx - xy],
            [zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz],
        ]
    )
    row = products[products.diagonal().argmax()]
    return row / hypot(*row)
