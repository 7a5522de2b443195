"""PLAS: an autoencoder learns what demonstrators do, and a policy chooses among that what critics value most."""

import pytest
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class

from lerobot_gcdt import PLASPolicy
from lerobot_gcdt.baselines.configuration_plas import PLASConfig
from lerobot_gcdt.baselines.reward_learner import Transitions
from lerobot_gcdt.errors import OptionError

NETWORKS = ("encoder", "decoder", "latent_policy", "critics")


@pytest.fixture
def policy(needle_pick_meta):
    torch.manual_seed(0)
    config = PLASConfig(hidden_sizes=(32, 32), device="cpu", push_to_hub=False)
    return PLASPolicy(config, dataset_meta=needle_pick_meta)


@pytest.fixture
def transitions(policy):
    """Steps of 16 random states."""
    seen, then = torch.randn(2, 16, 25)
    return Transitions(seen, torch.rand(16, 5) * 2 - 1, -torch.ones(16, 1), then)


def test_lerobot_knows_it_by_name():
    assert PreTrainedConfig.get_choice_class("plas") is PLASConfig
    assert get_policy_class("plas") is PLASPolicy


@pytest.mark.parametrize(
    ("loss", "moved"),
    [
        ("autoencoder_loss", {"encoder", "decoder"}),
        ("critics_loss", {"critics"}),
        ("policy_loss", {"latent_policy"}),
    ],
)
def test_a_loss_moves_its_own_networks_only(policy, transitions, loss, moved):
    getattr(policy, loss)(transitions).backward()
    for name in NETWORKS:
        gradients = [weight.grad for weight in getattr(policy, name).parameters()]
        if name in moved:
            assert all(gradient.any() for gradient in gradients)
        else:
            assert gradients == [None] * len(gradients)


def test_training_lowers_the_error_of_the_actions(policy, train):
    batch = {"index": torch.arange(200)}
    before = policy.eval().forward(batch)[0]
    assert train(policy, 150).forward(batch)[0] < before / 2


def test_weighted_samples_are_refused_in_training(policy):
    batch = {"index": torch.arange(4)}
    with pytest.raises(OptionError, match="type plas cannot weight the samples .* leave out sample_weighting"):
        policy.train().forward(batch, reduction="none")
    assert policy.eval().forward(batch, reduction="none")[0].shape == (4,)


def test_decoded_actions_stay_within_the_action_space(policy):
    actions = policy.decoder(torch.randn(500, 25) * 100, torch.randn(500, 10) * 100)
    assert actions.abs().max() <= 1 and actions.abs().max() > 0.99


def test_latent_actions_stay_within_their_maximum(policy):
    latent = policy.latent_policy(torch.randn(500, 25) * 100)
    assert latent.shape == (500, 10) and latent.abs().max() <= 2 and latent.abs().max() > 1.9


def test_it_prefers_the_better_of_two_things_that_demonstrators_do(policy):
    """Half of the demonstrators go left, which costs a step, half go right, which costs none; then nothing follows."""
    policy.config.discount = 1e-6
    optimiser = torch.optim.AdamW(policy.get_optim_params(), lr=3e-3)
    for _ in range(400):
        seen, right = torch.randn(64, 25), torch.rand(64, 1).round()
        action = (right * 1.2 - 0.6).expand(64, 5)
        losses = policy.losses(Transitions(seen, action, right - 1, seen))
        sum(losses.values()).backward()
        optimiser.step()
        optimiser.zero_grad()
    assert (policy.act(torch.randn(100, 25)) - 0.6).abs().max() < 0.3


def test_targets_are_between_the_two_action_values(policy, transitions):
    """Where the target is known, so is the loss of critics that say nothing else but 0 and -4."""
    for critics in (policy.critics, policy.slow_critics):
        for weight in [*critics.parameters(), *critics.buffers()]:
            weight.data.zero_()
    for bias in (policy.critics.networks[1][-1].bias, policy.slow_critics.get_buffer("networks/1/4/bias")):
        bias.data.fill_(-4)
    target = -1 + 0.99 * (0.75 * -4 + 0.25 * 0)
    expected = ((0 - target) ** 2 + (-4 - target) ** 2) / 2
    assert policy.critics_loss(transitions).item() == pytest.approx(expected, rel=1e-5)


def test_targets_follow_slowly_and_are_no_parameters(policy, train):
    start = [weight.clone() for weight in policy.critics.parameters()]
    train(policy, 3).train()
    for before, slow, now in zip(start, policy.slow_critics.buffers(), policy.critics.parameters(), strict=True):
        assert 0 < (slow - before).abs().sum() < (now - before).abs().sum() / 10
    assert not any(name.startswith("slow_") for name, _ in policy.named_parameters())


@pytest.mark.parametrize("mode", [True, False], ids=["in training", "in evaluation"])
def test_what_is_saved_acts_and_trains_on_alike(policy, train, observation, needle_pick_meta, tmp_path, mode):
    train(policy, 3).train(mode).save_pretrained(tmp_path)
    policy.eval()
    loaded = PLASPolicy.from_pretrained(tmp_path, dataset_meta=needle_pick_meta)
    assert torch.equal(loaded.select_action(observation), policy.select_action(observation))

    def loss(learner):
        torch.manual_seed(0)
        return learner.train().forward({"index": torch.arange(0, 200, 20)})[0]

    assert torch.equal(loss(loaded), loss(policy))


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"max_latent": 0.0}, "max_latent must be positive, got 0.0"),
        ({"latents_per_action": 0}, "latents_per_action must be positive, got 0"),
        ({"kl_weight": -1.0}, "kl_weight must be positive, got -1.0"),
        ({"worse_weight": 1.5}, "worse_weight must lie in .0, 1., got 1.5"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_bad_options_are_named(changed, told):
    with pytest.raises(OptionError, match=told):
        PLASConfig(**changed)
