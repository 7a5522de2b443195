"""Pre- and postprocessors of PLAS, by the name under which LeRobot looks for them: its defaults."""

from lerobot.processor.factory import make_default_pre_post_processors as make_plas_pre_post_processors

__all__ = ["make_plas_pre_post_processors"]
