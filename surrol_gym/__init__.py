"""SurRoL's surgical tasks for Gymnasium; importing the package registers ``surrol/<Task>-v0``."""

from typing import Any

from surrol_gym.registry import find_task, register_task, registered_tasks

__version__ = "0.1.0"

__all__ = ["TASKS", "find_task", "make_expert", "register_task", "registered_tasks"]

for _module, _task, _limit in (
    ("needle_reach", "NeedleReach", 50),
    ("gauze_retrieve", "GauzeRetrieve", 50),
    ("needle_pick", "NeedlePick", 50),
    ("peg_transfer", "PegTransfer", 50),
    ("needle_regrasp", "NeedleRegrasp", 50),
    ("bi_peg_transfer", "BiPegTransfer", 100),
    ("bi_peg_board", "BiPegBoard", 100),
    ("match_board_panel", "MatchBoardPanel", 100),
    ("pick_and_place", "PickAndPlace", 100),
    ("match_board", "MatchBoard", 100),
):
    register_task(f"surrol_gym.tasks.{_module}:{_task}Env", _limit, f"surrol_gym.experts.{_module}:law")

TASKS = registered_tasks()
"""Names of the ten tasks, in the order of the paper's tables."""


def __getattr__(name: str) -> Any:
    # PyBullet takes time to load and prints a line; whoever only asks for the names of the tasks is spared both.
    if name == "make_expert":
        from surrol_gym.experts import make_expert

        return make_expert
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
