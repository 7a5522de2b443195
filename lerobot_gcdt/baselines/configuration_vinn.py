"""Configuration of the nearest neighbours."""

from dataclasses import dataclass, field

from lerobot.configs.policies import PreTrainedConfig
from lerobot.optim.optimizers import AdamWConfig

from lerobot_gcdt.data.single_frames import SingleFrames
from lerobot_gcdt.errors import OptionError


@PreTrainedConfig.register_subclass("vinn")
@dataclass
class VINNConfig(SingleFrames):
    """Configuration of ``VINNPolicy`` (Pari et al. 2021, arXiv 2112.01511), for one task.

    Attributes:
        neighbours: Frames that an action is averaged over; 0 to choose the number by the demonstrations.
        temperature: Distance at which the weight of a frame falls to 1/e; 0 to choose it by the demonstrations.
        frames: Frames that are kept. Filled from the dataset.
        task_dims: Sizes ``[observation, goal, action]`` of the task, by task sentence. Filled from the dataset.
    """

    neighbours: int = 0
    temperature: float = 0.0
    frames: int = 0
    task_dims: dict[str, list[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("neighbours", "temperature"):
            if getattr(self, name) < 0:
                raise OptionError(f"policy.{name} must not be negative, got {getattr(self, name)}.")

    def get_optimizer_preset(self) -> AdamWConfig:
        """Returns an optimiser that changes nothing: LeRobot's trainer wants one."""
        return AdamWConfig(lr=0.0, weight_decay=0.0)

    def get_scheduler_preset(self) -> None:
        """Nothing is scheduled."""
        return None
