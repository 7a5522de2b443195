"""Closed-form kinematics of the PSM, vectorised over leading axes (facts, section 1.2).

Poses are those of link 5 (the tool-yaw link: +y points along the jaws, z is the jaw hinge) in the RCM frame, in
metres. Joints are ``(yaw, pitch, insertion, roll, wrist pitch, wrist yaw)``; insertion is in metres, the others in
radians. The remote centre of motion (RCM) is the point where the shaft enters the patient.
"""

import numpy as np

JOINT_NAMES = ("yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw")

JOINT_LIMITS = np.array(
    [[-1.5883, 1.5883], [-0.9251, 0.9251], [0.0, 0.24], [-4.5379, 4.5379], [-1.3963, 1.3963], [-1.3963, 1.3963]]
)
"""Lower and upper joint limits, shape (6, 2)."""

WRIST_OFFSET = 0.0091
"""Distance from the wrist-pitch axis to the wrist-yaw axis, metres."""

INSERTION_OFFSET = 0.0156
"""Insertion at which the wrist-pitch axis lies in the RCM, metres."""

_ROLL = 3


class JointLimitError(ValueError):
    """A pose needs a joint beyond its limit."""


def forward(joints):
    """Computes the pose of link 5 in the RCM frame.

    Args:
        joints: Joint positions, shape (..., 6).

    Returns:
        The position of link 5, shape (..., 3), metres, and its rotation matrix, shape (..., 3, 3).
    """
    q1, q2, q3, q4, q5, q6 = np.moveaxis(np.asarray(joints, dtype=np.float64), -1, 0)[..., None]
    x3, y3, z3 = _shaft_frame(q1, q2)
    x4, z5 = x3 * np.cos(q4) + y3 * np.sin(q4), y3 * np.cos(q4) - x3 * np.sin(q4)
    x5, z6 = x4 * np.sin(q5) + z3 * np.cos(q5), x4 * np.cos(q5) - z3 * np.sin(q5)
    x6, y6 = x5 * np.sin(q6) + z5 * np.cos(q6), x5 * np.cos(q6) - z5 * np.sin(q6)
    position = (q3 - INSERTION_OFFSET) * z3 + WRIST_OFFSET * x5
    return position, np.stack([x6, y6, z6], axis=-1)


def inverse(position, rotation, near=None, on_limit="raise"):
    """Computes the joints that put link 5 at a pose in the RCM frame.

    Of the two wrist branches the one with the wrist pitch within 90 degrees is taken. Poses must lie below the RCM,
    that is, need an insertion beyond ``INSERTION_OFFSET``.

    Args:
        position: Position of link 5, shape (..., 3), metres.
        rotation: Rotation matrix of link 5, shape (..., 3, 3).
        near: Joints, shape (..., 6); the roll, whose range exceeds a full turn, is the one nearest to theirs.
        on_limit: ``"raise"`` refuses a pose beyond the joint limits, ``"clip"`` moves each joint to its limit.

    Returns:
        Joint positions, shape (..., 6).

    Raises:
        JointLimitError: A joint lies beyond its limit and ``on_limit`` is ``"raise"``; names the joint and its value.
        ValueError: ``on_limit`` is neither ``"raise"`` nor ``"clip"``.
    """
    if on_limit not in ("raise", "clip"):
        raise ValueError(f"on_limit must be 'raise' or 'clip', got {on_limit!r}.")
    p6 = np.asarray(position, dtype=np.float64)
    x6, _, z6 = np.moveaxis(np.asarray(rotation, dtype=np.float64), -1, 0)
    z5 = _cross(p6, z6)
    z5 = z5 / np.sqrt(_dot(z5, z5))[..., None]
    x5 = _cross(z6, z5)
    p5 = p6 - WRIST_OFFSET * x5
    length = np.sqrt(_dot(p5, p5))
    q1 = np.arctan2(p5[..., 0], -p5[..., 2])
    q2 = -np.arcsin(p5[..., 1] / length)
    x3, y3, z3 = _shaft_frame(q1[..., None], q2[..., None])
    q4 = np.arctan2(-_dot(x3, z5), _dot(y3, z5))
    x4 = x3 * np.cos(q4)[..., None] + y3 * np.sin(q4)[..., None]
    q5 = np.arctan2(_dot(x5, x4), _dot(x5, z3))
    q6 = np.arctan2(_dot(x6, x5), _dot(x6, z5))
    joints = np.stack([q1, q2, length + INSERTION_OFFSET, q4, q5, q6], axis=-1)
    if near is not None:
        turns = np.round((np.asarray(near)[..., _ROLL] - q4) / (2 * np.pi))
        joints[..., _ROLL] += 2 * np.pi * turns
    clipped = np.clip(joints, JOINT_LIMITS[:, 0], JOINT_LIMITS[:, 1])
    if on_limit == "raise" and not np.array_equal(clipped, joints):
        worst = np.unravel_index(np.argmax(~(clipped == joints)), joints.shape)
        low, high = JOINT_LIMITS[worst[-1]]
        raise JointLimitError(
            f"The pose needs {JOINT_NAMES[worst[-1]]} = {joints[worst]:.4f}, beyond its limits [{low}, {high}]; "
            "choose a pose within reach or pass on_limit='clip'."
        )
    return clipped


def _shaft_frame(q1, q2):
    """Axes of the frame behind the roll joint, z3 along the shaft; q1 and q2 have the shape (..., 1)."""
    c1, s1, c2, s2 = np.cos(q1), np.sin(q1), np.cos(q2), np.sin(q2)
    return (
        np.concatenate([-s1 * s2, -c2, c1 * s2], axis=-1),
        np.concatenate([-c1, 0 * c1, -s1], axis=-1),
        np.concatenate([s1 * c2, -s2, -c1 * c2], axis=-1),
    )


def _dot(a, b):
    return (a * b).sum(-1)


def _cross(a, b):
    # np.cross costs three times as much on single vectors, and one runs in every control step.
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
