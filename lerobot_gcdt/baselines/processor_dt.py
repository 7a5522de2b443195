"""Pre- and postprocessors of the decision transformer, by the name under which LeRobot looks for them: its defaults."""

from lerobot.processor.factory import make_default_pre_post_processors as make_dt_pre_post_processors

__all__ = ["make_dt_pre_post_processors"]
