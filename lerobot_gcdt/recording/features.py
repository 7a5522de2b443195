"""What a dataset holds: the columns of every recording, and those that are recorded on request."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import gymnasium as gym
import numpy as np

from lerobot_gcdt.keys import (
    ACHIEVED_GOAL,
    ACTION,
    DISTURBANCE,
    ENVIRONMENT_STATE,
    GOAL,
    REWARD,
    STATE,
    SUCCESS,
    TIME_TO_GOAL,
    image_key,
)
from lerobot_gcdt.recording.fields import check_fields, find_field, observe_field
from surrol_gym.envs.psm_env import PSMEnv, unwrapped
from surrol_gym.registry import env_class


@dataclass(frozen=True)
class Extras:
    """What a dataset holds beside what all of them do.

    Attributes:
        fields: Names of sets of further numbers (``lerobot_gcdt.recording.fields.find_field``).
        cameras: Cameras of the environment that film every episode, as ``observation.images.<camera>``.
        camera_size: Width and height of the pictures, pixels.
    """

    fields: list[str] = field(default_factory=list)
    cameras: list[str] = field(default_factory=list)
    camera_size: int = 128

    def check(self, env_id: str) -> None:
        """Raises ValueError if an environment cannot give what is asked for, or a field observes something else."""
        if len(set(self.fields)) < len(self.fields):
            raise ValueError(f"The fields must be different ones, got {', '.join(self.fields)}.")
        check_fields(self.fields, env_class(env_id))
        known = sorted(env_class(env_id).cameras)
        if not set(self.cameras) <= set(known) or len(set(self.cameras)) < len(self.cameras):
            raise ValueError(
                f"The cameras of {env_id} are different ones of {', '.join(known)}; got {', '.join(self.cameras)}."
            )
        # Video codecs halve the resolution of colours.
        if self.camera_size < 16 or self.camera_size % 2:
            raise ValueError(f"The size of pictures must be an even number from 16, got {self.camera_size}.")
        if self.fields:
            env = gym.make(env_id)
            try:
                env.reset(seed=0)
                self._numbers(unwrapped(env))
            finally:
                env.close()

    def describe(self, env: gym.Env) -> dict[str, dict]:
        """Returns LeRobot's description of the further columns."""
        picture = {
            "dtype": "video",
            "shape": (self.camera_size, self.camera_size, 3),
            "names": ["height", "width", "channels"],
        }
        described = {
            key: vector_feature(list(numbers))
            for name in self.fields
            for key, numbers in find_field(name).describe(type(unwrapped(env))).items()
        }
        return described | {image_key(camera): picture for camera in self.cameras}

    def observe(self, env: gym.Env) -> dict[str, np.ndarray]:
        """Returns the further columns of this moment; what is simulated is not changed.

        Raises:
            ValueError: A field observes something else than it describes.
        """
        task, size = unwrapped(env), self.camera_size
        return self._numbers(task) | {image_key(camera): task.picture(camera, size, size) for camera in self.cameras}

    def _numbers(self, task: PSMEnv) -> dict[str, np.ndarray]:
        return {key: row for name in self.fields for key, row in observe_field(name, task).items()}


NO_EXTRAS = Extras()


def describe_columns(env: gym.Env, extras: Extras) -> dict[str, dict]:
    """Returns LeRobot's description of all columns of a dataset, every number named by the environment."""
    task = unwrapped(env)
    goal = vector_feature(task.goal_names)
    return {
        STATE: vector_feature(task.observation_names),
        ENVIRONMENT_STATE: goal,
        GOAL: goal,
        ACHIEVED_GOAL: goal,
        TIME_TO_GOAL: vector_feature(["steps"]),
        ACTION: vector_feature(task.action_names),
        DISTURBANCE: vector_feature(task.action_names),
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
    extras = dict(episode)
    observation, goal, success = (extras.pop(key) for key in ("observation", "desired_goal", "success"))
    return {
        STATE: observation,
        ENVIRONMENT_STATE: goal,
        GOAL: goal,
        ACHIEVED_GOAL: extras.pop("achieved_goal"),
        TIME_TO_GOAL: time_to_goal(success)[:, None],
        ACTION: extras.pop("action"),
        DISTURBANCE: extras.pop("disturbance"),
        REWARD: extras.pop("reward")[:, None],
        SUCCESS: success[:, None],
    } | extras


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
