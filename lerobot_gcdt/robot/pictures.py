"""What people look at: the paths of the tips with their times, and how near to the limits a trajectory comes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure  # without pyplot: the backend of a notebook or a script stays as it is
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from lerobot_gcdt.robot.limits import Limits
from lerobot_gcdt.robot.safety import Report, accelerations, distance_of_arms, height_of_tip, speeds
from lerobot_gcdt.robot.set_points import SetPoints, Trajectory
from surrol_gym.psm.arm import JAW_OPEN
from surrol_gym.psm.kinematics import JOINT_NAMES

ARM_COLORS = ("#24557a", "#c0562b")
BROKEN = "#c0392b"
LABELS = 5
"""Times that are written beside each path, at equal distances along it."""

FLATTEST = 0.5
"""Shortest axis of a drawn path, as a share of the longest."""

TITLE_LINES = 4
"""Broken limits that the picture names."""


def plot_trajectories(trajectories: Sequence[Trajectory], path: str | Path, columns: int = 3) -> Path:
    """Draws the paths of the jaw tips over the table, thick where the jaws are closed, with the time along them.

    Args:
        trajectories: The trajectories, a panel each.
        path: The PNG file to write.
        columns: Panels in a row.

    Returns:
        The path.
    """
    columns = min(columns, len(trajectories))
    rows = -(-len(trajectories) // columns)
    figure = Figure(figsize=(5 * columns, 4.4 * rows), layout="constrained")
    for number, trajectory in enumerate(trajectories, 1):
        axes: Any = figure.add_subplot(rows, columns, number, projection="3d")
        for color, points in zip(ARM_COLORS, trajectory.arms.values(), strict=False):
            _draw_path(axes, trajectory, points, color)
        axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
        axes.set_title(f"{trajectory.task}, {trajectory.source}, seed {trajectory.seed}", fontsize=10)
        axes.tick_params(labelsize=7)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_major_locator(MaxNLocator(4))
        _show_to_scale(axes)
        axes.view_init(25, -40)
    handles = [
        *(Line2D([], [], color=color, label=f"PSM{n}") for n, color in enumerate(ARM_COLORS, 1)),
        Line2D([], [], color="#555555", linewidth=3, label="jaws closed"),
        Line2D([], [], color="#555555", linewidth=1, label="jaws open"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(path, dpi=110)
    return Path(path)


def plot_safety(report: Report, path: str | Path) -> Path:
    """Draws how near a trajectory comes to its limits, a column an arm.

    Joints are drawn as shares of their range, -1 and 1 being the limits, speeds and accelerations as shares of what is
    allowed, so that what is beyond 1 is red.

    Args:
        report: The report.
        path: The PNG file to write.

    Returns:
        The path.
    """
    trajectory, limits = report.trajectory, report.limits
    arms = trajectory.arms
    figure = Figure(figsize=(max(8, 6.5 * len(arms)), 11), layout="constrained")
    all_axes = figure.subplots(5, len(arms), squeeze=False, sharex=True, sharey="row")
    for column, (arm, points) in zip(all_axes.T, arms.items(), strict=True):
        column[0].set_title(arm)
        _draw_shares(column, trajectory, points, limits)
        column[3].plot(trajectory.time, points.jaw, color="#333333")
        _draw_limits(column[3], limits.jaw)
        column[4].plot(trajectory.time, 1000 * height_of_tip(points), color="#333333", label="tip above the table")
        if len(arms) == 2:
            distance = 1000 * distance_of_arms(*arms.values())
            column[4].plot(trajectory.time, distance, color="#7d3c98", label="between the arms")
        column[4].set_xlabel("time (s)")
        bottom = min(-5, column[4].dataLim.y0 - 5)
        column[4].axhspan(bottom, 0, color=BROKEN, alpha=0.15, linewidth=0)
        column[4].set_ylim(bottom=bottom)
    names = ("joints, share of range", "speed, share of limit", "acceleration, share of limit", "jaws (rad)", "mm")
    for axes, name in zip(all_axes[:, 0], names, strict=True):
        axes.set_ylabel(name)
    all_axes[0, -1].legend(fontsize=7, ncols=3, loc="upper right")
    all_axes[4, -1].legend(fontsize=7, loc="upper right")
    verdict = [check.describe() for check in report.broken[:TITLE_LINES]] or ["no limit is broken"]
    title = "\n".join([f"{trajectory.task}, seed {trajectory.seed}, {trajectory.source}", *verdict])
    figure.suptitle(title, color=BROKEN if report.broken else "black", fontsize=10)
    figure.savefig(path, dpi=110)
    return Path(path)


def _draw_path(axes: Any, trajectory: Trajectory, points: SetPoints, color: str) -> None:
    tips = 1000 * points.in_frame(points.rcm)[0]
    closed = points.jaw < JAW_OPEN / 2
    switches = [0, *(np.flatnonzero(np.diff(closed)) + 1), len(closed) - 1]
    for start, end in zip(switches[:-1], switches[1:], strict=True):
        axes.plot(*tips[start : end + 1].T, color=color, linewidth=3 if closed[start] else 1, alpha=0.8)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tips, axis=0), axis=-1))])
    for index in np.searchsorted(along, np.linspace(0, along[-1], LABELS)):
        axes.scatter(*tips[index], color=color, s=14)
        axes.text(*tips[index], f" {trajectory.time[index]:.1f} s", fontsize=8, color=color)


def _show_to_scale(axes: Any) -> None:
    """Makes a millimetre as long on every axis, and no axis much shorter than the longest."""
    limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    length = np.ptp(limits, axis=1)
    missing = np.maximum(FLATTEST * length.max() - length, 0)[:, None]
    axes.set(**dict(zip(("xlim", "ylim", "zlim"), limits + missing * (-0.5, 0.5), strict=True)))
    axes.set_box_aspect(length + missing[:, 0], zoom=1.1)


def _draw_shares(column: Any, trajectory: Trajectory, points: SetPoints, limits: Limits) -> None:
    low, high = np.array(limits.joints).T
    shares = (
        (2 * points.joints - low - high) / (high - low),
        speeds(points.joints, trajectory.rate) / limits.velocity,
        accelerations(points.joints, trajectory.rate) / limits.acceleration,
    )
    jaw = (
        speeds(points.jaw, trajectory.rate) / limits.jaw_velocity,
        accelerations(points.jaw, trajectory.rate) / limits.jaw_acceleration,
    )
    for axes, values in zip(column, shares, strict=False):
        for name, share in zip(JOINT_NAMES, values.T, strict=True):
            axes.plot(trajectory.time, share, linewidth=1, label=name)
        _draw_limits(axes, (-1, 1))
    for axes, share in zip(column[1:], jaw, strict=False):
        axes.plot(trajectory.time, share, linewidth=1, color="#333333", label="jaw")


def _draw_limits(axes: Any, limits: tuple[float, float]) -> None:
    """Colours what is beyond limits, and shows at least a bit of it."""
    low, high = limits
    shown = 0.15 * (high - low)
    bottom, top = min(axes.dataLim.y0, low) - shown, max(axes.dataLim.y1, high) + shown
    axes.axhspan(bottom, low, color=BROKEN, alpha=0.15, linewidth=0)
    axes.axhspan(high, top, color=BROKEN, alpha=0.15, linewidth=0)
    axes.set_ylim(bottom, top)
