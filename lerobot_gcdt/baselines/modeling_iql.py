"""Implicit Q-learning: cloning in which actions count more that were better than usual (Kostrikov et al. 2021)."""

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.modules import MLP, IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import IQLLoss, SoftUpdate, ValueEstimators

from lerobot_gcdt.baselines.configuration_iql import IQLConfig
from lerobot_gcdt.baselines.reward_learner import RewardLearner, Transitions


class Actor(nn.Module):
    """A normal distribution of actions whose mean depends on what is seen, and whose width does not."""

    def __init__(self, inputs: int, actions: int, hidden_sizes: tuple[int, ...]):
        super().__init__()
        self.network = MLP(inputs, actions, num_cells=hidden_sizes, activation_class=nn.ReLU)
        self.log_std = nn.Parameter(torch.zeros(actions))

    def forward(self, seen: Tensor) -> tuple[Tensor, Tensor]:
        """Returns mean, in [-1, 1], and standard deviation, shape (B, A)."""
        mean = self.network(seen).tanh()
        return mean, self.log_std.clamp(-5, 2).exp().expand_as(mean)


class IQLPolicy(RewardLearner, PreTrainedPolicy):
    """Implicit Q-learning on the demonstrations of one task, with the loss of torchrl.

    It learns the value of states and actions from the rewards of the demonstrations, -1 a step until the goal is
    reached, and imitates actions the more, the more they gained. At test time it takes the mean action. Nothing is
    relabelled; where an episode ends, its last state is taken to stay as it is.
    """

    config_class = IQLConfig
    name = "iql"

    def make_networks(self, inputs: int, actions: int) -> None:
        """Makes actor, value, the two action values, and the targets of these."""
        config, hidden = self.config, {"num_cells": self.config.hidden_sizes, "activation_class": nn.ReLU}
        actor = Actor(inputs, actions, config.hidden_sizes)
        distribution = TensorDictModule(actor, in_keys=["observation"], out_keys=["loc", "scale"])
        self.iql = IQLLoss(
            ProbabilisticActor(distribution, in_keys=["loc", "scale"], distribution_class=IndependentNormal),
            ValueOperator(MLP(inputs + actions, 1, **hidden), in_keys=["observation", "action"]),
            ValueOperator(MLP(inputs, 1, **hidden), in_keys=["observation"]),
            loss_function="l2",
            temperature=config.temperature,
            expectile=config.expectile,
        )
        self.iql.make_value_estimator(ValueEstimators.TD0, gamma=config.discount)
        self._targets = SoftUpdate(self.iql, tau=config.target_rate)

    def losses(self, transitions: Transitions) -> dict[str, Tensor]:
        """Returns the losses of actions, action values and values."""
        if self.training_step:
            self._targets.step()
        never = torch.zeros_like(transitions.reward, dtype=torch.bool)
        following = {"observation": transitions.then, "reward": transitions.reward, "done": never, "terminated": never}
        seen = {"observation": transitions.seen, "action": transitions.action, "next": following}
        losses = self.iql(TensorDict(seen, batch_size=[len(never)]))
        return {name: losses[name] for name in ("loss_actor", "loss_qvalue", "loss_value")}

    def act(self, seen: Tensor) -> Tensor:
        """Returns the mean actions, shape (B, A)."""
        with self.iql.actor_network_params.to_module(self.iql.actor_network):
            return self.iql.actor_network.get_dist(TensorDict({"observation": seen}, batch_size=[len(seen)])).mean
