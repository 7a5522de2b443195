"""NeedleReach: bring the jaw tips to a point above the needle."""

import numpy as np

from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state
from surrol_gym.quantities import point
from surrol_gym.tasks.needle import CAMERAS, Needle

HOVER = np.array([0.0, 0.0, 0.025])
"""From the middle of the needle to the goal, su."""


class NeedleReachEnv(PSMEnv):
    """
    ## Description

    A needle lies on a padded tray. One Patient Side Manipulator, its jaws closed and pointing straight down, has to
    bring the jaw tips to a point just above the middle of the needle. The easiest of the ten tasks: free-space motion
    with a goal that differs in every episode.

    ## Action Space

    {actions}

    ## Observation Space

    {observation}

    ## Rewards

    0 where the tips are within 0.025 su (5 mm) of the goal, -1 elsewhere. `info["is_success"]` says the same.

    ## Starting State

    Link 5 at (2.5, 0.25, 3.776), tool down, jaws closed. Centre of the needle's arc uniform in
    [2.70, 2.80] x [-0.05, 0.05], turned by a uniform angle in [-90, 90] degrees. The goal is 0.025 su above the middle
    of the needle at rest.

    ## Episode End

    Truncated after 50 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; docs/scenes.md#needle-reach.
    """

    task_description = "Move the closed jaw tips to the point above the needle."
    cameras = CAMERAS
    observation_quantities = robot_state()
    goal_quantities = (point("tip", "position of the jaw tips", "the point above the needle"),)
    mounts = (Mount(start_position=(2.5, 0.25, 3.776), turn_step=0.0),)
    has_gripper = False

    def _build_scene(self) -> None:
        super()._build_scene()
        self._needle = Needle(self.world)

    def _pose_scene(self) -> None:
        super()._pose_scene()
        self._needle.drop(*self._needle.sample_pose(self.np_random))

    def _sample_goal(self) -> np.ndarray:
        return self._needle.middle()[0] + HOVER

    def _observe(self) -> np.ndarray:
        return self._robot_state()

    def _achieved_goal(self) -> np.ndarray:
        return self.arms[0].tip()
