"""The simulated arms of a task as a robot of LeRobot's."""

import logging
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from lerobot.robots import Robot
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from lerobot_gcdt.robot.config_surrol_psm import SurRoLPSMConfig
from lerobot_gcdt.robot.names import (
    BEGIN,
    DELTAS,
    ActionReader,
    action_names,
    observation_names,
    observation_numbers,
)
from lerobot_gcdt.robot.recorded import recorded_episode
from surrol_gym.envs.goal_env import Observation
from surrol_gym.envs.psm_env import unwrapped
from surrol_gym.registry import env_class, find_task

logger = logging.getLogger(__name__)


class SurRoLPSM(Robot):
    """One or two simulated PSMs in the scene of a task.

    Each action takes 0.2 s of simulated time, however fast it is sent: run LeRobot's commands with 5 frames a second.
    An episode begins when the robot is connected, and again where an action says ``begin_anew``, each time from the
    next seed. It never ends by itself.

    Args:
        config: The configuration.

    Raises:
        OptionError: The recording lacks the episode.
    """

    config_class = SurRoLPSMConfig
    name = "surrol_psm"

    def __init__(self, config: SurRoLPSMConfig):
        super().__init__(config)
        self.config = config
        self._seed, self._disturbance = config.seed, np.zeros((0, 0), dtype=np.float32)
        if config.recording:
            self._seed, self._disturbance = recorded_episode(Path(config.recording), config.episode)
        self._class = env_class(config.task)
        self._reader = ActionReader(self._class, config.away, config.delta_scale)
        self.cameras: dict[str, None] = dict.fromkeys(config.camera_names())
        """By name; LeRobot's commands count them."""
        self._env: gym.Env | None = None
        self._seen: Observation = {}
        self._steps, self._held = 0, False
        self._reached: int | None = None

    @property
    def observation_features(self) -> dict[str, Any]:
        """The numbers of ``observation_names``, and a picture of each camera."""
        size = self.config.camera_size
        return dict.fromkeys(observation_names(self._class), float) | dict.fromkeys(self.cameras, (size, size, 3))

    @property
    def action_features(self) -> dict[str, type]:
        """The numbers of ``action_names``, or deltas where the configuration says so."""
        return dict.fromkeys(DELTAS if self.config.deltas else action_names(self._class), float)

    @property
    def is_connected(self) -> bool:
        """Whether there is a scene."""
        return self._env is not None

    @property
    def is_calibrated(self) -> bool:
        """Always: there is nothing to calibrate."""
        return True

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Makes the scene and begins an episode."""
        self._env = gym.make(find_task(self.config.task), render_mode="human" if self.config.window else None)
        self._begin()

    def calibrate(self) -> None:
        """Does nothing."""

    def configure(self) -> None:
        """Does nothing."""

    @check_if_not_connected
    def get_observation(self) -> dict[str, Any]:
        """Returns what is seen at this moment."""
        size = self.config.camera_size
        pictures = {camera: unwrapped(self._scene).picture(camera, size, size) for camera in self.cameras}
        return observation_numbers(self._class, self._seen) | pictures

    @check_if_not_connected
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Takes one control step.

        Args:
            action: What ``ActionReader`` reads; numbers beyond [-1, 1] are cut off there.

        Returns:
            The action that was executed, named as in ``action_names``.

        Raises:
            ValueError: It is no action of this task.
        """
        if action.get(BEGIN):
            self._tell()
            self._seed += 1
            self._begin()
        numbers = self._reader.read(action)
        if self._steps < len(self._disturbance):
            numbers = numbers + self._disturbance[self._steps]
        self._seen, _, _, _, info = self._scene.step(numbers)
        self._steps += 1
        self._held = info["is_success"]
        if self._held and self._reached is None:
            self._reached = self._steps
            logger.info("Seed %d: the goal is reached in step %d.", self._seed, self._steps)
        executed = np.clip(numbers, -1, 1).tolist()
        return dict(zip(action_names(self._class), executed, strict=True))

    @check_if_not_connected
    def disconnect(self) -> None:
        """Says how the episode ended, and closes the scene."""
        self._tell()
        self._scene.close()
        self._env = None

    @property
    def _scene(self) -> gym.Env:
        assert self._env  # all that need it are refused while there is no connection
        return self._env

    def _begin(self) -> None:
        self._reader.reset()
        self._seen = self._scene.reset(seed=self._seed)[0]
        self._steps, self._reached, self._held = 0, None, False

    def _tell(self) -> None:
        if self._steps:
            reached = "never reached" if self._reached is None else f"reached in step {self._reached}"
            held = "held" if self._held else "not held"
            logger.info(
                "%s, seed %d: %d steps, the goal %s, %s at the end.",
                *(self._class.task, self._seed, self._steps, reached, held),
            )
