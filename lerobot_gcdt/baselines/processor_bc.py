"""Pre- and postprocessors of behavioural cloning, by the name under which LeRobot looks for them: those of GCDT."""

from lerobot_gcdt.processor_gcdt import make_gcdt_pre_post_processors as make_bc_pre_post_processors

__all__ = ["make_bc_pre_post_processors"]
