"""NeedleReach: bring the jaw tips to a point above the needle."""

import numpy as np

from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state_names, xyz
from surrol_gym.experts import Target
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

    `Box(-1, 1, (5,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | turn of the tool | none in this task |
    | 4 | jaws | none in this task: they stay closed |

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | position of link 5 (x, y, z), su |
    | 3, 4, 5 | fixed-axis x-y-z Euler angles of link 5, radians |
    | 6 | opening angle of the jaws, radians |

    `achieved_goal` (3): position of the jaw tips. `desired_goal` (3): the point above the needle.

    ## Rewards

    0 where the tips are within 0.025 su (5 mm) of the goal, -1 elsewhere. `info["is_success"]` says the same.

    ## Starting State

    Link 5 at (2.5, 0.25, 3.776), tool down, jaws closed. Centre of the needle's arc uniform in
    [2.70, 2.80] x [-0.05, 0.05], turned by a uniform angle in [-90, 90] degrees. The goal is 0.025 su above the middle
    of the needle at rest.

    ## Episode End

    Truncated after 50 steps; never terminated.

    ## Arguments

    `render_mode`, `camera` ("closeup" or "overview"), `width`, `height`: see `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; facts, section 4.1.
    """

    task = "NeedleReach"
    task_description = "Move the closed jaw tips to the point above the needle."
    cameras = CAMERAS
    observation_names = robot_state_names("psm1")
    goal_names = xyz("goal_tip")
    mounts = (Mount(start_position=(2.5, 0.25, 3.776), turn_step=0.0),)
    has_gripper = False

    def _build_scene(self):
        super()._build_scene()
        self._needle = Needle(self.world)

    def _pose_scene(self):
        super()._pose_scene()
        self._needle.drop(*self._needle.sample_pose(self.np_random))

    def _sample_goal(self):
        return self._needle.middle()[0] + HOVER

    def _observe(self):
        return self._robot_state()

    def _achieved_goal(self):
        return self.arms[0].tip()

    @staticmethod
    def expert_target(observation):
        """Straight to the goal, about as fast as the original script (facts, section 5.1)."""
        return Target(observation["desired_goal"] - observation["achieved_goal"], gain=0.5, speed=0.3)
