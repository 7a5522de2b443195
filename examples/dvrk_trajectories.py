"""Draws what the paper's six tasks ask of a da Vinci Research Kit: the paths of the tips, with their times.

    python examples/dvrk_trajectories.py
    python examples/dvrk_trajectories.py --policy generalist --seed 5

A time is that of the exported set-points, in which jaws open and close no faster than those of the robot may.
"""

import argparse
from pathlib import Path

from tqdm import tqdm

from lerobot_gcdt import GENERALIST
from lerobot_gcdt.evaluation import load_policy
from lerobot_gcdt.robot.episodes import play
from lerobot_gcdt.robot.pictures import plot_trajectories
from lerobot_gcdt.robot.set_points import interpolate

TASKS = ("NeedlePick", "GauzeRetrieve", "PegTransfer", "NeedleRegrasp", "BiPegTransfer", "BiPegBoard")


def main(arguments: list[str] | None = None) -> None:
    """Plays an episode of each task and draws its set-points."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--policy", default="expert", help="expert (default), generalist, or a checkpoint")
    parser.add_argument("--tasks", type=lambda text: text.split(","), default=TASKS, help="tasks, separated by commas")
    parser.add_argument("--seed", type=int, default=3, help="seed of the episodes (default 3)")
    parser.add_argument("--output", type=Path, default=Path("outputs/dvrk_trajectories.png"), help="the picture")
    options = parser.parse_args(arguments)
    policy = None
    if options.policy != "expert":
        policy = load_policy(GENERALIST if options.policy == "generalist" else options.policy)
    tasks = tqdm(options.tasks, desc="Playing", unit="task")
    trajectories = [interpolate(play(task, options.seed, policy, options.policy)) for task in tasks]
    options.output.parent.mkdir(parents=True, exist_ok=True)
    print(f"The picture is {plot_trajectories(trajectories, options.output)}.")


if __name__ == "__main__":
    main()
