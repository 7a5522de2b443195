"""The tables of success rates are those of the committed episodes."""

import runpy
from pathlib import Path

import pandas as pd
import pytest

import surrol_gym
from lerobot_gcdt.benchmark.report import success_latex
from lerobot_gcdt.hub.documents import read_section

ROOT = Path(__file__).parents[2]
TABLE = runpy.run_path(str(ROOT / "examples/results_table.py"))


@pytest.fixture(scope="module")
def episodes():
    return pd.read_parquet(TABLE["EPISODES"])


def test_the_documents_hold_the_tables_that_the_script_writes():
    for document, section, text in TABLE["tables"]():
        assert read_section(document, section) == text


def test_there_are_a_latex_table_and_a_figure_of_each_protocol():
    for protocol, rates in TABLE["protocols"]():
        table, figure = (TABLE["EPISODES"].with_name(f"{protocol}.{kind}") for kind in ("tex", "png"))
        assert table.read_text() == success_latex(rates.assign(method=rates.method.map(TABLE["METHODS"])))
        assert figure.read_bytes().startswith(b"\x89PNG")


def test_every_rate_is_over_the_same_two_hundred_starts(episodes):
    for _, rows in episodes.groupby(TABLE["KEY"][:-1]):
        assert sorted(rows.seed) == list(TABLE["STARTS"]) == list(range(400_000, 400_200))


def test_a_mean_is_over_all_ten_tasks():
    for _, _, text in TABLE["tables"]():
        rows = {cells[1].strip(): cells[2:-2] for cells in (line.split("|") for line in text.splitlines()[2:])}
        means = rows.pop("mean", None)
        if means:
            assert list(rows) == list(surrol_gym.TASKS)
        for i, column in enumerate(zip(*rows.values(), strict=True)):
            whole = len(column) == len(surrol_gym.TASKS) and all(cell.strip() for cell in column)
            assert whole == bool(means and means[i].strip())


def test_protocols_are_known(episodes):
    assert set(episodes.protocol) <= set(TABLE["PROTOCOLS"])
    assert set(episodes.method) <= set(TABLE["METHODS"])


def test_held_episodes_reached_the_goal(episodes):
    assert not (episodes.held & ~episodes.reached).any()
    assert (episodes.reached == episodes.steps.notna()).all()


def test_a_benchmark_is_taken_over_once(tmp_path, monkeypatch):
    add = TABLE["add"]
    monkeypatch.setitem(add.__globals__, "EPISODES", tmp_path / "kept.parquet")
    cell = {"method": "scratch", "task": "NeedlePick", "demonstrations": 100, "training_seed": 3, "seconds": 9.0}
    rows = [
        cell | {"step": step, "seed": seed, "reached": True, "held": step > 1, "steps": 7.0}
        for step in (1, 2)
        for seed in (20_000, 400_000, 400_001)
    ]
    pd.DataFrame(rows).to_parquet(tmp_path / "episodes.parquet")
    for _ in range(2):
        add(tmp_path, "plain-100")
    kept = pd.read_parquet(tmp_path / "kept.parquet")
    assert list(kept) == TABLE["COLUMNS"] and kept.held.tolist() == [True, True]
    assert set(kept.protocol) == {"plain-100"} and kept.seed.tolist() == [400_000, 400_001]


@pytest.mark.parametrize(
    ("columns", "told"),
    [
        ({"demonstrations": [50, 100]}, "several numbers of demonstrations"),
        ({"delay": 1}, "imperfect sensors"),
        ({"method": ["scratch", "gcdt"]}, "methods called gcdt; the tables have generalist"),
    ],
)
def test_a_benchmark_that_is_of_no_protocol_is_refused(tmp_path, monkeypatch, columns, told):
    add = TABLE["add"]
    monkeypatch.setitem(add.__globals__, "EPISODES", tmp_path / "kept.parquet")
    cell = {"method": "scratch", "task": "NeedlePick", "demonstrations": 100, "training_seed": 3, "seed": 400_000}
    pd.DataFrame([cell] * 2).assign(**columns).to_parquet(tmp_path / "episodes.parquet")
    with pytest.raises(ValueError, match=told):
        add(tmp_path, "plain-100")
    assert not (tmp_path / "kept.parquet").exists()


def test_a_benchmark_is_taken_over_with_its_protocol_alone(tmp_path, monkeypatch, capsys):
    main = TABLE["main"]
    monkeypatch.setitem(main.__globals__, "EPISODES", tmp_path / "kept.parquet")
    monkeypatch.setattr("sys.argv", ["results_table.py", "--add", str(tmp_path)])
    with pytest.raises(SystemExit):
        main()
    assert "needs a --protocol: published-large" in capsys.readouterr().err
