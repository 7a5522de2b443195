"""Policies act with an average of their weights, and train on with the weights themselves."""

import pytest
import torch
from safetensors.torch import load_file, save_file

from lerobot_gcdt import GCDTConfig
from lerobot_gcdt.averaging import RESTING, without_resting
from lerobot_gcdt.baselines.configuration_bc import BCConfig
from lerobot_gcdt.baselines.configuration_dt import DTConfig
from lerobot_gcdt.baselines.configuration_plas import PLASConfig
from lerobot_gcdt.baselines.modeling_bc import BCPolicy
from lerobot_gcdt.errors import OptionError

SIZES = {"task_dims": {"Pick it up.": [3, 2, 4]}, "hidden_sizes": (5,), "device": "cpu"}


def trained(average_steps: int, steps: int = 4) -> BCPolicy:
    """A policy of which every weight rises by one in each step of its training."""
    policy = BCPolicy(BCConfig(average_steps=average_steps, **SIZES))
    for _ in range(steps):
        policy.average_weights()
        policy.training_step += 1
        with torch.no_grad():
            for parameter in policy.parameters():
                parameter.add_(1)
    return policy


def weights(policy):
    return {name: parameter.detach().clone() for name, parameter in policy.named_parameters()}


def assert_same(a, b):
    assert a.keys() == b.keys()
    for name, weight in a.items():
        torch.testing.assert_close(weight, b[name], atol=0, rtol=0)


def saved(policy, folder):
    policy.save_pretrained(folder)
    return load_file(folder / "model.safetensors")


def test_it_acts_with_an_exponential_average_and_trains_with_the_weights():
    policy = trained(average_steps=5, steps=60)
    in_training = weights(policy)
    behind = 0.0  # the last step has not been taken in
    for step in range(60):
        behind = min(1 - 1 / 5, (1 + step) / (10 + step)) * behind + 1
    for name, average in weights(policy.eval()).items():
        torch.testing.assert_close(average, in_training[name] - behind)
    assert_same(weights(policy.train()), in_training)


def test_a_short_training_looks_back_on_a_ninth_of_itself():
    policy = trained(average_steps=2000, steps=600)
    last = weights(policy)
    behind = {(last[name] - average).mean().item() for name, average in weights(policy.eval()).items()}
    assert all(steps == pytest.approx(600 / 10, rel=0.05) for steps in behind), "ages fade, so a tenth on average"


def test_without_an_average_it_acts_with_the_last_weights():
    policy = trained(average_steps=0)
    last = weights(policy)
    assert_same(weights(policy.eval()), last)
    assert without_resting(policy.state_dict()) == set(policy.state_dict())


def test_a_file_holds_the_average_by_the_names_of_the_weights_whatever_the_mode(tmp_path):
    policy = trained(average_steps=5)
    in_training = saved(policy, tmp_path / "training")
    average = weights(policy.eval())
    assert_same(saved(policy, tmp_path / "evaluation"), in_training)
    assert_same({name: in_training[name] for name in average}, average)


def test_what_is_loaded_acts_and_trains_on_as_what_was_saved(tmp_path):
    policy = trained(average_steps=5)
    in_training = weights(policy)
    policy.save_pretrained(tmp_path)
    loaded = BCPolicy.from_pretrained(tmp_path)
    assert_same(weights(loaded), weights(policy.eval()))
    assert_same(weights(loaded.train()), in_training)


def test_weights_can_be_loaded_in_training_mode():
    policy, other = trained(average_steps=5), trained(average_steps=5, steps=1)
    other.load_state_dict(policy.state_dict())
    assert_same(weights(other), weights(policy))
    assert_same(weights(other.eval()), weights(policy.eval()))


@pytest.mark.parametrize("average_steps", [0, 5], ids=["that keeps none", "that keeps one"])
def test_a_file_without_an_average_trains_on_from_its_weights(tmp_path, average_steps):
    names = without_resting(whole := saved(trained(average_steps=5), tmp_path))
    save_file({name: whole[name] for name in names}, tmp_path / "model.safetensors")
    loaded = BCPolicy.from_pretrained(tmp_path, config=BCConfig(average_steps=average_steps, **SIZES))
    acting = weights(loaded)
    assert_same(acting, {name: whole[name] for name in acting})
    assert_same(weights(loaded.train()), acting)


def test_a_policy_that_keeps_no_average_begins_with_one_that_was_saved(tmp_path):
    whole = saved(trained(average_steps=5), tmp_path)
    loaded = BCPolicy.from_pretrained(tmp_path, config=BCConfig(average_steps=0, **SIZES))
    assert_same(weights(loaded), {name: whole[name] for name in weights(loaded)})
    assert not any(name.startswith(RESTING) for name in loaded.state_dict())


@pytest.mark.parametrize("config", [GCDTConfig, BCConfig, DTConfig, PLASConfig])
def test_a_negative_number_of_steps_is_refused(config):
    with pytest.raises(OptionError, match="average_steps must not be negative, got -1"):
        config(average_steps=-1)
