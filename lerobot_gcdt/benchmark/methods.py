"""Methods that are compared: what they are called, and how they are trained."""

import argparse
import shlex
from collections.abc import Iterable
from typing import NamedTuple

from lerobot_gcdt.training.outputs import existing_checkpoint
from lerobot_gcdt.training.recipes import recipe, steps_to_train
from lerobot_gcdt.training.stages import SET_HERE, policy_type, refuse_options
from lerobot_gcdt.training.trainer import check_options

OWN = ("steps", "start", "dataset")
"""Options of a method that are not those of `lerobot-train`."""

EXPERT = "expert"
"""The type of a method that learns nothing: the scripted expert of each task."""

SET_BY_BENCHMARKS = SET_HERE | {
    "dataset.root": "--datasets",
    "seed": "--seeds",
    "save_freq": "--points",
    "log_freq": "--points",
}
"""Options of `lerobot-train` that a benchmark sets itself, and what says them instead."""


class Method(NamedTuple):
    """A way to train a policy.

    Attributes:
        name: Its name, also of its folder.
        policy: Type of the policy, or ``EXPERT``.
        steps: Optimiser steps.
        points: Checkpoints that are evaluated.
        options: Further arguments of `lerobot-train`.
        start: Training, or folder of a checkpoint, that it begins with; None for random weights.
        dataset: Name of the dataset that it learns all tasks from, in one training; None for one of each task's.
    """

    name: str
    policy: str
    steps: int
    points: int
    options: tuple[str, ...]
    start: str | None = None
    dataset: str | None = None

    @property
    def checkpoints(self) -> range:
        """The steps of the checkpoints that are evaluated; the last is the end of the training."""
        every = self.steps // self.points
        return range(every, self.steps + 1, every)


def parse_method(text: str, points: int, steps: int | None = None, options: Iterable[str] = ()) -> Method:
    """Reads a method.

    Args:
        text: A type of policy, such as ``bc``, or ``expert`` for the scripted one, or a name and what it stands for,
            such as ``long=gcdt --policy.context_length=100 --steps=8000``. Beside options of `lerobot-train` it may
            hold ``--steps``, ``--start`` and ``--dataset`` (``Method``).
        points: Checkpoints that are evaluated; of a recipe with fewer steps, as many as these.
        steps: Steps where the text says none; None for those of ``lerobot_gcdt.training.recipes.RECIPES``.
        options: Arguments of `lerobot-train` for all methods; those of the text win.

    Returns:
        The method.

    Raises:
        ValueError: The name cannot be that of a folder, or the type, the steps, the points or an option is bad.
        FileNotFoundError: There is no checkpoint to start from.
    """
    first, *own = shlex.split(text) or [""]
    name, named, policy = first.partition("=")
    policy = policy if named else name
    if not name.replace("-", "_").isidentifier():
        raise ValueError(
            f"{text!r} is no method; write a type of policy, such as gcdt, or a name and what it stands for, such as "
            "'long=gcdt --policy.context_length=100'."
        )
    if policy == EXPERT:
        if own:
            raise ValueError(f"The method {name} is the scripted expert, which takes no options: {shlex.join(own)}.")
        return Method(name, policy, 1, 1, ())
    said, own = _split(own)
    settings = (*options, *own)
    refuse_options(settings, SET_BY_BENCHMARKS)
    if not said.get("steps", "1").isdigit():
        raise ValueError(f"The method {name} has --steps={said['steps']}, which is no number of steps.")
    start = existing_checkpoint(said["start"]) if "start" in said else None
    if start and policy != (found := policy_type(start)):
        raise ValueError(f"The method {name} is a policy of type {policy}, and {said['start']} is one of type {found}.")
    asked = int(said["steps"]) if "steps" in said else steps
    steps = steps_to_train(policy, recipe(policy, "finetune" if start else "scratch", start), asked)
    points = min(points, steps) if asked is None else points
    if points < 1 or steps % points:
        raise ValueError(f"The {steps} steps of the method {name} cannot be divided into {points} equal parts.")
    try:
        check_options([f"--policy.type={policy}", "--policy.push_to_hub=false", "--dataset.repo_id=any", *settings])
    except ValueError as error:
        raise ValueError(f"lerobot-train does not take the options of the method {name}: {error}") from None
    return Method(name, policy, steps, points, settings, said.get("start"), said.get("dataset"))


def _split(options: list[str]) -> tuple[dict[str, str], list[str]]:
    """The values of ``OWN`` among the options of a method, and the other options.

    Raises:
        ValueError: One of them has no value.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    for key in OWN:
        parser.add_argument(f"--{key}", default=argparse.SUPPRESS)
    try:
        said, others = parser.parse_known_args(options)
    except argparse.ArgumentError as error:
        raise ValueError(f"A method's {error.argument_name} needs a value, got {shlex.join(options)!r}.") from None
    return vars(said), others
