"""Closed-form kinematics of the PSM, vectorised over leading axes (docs/psm.md#kinematics).

Poses are those of link 5 (the tool-yaw link: +y points along the jaws, z is the jaw hinge) in the RCM frame, in
metres. Joints are ``(yaw, pitch, insertion, roll, wrist pitch, wrist yaw)``; insertion is in metres, the others in
radians. The remote centre of motion (RCM) is the point where the shaft enters the patient.
"""

from math import asin, atan2, cos, pi, sin, sqrt

import numpy as np
from numpy.typing import ArrayLike

JOINT_NAMES = ("yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw")

JOINT_LIMITS = np.array(
    [[-1.5883, 1.5883], [-0.9251, 0.9251], [0.0, 0.24], [-4.5379, 4.5379], [-1.3963, 1.3963], [-1.3963, 1.3963]]
)
"""Lower and upper joint limits, shape (6, 2)."""

_LIMITS = JOINT_LIMITS.tolist()

WRIST_OFFSET = 0.0091
"""Distance from the wrist-pitch axis to the wrist-yaw axis, metres."""

RCM_OFFSET = 0.4864
"""Distance from the base to the RCM, along the base's y axis, metres."""

JAW_LENGTH = 0.0102
"""Distance from link 5 to the jaw tips along the tool, metres."""

TIP_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Rotation from link 5 to the tool tip of the dVRK, whose z axis points along the jaws ("tooltip-offset" there)."""

INSERTION_OFFSET = 0.0156
"""Insertion at which the wrist-pitch axis lies in the RCM, metres."""

_ROLL = 3

_cos, _sin = np.vectorize(cos, otypes=[np.float64]), np.vectorize(sin, otypes=[np.float64])  # see GoalEnv


class JointLimitError(ValueError):
    """A pose needs a joint beyond its limit."""


def forward(joints: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Computes the pose of link 5 in the RCM frame.

    Args:
        joints: Joint positions, shape (..., 6).

    Returns:
        The position of link 5, shape (..., 3), metres, and its rotation matrix, shape (..., 3, 3).
    """
    q1, q2, q3, q4, q5, q6 = np.moveaxis(np.asarray(joints, dtype=np.float64), -1, 0)[..., None]
    x3, y3, z3 = _shaft_frame(q1, q2)
    x4, z5 = x3 * _cos(q4) + y3 * _sin(q4), y3 * _cos(q4) - x3 * _sin(q4)
    x5, z6 = x4 * _sin(q5) + z3 * _cos(q5), x4 * _cos(q5) - z3 * _sin(q5)
    x6, y6 = x5 * _sin(q6) + z5 * _cos(q6), x5 * _cos(q6) - z5 * _sin(q6)
    position = (q3 - INSERTION_OFFSET) * z3 + WRIST_OFFSET * x5
    return position, np.stack([x6, y6, z6], axis=-1)


def inverse(
    position: ArrayLike, rotation: ArrayLike, near: np.ndarray | None = None, on_limit: str = "raise"
) -> np.ndarray:
    """Computes the joints that put link 5 at a pose in the RCM frame.

    Of the two wrist branches the one with the wrist pitch within 90 degrees is taken. Poses must lie below the RCM,
    that is, need an insertion beyond ``INSERTION_OFFSET``.

    Args:
        position: Position of link 5, shape (..., 3), metres.
        rotation: Rotation matrix of link 5, shape (..., 3, 3).
        near: Joints, shape (..., 6); the roll, whose range exceeds a full turn, is the one nearest to theirs.
        on_limit: ``"raise"`` refuses a pose beyond the joint limits, ``"clip"`` moves each joint to its limit,
            ``"ignore"`` leaves it to the caller to look at the limits.

    Returns:
        Joint positions, shape (..., 6).

    Raises:
        JointLimitError: A joint lies beyond its limit and ``on_limit`` is ``"raise"``; names the joint and its value.
        ValueError: ``on_limit`` is none of these.
    """
    if on_limit not in ("raise", "clip", "ignore"):
        raise ValueError(f"on_limit must be 'raise', 'clip' or 'ignore', got {on_limit!r}.")
    position, rotation = np.asarray(position, dtype=np.float64), np.asarray(rotation, dtype=np.float64)
    leading = position.shape[:-1]
    if not leading:
        return np.array(_inverse_of_one(position, rotation, near, on_limit))
    joints = np.empty((*leading, len(JOINT_NAMES)))
    near = None if near is None else np.broadcast_to(near, joints.shape)
    for index in np.ndindex(leading):
        joints[index] = _inverse_of_one(
            position[index], rotation[index], None if near is None else near[index], on_limit
        )
    return joints


