"""Pre- and postprocessors of behavioural cloning, by the name under which LeRobot looks for them: its own defaults."""

from lerobot.processor.factory import make_default_pre_post_processors as make_bc_pre_post_processors

__all__ = ["make_bc_pre_post_processors"]
