"""Pre- and postprocessors of behavioural cloning: LeRobot's defaults, left idle by the policy's own normalisation."""

from lerobot.processor.factory import make_default_pre_post_processors

from lerobot_gcdt.baselines.configuration_bc import BCConfig


def make_bc_pre_post_processors(config: BCConfig, dataset_stats=None):
    """Makes the processor pipelines, by the name under which LeRobot looks for them.

    Args:
        config: The policy's configuration.
        dataset_stats: Statistics of the dataset; unused.

    Returns:
        The preprocessor and the postprocessor.
    """
    return make_default_pre_post_processors(config, dataset_stats)
