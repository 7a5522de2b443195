"""The tables of a dataset's card: every number by its name, with what the docstring says of it and its statistics."""

import re

from lerobot.utils.constants import DEFAULT_FEATURES

from lerobot_gcdt.hub.docstrings import described_numbers, remarks, sections
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

UNITS = {"x": "su", "y": "su", "z": "su", "roll": "rad", "pitch": "rad", "yaw": "rad", "jaw": "rad"}
"""Unit of a number of an observation or goal, by the end of its name; others have none."""

SAID_BY_NAME_AND_UNIT = re.compile(r" \(x, y, z\)|, (su|radians)(?=;|$)")
"""What a row of a docstring says of its numbers that other columns of the card say, too."""

OTHER_KEYS = {
    TIME_TO_GOAL: "steps to the first success, 0 from then on",
    REWARD: "after the action: 0 in success, -1 otherwise",
    SUCCESS: "after the action: whether it is a success",
}


def table(titles: list[str], rows: list[list]) -> str:
    """Returns a table as Markdown; rows may be shorter than the titles."""
    lines = [titles, ["---"] * len(titles), *(row + [""] * (len(titles) - len(row)) for row in rows)]
    return "\n".join("|" + "".join(f" {cell} |" if cell != "" else " |" for cell in line) for line in lines)


def number_tables(env_class: type, statistics: dict[str, dict], heading: str) -> str:
    """Describes every number of observations, goals and actions, with what the docstring adds.

    Args:
        env_class: The task.
        statistics: Minima, means and maxima of the columns of a dataset, by column; may be empty.
        heading: Marks of the headings, such as ``"###"``.

    Returns:
        Markdown.
    """
    told = sections(env_class)
    observation, action = told["Observation Space"], told["Action Space"]
    state, moves = described_numbers(observation), described_numbers(action)
    states = [
        [i, f"`{name}`", _content(state, i), _unit(name), *_figures(statistics, STATE, i)]
        for i, name in enumerate(env_class.observation_names)
    ]
    goals = [
        [i, f"`{name}`", _unit(name), *_figures(statistics, ACHIEVED_GOAL, i), *_figures(statistics, GOAL, i)]
        for i, name in enumerate(env_class.goal_names)
    ]
    actions = []
    for i, name in enumerate(env_class.action_names):
        figures = [*_figures(statistics, ACTION, i), *_figures(statistics, DISTURBANCE, i)]
        actions.append([i, f"`{name}`", _content(moves, i), moves[i][1], *figures])
    achieved, desired = _titles(statistics, ACHIEVED_GOAL, "achieved "), _titles(statistics, GOAL, "desired ")
    moved, pushed = _titles(statistics, ACTION), _titles(statistics, DISTURBANCE, "push ")
    parts = [
        f"{heading} `{STATE}`",
        table(["index", "name", "content", "unit", *_titles(statistics, STATE)], states),
        remarks(observation),
        f"{heading} `{ACHIEVED_GOAL}` and `{GOAL}`",
        table(["index", "name", "unit", *achieved, *desired], goals),
        f"{heading} `{ACTION}` and `{DISTURBANCE}`",
        table(["index", "name", "content", "effect of 1", *moved, *pushed], actions),
        remarks(action),
    ]
    return "\n\n".join(filter(None, parts))


def other_keys(env_class: type, extras: dict, statistics: dict[str, dict]) -> str:
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


def _content(described: dict[int, list[str]], i: int) -> str:
    """What the docstring says of a number; nothing where it shares the row of the number before."""
    return "" if i and described[i] is described[i - 1] else SAID_BY_NAME_AND_UNIT.sub("", described[i][0])


def _unit(name: str) -> str:
    return UNITS.get(name.rpartition("_")[2], "")


def _titles(statistics: dict[str, dict], key: str, prefix: str = "") -> list[str]:
    return [prefix + title for title in statistics.get(key, ())]


def _figures(statistics: dict[str, dict], key: str, i: int) -> list[str]:
    return [f"{values[i]:g}" for values in statistics.get(key, {}).values()]
