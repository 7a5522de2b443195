"""What a dataset holds: the columns of every recording, and those that are recorded on request."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np

from lerobot_gcdt.environment.surrol_env import env_class
from lerobot_gcdt.keys import (
    ACHIEVED_GOAL,
    ACTION,
    CARTESIAN_STATE,
    DISTURBANCE,
    ENVIRONMENT_STATE,
    GOAL,
    REWARD,
    STATE,
    SUCCESS,
    TIME_TO_GOAL,
    image_key,
)
from lerobot_gcdt.recording.openh import cartesian_state, cartesian_state_names

FIELDS = ("openh",)
"""Sets of further numbers that can be recorded."""


@dataclass(frozen=True)
class Extras:
    """What a dataset holds beside what all of them do.

    Attributes:
        fields: Sets of further numbers, of ``FIELDS``.
        cameras: Cameras of the environment that film every episode, as ``observation.images.<camera>``.
        camera_size: Width and height of the pictures, pixels.
    """

    fields: list[str] = field(default_factory=list)
    cameras: list[str] = field(default_factory=list)
    camera_size: int = 128

    def check(self, env_id: str) -> None:
        """Raises ValueError if an environment cannot give what is asked for."""
        known = sorted(env_class(env_id).cameras)
        for kind, asked, choices in (("fields", self.fields, FIELDS), ("cameras", self.cameras, known)):
            unknown = [name for name in asked if name not in choices]
            if unknown or len(set(asked)) < len(asked):
                raise ValueError(
                    f"The {kind} of {env_id} are different ones of {', '.join(choices)}; got {', '.join(asked)}."
                )
        # Video codecs halve the resolution of colours.
        if self.camera_size < 16 or self.camera_size % 2:
            raise ValueError(f"The size of pictures must be an even number from 16, got {self.camera_size}.")

    def describe(self, env: gym.Env) -> dict[str, dict]:
        """Returns LeRobot's description of the further columns."""
        picture = {
            "dtype": "video",
            "shape": (self.camera_size, self.camera_size, 3),
            "names": ["height", "width", "channels"],
        }
        numbers = {"openh": {CARTESIAN_STATE: vector_feature(cartesian_state_names(len(env.unwrapped.mounts)))}}
        described = {key: value for name in self.fields for key, value in numbers[name].items()}
        return described | {image_key(camera): picture for camera in self.cameras}

    def observe(self, env: gym.Env) -> dict[str, np.ndarray]:
        """Returns the further columns of this moment; what is simulated is not changed."""
        numbers = {CARTESIAN_STATE: cartesian_state(env.unwrapped)} if "openh" in self.fields else {}
        size = self.camera_size
        return numbers | {image_key(camera): env.unwrapped.picture(camera, size, size) for camera in self.cameras}


NO_EXTRAS = Extras()


def describe_columns(env: gym.Env, extras: Extras) -> dict[str, dict]:
    """Returns LeRobot's description of all columns of a dataset, every number named by the environment."""
    unwrapped = env.unwrapped
    goal = vector_feature(unwrapped.goal_names)
    return {
        STATE: vector_feature(unwrapped.observation_names),
        ENVIRONMENT_STATE: goal,
        GOAL: goal,
        ACHIEVED_GOAL: goal,
        TIME_TO_GOAL: vector_feature(["steps"]),
        ACTION: vector_feature(unwrapped.action_names),
        DISTURBANCE: vector_feature(unwrapped.action_names),
        REWARD: vector_feature(["reward"]),
        SUCCESS: {"dtype": "bool", "shape": (1,), "names": ["success"]},
    } | extras.describe(env)


def to_columns(episode: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Turns what ``run_episode`` returns of a successful episode into the columns of a dataset.

    Args:
        episode: Arrays over the steps.

    Returns:
        An array for each column, a row a step, shape (T, ...).
    """
    return {
        STATE: episode["observation"],
        ENVIRONMENT_STATE: episode["desired_goal"],
        GOAL: episode["desired_goal"],
        ACHIEVED_GOAL: episode["achieved_goal"],
        TIME_TO_GOAL: time_to_goal(episode["success"])[:, None],
        ACTION: episode["action"],
        DISTURBANCE: episode["disturbance"],
        REWARD: episode["reward"][:, None],
        SUCCESS: episode["success"][:, None],
    } | {key: values for key, values in episode.items() if key.startswith("observation.")}


def time_to_goal(success: np.ndarray) -> np.ndarray:
    """Computes the steps that are left to the first success, 0 once it is reached.

    Args:
        success: Whether each step ended in success, shape (T,); at least one did.

    Returns:
        Shape (T,), float32; step t is before action t, so an action that succeeds at once starts at 1.
    """
    first = int(np.argmax(success)) + 1
    return np.maximum(first - np.arange(len(success)), 0).astype(np.float32)


def vector_feature(names: Sequence[str]) -> dict:
    """Returns LeRobot's description of a vector of named float32 numbers."""
    return {"dtype": "float32", "shape": (len(names),), "names": list(names)}
