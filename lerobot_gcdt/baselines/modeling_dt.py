"""The decision transformer, conditioned on the return that is still to come (Chen et al. 2021)."""

from collections.abc import Iterator

import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.policies.pretrained import PreTrainedPolicy
from torch import Tensor, nn

from lerobot_gcdt.averaging import AveragedWeights
from lerobot_gcdt.baselines.configuration_dt import DTConfig
from lerobot_gcdt.baselines.one_task import open_one_task, state_and_goal, to_train_on, training_frames
from lerobot_gcdt.data.acting_batch import with_goals
from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.data.statistics import mean_and_std, mean_of_each
from lerobot_gcdt.data.trajectories import TrajectoryBank
from lerobot_gcdt.keys import ACTION, REWARD, STATE

RETURN, SEEN = "return_to_go", "seen"
ORDER = (RETURN, SEEN, ACTION)
"""The tokens of a step, in their order."""


class DTPolicy(AveragedWeights, PreTrainedPolicy):
    """A decision transformer, the paper's rival of GCDT.

    It reads return-to-go, observation and action of the last steps, and learns from the demonstrations of one task as
    they are, without relabelling. Unless ``config.goal`` says otherwise it does not see the goal.

    At test time no reward is given to a policy of LeRobot's. A step costs 1 until the goal is reached, and nothing more
    can be lost from then on; so the return-to-go rises by 1 a step up to 0. That is what subtracting the rewards gives
    up to the first success or to the step at which the demonstration that it began with would have succeeded. After an
    earlier success, the rewards would leave it where it is.

    Args:
        config: The configuration.
        dataset_stats: Unused; LeRobot passes it to every policy.
        dataset_meta: Metadata of the dataset to train on, None for inference.

    Raises:
        ValueError: The dataset holds several tasks.
    """

    config_class = DTConfig
    name = "dt"

    def __init__(
        self,
        config: DTConfig,
        dataset_stats: dict | None = None,
        dataset_meta: LeRobotDatasetMetadata | None = None,
    ):
        super().__init__(config)
        self._bank = None if dataset_meta is None else open_one_task(dataset_meta, config)
        [(state, goal, action)] = config.task_dims.values()
        self._action_size = action
        sizes = {RETURN: 1, SEEN: state + 2 * goal if config.goal else state, ACTION: action}
        self.register_buffer("mean", torch.zeros(sizes[SEEN]))
        self.register_buffer("std", torch.ones(sizes[SEEN]))
        self.register_buffer("first_return", torch.zeros(()))
        """Return-to-go at the beginning of an episode, also the unit in which it is read."""
        self.register_buffer("training_step", torch.tensor(0))
        """Batches that training has seen; what is drawn for a frame changes with it."""
        width = config.width
        self.tokenizers = nn.ModuleDict({key: nn.Linear(size, width) for key, size in sizes.items()})
        self.timestep_embedding = nn.Embedding(config.max_timesteps, width)
        self.norm = nn.LayerNorm(width)
        block = nn.TransformerEncoderLayer(
            width, config.heads, 4 * width, config.dropout, nn.functional.gelu, batch_first=True, norm_first=True
        )
        last_norm = nn.LayerNorm(width)
        self.transformer = nn.TransformerEncoder(block, config.layers, last_norm, enable_nested_tensor=False)
        self.head = nn.Sequential(nn.Linear(width, action), nn.Tanh())
        if dataset_meta is not None and self._bank is not None:
            self._returns = _returns_to_go(dataset_meta, self._bank)
            mean, std = mean_and_std(self._seen(training_frames(self._bank)[0]))
            returns = self._returns[self._bank.training_starts(0), 0]
            self.mean.copy_(mean)
            self.std.copy_(std)
            self.first_return.copy_(returns.quantile(config.return_quantile))
        self.keep_average(config.average_steps)
        self.reset()

    def forward(self, batch: dict[str, Tensor], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Computes the mean squared error of the actions.

        In evaluation mode every frame begins a window of ``context_length`` steps. In training mode
        ``windows_per_sample`` windows are drawn for it, from all episodes that are trained on and anew in each call.

        Args:
            batch: As LeRobot's loader gives it; of it only ``index``, shape (B,), is used.
            reduction: ``"mean"``, or ``"none"`` for one loss a frame.

        Returns:
            The loss, and what to log.

        Raises:
            RuntimeError: The policy was made without a dataset.
        """
        index = batch["index"].to(self.mean.device)
        bank = to_train_on(self._bank, index.device)
        self._returns = self._returns.to(index.device)
        first, source = index, torch.arange(len(index), device=index.device)
        if self.training:
            self.average_weights()
            pieces = bank.draw_pieces(index, 1, self.training_step, self.config.windows_per_sample)
            first, source = pieces.first, pieces.source
            self.training_step += 1
        frames = first[:, None] + torch.arange(self.config.context_length, device=index.device)
        real = frames <= bank.last[first][:, None]
        frames = frames.clamp(max=len(bank) - 1)  # beyond an episode's end stands what no earlier step sees
        items = {key: value[frames] for key, value in bank.items.items()}
        tokens = {RETURN: self._returns[frames], SEEN: self._seen(items), ACTION: items[ACTION]}
        actions = self._predict(tokens, (frames - first[:, None]) + bank.timestep[first][:, None])
        errors = (actions - items[ACTION]).square().mean(-1)
        if reduction == "none":
            return mean_of_each(errors[real], source[:, None].expand(real.shape)[real], len(index)), {}
        loss = errors[real].mean()
        return loss, {"action_loss": loss.item()}

    def reset(self) -> None:
        """Forgets all running episodes."""
        self._history: dict[str, Tensor] = {}
        self._step = 0

    @torch.no_grad()
    def select_action(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns the next action of each running episode and remembers it as executed.

        Args:
            batch: ``observation.*`` of all episodes that run, a row an episode; a robot's state may hold the goals.

        Returns:
            Actions in [-1, 1], shape (B, A).

        Raises:
            ValueError: The batch has not as many rows as the one of the last step.
        """
        batch = with_goals(batch, self.config.task_dims)
        seen = self._seen(batch)
        rows = len(seen)
        if self._history and len(self._history[SEEN]) != rows:
            raise ValueError(
                f"The batch holds {rows} episodes, the running history {len(self._history[SEEN])}; call policy.reset() "
                "when new episodes start."
            )
        now = {
            RETURN: (self.first_return + self._step).clamp(max=0).expand(rows, 1),
            SEEN: seen,
            ACTION: seen.new_zeros(rows, self._action_size),  # comes after what predicts it
        }
        length = self.config.context_length
        past = self._history or {key: value[:, None][:, :0] for key, value in now.items()}
        self._history = {key: torch.cat([past[key], value[:, None]], dim=1)[:, -length:] for key, value in now.items()}
        steps = torch.arange(self._step + 1, device=seen.device)[-length:]
        action = self._predict(self._history, steps.expand(rows, -1))[:, -1]
        self._history[ACTION][:, -1] = action
        self._step += 1
        return action

    def predict_action_chunk(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns ``select_action`` as a chunk of one step, shape (B, 1, A)."""
        return self.select_action(batch)[:, None]

    def get_optim_params(self) -> Iterator[nn.Parameter]:
        """Returns all parameters."""
        return self.parameters()

    def _seen(self, items: dict[str, Tensor]) -> Tensor:
        return state_and_goal(items) if self.config.goal else items[STATE]

    def _predict(self, items: dict[str, Tensor], timestep: Tensor) -> Tensor:
        """Predicts the actions of windows, each from its past.

        Args:
            items: Return-to-go, what is seen, and actions, shape (W, S, size).
            timestep: Step within the episode, shape (W, S).

        Returns:
            Shape (W, S, A).
        """
        scaled = {
            RETURN: items[RETURN] / self.first_return.abs().clamp(min=1),
            SEEN: (items[SEEN] - self.mean) / self.std,
            ACTION: items[ACTION],
        }
        tokens = torch.stack([self.tokenizers[key](scaled[key]) for key in ORDER], dim=2)
        tokens = tokens + self.timestep_embedding(timestep.clamp(max=self.config.max_timesteps - 1))[:, :, None]
        tokens = self.norm(tokens).flatten(1, 2)
        mask = nn.Transformer.generate_square_subsequent_mask(tokens.shape[1], tokens.device)
        hidden = self.transformer(tokens, mask, is_causal=True)
        return self.head(hidden[:, ORDER.index(SEEN) :: len(ORDER)])


def _returns_to_go(meta: LeRobotDatasetMetadata, bank: TrajectoryBank) -> Tensor:
    """Sums the rewards from each frame to the end of its episode, shape (frames, 1)."""
    rewards = torch.from_numpy(read_columns(meta.root, [REWARD])[REWARD])
    total = rewards.double().cumsum(0)  # on the CPU, since not every device has float64
    return (total[bank.last.cpu()] - total + rewards).float()[:, None].to(bank.timestep.device)
