"""What lies where in the output folder of a training."""

from pathlib import Path

import numpy as np
import pandas as pd

LOSS_FILE = "loss.csv"
"""In the output folder: columns ``step``; ``loss``, the mean since the row before; and ``seconds`` since the beginning,
CPU time of the process where it trains on the CPU, wall time on another device, which earlier versions left out."""


def trainer_folder(output: str | Path) -> Path:
    """Returns the folder that the process that trains locks (``lerobot_gcdt.locking.alone_in``)."""
    there = Path(output).resolve()
    return there.with_name(f"{there.name}.trainer")


def checkpoint(folder: str | Path) -> Path:
    """Returns the folder of a training's last checkpoint, for ``from_pretrained`` and `--policy.path`.

    Args:
        folder: Output folder of a training. Any other folder is returned as it is, as the checkpoint itself.
    """
    last = Path(folder) / "checkpoints/last/pretrained_model"
    return last if last.exists() else Path(folder)


def existing_checkpoint(folder: str | Path) -> Path:
    """Returns what ``checkpoint`` does, if there is one.

    Raises:
        FileNotFoundError: There is none.
    """
    found = checkpoint(folder)
    if not (found / "config.json").exists():
        raise FileNotFoundError(
            f"{folder} holds no checkpoint; `gcdt train --dataset DATASET --output {folder}` trains one."
        )
    return found


def loss_curve(output: str | Path) -> pd.DataFrame:
    """Reads the losses of a training.

    Args:
        output: Its output folder.

    Returns:
        The columns of ``LOSS_FILE``, each step once: a training that was interrupted has repeated some.
    """
    losses = pd.read_csv(Path(output) / LOSS_FILE)
    return losses.drop_duplicates("step", keep="last").sort_values("step", ignore_index=True)


def training_seconds(output: str | Path, step: int) -> float:
    """Returns what a training took up to a step, seconds as in ``LOSS_FILE``.

    Preparations, steps that an interruption lost, and what it began with (``--start``) do not count.

    Args:
        output: Its output folder.
        step: The step; between two rows of the file the seconds are interpolated.

    Returns:
        The seconds, NaN where the training was begun without keeping them.
    """
    if not (Path(output) / LOSS_FILE).exists():
        return np.nan
    curve = loss_curve(output)
    if "seconds" not in curve:
        return np.nan
    return float(np.interp(step, [0, *curve.step], [0.0, *curve.seconds]))
