"""From nothing to a trained surgical policy in one command.

Records demonstrations of the scripted expert, trains GCDT on them with LeRobot's own trainer, evaluates the policy on
starts that it was neither trained nor selected on, and shows the result: a film, the training curve, and where the
needle ended. Every stage is skipped when its output is there, so the command can be interrupted and repeated.

    python examples/quickstart.py --output outputs/quickstart
"""

import argparse
import os
import time
from pathlib import Path

# Threads that wait busily for each other make a training on a machine that does other things up to 40 times as long.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # read when PyTorch is loaded

from lerobot_gcdt.evaluation import describe, evaluate_checkpoint, load_policy
from lerobot_gcdt.evaluation.pictures import film, plot_goals, plot_training
from lerobot_gcdt.recording import record
from lerobot_gcdt.training import loss_curve, train

FIRST_TEST_SEED = 100_000  # demonstrations count up from 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("outputs/quickstart"), help="folder of all results")
    parser.add_argument("--task", default="NeedlePick", help="name of the task (default NeedlePick)")
    parser.add_argument("--episodes", type=int, default=100, help="demonstrations (default 100)")
    parser.add_argument("--steps", type=int, default=2000, help="optimiser steps (default 2000)")
    parser.add_argument("--starts", type=int, default=100, help="episodes of the evaluation (default 100)")
    options = parser.parse_args()
    started = time.monotonic()

    dataset = record(options.task, options.episodes, seed=0, root=options.output / "dataset")
    training = options.output / "training"
    checkpoint = train(dataset, training, steps=options.steps, device="cpu")
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + options.starts)
    episodes = evaluate_checkpoint(checkpoint, [options.task], seeds)

    film_file, weights = options.output / "film.mp4", checkpoint / "model.safetensors"
    if not film_file.exists() or film_file.stat().st_mtime < weights.stat().st_mtime:
        unfinished = film_file.with_name("unfinished.mp4")
        film(load_policy(checkpoint), options.task, seeds[:3], unfinished)
        unfinished.replace(film_file)
    plot_training(loss_curve(training), options.output / "training_curve.png")
    plot_goals(episodes, options.output / "goals.png")

    print(f"\n{describe(episodes)}")
    print(f"Film, training_curve.png and goals.png are in {options.output}.")
    print(f"Everything took {(time.monotonic() - started) / 60:.1f} minutes.")


if __name__ == "__main__":
    main()
