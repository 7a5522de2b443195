"""What makes a policy close its jaws: the clock and the scene are told apart."""

import closing
import numpy as np
import pytest
import torch

from lerobot_gcdt.evaluation.rollout import rollout


class Clock:
    """Opens the jaws and closes them at its eighth step, whatever it sees."""

    def reset(self):
        self.step = 0

    def select_action(self, batch):
        self.step += 1
        action = torch.zeros(len(batch["task"]), 5)
        action[:, closing.JAW] = -1.0 if self.step >= 8 else 1.0
        return action


@pytest.mark.parametrize("wait", [0, 4])
def test_a_policy_by_the_clock_closes_at_the_same_step_however_long_it_waited(wait):
    waiting = closing.Waiting(Clock(), wait)
    rollout(waiting, "NeedlePick", [20_000, 20_001])
    step, away = closing.closing(waiting)
    assert step.tolist() == [7, 7]
    assert (away > 0.05).all()  # it never moved to the needle


def test_an_episode_without_a_closing_counts_for_nothing():
    waiting = closing.Waiting(Clock(), 60)
    rollout(waiting, "NeedlePick", [20_000])
    assert np.isnan(closing.closing(waiting)).all()


def test_the_built_in_policy_closes_by_what_it_sees(tmp_path, run_example):
    picture = tmp_path / "pictures" / "closing.png"
    printed = run_example("closing", "--starts=6", "--wait=8", f"--output={picture}")
    assert "Made to wait 8 steps, the policy closes its jaws 8 steps later" in printed
    assert picture.read_bytes().startswith(b"\x89PNG")
