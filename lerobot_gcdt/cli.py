"""The console command ``gcdt``."""

import argparse
import sys

from lerobot_gcdt.merging import merge as merge_datasets
from lerobot_gcdt.recording import record as record_dataset

RECORD_EXAMPLE = "example: gcdt record --task NeedlePick --episodes 100 --seed 0 --root datasets/needle_pick"
MERGE_EXAMPLE = "example: gcdt merge datasets/needle_pick datasets/peg_transfer --root datasets/surrol_cross_task"


def main(arguments: list[str] | None = None) -> None:
    """Runs ``gcdt``; a bad argument ends with one line and an exit status other than 0."""
    parser = argparse.ArgumentParser(prog="gcdt", description="Datasets of the SurRoL tasks.", epilog=RECORD_EXAMPLE)
    commands = parser.add_subparsers(dest="command", required=True)
    record = commands.add_parser(
        "record",
        help="record demonstrations of a scripted expert as a LeRobot dataset",
        epilog=RECORD_EXAMPLE,
    )
    record.add_argument("--task", required=True, help="name of the task, such as NeedlePick")
    record.add_argument("--episodes", type=int, default=100, help="successful episodes to keep (default 100)")
    record.add_argument("--seed", type=int, default=0, help="seed of the first episode (default 0)")
    record.add_argument("--root", required=True, help="folder of the dataset; an interrupted recording goes on there")
    record.add_argument(
        "--disturb",
        type=float,
        default=0.0,
        metavar="LEVEL",
        help="push the arm now and then, by up to LEVEL of a full action; the expert corrects (default 0)",
    )
    merge = commands.add_parser(
        "merge", help="merge the datasets of several tasks into one for cross-task training", epilog=MERGE_EXAMPLE
    )
    merge.add_argument("datasets", nargs="+", help="folders of datasets that `gcdt record` wrote")
    merge.add_argument("--root", required=True, help="folder of the merged dataset")
    options = parser.parse_args(arguments)

    try:
        if options.command == "record":
            record_dataset(options.task, options.episodes, options.seed, options.root, options.disturb)
        else:
            merge_datasets(options.datasets, options.root)
    except (ValueError, OSError) as error:
        sys.exit(f"gcdt {options.command}: {error}")
