"""The card of a policy: success with intervals, data, command and commit, read from the checkpoint's folder."""

import json
import re
import subprocess
from pathlib import Path

import pandas as pd
import pytest
from huggingface_hub import ModelCard
from lerobot.configs.default import DatasetConfig
from lerobot.configs.train import TrainPipelineConfig

from lerobot_gcdt import BCPolicy
from lerobot_gcdt.evaluation.statistics import wilson_interval
from lerobot_gcdt.hub.model_card import model_card

REACH = "Move the closed jaw tips to the point above the needle."
PICK = "Pick up the needle and bring its middle to the goal."


@pytest.fixture
def policy(tiny_config):
    """Configuration of a policy of NeedleReach."""
    tiny_config.task_dims = {REACH: [7, 3, 5]}
    return tiny_config


@pytest.fixture
def save(tmp_path):
    """Saves the configurations of a checkpoint, all that a card reads of it; returns its folder."""

    def save(policy, data, step=40, output="output", **options):
        folder = tmp_path / output / "checkpoints" / f"{step:06}" / "pretrained_model"
        folder.mkdir(parents=True)
        policy._save_pretrained(folder)
        data = DatasetConfig(video_backend="pyav", **data)
        TrainPipelineConfig(dataset=data, policy=policy, **options)._save_pretrained(folder)
        return folder

    return save


@pytest.fixture
def checkpoint(save, policy, needle_reach_root):
    """Folder of a checkpoint of a training from scratch."""
    return save(policy, {"repo_id": "local/needle_reach", "root": str(needle_reach_root)}, steps=40, batch_size=16)


@pytest.fixture
def evaluated(checkpoint):
    """The same, evaluated on 20 starts of which 18 reach the goal and 17 hold it."""
    held = [True] * 17 + [False] * 3
    rows = {"task": "NeedleReach", "seed": range(100, 120), "reached": [True] * 18 + [False] * 2, "held": held}
    pd.DataFrame(rows).to_parquet(checkpoint.parent / "episodes.parquet")
    return checkpoint


def command(card: str) -> str:
    """The training command of a card, on one line."""
    return " ".join(card[card.index("lerobot-train") : card.index("This card was written")].replace("\\\n", "").split())


def test_the_front_matter_says_what_the_hub_asks_for(checkpoint):
    data = ModelCard(model_card(checkpoint, "me/reach")).data
    assert (data.license, data.library_name, data.pipeline_tag) == ("apache-2.0", "lerobot", "robotics")
    assert {"LeRobot", "surrol", "gcdt"} <= set(data.tags)


def test_success_is_shown_with_wilson_intervals_and_seeds(evaluated):
    card = model_card(evaluated)
    low, high = wilson_interval(17, 20)
    assert f"0.85 ({low:.3f}-{high:.3f})" in card
    [row] = re.findall(r"\| NeedleReach \|.*", card)
    assert row.endswith("| 20 | 100-119 |")
    assert row.index("0.90") < row.index("0.85"), "reached, then held"


def test_success_is_in_the_front_matter_too_by_task(evaluated):
    file = evaluated.parent / "episodes.parquet"
    reach = pd.read_parquet(file)
    pd.concat([reach, reach.assign(task="NeedlePick", held=False)]).to_parquet(file)
    results = ModelCard(model_card(evaluated, "me/reach")).data.eval_results
    assert {(result.dataset_name, result.metric_name.split()[-1]): result.metric_value for result in results} == {
        ("surrol/NeedleReach-v0", "reached"): 0.9,
        ("surrol/NeedleReach-v0", "held"): 0.85,
        ("surrol/NeedlePick-v0", "reached"): 0.9,
        ("surrol/NeedlePick-v0", "held"): 0.0,
    }


def test_starts_that_it_was_chosen_on_are_told_apart_from_those_that_count(evaluated):
    file = evaluated.parent / "episodes.parquet"
    reach = pd.read_parquet(file)
    pd.concat([reach, reach.iloc[:10].assign(seed=range(20, 30))]).to_parquet(file)
    card = model_card(evaluated, "me/reach")
    rows = re.findall(r"\| NeedleReach \|.*", card)
    assert [row.split("|")[-3:-1] for row in rows] == [[" 10 ", " 20-29 "], [" 20 ", " 100-119 "]]
    assert {result.metric_value for result in ModelCard(card).data.eval_results} == {0.9, 0.85}


def test_a_checkpoint_without_an_evaluation_says_so(checkpoint):
    assert "has not been evaluated" in model_card(checkpoint)
    assert ModelCard(model_card(checkpoint)).data.eval_results is None


