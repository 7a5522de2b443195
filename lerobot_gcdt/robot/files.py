"""Trajectories as files: a CSV for each arm, to look into, and one NPZ, to load (docs/dvrk.md#files)."""

from dataclasses import fields
from pathlib import Path

import numpy as np

from lerobot_gcdt.robot.set_points import SetPoints, Trajectory
from surrol_gym.psm.kinematics import JOINT_NAMES

UNITS = ["rad", "rad", "m", "rad", "rad", "rad"]
COLUMNS = [
    *("time_s", "step", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"),
    *(f"{name}_{unit}" for name, unit in zip(JOINT_NAMES, UNITS, strict=True)),
    "jaw_rad",
]
"""Of the CSV files: the pose is that of the tool tip in the RCM frame."""

NPZ_FILE = "trajectory.npz"


def write_csv(trajectory: Trajectory, folder: Path) -> None:
    """Writes ``PSM1.csv`` and the like, to a thousandth of a micrometre and of a microradian."""
    for arm, points in trajectory.arms.items():
        columns = (trajectory.time, trajectory.step, points.position, points.quaternion, points.joints, points.jaw)
        formats = ["%.6f", "%d", *["%.9f"] * (len(COLUMNS) - 2)]
        np.savetxt(folder / f"{arm}.csv", np.column_stack(columns), formats, ",", header=",".join(COLUMNS), comments="")


def write_npz(trajectory: Trajectory, folder: Path) -> None:
    """Writes ``trajectory.npz``: the fields of ``Trajectory``, ``time`` and ``step``, and those of each arm's
    ``SetPoints`` as ``PSM1_position`` and the like."""
    told = {name: getattr(trajectory, name) for name in _facts()} | {"time": trajectory.time, "step": trajectory.step}
    for arm, points in trajectory.arms.items():
        told |= {f"{arm}_{field.name}": getattr(points, field.name) for field in fields(points)}
    np.savez_compressed(folder / NPZ_FILE, arms=list(trajectory.arms), **told)


def read_npz(path: str | Path) -> Trajectory:
    """Reads what ``write_npz`` wrote.

    Args:
        path: The file.

    Returns:
        The trajectory.

    Raises:
        ValueError: It is another kind of file.
        OSError: It cannot be read.
    """
    try:
        with np.load(path) as file:
            arms = {
                str(arm): SetPoints(**{field.name: file[f"{arm}_{field.name}"] for field in fields(SetPoints)})
                for arm in file["arms"]
            }
            facts = {name: file[name].item() if file[name].ndim == 0 else file[name] for name in _facts()}
    except (KeyError, ValueError, AttributeError, TypeError) as error:
        raise ValueError(f"{path} is no trajectory of `gcdt export-dvrk`: {error}.") from None
    return Trajectory(arms=arms, **facts)


def _facts() -> list[str]:
    return [field.name for field in fields(Trajectory) if field.name != "arms"]
