"""Watching a trained policy right after the installation."""

import pytest

from lerobot_gcdt import GENERALIST


def test_it_films_the_built_in_policy_and_tells_the_outcome(tmp_path, run_example):
    film = tmp_path / "films" / "reach.mp4"
    printed = run_example("watch", "--task=NeedleReach", "--episodes=1", f"--output={film}")
    assert film.stat().st_size > 10_000
    assert "NeedleReach, seed 100000: the goal is" in printed and str(film) in printed


def test_the_policy_is_named_by_its_training(tmp_path, run_example):
    last = tmp_path / "training" / "checkpoints" / "last"
    last.mkdir(parents=True)
    (last / "pretrained_model").symlink_to(GENERALIST)
    film = tmp_path / "reach.mp4"
    run_example("watch", "--task=NeedleReach", "--episodes=1", f"--policy={tmp_path}/training", f"--output={film}")
    assert film.exists()


@pytest.mark.parametrize("made", [False, True], ids=["no folder", "an empty folder"])
def test_a_policy_that_is_not_there_is_named(tmp_path, run_example, capsys, monkeypatch, made):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    if made:
        (tmp_path / "none").mkdir()
    with pytest.raises(SystemExit):
        run_example("watch", f"--policy={tmp_path}/none", f"--output={tmp_path}/films/x.mp4")
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("watch.py: error: --policy: ") and f"{tmp_path}/none" in line
    assert not (tmp_path / "films").exists()


def test_an_unknown_task_names_the_known_ones(run_example, capsys):
    with pytest.raises(SystemExit):
        run_example("watch", "--task=NeedleSew")
    error = capsys.readouterr().err
    assert "NeedleSew" in error and "PegTransfer" in error
