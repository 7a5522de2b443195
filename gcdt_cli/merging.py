"""``gcdt merge``."""

import argparse
import json
from typing import Any

from gcdt_cli.options import check_root

EXAMPLE = "example: gcdt merge datasets/needle_pick datasets/peg_transfer --root datasets/surrol_cross_task"


def add(commands: Any) -> None:
    merge = commands.add_parser(
        "merge", help="merge the datasets of several tasks into one for cross-task training", epilog=EXAMPLE
    )
    merge.add_argument("datasets", nargs="+", help="folders of datasets that `gcdt record` or `gcdt import` wrote")
    merge.add_argument("--root", required=True, help="folder of the merged dataset")
    merge.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    check_root(options.root)

    from lerobot_gcdt.recording import merge

    facts = json.loads((merge(options.datasets, options.root) / "meta/info.json").read_text())
    tasks = facts["total_tasks"]
    print(f"{options.root}: {facts['total_episodes']} episodes of {tasks} task{'s' if tasks > 1 else ''}")