def test_the_training_is_told_from_the_recording_on(checkpoint):
    card = model_card(checkpoint)
    assert "gcdt record --task NeedleReach --episodes 4 --seed 0 --disturb 0.0 --root datasets/needle_reach" in card
    assert command(card).startswith("lerobot-train --policy.type=gcdt")
    chosen = ["--policy.layers=2", "--policy.context_length=100", "--steps=40", "--batch_size=16", "--seed=1000"]
    data = ["--dataset.repo_id=local/needle_reach", "--dataset.root=datasets/needle_reach"]
    assert set(chosen + data) <= set(command(card).split())


def test_what_was_not_chosen_is_no_part_of_the_command(checkpoint):
    for name in ("dropout", "hindsight_ratio", "device", "task_dims", "input_features", "image_transforms"):
        assert name not in command(model_card(checkpoint))


def test_a_merged_dataset_is_recorded_and_merged(save, policy, uneven_root):
    policy.task_dims[PICK] = [19, 3, 5]
    card = model_card(save(policy, {"repo_id": "local/uneven", "root": str(uneven_root)}))
    assert "--task NeedlePick" in card and "--task NeedleReach" in card
    merging = " ".join(card.replace("\\\n", "").split())
    assert "gcdt merge datasets/surrol_needle_pick datasets/surrol_needle_reach --root datasets/uneven" in merging


def test_a_published_dataset_is_linked_with_its_revision(save, policy):
    card = model_card(save(policy, {"repo_id": "me/data", "revision": "v1.0"}))
    assert ModelCard(card).data.datasets == "me/data"
    assert "me/data at v1.0" in card
    assert "--dataset.repo_id=me/data --dataset.revision=v1.0" in command(card)
    assert "gcdt record" not in card and "--dataset.root" not in card


def test_fine_tuning_names_what_it_started_from(save, policy):
    policy.pretrained_path = Path("me/generalist")
    told = command(model_card(save(policy, {"repo_id": "me/data"})))
    assert told.startswith("lerobot-train --policy.path=me/generalist")
    assert "--policy.training_stage=finetune" in told  # whatever the stage of the start was


def test_trainings_that_follow_one_another_are_all_told(save, policy, needle_reach_root):
    data = {"repo_id": "local/needle_reach", "root": str(needle_reach_root)}
    policy.training_stage = "pretrain"
    first = save(policy, data, step=20, output="first")
    policy.training_stage, policy.pretrained_path = "finetune", first
    card = model_card(save(policy, data, step=40, output="second"))
    assert card.count("gcdt record") == 1
    one, two = command(card).split("lerobot-train ")[1:]
    assert one.startswith("--policy.type=gcdt") and "--policy.training_stage=pretrain" in one
    assert one.strip().endswith("--output_dir=outputs/first")
    start = "--policy.path=outputs/first/checkpoints/000020/pretrained_model"
    assert two.startswith(f"{start} --policy.training_stage=finetune --dataset.repo_id=local/needle_reach")


def test_a_resumed_training_is_told_as_one(save, policy):
    save(policy, {"repo_id": "me/data"}, step=20)
    policy.pretrained_path = Path("output/checkpoints/last/pretrained_model")
    assert command(model_card(save(policy, {"repo_id": "me/data"}, step=40, resume=True))).startswith(
        "lerobot-train --policy.type=gcdt"
    )


def test_the_versions_and_the_commit_are_named(checkpoint, monkeypatch):
    monkeypatch.setattr("lerobot_gcdt.hub.model_card._commit", lambda: "0123abc")
    card = model_card(checkpoint)
    assert "`0123abc`" in card and "LeRobot 0.6" in card and "PyTorch 2" in card


def test_an_installed_package_has_no_commit_even_within_a_foreign_repository(checkpoint, monkeypatch, tmp_path):
    project, installed = tmp_path / "project", tmp_path / "project" / "lerobot_gcdt"
    installed.mkdir(parents=True)
    (project / "thesis.txt").write_text("ten years of work")
    identity = ["-c", "user.name=somebody", "-c", "user.email=somebody"]
    for arguments in (["init", "-q"], ["add", "."], [*identity, "commit", "-q", "-m", "Begin"]):
        subprocess.run(["git", *arguments], cwd=project, check=True)
    (installed / "model_card.py").touch()
    monkeypatch.setattr("lerobot_gcdt.hub.model_card.__file__", str(installed / "model_card.py"))
    assert " at commit" not in model_card(checkpoint)


def test_loading_is_shown_by_the_repository_id(checkpoint):
    card = model_card(checkpoint, "me/reach")
    assert 'lerobot_gcdt.GCDTPolicy.from_pretrained("me/reach")' in card
    assert "lerobot-eval --policy.path=me/reach" in card and "--env.task=NeedleReach-v0" in card


def test_the_baseline_has_a_card_of_its_own(checkpoint):
    config = checkpoint / "config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | {"type": "bc"}))
    card = model_card(checkpoint)
    assert f"{BCPolicy.__name__}.from_pretrained" in card and "perceptron" in card
