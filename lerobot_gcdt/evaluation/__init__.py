"""From a policy to numbers and pictures: loading it with its processors, episodes, success rates, films and plots.

Imports the simulator and ``lerobot_gcdt.environment``. Any policy of LeRobot's can be evaluated, so none is imported.
"""

from lerobot_gcdt.evaluation.checkpoints import evaluate_checkpoint
from lerobot_gcdt.evaluation.loading import load_policy
from lerobot_gcdt.evaluation.rollout import evaluate
from lerobot_gcdt.evaluation.statistics import describe

__all__ = ["describe", "evaluate", "evaluate_checkpoint", "load_policy"]
