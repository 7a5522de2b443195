"""The README's main job, small: all its outputs appear, and a second call repeats nothing."""

import os

import pandas as pd
import pytest

EPISODES = "training/checkpoints/last/episodes.parquet"
KEPT = ("dataset/meta/info.json", "training/checkpoints/last/pretrained_model/model.safetensors", EPISODES, "film.mp4")
SIZES = ["--episodes=2", "--steps=2", "--starts=1"]


@pytest.fixture(scope="module")
def first_run(tmp_path_factory, run_example):
    output = tmp_path_factory.mktemp("quickstart")
    return output, run_example("quickstart", f"--output={output}", *SIZES)


def test_it_shows_the_result_and_says_where_the_pictures_are(first_run):
    output, printed = first_run
    assert "NeedlePick reached" in printed
    assert "95 % interval" in printed
    assert all((output / name).stat().st_size > 1000 for name in ("film.mp4", "training_curve.png", "goals.png"))


def test_the_evaluation_has_a_row_a_start_on_unseen_seeds(first_run):
    episodes = pd.read_parquet(first_run[0] / EPISODES)
    assert episodes.seed.tolist() == [100_000]
    assert {"task", "seed", "reached", "held", "steps"} <= set(episodes.columns)


def test_a_second_call_repeats_no_stage(first_run, run_example):
    output, printed = first_run
    before = {name: (output / name).stat().st_mtime_ns for name in KEPT}
    again = run_example("quickstart", f"--output={output}", *SIZES)
    assert {name: (output / name).stat().st_mtime_ns for name in before} == before
    result = [line for line in printed.splitlines() if line.startswith("NeedlePick")]
    assert [line for line in again.splitlines() if line.startswith("NeedlePick")] == result


def test_a_film_of_an_earlier_policy_is_replaced(first_run, run_example):
    film = first_run[0] / "film.mp4"
    film.write_bytes(b"")
    os.utime(film, (0, 0))
    run_example("quickstart", f"--output={first_run[0]}", *SIZES)
    assert film.stat().st_size > 1000
    assert not film.with_name("unfinished.mp4").exists()
