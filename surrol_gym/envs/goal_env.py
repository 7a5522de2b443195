"""The goal environment that the tasks share: Gymnasium's API around one PyBullet world."""

import inspect
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ClosedEnvironmentError, ResetNeeded

from surrol_gym.bullet import Vector, World
from surrol_gym.display import check_display
from surrol_gym.quantities import Quantity, described, names, places, repeated_names
from surrol_gym.stage import KINDS, Camera, Stage

if TYPE_CHECKING:
    from surrol_gym.window import Window

SUB_STEPS = 48
"""Simulation sub-steps in one control step of 0.2 s (docs/simulator.md#sub-steps)."""

SETTLING_STEPS = 60
"""Sub-steps between posing the scene and the first observation (docs/simulator.md#sub-steps)."""

_WORLD_EXTENT = 100.0  # Bounds of the observation spaces: nothing can leave the floor.

_PICTURES = {"rgb_array": "rgb", "depth_array": "depth", "segmentation": "segmentation"}


Observation = dict[str, np.ndarray]
"""Arrays ``observation``, ``achieved_goal`` and ``desired_goal``; see ``GoalEnv``."""

Reading = SimpleNamespace
"""What ``GoalEnv.read`` returns."""


@dataclass(frozen=True)
class State:
    """A moment of an episode, as ``get_state`` returns it: simulation, task, random generator and number of steps."""

    task_name: str
    world: tuple
    task: dict[str, Any]
    rng: Mapping[str, Any]
    elapsed_steps: int


