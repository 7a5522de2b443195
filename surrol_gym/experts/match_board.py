"""MatchBoard: grasp the piece by its stroke, carry it over the board, turn it and let it drop into its recess."""

from dataclasses import replace
from math import cos, hypot, sin, sumprod

import numpy as np

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import CLOSE, OPEN, Target, grasp, heading, nearest_yaw
from surrol_gym.psm.arm import TIP_OFFSET, euler_to_matrix
from surrol_gym.tasks.match_board import BOARD_POSITION, BOARD_TOP, CELL, GLYPHS, SEATED, TILE

CATCHES = {
    "0": (0.0, 0.0148, 0.0),
    "1": (0.0, 0.0, 0.0),
    "2": (0.0031, 0.0044, -35.2),
    "4": (0.0133, 0.0038, -90.0),
    "5": (-0.0045, -0.0015, -90.0),
    "6": (0.0364, 0.0, -90.0),
    "A": (0.0119, 0.0, -90.0),
    "B": (0.0, -0.0050, -90.0),
    "C": (0.0, -0.0315, 0.0),
}
"""Where the expert grasps a piece: a point in its frame, x and y, su, and the direction of the stroke there, degrees.

Open jaws have room on both sides, also beside the board (0 and 4: off the middle of the stroke, for the room), and the
line along which they close passes the centre of mass, or nearly: so the piece hangs level from them.
"""

GRASP_DEPTHS = dict.fromkeys(GLYPHS, 0.006) | {"1": 0.002}
"""How far below the middle of a piece the closed tips are in the grasp, su; the 1 is thin."""

REACH = 0.2695
"""Distance from the middle that link 5 can reach along y, su."""

TILT_REACH = 0.045
"""Half the length of a piece, roughly, by which a slanting one is let go higher, su."""

HELD_JAW = (0.03, 0.6)
"""Opening angle of jaws that hold a piece, radians: closed on nothing they are at 0, open at 0.7."""

HOVER = 0.045
"""Height above the place of release at which a piece travels, su."""

RETREAT_HEIGHT = 3.55
"""Height to which link 5 rises when the piece is in its recess, su."""

GAIN, TURN_SPEED = 0.5, 0.8
"""Share of the way to a distant target that one step covers, and the largest turning action."""

# The same as arrays, by class.
_CATCHES = np.array([(*CATCHES[glyph][:2], np.deg2rad(CATCHES[glyph][2]), GRASP_DEPTHS[glyph]) for glyph in GLYPHS])


def law(seen: Reading) -> Target:
    """Recognises each phase from the state.

    A piece that lies anywhere else, be it on the rim or upside down, is grasped again; one that stands is toppled.
    """
    position, tool_yaw, jaw, piece = seen.psm1, nearest_yaw(seen.psm1_yaw), seen.psm1_jaw, seen.piece
    number = round(float(seen.piece_class))
    catch_x, catch_y, catch_direction, depth = _CATCHES[number]
    rotation = euler_to_matrix(seen.mark_rpy)
    catch = piece + catch_x * rotation[:, 0] + catch_y * rotation[:, 1]
    stroke = cos(catch_direction) * rotation[:, 0] + sin(catch_direction) * rotation[:, 1]
    to_grasp = catch + (0.0, 0.0, TIP_OFFSET - depth) - position
    # Tips must not touch the tiles. A little beyond the workspace, jaws at its limit still enclose the stroke.
    above_tiles = BOARD_POSITION[2] + BOARD_TOP + TIP_OFFSET - position[2]
    reachable = to_grasp + (0.0, np.clip(catch[1], -REACH, REACH) - catch[1], 0.0)
    if np.abs(catch[:2] - BOARD_POSITION[:2]).max() < 1.5 * TILE + 0.03:
        reachable[2] = max(to_grasp[2], above_tiles + 0.0005)
    # The recesses are not where the goals are.
    seat = BOARD_POSITION + (seen.goal_mark - BOARD_POSITION) * (TILE / CELL)
    if HELD_JAW[0] < jaw < HELD_JAW[1] and np.abs(to_grasp).max() < 0.025:
        # Upside down it fits both ways.
        upright = heading(rotation[1, 0], rotation[0, 0])
        turn = nearest_yaw(tool_yaw - upright, 2 * np.pi if rotation[2, 2] > 0 else np.pi) - tool_yaw
        slant = TILT_REACH * np.sqrt(max(0.0, 1.0 - rotation[2, 2] ** 2))
        to_release = seat + (0.0, 0.0, BOARD_TOP + 0.001 + depth + slant) - piece
        to_release[2] = max(to_release[2], above_tiles + 0.001)
        return _carry(to_release, turn, 0.003 + 0.1 * slant)
    from_seat = piece - seat
    if np.hypot(from_seat[0], from_seat[1]) < 0.012 and from_seat[2] < SEATED[number] - 0.001:
        return Target(np.array((0.0, 0.0, max(0.0, RETREAT_HEIGHT - position[2]))), jaw=OPEN, speed=0.4)
    if abs(rotation[2, 2]) < 0.6:
        return _topple(piece, rotation[:2, 2], position, jaw)
    turn = nearest_yaw(heading(stroke[1], stroke[0]) + np.pi / 2, np.pi) - tool_yaw  # the jaws are symmetric
    target = grasp(reachable, turn, gain=GAIN, turn_speed=TURN_SPEED)
    # Jaws that closed on nothing open again.
    return target if jaw > HELD_JAW[0] else replace(target, jaw=OPEN)


def _topple(piece: np.ndarray, normal: np.ndarray, position: np.ndarray, jaw: float) -> Target:
    """Pushes a piece that stands on its edge, along the normal of its plane, with closed jaws from the nearer side."""
    normal = np.append(normal, 0.0) / hypot(*normal)
    push_at = piece + (0.0, 0.0, 0.008 + TIP_OFFSET) - position
    distance = sumprod(push_at, normal)
    side = 1.0 if distance < 0 else -1.0
    gripper = CLOSE if jaw < HELD_JAW[0] or abs(distance) > 0.03 else OPEN  # not around the piece
    across = push_at - distance * normal
    if np.abs(across).max() < 0.008:
        return Target(push_at - 0.03 * side * normal, jaw=gripper, speed=0.3)
    beside = push_at + 0.045 * side * normal
    return Target(beside + (0.0, 0.0, np.clip(3 * (np.hypot(*beside[:2]) - 0.005), 0.0, 0.06)), jaw=gripper)


def _carry(to_release: np.ndarray, turn: float, tolerance: float) -> Target:
    """Moves a held piece above the board to the place where it is let go, and turns it on the way."""
    misalignment = max(np.hypot(to_release[0], to_release[1]), 0.05 * abs(turn))
    if misalignment < tolerance and abs(to_release[2]) < 0.003:
        return Target(np.zeros(3), jaw=OPEN)
    wanted = to_release + (0.0, 0.0, np.clip(4 * (misalignment - tolerance), 0.0, HOVER))
    share = np.clip(1.0 - (wanted[2] - 0.005) / 0.015, 0.0, 1.0)  # up first
    return Target(wanted * (share, share, 1.0), turn * share, CLOSE, gain=GAIN, speed=0.9, turn_speed=TURN_SPEED)
