"""Pre- and postprocessors of GCDT, by the name under which LeRobot looks for them: its own defaults."""

from lerobot.processor.factory import make_default_pre_post_processors as make_gcdt_pre_post_processors

__all__ = ["make_gcdt_pre_post_processors"]
