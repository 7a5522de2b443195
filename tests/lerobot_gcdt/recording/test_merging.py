"""Merging: padded vectors, natural sizes in the metadata, nothing lost, bad input refused."""

import importlib.util
import json
import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.data.task_layouts import TaskLayout, task_layouts
from lerobot_gcdt.keys import ACTION, GOAL, KEPT, PADDED, STATE
from lerobot_gcdt.recording import merge, record
from lerobot_gcdt.recording.facts import RECORDING_FILE
from lerobot_gcdt.recording.features import Extras

PICK = "Pick up the needle and bring its middle to the goal."
REACH = "Move the closed jaw tips to the point above the needle."


def columns(root):
    return read_columns(root, pq.read_schema(next(root.glob("data/*/*.parquet"))).names)


def test_vectors_have_the_size_of_the_largest_task(uneven_meta):
    assert [uneven_meta.features[key]["shape"] for key in PADDED] == [(19,), (3,), (3,), (3,), (5,), (5,)]


def test_datasets_of_one_task_are_not_padded(needle_reach_root, tmp_path):
    merged = columns(merge([needle_reach_root, record("NeedleReach", 1, 9, tmp_path / "more")], tmp_path / "both"))
    assert merged[STATE].shape == (250, 7) and np.array_equal(merged[STATE][:200], columns(needle_reach_root)[STATE])


def test_the_metadata_keeps_what_it_takes_to_replay_every_episode(uneven_root, needle_pick_root):
    facts = json.loads((uneven_root / RECORDING_FILE).read_text())["merged_from"]
    assert facts[0] == json.loads((needle_pick_root / RECORDING_FILE).read_text())
    assert [part["env_id"] for part in facts] == ["surrol/NeedlePick-v0", "surrol/NeedleReach-v0"]


def test_values_are_those_of_the_sources_and_zeros(uneven_root, needle_pick_root):
    merged, source = columns(uneven_root), columns(needle_pick_root)
    frames = len(source["index"])
    for key in PADDED:
        natural = source[key].shape[1]
        assert np.array_equal(merged[key][:frames, :natural], source[key])
        assert (merged[key][:frames, natural:] == 0).all()
    for key in KEPT:
        assert np.array_equal(merged[key][:frames], source[key])


def test_lerobot_loads_the_result_with_its_sentences(uneven_root):
    dataset = LeRobotDataset("local/uneven", root=uneven_root, video_backend="pyav")
    assert (dataset.num_episodes, dataset.num_frames) == (5, 250)
    assert dataset[0]["task"] == PICK and dataset[249]["task"] == REACH
    assert dataset[0][STATE].shape == (19,) and dataset[0][ACTION].shape == (5,)


def test_an_interrupted_merge_goes_on_and_ends_the_same(uneven_root, needle_pick_root, tmp_path, monkeypatch):
    import lerobot_gcdt.recording.merging as merging

    reach = next(root for root in uneven_root.parent.iterdir() if root.name == "one_reach")

    def fail(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(merging, "aggregate_datasets", fail)
        with pytest.raises(KeyboardInterrupt):
            merge([needle_pick_root, reach], tmp_path / "uneven")
    assert not (tmp_path / "uneven").exists()
    merge([needle_pick_root, reach], tmp_path / "uneven")
    again, once = columns(tmp_path / "uneven"), columns(uneven_root)
    assert all(np.array_equal(again[key], once[key]) for key in once)
    assert [path.name for path in tmp_path.iterdir()] == ["uneven"]


def test_no_decoder_of_films_is_missed(needle_pick_root, needle_reach_root, tmp_path, monkeypatch, caplog):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "torchcodec" else find_spec(name))
    merge([needle_pick_root, needle_reach_root], tmp_path / "merged")
    assert "torchcodec" not in caplog.text


def without(root, column, copy):
    """Copies a dataset but for one column."""
    shutil.copytree(root, copy)
    info = json.loads((copy / "meta/info.json").read_text())
    del info["features"][column]
    (copy / "meta/info.json").write_text(json.dumps(info))
    for file in copy.glob("data/*/*.parquet"):
        pq.write_table(pq.read_table(file).drop_columns([column]), file)
    return copy


def test_what_was_added_to_the_actions_is_merged(needle_pick_root, tmp_path):
    pushed = record("NeedleReach", 2, 0, tmp_path / "reach", 0.3)
    merged = columns(merge([needle_pick_root, pushed], tmp_path / "merged"))["disturbance"]
    assert not merged[:200].any()
    assert np.array_equal(merged[200:, :5], columns(pushed)["disturbance"])


