"""Implicit Q-learning: it learns values from rewards, and imitates the better actions more."""

import pytest
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class

from lerobot_gcdt.baselines import configuration_iql
from lerobot_gcdt.baselines.configuration_iql import IQLConfig
from lerobot_gcdt.baselines.modeling_iql import IQLPolicy
from lerobot_gcdt.errors import OptionError

EVERY_FRAME = {"index": torch.arange(200)}


def make(meta):
    torch.manual_seed(0)
    return IQLPolicy(IQLConfig(hidden_sizes=(32, 32), device="cpu", push_to_hub=False), dataset_meta=meta)


@pytest.fixture
def policy(needle_pick_meta):
    return make(needle_pick_meta)


@pytest.fixture(scope="module")
def learned(opened, needle_pick_root, train):
    """A policy that was trained for a while, and the error of its actions before that."""
    policy = make(opened(needle_pick_root))
    before = policy.eval().forward(EVERY_FRAME)[0]
    return train(policy, 300), before


def test_lerobot_knows_it_by_name():
    assert PreTrainedConfig.get_choice_class("iql") is IQLConfig
    assert get_policy_class("iql") is IQLPolicy


def test_training_lowers_the_error_of_the_actions(learned):
    policy, before = learned
    assert policy.forward(EVERY_FRAME)[0] < before / 10


def test_values_rise_towards_the_goal(learned):
    policy, _ = learned
    seen = policy._seen({key: value[:50] for key, value in policy._bank.items.items()})
    with policy.iql.value_network_params.to_module(policy.iql.value_network):
        values = policy.iql.value_network(observation=seen)
    assert values[-5:].mean() > values[:5].mean() + 0.5


def test_targets_follow_the_action_values_slowly(policy, train):
    before = policy.iql.target_qvalue_network_params.clone()
    train(policy, 3)
    moved = (policy.iql.target_qvalue_network_params - before).abs().sum()
    ahead = (policy.iql.qvalue_network_params - policy.iql.target_qvalue_network_params).abs().sum()
    for key in moved.keys(True, True):
        assert moved[key] < ahead[key] / 10
    assert max(moved.values(True, True)) > 0


@pytest.mark.parametrize("mode", [True, False], ids=["in training", "in evaluation"])
def test_what_is_saved_acts_and_trains_on_alike(policy, train, observation, needle_pick_meta, tmp_path, mode):
    train(policy, 3).train(mode).save_pretrained(tmp_path)
    policy.eval()
    loaded = IQLPolicy.from_pretrained(tmp_path, dataset_meta=needle_pick_meta)
    assert torch.equal(loaded.select_action(observation), policy.select_action(observation))
    index = {"index": torch.arange(0, 200, 20)}
    assert torch.equal(loaded.train().forward(index)[0], policy.train().forward(index)[0])


def test_the_last_frame_of_an_episode_is_followed_by_itself(policy, monkeypatch):
    seen = []
    monkeypatch.setattr(policy.iql, "forward", lambda data: seen.append(data) or {})
    monkeypatch.setattr(policy.config, "frames_per_sample", 400)
    with pytest.raises(KeyError):
        policy.forward({"index": torch.tensor([0])})
    [data] = seen
    same = (data["observation"] == data["next", "observation"]).all(-1)
    assert same.any() and not same.all()


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"expectile": 0.0}, "expectile must lie in .0, 1., got 0.0"),
        ({"discount": 2.0}, "discount must lie"),
        ({"temperature": -1.0}, "temperature must not be negative, got -1.0"),
        ({"frames_per_sample": 0}, "frames_per_sample must be positive, got 0"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_bad_options_are_named(changed, told):
    with pytest.raises(OptionError, match=told):
        IQLConfig(**changed)


def test_without_torchrl_the_extra_is_named(monkeypatch):
    monkeypatch.setattr(configuration_iql, "find_spec", lambda name: None)
    with pytest.raises(OptionError, match=r"needs torchrl: pip install 'lerobot_policy_gcdt\[iql\]'"):
        IQLConfig()
