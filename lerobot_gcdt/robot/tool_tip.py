"""From link 5, which the simulator moves, to the tool tip that a dVRK reports, and back (docs/dvrk.md).

Positions have the shape (..., 3), metres, rotation matrices (..., 3, 3), both in one frame, whichever.
"""

import numpy as np

from surrol_gym.psm import kinematics
from surrol_gym.psm.kinematics import JAW_LENGTH, TIP_AXES


def from_link5(position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns position and rotation of the tool tip, whose z axis points along the jaws, for those of link 5."""
    return position + JAW_LENGTH * rotation[..., 1], rotation @ TIP_AXES


def to_link5(position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns position and rotation of link 5, the hinge of the jaws, for those of the tool tip."""
    return position - JAW_LENGTH * rotation[..., 2], rotation @ TIP_AXES.T


def joints(position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Returns the joints, (..., 6), that put the tool tip at a pose in the RCM frame; limits are not looked at."""
    return kinematics.inverse(*to_link5(position, rotation), on_limit="ignore")
