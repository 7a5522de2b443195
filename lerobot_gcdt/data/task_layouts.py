"""What the vectors of each task hold: how many numbers, and which numbers of an observation repeat the goal.

Names of features say it for a dataset of one task: a number of the observation that is called like a number of the goal
repeats it. In a merged dataset vectors are padded and nameless; a table of its tasks stands in the description of
``observation.state``, which LeRobot's split, merge and edit keep.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata

from lerobot_gcdt.keys import ACTION, GOAL, STATE

_TABLE = "tasks"


@dataclass(frozen=True)
class TaskLayout:
    """The vectors of one task.

    Attributes:
        sizes: Numbers of observation, goal and action, without padding.
        goal_in_state: Where the observation repeats the desired goal, number by number; empty if it does not.
    """

    sizes: list[int]
    goal_in_state: list[int] = field(default_factory=list)


def task_layouts(meta: LeRobotDatasetMetadata) -> dict[str, TaskLayout]:
    """Returns the layout of each task of a dataset, by sentence.

    Args:
        meta: Metadata of a dataset of ``gcdt record`` or ``gcdt merge``, or of one that LeRobot made of them.

    Raises:
        ValueError: The vectors are padded, and nothing says how many numbers belong to a task.
    """
    table = meta.features[STATE].get("info", {}).get(_TABLE)
    if table is None:
        names = {key: list(meta.features[key]["names"] or ()) for key in (STATE, GOAL)}
        if names[STATE] and names[STATE] == padded_names(STATE, len(names[STATE])):
            raise ValueError(
                f"The vectors of {meta.repo_id} are padded, but its meta/info.json has no table of its tasks; merge it "
                "again with `gcdt merge`."
            )
        sizes = [meta.features[key]["shape"][0] for key in (STATE, GOAL, ACTION)]
        repeated = set(names[GOAL]) <= set(names[STATE])
        layout = TaskLayout(sizes, [names[STATE].index(name) for name in names[GOAL]] if repeated else [])
        return dict.fromkeys(meta.tasks.index, layout)
    unknown = sorted(set(meta.tasks.index) - set(table))
    if unknown:
        raise ValueError(f"The table of tasks in meta/info.json of {meta.repo_id} lacks {unknown}.")
    return {task: TaskLayout(**table[task]) for task in meta.tasks.index}


def table_of(layouts: dict[str, TaskLayout]) -> dict:
    """Returns the table of tasks as it stands in the description of ``observation.state``."""
    return {"info": {_TABLE: {task: asdict(layout) for task, layout in layouts.items()}}}


def padded_names(key: str, size: int) -> list[str]:
    """Returns the names of the numbers of a padded vector, such as ``state_0``."""
    return [f"{key.split('.')[-1]}_{i}" for i in range(size)]


def sizes_of(task: str, task_dims: Mapping[str, Sequence[int]]) -> Sequence[int]:
    """Looks up the sizes of observation, goal and action of a task sentence.

    Raises:
        KeyError: The task is unknown.
    """
    if task not in task_dims:
        raise KeyError(f"Unknown task {task!r}; this policy knows {sorted(task_dims)}.")
    return task_dims[task]
