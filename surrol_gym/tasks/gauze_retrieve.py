"""GauzeRetrieve: pick up a piece of gauze and bring it to a goal in the air."""

from typing import Any

import numpy as np

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state
from surrol_gym.quantities import euler, point
from surrol_gym.tasks.needle import CAMERAS

TRAY_POSITION = (2.75, 0.0, 3.3798)
DROP_HEIGHT = 3.436
"""Height from which the gauze drops into the tray, su."""

GOAL_CENTRE, GOAL_SCATTER = np.array([2.75, 0.0, 3.626]), 0.1

ATTACH_HEIGHT = 0.0125
"""Lift of the gauze at which a grasp attaches it, su (docs/grasping.md#the-rule)."""


class GauzeRetrieveEnv(PSMEnv):
    """
    ## Description

    A folded piece of gauze lies in a tray. One Patient Side Manipulator, its tool pointing straight down, has to grasp
    it in the middle and bring it to a goal in the air. Only a small box in the middle of the gauze is felt, as if the
    rest gave way.

    ## Action Space

    {actions}

    ## Observation Space

    {observation}

    ## Rewards

    0 where the centre of the gauze is within 0.025 su (5 mm) of the goal, -1 elsewhere. `info["is_success"]` says the
    same.

    ## Starting State

    Link 5 at (2.5, 0.25, 3.601), tool down, jaws closed. Gauze uniform in [2.70, 2.80] x [-0.05, 0.05], never turned.
    Goal normal around (2.75, 0) with standard deviation 0.1 su, height 3.626. A goal out of the limits of link 5 is
    drawn again; that happens once in 70 times, and in SurRoL half of those goals cannot be reached.

    ## Episode End

    Truncated after 50 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; docs/scenes.md#gauze-retrieve.
    """

    task_description = "Pick up the gauze and bring it to the goal."
    cameras = CAMERAS
    observation_quantities = (
        *robot_state(),
        point("gauze", "centre of the gauze"),
        point("gauze_rel", "the same relative to link 5", derived_from=("gauze", "psm1")),
        point("grasp_point", "where to grasp the gauze: its centre again", derived_from=("gauze",)),
        euler("grasp_point", "its fixed-axis x-y-z Euler angles"),
    )
    solver_iterations = 20  # a step takes a third less time than with 50, and episodes end the same
    goal_quantities = (point("gauze", "centre of the gauze", "where it has to be"),)
    mounts = (Mount(start_position=(2.5, 0.25, 3.601), turn_step=0.0),)

    def _build_scene(self) -> None:
        super()._build_scene()
        self.world.load("tray.urdf", TRAY_POSITION)
        self._gauze = self.world.load("gauze.urdf", (*TRAY_POSITION[:2], DROP_HEIGHT), fixed=False)
        self.grasps[0].append(Grasp(self.world, self.arms[0], self._gauze, self._is_lifted))

    def _pose_scene(self) -> None:
        super()._pose_scene()
        x, y = TRAY_POSITION[:2] + self.np_random.uniform(-0.05, 0.05, 2)
        self.world.place(self._gauze, (x, y, DROP_HEIGHT))

    def _sample_goal(self) -> np.ndarray:
        self._rest_height = self._achieved_goal()[2]
        low, high = self.mounts[0].limits()
        while True:
            goal = GOAL_CENTRE + (*self.np_random.normal(0.0, GOAL_SCATTER, 2), 0.0)
            if np.all((low < goal) & (goal < high)):
                return goal

    def _is_lifted(self) -> bool:
        return self._achieved_goal()[2] > self._rest_height + ATTACH_HEIGHT

    def _observe(self) -> np.ndarray:
        grasp_point = self.world.frame(self._gauze, (0, 0, 0))
        return self._robot_and_object(grasp_point[0], grasp_point)

    def _achieved_goal(self) -> np.ndarray:
        return self.world.pose(self._gauze)[0]

    def _get_task_state(self) -> dict[str, Any]:
        return super()._get_task_state() | {"rest_height": self._rest_height}

    def _set_task_state(self, state: dict[str, Any]) -> None:
        super()._set_task_state(state)
        self._rest_height = state["rest_height"]
