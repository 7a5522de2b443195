"""How success falls with imperfections: what is evaluated, once, and what is told of it."""

import pandas as pd
import pytest
import robustness

from lerobot_gcdt import GCDTConfig, GCDTPolicy, make_gcdt_pre_post_processors
from surrol_gym.tasks.needle_reach import NeedleReachEnv


@pytest.fixture
def trainings(tmp_path):
    """Two trainings in NeedleReach that have learned nothing."""
    config = GCDTConfig(layers=1, width=16, heads=2, inner_width=16, device="cpu")
    config.task_dims = {NeedleReachEnv.task_description: [7, 3, 5]}
    config.expected_steps = {NeedleReachEnv.task_description: 20.0}
    for name in ("0", "1"):
        for part in (GCDTPolicy(config), *make_gcdt_pre_post_processors(config)):
            part.save_pretrained(tmp_path / name / "checkpoints/last/pretrained_model")
    return [tmp_path / "0", tmp_path / "1"]


@pytest.fixture
def small(monkeypatch):
    """One level of two imperfections."""
    study = {"action_std": ("noise of actions", [0.2]), "delay": ("delay", [1])}
    monkeypatch.setattr(robustness, "IMPERFECTIONS", study)


def test_every_level_is_evaluated_once_and_drawn(small, trainings, tmp_path, capsys, monkeypatch):
    output = tmp_path / "out"
    policies = [f"both={trainings[0]}", f"both={trainings[1]}", f"one={trainings[0]}"]
    command = [*policies, "--task=NeedleReach", "--starts=2", f"--output={output}"]
    robustness.main(command)
    first = pd.read_parquet(output / "episodes.parquet")
    assert first.groupby(robustness.POINT).size().to_dict() == {
        (imperfection, level, policy): count
        for imperfection, levels in (("action_std", (0, 0.2)), ("delay", (0, 1)))
        for level in levels
        for policy, count in (("both", 4), ("one", 2))
    }
    assert set(first.seed) == {20_000, 20_001} and set(first.task) == {"NeedleReach"}
    assert first.groupby("policy").training.unique().map(list).to_dict() == {"both": [0, 1], "one": [0]}
    assert (output / "robustness.png").read_bytes().startswith(b"\x89PNG")
    assert "| noise of actions | 0.2 | 0.00 (0.00-0.66) | 0.00 (0.00-0.66) |" in capsys.readouterr().out

    monkeypatch.setattr("lerobot_gcdt.evaluation.checkpoints.load_policy", None)  # nothing is left to evaluate
    robustness.main(command)
    pd.testing.assert_frame_equal(pd.read_parquet(output / "episodes.parquet"), first)


def test_a_policy_is_called_by_its_folder_where_it_has_no_name(small, trainings, tmp_path, capsys):
    robustness.main([str(trainings[0]), "--task=NeedleReach", "--starts=1", f"--output={tmp_path / 'out'}"])
    assert f"| imperfection | level | {trainings[0]} |" in capsys.readouterr().out


def test_rates_are_means_over_trainings_with_intervals_of_their_starts():
    episodes = pd.DataFrame(
        {
            "imperfection": "arm",
            "level": 0.1,
            "policy": "mine",
            "training": [0] * 4 + [1] * 4,
            "seed": [*range(4)] * 2,
        }
    ).assign(held=[True] * 4 + [True, True, False, False])
    alone = robustness.held_rates(episodes[:4]).iloc[0]
    assert (alone.held, alone.low, alone.high) == pytest.approx((1, 0.51, 1), abs=0.005)
    both = robustness.held_rates(episodes).iloc[0]
    assert (both.held, both.low, both.high) == (0.75, 0, 1)  # they differ too much to tell


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (["--task=NeedleSew"], "NeedleSew.*; choose one of"),
        (["--task=BiPegBoard"], "but none of BiPegBoard"),
        (["--starts=0"], "needs tasks, and seeds from 0 on"),
        (["mine=nowhere"], "nowhere holds no checkpoint"),
    ],
)
def test_a_bad_request_is_one_line_before_anything_is_evaluated(small, trainings, tmp_path, changed, told):
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SystemExit, match=told) as error:
        robustness.main(["--task=NeedleReach", f"--output={tmp_path / 'out'}", str(trainings[0]), *changed])
    assert "\n" not in str(error.value)
    assert sorted(tmp_path.rglob("*")) == before
