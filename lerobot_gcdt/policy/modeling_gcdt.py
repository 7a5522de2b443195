"""The goal-conditioned decision transformer as a LeRobot policy (Fu et al., ICRA 2024, arXiv 2405.18757)."""

from typing import Any, cast

import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.policies.pretrained import PreTrainedPolicy
from torch import Tensor, nn

from lerobot_gcdt.averaging import AveragedWeights
from lerobot_gcdt.data.acting_batch import tasks_of, with_goals
from lerobot_gcdt.data.draws import combine, uniform
from lerobot_gcdt.data.sequences import Sequences
from lerobot_gcdt.data.statistics import mean_of_each
from lerobot_gcdt.data.task_layouts import task_layouts
from lerobot_gcdt.data.trajectories import TrajectoryBank
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, STATE, TIME_TO_GOAL
from lerobot_gcdt.policy.configuration_gcdt import GCDTConfig
from lerobot_gcdt.policy.history import History
from lerobot_gcdt.policy.objectives import OBJECTIVES, action_errors, mean_over_processes, time_to_goal_error
from lerobot_gcdt.policy.saved_weights import misfit, prepare_for_weights
from lerobot_gcdt.policy.tokens import ORDER, TaskModules, module_names
from lerobot_gcdt.policy.transformer import Transformer, attention_mask
from lerobot_gcdt.precision import autocast_dtype, training_precision

TOKENS = len(ORDER)
"""Tokens a step."""

_HIDE_TIME, _LENGTH = 200, 201
"""The random numbers that decide whether a piece's time-to-goal is hidden, and how long the pieces of a step are;
smaller ones are used elsewhere."""

NOW = ORDER[: ORDER.index(ACTION)]
"""Kinds of items of a step that are there before its action."""


