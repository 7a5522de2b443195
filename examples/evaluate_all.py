"""Evaluates trainings of any policy on fresh starts; training needs no simulator, so this is a step of its own.

    python examples/evaluate_all.py outputs/all/pretrain                      # a generalist, on all tasks it knows
    python examples/evaluate_all.py outputs/all/NeedlePick outputs/all/PegTransfer --tasks NeedlePick,PegTransfer

GCDT and BC are evaluated on each of the chosen tasks that they know, by default all of these; other policies, which do
not say what they know, on all tasks that are chosen. The episodes are kept in `episodes.parquet` beside
the checkpoint; a checkpoint that has been evaluated on these seeds is not evaluated again.
"""

import argparse
from pathlib import Path

import pandas as pd
from lerobot.configs.policies import PreTrainedConfig

import surrol_gym
from lerobot_gcdt.environment.surrol_env import env_class
from lerobot_gcdt.evaluation import describe, evaluate, load_policy
from lerobot_gcdt.training import checkpoint


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trainings", nargs="+", type=Path, help="output folders of lerobot-train")
    parser.add_argument("--tasks", help="tasks, separated by commas (default: all that the policy knows)")
    parser.add_argument("--first_seed", type=int, default=100_000)
    parser.add_argument("--starts", type=int, default=100)
    options = parser.parse_args()
    chosen = options.tasks.split(",") if options.tasks else None
    unknown = sorted(set(chosen or ()) - set(surrol_gym.TASKS))
    if unknown:
        parser.error(f"unknown tasks {unknown}; choose from {', '.join(surrol_gym.TASKS)}")
    tasks = {}
    for training in options.trainings:
        if not checkpoint(training).exists():
            parser.error(f"{training} holds no checkpoint of lerobot-train")
        config = PreTrainedConfig.from_pretrained(checkpoint(training))
        known = known_tasks(config) or chosen
        if known is None:
            parser.error(
                f"{training} holds a policy of type {config.type}, which does not say what it knows; add --tasks"
            )
        tasks[training] = [task for task in chosen or known if task in known]
    seeds = range(options.first_seed, options.first_seed + options.starts)
    for training in options.trainings:
        kept = checkpoint(training).resolve().parent / "episodes.parquet"
        done = pd.read_parquet(kept) if kept.exists() else pd.DataFrame(columns=["task", "seed"])
        policy = load_policy(checkpoint(training))
        for task in tasks[training]:
            if not set(seeds) <= set(done.seed[done.task == task]):
                episodes = evaluate(policy, [task], seeds)
                done = episodes if done.empty else pd.concat([done[done.task != task], episodes])
                done.to_parquet(kept)
        print(f"{training}\n{describe(done)}", flush=True)


def known_tasks(config: PreTrainedConfig) -> list[str] | None:
    """Returns the tasks that a policy was trained on; None where its type does not tell."""
    sentences = {env_class(f"surrol/{task}-v0").task_description: task for task in surrol_gym.TASKS}
    known = getattr(config, "task_dims", None)
    return known and [sentences[sentence] for sentence in known if sentence in sentences]


if __name__ == "__main__":
    main()
