"""The registered tasks: the ten of SurRoL and anybody's own, with the same rights.

A task is found by its name or its id, such as ``NeedlePick`` or ``surrol/NeedlePick-v0``. Another process finds one
that is not among the ten where the module that registers it stands in front, as Gymnasium has it: ``module:PushBlock``.
"""

import importlib
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

from surrol_gym.envs.time_limit import RestorableTimeLimit

if TYPE_CHECKING:
    from surrol_gym.envs.psm_env import PSMEnv
    from surrol_gym.experts import Law

NAMESPACE = "surrol/"

_ids: list[str] = []
"""Of the registered tasks."""

_laws: dict[str, "Law | str | None"] = {}
"""The law of each task's expert, by where its environment's class is defined."""


def register_task(
    env_class: "type[PSMEnv] | str", max_episode_steps: int, expert: "Law | str | None" = None, version: int = 0
) -> str:
    """Registers a task with Gymnasium, as ``surrol/<Task>-v<version>``: named as its class without ``Env``.

    Classes and laws may be given as ``"module:name"``; then they are imported when they are needed.

    Args:
        env_class: The environment, a subclass of ``surrol_gym.envs.psm_env.PSMEnv``.
        max_episode_steps: Steps of an episode.
        expert: The scripted expert's law: takes what ``env_class.read`` returns of an observation, and returns the
            ``surrol_gym.experts.Target`` of the arm or a tuple of one for each. None where there is no expert.
        version: To be raised where episodes change.

    Returns:
        The id.

    Raises:
        ValueError: Another class is registered under this id.
    """
    where = env_class if isinstance(env_class, str) else _where(env_class)
    env_id = f"{NAMESPACE}{where.rpartition(':')[2].rpartition('.')[2].removesuffix('Env')}-v{version}"
    if env_id in _ids:
        raise ValueError(f"{env_id} is registered already; give the class of {where} another name, or a version.")
    gym.register(
        env_id,
        env_class,  # type: ignore[arg-type]  # Gymnasium declares classes that take any keyword argument
        max_episode_steps=max_episode_steps,
        additional_wrappers=(RestorableTimeLimit.wrapper_spec(),),
    )
    _ids.append(env_id)
    _laws[where] = expert
    return env_id


def registered_tasks() -> tuple[str, ...]:
    """Returns the names of all registered tasks, the ten first."""
    return tuple(dict.fromkeys(map(task_name, _ids)))


def task_name(env_id: str) -> str:
    """Returns the name of the task in an id, such as ``NeedlePick`` in ``surrol/NeedlePick-v0``."""
    return env_id.rpartition("/")[2].rpartition("-v")[0]


def find_task(task: str) -> str:
    """Finds a registered task, importing the module that stands in front of it.

    Args:
        task: Its name or its id: ``NeedlePick``, ``NeedlePick-v0``, ``surrol/NeedlePick-v0`` or
            ``module:PushBlock``. Without a version the newest is meant.

    Returns:
        The id that ``gymnasium.make`` takes, with the module where it was given: ``module:surrol/PushBlock-v0``.

    Raises:
        ValueError: There is no such module or task.
    """
    module, colon, name = task.rpartition(":")
    name = name.removeprefix(NAMESPACE)
    if module:
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            raise ValueError(
                f"Cannot import the module of {task!r}: {error}; is it installed, or on PYTHONPATH?"
            ) from None
    ids = [env_id for env_id in _ids if name in (env_id.removeprefix(NAMESPACE), task_name(env_id))]
    if not ids:
        versions = [env_id for env_id in _ids if task_name(env_id) == name.partition("-v")[0]]
        raise ValueError(
            f"Unknown task {task!r}; choose one of {', '.join(versions or registered_tasks())}, or name the module "
            "that registers it, as in my_module:MyTask."
        )
    return module + colon + max(ids, key=lambda env_id: int(env_id.rpartition("-v")[2]))


def task_spec(task: str) -> EnvSpec:
    """Returns Gymnasium's spec of a task, which knows the time limit; the task as in ``find_task``."""
    return gym.spec(find_task(task).rpartition(":")[2])


def env_class(task: str) -> "type[PSMEnv]":
    """Returns the class of a task, which knows its names, sizes and cameras without being made; as ``find_task``."""
    return _resolved(task_spec(task).entry_point)


def find_law(env_class: type) -> "Law | None":
    """Returns the law of a task's expert, by the class of its environment or the nearest one that it derives from."""
    found = next((where for where in map(_where, env_class.__mro__) if where in _laws), None)
    return _resolved(_laws[found]) if found else None


def _where(defined: type) -> str:
    return f"{defined.__module__}:{defined.__qualname__}"


def _resolved(what: Any) -> Any:
    return resolve_name(what) if isinstance(what, str) else what
