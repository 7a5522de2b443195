"""The README's main job, small: all its outputs appear, and a second call repeats nothing."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "quickstart.py"
KEPT = ("dataset/meta/info.json", "training/checkpoints/last/pretrained_model/model.safetensors", "episodes.parquet")


SIZES = ["--episodes=2", "--steps=2", "--starts=1"]


@pytest.fixture(scope="module")
def first_run(tmp_path_factory):
    output = tmp_path_factory.mktemp("quickstart")
    environment = os.environ | {"HF_HUB_OFFLINE": "1"}
    command = [sys.executable, str(SCRIPT), f"--output={output}", *SIZES]
    return output, subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


def test_it_shows_the_result_and_says_where_the_pictures_are(first_run):
    output, printed = first_run
    assert "NeedlePick reached" in printed
    assert "95 % interval" in printed
    assert all((output / name).stat().st_size > 1000 for name in ("film.mp4", "training_curve.png", "goals.png"))


def test_the_evaluation_has_a_row_a_start_on_unseen_seeds(first_run):
    episodes = pd.read_parquet(first_run[0] / "episodes.parquet")
    assert episodes.seed.tolist() == [100_000]
    assert {"task", "seed", "reached", "held", "steps"} <= set(episodes.columns)


def test_a_second_call_repeats_no_stage(first_run, monkeypatch, capsys):
    output, printed = first_run
    before = {name: (output / name).stat().st_mtime_ns for name in (*KEPT, "film.mp4")}
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), f"--output={output}", *SIZES])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    again = capsys.readouterr().out
    assert {name: (output / name).stat().st_mtime_ns for name in before} == before
    result = [line for line in printed.splitlines() if line.startswith("NeedlePick")]
    assert [line for line in again.splitlines() if line.startswith("NeedlePick")] == result
