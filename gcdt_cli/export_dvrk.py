"""``gcdt export-dvrk``."""

import argparse
from pathlib import Path
from typing import Any

from gcdt_cli.options import check_tasks, checkpoint_of

EXAMPLE = "example: gcdt export-dvrk --policy expert --task PegTransfer --seed 3 --out outputs/peg_transfer_dvrk"


def add(commands: Any) -> None:
    export = commands.add_parser(
        "export-dvrk",
        help="export an episode as set-points of a da Vinci Research Kit, with a safety report",
        epilog=f"{EXAMPLE}; no real robot was ever moved with this: read docs/dvrk.md first",
    )
    export.add_argument(
        "--policy",
        required=True,
        metavar="TRAINING",
        help="who acts: expert, a training, a pretrained_model folder, a repository on the Hub, or generalist, which "
        "is built in",
    )
    export.add_argument("--task", required=True, help="name of the task, such as PegTransfer or my_module:MyTask")
    export.add_argument("--seed", type=int, default=0, help="seed of the episode (default 0)")
    export.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="folder of the set-points and the report"
    )
    export.add_argument("--rate", type=float, default=200.0, help="set-points a second (default 200)")
    export.add_argument(
        "--base-frame", type=Path, metavar="FILE", help="measured poses of the RCMs, JSON (default: the simulator's)"
    )
    export.add_argument("--bag", action="store_true", help="also write a ROS 2 bag (mcap), which needs the extra dvrk")
    export.add_argument("--allow_unsafe", action="store_true", help="write a trajectory that breaks limits, too")
    export.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    check_tasks([options.task])

    from lerobot_gcdt.robot.export import export

    policy = None
    if options.policy != "expert":
        from lerobot_gcdt.evaluation import load_policy
        from lerobot_gcdt.evaluation.tasks import tasks_of

        checkpoint = checkpoint_of(options.policy)
        tasks_of(checkpoint, [options.task])
        policy = load_policy(checkpoint)
    asked = {name: getattr(options, name) for name in ("rate", "base_frame", "bag", "allow_unsafe")}
    report = export(options.task, options.seed, options.out, policy, options.policy, **asked)
    print(f"{report.summary()}\nThe set-points and the report are in {options.out}.")
