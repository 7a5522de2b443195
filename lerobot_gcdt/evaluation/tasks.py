"""What can be evaluated: tasks that exist, seeds, and the tasks that a policy knows."""

from collections.abc import Sequence
from pathlib import Path

from lerobot.configs.policies import PreTrainedConfig
from lerobot.utils.import_utils import register_third_party_plugins

from surrol_gym.registry import env_class, find_task, registered_tasks


def check_starts(tasks: Sequence[str], seeds: Sequence[int]) -> None:
    """Raises ValueError unless there are tasks, all of them exist, and seeds, none of them negative."""
    for task in tasks:
        find_task(task)
    if not tasks or not seeds or min(seeds) < 0:
        raise ValueError(f"An evaluation needs tasks, and seeds from 0 on; got {list(tasks)} and {sorted(seeds)[:3]}.")


def tasks_of(checkpoint: str | Path, chosen: Sequence[str] | None = None) -> list[str]:
    """Returns the tasks that a checkpoint can be evaluated on.

    Args:
        checkpoint: Its folder.
        chosen: Tasks, as ``surrol_gym.find_task`` takes them; None for all that are registered.

    Returns:
        Those of the chosen tasks that the policy knows. Policies that do not tell what they know are taken to know the
        chosen ones.

    Raises:
        ValueError: A chosen task is unknown, the policy knows none of them, or nothing is chosen and it does not tell.
    """
    sentences = {task: env_class(task).task_description for task in chosen or registered_tasks()}
    register_third_party_plugins()
    config = PreTrainedConfig.from_pretrained(checkpoint)
    if not getattr(config, "task_dims", None):
        if not chosen:
            raise ValueError(
                f"{checkpoint} is a policy of type {config.type}, which does not tell what it knows; add --tasks."
            )
        return list(chosen)
    tasks = [task for task, sentence in sentences.items() if sentence in config.task_dims]
    if not tasks:
        raise ValueError(
            f"{checkpoint} knows {', '.join(map(repr, config.task_dims))}, but none of {', '.join(sentences)}; name "
            "the module that registers another task, as in --tasks my_module:MyTask."
        )
    return tasks
