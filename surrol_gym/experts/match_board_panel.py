"""MatchBoardPanel: open the lid, lay the letter in its cell, close the lid. Lengths are su."""

from functools import partial
from math import cos, sin, sumprod

import numpy as np
import pybullet

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import CLOSE, OPEN, Target, heading, nearest_yaw
from surrol_gym.tasks.match_board_panel import PANEL_POSITION

HELD_JAW = (0.03, 0.3)
"""Opening angle of jaws that hold the letter, radians: closed on nothing they are at 0, open at 0.7."""
ARC_OFFSET, ARC_RADIUS = 0.0052, 0.0272
"""Centre of the letter's arc, ahead of its centre of mass, and the radius of its middle line."""
GRASP_HEIGHT = 0.0431
"""Height of link 5 above the letter in the grasp."""
GRASP_ANGLES = np.pi + np.deg2rad((0, 90, -90, 45, -45, 130, -130))
"""Where along its arc the letter may be grasped: at its back, at both arms, in between and at its ends."""
GRASP_COSTS = 0.001 * np.array((0, 3, 3, 4, 4, 5, 5))
"""What each grasp is worse than the one at the back, in the unit of obstructions."""
OBSTRUCTED = 4.0
"""Weight of an obstruction when grasps, or the two sides of a standing letter, are compared."""
PARKED = np.array((3.005, 0.185, 3.3882))
"""Where a letter is put down that is in the way of the lid."""
CLOSED = 0.004
"""A lid that has slid no further is closed."""
CARRY_SPEED = 0.9
"""Largest action along an axis with the letter between the jaws."""
REST = 0.0045
"""Height of a letter that lies in its cell above its goal."""
FLAT = 0.8
"""A letter whose plane leans further, by the vertical part of its normal, stands or leans and cannot be grasped."""
TOPPLE_HEIGHT, RUN_UP, TOPPLE_SPEED = 0.06, 0.035, 0.5
"""Height of link 5 above such a letter, how far beside it the push begins, and its largest action along an axis."""
TRANSIT = 3.55
"""Height of link 5 at which a letter that has swung down between its jaws still passes above lids and handles."""
PUSH_HEIGHT = 0.048
"""Height of link 5 above the handle that it pushes."""
TOUCH = 0.0106
"""Distance from link 5 to the handle that it pushes, along y."""
ALIGNED = 0.005
"""Misalignment below which the jaws close; 0.05 su of it count as one radian."""
OPEN_ENOUGH = 0.355
"""How far a lid has slid that leaves room for the letter in any cell below it."""
PUSH_SPEED = 0.8
"""Largest action along an axis while pushing."""

_move = partial(Target, gain=0.8, turn_speed=0.8)


def law(seen: Reading) -> Target:
    """Recognises each phase from the state.

    Jaws that closed on nothing open again. A letter that lies where the lid passes is put aside first, and one that
    stands on its edge is pushed over.
    """
    position, yaw, jaw, letter = seen.psm1, nearest_yaw(seen.psm1_yaw), seen.psm1_jaw, seen.letter
    handle, slid = seen.handle, seen.handle_y - seen.goal_handle_y
    grasps, yaws = _grasps(letter, seen.grip_yaw)
    to_grasps = grasps - position
    lateral, height = np.hypot(to_grasps[:, 0], to_grasps[:, 1]), to_grasps[0, 2]
    near = lateral.min() < 0.015 and -0.025 < height < 0.015
    to_goal = seen.goal_letter + (0.0, 0.0, REST) - letter
    held = near and HELD_JAW[0] < jaw < HELD_JAW[1]
    if _lies_at(to_goal, held):
        if near:
            return _move(np.array((0.0, 0.0, 0.05 if jaw > 0.4 else 0.0)), jaw=OPEN)
        if slid > CLOSED:
            return _push(position, yaw, jaw, handle, side=1, to=seen.goal_handle_y - 0.001)
        return _move(np.array((0.0, 0.0, max(0.0, TRANSIT - position[2]))), -yaw)
    if held:
        if slid < OPEN_ENOUGH:
            to_goal = PARKED - letter
            if _lies_at(to_goal, held):
                return Target(np.zeros(3), jaw=OPEN)
        return _move(_over(to_goal + (0.0, 0.0, 0.003), position), speed=CARRY_SPEED)
    normal = _normal(seen.grip_rpy)
    if abs(normal[2]) < FLAT:
        return _topple(position, yaw, letter, normal, handle)
    on_the_way = abs(letter[0] - handle[0]) < 0.1 and letter[1] > 0.09 and letter[2] < handle[2] - 0.02
    if on_the_way and slid > max(letter[1] - 0.13, CLOSED):
        return _push(position, yaw, jaw, handle, side=1, to=seen.goal_handle_y - 0.001)
    if slid < OPEN_ENOUGH and not on_the_way:
        return _push(position, yaw, jaw, handle, side=-1, to=seen.goal_handle_y + OPEN_ENOUGH + 0.015)
    best = np.argmin(OBSTRUCTED * _obstructions(grasps, yaws, handle) + GRASP_COSTS)
    to_grasp, turn = to_grasps[best], yaws[best] - yaw
    there = max(lateral[best], abs(height), 0.05 * abs(turn)) < ALIGNED
    return _move(_over(to_grasp, position, turn), turn, CLOSE if there and jaw > HELD_JAW[0] else OPEN)