class GoalEnv(gym.Env):
    """Base of all tasks: dict observations with goals, sparse rewards, seeded resets that load nothing.

    A task is named as its class without ``Env``. It says once, as data, what its numbers are
    (``observation_quantities``, ``goal_quantities``); the tables of its docstring stand where that says
    ``{observation}`` and ``{actions}``.

    Observations are dicts of float32 arrays ``observation``, ``achieved_goal`` and ``desired_goal``, in scaled units
    (1 su = 0.2 m) and radians, world frame; with ``obs_type="pixels_state"`` also ``pixels``, a picture of shape
    (height, width, 3), uint8. The reward is 0 in success and -1 otherwise; ``terminated`` is always
    False. ``info`` holds ``is_success``, ``contact_force`` (sum of the normal forces on the arms in the last
    sub-step, kg su / s^2) and ``workspace_clipped`` (whether the action pointed out of the workspace).

    Nothing between a seed and an action of the expert calls NumPy's transcendental functions, its products of float
    matrices or its ``linalg``, apart from norms along an axis: their last digit depends on the processor, and that of
    ``math`` does not. So a seed gives the same bytes on every x86-64 processor with FMA, which the C library looks for.

    Args:
        render_mode: None, ``"rgb_array"``, ``"depth_array"``, ``"segmentation"``, see ``surrol_gym.stage.Stage.render``
            for what these pictures hold, or, with pygame and on a machine with a display, ``"human"``.
        obs_type: ``"state"`` or ``"pixels_state"``.
        camera: Name of the camera of ``render`` and ``pixels``, one of ``cameras``.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.

    Attributes:
        elapsed_steps: Steps of the episode so far.

    Raises:
        ValueError: An argument is not one of the values above.
    """

    observation_space: gym.spaces.Dict
    metadata = {"render_modes": ["human", *_PICTURES], "render_fps": 5}

    task: ClassVar[str]
    """Name of the task."""
    task_description: ClassVar[str]
    """The task as a sentence; datasets store it and language-conditioned policies read it."""
    cameras: ClassVar[dict[str, Camera]] = {}
    """By name; one of them, ``"closeup"``, is the default."""
    observation_quantities: ClassVar[tuple[Quantity, ...]] = ()
    """What the numbers of ``observation`` are, in their order."""
    goal_quantities: ClassVar[tuple[Quantity, ...]] = ()
    """What the numbers of a goal are; one that is observed, too, has the same name there."""
    action_quantities: ClassVar[tuple[Quantity, ...]] = ()
    observation_names: ClassVar[tuple[str, ...]]
    """Name of each number of ``observation``; datasets carry them."""
    goal_names: ClassVar[tuple[str, ...]]
    """Name of each number of a goal; a number of ``observation`` of that name repeats the desired goal."""
    action_names: ClassVar[tuple[str, ...]]
    _places: ClassVar[dict[str, dict[str, int | slice]]]
    goal_tolerance = 0.025
    """Distance from the desired goal that is success, su."""
    solver_iterations = 50
    """Iterations of the contact solver; a task may get by with fewer."""

    def __init_subclass__(cls, **kwargs: Any):
        super().__init_subclass__(**kwargs)
        cls.task = cls.__name__.removesuffix("Env")
        desired = [replace(quantity, name=f"goal_{quantity.name}") for quantity in cls.goal_quantities]
        cls.observation_names, cls.goal_names = names(cls.observation_quantities), names(desired)
        cls.action_names = names(cls.action_quantities)
        for quantities in (cls.observation_quantities, cls.goal_quantities):
            if repeated := repeated_names(quantities):
                raise ValueError(f"{cls.task} has two quantities called {', '.join(repeated)}; give one another name.")
        cls._places = {
            "achieved_goal": places(cls.goal_quantities),
            "desired_goal": places(desired),
            "observation": places(cls.observation_quantities),
        }
        if cls.__doc__:  # Python may have been told to leave docstrings out
            doc = inspect.cleandoc(cls.__doc__).replace("{observation}", cls._describe_observation())
            cls.__doc__ = doc.replace("{actions}", cls._describe_actions())

    @classmethod
    def _sizes(cls) -> dict[str, int]:
        """How many numbers each array of an observation holds."""
        goal = len(cls.goal_names)
        return {"observation": len(cls.observation_names), "achieved_goal": goal, "desired_goal": goal}

    @classmethod
    def _describe_observation(cls) -> str:
        size, goals = len(cls.goal_names), cls.goal_quantities
        return (
            "A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.\n\n"
            + described(cls.observation_quantities, "Index", "`observation`", "Content", "Unit")
            + f"\n\n`achieved_goal` ({size}): {', then '.join(goal.meaning for goal in goals)}. "
            + f"`desired_goal` ({size}): {', then '.join(goal.wanted for goal in goals)}."
        )

    @classmethod
    def _describe_actions(cls) -> str:
        space = f"`Box(-1, 1, ({len(cls.action_names)},), float32)`. One step is 0.2 s.\n\n"
        return space + described(cls.action_quantities, "Index", "`action`", "Action", "Effect of 1")

    def __init__(
        self,
        render_mode: str | None = None,
        obs_type: str = "state",
        camera: str = "closeup",
        width: int = 256,
        height: int = 256,
    ):
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode must be None or one of {self.metadata['render_modes']}, got {render_mode!r}."
            )
        if render_mode == "human":
            check_display()
        if obs_type not in ("state", "pixels_state"):
            raise ValueError(f"obs_type must be 'state' or 'pixels_state', got {obs_type!r}.")
        self.render_mode = render_mode
        self._picture = self._check_picture(camera, width, height)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (len(self.action_names),), np.float32)
        self.observation_space = gym.spaces.Dict(
            {
                array: gym.spaces.Box(-_WORLD_EXTENT, _WORLD_EXTENT, (size,), np.float32)
                for array, size in self._sizes().items()
            }
        )
        if obs_type == "pixels_state":
            self.observation_space["pixels"] = gym.spaces.Box(0, 255, (height, width, 3), np.uint8)
        self.world = World(self.solver_iterations)
        self._stage: Stage | None = None
        self._window: Window | None = None
        self._closed = False
        self._goal: np.ndarray = np.resize((0.0, 0.0, -1.0), len(self.goal_names))  # below the floor at first
        self._world_state: tuple = ()  # until the first reset
        self.elapsed_steps = 0
        # Things near the camera first: the renderer then finds the others hidden.
        self._build_scene()
        for part in range(0, len(self.goal_names), 3):
            self.world.draw("goal.urdf", pose=partial(self._goal_pose, part))
        self.world.load("table.urdf", (2.5, 0.0, 0.005))
        self.world.load("floor.urdf")
        self.world.mark_built()
        if render_mode == "human":
            from surrol_gym import window  # which needs pygame

            self._window = window.Window(self.task, self._picture[0], self._render)

    @classmethod
    def read(cls, observation: Observation) -> Reading:
        """Returns the numbers of an observation by their names, and those of each quantity together.

        Of NeedlePick, ``seen.psm1_jaw`` is a number, ``seen.middle`` a point of shape (3,) and ``seen.middle_rpy`` its
        Euler angles; ``seen.goal_middle`` is the desired goal. An achieved goal that is not observed has its own name,
        as NeedleReach's ``seen.tip``.

        Raises:
            ValueError: An array has another size: the observation is one of another task.
        """
        for array, size in cls._sizes().items():
            shape = np.shape(observation[array])
            if shape[:1] != (size,):  # further axes are who reads many at once
                raise ValueError(f"{cls.task} has {size} numbers in {array}, not {shape}; is it of another task?")
        found = cls._places.items()
        return Reading(**{name: observation[array][at] for array, places in found for name, at in places.items()})

    # What a task defines.

    @abstractmethod
    def _build_scene(self) -> None:
        """Loads arms and objects; runs once, when the environment is made."""

    @abstractmethod
    def _pose_scene(self) -> None:
        """Puts arms and objects where the episode starts, drawing from ``self.np_random``."""

    @abstractmethod
    def _sample_goal(self) -> np.ndarray:
        """Returns the desired goal of the settled scene, shape (G,), drawing from ``self.np_random``."""

    @abstractmethod
    def _apply_action(self, action: np.ndarray) -> bool:
        """Commands the arms and grippers; returns whether the workspace clipped the motion."""

    @abstractmethod
    def _after_sub_steps(self) -> None:
        """Updates what the motion caused, such as grasps."""

    @abstractmethod
    def _observe(self) -> np.ndarray:
        """Returns the observation vector, shape (O,)."""

    @abstractmethod
    def _achieved_goal(self) -> np.ndarray:
        """Returns the achieved goal, shape (G,)."""

    @abstractmethod
    def _contact_force(self) -> float:
        """Returns the sum of the normal forces on the arms."""

    def is_success(self, achieved_goal: np.ndarray, desired_goal: np.ndarray) -> np.ndarray:
        """Tests achieved against desired goals of shape (..., G); returns booleans of shape (...)."""
        return np.linalg.norm(np.subtract(achieved_goal, desired_goal), axis=-1) < self.goal_tolerance

    def _get_task_state(self) -> dict[str, Any]:
        """Returns what the task must remember beside the simulation."""
        return {"goal": tuple(self._goal.tolist())}

    def _set_task_state(self, state: dict[str, Any]) -> None:
        """Restores ``_get_task_state``."""
        self._goal = np.array(state["goal"])

    # Gymnasium's API.

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts an episode; see ``gymnasium.Env.reset``. No task has options, so they are not looked at."""
        self._check_open()
        super().reset(seed=seed)
        self.world.restore_built()
        self._pose_scene()
        self.world.step(SETTLING_STEPS)
        self._goal = np.array(self._sample_goal(), dtype=np.float64)  # a copy, since it may be a constant of the task
        self._after_sub_steps()
        contact_force = self._contact_force()
        self._forget_contacts()
        self.elapsed_steps = 0
        observation = self._get_observation()
        self._check_sizes(observation)
        return observation, self._get_info(observation, contact_force, workspace_clipped=False)

    def step(self, action: np.ndarray) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advances the episode by one control step of 0.2 s; see ``gymnasium.Env.step``.

        Raises:
            ValueError: The action has another shape than the action space or a number that is not finite.
        """
        self._check_open()
        self._check_reset()
        clipped = self._apply_action(self._check_action(action))
        self.world.step(SUB_STEPS)
        self._after_sub_steps()
        contact_force = self._contact_force()
        self._forget_contacts()
        self.elapsed_steps += 1
        observation = self._get_observation()
        info = self._get_info(observation, contact_force, clipped)
        return observation, float(info["is_success"]) - 1.0, False, False, info

    def render(self) -> np.ndarray | None:
        """Returns a picture as the render mode says.

        In mode ``"human"`` every reset and step is shown by itself; call this now and then while none is taken, so that
        the window follows the mouse.

        Raises:
            surrol_gym.display.WindowClosed: The window was closed.
        """
        self._check_open()
        if self._window:
            self._window.refresh()
        if self.render_mode in _PICTURES:
            return self._render(*self._picture, _PICTURES[self.render_mode])
        return None

    def pressed_keys(self) -> set[str]:
        """Returns the names of the keys that are down in the window of mode ``"human"``, or were since the last call.

        A key is named by what it writes, ``"w"``, or by its own name, ``"shift"`` and ``"enter"``.

        Raises:
            ValueError: The render mode is another one.
            surrol_gym.display.WindowClosed: The window was closed.
        """
        self._check_open()
        if not self._window:
            raise ValueError(f"Only render_mode='human' has a window with keys; this is {self.render_mode!r}.")
        return self._window.pressed_keys()

    def picture(self, camera: str = "closeup", width: int = 256, height: int = 256, kind: str = "rgb") -> np.ndarray:
        """Renders the scene from any camera at any size, whatever the render mode.

        Args:
            camera: One of ``cameras``.
            width: Pixels.
            height: Pixels.
            kind: ``"rgb"``, ``"depth"`` or ``"segmentation"``; see ``surrol_gym.stage.Stage.render``.

        Returns:
            An array of shape (height, width, 3), uint8, or (height, width), float32 or int32.
        """
        self._check_open()
        if kind not in KINDS:
            raise ValueError(f"A picture has one of the kinds {KINDS}, got {kind!r}.")
        return self._render(*self._check_picture(camera, width, height), kind)

    @property
    def segment_names(self) -> tuple[str, ...]:
        """What the numbers of a segmentation stand for: its pixels are indices into this tuple."""
        self._check_open()
        return self._get_stage().names

    def close(self) -> None:
        """Frees the simulation; closing twice is harmless."""
        if not self._closed:
            self._closed = True
            self.world.close()
            if self._stage is not None:
                self._stage.close()
            if self._window:
                self._window.close()

    # The multi-goal API: everything vectorised over leading axes. Goals of another size raise ValueError.

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray | float:
        """Returns 0 where the goal is achieved and -1 elsewhere, for goals of shape (..., G)."""
        self._check_goals(achieved_goal, desired_goal)
        reward = np.asarray(self.is_success(achieved_goal, desired_goal), dtype=np.float32) - 1.0
        return reward if reward.ndim else float(reward)

    def compute_terminated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray | bool:
        """Returns False for every goal: episodes end at the time limit only."""
        return self._never(achieved_goal, desired_goal)

    def compute_truncated(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray | bool:
        """Returns False for every goal: the time limit truncates."""
        return self._never(achieved_goal, desired_goal)

    # Saving and restoring.

    def get_state(self) -> State:
        """Returns the full state of the episode; ``set_state`` brings it back in any environment of this task."""
        self._check_open()
        self._check_reset()
        rng = self.np_random.bit_generator.state
        return State(self.task, self._world_state, self._get_task_state(), rng, self.elapsed_steps)

    def set_state(self, state: State) -> Observation:
        """Restores a state of ``get_state``.

        Returns:
            The observation of that moment.

        Raises:
            TypeError: It is none.
            ValueError: The state is one of another task.
        """
        self._check_open()
        if not isinstance(state, State):
            raise TypeError(f"set_state takes what get_state returned, got {state!r}.")
        if state.task_name != self.task:
            raise ValueError(f"This is a {self.task} environment; it cannot go to a state of {state.task_name}.")
        self._set_task_state(state.task)  # first, because a body that is held does not fall asleep
        self._world_state = state.world
        self.world.set_state(state.world)
        self.np_random.bit_generator.state = state.rng
        self.elapsed_steps = state.elapsed_steps
        return self._get_observation()

    def __reduce__(self) -> tuple:
        """Lets ``copy`` and ``pickle`` make the environment again, which has a simulation of its own, in its state."""
        self._check_open()
        if self.spec is None:
            raise TypeError(
                f"Only an environment of gymnasium.make can be copied or pickled; make another {self.task} environment "
                "and give it the state: other.set_state(env.get_state())."
            )
        return _made_again, (type(self), self.spec, self.get_state() if self._world_state else None)

    # Details.

    def _get_observation(self) -> Observation:
        observation = {
            "observation": np.asarray(self._observe(), dtype=np.float32),
            "achieved_goal": np.asarray(self._achieved_goal(), dtype=np.float32),
            "desired_goal": self._goal.astype(np.float32),
        }
        if "pixels" in self.observation_space.spaces:
            observation["pixels"] = self._render(*self._picture)
        if self._window:
            self._window.show()
        return observation

    def _render(self, camera: Camera, width: int, height: int, kind: str = "rgb") -> np.ndarray:
        return self._get_stage().render(camera, width, height, kind)

    def _get_stage(self) -> Stage:
        if self._stage is None:
            self._stage = Stage(self.world)
        return self._stage

    def _goal_pose(self, part: int) -> tuple[Vector, Vector]:
        return self._goal[part : part + 3], (0, 0, 0, 1)

    def _forget_contacts(self) -> None:
        # From here on the episode depends on poses and velocities only, which is all that get_state has to keep.
        self._world_state = self.world.get_state()
        self.world.set_state(self._world_state)

    def _get_info(self, observation: Observation, contact_force: float, workspace_clipped: bool) -> dict[str, Any]:
        return {
            "is_success": bool(self.is_success(observation["achieved_goal"], observation["desired_goal"])),
            "contact_force": contact_force,
            "workspace_clipped": workspace_clipped,
        }

    def _check_action(self, action: np.ndarray) -> np.ndarray:
        action = np.asarray(action, dtype=np.float64)
        if action.shape != self.action_space.shape:
            raise ValueError(f"{self.task} takes actions of shape {self.action_space.shape}, got {action.shape}.")
        if not np.isfinite(action).all():
            raise ValueError(f"The action holds a number that is not finite: {action.tolist()}.")
        return np.minimum(np.maximum(action, -1.0), 1.0)  # faster than np.clip

    def _check_picture(self, camera: str, width: int, height: int) -> tuple[Camera, int, int]:
        if not isinstance(camera, str) or camera not in self.cameras:
            raise ValueError(f"{self.task} has the cameras {sorted(self.cameras)}, got {camera!r}.")
        for name, size in (("width", width), ("height", height)):
            if not isinstance(size, int | np.integer) or isinstance(size, bool) or size < 1:
                raise ValueError(f"A picture needs a whole, positive {name}, got {size!r}.")
        return self.cameras[camera], width, height

    def _check_sizes(self, observation: Observation) -> None:
        for array, size in self._sizes().items():
            if observation[array].shape != (size,):
                raise ValueError(
                    f"{self.task} says what {size} numbers of {array} are, and returns an array of shape "
                    f"{observation[array].shape}; its quantities and its methods have to agree."
                )

    def _check_open(self) -> None:
        if self._closed:
            raise ClosedEnvironmentError(f"This {self.task} environment is closed; make a new one.")

    def _check_reset(self) -> None:
        if not self._world_state:
            raise ResetNeeded(f"Call reset() before the first step of this {self.task} environment.")

    def _check_goals(self, *goals: np.ndarray) -> tuple[int, ...]:
        """Returns the leading axes that the goals have together."""
        size = len(self.goal_names)
        for goal in goals:
            if np.shape(goal)[-1:] != (size,):
                raise ValueError(f"{self.task} takes goals of shape (..., {size}), got {np.shape(goal)}.")
        return np.broadcast_shapes(*map(np.shape, goals))[:-1]

    def _never(self, *goals: np.ndarray) -> np.ndarray | bool:
        shape = self._check_goals(*goals)
        return np.zeros(shape, dtype=bool) if shape else False


def _made_again(env_class: type[GoalEnv], spec: EnvSpec, state: State | None) -> GoalEnv:
    """Makes the copy of an environment."""
    env = env_class(**spec.kwargs)
    env.spec = spec
    if state:
        env.set_state(state)
    return env
