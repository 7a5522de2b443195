"""What `lerobot-train` has to be called with to begin, or to go on with, a training."""

import shutil
from collections.abc import Sequence
from pathlib import Path


def arguments_to_reach(steps: int, output: Path, beginning: Sequence[str]) -> list[str] | None:
    """Returns arguments of `lerobot-train` that bring a training to its last step.

    Args:
        steps: Optimiser steps of the whole training.
        output: Its output folder.
        beginning: Arguments that begin it, without the steps and the output folder.

    Returns:
        The arguments, or None where nothing is left to do. A folder without a checkpoint is removed.
    """
    last = output / "checkpoints/last"
    if not last.exists():
        shutil.rmtree(output, ignore_errors=True)  # an earlier run ended before its first checkpoint
        return [*beginning, f"--steps={steps}", f"--output_dir={output}"]
    if int(last.resolve().name) >= steps:
        return None
    return [f"--config_path={last}/pretrained_model/train_config.json", "--resume=true", f"--steps={steps}"]


def checkpoint(output: Path) -> Path:
    """Returns the folder of a training's last checkpoint, for ``from_pretrained`` and `--policy.path`."""
    return output / "checkpoints/last/pretrained_model"
