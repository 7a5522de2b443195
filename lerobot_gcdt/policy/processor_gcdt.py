"""Pre- and postprocessors of GCDT: LeRobot's defaults, which the policy's own normalisation leaves idle."""

from lerobot.processor import PolicyProcessorPipeline
from lerobot.processor.factory import make_default_pre_post_processors

from lerobot_gcdt.policy.configuration_gcdt import GCDTConfig


def make_gcdt_pre_post_processors(
    config: GCDTConfig, dataset_stats: dict | None = None
) -> tuple[PolicyProcessorPipeline, PolicyProcessorPipeline]:
    """Makes the processor pipelines, by the name under which LeRobot looks for them.

    Args:
        config: The policy's configuration.
        dataset_stats: Statistics of the dataset; unused, because normalisation is a part of the tokenizers.

    Returns:
        The preprocessor and the postprocessor.
    """
    return make_default_pre_post_processors(config, dataset_stats)
