"""Columns of a whole dataset as arrays; LeRobot itself reads row by row."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd


def read_columns(root: str | Path, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Reads columns of a dataset from its data files.

    Args:
        root: Folder of the dataset.
        names: Names of the columns.

    Returns:
        Arrays of shape (frames,), or (frames, size) of vectors.

    Raises:
        FileNotFoundError: There are no data files.
    """
    files = sorted(Path(root).glob("data/*/*.parquet"))
    if not files:
        raise FileNotFoundError(f"There are no data files under {Path(root) / 'data'}; download the whole dataset.")
    table = pd.concat([pd.read_parquet(file, columns=list(names)) for file in files])
    columns = {name: table[name].to_numpy() for name in names}
    return {name: np.stack(values) if values.dtype == object else values for name, values in columns.items()}
