"""NeedleRegrasp: bring needle and PSM2 together, close, let PSM1 go and retreat, carry."""

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

BEYOND = TIP_OFFSET - DEPTH
"""How far the tips reach beyond the needle that the jaws hold, su."""

MEETING_X, MEETING_Z = (2.83, 2.93), (3.58, 3.75)
"""Where PSM2 can take the needle; every episode starts there, but a disturbed arm may leave."""


def law(seen: Reading) -> tuple[Target, Target]:
    """Recognises each phase from the state: PSM1 opens only where both hold the needle, PSM2 only where PSM1 does."""
    to_right, to_left = seen.right - (DEPTH, 0.0, 0.0) - seen.psm1, seen.left - (DEPTH, 0.0, 0.0) - seen.psm2
    first_holds, second_holds = _holds(seen.psm1_jaw, to_right, 0.03), _holds(seen.psm2_jaw, to_left, 0.012)
    if first_holds and second_holds:
        return _stay(OPEN), _stay(CLOSE)
    if first_holds:
        return _meet(seen, to_left)
    if HELD_JAW[0] < seen.psm2_jaw < HELD_JAW[1]:
        return _part(seen, to_right)
    return _stay(OPEN), _stay(OPEN)


def _holds(jaw: float, offset: np.ndarray, tolerance: float) -> bool:
    """Whether jaws are closed on the needle where they should be."""
    return HELD_JAW[0] < jaw < HELD_JAW[1] and np.abs(offset).max() < tolerance


def _stay(jaw: float) -> Target:
    return Target(np.zeros(3), jaw=jaw)


def _meet(seen: Reading, to_left: np.ndarray) -> tuple[Target, Target]:
    """PSM1 brings the needle to y = 0 and levels it; PSM2 goes where its point will be and closes on it from behind."""
    left, right = seen.left, seen.right
    span = right - left
    tilt = heading(span[2], span[1])
    meeting = np.array([np.clip(right[0], *MEETING_X), HALF_SPAN, np.clip(right[2], *MEETING_Z)])
    ahead = meeting - right
    turn = LEVEL - seen.psm2_pitch
    aside = np.hypot(to_left[1], to_left[2])
    misalignment = max(aside, 0.05 * abs(turn), 0.05 * abs(tilt))
    if misalignment < 0.002 and abs(to_left[0]) < 0.002 and np.abs(ahead).max() < 0.005:
        return _stay(CLOSE), Target(to_left, turn, CLOSE)
    if to_left[0] < BEYOND and misalignment > 0.006 and aside < 0.08:
        # Something went wrong: the tips of PSM2 are beyond the needle, but beside its point. Out the way they came.
        return Target(ahead * (1.0, 0.0, 0.0)), Target(np.array([to_left[0] - 0.03, 0.0, 0.0]), jaw=OPEN)
    clearance = np.clip(3 * (misalignment - 0.001), 0.0, 0.03) if seen.psm2_jaw > HELD_JAW[1] else 0.03
    behind = np.array([left[0] + ahead[0] - DEPTH - clearance, -HALF_SPAN, meeting[2]]) - seen.psm2
    return (
        Target(ahead, -tilt, CLOSE, gain=0.16, speed=0.4, turn_speed=1.0),
        Target(behind, turn, OPEN, gain=0.16, speed=0.4, turn_speed=1.0),
    )


def _part(seen: Reading, to_right: np.ndarray) -> tuple[Target, Target]:
    """PSM1 draws back along its tool, then aside; PSM2 waits until the way is clear and carries the needle."""
    in_the_way = np.hypot(to_right[1], to_right[2]) < 0.04
    back = to_right[0] - BEYOND - 0.02
    if in_the_way and back < -0.01:
        return Target(np.array([back, 0.0, 0.0]), jaw=OPEN, gain=0.5), _stay(CLOSE)
    aside = np.array([min(back, 0.0) if in_the_way else 0.0, max(HALF_SPAN + 0.05 - seen.psm1_y, 0.0), 0.0])
    carry = Target(seen.goal_left - seen.left, LEVEL - seen.psm2_pitch, CLOSE, gain=0.16, speed=0.4)
    return Target(aside, jaw=OPEN, gain=0.16, speed=0.4), carry
