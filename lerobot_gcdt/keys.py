"""Keys of the datasets' columns that policies read."""

STATE = "observation.state"
GOAL = "observation.goal"
ACHIEVED_GOAL = "observation.achieved_goal"
TIME_TO_GOAL = "observation.time_to_goal"
ACTION = "action"
REQUIRED_KEYS = (STATE, GOAL, ACHIEVED_GOAL, TIME_TO_GOAL, ACTION)
