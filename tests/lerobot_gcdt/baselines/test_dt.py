"""The decision transformer: it acts on its past and a return that it asks for, and sees no goal unless told to."""

import copy
from types import SimpleNamespace

import pandas as pd
import pytest
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class
from torch.utils._python_dispatch import TorchDispatchMode

from lerobot_gcdt import DTPolicy
from lerobot_gcdt.baselines.configuration_dt import DTConfig
from lerobot_gcdt.baselines.modeling_dt import _returns_to_go
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, STATE

SMALL = {"layers": 1, "heads": 2, "width": 16, "context_length": 4, "device": "cpu", "push_to_hub": False}


def make(meta, **options):
    torch.manual_seed(0)
    return DTPolicy(DTConfig(**(SMALL | options)), dataset_meta=meta)


@pytest.fixture
def policy(needle_pick_meta):
    return make(needle_pick_meta)


@pytest.fixture
def rewards(needle_pick_meta):
    """The rewards of the dataset, a list an episode."""
    table = pd.concat(map(pd.read_parquet, sorted(needle_pick_meta.root.glob("data/*/*.parquet"))))
    return [list(each) for _, each in table.groupby("episode_index")["next.reward"]]


def observation(batch, seed=0):
    draw = torch.Generator().manual_seed(seed)
    return {key: torch.randn(batch, size, generator=draw) for key, size in ((STATE, 19), (GOAL, 3), (ACHIEVED_GOAL, 3))}


def acted(policy, observations):
    """The actions of an episode, shape (T, B, A)."""
    policy.eval()
    policy.reset()
    return torch.stack([policy.select_action(each) for each in observations])


def test_lerobot_knows_it_by_name():
    assert PreTrainedConfig.get_choice_class("dt") is DTConfig
    assert get_policy_class("dt") is DTPolicy


# Training.


def test_training_lowers_the_loss(policy):
    optimizer = torch.optim.AdamW(policy.get_optim_params(), lr=3e-3)
    batch = {"index": torch.arange(0, 200, 50)}
    policy.eval()
    start = policy.forward(batch)[0].item()
    policy.train()
    for _ in range(100):
        policy.forward(batch)[0].backward()
        optimizer.step()
        optimizer.zero_grad()
    policy.eval()
    assert policy.forward(batch)[0] < start / 3


def test_training_draws_anew_in_every_call(needle_pick_meta):
    policy = make(needle_pick_meta, dropout=0.0)
    batch = {"index": torch.arange(0, 200, 10)}
    assert policy.forward(batch)[0] != policy.forward(batch)[0]


def test_return_to_go_is_what_is_still_rewarded(policy, rewards):
    expected = [sum(each[t:]) for each in rewards for t in range(len(each))]
    assert policy._returns[:, 0].tolist() == expected


class WithoutFloat64(TorchDispatchMode):
    """Refuses float64 but on the CPU, as MPS does; the device ``meta`` stands for it here."""

    def __torch_dispatch__(self, function, types, arguments=(), options=None):
        result = function(*arguments, **(options or {}))
        assert result.dtype != torch.float64 or result.device.type == "cpu"
        return result


def test_returns_need_no_device_that_has_float64(needle_pick_meta):
    bank = SimpleNamespace(last=torch.zeros(200, dtype=torch.long), timestep=torch.zeros(200, device="meta"))
    with WithoutFloat64():
        assert _returns_to_go(needle_pick_meta, bank).device.type == "meta"


def test_a_window_ends_with_its_episode(policy, rewards):
    policy.eval()
    last = len(rewards[0]) - 1
    alone = policy.forward({"index": torch.tensor([last])})[0]
    policy._bank.items[ACTION][last + 1 :] = 9.0
    assert policy.forward({"index": torch.tensor([last])})[0] == alone


def test_the_unreduced_loss_has_an_entry_a_frame(policy):
    policy.eval()
    batch = {"index": torch.arange(0, 40, 10)}
    each, _ = policy.forward(batch, reduction="none")
    assert each.shape == (4,)
    assert each.mean().item() == pytest.approx(policy.forward(batch)[0].item(), rel=1e-5)


# Acting.


