"""What the experts of the transfer tasks do with a block. Lengths are su."""

from collections.abc import Sequence
from math import hypot

import numpy as np

from surrol_gym.bullet import Vector
from surrol_gym.experts import CLOSE, OPEN, Target, heading
from surrol_gym.psm.arm import TIP_OFFSET, euler_to_matrix
from surrol_gym.tasks.peg_board import PEGS_XY

WALL, CORNER = 0.025, 0.0485
"""Distance of the middle of a wall, and of a corner, from the centre of the block."""

LYING = -0.011
"""How much lower the centre of a block is that lies on its side."""

CARRIED = 0.09
"""Height of the centre above the pegs' tips while the block is carried."""

# of link 5 above the middle of the wall (docs/experts.md#pace-and-grasps-of-the-original)
_GRASP_HEIGHT = 0.015 + TIP_OFFSET
_RIDGE_HEIGHT = TIP_OFFSET - 0.013  # of link 5 above the ridge of a lying block
_ALIGNED = 0.006  # misalignment of the hand below which open jaws enclose the wall
_HELD_JAW = (0.03, 0.5)  # radians: closed on nothing the jaws are at 0, open at 0.7
_STUCK_JAW = 0.75  # radians: something inside pushes the jaws apart
_HOVER = 0.1  # of link 5 above the grasp, so that open jaws pass above pegs
_HOLE_PLAY = 0.015  # across, between hole and peg
_WALL_DIRECTIONS = (-1.0, 0.0), (0.5, 0.75**0.5), (0.5, -(0.75**0.5))  # outward, in the frame of the first wall


class Block:
    """A block as an expert sees it.

    Args:
        centre: Its centre, shape (3,).
        wall_euler: Euler angles of its first wall, radians.
        ground: Height of its centre when it stands on the board.
        tip: Height of the tips of the pegs.

    Attributes:
        axis: Direction of the hole, unit vector.
        walls: Outward directions of the three walls, first those of ``PegBoard.wall``, shape (3, 3).
    """

    def __init__(self, centre: np.ndarray, wall_euler: np.ndarray, ground: float, tip: float):
        self.centre, self.ground, self.tip = centre, ground, tip
        rotation = euler_to_matrix(wall_euler)
        self.axis = rotation[:, 2]
        self.walls = np.array([c * rotation[:, 0] + s * rotation[:, 1] for c, s in _WALL_DIRECTIONS])

    @property
    def stands(self) -> bool:
        """Whether the hole is upright enough to be grasped and threaded."""
        return abs(self.axis[2]) > 0.8

    @property
    def leans(self) -> bool:
        """Whether it got caught on something, neither standing nor lying with a corner on top."""
        return not self.stands and (abs(self.axis[2]) > 0.35 or self.ridge[2] < 0.8)

    @property
    def ridge(self) -> np.ndarray:
        """Direction of the corner that is most on top."""
        return -self.walls[self.walls[:, 2].argmin()]

    def is_threaded(self, goal: np.ndarray) -> bool:
        """Whether the goal's peg, whose frame is at ``goal``, is well inside the hole."""
        across = np.hypot(*(goal - self.centre)[:2])
        return self.stands and across < 0.008 and self.centre[2] < goal[2] + 0.04

    @property
    def clears_pegs(self) -> bool:
        """Whether it is above all pegs."""
        return self.centre[2] > self.tip + 0.0425


