"""LeRobot's trainer, with its losses in a file; also what a launcher runs, in one process or several:

accelerate launch --num_processes=4 -m lerobot_gcdt.training.trainer LOSS_FILE ARGUMENTS_OF_LEROBOT_TRAIN
"""

import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from lerobot.scripts import lerobot_train
from lerobot.utils.logging_utils import MetricsTracker


def run(arguments: Sequence[str], losses: Path) -> None:
    """Runs `lerobot-train` in this process.

    Args:
        arguments: Of `lerobot-train`.
        losses: File that a row is added to whenever LeRobot logs; only one of several processes does.
    """

    def keep_loss(message: logging.LogRecord) -> bool:
        if isinstance(message.msg, MetricsTracker):
            row = message.msg.to_dict()
            losses.parent.mkdir(parents=True, exist_ok=True)
            header = "" if losses.exists() else "step,loss\n"
            with losses.open("a") as stream:
                stream.write(f"{header}{row['steps']},{row['loss']}\n")
        return True

    logger, before = logging.getLogger(), sys.argv
    logger.addFilter(keep_loss)
    sys.argv = ["lerobot-train", *arguments]  # LeRobot reads parts of its configuration from here alone
    try:
        lerobot_train.main()
    finally:
        sys.argv = before
        logger.removeFilter(keep_loss)


if __name__ == "__main__":
    run(sys.argv[2:], Path(sys.argv[1]))
