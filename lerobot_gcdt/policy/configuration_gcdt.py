"""Configuration of the goal-conditioned decision transformer."""

from dataclasses import dataclass, field

from lerobot.configs.policies import PreTrainedConfig
from lerobot.optim.optimizers import AdamWConfig
from lerobot.optim.schedulers import CosineDecayWithWarmupSchedulerConfig

from lerobot_gcdt.averaging import AveragedWeightsConfig
from lerobot_gcdt.data.single_frames import SingleFrames
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.policy.objectives import OBJECTIVES
from lerobot_gcdt.precision import DTYPES

SIZES = ("layers", "heads", "width", "inner_width", "max_timesteps", "context_length", "auxiliary_context_length")
"""Options that have to be positive."""

PAPERS_OBJECTIVES = ("dynamics", "time_to_goal", "reconstruction")
"""Auxiliary objectives that have an option each for their weight, and heads in every policy."""


@PreTrainedConfig.register_subclass("gcdt")
@dataclass
class GCDTConfig(AveragedWeightsConfig, SingleFrames):
    """Configuration of ``GCDTPolicy`` (Fu et al., ICRA 2024, arXiv 2405.18757).

    Attributes:
        layers: Transformer blocks.
        heads: Attention heads a block.
        width: Size of a token.
        inner_width: Hidden size of the blocks' perceptrons.
        dropout: Dropout in the blocks.
        context_length: Steps that an action is predicted from, its own included, in training and at test time alike.
            100 is the paper's; 1 measured better (docs/differences.md), because the scripted experts act on what they
            see now.
        draw_context: Whether each batch of training draws how many of these steps its pieces have, evenly over the
            orders of magnitude, so that a policy that remembers still acts well on what it sees now, and short pieces
            are of many episodes. False is the paper's.
        max_timesteps: Size of the timestep embedding; later steps share its last entry.
        hindsight_ratio: Share of the training trajectories that are cut at a random step and relabelled with the goal
            achieved there; the rest are whole demonstrations. 1 gives the paper's mix: every frame of a demonstration
            once as a cut and, in place of its first frame, the demonstration itself.
        relative_goal: Whether a goal token also holds what is left to the goal: desired minus achieved goal. False is
            the paper's.
        one_token: Whether the items of a step are joined into one token, past actions left out, and neither tokens nor
            last states layer-normalised. That costs a quarter of the paper's way, a token an item, and less with a
            longer context.
        time_to_goal_dropout: Share of the training pieces whose time-to-goal is hidden, of those with their own goal;
            the policy learns to predict it there. 1: it is hidden at test time, too. Between 0 and 1: the policy then
            acts on its own prediction. 0 is the paper's: it is always given, counts down from ``expected_steps`` at
            test time, and tokens carry an embedding of their timestep, so that the policy acts by the clock
            (docs/differences.md).
        training_stage: ``"pretrain"``: all four objectives, usually on many tasks; ``"finetune"``: actions only, which
            the head of a hidden time-to-goal learns beside, without a say in the transformer.
        dynamics_weight: Weight of the forward-dynamics objective in pretraining, beside 1 for the actions; 0 leaves it
            out.
        time_to_goal_weight: The same of time-to-goal prediction.
        reconstruction_weight: The same of sequence reconstruction.
        objectives: The same of further objectives, by name (``lerobot_gcdt.policy.objectives.register_objective``); the
            policy has heads of those that are named here.
        auxiliary_context_length: Steps in a piece of a trajectory that these objectives read, one piece for each
            frame of a batch. 100 is the paper's.
        hidden_ratio: Share of the items that sequence reconstruction hides.
        dtype: Arithmetic of the transformer in training: ``"bfloat16"``, ``"float32"``, or ``"auto"`` for the faster of
            the two on the device (``lerobot_gcdt.precision``). Weights and inference are always in float32.
        task_dims: Sizes ``[observation, goal, action]`` of each task, by task sentence. Filled from the dataset.
        expected_steps: Mean steps to the goal of each task, by task sentence: where time-to-goal starts at test time
            if it counts down. Filled from the dataset.
        optimizer_lr: Peak learning rate of AdamW.
        optimizer_eps: What AdamW adds to the root mean square that it divides gradients by. With PyTorch's 1e-8 one
            that had learned NeedleReach to the last digit blew up: its gradients had become so small that the next
            larger one moved it out of reach (examples/paper_table/notes.md#with-100-demonstrations).
        optimizer_weight_decay: Weight decay of AdamW.
        optimizer_grad_clip_norm: Norm at which gradients are clipped; .25 is that of the code that the paper's authors
            published later. With 1 a training blew up (examples/paper_table/notes.md#a-training-that-blew-up).
        scheduler_warmup_steps: Steps of linear warm-up, shrunk in proportion when training is shorter than
            ``scheduler_decay_steps``.
        scheduler_decay_steps: Steps of the cosine decay, shrunk to the length of the training. 0 keeps the learning
            rate constant, as in the paper.
    """

    layers: int = 4
    heads: int = 4
    width: int = 128
    inner_width: int = 512
    dropout: float = 0.0
    context_length: int = 1
    draw_context: bool = True
    max_timesteps: int = 100
    hindsight_ratio: float = 0.0
    relative_goal: bool = True
    one_token: bool = True
    time_to_goal_dropout: float = 1.0
    training_stage: str = "finetune"
    dynamics_weight: float = 0.1
    time_to_goal_weight: float = 0.1
    reconstruction_weight: float = 0.1
    objectives: dict[str, float] = field(default_factory=dict)
    auxiliary_context_length: int = 20
    hidden_ratio: float = 0.15
    dtype: str = "auto"

    task_dims: dict[str, list[int]] = field(default_factory=dict)
    expected_steps: dict[str, float] = field(default_factory=dict)

    optimizer_lr: float = 2e-3
    optimizer_eps: float = 1e-6
    optimizer_weight_decay: float = 1e-4
    optimizer_grad_clip_norm: float = 0.25
    scheduler_warmup_steps: int = 5_000
    scheduler_decay_steps: int = 100_000

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in SIZES:
            if getattr(self, name) < 1:
                raise OptionError(f"policy.{name} must be positive, got {getattr(self, name)}.")
        if self.width % self.heads:
            raise OptionError(f"policy.width ({self.width}) must be a multiple of policy.heads ({self.heads}).")
        for name in ("dropout", "time_to_goal_dropout", "hindsight_ratio", "hidden_ratio"):
            if not 0 <= getattr(self, name) <= 1:
                raise OptionError(f"policy.{name} must lie in [0, 1], got {getattr(self, name)}.")
        for name in self.objectives:
            if name in PAPERS_OBJECTIVES:
                raise OptionError(f"policy.objectives names {name}, whose weight is policy.{name}_weight.")
            if name not in OBJECTIVES:
                raise OptionError(
                    f"policy.objectives names {name!r}, but there are {', '.join(OBJECTIVES)}. LeRobot imports the "
                    "package (a folder with __init__.py) that registers another one with "
                    "--policy.discover_packages_path, or as an installed plugin whose name begins with lerobot_policy_."
                )
        for name, weight in self.objective_weights.items():
            if weight < 0:
                option = f"{name}_weight" if name in PAPERS_OBJECTIVES else f"objectives: {name}"
                raise OptionError(f"policy.{option} must not be negative, got {weight}.")
        if self.predicts_time_to_goal and not self.time_to_goal_weight:
            raise OptionError(
                f"policy.time_to_goal_dropout={self.time_to_goal_dropout} has the policy act on its own prediction of "
                "time-to-goal, which policy.time_to_goal_weight=0 leaves untrained; set the dropout to 0 or 1, or a "
                "weight."
            )
        if self.training_stage not in ("pretrain", "finetune"):
            raise OptionError(f"policy.training_stage must be 'pretrain' or 'finetune', got {self.training_stage!r}.")
        if self.optimizer_lr <= 0:
            raise OptionError(f"policy.optimizer_lr must be positive, got {self.optimizer_lr}.")
        if self.optimizer_eps <= 0:
            raise OptionError(f"policy.optimizer_eps must be positive, got {self.optimizer_eps}.")
        if self.dtype not in DTYPES:
            raise OptionError(f"policy.dtype must be 'auto', 'bfloat16' or 'float32', got {self.dtype!r}.")

    @property
    def predicts_time_to_goal(self) -> bool:
        """Whether the policy acts on time-to-goal as it predicts it itself."""
        return 0 < self.time_to_goal_dropout < 1

    @property
    def objective_weights(self) -> dict[str, float]:
        """The weight of each auxiliary objective that the policy has heads of, by name."""
        return {name: getattr(self, f"{name}_weight") for name in PAPERS_OBJECTIVES} | self.objectives

    def get_optimizer_preset(self) -> AdamWConfig:
        """Returns AdamW (Fu et al. 2024, section IV-A)."""
        return AdamWConfig(
            lr=self.optimizer_lr,
            eps=self.optimizer_eps,
            weight_decay=self.optimizer_weight_decay,
            grad_clip_norm=self.optimizer_grad_clip_norm,
        )

    def get_scheduler_preset(self) -> CosineDecayWithWarmupSchedulerConfig | None:
        """Returns a cosine decay to a hundredth of the peak, or None for a constant learning rate."""
        if self.scheduler_decay_steps == 0:
            return None
        return CosineDecayWithWarmupSchedulerConfig(
            num_warmup_steps=self.scheduler_warmup_steps,
            num_decay_steps=self.scheduler_decay_steps,
            peak_lr=self.optimizer_lr,
            decay_lr=self.optimizer_lr / 100,
        )
