"""Fields: sets of further numbers that datasets hold on request. Anybody's module can register one."""

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from lerobot.utils.constants import DEFAULT_FEATURES, OBS_IMAGES

from lerobot_gcdt.keys import COLUMNS
from lerobot_gcdt.recording import openh
from surrol_gym.envs.psm_env import PSMEnv

Describe = Callable[[type[PSMEnv]], dict[str, dict[str, str]]]
Observe = Callable[[PSMEnv], dict[str, np.ndarray]]


@dataclass(frozen=True)
class Field:
    """What a field adds to a dataset.

    Attributes:
        describe: Takes the class of an environment and returns, for each column, the names of its numbers with what a
            card says of them; a number of which nothing is said belongs to the one before. Names of columns begin with
            ``observation.`` where policies may see them.
        observe: Takes the environment, unwrapped, and returns the columns of this moment, vectors of float32 numbers;
            what is simulated is not changed.
    """

    describe: Describe
    observe: Observe


TAKEN = {*COLUMNS, *DEFAULT_FEATURES, "task", "observation", "achieved_goal", "desired_goal", "reward", "success"}
"""Keys that no field may have: columns of ours and of LeRobot's, and what episodes hold until they are columns."""

FIELDS: dict[str, Field] = {}
"""The registered fields, by name."""


def register_field(name: str, describe: Describe, observe: Observe) -> None:
    """Registers a field.

    Args:
        name: Its name, for ``gcdt record --fields``.
        describe: See ``Field``.
        observe: See ``Field``.

    Raises:
        ValueError: Another field has this name.
    """
    if name in FIELDS:
        raise ValueError(f"There is a field {name!r} already; give this one another name.")
    FIELDS[name] = Field(describe, observe)


def find_field(name: str) -> Field:
    """Finds a registered field, importing the module that stands in front of its name.

    Args:
        name: Its name, such as ``openh``, or ``module:name``, which any process finds.

    Raises:
        ValueError: There is no such module or field.
    """
    module, _, bare = name.rpartition(":")
    if module:
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            raise ValueError(f"Cannot import the module of the field {name!r}: {error}.") from None
    if bare not in FIELDS:
        raise ValueError(
            f"Unknown field {name!r}; choose one of {', '.join(FIELDS)}, or name the module that registers it, as in "
            "my_module:my_field."
        )
    return FIELDS[bare]


def check_fields(names: Sequence[str], env_class: type[PSMEnv]) -> None:
    """Checks which columns fields describe.

    Args:
        names: Names of the fields.
        env_class: Class of the environment.

    Raises:
        ValueError: A field is unknown, or a column of it is no name, has no numbers or is there already.
    """
    owners: dict[str, str] = {}
    for name in names:
        for key, numbers in find_field(name).describe(env_class).items():
            if key in TAKEN or key.startswith(OBS_IMAGES):
                raise ValueError(f"The field {name!r} describes {key}, which datasets hold already; rename it.")
            if key in owners:
                raise ValueError(f"The fields {owners[key]!r} and {name!r} both describe {key}; rename one of them.")
            if "/" in key or not numbers:
                raise ValueError(f"The field {name!r} describes {key!r} without a number, or with a / in its name.")
            owners[key] = name


def observe_field(name: str, env: PSMEnv) -> dict[str, np.ndarray]:
    """Observes a field.

    Args:
        name: Its name.
        env: The environment, unwrapped.

    Returns:
        The columns of this moment.

    Raises:
        ValueError: They are not what the field describes.
    """
    field = find_field(name)
    sizes = {key: len(numbers) for key, numbers in field.describe(type(env)).items()}
    columns = field.observe(env)
    if not isinstance(columns, dict) or columns.keys() != sizes.keys():
        found = ", ".join(columns) if isinstance(columns, dict) else repr(columns)
        raise ValueError(f"The field {name!r} describes {', '.join(sizes)}, but its observe returns {found}.")
    for key, size in sizes.items():
        row = columns[key]
        if not isinstance(row, np.ndarray) or row.dtype != np.float32 or row.shape != (size,):
            found = f"{row.dtype} of shape {row.shape}" if isinstance(row, np.ndarray) else repr(row)
            raise ValueError(
                f"The field {name!r} describes {size} numbers in {key}, so its observe must return a float32 array of "
                f"shape ({size},), got {found}."
            )
        if not np.isfinite(row).all():
            raise ValueError(f"The field {name!r} observes a number in {key} that is not finite: {row.tolist()}.")
    return columns


register_field("openh", openh.describe_cartesian_state, openh.observe_cartesian_state)
