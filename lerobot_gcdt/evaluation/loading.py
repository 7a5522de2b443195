"""Loading trained policies of any type together with the processors that they were trained with."""

from dataclasses import dataclass
from pathlib import Path

from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.processor import PolicyProcessorPipeline
from lerobot.utils.import_utils import register_third_party_plugins
from torch import Tensor


@dataclass
class ProcessedPolicy:
    """A policy between its processors: observations of the environment in, actions of the environment out.

    Attributes:
        policy: The bare policy.
        preprocessor: Turns observations into what the policy takes: moves them to its device, normalises them.
        postprocessor: Turns what the policy returns into actions.
    """

    policy: PreTrainedPolicy
    preprocessor: PolicyProcessorPipeline
    postprocessor: PolicyProcessorPipeline

    @property
    def config(self) -> PreTrainedConfig:
        """The policy's configuration."""
        return self.policy.config

    def reset(self) -> None:
        """Begins new episodes."""
        self.policy.reset()
        self.preprocessor.reset()
        self.postprocessor.reset()

    def select_action(self, batch: dict) -> Tensor:
        """Returns the action for each row of ``observation.*``, shape (B, A), on the CPU."""
        return self.postprocessor(self.policy.select_action(self.preprocessor(batch)))


def load_policy(path: str | Path) -> ProcessedPolicy:
    """Loads a policy of any type for inference.

    Args:
        path: Folder of a checkpoint of `lerobot-train` (``.../pretrained_model``), or a repository on the Hub.

    Returns:
        The policy and its processors, for ``lerobot_gcdt.evaluation.evaluate`` and
        ``lerobot_gcdt.evaluation.pictures.film``.

    Raises:
        FileNotFoundError: There is no checkpoint, or its processors are missing.
    """
    register_third_party_plugins()
    config = PreTrainedConfig.from_pretrained(path)
    policy = get_policy_class(config.type).from_pretrained(path, config=config)
    preprocessor, postprocessor = make_pre_post_processors(
        config,
        pretrained_path=str(path),
        preprocessor_overrides={"device_processor": {"device": str(config.device)}},  # the saved one may not be here
    )
    return ProcessedPolicy(policy, preprocessor, postprocessor)
