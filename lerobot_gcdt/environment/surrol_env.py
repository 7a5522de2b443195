"""The SurRoL tasks as LeRobot's environment type ``surrol``."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.envs.utils import freeze_after_episode_end
from lerobot.processor import PolicyProcessorPipeline
from lerobot.processor.pipeline import ObservationProcessorStep, ProcessorStepRegistry

from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, ENVIRONMENT_STATE, GOAL, STATE, image_key
from surrol_gym.registry import NAMESPACE, env_class, find_task
from surrol_gym.wrappers import IDEAL, complete_sensors, imperfect

if TYPE_CHECKING:
    from surrol_gym.envs.psm_env import PSMEnv


class CameraPictures(gym.ObservationWrapper):
    """Adds pictures to the observations: ``pixels``, a dictionary of one of shape (size, size, 3) for each camera.

    Args:
        env: An environment of ``surrol_gym``.
        cameras: Names of its cameras.
        size: Width and height, pixels.
    """

    unwrapped: "PSMEnv"  # imported for the type only: importing the policies loads no simulation

    def __init__(self, env: gym.Env, cameras: list[str], size: int):
        super().__init__(env)
        self._cameras, self._size = cameras, size
        picture = gym.spaces.Box(0, 255, (size, size, 3), np.uint8)
        pixels = gym.spaces.Dict(dict.fromkeys(cameras, picture))
        self.observation_space = gym.spaces.Dict({**self.unwrapped.observation_space.spaces, "pixels": pixels})

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Adds the pictures of this moment."""
        picture = self.unwrapped.picture
        return observation | {"pixels": {camera: picture(camera, self._size, self._size) for camera in self._cameras}}


