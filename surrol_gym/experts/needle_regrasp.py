"""NeedleRegrasp: bring needle and PSM2 together, close, let PSM1 go and retreat, carry."""

from math import hypot

import numpy as np

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import CLOSE, OPEN, Target, heading
from surrol_gym.psm.arm import TIP_OFFSET
from surrol_gym.tasks.needle_regrasp import DEPTH

HELD_JAW = (0.08, 0.6)
"""Opening angle of jaws that hold the needle, radians: closed on nothing they are at 0, open at 0.7."""

LEVEL = np.deg2rad(-30)
"""Pitch of either tool when it holds a needle whose ends are at one height."""

HALF_SPAN = 0.0866
"""Half the distance between the two points where the needle is held, su."""

MEETING_X, MEETING_Z = (2.83, 2.93), (3.58, 3.75)
"""Where PSM2 can take the needle; every episode starts there, but a disturbed arm may leave."""

GRIP = DEPTH - 0.009
"""Distance along PSM2's tool from link 5 to the needle when the jaws close, su.

They take it deeper than those of PSM1 hold it, lest a push draws them off while they close.
"""

BESIDE, BACK = 0.012, 0.03
"""How far beside the needle's point open jaws still enclose it, and how far behind it they wait till they would, su."""

GAIN = 0.3
"""Share of a large offset that one step covers."""


def law(seen: Reading) -> tuple[Target, Target]:
    """Recognises each phase from the state: PSM1 opens only where both hold the needle, PSM2 only where PSM1 does."""
    to_right, to_left = seen.right - (DEPTH, 0.0, 0.0) - seen.psm1, seen.left - (GRIP, 0.0, 0.0) - seen.psm2
    second_holds = _holds(seen.psm2_jaw, to_left)
    if _holds(seen.psm1_jaw, to_right):
        return _meet(seen, to_left, second_holds)
    if HELD_JAW[0] < seen.psm2_jaw < HELD_JAW[1]:
        return _part(seen, to_right)
    return Target(np.zeros(3), jaw=OPEN), Target(np.zeros(3), jaw=OPEN)


def _holds(jaw: float, offset: np.ndarray) -> bool:
    """Whether jaws are closed on the needle where they should be."""
    return HELD_JAW[0] < jaw < HELD_JAW[1] and np.abs(offset).max() < 0.03


def _meet(seen: Reading, to_left: np.ndarray, second_holds: bool) -> tuple[Target, Target]:
    """PSM1 brings the needle to y = 0 and levels it; PSM2 goes where its point will be and closes on it from behind."""
    right, span = seen.right, seen.right - seen.left
    tilt = heading(span[2], span[1])
    ahead = np.array((np.clip(right[0], *MEETING_X), HALF_SPAN, np.clip(right[2], *MEETING_Z))) - right
    if second_holds:
        return Target(np.zeros(3), jaw=OPEN), Target(np.zeros(3), jaw=CLOSE)
    turn = LEVEL - seen.psm2_pitch
    beside = max(hypot(to_left[1], to_left[2]), 0.04 * abs(turn))
    encloses = beside < BESIDE and abs(to_left[0]) < 0.006 and np.abs(ahead).max() < 0.03
    wait = np.clip(5 * (beside - 0.5 * BESIDE), 0.0, BACK) if seen.psm2_jaw > HELD_JAW[1] else BACK
    meeting = np.array((right[0] + ahead[0] - span[0], -HALF_SPAN, right[2] + ahead[2])) - (GRIP + wait, 0.0, 0.0)
    offset = meeting - seen.psm2
    # Back before they go aside where the needle is between them.
    offset[1:] *= np.clip(1.0 + (offset[0] + 0.01) / 0.02, 0.0, 1.0) if beside < 0.08 else 1.0
    return (
        Target(ahead, -2 * tilt, CLOSE, gain=GAIN, turn_speed=1.0),
        Target(offset, 2 * turn, CLOSE if encloses else OPEN, gain=GAIN, turn_speed=1.0),
    )


def _part(seen: Reading, to_right: np.ndarray) -> tuple[Target, Target]:
    """PSM1 draws back along its tool, then aside; PSM2 waits until the way is clear and carries the needle."""
    in_the_way = hypot(to_right[1], to_right[2]) < 0.04
    back = to_right[0] - (TIP_OFFSET - DEPTH) - 0.02
    if in_the_way and back < -0.01:
        return Target(np.array((back, 0.0, 0.0)), jaw=OPEN, gain=1.0), Target(np.zeros(3), jaw=CLOSE)
    aside = np.array((min(back, 0.0) if in_the_way else 0.0, max(HALF_SPAN + 0.05 - seen.psm1_y, 0.0), 0.0))
    carry = Target(seen.goal_left - seen.left, LEVEL - seen.psm2_pitch, CLOSE, gain=GAIN)
    return Target(aside, jaw=OPEN, gain=GAIN), carry
