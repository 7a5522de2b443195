"""The studies are drawn from their committed episodes."""

import runpy
from pathlib import Path

import pandas as pd
import pytest
import robustness

from lerobot_gcdt.benchmark.report import sensor_columns
from lerobot_gcdt.hub.documents import read_section
from surrol_gym.wrappers import IDEAL

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "examples/studies.py"))


@pytest.mark.parametrize("name", SCRIPT["SHOWN"])
def test_a_study_has_a_table_and_a_figure(name):
    study = SCRIPT["SHOWN"][name]
    rates = study.rates(pd.read_parquet(SCRIPT["STUDIES"] / f"{name}.parquet"))
    assert read_section(SCRIPT["RESULTS"], name) == study.table(rates)
    assert (SCRIPT["STUDIES"] / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", [name for name in SCRIPT["SHOWN"] if name != "robustness"])
def test_every_rate_of_a_benchmark_is_over_the_same_two_hundred_starts(name):
    episodes = pd.read_parquet(SCRIPT["STUDIES"] / f"{name}.parquet")
    for _, rows in episodes.groupby([*sensor_columns(episodes), *SCRIPT["KEY"][:-1]]):
        assert sorted(rows.seed) == list(SCRIPT["STARTS"]) == list(range(20_000, 20_200))


def test_robustness_is_over_the_same_hundred_starts():
    episodes = pd.read_parquet(SCRIPT["STUDIES"] / "robustness.parquet")
    assert {*episodes.imperfection} == {*robustness.IMPERFECTIONS}
    for _, rows in episodes.groupby(SCRIPT["OF_ROBUSTNESS"][:-1]):
        assert sorted(rows.seed) == list(range(20_000, 20_100))


@pytest.fixture
def add(tmp_path, monkeypatch):
    monkeypatch.setitem(SCRIPT["add"].__globals__, "STUDIES", tmp_path)
    return SCRIPT["add"]


POINT = {"task": "NeedlePick", "method": "gcdt", "demonstrations": 100, "training_seed": 3, "seconds": 9.0}


def write_benchmark(folder, **sensors):
    rows = [
        POINT | sensors | {"step": step, "seed": seed, "reached": True, "held": False, "steps": 7.0}
        for step in (1, 2)
        for seed in (20_000, 400_000)
    ]
    pd.DataFrame(rows).to_parquet(folder / "episodes.parquet")


def test_a_benchmark_is_taken_over_once_with_all_its_points(tmp_path, add):
    write_benchmark(tmp_path)
    for _ in range(2):
        add(tmp_path, "curves")
    kept = pd.read_parquet(tmp_path / "curves.parquet")
    assert list(kept) == SCRIPT["COLUMNS"] and kept.step.tolist() == [1, 2] and kept.seed.unique().tolist() == [20_000]


def test_robustness_is_taken_over_once(tmp_path, add):
    point = {"imperfection": "delay", "level": 1.0, "policy": "ACT", "training": 0, "task": "PegTransfer"}
    rows = pd.DataFrame(
        [point | {"seed": seed, "reached": True, "held": True, "steps": 7.0} for seed in (20_000, 20_001)]
    )
    rows.to_parquet(tmp_path / "episodes.parquet")
    for _ in range(2):
        add(tmp_path, "robustness")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "robustness.parquet"), rows)


def test_levels_of_noise_are_told_apart(tmp_path, add):
    for level in (0.02, 0.01):
        write_benchmark(tmp_path, **IDEAL | {"position_std": level})
        add(tmp_path, "memory")
    rates = SCRIPT["rates_of"](pd.read_parquet(tmp_path / "memory.parquet"))
    assert rates.position_std.tolist() == [0.01, 0.01, 0.02, 0.02] and rates.step.tolist() == [1, 2, 1, 2]


@pytest.mark.parametrize("study, sensors", [("curves", IDEAL | {"delay": 1}), ("memory", {})])
def test_a_benchmark_of_other_sensors_is_refused(tmp_path, add, study, sensors):
    write_benchmark(tmp_path, **sensors)
    with pytest.raises(ValueError, match=f"{study} are not both of"):
        add(tmp_path, study)
    assert not (tmp_path / f"{study}.parquet").exists()


def test_episodes_for_another_study_are_refused(tmp_path, add):
    write_benchmark(tmp_path)
    with pytest.raises(ValueError, match="do not tell imperfection, level, policy, training, so .* not for robustness"):
        add(tmp_path, "robustness")
    assert not (tmp_path / "robustness.parquet").exists()


def test_a_benchmark_is_taken_over_for_a_study_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["studies.py", "--add", str(tmp_path)])
    with pytest.raises(SystemExit):
        SCRIPT["main"]()
    assert "belong together; studies are curves, demonstrations, memory, robustness" in capsys.readouterr().err
