"""Implicit Q-learning: cloning in which actions count more that were better than usual (Kostrikov et al. 2021)."""

from collections.abc import Iterator

import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.policies.pretrained import PreTrainedPolicy
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.modules import MLP, IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import IQLLoss, SoftUpdate, ValueEstimators

from lerobot_gcdt.averaging import AveragedWeights
from lerobot_gcdt.baselines.configuration_iql import IQLConfig
from lerobot_gcdt.baselines.one_task import open_one_task, state_and_goal, to_train_on, training_frames
from lerobot_gcdt.data.acting_batch import with_goals
from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.data.statistics import mean_and_std
from lerobot_gcdt.keys import ACTION, REWARD, STATE


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


class IQLPolicy(AveragedWeights, PreTrainedPolicy):
    """Implicit Q-learning on the demonstrations of one task, with the loss of torchrl.

    It learns the value of states and actions from the rewards of the demonstrations, -1 a step until the goal is
    reached, and imitates actions the more, the more they gained. At test time it takes the mean action. Nothing is
    relabelled; where an episode ends, its last state is taken to stay as it is.

    Args:
        config: The configuration.
        dataset_stats: Unused; LeRobot passes it to every policy.
        dataset_meta: Metadata of the dataset to train on, None for inference.

    Raises:
        ValueError: The dataset holds several tasks.
    """

    config_class = IQLConfig
    name = "iql"

    def __init__(
        self,
        config: IQLConfig,
        dataset_stats: dict | None = None,
        dataset_meta: LeRobotDatasetMetadata | None = None,
    ):
        super().__init__(config)
        self._bank = None if dataset_meta is None else open_one_task(dataset_meta, config)
        [(state, goal, action)] = config.task_dims.values()
        inputs, hidden = state + 2 * goal, {"num_cells": config.hidden_sizes, "activation_class": nn.ReLU}
        self.register_buffer("mean", torch.zeros(inputs))
        self.register_buffer("std", torch.ones(inputs))
        self.register_buffer("training_step", torch.tensor(0))
        """Batches that training has seen; what is drawn for a frame changes with it."""
        actor = Actor(inputs, action, config.hidden_sizes)
        distribution = TensorDictModule(actor, in_keys=["observation"], out_keys=["loc", "scale"])
        self.iql = IQLLoss(
            ProbabilisticActor(distribution, in_keys=["loc", "scale"], distribution_class=IndependentNormal),
            ValueOperator(MLP(inputs + action, 1, **hidden), in_keys=["observation", "action"]),
            ValueOperator(MLP(inputs, 1, **hidden), in_keys=["observation"]),
            loss_function="l2",
            temperature=config.temperature,
            expectile=config.expectile,
        )
        self.iql.make_value_estimator(ValueEstimators.TD0, gamma=config.discount)
        self._targets = SoftUpdate(self.iql, tau=config.target_rate)
        if self._bank is not None and dataset_meta is not None:
            mean, std = mean_and_std(state_and_goal(training_frames(self._bank)[0]))
            self.mean.copy_(mean)
            self.std.copy_(std)
            self._rewards = torch.from_numpy(read_columns(dataset_meta.root, [REWARD])[REWARD]).float()
        self.keep_average(config.average_steps)

    def forward(self, batch: dict[str, Tensor], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Computes the sum of the losses of actions, action values and values.

        In evaluation mode every frame stands for itself, and the loss is the mean squared error of its action. In
        training mode ``frames_per_sample`` frames are drawn for it, from all episodes that are trained on and anew in
        each call.

        Args:
            batch: As LeRobot's loader gives it; of it only ``index``, shape (B,), is used.
            reduction: ``"mean"``, or ``"none"`` for the error of each frame's action.

        Returns:
            The loss, and what to log.

        Raises:
            RuntimeError: The policy was made without a dataset.
        """
        index = batch["index"].to(self.mean.device)
        bank = to_train_on(self._bank, index.device)
        if not self.training or reduction == "none":
            items = {key: value[index] for key, value in bank.items.items()}
            errors = (self._mean_action(items) - items[ACTION]).square().mean(-1)
            return (errors if reduction == "none" else errors.mean()), {"action_loss": errors.mean().item()}
        self.average_weights()
        if self.training_step:
            self._targets.step()
        now = bank.draw_pieces(index, 1, self.training_step, self.config.frames_per_sample).first
        self.training_step += 1
        then = torch.minimum(now + 1, bank.last[now])
        never = torch.zeros(len(now), 1, dtype=torch.bool, device=now.device)
        self._rewards = self._rewards.to(now.device)
        following = {"reward": self._rewards[now][:, None], "done": never, "terminated": never}
        following["observation"] = self._seen({key: value[then] for key, value in bank.items.items()})
        items = {key: value[now] for key, value in bank.items.items()}
        seen = {"observation": self._seen(items), "action": items[ACTION], "next": following}
        losses = self.iql(TensorDict(seen, batch_size=[len(now)]))
        parts = {name: losses[name] for name in ("loss_actor", "loss_qvalue", "loss_value")}
        return sum(parts.values()), {name: part.item() for name, part in parts.items()}

    @torch.no_grad()
    def select_action(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns the action of each row of ``observation.*``, shape (B, A); a robot's state may hold the goals."""
        return self._mean_action(with_goals(batch, self.config.task_dims))

    def predict_action_chunk(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns ``select_action`` as a chunk of one step, shape (B, 1, A)."""
        return self.select_action(batch)[:, None]

    def reset(self) -> None:
        """Does nothing: there is no memory."""

    def get_optim_params(self) -> Iterator[nn.Parameter]:
        """Returns the parameters of actor, values and action values."""
        return self.parameters()

    def _mean_action(self, items: dict[str, Tensor]) -> Tensor:
        seen = TensorDict({"observation": self._seen(items)}, batch_size=[len(items[STATE])])
        with self.iql.actor_network_params.to_module(self.iql.actor_network):
            return self.iql.actor_network.get_dist(seen).mean

    def _seen(self, items: dict[str, Tensor]) -> Tensor:
        return (state_and_goal(items) - self.mean) / self.std
