"""Watching a trained policy right after the installation."""

import runpy
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "watch.py"


def run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), *map(str, arguments)])
    runpy.run_path(str(SCRIPT), run_name="__main__")


def test_it_films_the_built_in_policy_and_tells_the_outcome(tmp_path, monkeypatch, capsys):
    film = tmp_path / "films" / "reach.mp4"
    run(monkeypatch, "--task=NeedleReach", "--episodes=1", f"--output={film}")
    assert film.stat().st_size > 10_000
    printed = capsys.readouterr().out
    assert "NeedleReach, seed 100000: the goal is" in printed and str(film) in printed


def test_an_unknown_task_names_the_known_ones(monkeypatch, capsys):
    with pytest.raises(SystemExit):
        run(monkeypatch, "--task=NeedleSew")
    error = capsys.readouterr().err
    assert "NeedleSew" in error and "PegTransfer" in error
