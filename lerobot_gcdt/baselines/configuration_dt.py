"""Configuration of the decision transformer."""

from dataclasses import dataclass, field

from lerobot.configs.policies import PreTrainedConfig
from lerobot.optim.optimizers import AdamWConfig
from lerobot.optim.schedulers import CosineDecayWithWarmupSchedulerConfig

from lerobot_gcdt.averaging import AveragedWeightsConfig
from lerobot_gcdt.baselines.one_task import whole_cosine
from lerobot_gcdt.data.single_frames import SingleFrames
from lerobot_gcdt.errors import OptionError


@PreTrainedConfig.register_subclass("dt")
@dataclass
class DTConfig(AveragedWeightsConfig, SingleFrames):
    """Configuration of ``DTPolicy`` (Chen et al. 2021, arXiv 2106.01345), for one task.

    Layers, width, dropout and context are those of Chen et al. for continuous control.

    Attributes:
        layers: Transformer blocks.
        heads: Attention heads a block.
        width: Size of a token; the blocks' perceptrons are four times as wide.
        dropout: Dropout in the blocks.
        context_length: Steps that an action is predicted from, its own included, in training and at test time alike.
        max_timesteps: Size of the timestep embedding; later steps share its last entry.
        goal: Whether the token of an observation also holds the desired goal and what is left to it. False is the
            paper's rival of GCDT, which has no goal token (Fu et al. 2024, section IV).
        return_quantile: Quantile of the demonstrations' returns that the return-to-go starts at; 1 is the best one.
        windows_per_sample: Training windows that are drawn for each sample of a batch.
        task_dims: Sizes ``[observation, goal, action]`` of the task, by task sentence. Filled from the dataset.
        optimizer_lr: Peak learning rate of AdamW, decayed along a cosine over the whole training.
    """

    layers: int = 3
    heads: int = 4
    width: int = 128
    dropout: float = 0.1
    context_length: int = 20
    max_timesteps: int = 100
    goal: bool = False
    return_quantile: float = 1.0
    windows_per_sample: int = 2
    task_dims: dict[str, list[int]] = field(default_factory=dict)
    optimizer_lr: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("layers", "heads", "width", "context_length", "max_timesteps", "windows_per_sample"):
            if getattr(self, name) < 1:
                raise OptionError(f"policy.{name} must be positive, got {getattr(self, name)}.")
        if self.width % self.heads:
            raise OptionError(f"policy.width ({self.width}) must be a multiple of policy.heads ({self.heads}).")
        for name in ("dropout", "return_quantile"):
            if not 0 <= getattr(self, name) <= 1:
                raise OptionError(f"policy.{name} must lie in [0, 1], got {getattr(self, name)}.")

    def get_optimizer_preset(self) -> AdamWConfig:
        """Returns AdamW, with the weight decay and the clipping of Chen et al."""
        return AdamWConfig(lr=self.optimizer_lr, weight_decay=1e-4, grad_clip_norm=0.25)

    def get_scheduler_preset(self) -> CosineDecayWithWarmupSchedulerConfig:
        """Returns ``whole_cosine``."""
        return whole_cosine(self.optimizer_lr)
