"""Configuration of PLAS."""

from dataclasses import dataclass

from lerobot.configs.policies import PreTrainedConfig

from lerobot_gcdt.baselines.reward_learner import RewardLearnerConfig
from lerobot_gcdt.errors import OptionError


@PreTrainedConfig.register_subclass("plas")
@dataclass
class PLASConfig(RewardLearnerConfig):
    """Configuration of ``PLASPolicy`` (Zhou, Bajracharya and Held 2020, arXiv 2011.07213), for one task.

    Attributes:
        latents_per_action: Numbers of a latent action for each number of an action.
        max_latent: Largest magnitude of a latent number that the policy may choose, standard deviations of the prior.
        kl_weight: Weight of the divergence of latent actions from their prior, beside the squared error of the action.
            It says what is noise: spread of the demonstrators' actions below the square root of half of it.
        worse_weight: Weight of the smaller of the two action values in their targets; the larger one has the rest.
    """

    latents_per_action: int = 2
    max_latent: float = 2.0
    kl_weight: float = 0.02
    worse_weight: float = 0.75

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("latents_per_action", "max_latent", "kl_weight"):
            if getattr(self, name) <= 0:
                raise OptionError(f"policy.{name} must be positive, got {getattr(self, name)}.")
        if not 0 <= self.worse_weight <= 1:
            raise OptionError(f"policy.worse_weight must lie in [0, 1], got {self.worse_weight}.")
