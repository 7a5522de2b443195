"""The studies are drawn from their committed episodes."""

import runpy
from pathlib import Path

import pandas as pd
import pytest

from lerobot_gcdt.benchmark.report import sensor_columns, success_table
from lerobot_gcdt.hub.documents import read_section
from surrol_gym.wrappers import IDEAL

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "examples/studies.py"))


@pytest.mark.parametrize("study", SCRIPT["FIGURES"])
def test_a_study_has_a_table_and_a_figure(study):
    assert read_section(SCRIPT["RESULTS"], study) == success_table(SCRIPT["rates_of"](study))
    assert (SCRIPT["STUDIES"] / f"{study}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("study", SCRIPT["FIGURES"])
def test_every_rate_of_a_study_is_over_the_same_two_hundred_starts(study):
    episodes = pd.read_parquet(SCRIPT["STUDIES"] / f"{study}.parquet")
    for _, rows in episodes.groupby([*sensor_columns(episodes), *SCRIPT["KEY"][:-1]]):
        assert sorted(rows.seed) == list(SCRIPT["STARTS"]) == list(range(20_000, 20_200))


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


def test_levels_of_noise_are_told_apart(tmp_path, add):
    for level in (0.02, 0.01):
        write_benchmark(tmp_path, **IDEAL | {"position_std": level})
        add(tmp_path, "memory")
    rates = SCRIPT["rates_of"]("memory")
    assert rates.position_std.tolist() == [0.01, 0.01, 0.02, 0.02] and rates.step.tolist() == [1, 2, 1, 2]


@pytest.mark.parametrize("study, sensors", [("curves", IDEAL | {"delay": 1}), ("memory", {})])
def test_a_benchmark_of_other_sensors_is_refused(tmp_path, add, study, sensors):
    write_benchmark(tmp_path, **sensors)
    with pytest.raises(ValueError, match=f"{study} are not both of"):
        add(tmp_path, study)
    assert not (tmp_path / f"{study}.parquet").exists()


def test_a_benchmark_is_taken_over_for_a_study_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["studies.py", "--add", str(tmp_path)])
    with pytest.raises(SystemExit):
        SCRIPT["main"]()
    assert "belong together; studies are curves, memory" in capsys.readouterr().err
