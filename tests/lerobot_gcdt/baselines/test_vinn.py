"""Nearest neighbours: the actions of the frames that saw nearly the same, weighted by their distance."""

import copy

import pytest
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class

from lerobot_gcdt import VINNPolicy
from lerobot_gcdt.baselines.configuration_vinn import VINNConfig
from lerobot_gcdt.baselines.modeling_vinn import NEIGHBOURS, TEMPERATURES
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, STATE

CPU = {"device": "cpu", "push_to_hub": False}


def make(meta, **options):
    return VINNPolicy(VINNConfig(**CPU, **options), dataset_meta=meta)


@pytest.fixture
def policy(needle_pick_meta):
    return make(needle_pick_meta)


def frames(policy, *index):
    """What the policy sees in frames of the dataset."""
    return {key: policy._bank.items[key][list(index)] for key in (STATE, GOAL, ACHIEVED_GOAL)}


def test_lerobot_knows_it_by_name():
    assert PreTrainedConfig.get_choice_class("vinn") is VINNConfig
    assert get_policy_class("vinn") is VINNPolicy


def test_it_keeps_every_frame(policy, needle_pick_meta):
    assert policy.config.frames == needle_pick_meta.total_frames == len(policy.actions)


def test_the_nearest_frame_alone_does_what_it_did(needle_pick_meta):
    policy = make(needle_pick_meta, neighbours=1)
    done = policy._bank.items[ACTION][[3, 90]]
    torch.testing.assert_close(policy.select_action(frames(policy, 3, 90)), done)


def test_actions_are_weighted_by_their_distance(needle_pick_meta):
    policy = make(needle_pick_meta, neighbours=2, temperature=0.5)
    policy.seen.copy_(torch.full_like(policy.seen, 100.0))
    policy.seen[:2] = torch.zeros_like(policy.seen[:2])
    policy.seen[1, 0] = 1.0
    at_the_first = {STATE: policy.mean[None, :19], GOAL: policy.mean[None, 19:22]}
    at_the_first[ACHIEVED_GOAL] = at_the_first[GOAL] - policy.mean[None, 22:]
    weight = torch.tensor([0.0, -1.0 / 0.5]).softmax(0)
    torch.testing.assert_close(policy.select_action(at_the_first), (weight @ policy.actions[:2])[None])


def test_the_goal_tells_frames_apart(policy):
    here = frames(policy, 3)
    elsewhere = here | {GOAL: here[GOAL] + 0.5}
    assert not torch.equal(policy.select_action(here), policy.select_action(elsewhere))


# What is chosen by the demonstrations.


def test_the_choice_has_the_smallest_error_with_the_own_episode_left_out(policy, needle_pick_meta):
    every = {"index": torch.arange(needle_pick_meta.total_frames)}
    chosen = policy.forward(every)[0].item()
    assert policy.neighbours in NEIGHBOURS and any(map(policy.temperature.isclose, map(torch.tensor, TEMPERATURES)))
    for count, temperature in ((1, 1.0), (64, 3.0), (4, 0.03)):
        other = make(needle_pick_meta, neighbours=count, temperature=temperature)
        assert other.forward(every)[0].item() >= chosen - 1e-7


def test_what_is_said_is_not_chosen(needle_pick_meta):
    assert make(needle_pick_meta, neighbours=5).neighbours == 5
    assert make(needle_pick_meta, temperature=0.2).temperature.item() == pytest.approx(0.2)


def test_the_configuration_stays_as_it_was_asked_for(policy):
    assert (policy.config.neighbours, policy.config.temperature) == (0, 0.0)


def test_a_policy_that_was_saved_with_its_choice_in_the_configuration_acts_the_same(policy, tmp_path):
    observed = frames(policy, 3, 90, 150)
    action = policy.select_action(observed)
    policy.config.neighbours = int(policy.neighbours)
    del policy.neighbours
    policy.save_pretrained(tmp_path)
    assert torch.equal(VINNPolicy.from_pretrained(tmp_path).select_action(observed), action)


# The trainer.


def test_the_loss_leaves_the_own_episode_out(needle_pick_meta):
    policy = make(needle_pick_meta, neighbours=1)
    policy.actions[policy._episode == 0] = 9.0
    assert policy.forward({"index": torch.tensor([3, 4])})[0] < 1


def test_a_step_of_the_trainer_changes_nothing(policy):
    before = copy.deepcopy(policy.state_dict())
    optimizer = policy.config.get_optimizer_preset().build(policy.get_optim_params())
    policy.forward({"index": torch.arange(8)})[0].backward()
    optimizer.step()
    assert all(torch.equal(value, before[key]) for key, value in policy.state_dict().items())


def test_the_unreduced_loss_has_an_entry_a_frame(policy):
    batch = {"index": torch.arange(0, 200, 50)}
    each, _ = policy.forward(batch, reduction="none")
    assert each.shape == (4,)
    assert each.mean().item() == pytest.approx(policy.forward(batch)[0].item(), rel=1e-5)


def test_a_saved_policy_acts_the_same(policy, tmp_path):
    observed = frames(policy, 3, 90, 150)
    action = policy.select_action(observed)
    policy.save_pretrained(tmp_path)
    assert torch.equal(VINNPolicy.from_pretrained(tmp_path).select_action(observed), action)


# Bad input.


def test_several_tasks_are_refused(uneven_meta):
    with pytest.raises(ValueError, match="vinn learns one task"):
        make(uneven_meta)


def test_training_without_a_dataset_is_an_error(policy):
    with pytest.raises(RuntimeError, match="dataset_meta"):
        VINNPolicy(copy.deepcopy(policy.config)).forward({"index": torch.tensor([0])})


@pytest.mark.parametrize("bad", [{"neighbours": -1}, {"temperature": -0.5}], ids=str)
def test_a_bad_number_is_named(bad):
    [(name, value)] = bad.items()
    with pytest.raises(OptionError, match=f"{name}.*{value}"):
        VINNConfig(**bad)
