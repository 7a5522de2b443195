"""Set-points: what the arms are sent, many times a second, made from the five steps a second of an episode."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.spatial.transform import RigidTransform, Rotation

from lerobot_gcdt.robot import tool_tip
from lerobot_gcdt.robot.base_frame import TABLE_ORIGIN, Placement, arm_names, simulated
from lerobot_gcdt.robot.episodes import STEP, Episode
from lerobot_gcdt.robot.limits import PSM, Limits
from surrol_gym.psm import kinematics
from surrol_gym.units import to_metres

TRIES, LARGEST_STRETCH, MARGIN = 6, 4.0, 0.99
"""How often steps that are too fast are stretched, by how much at a time at most, and the share of a limit aimed at."""


@dataclass(frozen=True)
class SetPoints:
    """What one arm is sent, N set-points.

    Attributes:
        position: Of the tool tip in the RCM frame, metres, (N, 3).
        quaternion: Of the tool tip there, x, y, z, w, (N, 4); its z axis points along the jaws, as in the dVRK.
        joints: Joint positions, metres and radians, (N, 6).
        jaw: Opening angle of the jaws, radians, (N,).
        rcm: Pose of the RCM in the table frame, (4, 4), metres.
        base: Pose of the RCM in the frame of ``Trajectory.frame``, (4, 4), metres.
        workspace: Lowest and highest position of link 5, the hinge of the jaws, in the table frame, metres, (2, 3).
    """

    position: np.ndarray
    quaternion: np.ndarray
    joints: np.ndarray
    jaw: np.ndarray
    rcm: np.ndarray
    base: np.ndarray
    workspace: np.ndarray

    def in_frame(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns positions and quaternions of the tip in a frame in which the RCM has the pose ``frame``, (4, 4)."""
        rotation = Rotation.from_matrix(frame[:3, :3])
        turned = rotation * Rotation.from_quat(self.quaternion)
        return rotation.apply(self.position) + frame[:3, 3], continuous(turned.as_quat())


@dataclass(frozen=True)
class Trajectory:
    """What the arms of a task are sent, from the start of an episode to its end.

    Attributes:
        task: Name of the task.
        seed: Seed of the episode.
        source: Who acted: ``expert``, or the name of a policy.
        success: Whether the episode ended in success.
        rate: Set-points a second.
        knots: Index of the set-point at the start of the episode and at the end of each step, (T + 1,).
        frame: Name of the frame of ``SetPoints.base``.
        no_go: Boxes that no arm may enter: lowest and highest corner in the table frame, (B, 2, 3), metres.
        arms: For each arm its set-points.
    """

    task: str
    seed: int
    source: str
    success: bool
    rate: float
    knots: np.ndarray
    frame: str
    no_go: np.ndarray
    arms: dict[str, SetPoints]

    @property
    def time(self) -> np.ndarray:
        """When each set-point is sent, seconds from the start, (N,)."""
        return np.arange(self.knots[-1] + 1) / self.rate

    @property
    def step(self) -> np.ndarray:
        """The step of the episode to which each set-point belongs, counted from 0, (N,)."""
        return np.clip(np.searchsorted(self.knots, np.arange(self.knots[-1] + 1)) - 1, 0, None)

    def stretched(self) -> list[int]:
        """Returns the steps that take longer than in the simulator."""
        return np.flatnonzero(np.diff(self.knots) / self.rate > STEP + 0.5 / self.rate).tolist()


def interpolate(
    episode: Episode, placement: Placement | None = None, rate: float = 200.0, limits: Limits = PSM
) -> Trajectory:
    """Makes set-points of an episode.

    Every step of the episode ends in a knot, where the arm is exactly where the simulator sent it. Between knots,
    coordinates of the tip in the table frame, its rotation vector and the jaws follow cubic curves that are monotone
    and begin and end at rest: they never leave what lies between two knots. A step that would break a limit of speed or
    acceleration takes longer.

    Args:
        episode: The episode.
        placement: Where the arms stand; None for where they do in the simulator.
        rate: Set-points a second, at least one a step.
        limits: The limits of speed and acceleration.

    Returns:
        The trajectory. Whether it keeps to all limits is not looked at.

    Raises:
        ValueError: The rate is too low.
    """
    if not rate * STEP >= 1:
        raise ValueError(f"The rate must be at least {1 / STEP:g} set-points a second, one a step; got {rate:g}.")
    placement = placement or simulated(episode.mounts)
    samples = np.full(len(episode.joints) - 1, np.ceil(rate * STEP - 1e-9))
    for _ in range(TRIES):
        knots = np.concatenate([[0], np.cumsum(samples)]).astype(int)
        arms = {
            arm: _arm(episode, number, placement, knots, arm)
            for number, arm in enumerate(arm_names(len(episode.mounts)))
        }
        stretch = np.max([_too_fast(set_points, knots, rate, limits) for set_points in arms.values()], axis=0)
        if (stretch <= 1).all():
            break
        samples = np.ceil(samples * np.clip(stretch, 1, LARGEST_STRETCH))
    success = bool(episode.success[-1])
    return Trajectory(
        episode.task, episode.seed, episode.source, success, rate, knots, placement.frame, placement.no_go, arms
    )


