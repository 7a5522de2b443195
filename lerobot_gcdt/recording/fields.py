"""Fields: sets of further numbers that datasets hold on request. Anybody's module can register one."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

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


register_field("openh", openh.describe_cartesian_state, openh.observe_cartesian_state)
