"""Pre- and postprocessors of the nearest neighbours, by the name under which LeRobot looks for them: its defaults."""

from lerobot.processor.factory import make_default_pre_post_processors as make_vinn_pre_post_processors

__all__ = ["make_vinn_pre_post_processors"]
