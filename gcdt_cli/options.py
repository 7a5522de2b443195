"""What several commands take, and what is checked before anything slow is imported."""

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import Any

BUILT_IN = "generalist"
"""What names the policy that comes with the package."""

EXECUTORS = {
    "local": set[str](),
    "slurm": {"partition", "time", "cpus_per_task", "gpus_per_task", "dry_run"},
    "ray": {"cpus_per_task", "gpus_per_task"},
}
"""Options that go with each executor, beside ``--workers``."""


def add_sensors(command: argparse.ArgumentParser, title: str, noisy_actions: bool = False) -> None:
    sensors = command.add_argument_group(title)
    sensors.add_argument("--position_std", type=float, default=0.0, help="noise of each coordinate, su (default 0)")
    sensors.add_argument("--angle_std", type=float, default=0.0, help="noise of each angle, radians (default 0)")
    sensors.add_argument("--dropout", type=float, default=0.0, help="probability that a step is missed (default 0)")
    sensors.add_argument("--delay", type=int, default=0, help="steps by which what is shown lags (default 0)")
    if noisy_actions:
        told = "noise of each number of an action, in full actions (default 0)"
        sensors.add_argument("--action_std", type=float, default=0.0, help=told)


def sensor_settings(options: argparse.Namespace) -> dict[str, float]:
    """What the options of ``add_sensors`` say, without those that change nothing."""
    from surrol_gym.wrappers import IDEAL

    return {name: value for name in IDEAL if (value := getattr(options, name, 0.0))}


def add_executor(command: argparse.ArgumentParser, title: str) -> None:
    executor = command.add_argument_group(f"{title} (needs lerobot_policy_gcdt[executors])")
    executor.add_argument("--executor", choices=EXECUTORS, help="who runs the units: datatrove's executor of that name")
    executor.add_argument("--partition", help="with Slurm: the partition")
    executor.add_argument("--time", metavar="HH:MM:SS", help="with Slurm: the longest time of a unit")
    executor.add_argument("--cpus_per_task", type=int, help="with Slurm and Ray: cores a unit, of 2 GB (default 1)")
    executor.add_argument("--gpus_per_task", type=int, help="with Slurm and Ray: GPUs a unit (default 0)")
    executor.add_argument("--dry_run", action="store_true", help="with Slurm: only show what would be submitted")


def executor_settings(options: argparse.Namespace, workers: int) -> dict[str, Any]:
    """What the options of ``add_executor`` say, as arguments of ``run_units``; nothing without an executor.

    Args:
        options: The options.
        workers: Units at a time on this machine, where that is not said.
    """
    named = ("partition", "time", "cpus_per_task", "gpus_per_task", "dry_run")
    given = {name: value for name in named if (value := getattr(options, name))}
    for name in given:
        if name not in EXECUTORS.get(options.executor, ()):
            takers = " or ".join(executor for executor, takes in EXECUTORS.items() if name in takes)
            raise ValueError(f"--{name} goes with --executor {takers}.")
    if not options.executor:
        return {}
    if options.workers is not None and options.workers < 1:
        raise ValueError(f"--executor needs at least one worker, got {options.workers}.")
    if options.executor == "slurm" and not {"partition", "time"} <= given.keys():
        raise ValueError("--executor slurm needs a --partition and a --time, such as 02:00:00.")
    for package in ("datatrove", "ray") if options.executor == "ray" else ("datatrove",):
        if not find_spec(package):
            raise RuntimeError(
                f"--executor {options.executor} needs {package}, which is not installed: "
                "`pip install 'lerobot_policy_gcdt[executors]'`."
            )
    elsewhere = options.executor != "local"
    return {"executor": options.executor, "workers": options.workers or (-1 if elsewhere else workers), **given}


def names(text: str) -> list[str]:
    """Names, separated by commas."""
    return [name.strip() for name in text.split(",")]


def numbers(text: str) -> list[int]:
    """Whole numbers, separated by commas."""
    return [int(number) for number in text.split(",")]


def check_tasks(tasks: list[str]) -> None:
    """Raises ValueError for an unknown task, before anything slow is imported."""
    import surrol_gym

    for task in tasks:
        surrol_gym.find_task(task)


def check_folder(folder: Path, remedy: str) -> None:
    """Raises FileNotFoundError for a missing folder, before anything slow is imported."""
    if not folder.exists():
        raise FileNotFoundError(f"There is no folder {folder}; {remedy}.")


def check_root(root: str) -> None:
    """Raises ValueError for a folder without a name, beside which nothing unfinished can be kept."""
    if not Path(root).name:
        raise ValueError(f"--root {root!r} names no folder; write one such as --root datasets/needle_pick.")


def checkpoint_of(named: str) -> Path:
    """Finds where a policy is loaded from.

    Args:
        named: The built-in one, a training, a folder, or a repository on the Hub.

    Returns:
        The folder, or the name of the repository.

    Raises:
        FileNotFoundError: It is none of these.
    """
    from huggingface_hub import hf_hub_download
    from huggingface_hub.constants import CONFIG_NAME

    from lerobot_gcdt import GENERALIST
    from lerobot_gcdt.training import checkpoint

    found = GENERALIST if named == BUILT_IN else checkpoint(named)
    if not found.is_dir():
        try:
            hf_hub_download(named, CONFIG_NAME)
        except (OSError, ValueError) as error:
            told = " ".join(str(error).split())
            raise FileNotFoundError(
                f"{named} is no folder here, nor could it be loaded from the Hub: {told}"
            ) from error
    return found