def tip_pose(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes the pose of the dVRK's tool tip in the RCM frame.

    Args:
        joints: Joint positions, metres and radians, (N, 6).

    Returns:
        Positions, metres, (N, 3), and rotation matrices, (N, 3, 3).
    """
    return tool_tip.from_link5(*kinematics.forward(joints))


def continuous(quaternions: np.ndarray) -> np.ndarray:
    """Of the two quaternions of each orientation, (N, 4), takes the one nearer to that before."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0
    return quaternions * np.concatenate([[1.0], np.where(np.cumsum(flips) % 2, -1.0, 1.0)])[:, None]


def _arm(episode: Episode, number: int, placement: Placement, knots: np.ndarray, arm: str) -> SetPoints:
    in_simulator = RigidTransform.from_matrix(simulated(episode.mounts).rcm[arm])
    at_knots = in_simulator * RigidTransform.from_components(*_tips(episode.joints[:, number]))
    at = np.arange(knots[-1] + 1)
    first = at_knots.rotation[0]
    on_table = RigidTransform.from_components(
        _monotone(knots, at_knots.translation, at),
        first * Rotation.from_rotvec(_monotone(knots, _turns(first.inv() * at_knots.rotation), at)),
    )
    local = RigidTransform.from_matrix(placement.rcm[arm]).inv() * on_table
    joints = _joints(local)
    return SetPoints(
        local.translation,
        continuous(local.rotation.as_quat()),
        joints,
        _monotone(knots, episode.jaws[:, number], at),
        placement.rcm[arm],
        placement.base[arm],
        to_metres(episode.mounts[number].limits()) - TABLE_ORIGIN,
    )


def _tips(joints: np.ndarray) -> tuple[np.ndarray, Rotation]:
    position, rotation = tip_pose(joints)
    return position, Rotation.from_matrix(rotation)


def _monotone(knots: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    slopes = PchipInterpolator(knots, values).derivative()(knots)
    slopes[[0, -1]] = 0
    return CubicHermiteSpline(knots, values, slopes)(at)


def _turns(rotations: Rotation) -> np.ndarray:
    """Rotation vectors that do not jump where a turn passes 180 degrees, (N, 3)."""
    vectors = rotations.as_rotvec()
    for before, vector in zip(vectors[:-1], vectors[1:], strict=True):
        along = vector if vector.any() else before
        if along.any():
            axis = along / np.linalg.norm(along)
            vector += 2 * np.pi * np.round((before - vector) @ axis / (2 * np.pi)) * axis
    return vectors


def _joints(tips: RigidTransform) -> np.ndarray:
    """Joints that put the tool tip at poses in the RCM frame, (N, 6), of all turns of the roll near the middle one."""
    joints = tool_tip.joints(tips.translation, tips.rotation.as_matrix())
    roll = np.unwrap(joints[:, 3])
    joints[:, 3] = roll - 2 * np.pi * np.round((roll.min() + roll.max()) / (4 * np.pi))
    return joints


def _too_fast(set_points: SetPoints, knots: np.ndarray, rate: float, limits: Limits) -> np.ndarray:
    """By how much each step has to be stretched, (T,); up to 1 where it need not."""
    values = np.column_stack([set_points.joints, set_points.jaw])
    fastest = MARGIN * np.array([*limits.velocity, limits.jaw_velocity])
    strongest = MARGIN * np.array([*limits.acceleration, limits.jaw_acceleration])
    velocity = np.diff(values, axis=0) * rate
    acceleration = np.diff(velocity, axis=0, prepend=velocity[:1]) * rate
    acceleration[knots[:-1]] = 0  # half of it is the step before's
    excess = np.maximum(np.abs(velocity) / fastest, np.sqrt(np.abs(acceleration) / strongest)).max(axis=-1)
    return np.maximum.reduceat(excess, knots[:-1])
