"""What the configurations have in common of policies that look up episodes in a ``TrajectoryBank`` of their own."""

from dataclasses import dataclass, field

from lerobot.configs.policies import PreTrainedConfig
from lerobot.configs.types import NormalizationMode


@dataclass
class SingleFrames(PreTrainedConfig):
    """A configuration that asks LeRobot's loader for single frames, as they are.

    Attributes:
        normalization_mapping: LeRobot's normalisation is off. Its statistics are one set per key, not per task, and are
            replaced by the new dataset's at fine-tuning, which would shift what a pretrained policy sees; policies
            standardise by themselves.
    """

    normalization_mapping: dict[str, NormalizationMode] = field(
        default_factory=lambda: {kind: NormalizationMode.IDENTITY for kind in ("STATE", "ENV", "ACTION")}
    )

    def validate_features(self) -> None:
        """Nothing to check: sizes come from the dataset, because LeRobot overwrites the features at fine-tuning."""

    @property
    def observation_delta_indices(self) -> None:
        """The loader gives single frames; the policy's trajectory bank looks up the rest."""
        return None

    @property
    def action_delta_indices(self) -> None:
        """See ``observation_delta_indices``."""
        return None

    @property
    def reward_delta_indices(self) -> None:
        """The loader need not give them."""
        return None
