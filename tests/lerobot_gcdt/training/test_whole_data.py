"""A dataset is whole where its files are there and hold as many rows as its description says."""

import shutil

import pyarrow.parquet as pq
import pytest

from lerobot_gcdt.training.whole_data import check_whole


def test_frames_are_not_read(needle_pick_root, tmp_path):
    shutil.copytree(needle_pick_root, dataset := tmp_path / "needle_pick")
    file = next(dataset.glob("data/*/*.parquet"))
    content = file.read_bytes()
    file.write_bytes(content[:4] + bytes(1000) + content[1004:])
    with pytest.raises(OSError):
        pq.read_table(file)
    check_whole(dataset)
