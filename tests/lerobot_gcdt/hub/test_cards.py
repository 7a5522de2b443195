"""The cards: the committed ones are up to date, and what a card says of a dataset is what the dataset holds."""

import dataclasses
import json
import re
import runpy
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from huggingface_hub import DatasetCard

import surrol_gym
from lerobot_gcdt.data.task_layouts import task_layouts
from lerobot_gcdt.hub.card_tables import number_tables
from lerobot_gcdt.hub.cards import card, dataset_card
from lerobot_gcdt.hub.checks import check_card
from lerobot_gcdt.recording import record
from lerobot_gcdt.recording.facts import card_facts
from lerobot_gcdt.recording.features import Extras
from lerobot_gcdt.recording.manifest import write_manifest
from surrol_gym.registry import env_class as env_class_of

ROOT = Path(__file__).parents[3]
SCRIPT = runpy.run_path(str(ROOT / "examples/write_cards.py"))
PUBLISHED = SCRIPT["cards"]()


@pytest.fixture(params=surrol_gym.TASKS)
def env_class(request):
    """Each task."""
    return env_class_of(request.param)


@pytest.fixture(scope="module")
def rich_root(tmp_path_factory):
    """Folder of a disturbed NeedleRegrasp dataset of two episodes with everything that can be asked for."""
    extras = Extras(["openh"], ["overview"], 32)
    return record("NeedleRegrasp", 2, 0, tmp_path_factory.mktemp("rich") / "needle_regrasp", 0.3, extras)


@pytest.fixture(params=["needle_pick_root", "needle_reach_root", "rich_root"])
def root(request):
    """Each of the recorded datasets."""
    return request.getfixturevalue(request.param)


def rows(text: str, heading: str) -> list[list[str]]:
    """The cells of the table below a heading, without its titles."""
    lines = [line for line in text.split(f"{heading}\n", 1)[1].split("\n#")[0].splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line[1:-1].split("|")] for line in lines[2:]]


def read_json(file: Path) -> dict:
    return json.loads(file.read_text())


# The committed cards.


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_committed_card_is_what_the_script_writes(name):
    assert (ROOT / "dataset_cards" / name).read_text() == PUBLISHED[name], "python examples/write_cards.py"


def test_there_is_a_card_for_each_published_dataset_and_no_other():
    assert len(PUBLISHED) == len(surrol_gym.TASKS) + 2, "the merged one and the index"
    assert {file.name for file in (ROOT / "dataset_cards").glob("*.md")} == set(PUBLISHED)


@pytest.mark.parametrize("name", PUBLISHED)
def test_what_a_committed_card_links_to_is_there(name):
    links = re.findall(r"\]\((?!https:)(.+?)\)", PUBLISHED[name])
    assert links
    assert all((ROOT / "dataset_cards" / link).is_file() for link in links)


@pytest.mark.parametrize("name", sorted(set(PUBLISHED) - {"README.md"}))
def test_the_front_matter_says_what_the_hub_asks_for(name):
    check_card(PUBLISHED[name], "dataset")
    data = DatasetCard(PUBLISHED[name]).data
    assert data.license == "apache-2.0"
    assert {"LeRobot", "surgical-robotics", "surrol", "dvrk"} <= set(data.tags)
    assert data.size_categories == ["1K<n<10K" if " 5,000 frames" in PUBLISHED[name] else "10K<n<100K"]


# What the docstrings say.


def test_a_card_names_every_number_of_a_task_with_its_unit(env_class):
    text = number_tables(env_class, {}, "###")
    states = rows(text, "### `observation.state`")
    assert [row[1] for row in states] == [f"`{name}`" for name in env_class.observation_names]
    units = [unit for quantity in env_class.observation_quantities for unit in [quantity.unit] * len(quantity.names)]
    assert [row[3] for row in states] == units
    effects = [row[3] for row in rows(text, "### `action` and `disturbance`")]
    assert effects[:3] == ["0.05 su (10 mm)"] * 3


