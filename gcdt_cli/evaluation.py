"""``gcdt evaluate``."""

import argparse
from pathlib import Path
from typing import Any

from gcdt_cli.options import BUILT_IN, add_sensors, check_folder, check_tasks, checkpoint_of, names, sensor_settings

EXAMPLE = "example: gcdt evaluate outputs/needle_pick --first_seed 100000 --starts 100"


def add(commands: Any) -> None:
    evaluate = commands.add_parser(
        "evaluate",
        help="evaluate trained policies from fresh starts; the episodes are kept beside their checkpoints",
        epilog=EXAMPLE,
    )
    evaluate.add_argument(
        "trainings",
        nargs="+",
        metavar="TRAINING",
        help="training, or pretrained_model folder in it; with --episodes a single one, a repository on the Hub, or "
        "generalist, which is built in",
    )
    evaluate.add_argument("--tasks", type=names, help="tasks, separated by commas (default: all that the policy knows)")
    evaluate.add_argument("--first_seed", type=int, default=100_000, help="seed of the first start (default 100000)")
    evaluate.add_argument("--starts", type=int, default=100, help="episodes of each task (default 100)")
    evaluate.add_argument(
        "--episodes", type=Path, metavar="FILE", help="keep the episodes in this Parquet file instead"
    )
    evaluate.add_argument("--film", action="store_true", help="also film the first three, beside the checkpoint")
    add_sensors(evaluate, "imperfect sensors and noisy actions, with --episodes", noisy_actions=True)
    evaluate.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    check_tasks(options.tasks or [])
    if options.starts < 1 or options.first_seed < 0:
        raise ValueError(
            f"An evaluation needs --starts from 1 on and a --first_seed from 0 on; got {options.starts} and "
            f"{options.first_seed}."
        )
    if options.episodes and options.episodes.suffix != ".parquet":
        raise ValueError(
            f"--episodes {options.episodes} is no FILE.parquet to keep the episodes in; --starts says how many there "
            "are."
        )
    if options.episodes and len(options.trainings) > 1:
        raise ValueError(f"--episodes keeps those of a single training, got {', '.join(options.trainings)}.")
    sensors = sensor_settings(options)
    if sensors and not options.episodes:
        raise ValueError(f"Episodes with imperfections ({', '.join(sensors)}) need a file of their own: --episodes.")
    for training in [] if options.episodes else options.trainings:
        if training == BUILT_IN and not Path(training).exists():
            raise ValueError(
                f"{training} has no folder that could keep its episodes; name a file: --episodes FILE.parquet."
            )
        check_folder(Path(training), f"`gcdt train --dataset DATASET --output {training}` trains a policy")

    from lerobot_gcdt.evaluation import describe, evaluate_checkpoint, load_policy
    from lerobot_gcdt.evaluation.pictures import film
    from lerobot_gcdt.evaluation.tasks import tasks_of
    from lerobot_gcdt.training import existing_checkpoint
    from surrol_gym.registry import find_task, task_name

    seeds = range(options.first_seed, options.first_seed + options.starts)
    if options.episodes:
        checkpoints = {training: checkpoint_of(training) for training in options.trainings}
    else:
        checkpoints = {training: existing_checkpoint(training) for training in options.trainings}
    tasks = {training: tasks_of(found, options.tasks) for training, found in checkpoints.items()}
    for training, found in checkpoints.items():
        episodes = evaluate_checkpoint(found, tasks[training], seeds, file=options.episodes, sensors=sensors)
        print(f"{training}\n{describe(episodes)}", flush=True)
        if options.film:
            policy = load_policy(found)
            for name, task in {task_name(find_task(task)): task for task in tasks[training]}.items():
                path = (options.episodes or found.resolve()).parent / f"{name}.mp4"
                film(policy, task, seeds[:3], path, sensors=sensors)
                print(f"The film is {path}.")
