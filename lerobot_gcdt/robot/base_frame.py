"""Where the arms stand: in the simulator, or as a user measured it (docs/dvrk.md#base-frames)."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from surrol_gym.envs.psm_env import Mount

TABLE_ORIGIN = (0.55, 0.0, 0.676)
"""Origin of the table frame, metres, world frame: on the top of the table, below the middle of the usual workspace. Its
axes are those of the world."""

LOCAL = "local"
"""Name of the frame of Cartesian set-points that are given in the RCM frame."""

TOLERANCE = 1e-3
"""How far a measured rotation may be off; what is nearer is taken for rounding, and mended."""

FARTHEST = 0.5
"""Metres: from an RCM that is farther from the middle of the table, no tool gets there."""


@dataclass(frozen=True)
class Placement:
    """Where the arms of a task stand.

    Attributes:
        frame: Name of the frame that Cartesian set-points are given in, beside the RCM's.
        rcm: For each arm the pose of its RCM in the table frame, (4, 4), metres.
        base: For each arm the pose of its RCM in ``frame``, (4, 4), metres.
        no_go: Boxes that no arm may enter: lowest and highest corner in the table frame, (B, 2, 3), metres.
    """

    frame: str
    rcm: dict[str, np.ndarray]
    base: dict[str, np.ndarray]
    no_go: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 3)))


def simulated(mounts: tuple[Mount, ...]) -> Placement:
    """Returns where the arms of a task stand in the simulator; Cartesian set-points are those of the RCM frame."""
    to_table = np.eye(4)
    to_table[:3, 3] = -np.array(TABLE_ORIGIN)
    rcm = {arm: to_table @ mount.rcm() for arm, mount in zip(arm_names(len(mounts)), mounts, strict=True)}
    return Placement(LOCAL, rcm, {arm: np.eye(4) for arm in rcm})


def read_placement(path: str | Path, arms: tuple[str, ...]) -> Placement:
    """Reads measured transforms.

    Args:
        path: JSON file with ``frame``, a name; ``PSM1`` and ``PSM2``, the poses of the RCMs in that frame; and
            ``table``, that of the table frame. Poses are (4, 4) matrices, metres. Without ``table``, the frame is the
            table frame. ``no_go`` lists boxes, each by two opposite corners in the table frame.
        arms: Names of the arms that are needed.

    Returns:
        The placement.

    Raises:
        ValueError: The file is no such file, an arm is missing, or a matrix is no pose; names it and what is wrong.
        OSError: The file cannot be read.
    """
    try:
        measured = json.loads(Path(path).read_text())
    except ValueError as error:
        raise ValueError(f"{path} is no JSON: {error}.") from None
    if not isinstance(measured, Mapping) or not isinstance(measured.get("frame"), str):
        raise ValueError(f'{path} must name the frame that was measured in, as in {{"frame": "camera", ...}}.')
    if unknown := set(measured) - {"frame", "table", "PSM1", "PSM2", "no_go"}:
        raise ValueError(f"{path} holds {', '.join(sorted(unknown))}; known are frame, table, PSM1, PSM2 and no_go.")
    if missing := [arm for arm in arms if arm not in measured]:
        raise ValueError(f"{path} lacks the pose of {', '.join(missing)}.")
    table = _pose(measured.get("table", np.eye(4)), f"table in {path}")
    base = {arm: _pose(measured[arm], f"{arm} in {path}") for arm in arms}
    rcm = {arm: np.linalg.inv(table) @ pose for arm, pose in base.items()}
    for arm, pose in rcm.items():
        x, y, z = pose[:3, 3]
        if z <= 0 or np.linalg.norm(pose[:3, 3]) > FARTHEST:
            raise ValueError(
                f"By {path} the RCM of {arm} is at ({x:.3f}, {y:.3f}, {z:.3f}) m in the table frame; it should be "
                f"above the table and within {FARTHEST} m. Are the lengths metres, and the poses those of the RCM in "
                f"the frame {measured['frame']}, not the other way round?"
            )
    return Placement(measured["frame"], rcm, base, _boxes(measured.get("no_go", []), f"no_go in {path}"))


def arm_names(count: int) -> tuple[str, ...]:
    """Returns the names of the arms: ``PSM1``, and ``PSM2`` where there are two."""
    return tuple(f"PSM{number}" for number in range(1, count + 1))


def _boxes(corners: Any, name: str) -> np.ndarray:
    boxes = _numbers(corners) if corners else np.zeros((0, 2, 3))
    if boxes.ndim != 3 or boxes.shape[1:] != (2, 3) or not np.isfinite(boxes).all():
        raise ValueError(f"{name} must list boxes, each by two corners of 3 numbers.")
    return np.stack([boxes.min(axis=1), boxes.max(axis=1)], axis=1)


def _numbers(values: Any) -> np.ndarray:
    """The values as an array, which is empty if they are none."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty(0)


def _pose(matrix: Any, name: str) -> np.ndarray:
    """Checks a measured pose, and mends the rounding of its rotation."""
    pose = _numbers(matrix)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError(f"{name} must be a matrix of 4 rows of 4 numbers.")
    if not np.allclose(pose[3], (0, 0, 0, 1), rtol=0, atol=1e-9):
        raise ValueError(f"The last row of {name} must be 0, 0, 0, 1; it is {pose[3].tolist()}. Is it transposed?")
    rotation = pose[:3, :3]
    lengths = np.linalg.norm(rotation, axis=0)
    if np.ptp(lengths) < TOLERANCE < np.abs(lengths - 1).max():
        raise ValueError(f"{name} scales by {lengths.mean():.4g}; a pose does not, so divide its rotation by that.")
    if np.linalg.det(rotation) < 0:
        raise ValueError(f"{name} is left-handed: it mirrors; one of its axes has the wrong sign, or two are swapped.")
    error = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if error > TOLERANCE:
        raise ValueError(f"{name} holds no rotation: its axes are {error:.4f} away from orthogonal unit vectors.")
    pose[:3, :3] = Rotation.from_matrix(rotation).as_matrix()
    return pose
