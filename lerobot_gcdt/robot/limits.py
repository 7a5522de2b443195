"""What a PSM may be asked for (docs/dvrk.md#limits)."""

from dataclasses import dataclass

import numpy as np

RISE_TIME = 0.1
"""Seconds: no joint may gain its full speed faster. A choice of ours."""


@dataclass(frozen=True)
class Limits:
    """Limits of one arm; joints in the order of ``surrol_gym.psm.kinematics.JOINT_NAMES``.

    Positions and velocities are those of the dVRK's configuration for its simulated PSM; the others are our choice.

    Attributes:
        joints: Lowest and highest joint positions, metres and radians.
        velocity: Highest joint speeds, metres and radians a second.
        jaw: Smallest and largest opening angle of the jaws, radians.
        jaw_velocity: Highest speed of the jaws, radians a second.
        insertion: Insertion from which on the wrist is taken to be out of the cannula, metres.
        table: Lowest height of the jaw tips above the table, metres.
        arms: Shortest distance of an arm's shaft and gripper from those of the other arm, and from a no-go box, from
            surface to surface, metres.
    """

    joints: tuple[tuple[float, float], ...] = (
        *((-1.5708, 1.5708), (-0.7854, 0.7854), (0.0, 0.240)),
        *((-4.538, 4.538), (-1.2217, 1.2217), (-1.396, 1.396)),
    )
    velocity: tuple[float, ...] = (5.0, 5.0, 0.4, 50.0, 50.0, 50.0)
    jaw: tuple[float, float] = (-0.349, 1.396)
    jaw_velocity: float = 0.4
    insertion: float = 0.050
    table: float = 0.0005
    arms: float = 0.001

    @property
    def acceleration(self) -> np.ndarray:
        """Highest joint accelerations, metres and radians a second squared, (6,)."""
        return np.array(self.velocity) / RISE_TIME

    @property
    def jaw_acceleration(self) -> float:
        """Highest acceleration of the jaws, radians a second squared."""
        return self.jaw_velocity / RISE_TIME


PSM = Limits()
"""Those of the classic PSM with a large needle driver."""
