"""What lies where in the output folder of a training."""

from pathlib import Path

import pandas as pd

LOSS_FILE = "loss.csv"
"""In the output folder: columns ``step`` and ``loss``, the mean since the row before."""


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
        Columns ``step`` and ``loss``, each step once: a training that was interrupted has repeated some.
    """
    losses = pd.read_csv(Path(output) / LOSS_FILE)
    return losses.drop_duplicates("step", keep="last").sort_values("step", ignore_index=True)
