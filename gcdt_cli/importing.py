"""``gcdt import``."""

import argparse
from typing import Any

from gcdt_cli.options import check_root, check_tasks

EXAMPLE = "example: gcdt import data_NeedlePickRL-v0_random_200.npz --task NeedlePick --root datasets/imported"


def add(commands: Any) -> None:
    importing = commands.add_parser(
        "import",
        help="import demonstrations of SurRoL or DEX, or plain arrays, as a LeRobot dataset",
        epilog=f"{EXAMPLE}; for N episodes of T steps, archives of SurRoL hold acs (N, T, A) and obs, N times "
        "T + 1 dictionaries of observation, achieved_goal and desired_goal; plain arrays are called actions (N, T, A), "
        "observations (N, T + 1, O), desired_goals and achieved_goals (N, T + 1, G)",
    )
    importing.add_argument(
        "files", nargs="+", metavar="FILE", help="archives (.npz) of SurRoL or DEX, or of plain arrays"
    )
    importing.add_argument("--task", required=True, help="name of the task, such as NeedlePick")
    importing.add_argument("--root", required=True, help="folder of the dataset")
    importing.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    check_tasks([options.task])
    check_root(options.root)

    from lerobot_gcdt.recording import import_demonstrations

    import_demonstrations(options.files, options.task, options.root)
