"""The needle and its padded tray, shared by the tasks that use them (docs/objects.md#needle)."""

from math import cos, sin

import numpy as np
import pybullet

from surrol_gym.bullet import World
from surrol_gym.stage import OVERVIEW, Camera

TRAY_POSITION = (2.75, 0.0, 3.3868)
DROP_HEIGHT = 3.436
"""Height of the arc's centre from which the needle drops onto the pad, su."""

# In the needle's centre-of-mass frame, su; its x axis points away from the middle of the arc.
_ARC_CENTRE = (0.0635, 0.0, 0.0)
_MIDDLE = (-0.0365, 0.0, 0.0)
# 60 degrees from the middle along the arc on either side; the x axes of these frames point to the arc's centre, too.
_LEFT = (0.0135, -0.0866, 0.0), pybullet.getQuaternionFromEuler((0.0, 0.0, np.deg2rad(60)))
_RIGHT = (0.0135, 0.0866, 0.0), pybullet.getQuaternionFromEuler((0.0, 0.0, np.deg2rad(-60)))

CAMERAS = {
    "closeup": Camera(eye=(3.75, 0.0, 4.35), target=(2.74, 0.0, 3.53), field_of_view=40.0),
    "overview": OVERVIEW,
}


class Needle:
    """A half-circle needle of radius 0.1 su.

    Args:
        world: The ``surrol_gym.bullet.World`` to load the needle into.
        tray: Whether to load the tray, too.
    """

    def __init__(self, world: World, tray: bool = True):
        self._world = world
        if tray:
            world.load("tray_pad.urdf", TRAY_POSITION)
        self.body = world.load("needle.urdf", (*TRAY_POSITION[:2], DROP_HEIGHT), fixed=False)

    @staticmethod
    def sample_pose(rng: np.random.Generator) -> tuple[float, float, float]:
        """Draws where the needle drops: x and y of the arc's centre, su, and yaw, radians."""
        x, y = rng.uniform(-0.05, 0.05, 2)
        return TRAY_POSITION[0] + x, TRAY_POSITION[1] + y, rng.uniform(-np.pi / 2, np.pi / 2)

    def drop(self, x: float, y: float, yaw: float) -> None:
        """Puts the centre of the arc above a point of the pad, turned about the vertical by ``yaw`` radians."""
        offset = np.multiply(_ARC_CENTRE[0], (cos(yaw), sin(yaw), 0.0))
        orientation = pybullet.getQuaternionFromEuler((0.0, 0.0, yaw))
        self._world.place(self.body, (x, y, DROP_HEIGHT) - offset, orientation)

    def centre(self) -> np.ndarray:
        """Returns the centre of mass, shape (3,), su, world frame."""
        return self._world.pose(self.body)[0]

    def middle(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the middle of the arc, where it is grasped: position (3,), su, and Euler angles (3,), radians."""
        return self._world.frame(self.body, _MIDDLE)

    def left(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the point 60 degrees left of the middle: position (3,), su, and Euler angles (3,), radians."""
        return self._world.frame(self.body, *_LEFT)

    def right(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the point 60 degrees right of the middle: position (3,), su, and Euler angles (3,), radians."""
        return self._world.frame(self.body, *_RIGHT)
