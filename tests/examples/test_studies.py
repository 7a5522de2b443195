"""The studies are drawn from their committed episodes."""

import runpy
from pathlib import Path

import pandas as pd
import pytest

from lerobot_gcdt.benchmark.report import success_table
from lerobot_gcdt.hub.documents import read_section

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "examples/studies.py"))


@pytest.mark.parametrize("study", SCRIPT["FIGURES"])
def test_a_study_has_a_table_and_a_figure(study):
    assert read_section(SCRIPT["RESULTS"], study) == success_table(SCRIPT["rates_of"](study))
    assert (SCRIPT["STUDIES"] / f"{study}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("study", SCRIPT["FIGURES"])
def test_every_rate_of_a_study_is_over_the_same_two_hundred_starts(study):
    episodes = pd.read_parquet(SCRIPT["STUDIES"] / f"{study}.parquet")
    for _, rows in episodes.groupby(SCRIPT["KEY"][:-1]):
        assert sorted(rows.seed) == list(SCRIPT["STARTS"]) == list(range(20_000, 20_200))


def test_a_benchmark_is_taken_over_once_with_all_its_points(tmp_path, monkeypatch):
    add = SCRIPT["add"]
    monkeypatch.setitem(add.__globals__, "STUDIES", tmp_path)
    point = {"task": "NeedlePick", "method": "gcdt", "demonstrations": 100, "training_seed": 3, "seconds": 9.0}
    rows = [
        point | {"step": step, "seed": seed, "reached": True, "held": False, "steps": 7.0}
        for step in (1, 2)
        for seed in (20_000, 400_000)
    ]
    pd.DataFrame(rows).to_parquet(tmp_path / "episodes.parquet")
    for _ in range(2):
        add(tmp_path, "curves")
    kept = pd.read_parquet(tmp_path / "curves.parquet")
    assert list(kept) == SCRIPT["COLUMNS"] and kept.step.tolist() == [1, 2] and kept.seed.unique().tolist() == [20_000]


def test_a_benchmark_of_imperfect_sensors_is_refused(tmp_path, monkeypatch):
    add = SCRIPT["add"]
    monkeypatch.setitem(add.__globals__, "STUDIES", tmp_path)
    pd.DataFrame({"seed": [20_000], "delay": [1]}).to_parquet(tmp_path / "episodes.parquet")
    with pytest.raises(ValueError, match="imperfect sensors"):
        add(tmp_path, "curves")
    assert not (tmp_path / "curves.parquet").exists()


def test_a_benchmark_is_taken_over_for_a_study_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["studies.py", "--add", str(tmp_path)])
    with pytest.raises(SystemExit):
        SCRIPT["main"]()
    assert "belong together; studies are curves" in capsys.readouterr().err
