"""The goal-conditioned decision transformer as a LeRobot policy (Fu et al., ICRA 2024, arXiv 2405.18757)."""

import gc
from dataclasses import dataclass

import torch
from lerobot.datasets.streaming_dataset import StreamingLeRobotDataset
from lerobot.policies.pretrained import PreTrainedPolicy
from safetensors import safe_open
from torch import Tensor, nn

from lerobot_gcdt.configuration_gcdt import GCDTConfig
from lerobot_gcdt.objectives import action_loss
from lerobot_gcdt.tokens import ORDER, TaskModules, module_key
from lerobot_gcdt.trajectories import (
    ACHIEVED_GOAL,
    ACTION,
    GOAL,
    REQUIRED_KEYS,
    STATE,
    TIME_TO_GOAL,
    Sequences,
    TrajectoryBank,
)
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
    tokens: int = 0
    step: int = 0
    last_action: Tensor | None = None


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
        ValueError: The dataset has other dimensions than the configuration for the same task, or is streamed.
        FileNotFoundError: The dataset's files are not on this machine.
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
            {
                module_key(task): TaskModules(dims, config.width, config.relative_goal)
                for task, dims in config.task_dims.items()
            }
        )
        self.timestep_embedding = nn.Embedding(config.max_timesteps, config.width)
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
        sequences = self._bank.sequences(index, relabel)
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
        with self._full_precision():
            tokens = self._tokenize(sequences)  # (R, S, 4, W)
        hidden = self.transformer(tokens.flatten(1, 2), self._attention_mask(sequences))
        hidden = hidden.view(r, s, TOKENS, -1)[:, :, ORDER.index(STATE)]
        with self._full_precision():
            return self._act(hidden.float(), self._steps_by_task(sequences))

    # Inference.

    def reset(self) -> None:
        """Forgets all running episodes."""
        self._history: History | None = None

    @torch.no_grad()
    def select_action(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns the next action of each running episode and remembers it as executed.

        Args:
            batch: ``observation.state`` (B, O), ``observation.goal`` and ``observation.achieved_goal`` (B, G), and
                ``task``, a sentence for each row.

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
            self._history = History(tasks, caches, torch.zeros(slots, dtype=torch.long, device=device))
        history = self._history
        if tasks != history.tasks:
            raise ValueError(
                f"The batch holds {len(tasks)} episodes, the running history {len(history.tasks)} or other tasks; "
                "call policy.reset() when new episodes start."
            )
        with self._full_precision():
            items = {
                TIME_TO_GOAL: torch.tensor([[self._time_to_goal(task, history.step)] for task in tasks], device=device),
                GOAL: batch[GOAL].float(),
                ACHIEVED_GOAL: batch[ACHIEVED_GOAL].float(),
                STATE: batch[STATE].float(),
            }
            now = [key for key in ORDER if key != ACTION]
            new = [self._step_tokens(now, items, history.step)]
            steps = [history.step] * len(now)
            if history.last_action is not None:
                new.insert(0, self._step_tokens([ACTION], {ACTION: history.last_action}, history.step - 1))
                steps.insert(0, history.step - 1)
            hidden = self.transformer(torch.cat(new, 1), self._remember_tokens(steps), history.caches)
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

    # Details.

    @classmethod
    def _load_as_safetensor(cls, model, model_file: str, map_location: str, strict: bool):
        with safe_open(model_file, "pt") as file:
            saved = set(file.keys())
        own = set(model.state_dict())
        # Tasks that the checkpoint does not know keep their new modules.
        new = {key for key in own if key.startswith("tasks.") and not _has_task(saved, key.split(".")[1])}
        problem = sorted(saved ^ (own - new))
        if not problem:
            try:
                return super()._load_as_safetensor(model, model_file, map_location, strict)
            except RuntimeError as error:
                problem = error
        config = model.config
        raise ValueError(
            f"The weights in {model_file} do not fit their configuration (layers={config.layers}, "
            f"width={config.width}, task_dims={config.task_dims}): {problem}"
        )

    def _read_dataset(self, meta) -> None:
        """Loads the trajectories and adds the dataset's tasks to the configuration."""
        missing = [key for key in REQUIRED_KEYS if key not in meta.features]
        if missing:
            raise KeyError(
                f"The dataset {meta.repo_id} lacks {', '.join(missing)}; GCDT needs {', '.join(REQUIRED_KEYS)}. "
                "Record one with `gcdt record`."
            )
        # Nothing that LeRobot hands to a policy says how the dataset is loaded; the dataset itself holds its metadata.
        if any(isinstance(owner, StreamingLeRobotDataset) for owner in gc.get_referrers(meta)):
            raise ValueError(
                "GCDT reads whole trajectories into memory and cannot train on a streamed dataset; pass "
                "--dataset.streaming=false."
            )
        dims = [meta.features[key]["shape"][0] for key in (STATE, GOAL, ACTION)]
        self._dataset_tasks = list(meta.tasks.sort_values("task_index").index)
        for task in self._dataset_tasks:
            known = self.config.task_dims.get(task, dims)
            if list(known) != dims:
                raise ValueError(
                    f"The policy knows {task!r} with the sizes {list(known)} of observation, goal and action, but the "
                    f"dataset {meta.repo_id} has {dims}."
                )
        self._bank = TrajectoryBank(meta.root, self.config.device)
        for i, task in enumerate(self._dataset_tasks):
            self.config.task_dims[task] = dims
            self.config.expected_steps.setdefault(task, self._bank.expected_steps(i))

    def _modules_of(self, task: str) -> TaskModules:
        return self.tasks[module_key(task)]

    def _steps_by_task(self, sequences: Sequences) -> dict[str, tuple[Tensor, ...]]:
        """Positions of the real steps of each task present, as indices into (R, S)."""
        present = sequences.task[sequences.real].unique().tolist()
        return {
            self._dataset_tasks[i]: torch.nonzero(sequences.real & (sequences.task == i), as_tuple=True)
            for i in present
        }

    def _tokenize(self, sequences: Sequences) -> Tensor:
        """Tokens of packed trajectories, shape (R, S, 4, W); 0 in padding."""
        tokens = self.timestep_embedding.weight.new_zeros(*sequences.segment.shape, TOKENS, self.config.width)
        for task, steps in self._steps_by_task(sequences).items():
            modules = self._modules_of(task)
            time = self._embed_time(sequences.timestep[steps])  # (N, W)
            items = {key: value[steps] for key, value in sequences.items.items()}
            tokens[steps] = torch.stack([modules.tokenize(key, items) + time for key in ORDER], dim=1)
        return tokens

    def _embed_time(self, timestep: Tensor) -> Tensor:
        # Steps beyond the table share its last entry.
        return self.timestep_embedding(timestep.clamp(max=self.config.max_timesteps - 1))

    def _attention_mask(self, sequences: Sequences) -> Tensor:
        """Additive mask (R, 1, 4S, 4S): a token sees the past of its own trajectory, within the context length."""
        r, s = sequences.segment.shape
        segment = sequences.segment.repeat_interleave(TOKENS, dim=1)
        step = torch.arange(s, device=segment.device).repeat_interleave(TOKENS)
        allowed = segment[:, :, None] == segment[:, None, :]
        allowed &= torch.ones(s * TOKENS, s * TOKENS, dtype=torch.bool, device=segment.device).tril()
        allowed &= step[:, None] - step[None, :] < self.config.context_length
        mask = torch.zeros(r, 1, s * TOKENS, s * TOKENS, device=segment.device, dtype=self._compute_dtype())
        return mask.masked_fill(~allowed[:, None], float("-inf"))

    def _full_precision(self):
        # Corrections near a goal are small beside the observations; only the transformer may work in bfloat16.
        return torch.autocast(self.timestep_embedding.weight.device.type, enabled=False)

    def _compute_dtype(self) -> torch.dtype:
        device = self.timestep_embedding.weight.device.type
        return torch.get_autocast_dtype(device) if torch.is_autocast_enabled(device) else torch.float32

    def _act(self, hidden: Tensor, rows: dict[str, tuple[Tensor, ...]]) -> Tensor:
        """Actions from hidden states (..., W), each by its task's head; zero-padded to the largest action."""
        size = max(self.config.task_dims[task][2] for task in rows)
        actions = hidden.new_zeros(*hidden.shape[:-1], size)
        for task, where in rows.items():
            predicted = self._modules_of(task).predict_action(hidden[where])
            actions[where] = nn.functional.pad(predicted, (0, size - predicted.shape[-1]))
        return actions

    def _time_to_goal(self, task: str, step: int) -> float:
        """Starts at the task's expected length and falls by one a step, never below one (Fu et al. 2024, IV-A)."""
        return max(self.config.expected_steps[task] - step, 1.0)

    def _step_tokens(self, keys: list[str], items: dict[str, Tensor], step: int) -> Tensor:
        """Tokens of some kinds of one step of the running episodes, shape (B, kinds, W)."""
        device = self.timestep_embedding.weight.device
        time = self._embed_time(torch.tensor(step, device=device))
        tokens = time.repeat(len(self._history.tasks), len(keys), 1)
        for task in dict.fromkeys(self._history.tasks):
            rows = [i for i, t in enumerate(self._history.tasks) if t == task]
            of_task = {key: value[rows] for key, value in items.items()}
            for k, key in enumerate(keys):
                tokens[rows, k] += self._modules_of(task).tokenize(key, of_task)
        return tokens

    def _remember_tokens(self, steps: list[int]) -> Tensor:
        """Notes the steps of new tokens; returns what they may attend to, booleans (1, 1, new tokens, kept tokens)."""
        history = self._history
        device = history.token_step.device
        slots = (torch.arange(len(steps), device=device) + history.tokens) % len(history.token_step)
        history.token_step[slots] = torch.tensor(steps, device=device)
        history.tokens += len(steps)
        kept = history.token_step[: history.tokens]
        allowed = history.token_step[slots][:, None] - kept[None, :] < self.config.context_length
        allowed[:, slots] &= torch.ones(len(steps), len(steps), dtype=torch.bool, device=device).tril()
        return allowed[None, None]

    def _check_observation(self, batch: dict[str, Tensor]) -> list[str]:
        """Returns the task of each row after checking that the policy can act on the batch."""
        needed = (STATE, GOAL, ACHIEVED_GOAL, "task")
        missing = [key for key in needed if key not in batch]
        if missing:
            raise KeyError(f"select_action needs {', '.join(needed)}; the batch lacks {', '.join(missing)}.")
        tasks = [batch["task"]] if isinstance(batch["task"], str) else list(batch["task"])
        for task in dict.fromkeys(tasks):
            if task not in self.config.task_dims:
                raise KeyError(f"Unknown task {task!r}; this policy knows {sorted(self.config.task_dims)}.")
            state, goal, _ = self.config.task_dims[task]
            for key, size in ((STATE, state), (GOAL, goal), (ACHIEVED_GOAL, goal)):
                # Several tasks in one batch share a tensor, padded to the largest of them.
                width = batch[key].shape[-1] if len(set(tasks)) > 1 else size
                if batch[key].shape != (len(tasks), max(width, size)):
                    raise ValueError(
                        f"{key} must have the shape ({len(tasks)}, {size}) for the task {task!r}, "
                        f"got {tuple(batch[key].shape)}."
                    )
        return tasks


def _has_task(keys: set[str], task: str) -> bool:
    return any(key.startswith(f"tasks.{task}.") for key in keys)
