"""From an episode to a folder that a da Vinci Research Kit can play, with its safety report (docs/dvrk.md)."""

import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lerobot_gcdt.robot.bag import check_rosbags, write_bag
from lerobot_gcdt.robot.base_frame import arm_names, read_placement
from lerobot_gcdt.robot.episodes import play
from lerobot_gcdt.robot.files import write_csv, write_npz
from lerobot_gcdt.robot.pictures import plot_safety, plot_trajectories
from lerobot_gcdt.robot.safety import Report, check
from lerobot_gcdt.robot.set_points import Trajectory, interpolate
from surrol_gym.registry import env_class

REPORT_FILES = ("safety.txt", "safety.json", "safety.png")
"""What an export writes even if it refuses to write a trajectory."""


def export(
    task: str,
    seed: int,
    out: str | Path,
    policy: Any = None,
    source: str = "expert",
    rate: float = 200.0,
    base_frame: str | Path | None = None,
    bag: bool = False,
    allow_unsafe: bool = False,
) -> Report:
    """Plays an episode and writes its set-points, the safety report, and pictures of both.

    Args:
        task: Name of the task; see ``surrol_gym.find_task``.
        seed: Seed of the episode.
        out: The folder to write; where it exists, it holds at most the report of an export that was refused.
        policy: As ``lerobot_gcdt.evaluation.evaluate`` takes it; None for the scripted expert.
        source: What the files say of who acted.
        rate: Set-points a second.
        base_frame: File of measured transforms; see ``lerobot_gcdt.robot.base_frame.read_placement``.
        bag: Whether to write a ROS 2 bag, too.
        allow_unsafe: Whether to write a trajectory that breaks a limit.

    Returns:
        The safety report.

    Raises:
        ValueError: An argument is bad, or the trajectory breaks a limit; then the report is in the folder.
        OSError: A file cannot be read or written.
        RuntimeError: A bag was asked for, and rosbags is not installed.
    """
    out = Path(out)
    _check_free(out)
    if bag:
        check_rosbags()
    placement = read_placement(base_frame, arm_names(len(env_class(task).mounts))) if base_frame else None
    trajectory = interpolate(play(task, seed, policy, source), placement, rate)
    report = check(trajectory)
    out.mkdir(parents=True, exist_ok=True)
    (out / "safety.txt").write_text(report.text())
    (out / "safety.json").write_text(report.json())
    plot_safety(report, out / "safety.png")
    if report.broken and not allow_unsafe:
        raise ValueError(
            f"The trajectory is not written, because it breaks {len(report.broken)} of {len(report.checks)} limits: "
            f"{report.broken[0].describe()}. {out / 'safety.txt'} tells all; --allow_unsafe writes it nevertheless."
        )
    with TemporaryDirectory(prefix=".unfinished-", dir=out) as unfinished:
        _write(trajectory, Path(unfinished), bag)
        for file in Path(unfinished).iterdir():
            os.replace(file, out / file.name)
    return report


def _check_free(out: Path) -> None:
    """Raises ValueError for a folder that holds something else, FileExistsError for a file."""
    if out.exists() and not out.is_dir():
        raise FileExistsError(f"{out} is a file; choose another --out.")
    if out.exists() and (others := sorted({path.name for path in out.iterdir()} - set(REPORT_FILES))):
        raise ValueError(f"{out} holds {', '.join(others[:3])} already; choose another --out.")


def _write(trajectory: Trajectory, folder: Path, bag: bool) -> None:
    write_csv(trajectory, folder)
    write_npz(trajectory, folder)
    plot_trajectories([trajectory], folder / "trajectory.png")
    if bag:
        write_bag(trajectory, folder / "bag")
