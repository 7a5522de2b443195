"""SurRoL's surgical tasks for Gymnasium; importing the package registers ``surrol/<Task>-v0``."""

from gymnasium.envs.registration import register

from surrol_gym.envs.time_limit import RestorableTimeLimit

__version__ = "0.1.0"

_TIME_LIMITS = {
    "NeedleReach": 50,
    "GauzeRetrieve": 50,
    "NeedlePick": 50,
    "PegTransfer": 50,
    "NeedleRegrasp": 50,
    "BiPegTransfer": 100,
    "BiPegBoard": 100,
    "MatchBoardPanel": 100,
    "PickAndPlace": 100,
    "MatchBoard": 100,
}

TASKS = tuple(_TIME_LIMITS)
"""Names of the registered tasks, in the order of the paper's tables."""

__all__ = ["TASKS", "make_expert"]

for _task, _limit in _TIME_LIMITS.items():
    _module = "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in _task).strip("_")
    register(
        f"surrol/{_task}-v0",
        f"surrol_gym.tasks.{_module}:{_task}Env",
        max_episode_steps=_limit,
        additional_wrappers=(RestorableTimeLimit.wrapper_spec(),),
    )


def __getattr__(name):
    # PyBullet takes time to load and prints a line; whoever only asks for the names of the tasks is spared both.
    if name == "make_expert":
        from surrol_gym.experts import make_expert

        return make_expert
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
