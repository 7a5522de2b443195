"""The trajectory bank: the dataset in memory, hindsight relabelling, packing."""

import shutil
from types import SimpleNamespace

import gymnasium as gym
import pyarrow.parquet as pq
import pytest
import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from lerobot_gcdt.data.trajectories import TrajectoryBank
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, REQUIRED_KEYS, STATE, TIME_TO_GOAL


@pytest.fixture(scope="module")
def bank(needle_pick_root):
    return TrajectoryBank(needle_pick_root)


@pytest.fixture(scope="module")
def compute_reward():
    env = gym.make("surrol/NeedlePick-v0")
    yield env.unwrapped.compute_reward
    env.close()


EPISODE = 1000
"""A length that no episode exceeds: a piece is the whole episode."""


def relabelled(bank, cuts):
    """Whole episodes, relabelled by frames of theirs."""
    return bank.sequences(bank.pieces(cuts, EPISODE), cuts)


def whole(bank, index):
    return bank.sequences(bank.pieces(index, EPISODE))


def cuts(bank, seed=0, count=60):
    """Frames that can be cuts: all but the first ones of episodes."""
    frames = torch.nonzero(bank.timestep > 0).flatten()
    return frames[torch.randperm(len(frames), generator=torch.Generator().manual_seed(seed))[:count]]


def test_sequences_hold_what_lerobot_loads(bank, needle_pick_root):
    dataset = LeRobotDataset("local/needle_pick", root=needle_pick_root, video_backend="pyav")
    sequences = whole(bank, torch.tensor([60]))
    for t in (0, 1, 30, 49):
        frame = dataset[50 + t]
        for key in (STATE, GOAL, ACHIEVED_GOAL, TIME_TO_GOAL, ACTION):
            assert torch.equal(sequences.items[key][0, t], frame[key].reshape(-1)), key


@pytest.mark.parametrize("length", [1, 7, 50])
def test_pieces_cover_an_episode_once_and_in_order(bank, length):
    pieces = bank.pieces(torch.tensor([120, 3]), length)
    for source, start in ((0, 100), (1, 0)):
        own = pieces.source == source
        frames = [i for a, b in zip(pieces.first[own], pieces.last[own], strict=True) for i in range(a, b + 1)]
        assert frames == list(range(start, start + 50))
        assert (pieces.last[own] - pieces.first[own] < length).all()


def test_cuts_lie_between_the_start_of_their_piece_and_the_end_of_the_episode(bank):
    pieces = bank.pieces(torch.arange(0, 200, 3), 7)
    drawn = bank.draw_cuts(pieces, 1.0)
    assert ((drawn >= pieces.first) & (drawn <= bank.last[pieces.first])).all()
    assert (drawn > pieces.last).any() and (drawn == bank.last[pieces.first]).any()


def test_without_hindsight_no_piece_is_cut(bank):
    pieces = bank.pieces(torch.arange(0, 200, 3), 7)
    assert torch.equal(bank.draw_cuts(pieces, 0.0), pieces.first)


def test_a_piece_that_ends_before_its_cut_keeps_all_its_steps(bank):
    pieces = bank.pieces(torch.tensor([0]), 10)
    sequences = bank.sequences(pieces, torch.full((5,), 45))
    assert torch.bincount(sequences.segment[sequences.real]).tolist() == [10, 10, 10, 10, 5]
    first = sequences.items[TIME_TO_GOAL][sequences.segment == 0].flatten()
    assert first.tolist() == list(range(45, 35, -1))


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


def test_drawn_pieces_are_spread_evenly_over_tasks_of_different_sizes(uneven_root):
    bank = TrajectoryBank(uneven_root)
    assert torch.bincount(bank.task).tolist() == [200, 50]
    pieces = bank.draw_pieces(torch.arange(250), 1, 0)
    assert len(pieces.first) == 250 * 50
    counts = torch.bincount(pieces.first, minlength=250).float()
    assert counts[:200].sum().item() == pytest.approx(6250, rel=0.05)
    assert counts[:200].min() > 10 and counts[200:].min() > 80  # every frame of a task is as likely as any other


def test_drawn_pieces_come_from_the_training_episodes_only(uneven_root):
    bank = TrajectoryBank(uneven_root, training_episodes=[0, 1, 4])
    pieces = bank.draw_pieces(torch.tensor([*range(100), *range(200, 250)]), 1, 0)
    assert bank.episode[pieces.first].unique().tolist() == [0, 1, 4]


@pytest.mark.parametrize("length", [1, 7, 50])
def test_drawn_pieces_are_pieces_of_episodes_and_as_many_as_those_of_the_frames(bank, length):
    index = torch.tensor([3, 77, 199])
    drawn = bank.draw_pieces(index, length, 0)
    assert torch.equal(drawn.source, bank.pieces(index, length).source)
    every = bank.pieces(torch.arange(0, 200, 50), length)
    known = set(zip(every.first.tolist(), every.last.tolist(), strict=True))
    assert set(zip(drawn.first.tolist(), drawn.last.tolist(), strict=True)) <= known


