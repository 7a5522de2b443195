"""Behavioural cloning: it learns from the same relabelled data, and LeRobot finds and keeps it."""

import copy

import pytest
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class

from lerobot_gcdt import BCPolicy
from lerobot_gcdt.baselines.configuration_bc import BCConfig
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.keys import ACHIEVED_GOAL, GOAL, STATE


@pytest.fixture
def policy(needle_pick_meta):
    torch.manual_seed(0)
    return BCPolicy(BCConfig(hidden_sizes=(32, 32), device="cpu", push_to_hub=False), dataset_meta=needle_pick_meta)


def observation(batch):
    return {STATE: torch.randn(batch, 19), GOAL: torch.randn(batch, 3), ACHIEVED_GOAL: torch.randn(batch, 3)}


def test_lerobot_knows_it_by_name():
    assert PreTrainedConfig.get_choice_class("bc") is BCConfig
    assert get_policy_class("bc") is BCPolicy


def test_it_takes_its_sizes_from_the_dataset(policy):
    assert list(policy.config.task_dims.values()) == [[19, 3, 5]]
    assert policy.select_action(observation(4)).shape == (4, 5)


def test_training_lowers_the_loss(policy):
    optimizer = torch.optim.AdamW(policy.get_optim_params(), lr=1e-3)
    batch = {"index": torch.arange(0, 200, 50)}
    policy.eval()  # demonstrations as they are
    start = policy.forward(batch)[0].item()
    for _ in range(100):
        loss, log = policy.forward(batch)
        loss.backward()
        optimizer.step()
        optimizer.zero_grad()
    assert log["action_loss"] < start / 4


def test_training_draws_anew_in_every_call(policy):
    batch = {"index": torch.arange(0, 200, 10)}
    assert policy.forward(batch)[0] != policy.forward(batch)[0]


def test_goals_are_relabelled_in_training_only(policy):
    policy.config.hindsight_ratio = 1.0
    batch = {"index": torch.arange(0, 200, 10)}
    policy.eval()
    demonstrations = policy.forward(batch)[0]
    assert policy.forward(batch)[0] == demonstrations
    policy.train()
    assert policy.forward(batch)[0] != demonstrations


def test_the_unreduced_loss_has_an_entry_a_frame(policy):
    policy.eval()
    batch = {"index": torch.arange(0, 200, 50)}
    each, _ = policy.forward(batch, reduction="none")
    assert each.shape == (4,)
    assert each.mean().item() == pytest.approx(policy.forward(batch)[0].item(), rel=1e-5)


@pytest.mark.parametrize("dtype", ["bfloat16", "float32"])
def test_only_the_layers_between_train_in_the_chosen_precision(policy, dtype):
    policy.config.dtype, seen = dtype, []
    for layer in policy.network[::2]:
        layer.register_forward_hook(lambda _, __, output: seen.append(output.dtype))
    policy.forward({"index": torch.arange(0, 200, 50)})
    policy.select_action(observation(2))
    assert seen == [torch.float32, getattr(torch, dtype), torch.float32] + 3 * [torch.float32]


def test_it_may_be_linear(needle_pick_meta):
    config = BCConfig(hidden_sizes=(), device="cpu", push_to_hub=False)
    assert BCPolicy(config, dataset_meta=needle_pick_meta).select_action(observation(4)).shape == (4, 5)


def test_a_saved_policy_acts_the_same(policy, tmp_path):
    batch = observation(3)
    action = policy.select_action(batch)
    policy.save_pretrained(tmp_path)
    assert torch.equal(BCPolicy.from_pretrained(tmp_path).select_action(batch), action)


def test_several_tasks_are_refused(uneven_meta):
    with pytest.raises(ValueError, match="one task"):
        BCPolicy(BCConfig(device="cpu", push_to_hub=False), dataset_meta=uneven_meta)


def test_training_without_a_dataset_is_an_error(policy):
    config = copy.deepcopy(policy.config)
    with pytest.raises(RuntimeError, match="dataset_meta"):
        BCPolicy(config).forward({"index": torch.tensor([0])})


@pytest.mark.parametrize("bad", [{"hindsight_ratio": 1.5}, {"frames_per_sample": 0}, {"dtype": "half"}], ids=str)
def test_a_bad_number_is_named(bad):
    [(name, value)] = bad.items()
    with pytest.raises(OptionError, match=f"{name}.*{value}"):
        BCConfig(**bad)
