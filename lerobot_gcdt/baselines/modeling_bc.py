"""Behavioural cloning with a perceptron: the baseline that a sequence model has to beat."""

import itertools
from typing import Any

import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.policies.pretrained import PreTrainedPolicy
from torch import Tensor, nn

from lerobot_gcdt.averaging import AveragedWeights
from lerobot_gcdt.baselines.configuration_bc import BCConfig
from lerobot_gcdt.baselines.one_task import open_one_task, state_and_goal, to_train_on, training_frames
from lerobot_gcdt.data.acting_batch import with_goals
from lerobot_gcdt.data.statistics import mean_and_std, mean_of_each
from lerobot_gcdt.data.trajectories import TrajectoryBank
from lerobot_gcdt.keys import ACTION
from lerobot_gcdt.precision import training_precision


class BCPolicy(AveragedWeights, PreTrainedPolicy):
    """A perceptron trained by behavioural cloning, the baseline beside GCDT.

    It maps observation and goal to the action, and learns from hindsight-relabelled frames of one task.

    Args:
        config: The configuration.
        dataset_stats: Unused; LeRobot passes it to every policy.
        dataset_meta: Metadata of the dataset to train on, None for inference.

    Raises:
        ValueError: The dataset holds several tasks.
    """

    config_class = BCConfig
    name = "bc"

    def __init__(
        self,
        config: BCConfig,
        dataset_stats: dict | None = None,
        dataset_meta: LeRobotDatasetMetadata | None = None,
    ):
        super().__init__(config)
        self._bank: TrajectoryBank | None = None
        if dataset_meta is not None:
            self._bank = open_one_task(dataset_meta, config)
        [(state, goal, action)] = config.task_dims.values()
        inputs = state + goal * (2 if config.relative_goal else 1)
        self.register_buffer("mean", torch.zeros(inputs))
        self.register_buffer("std", torch.ones(inputs))
        self.register_buffer("training_step", torch.tensor(0))
        """Batches that training has seen; what is drawn for a frame changes with it."""
        sizes = [inputs, *config.hidden_sizes]
        regularised = nn.Sequential(nn.ReLU(), nn.Dropout(config.dropout))
        layers = [(nn.Linear(a, b), regularised) for a, b in itertools.pairwise(sizes)]
        self.network = nn.Sequential(*itertools.chain(*layers), nn.Linear(sizes[-1], action), nn.Tanh())
        if self._bank is not None:
            mean, std = mean_and_std(state_and_goal(training_frames(self._bank)[0], config.relative_goal))
            self.mean.copy_(mean)
            self.std.copy_(std)
        self.keep_average(config.average_steps)

    def forward(self, batch: dict[str, Tensor], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Computes the mean squared error of the actions.

        In evaluation mode every frame stands for its episode. In training mode ``frames_per_sample`` frames are drawn
        for it, from all episodes that are trained on and anew in each call.

        Args:
            batch: As LeRobot's loader gives it; of it only ``index``, shape (B,), is used.
            reduction: ``"mean"``, or ``"none"`` for one loss a frame.

        Returns:
            The loss, and what to log.

        Raises:
            RuntimeError: The policy was made without a dataset.
        """
        index = batch["index"].to(self.mean.device)
        bank, config = to_train_on(self._bank, index.device), self.config
        if self.training:
            self.average_weights()
            pieces = bank.draw_pieces(index, 1, self.training_step, config.frames_per_sample)
            self.training_step += 1
        else:
            pieces = bank.pieces(index, 1)
        cuts = bank.draw_cuts(pieces, config.hindsight_ratio if self.training else 0.0)
        items = {key: value[:, 0] for key, value in bank.sequences(pieces, cuts).items.items()}
        with training_precision(config.dtype, index.device.type):
            errors = (self._act(items) - items[ACTION]).square().mean(-1)
        if reduction == "none":
            return mean_of_each(errors, pieces.source, len(index)), {}
        return errors.mean(), {"action_loss": errors.mean().item()}

    @torch.no_grad()
    def select_action(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns the action of each row of ``observation.*``, shape (B, A); a robot's state may hold the goals."""
        return self._act(with_goals(batch, self.config.task_dims))

    def predict_action_chunk(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns ``select_action`` as a chunk of one step, shape (B, 1, A)."""
        return self.select_action(batch)[:, None]

    def reset(self) -> None:
        """Does nothing: there is no memory."""

    def get_optim_params(self) -> list[dict[str, Any]]:
        """Returns all parameters, to be updated by PyTorch's fused optimiser."""
        return [{"params": list(self.parameters()), "fused": True}]

    def _act(self, items: dict[str, Tensor]) -> Tensor:
        inputs = (state_and_goal(items, self.config.relative_goal) - self.mean) / self.std
        # Corrections near a goal are small beside the observations; only the layers between may work in bfloat16.
        last = len(self.network) - 2
        first = min(2, last)
        with torch.autocast(inputs.device.type, enabled=False):
            hidden = self.network[:first](inputs)
        hidden = self.network[first:last](hidden)
        with torch.autocast(inputs.device.type, enabled=False):
            return self.network[last:](hidden.float())
