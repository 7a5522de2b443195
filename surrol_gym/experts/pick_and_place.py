"""PickAndPlace: put the red jack into its pot, then the green one; fetch a jack that is not where it should be."""

from dataclasses import replace
from math import cos

import numpy as np

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import CLOSE, OPEN, Target, grasp

GRASP_HEIGHT = 0.0275
"""Height of link 5 above the top of a jack in the grasp, su (docs/experts.md#pace-and-grasps-of-the-original)."""

STANDING = -0.0065
"""Height of a jack's origin above the middle of the pot it stands in, su; its top is 0.05 higher."""

HELD_JAW = (0.15, 0.6)
"""Opening angle of jaws that hold a jack, radians: closed on nothing they are at 0, open at 0.7."""

HOVER = 0.07
"""Height above the grasp, or above standing in a pot, at which the tool travels, su."""

PLACED = 0.02
"""Largest offset of a jack that is left where it stands, along each axis, su."""

FOOT = 0.027
"""Distance of a jack's feet from its axis, su."""

RETREAT_HEIGHT = 3.6
"""Height to which link 5 rises when both jacks are in place, su."""

GAIN = 0.5
"""Share of the way to a distant target that one step covers."""

ALIGNED = 0.006
"""Misalignment below which the jaws close on a jack, or let it go, su."""


def law(seen: Reading) -> Target:
    """Recognises each phase from the state. The tool never turns: jaws find the ball of a jack from every side."""
    jaw = seen.psm1_jaw
    origins, eulers = np.array((seen.red, seen.green)), np.array((seen.red_top_rpy, seen.green_top_rpy))
    to_places = np.array((seen.goal_red_top, seen.goal_green_top)) + (0.0, 0.0, STANDING) - origins
    to_grasps = np.array((seen.red_top, seen.green_top)) + (0.0, 0.0, GRASP_HEIGHT) - seen.psm1
    for to_place, to_grasp, euler in zip(to_places, to_grasps, eulers, strict=True):
        if HELD_JAW[0] < jaw < HELD_JAW[1] and np.abs(to_grasp).max() < 0.02:
            return _carry(to_place, euler)
    # The green one goes first where it stands in the way.
    order = (0, 1) if np.abs(seen.goal_red_top[:2] - origins[1, :2]).max() > 0.045 else (1, 0)
    for to_place, to_grasp in zip(to_places[order, :], to_grasps[order, :], strict=True):
        if np.abs(to_place).max() > PLACED:
            target = grasp(to_grasp, hover=HOVER, aligned=ALIGNED, gain=GAIN)
            # Jaws that closed on nothing open again.
            gripper = target.jaw if jaw > HELD_JAW[0] else OPEN
            return replace(target, offset=_rise_first(target.offset), jaw=gripper)
    return Target(np.array((0.0, 0.0, max(0.0, RETREAT_HEIGHT - seen.psm1_z))), jaw=OPEN, speed=0.4)


def _carry(to_place: np.ndarray, euler: np.ndarray) -> Target:
    """Moves a held jack, above everything else, over the place where it will stand, and lets go just above it."""
    slant = np.sqrt(max(0.0, 1.0 - (cos(euler[0]) * cos(euler[1])) ** 2))
    to_place = to_place + (0.0, 0.0, 0.003 + FOOT * slant)
    lateral = np.hypot(to_place[0], to_place[1])
    if lateral < ALIGNED and abs(to_place[2]) < ALIGNED:
        return Target(np.zeros(3), jaw=OPEN)
    wanted = to_place + (0.0, 0.0, np.clip(3 * (lateral - ALIGNED), 0.0, HOVER))
    return Target(_rise_first(wanted), jaw=CLOSE, gain=GAIN)


def _rise_first(offset: np.ndarray) -> np.ndarray:
    """Reduces the horizontal part of an offset while its end is much higher."""
    share = np.clip(1.0 - (offset[2] - 0.01) / 0.02, 0.0, 1.0)
    return offset * (share, share, 1.0)
