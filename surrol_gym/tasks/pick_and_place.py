"""PickAndPlace: put two jacks into the pots of their colours."""

from functools import partial
from typing import Any

import numpy as np
import pybullet

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state
from surrol_gym.quantities import euler, point
from surrol_gym.stage import OVERVIEW, Camera
from surrol_gym.tasks.tray import TRAY_POSITION, load_tray

COLOURS = ("red", "green")
POTS = np.array([(2.75, -0.125, 3.3905), (2.75, 0.15, 3.3905)])
DROP_HEIGHT = 3.436
"""Height from which the lying jacks drop, su."""

SPREAD, APART = 0.05, 0.1
"""Half side of the square over which the jacks are scattered, and their smallest distance in it, su."""

ATTACH_HEIGHT = 0.025
"""Lift of a jack's top at which a grasp attaches it, su (docs/grasping.md#the-rule)."""

# The top of a jack, its z axis along the rod, in the jack's frame, where that rod is y.
_TOP = (0.0, 0.05, 0.0), pybullet.getQuaternionFromEuler((-np.pi / 2, 0.0, 0.0))


class PickAndPlaceEnv(PSMEnv):
    """
    ## Description

    Two jacks, a red and a green one, stand between two shallow pots. One Patient Side Manipulator has to grasp each by
    its upper ball and put it into the pot of its colour, in any order. Jacks in the wrong pots are no success, nor is
    a single one in its pot.

    ## Action Space

    {actions}

    Closed jaws hold a jack by friction, and firmly once its top was lifted by 0.025 su.

    ## Observation Space

    {observation}

    The z axis of these angles is the upper rod: a jack that stands has (0, 0, yaw). In SurRoL it is the y axis.

    ## Rewards

    0 where each top is within 0.053 su (10.6 mm) of the middle of its pot, -1 elsewhere; the top of a jack that stands
    in the middle is 0.043 su above it. `info["is_success"]` says the same.

    ## Starting State

    Link 5 at (2.5, 0.25, 3.601), tool down, jaws closed. Each jack drops from a height of 3.436 su, lying, uniform in
    [2.70, 2.80] x [-0.05, 0.05] and at least 0.1 su from the other, turned by a uniform angle in [-90, 90] degrees; it
    rights itself, but some hang on the rim of the red pot and rock. Pots at (2.75, -0.125, 3.3905), red, and
    (2.75, 0.15, 3.3905), green.

    ## Episode End

    Truncated after 100 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; docs/scenes.md#pick-and-place.
    """

    task_description = "Put the red jack into the red pot and the green jack into the green pot."
    cameras = {
        "closeup": Camera(eye=(3.45, 0.015, 4.25), target=(2.73, 0.015, 3.46), field_of_view=32.0),
        "overview": OVERVIEW,
    }
    observation_quantities = (
        *robot_state(),
        point("red", "origin of the red jack, which is its centre of mass, below its feet"),
        point("green", "origin of the green jack"),
        point("red_rel", "origin of the red jack relative to link 5", derived_from=("red", "psm1")),
        point("green_rel", "origin of the green jack relative to link 5", derived_from=("green", "psm1")),
        point("red_top", "top of the red jack, 0.05 su from the origin along its upper rod"),
        point("green_top", "top of the green jack"),
        euler("red_top", "fixed-axis x-y-z Euler angles of the red jack"),
        euler("green_top", "fixed-axis x-y-z Euler angles of the green jack"),
    )
    goal_quantities = (
        point("red_top", "top of the red jack", "middle of the red pot"),
        point("green_top", "top of the green jack", "middle of the green pot"),
    )
    mounts = (Mount(start_position=(2.5, 0.25, 3.601)),)
    goal_tolerance = 0.053
    """Distance of each jack's top from the middle of its pot that is success, su."""

    def _build_scene(self) -> None:
        super()._build_scene()
        for colour, position in zip(COLOURS, POTS, strict=True):
            self.world.load(f"pot_{colour}.urdf", position)
        self._jacks = [self.world.load(f"jack_{colour}.urdf", fixed=False) for colour in COLOURS]
        load_tray(self.world)
        for index, jack in enumerate(self._jacks):
            self.grasps[0].append(Grasp(self.world, self.arms[0], jack, partial(self._is_lifted, index)))

    def _pose_scene(self) -> None:
        super()._pose_scene()
        offsets: np.ndarray = np.zeros((2, 2))
        while np.hypot(*(offsets[1] - offsets[0])) < APART:
            offsets = self.np_random.uniform(-SPREAD, SPREAD, (2, 2))
        yaws = self.np_random.uniform(-np.pi / 2, np.pi / 2, 2)
        for jack, offset, yaw in zip(self._jacks, offsets, yaws, strict=True):
            position = (*np.add(TRAY_POSITION[:2], offset), DROP_HEIGHT)
            self.world.place(jack, position, pybullet.getQuaternionFromEuler((0.0, 0.0, yaw)))

    def _sample_goal(self) -> np.ndarray:
        self._rest_heights = [self._top(index)[0][2] for index in range(2)]
        return POTS.ravel()

    def _is_lifted(self, index: int) -> bool:
        return self._top(index)[0][2] > self._rest_heights[index] + ATTACH_HEIGHT

    def _top(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        return self.world.frame(self._jacks[index], *_TOP)

    def _observe(self) -> np.ndarray:
        robot = self._robot_state()
        origins = [self.world.pose(jack)[0] for jack in self._jacks]
        positions, eulers = zip(*(self._top(index) for index in range(2)), strict=True)
        return np.concatenate([robot, *origins, *(origin - robot[:3] for origin in origins), *positions, *eulers])

    def _achieved_goal(self) -> np.ndarray:
        return np.concatenate([self._top(index)[0] for index in range(2)])

    def is_success(self, achieved_goal: np.ndarray, desired_goal: np.ndarray) -> np.ndarray:
        """Tests the tops of both jacks against the middles of their pots; shapes as in ``GoalEnv.is_success``."""
        offset = np.subtract(achieved_goal, desired_goal)
        offset = offset.reshape(*offset.shape[:-1], 2, 3)
        return (np.linalg.norm(offset, axis=-1) < self.goal_tolerance).all(axis=-1)

    def _get_task_state(self) -> dict[str, Any]:
        return super()._get_task_state() | {"rest_heights": self._rest_heights}

    def _set_task_state(self, state: dict[str, Any]) -> None:
        super()._set_task_state(state)
        self._rest_heights = state["rest_heights"]
