"""Draws how well a policy knows how many steps it still needs, while it acts.

    python examples/time_to_goal.py

A panel a task: over the steps that an episode really needed from a moment on, what the policy predicted at that moment,
its median and the middle 80 %. Episodes without success are left out, and moments after it.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from lerobot_gcdt import GENERALIST
from lerobot_gcdt.evaluation import load_policy
from lerobot_gcdt.evaluation.loading import ProcessedPolicy
from lerobot_gcdt.evaluation.rollout import rollout
from lerobot_gcdt.evaluation.tasks import tasks_of


class Asked:
    """A policy that is asked at every step how many it still needs; ``told`` holds the answers, arrays (B,)."""

    def __init__(self, policy: ProcessedPolicy):
        self.policy = policy

    def reset(self) -> None:
        self.policy.reset()
        self.told: list[np.ndarray] = []

    def select_action(self, batch: dict) -> Any:
        action = self.policy.select_action(batch)
        self.told.append(self.policy.policy.predict_time_to_goal().cpu().numpy())
        return action


def predictions(policy: ProcessedPolicy, task: str, seeds: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Lets a policy act and asks it at every step.

    Args:
        policy: A GCDT policy that is not told its time-to-goal.
        task: Name of the task.
        seeds: Seeds of the starts.

    Returns:
        The steps that were left to the first success, and those that the policy predicted; arrays over the moments
        before success, of all episodes that succeeded.
    """
    asked = Asked(policy)
    success, _ = rollout(asked, task, seeds)
    first = np.where(success.any(0), success.argmax(0), -1)
    left = 1 + first - np.arange(len(success))[:, None]
    before = left > 0
    return left[before], np.stack(asked.told)[before]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", default=str(GENERALIST), help="folder or repository of a checkpoint")
    parser.add_argument("--tasks", help="tasks, separated by commas (default: all that the policy knows)")
    parser.add_argument("--starts", type=int, default=50, help="how many (default 50, from seed 20000 on)")
    parser.add_argument("--output", type=Path, default=Path("outputs/time_to_goal.png"), help="the picture")
    options = parser.parse_args()
    policy, tasks = load_policy(options.policy), tasks_of(options.policy, options.tasks and options.tasks.split(","))
    columns = min(len(tasks), 5)
    rows = -(-len(tasks) // columns)
    figure = Figure(figsize=(2.6 * columns + 0.6, 2.6 * rows + 0.4), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).flat
    seeds = list(range(20_000, 20_000 + options.starts))
    for task, axes in zip(tqdm(tasks, unit="task"), panels, strict=False):
        left, told = predictions(policy, task, seeds)
        if not len(left):
            print(f"{task}: no episode succeeded")
            axes.set_axis_off()
            continue
        error, spread = np.abs(told - left).mean(), np.abs(left - left.mean()).mean()
        print(f"{task}: {error:.1f} steps off on average; always to say the mean would be {spread:.1f} off")
        steps = np.unique(left)
        low, middle, high = np.transpose([np.quantile(told[left == step], (0.1, 0.5, 0.9)) for step in steps])
        axes.fill_between(steps, low, high, color="#24557a", alpha=0.25, linewidth=0)
        axes.plot(steps, middle, color="#24557a")
        axes.plot([0, steps.max()], [0, steps.max()], color="0.4", linestyle="--", linewidth=1)
        axes.set_title(f"{task}, {error:.1f} off", fontsize=9)
    for axes in panels:  # left over
        axes.set_axis_off()
    figure.supxlabel("steps left to the first success", fontsize=10)
    figure.supylabel("predicted", fontsize=10)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output, dpi=110)
    print(f"The picture is {options.output}.")


if __name__ == "__main__":
    main()