def test_it_acts_as_in_training(policy, rewards):
    policy.eval()
    items = {key: policy._bank.items[key][:7] for key in (STATE, GOAL, ACHIEVED_GOAL, ACTION)}
    policy.first_return.copy_(policy._returns[0, 0])
    for t in range(7):
        policy.select_action({key: value[t : t + 1] for key, value in items.items()})
        policy._history[ACTION][:, -1] = items[ACTION][t]  # as if it had done what the expert did
    frames = torch.arange(3, 7)[None]
    seen = {"return_to_go": policy._returns[frames], "seen": items[STATE][frames], ACTION: items[ACTION][frames]}
    again = policy._predict(policy._history, frames)
    torch.testing.assert_close(again, policy._predict(seen, frames))


def test_an_action_depends_on_the_context_and_on_nothing_before_it(policy):
    policy.eval()

    def play(first):
        policy.reset()
        actions = []
        for observed in [first, *(observation(2, seed) for seed in range(1, 5))]:
            actions.append(policy.select_action(observed).clone())
            policy._history[ACTION][:, -1] = 0.5  # both episodes did the same
        return actions

    same = map(torch.equal, play(observation(2, 0)), play(observation(2, 9)))
    assert list(same) == [False, False, False, False, True]


def test_the_future_is_out_of_sight(policy):
    policy.eval()
    draw = torch.Generator().manual_seed(0)
    window = {
        key: torch.randn(1, 4, size, generator=draw) for key, size in (("return_to_go", 1), ("seen", 19), (ACTION, 5))
    }
    before = policy._predict(window, torch.arange(4)[None])
    for key, value in window.items():
        changed = window | {key: value.clone()}
        changed[key][:, 2] += 1.0
        after = policy._predict(changed, torch.arange(4)[None])
        same = 3 if key == ACTION else 2  # an action is predicted before it is known
        assert torch.equal(after[:, :same], before[:, :same]), key
        assert not torch.equal(after[:, 3], before[:, 3]), key


@pytest.mark.parametrize("sees", [False, True])
def test_it_sees_the_goal_only_if_told_to(needle_pick_meta, sees):
    policy = make(needle_pick_meta, goal=sees)
    here = observation(2)
    elsewhere = here | {GOAL: here[GOAL] + 1.0}
    assert torch.equal(acted(policy, [here]), acted(policy, [elsewhere])) != sees


@pytest.mark.parametrize(("quantile", "choose"), [(1.0, max), (0.0, min)])
def test_return_to_go_starts_at_a_quantile_and_rises_to_zero(needle_pick_meta, rewards, quantile, choose):
    policy = make(needle_pick_meta, return_quantile=quantile, context_length=100)
    first = choose(map(sum, rewards))
    acted(policy, [observation(1)] * 60)
    asked = policy._history["return_to_go"][0, :, 0].tolist()
    assert asked == [min(first + t, 0) for t in range(60)]


def test_reset_forgets(policy):
    actions = acted(policy, [observation(3, seed) for seed in range(3)])
    policy.reset()
    assert torch.equal(policy.select_action(observation(3)), actions[0])


def test_a_saved_policy_acts_the_same(policy, tmp_path):
    episode = [observation(3, seed) for seed in range(6)]
    actions = acted(policy, episode)
    policy.save_pretrained(tmp_path)
    assert torch.equal(acted(DTPolicy.from_pretrained(tmp_path), episode), actions)


# Bad input.


def test_another_number_of_episodes_without_a_reset_is_an_error(policy):
    policy.select_action(observation(3))
    with pytest.raises(ValueError, match=r"holds 2 episodes, the running history 3; call policy.reset\(\)"):
        policy.select_action(observation(2))


def test_several_tasks_are_refused(uneven_meta):
    with pytest.raises(ValueError, match="dt learns one task"):
        make(uneven_meta)


def test_training_without_a_dataset_is_an_error(policy):
    config = copy.deepcopy(policy.config)
    with pytest.raises(RuntimeError, match="dataset_meta"):
        DTPolicy(config).forward({"index": torch.tensor([0])})


@pytest.mark.parametrize(
    "bad", [{"context_length": 0}, {"heads": 3}, {"dropout": 1.5}, {"return_quantile": -0.5}], ids=str
)
def test_a_bad_number_is_named(bad):
    [(name, value)] = bad.items()
    with pytest.raises(OptionError, match=name):
        DTConfig(**bad)
