"""Configuration of behavioural cloning."""

from dataclasses import dataclass, field

from lerobot.configs.policies import PreTrainedConfig
from lerobot.optim.optimizers import AdamWConfig
from lerobot.optim.schedulers import CosineDecayWithWarmupSchedulerConfig

from lerobot_gcdt.averaging import AveragedWeightsConfig
from lerobot_gcdt.baselines.one_task import whole_cosine
from lerobot_gcdt.data.single_frames import SingleFrames
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.precision import DTYPES


@PreTrainedConfig.register_subclass("bc")
@dataclass
class BCConfig(AveragedWeightsConfig, SingleFrames):
    """Configuration of ``BCPolicy``, for one task.

    `gcdt train` gives it 24,000 steps of four samples.

    Attributes:
        hidden_sizes: Sizes of the hidden layers.
        dropout: Dropout after each of them.
        frames_per_sample: Training frames that are drawn for each sample of a batch.
        hindsight_ratio: Share of the training frames whose goal is replaced by one achieved later in the episode.
        relative_goal: Whether the network also reads what is left to the goal.
        dtype: Arithmetic of the layers between the first and the last in training: ``"bfloat16"``, ``"float32"``, or
            ``"auto"`` for the faster of the two on the device (``lerobot_gcdt.precision``). All else is in float32.
        task_dims: Sizes ``[observation, goal, action]`` of the task, by task sentence. Filled from the dataset.
        optimizer_lr: Peak learning rate of AdamW, decayed along a cosine over the whole training.
    """

    hidden_sizes: tuple[int, ...] = (512, 512, 512)
    dropout: float = 0.0
    frames_per_sample: int = 32
    hindsight_ratio: float = 0.0
    relative_goal: bool = True
    dtype: str = "auto"
    task_dims: dict[str, list[int]] = field(default_factory=dict)
    optimizer_lr: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.frames_per_sample < 1:
            raise OptionError(f"policy.frames_per_sample must be positive, got {self.frames_per_sample}.")
        for name in ("dropout", "hindsight_ratio"):
            if not 0 <= getattr(self, name) <= 1:
                raise OptionError(f"policy.{name} must lie in [0, 1], got {getattr(self, name)}.")
        if self.dtype not in DTYPES:
            raise OptionError(f"policy.dtype must be 'auto', 'bfloat16' or 'float32', got {self.dtype!r}.")

    def get_optimizer_preset(self) -> AdamWConfig:
        """Returns AdamW."""
        return AdamWConfig(lr=self.optimizer_lr, weight_decay=1e-4, grad_clip_norm=1.0)

    def get_scheduler_preset(self) -> CosineDecayWithWarmupSchedulerConfig:
        """Returns ``whole_cosine``."""
        return whole_cosine(self.optimizer_lr)
