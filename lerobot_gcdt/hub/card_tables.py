"""The tables of a dataset's card: every number by its name, with what the task says of it and its statistics."""

from collections.abc import Iterable, Iterator

from lerobot.utils.constants import DEFAULT_FEATURES

from lerobot_gcdt.hub.docstrings import remarks, sections
from lerobot_gcdt.keys import (
    ACHIEVED_GOAL,
    ACTION,
    DISTURBANCE,
    GOAL,
    REWARD,
    STATE,
    SUCCESS,
    TIME_TO_GOAL,
)
from lerobot_gcdt.recording.fields import find_field
from surrol_gym.envs.psm_env import PSMEnv
from surrol_gym.quantities import Quantity, table

OTHER_KEYS = {
    TIME_TO_GOAL: "steps to the first success, 0 from then on",
    REWARD: "after the action: 0 in success, -1 otherwise",
    SUCCESS: "after the action: whether it is a success",
}


def number_tables(env_class: type[PSMEnv], statistics: dict[str, dict], heading: str) -> str:
    """Describes every number of observations, goals and actions, with what the docstring adds below its tables.

    Args:
        env_class: The task.
        statistics: Minima, means and maxima of the columns of a dataset, by column; may be empty.
        heading: Marks of the headings, such as ``"###"``.

    Returns:
        Markdown.
    """
    told = sections(env_class)
    states = [
        [i, f"`{name}`", content, unit, *_figures(statistics, STATE, i)]
        for i, name, content, unit in _numbers(env_class.observation_quantities)
    ]
    goals = [
        [i, f"`goal_{name}`", unit, *_figures(statistics, ACHIEVED_GOAL, i), *_figures(statistics, GOAL, i)]
        for i, name, _, unit in _numbers(env_class.goal_quantities)
    ]
    actions = [
        [i, f"`{name}`", content, effect, *_figures(statistics, ACTION, i), *_figures(statistics, DISTURBANCE, i)]
        for i, name, content, effect in _numbers(env_class.action_quantities)
    ]
    achieved, desired = _titles(statistics, ACHIEVED_GOAL, "achieved "), _titles(statistics, GOAL, "desired ")
    moved, pushed = _titles(statistics, ACTION), _titles(statistics, DISTURBANCE, "push ")
    parts = [
        f"{heading} `{STATE}`",
        table(["index", "name", "content", "unit", *_titles(statistics, STATE)], states),
        remarks(told["Observation Space"]),
        f"{heading} `{ACHIEVED_GOAL}` and `{GOAL}`",
        table(["index", "name", "unit", *achieved, *desired], goals),
        f"{heading} `{ACTION}` and `{DISTURBANCE}`",
        table(["index", "name", "content", "effect of 1", *moved, *pushed], actions),
        remarks(told["Action Space"]),
    ]
    return "\n\n".join(filter(None, parts))


def other_keys(env_class: type[PSMEnv], extras: dict, statistics: dict[str, dict]) -> str:
    """Describes the columns that are the same in all tasks, and those that were recorded on request.

    Args:
        env_class: The task.
        extras: Fields of ``lerobot_gcdt.recording.features.Extras``.
        statistics: See ``number_tables``.

    Returns:
        A table as Markdown.
    """
    rows = [[f"`{key}`", content, *_figures(statistics, key, 0)] for key, content in OTHER_KEYS.items()]
    for key, numbers in (item for name in extras["fields"] for item in find_field(name).describe(env_class).items()):
        for i, (name, content) in enumerate(numbers.items()):
            rows.append([f"`{key}`, `{name}`", content, *_figures(statistics, key, i)])
    size = f"{extras['camera_size']} x {extras['camera_size']}"
    rows += [[f"`observation.images.{camera}`", f"film of the episode, {size}"] for camera in extras["cameras"]]
    rows.append(["`task`", "the task as a sentence"])
    rows.append([", ".join(f"`{key}`" for key in DEFAULT_FEATURES), "LeRobot's own; times are seconds"])
    return table(["key", "content", *_titles(statistics, TIME_TO_GOAL)], rows)


def _numbers(quantities: Iterable[Quantity]) -> Iterator[tuple[int, str, str, str]]:
    """Index, name, content and unit of every number; the content stands at the first one of a quantity."""
    told = [
        (name, "" if i else quantity.meaning, quantity.unit)
        for quantity in quantities
        for i, name in enumerate(quantity.names)
    ]
    return ((i, *number) for i, number in enumerate(told))


def _titles(statistics: dict[str, dict], key: str, prefix: str = "") -> list[str]:
    return [prefix + title for title in statistics.get(key, ())]


def _figures(statistics: dict[str, dict], key: str, i: int) -> list[str]:
    return [f"{values[i]:g}" for values in statistics.get(key, {}).values()]
