"""What a policy does wrong is counted, filmed and drawn."""

import pytest

from lerobot_gcdt import GCDTConfig, GCDTPolicy, make_gcdt_pre_post_processors
from surrol_gym.tasks.needle_reach import NeedleReachEnv


@pytest.fixture
def untrained(tmp_path):
    config = GCDTConfig(layers=1, width=16, heads=2, inner_width=16, device="cpu")
    config.task_dims = {NeedleReachEnv.task_description: [7, 3, 5]}
    config.expected_steps = {NeedleReachEnv.task_description: 20.0}
    for part in (GCDTPolicy(config), *make_gcdt_pre_post_processors(config)):
        part.save_pretrained(tmp_path / "untrained")
    return tmp_path / "untrained"


def test_failures_are_counted_filmed_and_drawn(untrained, tmp_path, run_example):
    output = tmp_path / "failures"
    printed = run_example("failures", untrained, "--tasks=NeedleReach", "--starts=2", "--show=1", f"--output={output}")
    assert "NeedleReach: 2 of 2 failed, 0 of these after they had reached the goal." in printed
    assert {file.name for file in output.iterdir()} == {"NeedleReach.png", "NeedleReach.mp4", "NeedleReach_goals.png"}


def test_a_task_without_failures_has_no_pictures(tmp_path, run_example):
    output = tmp_path / "failures"
    printed = run_example("failures", "--tasks=NeedleReach", "--starts=2", f"--output={output}")
    assert "NeedleReach: 0 of 2 failed" in printed
    assert not any(output.iterdir())