def test_a_number_of_pieces_for_each_frame_can_be_asked_for(bank):
    assert bank.draw_pieces(torch.tensor([3, 77]), 20, 0, count=2).source.tolist() == [0, 0, 1, 1]


def test_what_is_drawn_for_a_frame_follows_from_it_and_the_step_alone(bank):
    together, alone = bank.draw_pieces(torch.tensor([3, 77]), 7, 5), bank.draw_pieces(torch.tensor([77]), 7, 5)
    own = together.source == 1
    assert torch.equal(together.first[own], alone.first)
    assert torch.equal(bank.draw_cuts(together, 0.5)[own], bank.draw_cuts(alone, 0.5))


def test_trajectories_that_are_not_relabelled_are_whole(bank):
    index = torch.tensor([7, 60, 149])
    sequences = whole(bank, index)
    for i, cut in enumerate(index.tolist()):
        start = cut - int(bank.timestep[cut])
        for key in bank.items:
            assert torch.equal(sequences.items[key][sequences.segment == i], bank.items[key][start : start + 50]), key


def test_a_foreign_dataset_is_told_with_what_it_lacks():
    foreign = SimpleNamespace(root="foreign", features=dict.fromkeys(set(REQUIRED_KEYS) - {GOAL}))
    with pytest.raises(ValueError, match=f"in foreign lacks {GOAL}; this policy needs .* `gcdt record`"):
        TrajectoryBank.of(foreign, "cpu")


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
    pieces = bank.pieces(index, EPISODE)
    cuts = torch.where(relabel, index, pieces.first)
    assert bank.sequences(pieces, cuts).real.float().mean() > 0.8


def test_expected_steps_are_the_mean_steps_to_the_first_success_of_the_training_episodes(bank, needle_pick_root):
    starts = bank.items[TIME_TO_GOAL][bank.timestep == 0]
    assert bank.expected_steps(0) == pytest.approx(float(starts.mean()))
    assert TrajectoryBank(needle_pick_root, training_episodes=[2]).expected_steps(0) == starts[2]
    assert 15 < bank.expected_steps(0) < 45


def test_the_same_frames_draw_other_pieces_and_cuts_in_every_step(bank):
    index = torch.arange(0, 200, 10)
    pieces = [bank.draw_pieces(index, 7, step) for step in range(40)]
    drawn = {tuple(zip(p.first.tolist(), bank.draw_cuts(p, 0.5).tolist(), strict=True)) for p in pieces}
    assert len(drawn) == 40


def test_every_pair_of_a_frame_and_a_cut_occurs_at_last(bank):
    drawn = set()
    for step in range(200):
        pieces = bank.draw_pieces(torch.arange(0, 200, 4), 1, step)
        drawn |= set(zip(pieces.first.tolist(), bank.draw_cuts(pieces, 1.0).tolist(), strict=True))
    assert len(drawn) > 0.99 * 4 * sum(range(1, 51))


def test_relabelling_changes_the_goal_that_an_observation_repeats(needle_pick_root):
    bank = TrajectoryBank(needle_pick_root, goal_in_state={0: [7, 8, 9]})
    cut = torch.tensor([30])
    relabelled, original = (bank.sequences(bank.pieces(cut, 50), cuts) for cuts in (cut, None))
    assert torch.equal(relabelled.items[STATE][..., 7:10], relabelled.items[GOAL])
    assert torch.equal(relabelled.items[STATE][..., 10:], original.items[STATE][:, :30, 10:])
    assert torch.equal(original.items[STATE][0], bank.items[STATE][:50])


def test_a_folder_without_data_files_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="data files"):
        TrajectoryBank(tmp_path)


@pytest.mark.parametrize(
    "rows", [[*range(0, 60), *range(70, 200)], [1, 0, *range(2, 200)], range(50, 200)], ids=["gap", "order", "start"]
)
def test_frames_that_are_missing_or_out_of_order_are_named(needle_pick_root, tmp_path, rows):
    (tmp_path / "data/chunk-000").mkdir(parents=True)
    table = pq.read_table(next(needle_pick_root.glob("data/*/*.parquet")))
    pq.write_table(table.take(list(rows)), tmp_path / "data/chunk-000/file-000.parquet")
    with pytest.raises(ValueError, match="incomplete or out of order: row"):
        TrajectoryBank(tmp_path)


def test_a_partial_download_is_refused(needle_pick_root, tmp_path):
    root = shutil.copytree(needle_pick_root, tmp_path / "partial")
    file = next(root.glob("data/*/*.parquet"))
    pq.write_table(pq.read_table(file).slice(0, 100), file)
    with pytest.raises(ValueError, match="100 of the 200 frames"):
        TrajectoryBank.of(LeRobotDatasetMetadata("local/partial", root=root), "cpu")
