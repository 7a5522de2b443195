"""Nearest neighbours: what the demonstrations did where they saw nearly the same (Pari et al. 2021)."""

from collections.abc import Iterator

import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.policies.pretrained import PreTrainedPolicy
from torch import Tensor, nn

from lerobot_gcdt.baselines.configuration_vinn import VINNConfig
from lerobot_gcdt.baselines.one_task import open_one_task, state_and_goal, to_train_on, training_frames
from lerobot_gcdt.data.acting_batch import with_goals
from lerobot_gcdt.data.statistics import mean_and_std
from lerobot_gcdt.keys import ACTION

NEIGHBOURS = (1, 2, 4, 8, 16, 32, 64)
TEMPERATURES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
"""What is chosen from; the numbers of the observation, and so their distances, are standardised."""

QUERIES = 2_000
"""Frames that the choice is made by, spread evenly over the dataset."""


class VINNPolicy(PreTrainedPolicy):
    """Nearest neighbours in observation and goal, whose actions are averaged by their distance.

    That is the second half of VINN; its first, an encoder of pictures, has nothing to do where the state is known. The
    checkpoint holds all frames of the demonstrations of one task. The number of neighbours and the temperature are
    those with the smallest error of the actions where a frame's own episode is left out.

    Nothing is learned. For LeRobot's trainer the temperature is a parameter with a learning rate of 0, and one step
    is enough.

    Args:
        config: The configuration.
        dataset_stats: Unused; LeRobot passes it to every policy.
        dataset_meta: Metadata of the dataset whose frames are kept, None for inference.

    Raises:
        ValueError: The dataset holds several tasks.
    """

    config_class = VINNConfig
    name = "vinn"

    def __init__(
        self,
        config: VINNConfig,
        dataset_stats: dict | None = None,
        dataset_meta: LeRobotDatasetMetadata | None = None,
    ):
        super().__init__(config)
        self._bank = None if dataset_meta is None else open_one_task(dataset_meta, config)
        if self._bank is not None:
            items, self._episode = training_frames(self._bank)
            config.frames = len(self._episode)
        [(state, goal, action)] = config.task_dims.values()
        self.register_buffer("mean", torch.zeros(state + 2 * goal))
        self.register_buffer("std", torch.ones(state + 2 * goal))
        self.register_buffer("seen", torch.zeros(config.frames, state + 2 * goal))
        """Observation, goal and what is left to it, of all frames, standardised."""
        self.register_buffer("actions", torch.zeros(config.frames, action))
        if self._bank is not None:
            seen = state_and_goal(items)
            mean, std = mean_and_std(seen)
            self.mean.copy_(mean)
            self.std.copy_(std)
            self.seen.copy_((seen - mean) / std)
            self.actions.copy_(items[ACTION])
        # The configuration stays as it was asked for, so that the same command asks for the same again.
        neighbours, temperature = (config.neighbours, config.temperature) if self._bank is None else self._choose()
        self.register_buffer("neighbours", torch.tensor(neighbours))
        self.temperature = nn.Parameter(torch.tensor(temperature))

    def forward(self, batch: dict[str, Tensor], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Computes the mean squared error of the actions, each from the other episodes.

        Args:
            batch: As LeRobot's loader gives it; of it only ``index``, shape (B,), is used.
            reduction: ``"mean"``, or ``"none"`` for one loss a frame.

        Returns:
            The loss, and what to log.

        Raises:
            RuntimeError: The policy was made without a dataset.
        """
        index = batch["index"].to(self.seen.device)
        bank = to_train_on(self._bank, index.device)
        self._episode = self._episode.to(index.device)
        seen = (state_and_goal({key: value[index] for key, value in bank.items.items()}) - self.mean) / self.std
        distance, nearest = self._nearest(seen, int(self.neighbours), bank.first[index])
        errors = (self._average(distance, nearest, self.temperature) - bank.items[ACTION][index]).square().mean(-1)
        if reduction == "none":
            return errors, {}
        return errors.mean(), {"action_loss": errors.mean().item()}

    @torch.no_grad()
    def select_action(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns the action of each row of ``observation.*``, shape (B, A); a robot's state may hold the goals."""
        seen = (state_and_goal(with_goals(batch, self.config.task_dims)) - self.mean) / self.std
        return self._average(*self._nearest(seen, int(self.neighbours)), self.temperature)

    def predict_action_chunk(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns ``select_action`` as a chunk of one step, shape (B, 1, A)."""
        return self.select_action(batch)[:, None]

    def reset(self) -> None:
        """Does nothing: there is no memory."""

    def get_optim_params(self) -> Iterator[nn.Parameter]:
        """Returns the temperature."""
        return self.parameters()

    def _nearest(self, seen: Tensor, count: int, episode: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Finds the nearest frames, of other episodes where these are given; distances and places, shape (B, K)."""
        distance = torch.cdist(seen, self.seen)
        if episode is not None:
            distance = distance.masked_fill(self._episode == episode[:, None], torch.inf)
        distance, nearest = distance.topk(min(count, len(self.seen)), largest=False)
        return distance, nearest

    def _average(self, distance: Tensor, nearest: Tensor, temperature: Tensor | float) -> Tensor:
        """Averages actions with the weights exp(-distance / temperature), shape (B, A)."""
        weight = (-distance / temperature).softmax(-1)
        return (weight[..., None] * self.actions[nearest]).sum(-2)

    def _choose(self) -> tuple[int, float]:
        """Chooses what is not set, by the error of frames whose own episode is left out."""
        config = self.config
        counts = [config.neighbours] if config.neighbours else NEIGHBOURS
        temperatures = [config.temperature] if config.temperature else TEMPERATURES
        if len(counts) == len(temperatures) == 1 or len(self._episode.unique()) == 1:
            return counts[0], temperatures[0]
        queries = torch.arange(0, len(self.seen), max(1, len(self.seen) // QUERIES), device=self.seen.device)
        distance, nearest = self._nearest(self.seen[queries], max(counts), self._episode[queries])
        errors = {}
        for count in counts:
            for temperature in temperatures:
                actions = self._average(distance[:, :count], nearest[:, :count], temperature)
                errors[count, temperature] = float((actions - self.actions[queries]).square().mean())
        return min(errors, key=lambda choice: errors[choice])
