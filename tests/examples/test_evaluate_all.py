"""Evaluating trainings: the tasks that a policy knows, on the seeds that were asked for, once."""

import runpy
import sys
from pathlib import Path

import pandas as pd
import pytest
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.act.processor_act import make_act_pre_post_processors

from lerobot_gcdt import GCDTConfig, GCDTPolicy, make_gcdt_pre_post_processors
from lerobot_gcdt.recording import record

SCRIPT = Path(__file__).parents[2] / "examples" / "evaluate_all.py"


@pytest.fixture
def run(monkeypatch, capsys):
    """Runs the script in this process; returns what it printed."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", [str(SCRIPT), *map(str, arguments)])
        runpy.run_path(str(SCRIPT), run_name="__main__")
        return capsys.readouterr().out

    return run


@pytest.fixture(scope="module")
def training(tmp_path_factory):
    """What lerobot-train leaves, of a policy that learned nothing."""
    folder = tmp_path_factory.mktemp("training")
    root = record("NeedleReach", 1, 0, folder / "needle_reach")
    sizes = {"layers": 1, "width": 16, "heads": 2, "inner_width": 16}
    policy = GCDTPolicy(
        GCDTConfig(**sizes, device="cpu", push_to_hub=False),
        dataset_meta=LeRobotDatasetMetadata("local/needle_reach", root=root),
    )
    for part in (policy, *make_gcdt_pre_post_processors(policy.config)):
        part.save_pretrained(folder / "output/checkpoints/000001/pretrained_model")
    (folder / "output/checkpoints/last").symlink_to("000001")
    return folder / "output"


@pytest.fixture(scope="module")
def training_of_act(tmp_path_factory):
    """The same of ACT, which does not say what tasks it knows."""
    folder = tmp_path_factory.mktemp("act")
    config = ACTConfig(
        input_features={
            "observation.state": PolicyFeature(FeatureType.STATE, (7,)),
            "observation.environment_state": PolicyFeature(FeatureType.ENV, (3,)),
        },
        output_features={"action": PolicyFeature(FeatureType.ACTION, (5,))},
        **{"dim_model": 16, "n_heads": 2, "dim_feedforward": 16, "chunk_size": 5, "n_action_steps": 5},
        **{"pretrained_backbone_weights": None, "device": "cpu", "push_to_hub": False},
    )
    for part in (ACTPolicy(config), *make_act_pre_post_processors(config)):
        part.save_pretrained(folder / "checkpoints/000001/pretrained_model")
    (folder / "checkpoints/last").symlink_to("000001")
    return folder


def test_a_policy_is_evaluated_once_on_the_tasks_that_it_knows(training, run):
    arguments = (training, "--tasks=NeedleReach,NeedlePick", "--starts=2", "--first_seed=7")
    first = run(*arguments)
    kept = training / "checkpoints/000001/episodes.parquet"
    assert pd.read_parquet(kept)[["task", "seed"]].to_numpy().tolist() == [["NeedleReach", 7], ["NeedleReach", 8]]
    assert "NeedleReach held" in first and "2 starts, seeds 7-8" in first
    written = kept.stat().st_mtime_ns
    assert run(*arguments).splitlines()[-2:] == first.splitlines()[-2:]
    assert kept.stat().st_mtime_ns == written


def test_by_default_a_policy_is_evaluated_on_all_tasks_that_it_knows(training, run):
    printed = run(training, "--starts=1", "--first_seed=9")
    assert {line.split()[0] for line in printed.splitlines() if "1 starts" in line} == {"NeedleReach"}


def test_a_policy_of_another_type_is_evaluated_on_the_tasks_that_are_named(training_of_act, run):
    assert "NeedleReach held" in run(training_of_act, "--tasks=NeedleReach", "--starts=1")


def test_a_policy_that_does_not_say_what_it_knows_needs_tasks(training, training_of_act, run, capsys):
    with pytest.raises(SystemExit):
        run(training, training_of_act, "--starts=1", "--first_seed=11")
    printed = capsys.readouterr()
    error = printed.err.splitlines()[-1]
    assert str(training_of_act) in error and "type act" in error and "add --tasks" in error
    assert not printed.out, "no policy is evaluated before"


def test_an_unknown_task_names_the_known_ones(training, run, capsys):
    with pytest.raises(SystemExit):
        run(training, "--tasks=NeedleSew")
    error = capsys.readouterr().err
    assert "NeedleSew" in error and "NeedlePick" in error


def test_a_folder_without_a_checkpoint_is_named(tmp_path, run, capsys):
    with pytest.raises(SystemExit):
        run(tmp_path / "nothing")
    assert "nothing holds no checkpoint" in capsys.readouterr().err
