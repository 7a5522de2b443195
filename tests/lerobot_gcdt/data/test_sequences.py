"""Windows that a loader makes are read as the pieces of the trajectory bank are."""

import pytest
import torch

from lerobot_gcdt.data.sequences import Sequences
from lerobot_gcdt.data.trajectories import TrajectoryBank
from lerobot_gcdt.keys import GOAL


def test_windows_of_lerobot_hold_what_the_bank_holds(needle_pick_root, needle_pick_windows):
    bank = TrajectoryBank(needle_pick_root)
    windows = Sequences.of_windows(needle_pick_windows, {needle_pick_windows["task"][0]: [19, 3, 5]})
    episodes = bank.sequences(bank.pieces(torch.tensor([0, 50, 100]), 50))
    assert windows.real.sum(1).tolist() == [50, 50, 20]
    for key, value in episodes.items.items():
        assert torch.equal(windows.items[key][:2], value[:2]), key
        assert torch.equal(windows.items[key][2, 30:], value[2, :20]), key
    assert torch.equal(windows.timestep[2, 30:], torch.arange(20))


def test_windows_that_lack_something_or_are_of_an_unknown_task_are_named(needle_pick_windows):
    dims = {needle_pick_windows["task"][0]: [19, 3, 5]}
    without = {key: value for key, value in needle_pick_windows.items() if key != GOAL}
    with pytest.raises(KeyError, match=f"lacks {GOAL}"):
        Sequences.of_windows(without, dims)
    with pytest.raises(KeyError, match="(?s)Unknown task 'Sew'.*Pick up the needle"):
        Sequences.of_windows(needle_pick_windows | {"task": ["Sew"] * 3}, dims)


def test_windows_with_too_few_numbers_name_both_sizes(needle_pick_windows):
    with pytest.raises(ValueError, match=r"observation\.state.* 35\).*\(3, 50, 19\)"):
        Sequences.of_windows(needle_pick_windows, {needle_pick_windows["task"][0]: [35, 3, 5]})
