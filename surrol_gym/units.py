"""Scaled units (su): the PyBullet world is five times life size, so 1 su = 0.2 m (docs/simulator.md#scaled-units)."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

SCALING = 5.0
"""Scaled units per metre; also the ``globalScaling`` with which URDF files in metres are loaded."""


def to_su(metres: ArrayLike) -> Any:
    """Converts a length or position from metres to scaled units: a number to a number, a sequence to an array."""
    return np.multiply(metres, SCALING)


def to_metres(su: ArrayLike) -> Any:
    """Converts a length or position from scaled units to metres: a number to a number, a sequence to an array."""
    return np.divide(su, SCALING)
