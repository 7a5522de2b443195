"""What vectors hold: told by names or by the table of tasks, whatever LeRobot's tools did to the dataset."""

import json
import shutil

import pytest
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.dataset_tools import merge_datasets, split_dataset
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_gcdt.data.task_layouts import TaskLayout, task_layouts
from lerobot_gcdt.keys import STATE
from lerobot_gcdt.recording import record

PICK = "Pick up the needle and bring its middle to the goal."
REACH = "Move the closed jaw tips to the point above the needle."
BOTH = {PICK: TaskLayout([19, 3, 5]), REACH: TaskLayout([7, 3, 5])}


@pytest.fixture(scope="module")
def panel_root(tmp_path_factory):
    """Folder of a MatchBoardPanel dataset of one episode."""
    return record("MatchBoardPanel", 1, 0, tmp_path_factory.mktemp("datasets") / "panel")


def test_names_tell_the_layout_of_a_dataset_of_one_task(needle_pick_meta):
    assert task_layouts(needle_pick_meta) == {PICK: TaskLayout([19, 3, 5])}


def test_names_tell_where_an_observation_repeats_the_goal(panel_root):
    [layout] = task_layouts(LeRobotDatasetMetadata("local/panel", root=panel_root)).values()
    assert layout == TaskLayout([31, 6, 5], [25, 26, 27, 28, 29, 30])


def test_a_merged_dataset_has_the_layouts_of_its_tasks(uneven_meta):
    assert task_layouts(uneven_meta) == BOTH


def test_layouts_survive_lerobots_split_and_merge(uneven_root, tmp_path):
    whole = LeRobotDataset("local/uneven", root=uneven_root, video_backend="pyav")
    parts = split_dataset(whole, {"a": [0, 4], "b": [1]}, tmp_path / "split")
    assert not list((tmp_path / "split").rglob("surrol.json"))
    assert task_layouts(parts["a"].meta) == BOTH
    joined = merge_datasets(list(parts.values()), "local/joined", tmp_path / "joined")
    assert task_layouts(joined.meta) == BOTH


def changed(root, folder, change):
    """Metadata of a copy of a dataset whose description of the observation is changed."""
    root = shutil.copytree(root, folder / "changed")
    info = json.loads((root / "meta/info.json").read_text())
    change(info["features"][STATE])
    (root / "meta/info.json").write_text(json.dumps(info))
    return LeRobotDatasetMetadata("local/changed", root=root)


def test_padded_vectors_without_a_table_are_refused(uneven_root, tmp_path):
    meta = changed(uneven_root, tmp_path, lambda feature: feature.pop("info"))
    with pytest.raises(ValueError, match="padded.*no table of its tasks.*gcdt merge"):
        task_layouts(meta)


def test_a_table_that_lacks_a_task_is_refused(uneven_root, tmp_path):
    meta = changed(uneven_root, tmp_path, lambda feature: feature["info"]["tasks"].pop(REACH))
    with pytest.raises(ValueError, match="lacks .*Move the closed jaw tips"):
        task_layouts(meta)
