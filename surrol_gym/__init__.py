"""SurRoL's surgical tasks for Gymnasium; importing the package registers ``surrol/<Task>-v0``."""

from gymnasium.envs.registration import register

from surrol_gym.experts import make_expert

TASKS = ("NeedleReach", "NeedlePick")
"""Names of the registered tasks, in the order of the paper's tables."""

__all__ = ["TASKS", "make_expert"]

register("surrol/NeedleReach-v0", "surrol_gym.tasks.needle_reach:NeedleReachEnv", max_episode_steps=50)
register("surrol/NeedlePick-v0", "surrol_gym.tasks.needle_pick:NeedlePickEnv", max_episode_steps=50)
