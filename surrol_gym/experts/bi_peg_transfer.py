"""BiPegTransfer: PSM2 grasps its wall and brings the block to the meeting point, PSM1 takes it over and places it."""

from math import hypot

import numpy as np

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import CLOSE, OPEN, Target
from surrol_gym.experts.blocks import CARRIED, Block, Hand
from surrol_gym.tasks.bi_peg_transfer import BiPegTransferEnv
from surrol_gym.tasks.peg_board import REST, is_on_peg

PEG_TIP = 0.042
"""Height of a peg's tip above its frame, su."""

MEETING_POINT = np.array((2.7, 0.02))
"""Where the block changes hands; there both arms reach it."""


def law(seen: Reading) -> tuple[Target, Target]:
    """Recognises each phase from the state.

    Whichever arm reaches a block that was dropped picks it up. One that fell over is stood up by PSM1, at the goal's
    peg; PSM2 lays it down where PSM1 reaches it.
    """
    goal, psm1, psm2 = seen.goal_block, seen.psm1, seen.psm2
    rest = goal - (0.0, 0.0, REST)
    block = Block(seen.block, seen.wall1_rpy, ground=rest[2], tip=goal[2] + PEG_TIP)
    limits1, limits2 = (mount.limits() for mount in BiPegTransferEnv.mounts)
    hand2 = Hand(psm2, seen.psm2_yaw, seen.psm2_jaw, block, limits2, walls=(1, 0, 2))
    hand1 = Hand(psm1, seen.psm1_yaw, seen.psm1_jaw, block, limits1, avoid=psm2 if hand2.holds else None)
    meeting = np.array((*MEETING_POINT, block.tip + CARRIED))
    if hand2.holds:  # at a wall that may keep it from bringing the block all the way
        meeting[1] = min(meeting[1], block.centre[1] + limits2[1][1] - 0.005 - psm2[1])
    still = np.zeros(3)
    # Out of the way: up, then towards the own side.
    park2 = Target(_park(psm2, -0.12, block.ground), jaw=OPEN)
    if is_on_peg(block.centre, goal) and not (hand1.holds and block.centre[2] > goal[2]):
        return hand1.retreat(), park2
    if hand1.holds:
        if hypot(*hand2.offset) < 0.06:
            return Target(still, jaw=CLOSE), hand2.retreat()
        return (hand1.carry(rest) if block.stands else hand1.lay_across(goal[:2])), park2
    if hand2.holds:
        if not block.stands:
            return Target(_park(psm1, 0.15, block.ground), jaw=OPEN), hand2.lay_down(MEETING_POINT)
        return hand1.grasp(_beyond(meeting - block.centre)), hand2.carry(meeting)
    if hand1.reaches and block.centre[1] > 0.0:
        return hand1.grasp(), park2
    return hand1.grasp(meeting - block.centre), hand2.grasp()


def _park(position: np.ndarray, y: float, ground: float) -> np.ndarray:
    aside = y - position[1] if (y - position[1]) * y > 0 else 0.0
    rise = max(ground + 0.23 - position[2], 0.0)
    return np.array((0.0, aside if rise < 0.05 else 0.0, rise))


def _beyond(offset: np.ndarray) -> np.ndarray:
    """An offset, or zero when it is small: a held block need not be followed any more."""
    return offset if np.abs(offset).max() > 0.004 else np.zeros(3)
