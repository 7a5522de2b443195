"""What a policy predicts of its time-to-goal is set against the steps that it really needed."""

import numpy as np
import time_to_goal
import torch


class Prophet:
    """Never moves, and always says seven; without processors."""

    def __init__(self):
        self.policy = self

    def reset(self):
        pass

    def select_action(self, batch):
        return torch.zeros(len(batch["task"]), 5)

    def predict_time_to_goal(self):
        return torch.full((2,), 7.0)


def test_moments_of_episodes_without_success_do_not_count():
    left, told = time_to_goal.predictions(Prophet(), "NeedlePick", [20_000, 20_001])
    assert len(left) == len(told) == 0


def test_steps_are_counted_down_to_the_first_success(monkeypatch):
    success = np.zeros((6, 2), dtype=bool)
    success[3:, 0] = success[1:, 1] = True

    def succeed(policy, task, seeds):
        policy.reset()
        for _ in success:
            policy.select_action({"task": seeds})
        return success, {}

    monkeypatch.setattr(time_to_goal, "rollout", succeed)
    left, told = time_to_goal.predictions(Prophet(), "NeedlePick", [0, 1])
    assert sorted(left) == [1, 1, 2, 2, 3, 4] and set(told) == {7.0}


def test_the_built_in_policy_is_drawn(tmp_path, run_example):
    picture = tmp_path / "pictures/time_to_goal.png"
    printed = run_example("time_to_goal", "--tasks=NeedleReach,NeedlePick", "--starts=2", f"--output={picture}")
    assert printed.count("steps off on average") == 2
    assert picture.read_bytes().startswith(b"\x89PNG")