class GCDTPolicy(AveragedWeights, PreTrainedPolicy):
    """The goal-conditioned decision transformer (GCDT) of Fu et al. (ICRA 2024).

    A transformer over time-to-goal, goal, observation and action tokens predicts the next action. Tokenizers and heads
    belong to a task and are chosen by the task sentence; the transformer is shared. In training the policy looks up
    whole trajectories in its own bank of the dataset, by the ``index`` of the sampled frames, and relabels them in
    hindsight. At test time it keeps the keys and values of past tokens, so that a step costs the same early and late.

    Args:
        config: The configuration; tasks of the dataset that it does not know yet are added to it.
        dataset_stats: Unused; LeRobot passes it to every policy.
        dataset_meta: Metadata of the dataset to train on, None for inference.

    Raises:
        ValueError: The dataset has other dimensions than the configuration for the same task, or cannot be read
            (``TrajectoryBank.of``).
        FileNotFoundError: The dataset's files are not on this machine.
    """

    config_class = GCDTConfig
    name = "gcdt"

    def __init__(
        self,
        config: GCDTConfig,
        dataset_stats: dict | None = None,
        dataset_meta: LeRobotDatasetMetadata | None = None,
    ):
        super().__init__(config)
        self._bank: TrajectoryBank | None = None
        dataset_tasks = self._read_dataset(dataset_meta) if dataset_meta is not None else []
        self._task_order = list(dict.fromkeys([*dataset_tasks, *config.task_dims]))
        """Task sentences by index: the dataset's, then the others that the policy knows."""
        action_sizes = [config.task_dims[task][2] for task in self._task_order]
        self.register_buffer("action_sizes", torch.tensor(action_sizes), persistent=False)
        self.register_buffer("training_step", torch.tensor(0))
        """Batches of frames that training has seen; a part of the checkpoint, so that what a resumed training draws is
        what it would have drawn."""
        self._module_names = module_names(config.task_dims)
        self.tasks = nn.ModuleDict(
            {name: self._make_modules(config.task_dims[task]) for task, name in self._module_names.items()}
        )
        self.hidden_tokens = nn.Parameter(torch.randn(TOKENS, config.width))
        """Stand in the place of hidden items, one for each kind; as large as tokens, which are layer-normalised."""
        self.timestep_embedding = nn.Embedding(config.max_timesteps, config.width)
        nn.init.normal_(self.timestep_embedding.weight, std=0.02)
        sizes = config.layers, config.heads, config.width, config.inner_width
        self.transformer = Transformer(*sizes, config.dropout, normalised=not config.one_token)
        for i, task in enumerate(dataset_tasks):
            # Goals and times are standardised as training sees them, relabelled.
            pieces = self.bank.pieces(self.bank.training_starts(i), 1)
            seen = self.bank.sequences(pieces, self.bank.draw_cuts(pieces, config.hindsight_ratio))
            self.modules_of(task).fit({key: value[:, 0] for key, value in seen.items.items()})
        self.keep_average(config.average_steps)
        self.reset()

    # Training.

    @property
    def bank(self) -> TrajectoryBank:
        """The trajectories of the dataset.

        Raises:
            RuntimeError: The policy was made without a dataset.
        """
        if self._bank is None:
            raise RuntimeError(
                "This policy was made for inference; to train it on frames, pass dataset_meta to its constructor."
            )
        return self._bank

    def forward(self, batch: dict[str, Tensor], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Computes the loss of a batch of frames, or of a batch of windows.

        In evaluation mode every frame stands for its episode, which is read in pieces of ``context_length`` steps. In
        training mode as many pieces are drawn from all episodes that are trained on, evenly over the tasks and anew in
        each call, and each is relabelled with probability ``hindsight_ratio``. Windows, from loaders that make their
        own, are read as they are. Pretraining adds the auxiliary objectives in training mode.

        In training with several processes the loss is weighted so that its mean over the processes is the mean over
        all of their steps.

        Args:
            batch: Frames as `lerobot-train` gives them, of which only ``index``, shape (B,), is used; or windows,
                recognised by their ``observation.state`` of shape (B, S, O) (see ``Sequences.of_windows``).
            reduction: ``"mean"``, or ``"none"`` for one loss of the actions a row of the batch.

        Returns:
            The loss, and what to log.

        Raises:
            RuntimeError: The policy was made without a dataset, and the batch holds frames.
            KeyError, ValueError: Windows lack something or do not fit their task.
        """
        if self.training:
            self.average_weights()
            self.training_step += 1
        index = batch["index"].to(self.training_step.device)
        windows = STATE in batch and batch[STATE].ndim == 3
        if windows:
            sequences = Sequences.of_windows(batch, {task: self.config.task_dims[task] for task in self._task_order})
        else:
            bank = self.bank.to(index.device)
            length = self._piece_length()
            sequences = self._draw(index, length) if self.training else bank.sequences(bank.pieces(index, length))
        with training_precision(self.config.dtype, index.device.type):
            without_time = self._without_time(sequences)
            states = self.read(sequences, without_time)
            errors = action_errors(self, sequences, states)
            if reduction == "none":
                return mean_of_each(errors, sequences.source[sequences.real], len(index)), {}
            if not self.training:
                return errors.mean(), {"action_loss": errors.mean().item()}
            loss = mean_over_processes(errors)
            log = {"action_loss": loss.item()}
            if self.config.time_to_goal_dropout > 0 and self.config.time_to_goal_weight > 0:
                # Time-to-goal is far harder to predict than actions; it would claim the transformer for itself.
                seen = states if self.config.training_stage == "pretrain" else states.detach()
                of_time = time_to_goal_error(self, sequences, seen, without_time & sequences.real)
                loss = loss + self.config.time_to_goal_weight * of_time
                log["time_to_goal_loss"] = of_time.item()
            if self.config.training_stage == "pretrain":
                pieces = sequences if windows else self._draw(index, self.config.auxiliary_context_length, count=1)
                for name, (weight, auxiliary) in self._auxiliary_losses(pieces).items():
                    loss = loss + weight * auxiliary
                    log[name] = auxiliary.item()
        return loss, log

    def read(self, sequences: Sequences, without_time: Tensor) -> Tensor:
        """Runs the transformer over trajectories as the policy sees them when it acts.

        Args:
            sequences: Packed trajectories of the dataset's tasks.
            without_time: Steps whose time-to-goal is hidden, booleans of shape (R, S).

        Returns:
            Hidden states of each step when its observation has been seen, shape (R, S, W).
        """
        keys = (*NOW, ACTION) if self._sees_actions else NOW
        of_time = torch.tensor([key == TIME_TO_GOAL for key in keys], device=without_time.device)
        hidden = without_time[..., None] & of_time
        return self.encode(sequences, keys, self.config.context_length, hidden=hidden)[:, :, keys.index(STATE)]

    def predict_actions(self, sequences: Sequences, states: Tensor | None = None) -> Tensor:
        """Predicts the action of every step from what comes before it.

        Args:
            sequences: Packed trajectories of the dataset's tasks.
            states: What ``read`` gives of them; None to read them with time-to-goal hidden as it is in evaluation.

        Returns:
            Actions in [-1, 1], shape (R, S, largest action size of the tasks); 0 in padding.
        """
        if states is None:
            states = self.read(sequences, self._without_time(sequences))
        with self._full_precision():
            return self._act(states, {self._task_order[i]: steps for i, steps in sequences.by_task.items()})

    def encode(
        self,
        sequences: Sequences,
        keys: tuple[str, ...],
        context_length: int | None = None,
        causal: bool = True,
        hidden: Tensor | None = None,
    ) -> Tensor:
        """Runs the transformer over some kinds of tokens.

        Args:
            sequences: Packed trajectories of the dataset's tasks.
            keys: The kinds of tokens that take part, in their order within a step.
            context_length: Steps that a step may attend to, itself included; None for all of its piece.
            causal: Whether a token sees the past and itself only, or all of its piece.
            hidden: Items to hide, booleans of shape (R, S, kinds).

        Returns:
            Hidden states of the tokens, shape (R, S, kinds, W), float32.
        """
        r, s = sequences.segment.shape
        with self._full_precision():
            tokens = self._joined(self._tokenize(sequences, keys, hidden))  # (R, S, tokens of a step, W)
        count = tokens.shape[2]
        mask = attention_mask(
            sequences.segment, count, context_length, causal, autocast_dtype(sequences.segment.device.type)
        )
        states = self.transformer(tokens.flatten(1, 2), mask).view(r, s, count, -1).float()
        return states.expand(r, s, len(keys), -1)  # one token answers for all kinds

    def modules_of(self, task: int | str) -> TaskModules:
        """Returns tokenizers and heads of a task, by its sentence or its index in sequences."""
        name = self._module_names[self._task_order[task] if isinstance(task, int) else task]
        return cast(TaskModules, self.tasks[name])

    # Inference.

    def reset(self) -> None:
        """Forgets all running episodes."""
        self._history: History | None = None

    @torch.no_grad()
    def select_action(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns the next action of each running episode and remembers it as executed.

        Args:
            batch: ``observation.state`` (B, O), ``observation.goal`` and ``observation.achieved_goal`` (B, G), and
                ``task``, a sentence for each row. A robot's state, (B, O + 2 G), holds the goals, too.

        Returns:
            Actions in [-1, 1], shape (B, largest action size of the batch's tasks).

        Raises:
            KeyError: A task sentence is unknown, or an observation is missing.
            ValueError: Observations have other sizes than the task's, or the batch is not the one of the last step.
        """
        batch = with_goals(batch, self.config.task_dims)
        tasks = tasks_of(batch, self.config.task_dims)
        device = batch[STATE].device
        if self._history is None:
            slots = TOKENS * (self.config.context_length + 1)
            self._history = History(tasks, self.config.layers, slots, device)
        history = self._history
        if tasks != history.tasks:
            raise ValueError(
                f"The batch holds {len(tasks)} episodes, the running history {len(history.tasks)} or other tasks; "
                "call policy.reset() when new episodes start."
            )
        rows = {task: [i for i, t in enumerate(tasks) if t == task] for task in dict.fromkeys(tasks)}
        with self._full_precision():
            items = {key: batch[key].float() for key in (GOAL, ACHIEVED_GOAL, STATE)}
            if not self._tells_time_to_goal:
                times = [self._countdown(task, history.step) for task in tasks]
                items[TIME_TO_GOAL] = torch.tensor(times, device=device)[:, None]
            state, tokens = self._see(history, rows, items)
            if self._tells_time_to_goal:
                history.last_state = state
            if self.config.predicts_time_to_goal:
                history.forget(tokens)
                items[TIME_TO_GOAL] = self.predict_time_to_goal()[:, None]
                state, _ = self._see(history, rows, items)
            action = self._act(state, {task: (torch.tensor(i, device=device),) for task, i in rows.items()})
        history.last_action = action
        history.step += 1
        return action

    @torch.no_grad()
    def predict_time_to_goal(self) -> Tensor:
        """Predicts how many steps the running episodes still need, from what ``select_action`` saw last.

        Returns:
            Steps, shape (B,); around 0 when the goal is reached.

        Raises:
            RuntimeError: No episode is running, or the policy never learned it: it is told its time-to-goal
                (``time_to_goal_dropout`` 0), or the objective was left out (``time_to_goal_weight`` 0).
        """
        if not self._tells_time_to_goal or not self.config.time_to_goal_weight:
            raise RuntimeError(
                "A policy with time_to_goal_dropout=0 is told its time-to-goal, and one with time_to_goal_weight=0 "
                "never learned to predict it."
            )
        if self._history is None or self._history.last_state is None:
            raise RuntimeError("No episode is running; predict time-to-goal after select_action.")
        state = self._history.last_state
        times = [self.modules_of(task).predict_time_to_goal(state[i]) for i, task in enumerate(self._history.tasks)]
        return torch.cat(times)

    def predict_action_chunk(self, batch: dict[str, Tensor]) -> Tensor:
        """Returns ``select_action`` as a chunk of one step, shape (B, 1, A)."""
        return self.select_action(batch)[:, None]

    def get_optim_params(self) -> list[dict[str, Any]]:
        """Returns all parameters, to be updated by PyTorch's fused optimiser."""
        return [{"params": list(self.parameters()), "fused": True}]

    # Details.

    @classmethod
    def _load_as_safetensor(cls, model: "GCDTPolicy", model_file: str, map_location: str, strict: bool) -> "GCDTPolicy":
        prepare_for_weights(model, model_file)
        try:
            return super()._load_as_safetensor(model, model_file, map_location, strict)
        except RuntimeError as error:
            raise misfit(model, model_file, error) from None

    def _read_dataset(self, meta: LeRobotDatasetMetadata) -> list[str]:
        """Loads the trajectories and adds the dataset's tasks to the configuration; returns them by index."""
        self._bank = TrajectoryBank.of(meta, self.config.device)
        tasks = list(meta.tasks.sort_values("task_index").index)
        layouts = task_layouts(meta)
        for task in tasks:
            dims = layouts[task].sizes
            known = self.config.task_dims.get(task, dims)
            if list(known) != dims:
                raise ValueError(
                    f"The policy knows {task!r} with the sizes {list(known)} of observation, goal and action, but the "
                    f"dataset {meta.repo_id} has {dims}."
                )
            self.config.task_dims[task] = dims
        for i, task in enumerate(tasks):
            self.config.expected_steps.setdefault(task, self._bank.expected_steps(i))
        return tasks

    def _piece_length(self) -> int:
        """Steps of the pieces that are read: in training drawn for each batch, evenly over the orders of magnitude."""
        longest = self.config.context_length
        if not (self.training and self.config.draw_context):
            return longest
        return min(int((longest + 1) ** uniform(self.training_step, _LENGTH).item()), longest)

    def _draw(self, index: Tensor, length: int, count: int | None = None) -> Sequences:
        """Draws relabelled pieces for training, by the number of the step and the frames of a batch."""
        pieces = self.bank.draw_pieces(index, length, self.training_step, count)
        return self.bank.sequences(pieces, self.bank.draw_cuts(pieces, self.config.hindsight_ratio))

    def _make_modules(self, dims: list[int]) -> TaskModules:
        modules = TaskModules(dims, self.config.width, self.config.relative_goal, normalised=not self.config.one_token)
        for objective in self.config.objective_weights:
            for name, head in OBJECTIVES[objective].heads(dims, self.config.width).items():
                modules.add_module(name, head)
        return modules

    def _auxiliary_losses(self, sequences: Sequences) -> dict[str, tuple[float, Tensor]]:
        """Weight and value of the auxiliary objectives that are switched on, by name."""
        return {
            f"{name}_loss": (weight, OBJECTIVES[name].loss(self, sequences))
            for name, weight in self.config.objective_weights.items()
            if weight and not (name == "time_to_goal" and self.config.time_to_goal_dropout > 0)  # is in the main loss
        }

    def _tokenize(self, sequences: Sequences, keys: tuple[str, ...], hidden: Tensor | None) -> Tensor:
        """Tokens of packed trajectories, shape (R, S, kinds, W); 0 in padding."""
        tokens = self.timestep_embedding.weight.new_zeros(*sequences.segment.shape, len(keys), self.config.width)
        for task, steps in sequences.by_task.items():
            modules = self.modules_of(task)
            items = {key: value[steps] for key, value in sequences.items.items()}
            tokens[steps] = torch.stack([modules.tokenize(key, items) for key in keys], dim=1)
        if hidden is not None:
            of_kind = self.hidden_tokens[[ORDER.index(key) for key in keys]]
            tokens = torch.where(hidden[..., None], of_kind, tokens)
        return tokens + self._embed_time(sequences.timestep)[:, :, None]

    @property
    def _tells_time_to_goal(self) -> bool:
        """Whether states are hidden from time-to-goal, so that their head predicts it."""
        return self.config.time_to_goal_dropout > 0

    @property
    def _sees_actions(self) -> bool:
        """Whether actions are predicted from earlier ones: none that later steps look back on, none in one token."""
        return self.config.context_length > 1 and not self.config.one_token

    def _joined(self, tokens: Tensor) -> Tensor:
        """Joins the tokens of a step, shape (..., kinds, W), if it is to be one: shape (..., 1, W)."""
        return tokens.sum(-2, keepdim=True) * tokens.shape[-2] ** -0.5 if self.config.one_token else tokens

    def _embed_time(self, timestep: Tensor) -> Tensor:
        embedding = self.timestep_embedding
        if self.config.time_to_goal_dropout > 0:  # a policy that is not to act by the clock does not see one
            return embedding.weight.new_zeros(*timestep.shape, self.config.width)
        # Steps beyond the table share its last entry.
        return embedding(timestep.clamp(max=self.config.max_timesteps - 1))

    def _full_precision(self) -> torch.autocast:
        # Corrections near a goal are small beside the observations; only the transformer may work in bfloat16.
        return torch.autocast(self.timestep_embedding.weight.device.type, enabled=False)

    def _act(self, hidden: Tensor, rows: dict[str, tuple[Tensor, ...]]) -> Tensor:
        """Actions from hidden states (..., W), each by its task's head; zero-padded to the largest action."""
        size = max(self.config.task_dims[task][2] for task in rows)
        actions = hidden.new_zeros(*hidden.shape[:-1], size)
        for task, where in rows.items():
            predicted = self.modules_of(task).predict_action(hidden[where])
            actions[where] = nn.functional.pad(predicted, (0, size - predicted.shape[-1]))
        return actions

    def _without_time(self, sequences: Sequences) -> Tensor:
        """Steps whose time-to-goal is hidden, shape (R, S): in training of some pieces, and else of all or none.

        What is relabelled always shows it: without, the way to a goal that was merely passed contradicts the way to one
        that was meant.
        """
        dropout = self.config.time_to_goal_dropout
        if self.training and dropout > 0:
            drawn = uniform(combine(self.training_step, sequences.key), _HIDE_TIME) < dropout
            return drawn & ~sequences.relabelled
        return torch.full_like(sequences.real, dropout > 0)

    def _countdown(self, task: str, step: int) -> float:
        """Starts at the task's expected length and falls by one a step, never below one (Fu et al. 2024, IV-A)."""
        return max(self.config.expected_steps[task] - step, 1.0)

    def _see(self, history: History, rows: dict[str, list[int]], items: dict[str, Tensor]) -> tuple[Tensor, int]:
        """Adds a step to the history; returns hidden states, shape (B, W), and how many tokens were added."""
        tokens = self._joined(self._step_tokens(rows, NOW, items, history.step))
        steps = [history.step] * tokens.shape[1]
        if history.last_action is not None and self._sees_actions:
            acted = self._step_tokens(rows, (ACTION,), {ACTION: history.last_action}, history.step - 1)
            tokens, steps = torch.cat([acted, tokens], 1), [history.step - 1, *steps]
        hidden = self.transformer(tokens, history.add(steps, self.config.context_length), history.caches)
        return hidden[:, -1], len(steps)

    def _step_tokens(
        self, rows: dict[str, list[int]], keys: tuple[str, ...], items: dict[str, Tensor], step: int
    ) -> Tensor:
        """Tokens of some kinds of one step of the running episodes, shape (B, kinds, W); those without items hidden."""
        device = self.timestep_embedding.weight.device
        tokens = self._embed_time(torch.tensor(step, device=device)).repeat(sum(map(len, rows.values())), len(keys), 1)
        for task, chosen in rows.items():
            of_task = {key: value[chosen] for key, value in items.items()}
            for k, key in enumerate(keys):
                known = key in items
                tokens[chosen, k] += (
                    self.modules_of(task).tokenize(key, of_task) if known else self.hidden_tokens[ORDER.index(key)]
                )
        return tokens
