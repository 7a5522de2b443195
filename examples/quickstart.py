"""From nothing to a trained surgical policy in one command.

Records demonstrations of the scripted expert, trains GCDT on them with LeRobot's own trainer, evaluates the policy on
starts that it was neither trained nor selected on, and shows the result: a film, the training curve, and where the
needle ended. Every stage is skipped when its output is there, so the command can be interrupted and repeated.

    python examples/quickstart.py --output outputs/quickstart
"""

import argparse
import csv
import logging
import os
import sys
import time
from pathlib import Path

# Threads that wait busily for each other make a training on a machine that does other things up to 40 times as long.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # read when PyTorch is loaded

import pandas as pd
from lerobot.scripts import lerobot_train
from lerobot.utils.logging_utils import MetricsTracker

from lerobot_gcdt.evaluation import describe, evaluate, load_policy
from lerobot_gcdt.evaluation.pictures import film, plot_goals, plot_training
from lerobot_gcdt.recording import record
from lerobot_gcdt.training import arguments_to_reach, checkpoint

FIRST_TEST_SEED = 100_000  # demonstrations count up from 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("outputs/quickstart"), help="folder of all results")
    parser.add_argument("--task", default="NeedlePick", help="name of the task (default NeedlePick)")
    parser.add_argument("--episodes", type=int, default=100, help="demonstrations (default 100)")
    parser.add_argument("--steps", type=int, default=1000, help="optimiser steps (default 1000)")
    parser.add_argument("--starts", type=int, default=100, help="episodes of the evaluation (default 100)")
    options = parser.parse_args()
    started = time.monotonic()

    dataset = record(options.task, options.episodes, seed=0, root=options.output / "dataset")
    train(dataset, options.output / "training", options.output / "training.csv", options.steps)
    policy = load_policy(checkpoint(options.output / "training"))
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + options.starts)

    episodes_file = options.output / "episodes.parquet"
    if not episodes_file.exists():
        evaluate(policy, [options.task], seeds).to_parquet(episodes_file)
    episodes = pd.read_parquet(episodes_file)

    film_file = options.output / "film.mp4"
    if not film_file.exists():
        film(policy, options.task, seeds[:3], film_file)
    # A run that was interrupted repeats the steps after its last checkpoint.
    curve = pd.read_csv(options.output / "training.csv").drop_duplicates("step", keep="last").sort_values("step")
    plot_training(curve, options.output / "training_curve.png")
    plot_goals(episodes, options.output / "goals.png")

    print(f"\n{describe(episodes)}")
    print(f"Film, training_curve.png and goals.png are in {options.output}.")
    print(f"Everything took {(time.monotonic() - started) / 60:.1f} minutes.")


def train(dataset: Path, output: Path, curve: Path, steps: int):
    """Runs `lerobot-train`, or goes on with it from its last checkpoint."""
    beginning = [
        "--policy.type=gcdt",
        "--policy.device=cpu",
        "--policy.push_to_hub=false",
        "--dataset.repo_id=local/dataset",
        f"--dataset.root={dataset}",
        "--batch_size=4",
        "--save_freq=500",
        f"--log_freq={max(1, steps // 80)}",
        "--num_workers=0",
    ]
    arguments = arguments_to_reach(steps, output, beginning)
    if arguments is None:
        return
    if "--resume=true" not in arguments:
        curve.unlink(missing_ok=True)
    print("lerobot-train \\\n  " + " \\\n  ".join(arguments))

    def keep_curve(message: logging.LogRecord) -> bool:
        if isinstance(message.msg, MetricsTracker):
            row = message.msg.to_dict()
            is_new = not curve.exists()
            with curve.open("a", newline="") as stream:
                writer = csv.writer(stream)
                if is_new:
                    writer.writerow(["step", "loss"])
                writer.writerow([row["steps"], row["loss"]])
        return True

    logging.getLogger().addFilter(keep_curve)
    sys.argv = ["lerobot-train", *arguments]
    lerobot_train.main()
    logging.getLogger().removeFilter(keep_curve)


if __name__ == "__main__":
    main()
