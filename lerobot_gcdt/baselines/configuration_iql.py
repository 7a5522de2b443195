"""Configuration of implicit Q-learning."""

from dataclasses import dataclass
from importlib.util import find_spec

from lerobot.configs.policies import PreTrainedConfig

from lerobot_gcdt.baselines.reward_learner import RewardLearnerConfig
from lerobot_gcdt.errors import OptionError


@PreTrainedConfig.register_subclass("iql")
@dataclass
class IQLConfig(RewardLearnerConfig):
    """Configuration of ``IQLPolicy`` (Kostrikov et al. 2021, arXiv 2110.06169), for one task.

    Attributes:
        expectile: Expectile of the action values that the value of a state is; above 0.5 it leans to better actions.
        temperature: Inverse temperature: how much more an action counts that is better than its state; 0 is behavioural
            cloning. Advantages are in steps.
    """

    expectile: float = 0.7
    temperature: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not find_spec("torchrl"):
            raise OptionError("policy.type=iql needs torchrl: pip install 'lerobot_policy_gcdt[iql]'.")
        if not 0 < self.expectile <= 1:
            raise OptionError(f"policy.expectile must lie in (0, 1], got {self.expectile}.")
        if self.temperature < 0:
            raise OptionError(f"policy.temperature must not be negative, got {self.temperature}.")