def test_a_column_that_every_merged_dataset_needs_is_missed_by_name(needle_pick_root, needle_reach_root, tmp_path):
    broken = without(needle_reach_root, "observation.achieved_goal", tmp_path / "broken")
    with pytest.raises(ValueError, match="observation.achieved_goal"):
        merge([needle_pick_root, broken], tmp_path / "merged")
    assert not (tmp_path / "merged").exists()


def test_films_and_further_numbers_are_left_out_and_named(needle_reach_root, tmp_path, capsys):
    rich = record("NeedlePick", 1, 0, tmp_path / "rich", extras=Extras(["openh"], ["overview"], 32))
    capsys.readouterr()
    merged = columns(merge([rich, needle_reach_root], tmp_path / "merged"))
    assert merged.keys() == {*PADDED, *KEPT, "timestamp", "frame_index", "episode_index", "index", "task_index"}
    printed = capsys.readouterr().out
    assert f"observation.cartesian_state, observation.images.overview of {rich}" in printed
    assert str(needle_reach_root) not in printed


def test_copies_of_an_interrupted_merge_are_made_again_when_the_dataset_was_recorded_again(
    needle_pick_root, tmp_path, monkeypatch
):
    def fail(*_):
        raise KeyboardInterrupt

    reach = record("NeedleReach", 1, 0, tmp_path / "reach")
    with monkeypatch.context() as patch:
        patch.setattr("lerobot_gcdt.recording.merging.aggregate_datasets", fail)
        with pytest.raises(KeyboardInterrupt):
            merge([needle_pick_root, reach], tmp_path / "merged")
    shutil.rmtree(reach)
    record("NeedleReach", 1, 5, reach)
    merged = columns(merge([needle_pick_root, reach], tmp_path / "merged"))
    assert np.array_equal(merged[STATE][200:, :7], columns(reach)[STATE])


def test_datasets_may_have_the_names_of_what_a_merge_writes(needle_pick_root, needle_reach_root, tmp_path):
    named = {"lock": needle_pick_root, "merged": needle_reach_root}
    for name, root in named.items():
        (tmp_path / name).symlink_to(root)
    merged = columns(merge([tmp_path / name for name in named], tmp_path / "both"))
    assert np.array_equal(merged[STATE][200:, :7], columns(needle_reach_root)[STATE])
    assert {path.name for path in tmp_path.iterdir()} == {*named, "both"}


def changed(root, copy, change):
    """Copies a dataset and changes the description of its features."""
    shutil.copytree(root, copy)
    info = json.loads((copy / "meta/info.json").read_text())
    change(info["features"])
    (copy / "meta/info.json").write_text(json.dumps(info))
    return copy


def test_a_task_of_two_layouts_is_named_before_anything_is_written(needle_reach_root, tmp_path):
    def rename(features):
        features[STATE]["names"][0] = features[GOAL]["names"][0]
        features[ACTION]["shape"] = [4]

    other = changed(needle_reach_root, tmp_path / "other", rename)
    with pytest.raises(ValueError, match=f"'{REACH}' has other numbers in .*other .*7, 3, 4.*7, 3, 5.*Leave it out"):
        merge([needle_reach_root, other], tmp_path / "merged")
    assert [path.name for path in tmp_path.iterdir()] == ["other"]


def test_one_dataset_is_not_enough(needle_pick_root, tmp_path):
    with pytest.raises(ValueError, match="two or more"):
        merge([needle_pick_root], tmp_path / "merged")


def test_a_folder_that_was_not_recorded_is_named(needle_pick_root, tmp_path):
    (tmp_path / "photos").mkdir()
    with pytest.raises(ValueError, match="photos"):
        merge([needle_pick_root, tmp_path / "photos"], tmp_path / "merged")


def test_an_existing_folder_is_not_overwritten(needle_pick_root, uneven_root, needle_reach_root):
    with pytest.raises(ValueError, match="exists"):
        merge([needle_pick_root, needle_reach_root], uneven_root)


def test_a_second_merge_into_the_same_folder_is_refused(needle_pick_root, needle_reach_root, tmp_path, at_work):
    at_work(tmp_path / "merged.merging")
    with pytest.raises(OSError, match="another `gcdt` command is at work in .*merged.merging"):
        merge([needle_pick_root, needle_reach_root], tmp_path / "merged")
    assert not (tmp_path / "merged").exists()


def test_metadata_without_a_note_counts_its_own_sizes(needle_reach_meta, tmp_path):
    meta = LeRobotDatasetMetadata("local/needle_reach", root=needle_reach_meta.root)
    meta.root = tmp_path
    assert task_layouts(meta) == {REACH: TaskLayout([7, 3, 5])}
