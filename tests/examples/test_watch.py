"""Watching a trained policy right after the installation."""

import pytest


def test_it_films_the_built_in_policy_and_tells_the_outcome(tmp_path, run_example):
    film = tmp_path / "films" / "reach.mp4"
    printed = run_example("watch", "--task=NeedleReach", "--episodes=1", f"--output={film}")
    assert film.stat().st_size > 10_000
    assert "NeedleReach, seed 100000: the goal is" in printed and str(film) in printed


def test_an_unknown_task_names_the_known_ones(run_example, capsys):
    with pytest.raises(SystemExit):
        run_example("watch", "--task=NeedleSew")
    error = capsys.readouterr().err
    assert "NeedleSew" in error and "PegTransfer" in error
