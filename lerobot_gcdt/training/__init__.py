"""One way to train: stages and policies as arguments of `lerobot-train`, which runs here or under a launcher.

Imports, of this package, what keeps a second process out of a folder.
"""

from lerobot_gcdt.training.outputs import checkpoint, existing_checkpoint, loss_curve, training_seconds
from lerobot_gcdt.training.stages import train

__all__ = ["checkpoint", "existing_checkpoint", "loss_curve", "train", "training_seconds"]
