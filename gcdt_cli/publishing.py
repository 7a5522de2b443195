"""``gcdt publish``."""

import argparse
from typing import Any

EXAMPLE = "example: gcdt publish datasets/surrol_needle_pick --repo_id user/surrol_needle_pick --dry_run"


def add(commands: Any) -> None:
    publish = commands.add_parser(
        "publish", help="publish a dataset or a trained policy, with its card, on the Hub", epilog=EXAMPLE
    )
    publish.add_argument(
        "folder", help="a dataset of `gcdt record`, `import` or `merge`, or an output folder of lerobot-train"
    )
    publish.add_argument("--repo_id", required=True, metavar="USER/NAME", help="repository to publish it as")
    publish.add_argument("--private", action="store_true", help="make a new repository private")
    publish.add_argument("--revision_tag", metavar="TAG", help="name that this state keeps for ever, such as v1.0")
    publish.add_argument("--dry_run", action="store_true", help="only show what would be sent")
    publish.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    from lerobot_gcdt.hub.publish import publish

    publish(options.folder, options.repo_id, options.private, options.revision_tag, options.dry_run)
