"""One way to train: the arguments of `lerobot-train`, and where its checkpoints lie.

Imports nothing of this package.
"""

from lerobot_gcdt.training.arguments import arguments_to_reach, checkpoint

__all__ = ["arguments_to_reach", "checkpoint"]