@ProcessorStepRegistry.register(name="surrol_observations")
class SurRoLObservations(ObservationProcessorStep):
    """Gives the observations of a goal environment the names that our datasets use.

    The desired goal appears twice: as ``observation.goal``, and as ``observation.environment_state``, where LeRobot's
    own policies look for it.
    """

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Renames ``observation.observation`` and ``observation.desired_goal``."""
        renamed = dict(observation)
        renamed[STATE] = renamed.pop("observation.observation")
        renamed[GOAL] = renamed[ENVIRONMENT_STATE] = renamed.pop("observation.desired_goal")
        return renamed

    def transform_features(self, features: dict) -> dict:
        """Features of the environment configuration already have their final names."""
        return features


@EnvConfig.register_subclass("surrol")
@dataclass
class SurRoLEnvConfig(EnvConfig):
    """Environment type ``surrol``: ``--env.type=surrol --env.task=NeedlePick-v0``.

    Attributes:
        task: Name of a task, or several of them separated by commas; see ``surrol_gym.find_task``.
        fps: Control steps a second.
        camera: Camera of the rendered pictures.
        width: Width of the rendered pictures, pixels.
        height: Height of the rendered pictures, pixels.
        cameras: Cameras that policies see as ``observation.images.<camera>``, separated by commas, as in
            ``gcdt record --cameras``.
        camera_size: Width and height of what they see, pixels.
        position_std: Noise of what policies see, as ``surrol_gym.wrappers.ImperfectSensors`` takes it, su.
        angle_std: The same of angles, radians.
        dropout: Probability that they miss a step's reading.
        delay: Steps by which what they see lags.
        action_std: Noise of what they do, as ``surrol_gym.wrappers.NoisyActions`` takes it.

    Raises:
        OptionError: A task is not registered, or lacks one of the cameras, or a number is out of range.
    """

    task: str = "NeedlePick-v0"
    fps: int = 5
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(default_factory=dict)
    camera: str = "closeup"
    width: int = 256
    height: int = 256
    cameras: str = ""
    camera_size: int = 128
    position_std: float = 0.0
    angle_std: float = 0.0
    dropout: float = 0.0
    delay: int = 0
    action_std: float = 0.0

    def __post_init__(self) -> None:
        for task in self._tasks():
            try:
                has = sorted(env_class(task).cameras)
            except ValueError as error:
                raise OptionError(f"env.task: {error}") from None
            if not set(self._cameras()) <= set(has):
                raise OptionError(f"{task} has the cameras {', '.join(has)}; got env.cameras={self.cameras}.")
            if self.camera not in has:
                raise OptionError(f"{task} has the cameras {', '.join(has)}; got env.camera={self.camera}.")
        for name in ("width", "height", "camera_size"):
            if getattr(self, name) < 1:
                raise OptionError(f"env.{name} must be positive, got {getattr(self, name)}.")
        try:
            complete_sensors(self._imperfections(), IDEAL)
        except ValueError as error:
            raise OptionError(f"env.{error}") from None
        env = env_class(self._tasks()[0])
        self.features = {
            ACTION: PolicyFeature(FeatureType.ACTION, (len(env.action_names),)),
            STATE: PolicyFeature(FeatureType.STATE, (len(env.observation_names),)),
            GOAL: PolicyFeature(FeatureType.STATE, (len(env.goal_names),)),
            ACHIEVED_GOAL: PolicyFeature(FeatureType.STATE, (len(env.goal_names),)),
            ENVIRONMENT_STATE: PolicyFeature(FeatureType.ENV, (len(env.goal_names),)),
        }
        picture = PolicyFeature(FeatureType.VISUAL, (self.camera_size, self.camera_size, 3))
        self.features |= {image_key(camera): picture for camera in self._cameras()}
        self.features_map = {key: key for key in self.features}

    @property
    def package_name(self) -> str:
        """The module that registers the first task."""
        return find_task(self._tasks()[0]).rpartition(":")[0] or "surrol_gym"

    @property
    def gym_id(self) -> str:
        """The id of the first task."""
        return find_task(self._tasks()[0]).rpartition(":")[2]

    @property
    def gym_kwargs(self) -> dict:
        """Arguments of the environments."""
        return {"render_mode": "rgb_array", "camera": self.camera, "width": self.width, "height": self.height}

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> dict[str, dict[int, gym.vector.VectorEnv]]:
        """Makes one vector environment a task.

        Args:
            n_envs: Environments in each.
            use_async_envs: Whether they run in processes of their own.

        Returns:
            ``{task: {0: vector environment}}``.
        """
        ids = map(find_task, self._tasks())
        return {
            env_id.rpartition(NAMESPACE)[2]: {0: self._create(env_id, n_envs, use_async_envs and n_envs > 1)}
            for env_id in ids
        }

    def get_env_processors(self) -> tuple[PolicyProcessorPipeline, PolicyProcessorPipeline]:
        """Returns the pipelines that rename the observations and leave the actions alone."""
        return PolicyProcessorPipeline(steps=[SurRoLObservations()]), PolicyProcessorPipeline(steps=[])

    def _tasks(self) -> list[str]:
        return [task.strip() for task in self.task.split(",")]

    def _cameras(self) -> list[str]:
        return [camera.strip() for camera in self.cameras.split(",") if camera.strip()]

    def _imperfections(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in IDEAL}

    def _create(self, env_id: str, n_envs: int, use_async_envs: bool) -> gym.vector.VectorEnv:
        def make() -> gym.Env:
            env = gym.make(env_id, disable_env_checker=True, **self.gym_kwargs)
            if self.cameras:
                env = CameraPictures(env, self._cameras(), self.camera_size)
            return imperfect(env, self._imperfections())

        makers = [freeze_after_episode_end(make)] * n_envs
        mode = gym.vector.AutoresetMode.NEXT_STEP
        if use_async_envs:
            return gym.vector.AsyncVectorEnv(makers, context="forkserver", autoreset_mode=mode)
        return gym.vector.SyncVectorEnv(makers, autoreset_mode=mode)
