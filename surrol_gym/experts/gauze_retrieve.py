"""GauzeRetrieve: approach above the gauze, descend, close, lift, carry."""

import numpy as np

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import Target, grasp
from surrol_gym.psm.arm import TIP_OFFSET
from surrol_gym.tasks.gauze_retrieve import ATTACH_HEIGHT

REST_HEIGHT = 3.3891
"""Height of the centre of the gauze in the tray, su (docs/reference_values.md#heights-at-rest)."""

GRASP_HEIGHT = TIP_OFFSET - 0.005
"""Height of link 5 above the centre of the gauze in the grasp, su: the tips are 2.5e-3 above the tray."""

HELD_JAW = (0.12, 0.62)
"""Opening angle of jaws that hold the gauze, radians: closed on nothing they are at 0, open at 0.7."""

GAIN = 0.5
"""Share of the way to a distant target that one step covers."""


def law(seen: Reading) -> Target:
    """Recognises each phase from the state; jaws that closed on nothing open again."""
    to_grasp = seen.gauze + (0.0, 0.0, GRASP_HEIGHT) - seen.psm1
    if not (HELD_JAW[0] < seen.psm1_jaw < HELD_JAW[1] and np.abs(to_grasp).max() < 0.02):
        return grasp(to_grasp, gain=GAIN)
    to_goal = seen.goal_gauze - seen.gauze
    if seen.gauze_z < REST_HEIGHT + ATTACH_HEIGHT + 0.001:
        # Friction alone holds the gauze; moved aside or fast, it would turn or slip.
        return Target(to_goal * (0.0, 0.0, 1.0), gain=GAIN, speed=0.4)
    return Target(to_goal, gain=GAIN, speed=0.8)