def test_what_a_task_says_of_its_numbers_is_in_the_card(needle_reach_root, monkeypatch):
    before = dataset_card(needle_reach_root)
    first, *others = env_class_of("NeedleReach").observation_quantities
    changed = (dataclasses.replace(first, meaning="somewhere"), *others)
    monkeypatch.setattr(env_class_of("NeedleReach"), "observation_quantities", changed)
    assert dataset_card(needle_reach_root) == before.replace("position of link 5", "somewhere") != before


def test_a_changed_docstring_changes_the_card(needle_reach_root, monkeypatch):
    before = dataset_card(needle_reach_root)
    env_class = env_class_of("NeedleReach")
    monkeypatch.setattr(env_class, "__doc__", env_class.__doc__.replace("padded tray", "cushion"))
    assert dataset_card(needle_reach_root) == before.replace("padded tray", "cushion") != before


# What a card says of a dataset.


def test_every_number_is_named_once_and_in_order(root):
    features, text = read_json(root / "meta/info.json")["features"], dataset_card(root)
    for key, heading in (
        ("observation.state", "### `observation.state`"),
        ("observation.goal", "### `observation.achieved_goal` and `observation.goal`"),
        ("action", "### `action` and `disturbance`"),
    ):
        assert [row[:2] for row in rows(text, heading)] == [
            [str(i), f"`{name}`"] for i, name in enumerate(features[key]["names"])
        ]


def test_statistics_are_those_of_the_frames(root):
    frames, text = pq.read_table(root / "data"), dataset_card(root)
    for heading, *keys in (
        ("### `observation.state`", "observation.state"),
        ("### `observation.achieved_goal` and `observation.goal`", "observation.achieved_goal", "observation.goal"),
        ("### `action` and `disturbance`", "action", "disturbance"),
    ):
        columns = [np.stack(frames[key].to_numpy()) for key in keys]
        true = np.concatenate([[column.min(0), column.mean(0), column.max(0)] for column in columns]).T
        shown = [[float(cell) for cell in row[-3 * len(keys) :]] for row in rows(text, heading)]
        np.testing.assert_allclose(shown, true, atol=6e-4)


def test_every_column_is_mentioned(root):
    text = dataset_card(root)
    assert all(f"`{key}`" in text for key in read_json(root / "meta/info.json")["features"])


def test_what_was_recorded_on_request_is_described_number_by_number(rich_root):
    features, text = read_json(rich_root / "meta/info.json")["features"], dataset_card(rich_root)
    assert all(f"`{name}`" in text for name in features["observation.cartesian_state"]["names"])
    assert "--fields openh --cameras overview --camera_size 32 " in text


def test_the_command_and_the_success_rate_are_those_of_the_recording(rich_root):
    facts, text = read_json(rich_root / "meta/surrol.json"), dataset_card(rich_root)
    assert "gcdt record --task NeedleRegrasp --episodes 2 --seed 0 --disturb 0.3 " in text
    assert f"2 of {facts['attempts']} (" in text and f"the seeds 0 to {facts['attempts'] - 1}" in text
    steps = facts["steps_to_success"]
    assert f"{np.mean(steps):.1f} on average, {min(steps)} to {max(steps)}" in text


def test_failed_attempts_are_told_among_the_limits(needle_reach_root):
    facts = card_facts(needle_reach_root)
    assert "failed and are not in the data" not in card(facts, "me/reach", "pictures")
    assert "60 % of the attempts failed" in " ".join(card(facts | {"attempts": 10}, "me/reach", "pictures").split())


def test_the_worst_of_several_recordings_of_one_task_is_told(needle_reach_root):
    part = card_facts(needle_reach_root)
    text = card({"merged_from": [part | {"attempts": 10}, part | {"seed": 50}]}, "me/thing", "pictures")
    assert "60 % of the attempts at NeedleReach failed" in " ".join(text.split())


