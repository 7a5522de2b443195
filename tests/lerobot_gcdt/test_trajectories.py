"""The trajectory bank: the dataset in memory, LeRobot's windows, hindsight relabelling, packing."""

import gymnasium as gym
import pyarrow.parquet as pq
import pytest
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_gcdt.trajectories import ACHIEVED_GOAL, ACTION, GOAL, STATE, TIME_TO_GOAL, TrajectoryBank


@pytest.fixture(scope="module")
def bank(needle_pick_root):
    return TrajectoryBank(needle_pick_root)


@pytest.fixture(scope="module")
def compute_reward():
    env = gym.make("surrol/NeedlePick-v0")
    yield env.unwrapped.compute_reward
    env.close()


def relabelled(bank, index):
    return bank.sequences(index, torch.ones(len(index), dtype=torch.bool))


def whole(bank, index):
    return bank.sequences(index, torch.zeros(len(index), dtype=torch.bool))


def cuts(bank, seed=0, count=60):
    """Frames that can be cuts: all but the first ones of episodes."""
    frames = torch.nonzero(bank.timestep > 0).flatten()
    return frames[torch.randperm(len(frames), generator=torch.Generator().manual_seed(seed))[:count]]


@pytest.mark.parametrize("length", [1, 7, 50])
def test_windows_equal_lerobots_delta_timestamps_bit_for_bit(bank, needle_pick_root, length):
    offsets = [i / 5 for i in range(1 - length, 1)]
    keys = (STATE, GOAL, ACHIEVED_GOAL, TIME_TO_GOAL, ACTION)
    dataset = LeRobotDataset(
        "local/needle_pick",
        root=needle_pick_root,
        delta_timestamps={key: offsets for key in keys},
        video_backend="pyav",
    )
    index = torch.tensor([0, 3, 49, 50, 51, 120, len(bank) - 1])
    items, padding = bank.windows(index, length)
    for row, i in enumerate(index.tolist()):
        frame = dataset[i]
        for key in keys:
            assert torch.equal(items[key][row], frame[key].reshape(length, -1)), key
            assert torch.equal(padding[row], frame[f"{key}_is_pad"]), key


def test_relabelled_goal_is_the_goal_achieved_at_the_cut_at_every_step(bank):
    index = cuts(bank)
    sequences = relabelled(bank, index)
    for i, cut in enumerate(index):
        goals = sequences.items[GOAL][sequences.segment == i]
        assert torch.equal(goals, bank.items[ACHIEVED_GOAL][cut].expand_as(goals))


def test_relabelled_time_to_goal_counts_down_to_the_cut(bank):
    index = cuts(bank)
    sequences = relabelled(bank, index)
    for i, cut in enumerate(index):
        countdown = sequences.items[TIME_TO_GOAL][sequences.segment == i].flatten()
        assert torch.equal(countdown, torch.arange(int(bank.timestep[cut]), 0, -1, dtype=torch.float32))


def test_the_environment_calls_the_cut_a_success_for_the_relabelled_goal(bank, compute_reward):
    index = cuts(bank)
    goals = torch.stack([relabelled(bank, index[i : i + 1]).items[GOAL][0, 0] for i in range(len(index))])
    assert (compute_reward(bank.items[ACHIEVED_GOAL][index].numpy(), goals.numpy(), {}) == 0).all()


def test_relabelling_leaves_observations_and_actions_alone(bank):
    index = cuts(bank)
    sequences = relabelled(bank, index)
    for i, cut in enumerate(index.tolist()):
        start = cut - int(bank.timestep[cut])
        for key in (STATE, ACTION, ACHIEVED_GOAL):
            assert torch.equal(sequences.items[key][sequences.segment == i], bank.items[key][start:cut]), key


def test_the_first_frame_of_an_episode_stands_for_the_demonstration_itself(bank):
    sequences = relabelled(bank, torch.tensor([50]))
    assert torch.equal(sequences.items[GOAL][0], bank.items[GOAL][50:100])
    assert torch.equal(sequences.items[TIME_TO_GOAL][0], bank.items[TIME_TO_GOAL][50:100])


def test_every_frame_of_a_demonstration_once_gives_the_papers_mix(bank):
    lengths = torch.bincount(relabelled(bank, torch.arange(50)).segment.flatten() + 1)[1:]
    assert lengths.tolist() == [50, *range(1, 50)]  # the original, and a truncation at every later step


def test_trajectories_that_are_not_relabelled_are_whole(bank):
    index = torch.tensor([7, 60, 149])
    sequences = whole(bank, index)
    for i, cut in enumerate(index.tolist()):
        start = cut - int(bank.timestep[cut])
        for key in bank.items:
            assert torch.equal(sequences.items[key][sequences.segment == i], bank.items[key][start : start + 50]), key


def test_packing_keeps_every_step_once_and_trajectories_in_one_piece(bank):
    index = cuts(bank, seed=1)
    sequences = relabelled(bank, index)
    for i, cut in enumerate(index):
        rows, columns = torch.nonzero(sequences.segment == i, as_tuple=True)
        assert len(set(rows.tolist())) == 1
        assert torch.equal(columns, torch.arange(len(columns)) + columns[0])
        assert len(columns) == bank.timestep[cut]


def test_most_computed_steps_are_real(bank):
    index = torch.randint(len(bank), (32,), generator=torch.Generator().manual_seed(0))
    relabel = torch.rand(32, generator=torch.Generator().manual_seed(0)) < 0.5
    assert bank.sequences(index, relabel).real.float().mean() > 0.8


def test_expected_steps_are_the_mean_steps_to_the_first_success(bank):
    starts = bank.items[TIME_TO_GOAL][bank.timestep == 0]
    assert bank.expected_steps(0) == pytest.approx(float(starts.mean()))
    assert 30 < bank.expected_steps(0) < 45


def test_a_folder_without_data_files_is_named_as_streaming(tmp_path):
    with pytest.raises(FileNotFoundError, match="streaming=false"):
        TrajectoryBank(tmp_path)


def test_missing_keys_are_named(needle_pick_root, tmp_path):
    table = pq.read_table(next(needle_pick_root.glob("data/*/*.parquet"))).drop_columns([GOAL])
    (tmp_path / "data" / "chunk-000").mkdir(parents=True)
    pq.write_table(table, tmp_path / "data" / "chunk-000" / "file-000.parquet")
    with pytest.raises(KeyError, match=GOAL):
        TrajectoryBank(tmp_path)
