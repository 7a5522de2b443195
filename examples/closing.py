"""Shows what makes a policy close its jaws in NeedlePick: what it sees, or how much time has passed.

    python examples/closing.py

From every start the policy acts twice: at once, and after it was made to wait. A policy that goes by what it sees
closes later by as much, and where the needle is; one that goes by the clock closes at the same step, wherever the jaws
then are.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from lerobot_gcdt import GENERALIST
from lerobot_gcdt.evaluation import load_policy
from lerobot_gcdt.evaluation.rollout import rollout
from lerobot_gcdt.keys import ACHIEVED_GOAL, GOAL, STATE
from surrol_gym.tasks.needle_pick import NeedlePickEnv

TASK, JAW = "NeedlePick", 4
READ_FROM = {"observation": STATE, "achieved_goal": ACHIEVED_GOAL, "desired_goal": GOAL}
WAIT = np.array([0.0, 0.0, 0.0, 0.0, 1.0], dtype=np.float32)
"""No motion, jaws open."""


class Waiting:
    """A policy that waits before it acts, and keeps what it saw and did, arrays (B, size) of every step."""

    def __init__(self, policy: Any, steps: int):
        self.policy, self.steps = policy, steps

    def reset(self) -> None:
        self.policy.reset()
        self.seen: list[dict[str, np.ndarray]] = []
        self.actions: list[np.ndarray] = []

    def select_action(self, batch: dict) -> Any:
        action = self.policy.select_action(batch)
        if len(self.actions) < self.steps:
            action = action.new_tensor(WAIT).expand_as(action)
        self.seen.append({name: batch[key].cpu().numpy() for name, key in READ_FROM.items()})
        self.actions.append(action.cpu().numpy())
        return action


def closing(waiting: Waiting) -> tuple[np.ndarray, np.ndarray]:
    """Returns the step at which each episode first closes the jaws, and how far from the needle, sideways, su.

    NaN where it never does.
    """
    jaw = np.stack(waiting.actions)[:, :, JAW]
    opened = np.cumsum(jaw > 0, axis=0) > 0  # jaws are closed at the start
    closes = opened & (jaw < 0)
    step = closes.argmax(0)
    # Of each episode what it saw then, numbers first, as a reading takes them.
    at_step = {name: np.stack([waiting.seen[t][name][i] for i, t in enumerate(step)], -1) for name in READ_FROM}
    seen = NeedlePickEnv.read(at_step)
    away = np.hypot(*(seen.middle - seen.psm1)[:2])
    never = ~closes.any(0)
    return np.where(never, np.nan, step), np.where(never, np.nan, away)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", default=str(GENERALIST), help="folder or repository of a checkpoint")
    parser.add_argument("--starts", type=int, default=100, help="how many (default 100, from seed 20000 on)")
    parser.add_argument("--wait", type=int, default=10, help="steps to wait (default 10)")
    parser.add_argument("--output", type=Path, default=Path("outputs/closing.png"), help="the picture")
    options = parser.parse_args()
    policy = load_policy(options.policy)
    found = []
    for wait in (0, options.wait):
        waiting = Waiting(policy, wait)
        rollout(waiting, TASK, list(range(20_000, 20_000 + options.starts)))
        found.append(closing(waiting))
    (at_once, near), (later, near_later) = found
    delay = np.nanmedian(later - at_once)
    print(f"Made to wait {options.wait} steps, the policy closes its jaws {delay:.0f} steps later (median).")
    print(f"Sideways from the needle: {np.nanmedian(near):.4f} su at once, {np.nanmedian(near_later):.4f} su later.")
    figure = Figure(figsize=(9, 4), layout="constrained")
    steps, distances = figure.subplots(1, 2)
    ends = np.array([np.nanmin(at_once), np.nanmax(at_once)])
    steps.plot(ends, ends + options.wait, color="#1a7f5a", label="by what it sees")
    steps.plot(ends, ends, color="#c0392b", linestyle="--", label="by the clock")
    steps.scatter(at_once, later, s=12, color="#24557a")
    steps.set(xlabel="step of the first closing", ylabel=f"the same, made to wait {options.wait} steps", title=TASK)
    steps.legend()
    for (step, away), label in zip(found, ("at once", f"after {options.wait} steps"), strict=True):
        distances.scatter(step, away, s=12, label=label)
    distances.set(xlabel="step of the first closing", ylabel="sideways from the needle then (su)", ylim=(0, None))
    distances.legend()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(options.output, dpi=110)
    print(f"The picture is {options.output}.")


if __name__ == "__main__":
    main()
