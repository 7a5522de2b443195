"""Episodes are written as LeRobot writes them, without its search for pictures where there can be none."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from lerobot.datasets import dataset_writer
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_gcdt.recording import writing

VECTOR = {"state": {"dtype": "float32", "shape": (3,), "names": ["x", "y", "z"]}}
PICTURE = {"picture": {"dtype": "image", "shape": (8, 8, 3), "names": ["height", "width", "channels"]}}


@pytest.fixture
def written(tmp_path):
    """Writes an episode of four frames by some function; returns its table."""

    def write(save, name, features=VECTOR):
        dataset = LeRobotDataset.create(f"local/{name}", 5, features, root=tmp_path / name, use_videos=False)
        for i in range(4):
            frame = {"state": np.full(3, i, np.float32), "picture": np.full((8, 8, 3), i, np.uint8)}
            dataset.add_frame({key: frame[key] for key in features} | {"task": "Reach."})
        save(dataset)
        dataset.finalize()
        return pq.read_table(next((tmp_path / name).glob("data/*/*.parquet")))

    return write


@pytest.fixture
def searches(monkeypatch):
    """The searches for pictures that were made."""
    made, search = [], dataset_writer.embed_images

    def watched(rows):
        made.append(len(rows))
        return search(rows)

    monkeypatch.setattr(dataset_writer, writing.EMBED, watched)
    return made


def test_the_table_is_lerobots(written):
    theirs = written(lambda dataset: dataset.save_episode(), "theirs")
    ours = written(writing.save_episode, "ours")
    assert ours.equals(theirs)
    told, expected = (json.loads(table.schema.metadata[b"huggingface"])["info"] for table in (ours, theirs))
    assert told == expected


def test_rows_without_pictures_are_not_searched(written, searches):
    written(writing.save_episode, "ours")
    assert searches == []
    written(lambda dataset: dataset.save_episode(), "theirs")  # the search is back, and still LeRobot's way
    assert searches == [4]


def test_pictures_inside_rows_are_still_found(written, searches):
    table = written(writing.save_episode, "ours", VECTOR | PICTURE)
    assert searches == [4]
    assert all(picture["bytes"] for picture in table["picture"].to_pylist())


def test_a_lerobot_without_that_search_writes_as_well(written, monkeypatch):
    monkeypatch.setattr(writing, "EMBED", "gone")
    assert written(writing.save_episode, "ours").num_rows == 4


def test_statistics_of_constants_are_exact_and_others_are_left(tmp_path):
    (tmp_path / "meta").mkdir()
    file = tmp_path / "meta/stats.json"
    file.write_text(
        json.dumps({"b": {"min": [3.4354, 0.0], "max": [3.4354, 1.0], "mean": [3.4353971, 0.25], "std": [0.006, 0.3]}})
    )
    writing.tidy_statistics(tmp_path)
    tidied = json.loads(file.read_text())
    assert tidied == {"b": {"max": [3.4354, 1.0], "mean": [3.4354, 0.25], "min": [3.4354, 0.0], "std": [0.0, 0.3]}}
    assert [*tidied["b"]] == ["max", "mean", "min", "std"]


def test_what_never_changes_in_a_recording_is_normalised_to_zero(needle_reach_root):
    statistics = json.loads((needle_reach_root / "meta/stats.json").read_text())
    least, most, mean, std = (statistics["observation.state"][name][3] for name in ("min", "max", "mean", "std"))
    assert least == most == mean
    assert std == 0
