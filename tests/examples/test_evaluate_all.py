"""Evaluating trainings: the tasks that a policy knows, on the seeds that were asked for, once."""

import runpy
import sys
from pathlib import Path

import pandas as pd
import pytest
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata

from lerobot_gcdt import GCDTConfig, GCDTPolicy
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
    policy.save_pretrained(folder / "output/checkpoints/000001/pretrained_model")
    (folder / "output/checkpoints/last").symlink_to("000001")
    return folder / "output"


def test_a_policy_is_evaluated_once_on_the_tasks_that_it_knows(training, run):
    arguments = (training, "--tasks=NeedleReach,NeedlePick", "--starts=2", "--first_seed=7")
    first = run(*arguments)
    kept = training / "checkpoints/000001/episodes.parquet"
    assert pd.read_parquet(kept)[["task", "seed"]].to_numpy().tolist() == [["NeedleReach", 7], ["NeedleReach", 8]]
    assert "NeedleReach held" in first and "2 starts, seeds 7-8" in first
    written = kept.stat().st_mtime_ns
    assert run(*arguments).splitlines()[-2:] == first.splitlines()[-2:]
    assert kept.stat().st_mtime_ns == written


def test_a_folder_without_a_checkpoint_is_named(tmp_path, run, capsys):
    with pytest.raises(SystemExit):
        run(tmp_path / "nothing")
    assert "nothing holds no checkpoint" in capsys.readouterr().err
