"""The goal-conditioned decision transformer as a LeRobot policy (Fu et al., ICRA 2024, arXiv 2405.18757)."""

from dataclasses import dataclass, field

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from torch import Tensor, nn

from lerobot_gcdt.configuration_gcdt import GCDTConfig
from lerobot_gcdt.objectives import action_loss
from lerobot_gcdt.tokens import ORDER, TaskModules, module_key
from lerobot_gcdt.trajectories import ACTION, GOAL, REQUIRED_KEYS, STATE, TIME_TO_GOAL, Sequences, TrajectoryBank
from lerobot_gcdt.transformer import KeyValueCache, Transformer

TOKENS = len(ORDER)
"""Tokens a step."""


@dataclass
class History:
    """What the policy remembers of running episodes: keys and values of every layer, and the last actions."""

    tasks: list[str]
    caches: list[KeyValueCache]
    token_step: Tensor
    """Step of the token in each cache slot, shape (slots,)."""
    step: int = 0
    last_action: Tensor | None = field(default=None, repr=False)


class GCDTPolicy(PreTrainedPolicy):
    """A transformer over time-to-goal, goal, observation and action tokens that predicts the next action.

    Tokenizers and heads belong to a task and are chosen by the task sentence; the transformer is shared. In training
    the policy looks up whole trajectories in its own bank of the dataset, by the ``index`` of the sampled frames, and
    relabels them in hindsight. At test time it keeps the keys and values of past tokens, so that a step costs the same
    early and late.

    Args:
        config: The configuration; tasks of the dataset that it does not know yet are added to it.
        dataset_stats: Unused; LeRobot passes it to every policy.
        dataset_meta: Metadata of the dataset to train on, None for inference.

    Raises:
        KeyError: The dataset lacks a feature that GCDT needs.
        ValueError: The dataset has other dimensions than the configuration for the same task.
        FileNotFoundError: The dataset is streamed, so that its trajectories cannot be read.
    """

    config_class = GCDTConfig
    name = "gcdt"

    def __init__(self, config: GCDTConfig, dataset_stats=None, dataset_meta=None):
        super().__init__(config)
        self._bank: TrajectoryBank | None = None
        self._dataset_tasks: list[str] = []
        if dataset_meta is not None:
            self._read_dataset(dataset_meta)
        self.tasks = nn.ModuleDict(
            {module_key(task): TaskModules(dims, config.width) for task, dims in config.task_dims.items()}
        )
        self.timestep_embedding = nn.Embedding(config.context_length, config.width)
        nn.init.normal_(self.timestep_embedding.weight, std=0.02)
        self.transformer = Transformer(config.layers, config.heads, config.width, config.inner_width, config.dropout)
        for i, task in enumerate(self._dataset_tasks):
            frames = self._bank.task == i
            self._modules_of(task).fit({key: value[frames] for key, value in self._bank.items.items()})
        self.reset()

    # Training.

    def forward(self, batch: dict[str, Tensor], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Computes the loss of a batch of frames.

        In training mode every frame stands for a trajectory: with probability ``hindsight_ratio`` the one cut there
        and relabelled, otherwise its whole demonstration. In evaluation mode all are whole demonstrations.

        Args:
            batch: As LeRobot's loader gives it; of it only ``index``, shape (B,), is used.
            reduction: ``"mean"``, or ``"none"`` for one loss a frame of the batch.

        Returns:
            The loss, and what to log.

        Raises:
            RuntimeError: The policy was made without a dataset.
        """
        if self._bank is None:
            raise RuntimeError("This policy was made for inference; to train it, pass dataset_meta to its constructor.")
        index = batch["index"].to(self._bank.first.device)
        relabel = torch.rand(len(index), device=index.device) < self.config.hindsight_ratio * self.training
        sequences = self._bank.sequences(index, relabel, self.config.context_length)
        loss = action_loss(self.predict_actions(sequences), sequences, len(index), reduction)
        return loss, {"action_loss": loss.mean().item()}

    def predict_actions(self, sequences: Sequences) -> Tensor:
        """Predicts the action of every step from what comes before it.

        Args:
            sequences: Packed trajectories of the dataset's tasks.

        Returns:
            Actions in [-1, 1], shape (R, S, largest action size of the tasks); 0 in padding.
        """
        r, s = sequences.segment.shape
        tokens = self._tokenize(sequences)  # (R, S, 4, W)
        hidden = self.transformer(tokens.flatten(1, 2), self._attention_mask(sequences))
        hidden = hidden.view(r, s, TOKENS, -1)[:, :, ORDER.index(STATE)].float()
        return self._act(hidden, self._steps_by_task(sequences))

    # Inference.

    def reset(self) -> None:
        """Forgets all running episodes."""
        self._history: History | None = None

    @torch.no_grad()
    def select_action(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns the next action of each running episode and remembers it as executed.

        Args:
            batch: ``observation.state`` (B, O), ``observation.goal`` (B, G) and ``task``, a sentence for each row.

        Returns:
            Actions in [-1, 1], shape (B, largest action size of the batch's tasks).

        Raises:
            KeyError: A task sentence is unknown, or an observation is missing.
            ValueError: Observations have other sizes than the task's, or the batch is not the one of the last step.
        """
        tasks = self._check_observation(batch)
        device = batch[STATE].device
        if self._history is None:
            slots = TOKENS * (self.config.context_length + 1)
            caches = [KeyValueCache(slots) for _ in range(self.config.layers)]
            self._history = History(tasks, caches, torch.full((slots,), -1, device=device))
        history = self._history
        if tasks != history.tasks:
            raise ValueError(
                f"The batch holds {len(tasks)} episodes, the running history {len(history.tasks)} or other tasks; "
                "call policy.reset() when new episodes start."
            )
        with torch.autocast(device.type, enabled=False):
            items = {
                TIME_TO_GOAL: torch.tensor([[self._time_to_goal(task, history.step)] for task in tasks], device=device),
                GOAL: batch[GOAL].float(),
                STATE: batch[STATE].float(),
            }
            new = [self._step_tokens(items, history.step)]
            steps = [history.step] * len(items)
            if history.last_action is not None:
                new.insert(0, self._step_tokens({ACTION: history.last_action}, history.step - 1))
                steps.insert(0, history.step - 1)
            hidden = self.transformer(torch.cat(new, 1), self._cache_mask(history, steps), history.caches)
            rows = {task: [i for i, t in enumerate(tasks) if t == task] for task in dict.fromkeys(tasks)}
            action = self._act(hidden[:, -1], {task: (torch.tensor(i, device=device),) for task, i in rows.items()})
        history.last_action = action
        history.step += 1
        return action

    def predict_action_chunk(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns ``select_action`` as a chunk of one step, shape (B, 1, A)."""
        return self.select_action(batch)[:, None]

    def get_optim_params(self):
        """Returns all parameters."""
        return self.parameters()
