"""The manifest: episodes recorded again hold the same bytes, and a difference is found."""

import json
import shutil

import gymnasium as gym
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import surrol_gym
from lerobot_gcdt.recording import record
from lerobot_gcdt.recording.collection import dataset_name
from lerobot_gcdt.recording.episodes import run_episode
from lerobot_gcdt.recording.features import to_columns
from lerobot_gcdt.recording.manifest import (
    HASHED,
    MANIFEST,
    differing_episodes,
    episode_hash,
    episode_hashes,
    write_manifest,
)


@pytest.fixture(scope="module")
def reach_root(tmp_path_factory):
    """Folder with the beginning of a published dataset: two episodes."""
    return record("NeedleReach", 2, 0, tmp_path_factory.mktemp("manifest") / "surrol_needle_reach", 0.3)


@pytest.fixture
def copy_of_reach(reach_root, tmp_path):
    """A dataset that a test may damage."""
    return shutil.copytree(reach_root, tmp_path / reach_root.name)


@pytest.mark.parametrize("task", surrol_gym.TASKS)
def test_episodes_of_the_published_datasets_come_out_byte_for_byte(task):
    published = json.loads(MANIFEST.read_text())[dataset_name(task)]
    assert published["env_id"] == f"surrol/{task}-v0"
    assert published["episodes"] == len(published["sha256_by_seed"]) == 100
    env = gym.make(published["env_id"])
    for seed in list(published["sha256_by_seed"])[:2]:
        columns = to_columns(run_episode(env, int(seed), published["disturb"]))
        assert episode_hash(columns) == published["sha256_by_seed"][seed]
    env.close()


def test_a_stored_episode_has_the_hash_of_the_recorded_one(reach_root):
    env = gym.make("surrol/NeedleReach-v0")
    assert episode_hashes(reach_root) == [episode_hash(to_columns(run_episode(env, seed, 0.3))) for seed in (0, 1)]
    env.close()


@pytest.mark.parametrize("key", HASHED)
def test_a_hash_covers_every_number(key):
    columns = {name: np.zeros((50, 3), dtype=np.float32) for name in HASHED}
    before = episode_hash(columns)
    columns[key][49, 2] = 1
    assert episode_hash(columns) != before


def test_the_beginning_of_a_published_dataset_matches(reach_root):
    assert differing_episodes(reach_root) == []


def test_an_episode_that_differs_is_found(copy_of_reach):
    file = copy_of_reach / "data/chunk-000/file-000.parquet"
    table = pq.read_table(file)
    rewards = table["next.reward"].to_numpy().copy()
    rewards[50] = 0
    changed = table.set_column(table.column_names.index("next.reward"), "next.reward", pa.array(rewards))
    pq.write_table(changed, file)
    assert differing_episodes(copy_of_reach) == [1]


def test_an_episode_from_another_seed_is_found(copy_of_reach, tmp_path):
    write_manifest([copy_of_reach], tmp_path / "manifest.json")
    note = copy_of_reach / "meta/surrol.json"
    note.write_text(json.dumps(json.loads(note.read_text()) | {"seeds": [0, 2]}))
    assert differing_episodes(copy_of_reach, tmp_path / "manifest.json") == [1]


@pytest.mark.parametrize("setting", [{"disturb": 0.0}, {"seed": 7}, {"episodes": 200}], ids=str)
def test_another_recording_is_not_compared(copy_of_reach, setting):
    note = copy_of_reach / "meta/surrol.json"
    note.write_text(json.dumps(json.loads(note.read_text()) | setting))
    assert differing_episodes(copy_of_reach) is None


def test_a_dataset_of_another_name_is_not_compared(copy_of_reach):
    assert differing_episodes(copy_of_reach.rename(copy_of_reach.with_name("mine"))) is None


def test_a_written_manifest_matches_its_datasets(reach_root, tmp_path):
    write_manifest([reach_root], tmp_path / "manifest.json")
    assert differing_episodes(reach_root, tmp_path / "manifest.json") == []
