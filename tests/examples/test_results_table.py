import runpy
from pathlib import Path

import pandas as pd

import surrol_gym
from lerobot_gcdt.hub.documents import read_section

ROOT = Path(__file__).parents[2]
TABLE = runpy.run_path(str(ROOT / "examples/results_table.py"))


def test_the_readme_holds_the_table_that_the_script_writes():
    assert read_section(ROOT / "README.md", "results") == TABLE["table"]()


def test_every_rate_is_over_the_same_two_hundred_starts():
    for _, rows in pd.read_parquet(TABLE["EPISODES"]).groupby("method"):
        assert set(rows.task) == set(surrol_gym.TASKS)
        assert all(sorted(seeds) == list(range(400_000, 400_200)) for _, seeds in rows.groupby("task").seed)


def test_held_episodes_reached_the_goal():
    episodes = pd.read_parquet(TABLE["EPISODES"])
    assert not (episodes.held & ~episodes.reached).any()
    assert (episodes.reached == episodes.steps.notna()).all()