class Hand:
    """What one arm can do with the block.

    A standing block is grasped at a wall, one jaw in the hole, a lying one at the ridge on top.

    Args:
        position: Of its link 5, shape (3,).
        yaw: Of its tool, radians.
        jaw: Opening angle of its jaws, radians.
        block: The ``Block``.
        limits: Lowest and highest position of link 5.
        walls: Indices of the block's walls, the one to be preferred first.
        avoid: Position of the other arm if it holds the block, else None.

    Attributes:
        offset: From link 5 to where it grasps, shape (3,).
        turn: Rotation of the tool that is left to do before, radians.
        holds: Whether the block is held.
        reaches: Whether the grasp is within the limits.
    """

    def __init__(
        self,
        position: np.ndarray,
        yaw: float,
        jaw: float,
        block: Block,
        limits: np.ndarray,
        walls: Sequence[int] = (0, 1, 2),
        avoid: np.ndarray | None = None,
    ):
        self._position, self._jaw = position, jaw
        self._block, self._helped = block, avoid is not None
        points, directions = self._wall_grasps(list(walls)) if block.stands else self._ridge_grasp()
        within = ((points > limits[0]) & (points < limits[1]))[:, :2].all(axis=1)
        room = self._room(points, avoid)
        free = within & (room > 0.027)
        choice = free.argmax() if free.any() else (room * within).argmax()
        self.offset = points[choice] - self._position
        self.reaches = bool(within[choice])
        # Of the two orientations across, one is always within [0, 180] degrees and so in reach of the roll joint.
        yaw = (yaw + 2.0) % (2 * np.pi) - 2.0
        self.turn = heading(directions[choice][1], directions[choice][0]) % np.pi - yaw
        near = np.linalg.norm(points - self._position, axis=1).min() < 0.025
        # In the air the wall may slip between closed jaws, and they still hold it.
        slip = -0.3 if block.centre[2] > block.tip + 0.02 else _HELD_JAW[0]
        self.holds = bool(near and slip < self._jaw < _HELD_JAW[1])

    def _wall_grasps(self, order: list[int]) -> tuple[np.ndarray, np.ndarray]:
        directions = self._block.walls[order]
        points = self._block.centre + WALL * directions
        # Open jaws need a little more room than the block leaves between its wall and the peg.
        points += np.clip(0.03 - self._room(points), 0.0, 0.005)[:, None] * directions
        return points + (0.0, 0.0, _GRASP_HEIGHT), directions

    def _ridge_grasp(self) -> tuple[np.ndarray, np.ndarray]:
        block = self._block
        middle = block.centre + CORNER * block.ridge + (0.0, 0.0, _RIDGE_HEIGHT)
        points = middle + np.array(((0.0,), (0.022,), (-0.022,))) * block.axis
        return points, np.repeat(((-block.axis[1], block.axis[0]),), 3, axis=0)

    def _room(self, points: np.ndarray, avoid: np.ndarray | None = None) -> np.ndarray:
        """Distance across of each point from the nearest peg that is in the way, and from the other arm."""
        obstacles = [] if self._block.clears_pegs else [*PEGS_XY]
        obstacles += [] if avoid is None else [avoid[:2]]
        across = points[:, None, :2] - np.reshape(obstacles, (-1, 2))
        return np.linalg.norm(across, axis=-1).min(axis=1, initial=1.0)

    def grasp(self, ahead: Vector = (0.0, 0.0, 0.0)) -> Target:
        """Approaches the block from above, open, and closes the jaws on it.

        Args:
            ahead: From the block to where it will be; until it is there, the hand waits above that place.
        """
        if self._jaw > _STUCK_JAW:
            return Target(np.array((0.0, 0.0, 0.05)), jaw=OPEN)
        if self._block.leans:
            return self._poke()
        if self._block.centre[2] > self._block.tip + 0.0825 and not self._helped:
            # It hangs on the jaws, but not in their grasp: shake it off.
            return Target(np.zeros(3), jaw=CLOSE if self._jaw > _HELD_JAW[1] else OPEN)
        misalignment = max(np.hypot(*self.offset[:2]), 0.15 * abs(self.turn)) + hypot(*ahead)
        if misalignment < _ALIGNED and abs(self.offset[2]) < 0.009:
            return Target(self.offset, self.turn, CLOSE, gain=0.5)
        return self._approach(self.offset + ahead, misalignment, self.turn, OPEN)

    def carry(self, goal: np.ndarray) -> Target:
        """Brings the block to a point: up until it clears the pegs, across, down again where the hole is over the peg.

        Args:
            goal: Where the centre of the block has to be, shape (3,).
        """
        block = self._block
        # Still on the board: finish the descent with closed jaws. It takes the step that the grasp needs to attach.
        depth = self._position[2] - (block.ground + _GRASP_HEIGHT)
        if block.stands and block.centre[2] < block.ground + 0.005 and 0.0015 < depth < 0.01:
            return Target(np.array((0.0, 0.0, -depth)), gain=0.5)
        height = block.tip + CARRIED
        offset = goal - block.centre
        across = np.hypot(offset[0], offset[1])
        rise = np.clip(goal[2] + 12 * (across - 0.004), goal[2], height) - block.centre[2]
        share = 1.0 if across < _HOLE_PLAY else np.clip((block.centre[2] - height + 0.045) / 0.02, 0.0, 1.0)
        return Target(np.array((*share * offset[:2], rise)), gain=0.5, speed=0.9)

    def lay_across(self, peg: np.ndarray) -> Target:
        """Rights a lying block: lays one of its ends on the tip of a peg and lets go, and it tips over and stands.

        Args:
            peg: A free peg, shape (2,).
        """
        # The other end points to the middle of the free pegs.
        place = np.array((peg[0], peg[1] + np.copysign(0.0275, 0.14 - peg[1]), self._block.tip + 0.0305))
        axis = self._block.axis
        turn = np.pi / 2 - heading(axis[1], axis[0]) % np.pi
        return self._lay(place, turn)

    def lay_down(self, place: np.ndarray) -> Target:
        """Lays a lying block down on the board at a place, shape (2,)."""
        return self._lay(np.array((*place, self._block.ground + LYING + 0.004)), 0.0)

    def _lay(self, place: np.ndarray, turn: float) -> Target:
        offset = place - self._block.centre
        if np.abs(offset).max() < 0.004 and abs(turn) < 0.06:
            return Target(np.array((0.0, 0.0, 0.03)), jaw=OPEN)
        # Friction alone holds the block until it is attached: slowly at first.
        rise = self._block.centre[2] - (self._block.ground + LYING + 0.003)
        free = self._block.centre[2] > self._block.tip + 0.02
        speed = np.clip(0.1 + 25 * rise, 0.1, 0.9)
        return Target(self.carry(place).offset, turn if free else 0.0, gain=0.5, speed=speed, turn_speed=0.7)

    def _poke(self) -> Target:
        """Pushes a leaning block down with closed jaws: at its higher end, or where it can roll onto a flat side."""
        block = self._block
        if abs(block.axis[2]) > 0.35:
            aside = 0.025 * np.sign(block.axis[2]) * block.axis
        else:
            aside = -0.03 * block.walls[block.walls[:, 2].argsort()[1]]
        offset = block.centre + (*aside[:2], TIP_OFFSET - 0.03) - self._position
        jaw = OPEN if _HELD_JAW[0] < self._jaw < _HELD_JAW[1] else CLOSE  # rather than drag it along
        return self._approach(offset, np.hypot(offset[0], offset[1]), 0.0, jaw, hover=0.16)

    def retreat(self) -> Target:
        """Opens the jaws and moves up, out of the block."""
        return Target(np.array((0.0, 0.0, max(_HOVER + self.offset[2], 0.0))), jaw=OPEN, gain=0.7)

    @staticmethod
    def _approach(offset: np.ndarray, misalignment: float, turn: float, jaw: float, hover: float = _HOVER) -> Target:
        clearance = np.clip(3 * (misalignment - _ALIGNED), 0.0, hover)
        return Target(offset + (0.0, 0.0, clearance), turn, jaw, gain=0.4, speed=0.9, turn_speed=0.7)
