"""PLAS: a policy that chooses among what a demonstrator might have done (Zhou, Bajracharya and Held 2020)."""

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from torch import Tensor

from lerobot_gcdt.baselines.configuration_plas import PLASConfig
from lerobot_gcdt.baselines.latent_actions import Critics, Decoder, Encoder, LatentPolicy, SlowWeights, held_fixed
from lerobot_gcdt.baselines.reward_learner import RewardLearner, Transitions


class PLASPolicy(RewardLearner, PreTrainedPolicy):
    """PLAS, a policy in the latent space of the demonstrators' actions, on the demonstrations of one task.

    An autoencoder learns what demonstrators do in a state, critics learn from the rewards, -1 a step until the goal is
    reached, how good an action is, and a policy learns which latent action they value most. At test time that one is
    decoded.

    Unlike in the paper the autoencoder is not trained first and frozen: all networks learn in every step.
    The learning rate falls over the whole of a training, and what is frozen early would stay as coarse as it was at the
    peak. The critics judge actions, not latent ones, so what they know holds while the decoder changes; the policy
    follows it. The paper's optional perturbation of the decoded action is left out. Nothing is relabelled.
    """

    config_class = PLASConfig
    name = "plas"

    def make_networks(self, inputs: int, actions: int) -> None:
        """Makes encoder, decoder, policy, critics, and the targets of the last two."""
        config = self.config
        latents, hidden = config.latents_per_action * actions, config.hidden_sizes
        self.encoder = Encoder(inputs, actions, latents, hidden)
        self.decoder = Decoder(inputs, latents, actions, hidden)
        self.latent_policy = LatentPolicy(inputs, latents, config.max_latent, hidden)
        self.critics = Critics(inputs, actions, hidden)
        self.slow_policy = SlowWeights(self.latent_policy)
        self.slow_critics = SlowWeights(self.critics)

    def losses(self, transitions: Transitions) -> dict[str, Tensor]:
        """Returns the losses of the autoencoder, of the critics and of the policy, none of which moves the others."""
        return {
            "loss_autoencoder": self.autoencoder_loss(transitions),
            "loss_critics": self.critics_loss(transitions),
            "loss_policy": self.policy_loss(transitions),
        }

    def act(self, seen: Tensor) -> Tensor:
        """Returns what the policy's latent actions stand for, shape (B, A)."""
        return self.decoder(seen, self.latent_policy(seen))

    def autoencoder_loss(self, transitions: Transitions) -> Tensor:
        """Returns squared error and weighted divergence, each summed over the numbers of an action."""
        mean, log_std = self.encoder(transitions.seen, transitions.action)
        latent = mean + log_std.exp() * torch.randn_like(mean)
        error = (self.decoder(transitions.seen, latent) - transitions.action).square().sum(-1)
        divergence = (0.5 * (mean.square() + (2 * log_std).exp() - 1) - log_std).sum(-1)
        return (error + self.config.kl_weight * divergence).mean()

    def critics_loss(self, transitions: Transitions) -> Tensor:
        """Returns the squared error of both action values, after the targets have followed the networks."""
        config = self.config
        self.slow_policy.follow(self.latent_policy, config.target_rate)
        self.slow_critics.follow(self.critics, config.target_rate)
        with torch.no_grad():
            latent = self.slow_policy(self.latent_policy, transitions.then)
            values = self.slow_critics(self.critics, transitions.then, self.decoder(transitions.then, latent))
            smaller, larger = values.aminmax(dim=0)
            target = transitions.reward + config.discount * larger.lerp(smaller, config.worse_weight)
        return (self.critics(transitions.seen, transitions.action) - target).square().mean()

    def policy_loss(self, transitions: Transitions) -> Tensor:
        """Returns the negative value of the policy's actions, as the first critic judges them."""
        action = held_fixed(self.decoder, transitions.seen, self.latent_policy(transitions.seen))
        return -held_fixed(self.critics, transitions.seen, action)[0].mean()
