"""What can be evaluated: tasks that exist, seeds, and the tasks that a policy knows."""

from collections.abc import Sequence
from pathlib import Path

from lerobot.configs.policies import PreTrainedConfig

import surrol_gym
from lerobot_gcdt.environment.surrol_env import env_class


def check_tasks(tasks: Sequence[str]) -> None:
    """Raises ValueError unless all of these tasks exist."""
    unknown = [task for task in tasks if task not in surrol_gym.TASKS]
    if unknown:
        raise ValueError(f"Unknown tasks {', '.join(unknown)}; choose from {', '.join(surrol_gym.TASKS)}.")


def check_starts(tasks: Sequence[str], seeds: Sequence[int]) -> None:
    """Raises ValueError unless there are tasks, all of them exist, and seeds, none of them negative."""
    check_tasks(tasks)
    if not tasks or not seeds or min(seeds) < 0:
        raise ValueError(f"An evaluation needs tasks, and seeds from 0 on; got {list(tasks)} and {sorted(seeds)[:3]}.")


def sentences() -> dict[str, str]:
    """Returns the sentence of each task, by its name."""
    return {task: env_class(f"surrol/{task}-v0").task_description for task in surrol_gym.TASKS}


def tasks_of(checkpoint: str | Path, chosen: Sequence[str] | None = None) -> list[str]:
    """Returns the tasks that a checkpoint can be evaluated on.

    Args:
        checkpoint: Its folder.
        chosen: Names of tasks; None for all.

    Returns:
        Those of the chosen tasks that the policy knows. Policies that do not tell what they know are taken to know the
        chosen ones.

    Raises:
        ValueError: A chosen task is unknown, the policy knows none of them, or nothing is chosen and it does not tell.
    """
    check_tasks(chosen or [])
    config = PreTrainedConfig.from_pretrained(checkpoint)
    if not getattr(config, "task_dims", None):
        if not chosen:
            raise ValueError(
                f"{checkpoint} is a policy of type {config.type}, which does not tell what it knows; add --tasks."
            )
        return list(chosen)
    known = [task for task, sentence in sentences().items() if sentence in config.task_dims]
    tasks = [task for task in chosen or known if task in known]
    if not tasks:
        raise ValueError(f"{checkpoint} knows {', '.join(known)}, but not {', '.join(chosen or known)}.")
    return tasks
