"""What the baselines have in common that learn from the rewards of one task's demonstrations."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.optim.optimizers import AdamWConfig
from lerobot.optim.schedulers import CosineDecayWithWarmupSchedulerConfig
from torch import Tensor, nn

from lerobot_gcdt.averaging import AveragedWeights, AveragedWeightsConfig
from lerobot_gcdt.baselines.one_task import open_one_task, state_and_goal, to_train_on, training_frames, whole_cosine
from lerobot_gcdt.data.acting_batch import with_goals
from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.data.single_frames import SingleFrames
from lerobot_gcdt.data.statistics import mean_and_std
from lerobot_gcdt.data.trajectories import TrajectoryBank
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.keys import ACTION, REWARD


class Transitions(NamedTuple):
    """Frames of demonstrations, and what each led to.

    Attributes:
        seen: Observation, goal and what is left to the goal, standardised, shape (N, I).
        action: The demonstrator's action, shape (N, A).
        reward: -1 until the goal is reached, then 0, shape (N, 1).
        then: What is seen a step later, shape (N, I). After its last frame an episode is taken to stay as it is.
    """

    seen: Tensor
    action: Tensor
    reward: Tensor
    then: Tensor


@dataclass
class RewardLearnerConfig(AveragedWeightsConfig, SingleFrames):
    """Configuration of a ``RewardLearner``.

    Attributes:
        hidden_sizes: Sizes of the hidden layers of each of its perceptrons.
        discount: Share of a reward that is left a step later.
        target_rate: Share of the way to the networks in training that their targets go in a step.
        frames_per_sample: Training frames that are drawn for each sample of a batch.
        task_dims: Sizes ``[observation, goal, action]`` of the task, by task sentence. Filled from the dataset.
        optimizer_lr: Peak learning rate of AdamW, decayed along a cosine over the whole training.
    """

    hidden_sizes: tuple[int, ...] = (256, 256, 256)
    discount: float = 0.99
    target_rate: float = 0.005
    frames_per_sample: int = 32
    task_dims: dict[str, list[int]] = field(default_factory=dict)
    optimizer_lr: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.frames_per_sample < 1:
            raise OptionError(f"policy.frames_per_sample must be positive, got {self.frames_per_sample}.")
        for name in ("discount", "target_rate"):
            if not 0 < getattr(self, name) <= 1:
                raise OptionError(f"policy.{name} must lie in (0, 1], got {getattr(self, name)}.")

    def get_optimizer_preset(self) -> AdamWConfig:
        """Returns AdamW."""
        return AdamWConfig(lr=self.optimizer_lr, weight_decay=1e-4, grad_clip_norm=1.0)

    def get_scheduler_preset(self) -> CosineDecayWithWarmupSchedulerConfig:
        """Returns ``whole_cosine``."""
        return whole_cosine(self.optimizer_lr)


class RewardLearner(AveragedWeights):
    """What a LeRobot policy inherits, before ``PreTrainedPolicy``, that learns from frames and the ones after them.

    Args:
        config: The configuration.
        dataset_stats: Unused; LeRobot passes it to every policy.
        dataset_meta: Metadata of the dataset to train on, None for inference.

    Raises:
        ValueError: The dataset holds several tasks.
    """

    def __init__(
        self,
        config: RewardLearnerConfig,
        dataset_stats: dict | None = None,
        dataset_meta: LeRobotDatasetMetadata | None = None,
    ):
        super().__init__(config)
        self._bank = None if dataset_meta is None else open_one_task(dataset_meta, config)
        [(state, goal, action)] = config.task_dims.values()
        inputs = state + 2 * goal
        self.register_buffer("mean", torch.zeros(inputs))
        self.register_buffer("std", torch.ones(inputs))
        self.register_buffer("training_step", torch.tensor(0))
        """Batches that training has seen; what is drawn for a frame changes with it."""
        self.make_networks(inputs, action)
        if self._bank is not None and dataset_meta is not None:
            mean, std = mean_and_std(state_and_goal(training_frames(self._bank)[0]))
            self.mean.copy_(mean)
            self.std.copy_(std)
            self._rewards = torch.from_numpy(read_columns(dataset_meta.root, [REWARD])[REWARD]).float()
        self.keep_average(config.average_steps)

    @abstractmethod
    def make_networks(self, inputs: int, actions: int) -> None:
        """Makes the networks; a part of the constructor.

        Args:
            inputs: Numbers that are seen, I.
            actions: Numbers of an action, A.
        """

    @abstractmethod
    def losses(self, transitions: Transitions) -> dict[str, Tensor]:
        """Returns the losses of a step of training, by the name under which they are logged."""

    @abstractmethod
    def act(self, seen: Tensor) -> Tensor:
        """Returns the actions to take, shape (B, A), from what is seen, standardised, shape (B, I)."""

    def forward(self, batch: dict[str, Tensor], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Computes the sum of ``losses``.

        In evaluation mode every frame stands for itself, and the loss is the mean squared error of its action. In
        training mode ``frames_per_sample`` frames are drawn for it, from all episodes that are trained on and anew in
        each call.

        Args:
            batch: As LeRobot's loader gives it; of it only ``index``, shape (B,), is used.
            reduction: ``"mean"``, or, in evaluation mode, ``"none"`` for the error of each frame's action.

        Returns:
            The loss, and what to log.

        Raises:
            OptionError: The error of each frame is asked for in training mode, as ``--sample_weighting.*`` does.
            RuntimeError: The policy was made without a dataset.
        """
        index = batch["index"].to(self.mean.device)
        bank = to_train_on(self._bank, index.device)
        if self.training and reduction == "none":
            raise OptionError(
                f"A policy of type {self.config.type} cannot weight the samples of a batch, for which it draws others; "
                "leave out sample_weighting."
            )
        if not self.training:
            items = {key: value[index] for key, value in bank.items.items()}
            errors = (self.act(self._seen(items)) - items[ACTION]).square().mean(-1)
            return (errors if reduction == "none" else errors.mean()), {"action_loss": errors.mean().item()}
        self.average_weights()
        losses = self.losses(self._draw(bank, index))
        self.training_step += 1
        return torch.stack([*losses.values()]).sum(), {name: loss.item() for name, loss in losses.items()}

    @torch.no_grad()
    def select_action(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns the action of each row of ``observation.*``, shape (B, A); a robot's state may hold the goals."""
        return self.act(self._seen(with_goals(batch, self.config.task_dims)))

    def predict_action_chunk(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns ``select_action`` as a chunk of one step, shape (B, 1, A)."""
        return self.select_action(batch)[:, None]

    def reset(self) -> None:
        """Does nothing: there is no memory."""

    def get_optim_params(self) -> Iterator[nn.Parameter]:
        """Returns the parameters of all networks but the targets."""
        return self.parameters()

    def _draw(self, bank: TrajectoryBank, index: Tensor) -> Transitions:
        now = bank.draw_pieces(index, 1, self.training_step, self.config.frames_per_sample).first
        then = torch.minimum(now + 1, bank.last[now])
        self._rewards = self._rewards.to(now.device)
        items, following = ({key: value[frames] for key, value in bank.items.items()} for frames in (now, then))
        return Transitions(self._seen(items), items[ACTION], self._rewards[now][:, None], self._seen(following))

    def _seen(self, items: dict[str, Tensor]) -> Tensor:
        return (state_and_goal(items) - self.mean) / self.std
