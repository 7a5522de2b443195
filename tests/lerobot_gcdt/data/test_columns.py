"""Columns are read whole, in the order of the frames."""

import numpy as np
import pytest
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.keys import STATE, SUCCESS


def test_scalars_and_vectors_are_those_that_lerobot_gives(uneven_root):
    columns = read_columns(uneven_root, [STATE, SUCCESS, "index"])
    dataset = LeRobotDataset("local/uneven", root=uneven_root, video_backend="pyav")
    assert columns["index"].tolist() == list(range(len(dataset)))
    for i in (0, 57, len(dataset) - 1):
        np.testing.assert_array_equal(columns[STATE][i], dataset[i][STATE])
        assert columns[SUCCESS][i] == dataset[i][SUCCESS]
    assert columns[STATE].dtype == np.float32


def test_a_dataset_without_files_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=str(tmp_path)):
        read_columns(tmp_path, ["index"])
