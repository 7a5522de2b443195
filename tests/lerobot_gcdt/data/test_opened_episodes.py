"""Held-out episodes stay held out, however the dataset's metadata reach the policy."""

import copy

import pytest
import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.datasets.streaming_dataset import StreamingLeRobotDataset

from lerobot_gcdt import BCPolicy, GCDTPolicy
from lerobot_gcdt.baselines.configuration_bc import BCConfig
from lerobot_gcdt.data.opened_episodes import opened_episodes
from lerobot_gcdt.keys import STATE


@pytest.fixture
def half(needle_pick_root):
    """The NeedlePick dataset, opened with two of its four episodes."""
    return LeRobotDataset("local/x", root=needle_pick_root, episodes=[1, 2], video_backend="pyav")


def drawn_episodes(policy):
    pieces = policy._bank.draw_pieces(torch.arange(50, 150), 1, 0)
    return policy._bank.episode[pieces.first].unique().tolist()


def test_a_policy_draws_from_the_episodes_that_its_dataset_was_opened_with(half, tiny_config):
    assert drawn_episodes(GCDTPolicy(tiny_config, dataset_meta=half.meta)) == [1, 2]
    config = BCConfig(hidden_sizes=(8,), device="cpu", push_to_hub=False)
    assert drawn_episodes(BCPolicy(config, dataset_meta=half.meta)) == [1, 2]


def test_copies_and_other_references_do_not_hide_the_episodes(half, tiny_config):
    seen = vars(half)
    assert opened_episodes(copy.deepcopy(half.meta)) == [1, 2]
    assert drawn_episodes(GCDTPolicy(tiny_config, dataset_meta=copy.copy(seen["meta"]))) == [1, 2]


def test_normalisation_and_expected_steps_come_from_these_episodes_only(half, tiny_config):
    tiny_config.hindsight_ratio = 0.0
    policy = GCDTPolicy(tiny_config, dataset_meta=half.meta)
    frames = torch.isin(policy._bank.episode, torch.tensor([1, 2]))
    tokenizer = policy.modules_of(0).tokenizers["state"]
    torch.testing.assert_close(tokenizer.mean, policy._bank.items[STATE][frames].mean(0))
    assert list(policy.config.expected_steps.values()) == [policy._bank.expected_steps(0)]


def test_metadata_by_themselves_stand_for_all_episodes(needle_pick_meta):
    assert opened_episodes(needle_pick_meta) is None


def test_a_streamed_dataset_is_refused(needle_pick_root):
    streamed = StreamingLeRobotDataset("local/x", root=needle_pick_root)
    with pytest.raises(ValueError, match="streaming=false"):
        opened_episodes(streamed.meta)


def test_metadata_that_were_opened_before_the_import_are_refused(needle_pick_meta):
    early = copy.copy(needle_pick_meta)
    del early.opened_episodes
    with pytest.raises(ValueError, match="after `import lerobot_gcdt`"):
        opened_episodes(early)


def test_lerobot_still_makes_a_dataset_with_its_own_metadata(half):
    assert isinstance(half.meta, LeRobotDatasetMetadata)
