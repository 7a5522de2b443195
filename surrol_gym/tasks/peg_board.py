"""The peg board and its blocks, shared by the transfer tasks (docs/objects.md)."""

import numpy as np
import pybullet

from surrol_gym.bullet import World
from surrol_gym.stage import Camera
from surrol_gym.units import to_su

PEG_FRAME = 0.11
"""Height of the pegs' frames above the board's centre, su."""

CLOSEUP = Camera(eye=(3.55, 0.0, 4.35), target=(2.73, 0.0, 3.55), field_of_view=42.0)

REST = 0.0175
"""How far below the frame of its peg the centre of a block rests, su."""

PEGS = (
    *((-0.030, 0.043), (-0.010, 0.043), (0.010, 0.043), (-0.030, 0.013), (-0.010, 0.013), (0.010, 0.013)),
    *((-0.033, -0.027), (0.013, -0.027), (-0.0215, -0.007081), (0.0015, -0.007081)),
    *((-0.0215, -0.046919), (0.0015, -0.046919)),
)
"""Positions of the pegs on the board, metres; the first six are targets, the others sources."""

PEGS_XY = to_su(np.array(PEGS)) + (2.75, 0.0)
TARGETS, SOURCES = np.arange(6), np.arange(6, 12)
"""Indices into ``PEGS_XY``."""

_YAW_RANGE = np.deg2rad(30)

# Middles of two walls in the block's frame: position, su, and quaternion; their x axes point into the hole.
_WALLS = tuple(
    (np.array((*to_su((0.0025, y)), 0.0)), pybullet.getQuaternionFromEuler((0.0, 0.0, np.deg2rad(yaw))))
    for y, yaw in ((0.00433, -120), (-0.00433, 120))
)


class PegBoard:
    """A board with target pegs (+y) and source pegs (-y), and blocks on source pegs.

    Args:
        world: The ``surrol_gym.bullet.World`` to load them into.
        file_name: URDF of the board.
        height: Height of the board's centre, su.
        blocks: Number of blocks.

    Attributes:
        body: Id of the red block, which is the one to be transferred.
    """

    def __init__(self, world: World, file_name: str, height: float, blocks: int):
        self._world = world
        self._frame_height = height + PEG_FRAME
        self.body = world.load("block_red.urdf", fixed=False)
        self._others = [world.load("block.urdf", fixed=False) for _ in range(1, blocks)]
        world.load(file_name, (2.75, 0.0, height))

    def place_blocks(self, rng: np.random.Generator) -> None:
        """Puts the blocks onto source pegs drawn without replacement, each turned by an angle of its own."""
        # The sources are in random order, so the first is as random for the red block as any.
        for body, source in zip((self.body, *self._others), rng.permutation(SOURCES), strict=False):
            orientation = pybullet.getQuaternionFromEuler((0.0, 0.0, rng.uniform(-_YAW_RANGE, _YAW_RANGE)))
            # SurRoL drops them from 0.03 su; they come to rest there.
            self._world.lay(body, self._frame(source) - (0.0, 0.0, REST), orientation)

    def sample_goal(self, rng: np.random.Generator) -> np.ndarray:
        """Returns the frame of a target peg, shape (3,), su."""
        return self._frame(rng.choice(TARGETS))

    def centre(self) -> np.ndarray:
        """Returns the centre of the red block, shape (3,), su, world frame."""
        return self._world.pose(self.body)[0]

    def wall(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns the middle of a wall of the red block: position (3,), su, and Euler angles (3,), radians."""
        return self._world.frame(self.body, *_WALLS[number])

    def _frame(self, peg: int) -> np.ndarray:
        return np.array((*PEGS_XY[peg], self._frame_height))


def is_on_peg(achieved_goal: np.ndarray, desired_goal: np.ndarray) -> np.ndarray:
    """Tests centres of blocks against frames of pegs, both of shape (..., 3): within 0.025 su across, 0.02 up or down.

    So near, the peg is in the hole, whether the block rests or is still held (docs/observations.md#success). At rest it
    is 0.0175 su below the frame.
    """
    difference = np.subtract(achieved_goal, desired_goal)
    return (np.hypot(difference[..., 0], difference[..., 1]) < 0.025) & (np.abs(difference[..., 2]) < 0.02)
