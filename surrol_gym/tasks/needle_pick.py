"""NeedlePick: pick up the needle and bring its middle to a goal in the air."""

from typing import Any

import numpy as np

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state
from surrol_gym.quantities import euler, point
from surrol_gym.tasks.needle import CAMERAS, Needle

ATTACH_HEIGHT = 0.025
"""Lift of the needle's middle at which a grasp attaches it, su (docs/grasping.md#the-rule)."""


class NeedlePickEnv(PSMEnv):
    """
    ## Description

    A needle lies on a padded tray. One Patient Side Manipulator has to turn its jaws across the needle, grasp it in the
    middle of its arc and bring that middle to a goal in the air. Lifting without holding on is no success: the needle
    itself has to be at the goal.

    ## Action Space

    {actions}

    ## Observation Space

    {observation}

    ## Rewards

    0 where the middle of the needle is within 0.025 su (5 mm) of the goal, -1 elsewhere. `info["is_success"]` says
    the same.

    ## Starting State

    Link 5 at (2.5, 0.25, 3.601), tool down, jaws closed. Centre of the needle's arc uniform in
    [2.70, 2.80] x [-0.05, 0.05], turned by a uniform angle in [-90, 90] degrees. Goal normal around (2.75, 0) with
    standard deviation 0.05 su, height 3.576.

    ## Episode End

    Truncated after 50 steps; never terminated.

    ## Arguments

    * `randomize` (default True): False pins the needle (centre (2.75, 0), 18 degrees) and the goal (2.75, 0, 3.576) as
      in SurRoL's released demonstrations.
    * `render_mode`, `obs_type`, `camera` ("closeup" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; docs/scenes.md#needle-pick.
    """

    task_description = "Pick up the needle and bring its middle to the goal."
    cameras = CAMERAS
    observation_quantities = (
        *robot_state(),
        point("needle", "centre of mass of the needle"),
        point("needle_rel", "the same relative to link 5", derived_from=("needle", "psm1")),
        point("middle", "middle of the needle's arc"),
        euler("middle", "its fixed-axis x-y-z Euler angles"),
    )
    goal_quantities = (point("middle", "middle of the needle's arc", "where it has to be"),)
    mounts = (Mount(start_position=(2.5, 0.25, 3.601)),)

    def __init__(self, randomize: bool = True, **kwargs: Any):
        if not isinstance(randomize, bool | np.bool_):
            raise ValueError(f"randomize must be True or False, got {randomize!r}.")
        self._randomize = randomize
        super().__init__(**kwargs)

    def _build_scene(self) -> None:
        super()._build_scene()
        self._needle = Needle(self.world)
        self.grasps[0].append(Grasp(self.world, self.arms[0], self._needle.body, self._is_lifted))

    def _pose_scene(self) -> None:
        super()._pose_scene()
        pinned = (2.75, 0.0, 0.1 * np.pi)
        self._needle.drop(*(self._needle.sample_pose(self.np_random) if self._randomize else pinned))

    def _sample_goal(self) -> np.ndarray:
        self._rest_height = self._needle.middle()[0][2]
        scatter = self.np_random.normal(0.0, 0.05, 2) if self._randomize else np.zeros(2)
        return np.array([2.75, 0.0, 3.576]) + (*scatter, 0.0)

    def _is_lifted(self) -> bool:
        return self._needle.middle()[0][2] > self._rest_height + ATTACH_HEIGHT

    def _observe(self) -> np.ndarray:
        return self._robot_and_object(self._needle.centre(), self._needle.middle())

    def _achieved_goal(self) -> np.ndarray:
        return self._needle.middle()[0]

    def _get_task_state(self) -> dict[str, Any]:
        return super()._get_task_state() | {"rest_height": self._rest_height}

    def _set_task_state(self, state: dict[str, Any]) -> None:
        super()._set_task_state(state)
        self._rest_height = state["rest_height"]
