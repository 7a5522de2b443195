"""Keys of the datasets' columns."""

from lerobot.utils.constants import OBS_IMAGES

STATE = "observation.state"
GOAL = "observation.goal"
ACHIEVED_GOAL = "observation.achieved_goal"
TIME_TO_GOAL = "observation.time_to_goal"
ACTION = "action"
REQUIRED_KEYS = (STATE, GOAL, ACHIEVED_GOAL, TIME_TO_GOAL, ACTION)
"""What our policies read."""

ENVIRONMENT_STATE = "observation.environment_state"
"""The desired goal once more, where LeRobot's own policies look for it."""

DISTURBANCE = "disturbance"
"""What was added to the action before it was executed; without a prefix that would make LeRobot show it to policies."""

REWARD, SUCCESS = "next.reward", "next.success"

PADDED = (STATE, ENVIRONMENT_STATE, GOAL, ACHIEVED_GOAL, ACTION, DISTURBANCE)
"""Vectors whose sizes are a task's own; where tasks are merged, shorter ones are padded."""

KEPT = (TIME_TO_GOAL, REWARD, SUCCESS)
"""Columns that are the same in all tasks."""

COLUMNS = (*PADDED, *KEPT)
"""What every dataset of ours holds, beside what LeRobot adds to it."""

CARTESIAN_STATE = "observation.cartesian_state"
"""The arms as a dVRK reports them; only where it was asked for."""


def image_key(camera: str) -> str:
    """Returns the dataset key of a camera's pictures."""
    return f"{OBS_IMAGES}.{camera}"
