"""NeedleReach: straight to the goal, about as fast as the original script.

See docs/experts.md#pace-and-grasps-of-the-original.
"""

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import Target


def law(seen: Reading) -> Target:
    """Moves the tip to the goal."""
    return Target(seen.goal_tip - seen.tip, gain=0.5, speed=0.3)
