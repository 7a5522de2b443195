"""Evaluates trainings of GCDT and BC on fresh starts; training needs no simulator, so this is a step of its own.

    python examples/evaluate_all.py outputs/all/pretrain                      # a generalist, on all tasks it knows
    python examples/evaluate_all.py outputs/all/NeedlePick outputs/all/PegTransfer --tasks NeedlePick,PegTransfer

Every policy is evaluated on each of the chosen tasks that it knows. The episodes are kept in `episodes.parquet` beside
the checkpoint; a checkpoint that has been evaluated on these seeds is not evaluated again.
"""

import argparse
from pathlib import Path

import pandas as pd
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class

import lerobot_gcdt  # noqa: F401 (registers the policies)
import surrol_gym
from lerobot_gcdt.evaluation import describe, evaluate
from lerobot_gcdt.surrol_env import env_class
from lerobot_gcdt.training import checkpoint


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trainings", nargs="+", type=Path, help="output folders of lerobot-train")
    parser.add_argument("--tasks", default=",".join(surrol_gym.TASKS), help="tasks, separated by commas")
    parser.add_argument("--first_seed", type=int, default=100_000)
    parser.add_argument("--starts", type=int, default=100)
    options = parser.parse_args()
    for training in options.trainings:
        if not checkpoint(training).exists():
            parser.error(f"{training} holds no checkpoint of lerobot-train")
    seeds = range(options.first_seed, options.first_seed + options.starts)
    for training in options.trainings:
        kept = checkpoint(training).resolve().parent / "episodes.parquet"
        done = pd.read_parquet(kept) if kept.exists() else pd.DataFrame(columns=["task", "seed"])
        policy = load(checkpoint(training))
        for task in options.tasks.split(","):
            if knows(policy, task) and not set(seeds) <= set(done.seed[done.task == task]):
                episodes = evaluate(policy, [task], seeds)
                done = episodes if done.empty else pd.concat([done[done.task != task], episodes])
                done.to_parquet(kept)
        print(f"{training}\n{describe(done)}", flush=True)


def load(folder: Path):
    """Loads a policy of any type, for inference."""
    config = PreTrainedConfig.from_pretrained(folder)
    policy = get_policy_class(config.type).from_pretrained(folder, config=config)
    return policy.eval()


def knows(policy, task: str) -> bool:
    """Whether a policy was trained on a task."""
    return env_class(f"surrol/{task}-v0").task_description in policy.config.task_dims


if __name__ == "__main__":
    main()
