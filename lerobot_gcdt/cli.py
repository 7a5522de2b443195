"""The console command ``gcdt``."""

import argparse
import sys


def main(arguments: list[str] | None = None) -> None:
    """Runs ``gcdt``; a bad argument ends with one line and exit status 2."""
    parser = argparse.ArgumentParser(prog="gcdt", description="Datasets of the SurRoL tasks.")
    commands = parser.add_subparsers(dest="command", required=True)
    record = commands.add_parser(
        "record",
        help="record demonstrations of a scripted expert as a LeRobot dataset",
        epilog="example: gcdt record --task NeedlePick --episodes 100 --seed 0 --root datasets/needle_pick",
    )
    record.add_argument("--task", required=True, help="name of the task, such as NeedlePick")
    record.add_argument("--episodes", type=int, default=100, help="successful episodes to keep (default 100)")
    record.add_argument("--seed", type=int, default=0, help="seed of the first episode (default 0)")
    record.add_argument("--root", required=True, help="folder of the dataset; an interrupted recording goes on there")
    record.add_argument("--repo-id", help="name of the dataset on the Hub (default local/<folder>)")
    options = parser.parse_args(arguments)

    from lerobot_gcdt import recording

    try:
        recording.record(options.task, options.episodes, options.seed, options.root, options.repo_id)
    except (ValueError, OSError) as error:
        sys.exit(f"gcdt record: {error}")
