"""NeedlePick: approach above the needle, descend, close, carry."""

import numpy as np

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import CLOSE, Target, grasp, nearest_yaw
from surrol_gym.psm.arm import TIP_OFFSET

GRASP_HEIGHT = TIP_OFFSET - 0.0035
"""Height of link 5 above the needle's middle in the grasp, su (docs/experts.md#pace-and-grasps-of-the-original)."""

HELD_JAW = (0.08, 0.45)
"""Opening angle of jaws that hold the needle, radians: closed on nothing they are at 0, open at 0.7."""

GAIN = 0.3
"""Share of the way to a distant target that one step covers."""


def law(seen: Reading) -> Target:
    """Recognises each phase from the state; jaws that closed on nothing open again."""
    to_grasp = seen.middle + (0.0, 0.0, GRASP_HEIGHT) - seen.psm1
    lateral = np.hypot(to_grasp[0], to_grasp[1])
    if HELD_JAW[0] < seen.psm1_jaw < HELD_JAW[1] and lateral < 0.02 and abs(to_grasp[2]) < 0.02:
        return Target(seen.goal_middle - seen.middle, jaw=CLOSE, gain=GAIN, speed=0.6)
    # The jaws are symmetric; of the two orientations across the needle the one with a yaw within 90 degrees of 0 is
    # taken, not the nearer one: it is always within reach of the roll joint, and the choice flips where no episode
    # starts. Where it flips, learners would find no action between the two.
    turn = nearest_yaw(seen.middle_yaw, np.pi, middle=0.0) - nearest_yaw(seen.psm1_yaw)
    return grasp(to_grasp, turn, gain=GAIN, turn_speed=0.8)