def _inverse_of_one(
    position: np.ndarray, rotation: np.ndarray, near: np.ndarray | None, on_limit: str
) -> tuple[float, ...]:
    """``inverse`` of a single pose; plain floats, because every control step waits for it."""
    px, py, pz = position.tolist()
    (x6x, _, z6x), (x6y, _, z6y), (x6z, _, z6z) = rotation.tolist()
    z5x, z5y, z5z = py * z6z - pz * z6y, pz * z6x - px * z6z, px * z6y - py * z6x
    norm = sqrt(z5x * z5x + z5y * z5y + z5z * z5z)
    z5x, z5y, z5z = z5x / norm, z5y / norm, z5z / norm
    x5x, x5y, x5z = z6y * z5z - z6z * z5y, z6z * z5x - z6x * z5z, z6x * z5y - z6y * z5x
    px, py, pz = px - WRIST_OFFSET * x5x, py - WRIST_OFFSET * x5y, pz - WRIST_OFFSET * x5z
    length = sqrt(px * px + py * py + pz * pz)
    q1, q2 = atan2(px, -pz), -asin(py / length)
    c1, s1, c2, s2 = cos(q1), sin(q1), cos(q2), sin(q2)
    x3x, x3y, x3z = -s1 * s2, -c2, c1 * s2
    q4 = atan2(s1 * s2 * z5x + c2 * z5y - c1 * s2 * z5z, -c1 * z5x - s1 * z5z)
    c4, s4 = cos(q4), sin(q4)
    x4x, x4y, x4z = x3x * c4 - c1 * s4, x3y * c4, x3z * c4 - s1 * s4
    q5 = atan2(x5x * x4x + x5y * x4y + x5z * x4z, x5x * s1 * c2 - x5y * s2 - x5z * c1 * c2)
    q6 = atan2(x6x * x5x + x6y * x5y + x6z * x5z, x6x * z5x + x6y * z5y + x6z * z5z)
    if near is not None:
        q4 += 2 * pi * round((near[_ROLL] - q4) / (2 * pi))
    joints = (q1, q2, length + INSERTION_OFFSET, q4, q5, q6)
    if on_limit == "clip":
        return tuple(min(max(joint, low), high) for joint, (low, high) in zip(joints, _LIMITS, strict=True))
    if on_limit == "ignore":
        return joints
    for name, joint, (low, high) in zip(JOINT_NAMES, joints, _LIMITS, strict=True):
        if not low <= joint <= high:
            raise JointLimitError(
                f"The pose needs {name} = {joint:.4f}, beyond its limits [{low}, {high}]; "
                "choose a pose within reach or pass on_limit='clip'."
            )
    return joints


def _shaft_frame(q1: np.ndarray, q2: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes of the frame behind the roll joint, z3 along the shaft; q1 and q2 have the shape (..., 1)."""
    c1, s1, c2, s2 = _cos(q1), _sin(q1), _cos(q2), _sin(q2)
    return (
        np.concatenate([-s1 * s2, -c2, c1 * s2], axis=-1),
        np.concatenate([-c1, 0 * c1, -s1], axis=-1),
        np.concatenate([s1 * c2, -s2, -c1 * c2], axis=-1),
    )