def test_imperfect_sensors_are_told_where_there_were_any(needle_reach_root):
    facts = card_facts(needle_reach_root)
    assert "sensors" not in card(facts, "me/reach", "pictures")
    noisy = facts | {"sensors": {"position_std": 0.01, "angle_std": 0.0, "dropout": 0.0, "delay": 2}}
    for whole in (noisy, {"merged_from": [facts, noisy]}):
        told = " ".join(card(whole, "me/reach", "pictures").split())
        assert "--disturb 0.0 --position_std 0.01 --delay 2 --root" in told
        assert "4 episodes of NeedleReach are what imperfect sensors showed" in told
        assert ": position_std = 0.01, delay = 2." in told


def test_pushes_are_told_where_there_were_any(needle_reach_root, rich_root):
    assert "was pushed" in dataset_card(rich_root) and "in 20 % of the steps, by up to 0.3 of" in (
        " ".join(dataset_card(rich_root).split())
    )
    assert "was pushed" not in dataset_card(needle_reach_root)


def test_a_policy_that_acted_is_told_where_there_was_one(needle_reach_root):
    facts = card_facts(needle_reach_root)
    assert "policy `" not in card(facts, "user/reach", "pictures")
    told = " ".join(card(facts | {"policy": "outputs/my reach", "mix": 0.25}, "user/reach", "pictures").split())
    assert "--policy 'outputs/my reach' --mix 0.25 --root" in told
    assert "the policy `outputs/my reach` acted" in told and "probability 0.25" in told
    assert "Nothing diverts the expert" not in told


def test_loading_is_shown_by_the_repository_id(root):
    assert 'LeRobotDataset("me/thing")' in dataset_card(root, "me/thing")
    assert f'LeRobotDataset("user/{root.name}")' in dataset_card(root)


def test_the_hub_takes_the_card_of_any_dataset(root):
    check_card(dataset_card(root), "dataset")


# Merged datasets.


def test_a_merged_dataset_is_described_task_by_task(uneven_root, uneven_meta):
    text = dataset_card(uneven_root)
    check_card(text, "dataset")
    for sentence, layout in task_layouts(uneven_meta).items():
        assert f"| {sentence} | {', '.join(map(str, layout.sizes))} |" in text
    assert "padded with zeros, to 19 in `observation.state`, 3 in" in " ".join(text.split())
    assert "gcdt merge" in text and text.count("gcdt record --task") == 2
    for task, numbers in (("NeedlePick", 19), ("NeedleReach", 7)):
        assert len(rows(text.split(f"### {task}\n")[1], "#### `observation.state`")) == numbers


def test_recordings_of_one_task_are_made_in_folders_of_their_own(needle_reach_root):
    part = card_facts(needle_reach_root)
    learned = part | {"policy": "outputs/reach", "mix": 0.0}
    text = card({"merged_from": [part, learned]}, "me/thing", "pictures")
    assert "--root datasets/surrol_needle_reach\n" in text and "--root datasets/surrol_needle_reach_1\n" in text
    assert "In 4 episodes of NeedleReach the policy `outputs/reach`" in " ".join(text.split())


def test_a_merger_of_mergers_is_described_by_its_recordings(uneven_root):
    facts = card_facts(uneven_root)
    assert card({"merged_from": [facts]}, "me/thing", "pictures") == card(facts, "me/thing", "pictures")


# The two ways to a card.


def test_the_manifest_gives_the_same_card_as_the_data(root, tmp_path):
    write_manifest([root], tmp_path / "manifest.json")
    facts = read_json(tmp_path / "manifest.json")[root.name]
    assert card(facts, f"user/{root.name}", "pictures") == dataset_card(root)


def test_the_manifests_of_its_parts_give_the_same_card_as_the_merged_data(needle_pick_root, uneven_root, tmp_path):
    reach = record("NeedleReach", 1, 0, tmp_path / "one_reach")
    write_manifest([needle_pick_root, reach], tmp_path / "manifest.json")
    facts = {"merged_from": list(read_json(tmp_path / "manifest.json").values())}
    assert card(facts, "user/uneven", "pictures") == dataset_card(uneven_root)