def _grasps(letter: np.ndarray, yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Where link 5 may grasp the letter, one place for each of ``GRASP_ANGLES``, su, and the yaws of the jaws."""
    along = yaw + GRASP_ANGLES
    outward = np.array([(cos(angle), sin(angle), 0.0) for angle in along])
    middle = letter - ARC_OFFSET * outward[0] + (0.0, 0.0, GRASP_HEIGHT)
    return middle + ARC_RADIUS * outward, along % np.pi


def _obstructions(grasps: np.ndarray, yaws: np.ndarray, handle: np.ndarray) -> np.ndarray:
    """How far open jaws at each grasp would reach out of the workspace or onto a lid, su."""
    x, y = grasps[:, 0], grasps[:, 1]
    width, length = 0.008 + 0.0175 * np.abs([(cos(yaw), sin(yaw)) for yaw in yaws]).T
    outside = np.maximum(x - 3.018, 0.0) + np.maximum(-0.268 - y, 0.0)
    across, over_panel = np.abs(x - handle[0]), 0.19 - np.abs(x - PANEL_POSITION[0]) + width
    closed_lids = np.minimum.reduce((across + width - 0.0625, over_panel, 0.0875 - y + length))
    open_lid = np.minimum(0.0625 - across + width, y + length - handle[1] + 0.36875)
    return outside + np.maximum(np.maximum(closed_lids, open_lid), 0.0)


def _lies_at(offset: np.ndarray, held: bool) -> bool:
    """Whether the letter lies where ``offset`` leads; while held it has to be nearer than later."""
    return np.hypot(offset[0], offset[1]) < (0.005 if held else 0.012) and offset[2] > -0.006


def _normal(euler: np.ndarray) -> np.ndarray:
    """The direction across the letter's plane, shape (3,)."""
    return np.array(pybullet.getMatrixFromQuaternion(pybullet.getQuaternionFromEuler(euler)))[2::3]


def _topple(position: np.ndarray, yaw: float, letter: np.ndarray, normal: np.ndarray, handle: np.ndarray) -> Target:
    """Pushes the letter over, across its plane, with jaws open along it: closed ones would slip through the C."""
    across = normal * (1.0, 1.0, 0.0) / np.hypot(normal[0], normal[1])
    jaws = heading(across[0], -across[1]) % np.pi
    offset, turn = letter + (0.0, 0.0, TOPPLE_HEIGHT) - position, jaws - yaw
    distance = sumprod(offset, across)
    if np.abs(offset - distance * across).max() < 0.01 and abs(turn) < 0.25:
        return Target(offset + np.copysign(0.03, distance) * across, turn, OPEN, speed=TOPPLE_SPEED)
    starts = offset + np.outer((-RUN_UP, RUN_UP), across)
    obstructions = _obstructions(position + starts, np.full(2, jaws), handle)
    start = starts[np.argmin(OBSTRUCTED * obstructions + 0.2 * np.linalg.norm(starts, axis=1))]
    return _move(_over(start, position, turn), turn, OPEN)


def _push(position: np.ndarray, yaw: float, jaw: float, handle: np.ndarray, side: int, to: float) -> Target:
    """Pushes the handle along y with closed jaws, from its side ``side``, until it is at ``to``.

    The jaws are turned so that the handle does not push them open. They go slowly enough not to jump over it.
    """
    offset = handle + (0.0, side * TOUCH, PUSH_HEIGHT) - position
    gap = -side * offset[1]
    if max(abs(offset[0]), abs(offset[2])) < 0.004 and -0.005 < gap < 0.025 and abs(yaw) < 0.12:
        return _move(offset + (0.0, to - handle[1], 0.0), -yaw, speed=PUSH_SPEED)
    # Jaws that closed around the handle let it go on their way up.
    stuck = jaw > 0.1 and offset[2] > -0.03 and np.hypot(offset[0], gap + TOUCH) < 0.05
    return _move(_over(offset + (0.0, side * 0.012, 0.0), position), -yaw, OPEN if stuck else CLOSE)


def _over(offset: np.ndarray, position: np.ndarray, turn: float = 0.0) -> np.ndarray:
    """The next part of a way up, across everything and, once turned, down to ``offset``."""
    misalignment = max(np.hypot(offset[0], offset[1]), 0.05 * abs(turn))
    clearance = np.clip(3 * (misalignment - 0.006), 0.0, TRANSIT - (position[2] + offset[2]))
    rise = offset[2] + clearance
    across = np.clip((0.045 - rise) / 0.03, 0.0, 1.0)
    return np.array((across * offset[0], across * offset[1], rise))
