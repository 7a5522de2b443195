"""``gcdt train``."""

import argparse
from pathlib import Path
from typing import Any

from gcdt_cli.options import BUILT_IN, check_folder, checkpoint_of

EXAMPLE = "example: gcdt train --dataset datasets/surrol_needle_pick --output outputs/needle_pick"


def add(commands: Any) -> None:
    train = commands.add_parser(
        "train",
        help="train a policy with lerobot-train, or go on where that was interrupted",
        epilog=EXAMPLE,
    )
    train.add_argument("--dataset", required=True, type=Path, help="folder of a dataset")
    train.add_argument("--output", required=True, type=Path, help="folder of the checkpoints and the losses")
    train.add_argument(
        "--policy", metavar="TYPE", help="gcdt (default), bc, dt, vinn, iql, plas, or a type of LeRobot's, such as act"
    )
    train.add_argument(
        "--stage",
        choices=("pretrain", "generalist", "finetune", "scratch"),
        help="pretrain: all objectives, on many tasks; generalist: then the actions alone; finetune: then one task "
        "(default with --start); scratch: from random weights (default without)",
    )
    train.add_argument(
        "--start", help="what to begin with: a training, folder of a checkpoint, or generalist, which is built in"
    )
    train.add_argument("--steps", type=int, help="optimiser steps (default: what the stage needs, where it is known)")
    train.add_argument("--device", help="where to train, such as cpu or cuda (default: LeRobot chooses)")
    train.add_argument(
        "--launcher", help="command that runs a module, such as 'accelerate launch --num_processes=4 -m'"
    )
    train.add_argument("options", nargs="*", metavar="-- OPTION", help="more arguments of lerobot-train, after --")
    train.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    check_folder(options.dataset, f"`gcdt record --task TASK --root {options.dataset}` records a dataset")
    if options.start and options.start != BUILT_IN:
        check_folder(Path(options.start), f"`gcdt train --dataset DATASET --output {options.start}` trains a policy")

    from lerobot_gcdt.training import train

    options.start = checkpoint_of(options.start) if options.start else None
    train(**{name: value for name, value in vars(options).items() if name not in ("command", "run")})
