"""Configuration of implicit Q-learning."""

from dataclasses import dataclass, field
from importlib.util import find_spec

from lerobot.configs.policies import PreTrainedConfig
from lerobot.optim.optimizers import AdamWConfig
from lerobot.optim.schedulers import CosineDecayWithWarmupSchedulerConfig

from lerobot_gcdt.baselines.one_task import whole_cosine
from lerobot_gcdt.data.single_frames import SingleFrames
from lerobot_gcdt.errors import OptionError


@PreTrainedConfig.register_subclass("iql")
@dataclass
class IQLConfig(SingleFrames):
    """Configuration of ``IQLPolicy`` (Kostrikov et al. 2021, arXiv 2110.06169), for one task.

    Attributes:
        hidden_sizes: Sizes of the hidden layers of each of its four perceptrons.
        expectile: Expectile of the action values that the value of a state is; above 0.5 it leans to better actions.
        temperature: Inverse temperature: how much more an action counts that is better than its state; 0 is behavioural
            cloning. Advantages are in steps.
        discount: Share of a reward that is left a step later.
        target_rate: Share of the way to the action values that their targets go in a step.
        frames_per_sample: Training frames that are drawn for each sample of a batch.
        task_dims: Sizes ``[observation, goal, action]`` of the task, by task sentence. Filled from the dataset.
        average_steps: Steps of training whose weights the policy acts with the average of
            (``lerobot_gcdt.averaging``); 0 for the last weights.
        optimizer_lr: Peak learning rate of AdamW, decayed along a cosine over the whole training.
    """

    hidden_sizes: tuple[int, ...] = (256, 256, 256)
    expectile: float = 0.7
    temperature: float = 1.0
    discount: float = 0.99
    target_rate: float = 0.005
    frames_per_sample: int = 32
    task_dims: dict[str, list[int]] = field(default_factory=dict)
    average_steps: int = 2_000
    optimizer_lr: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        if not find_spec("torchrl"):
            raise OptionError("policy.type=iql needs torchrl: pip install 'lerobot_policy_gcdt[iql]'.")
        if self.frames_per_sample < 1:
            raise OptionError(f"policy.frames_per_sample must be positive, got {self.frames_per_sample}.")
        if self.temperature < 0:
            raise OptionError(f"policy.temperature must not be negative, got {self.temperature}.")
        for name in ("expectile", "discount", "target_rate"):
            if not 0 < getattr(self, name) <= 1:
                raise OptionError(f"policy.{name} must lie in (0, 1], got {getattr(self, name)}.")

    def get_optimizer_preset(self) -> AdamWConfig:
        """Returns AdamW."""
        return AdamWConfig(lr=self.optimizer_lr, weight_decay=1e-4, grad_clip_norm=1.0)

    def get_scheduler_preset(self) -> CosineDecayWithWarmupSchedulerConfig:
        """Returns ``whole_cosine``."""
        return whole_cosine(self.optimizer_lr)
