"""All stages of training in one command, small: weights are handed on, nothing is repeated or guessed."""

import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from accelerate.state import AcceleratorState
from lerobot.configs import parser
from lerobot.scripts import lerobot_train
from safetensors.torch import load_file

import surrol_gym
from lerobot_gcdt.recording import merge, record

SCRIPT = Path(__file__).parents[2] / "examples" / "train_all.py"
TINY = ["--policy.layers=1", "--policy.width=16", "--policy.heads=2", "--policy.inner_width=16"]


@pytest.fixture
def run(monkeypatch):
    """Runs the script in this process."""
    return lambda *arguments: call(monkeypatch, *arguments)


def call(monkeypatch, datasets, output, *arguments):
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), f"--datasets={datasets}", f"--output={output}", *arguments])
    monkeypatch.setattr(subprocess, "run", train_here)
    runpy.run_path(str(SCRIPT), run_name="__main__")


def train_here(command, check):
    """Runs in this process what is meant for one of its own, which saves the seconds of its imports."""
    *launcher, module = command[: command.index("lerobot.scripts.lerobot_train") + 1]
    assert check and launcher == [sys.executable, "-m"]
    sys.argv = [module, *command[3:]]
    try:
        lerobot_train.main()
    finally:
        parser._config_path_args.clear()
        parser._config_yaml_overrides.clear()
        AcceleratorState._reset_state(reset_partial_state=True)


@pytest.fixture(scope="module")
def datasets(tmp_path_factory):
    """Two tasks' datasets of two episodes and their merged one; eight folders stand for the other tasks'."""
    folder = tmp_path_factory.mktemp("datasets")
    two = [
        record(task, 2, 0, folder / name)
        for task, name in (("NeedleReach", "surrol_needle_reach"), ("NeedlePick", "surrol_needle_pick"))
    ]
    merge(two, folder / "surrol_cross_task")
    for name in (
        "gauze_retrieve",
        "peg_transfer",
        "needle_regrasp",
        "bi_peg_transfer",
        "bi_peg_board",
        "match_board_panel",
        "pick_and_place",
        "match_board",
    ):
        (folder / f"surrol_{name}").mkdir()
    return folder


@pytest.fixture(scope="module")
def trained(datasets, tmp_path_factory):
    output = tmp_path_factory.mktemp("all")
    sizes = ["--stages=pretrain,generalist,NeedlePick", "--save_freq=2"]
    sizes += ["--pretrain_steps=2", "--generalist_steps=1", "--finetune_steps=1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        call(patch, datasets, output, *sizes, "--", *TINY, "--policy.optimizer_lr=1e-12")
    return output, sizes


@pytest.mark.parametrize(("first", "second"), [("pretrain", "generalist"), ("generalist", "NeedlePick")])
def test_a_stage_starts_from_the_weights_of_the_one_before_it(trained, first, second):
    before, after = (
        load_file(trained[0] / stage / "checkpoints/last/pretrained_model/model.safetensors")
        for stage in (first, second)
    )
    assert before.keys() == after.keys()
    assert after.pop("training_step") > before.pop("training_step")
    # The learning rate is next to nothing.
    assert all((before[key] - after[key]).abs().max() < 1e-6 for key in before)


def test_a_second_call_repeats_nothing(trained, datasets, run, capfd):
    output, sizes = trained
    run(datasets, output, *sizes)
    printed = capfd.readouterr().out
    assert printed.count("is complete already") == 3
    assert "lerobot_train" not in printed


def test_a_missing_dataset_is_named(datasets, tmp_path, run, capsys):
    few = tmp_path / "few"
    shutil.copytree(datasets / "surrol_needle_reach", few / "surrol_needle_reach")
    with pytest.raises(SystemExit):
        run(few, tmp_path / "output", "--stages=NeedleReach,NeedlePick", "--scratch=bc")
    error = capsys.readouterr().err
    assert "surrol_needle_pick" in error and "surrol_needle_reach" not in error
    assert not (tmp_path / "output").exists()


@pytest.mark.parametrize(
    ("arguments", "missing"),
    [
        (["--stages=NeedlePick"], "generalist"),
        (["--stages=NeedlePick", "--generalist_steps=0"], "pretrain"),
        (["--stages=generalist"], "pretrain"),
    ],
)
def test_a_stage_whose_start_is_missing_asks_for_it(datasets, tmp_path, run, capsys, arguments, missing):
    with pytest.raises(SystemExit):
        run(datasets, tmp_path / "output", *arguments)
    error = capsys.readouterr().err
    assert f"add {missing}" in error and "--scratch" in error


def test_the_baseline_has_no_stage_of_several_tasks(datasets, tmp_path, run, capsys):
    with pytest.raises(SystemExit):
        run(datasets, tmp_path / "output", "--stages=pretrain,NeedlePick", "--scratch=bc")
    assert "leave pretrain out" in capsys.readouterr().err


def test_an_unknown_stage_names_the_known_ones(datasets, tmp_path, run, capsys):
    with pytest.raises(SystemExit):
        run(datasets, tmp_path / "output", "--stages=NeedleSew")
    error = capsys.readouterr().err
    assert "NeedleSew" in error and all(task in error for task in surrol_gym.TASKS)
