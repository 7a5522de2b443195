"""Pre- and postprocessors of implicit Q-learning, by the name under which LeRobot looks for them: its defaults."""

from lerobot.processor.factory import make_default_pre_post_processors as make_iql_pre_post_processors

__all__ = ["make_iql_pre_post_processors"]
