"""NeedlePick: pick up the needle and bring its middle to a goal in the air."""

import numpy as np

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state_names, rpy, xyz
from surrol_gym.experts import CLOSE, Target, grasp, nearest_yaw
from surrol_gym.psm.arm import TIP_OFFSET
from surrol_gym.tasks.needle import CAMERAS, Needle

ATTACH_HEIGHT = 0.025
"""Lift of the needle's middle at which a grasp attaches it, su (facts, section 2.1)."""

GRASP_HEIGHT = TIP_OFFSET - 0.0035
"""Height of link 5 above the needle's middle in the grasp, su (facts, section 5.3)."""

HELD_JAW = (0.08, 0.45)
"""Opening angle of jaws that hold the needle, radians: closed on nothing they are at 0, open at 0.7."""

LIFT_GAIN = 0.1
"""Share of the way to a distant goal that one step covers."""


class NeedlePickEnv(PSMEnv):
    """
    ## Description

    A needle lies on a padded tray. One Patient Side Manipulator has to turn its jaws across the needle, grasp it in the
    middle of its arc and bring that middle to a goal in the air. Lifting without holding on is no success: the needle
    itself has to be at the goal.

    ## Action Space

    `Box(-1, 1, (5,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | turn of the tool about the vertical | 30 degrees |
    | 4 | jaws: negative closes them, 0 and above opens them to 40 degrees | |

    Link 5 stays within x [2.48, 3.02], y [-0.27, 0.27], z [3.426, 3.856].

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | position of link 5 (x, y, z), su |
    | 3, 4, 5 | fixed-axis x-y-z Euler angles of link 5, radians |
    | 6 | opening angle of the jaws, radians |
    | 7, 8, 9 | centre of mass of the needle (x, y, z), su |
    | 10, 11, 12 | the same relative to link 5, su |
    | 13, 14, 15 | middle of the needle's arc (x, y, z), su |
    | 16, 17, 18 | its fixed-axis x-y-z Euler angles, radians |

    `achieved_goal` (3): middle of the needle's arc. `desired_goal` (3): where it has to be.

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
    * `render_mode`, `camera` ("closeup" or "overview"), `width`, `height`: see `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; facts, section 4.3.
    """

    task = "NeedlePick"
    task_description = "Pick up the needle and bring its middle to the goal."
    cameras = CAMERAS
    observation_names = (
        *robot_state_names("psm1"),
        *xyz("needle"),
        *xyz("needle_rel"),
        *xyz("middle"),
        *rpy("middle"),
    )
    goal_names = xyz("goal_middle")
    mounts = (Mount(start_position=(2.5, 0.25, 3.601)),)

    def __init__(self, randomize=True, **kwargs):
        self._randomize = randomize
        super().__init__(**kwargs)

    def _build_scene(self):
        super()._build_scene()
        self._needle = Needle(self.world)
        self.grasps[0].append(Grasp(self.world, self.arms[0], self._needle.body, self._is_lifted))

    def _pose_scene(self):
        super()._pose_scene()
        pinned = (2.75, 0.0, 0.1 * np.pi)
        self._needle.drop(*(self._needle.sample_pose(self.np_random) if self._randomize else pinned))

    def _sample_goal(self):
        self._rest_height = self._needle.middle()[0][2]
        scatter = self.np_random.normal(0.0, 0.05, 2) if self._randomize else np.zeros(2)
        return np.array([2.75, 0.0, 3.576]) + (*scatter, 0.0)

    def _is_lifted(self):
        return self._needle.middle()[0][2] > self._rest_height + ATTACH_HEIGHT

    def _observe(self):
        return self._robot_and_object(self._needle.centre(), self._needle.middle())

    def _achieved_goal(self):
        return self._needle.middle()[0]

    def _get_task_state(self):
        return super()._get_task_state() | {"rest_height": self._rest_height}

    def _set_task_state(self, state):
        super()._set_task_state(state)
        self._rest_height = state["rest_height"]

    @staticmethod
    def expert_target(observation):
        """Approach above the needle, descend, close, carry; each phase is recognised from the state.

        Jaws that closed on nothing open again.
        """
        state = observation["observation"]
        position, yaw, jaw, middle, needle_yaw = state[:3], state[5], state[6], state[13:16], state[18]
        to_grasp = middle + (0.0, 0.0, GRASP_HEIGHT) - position
        lateral = np.hypot(to_grasp[0], to_grasp[1])
        if HELD_JAW[0] < jaw < HELD_JAW[1] and lateral < 0.02 and abs(to_grasp[2]) < 0.02:
            return Target(observation["desired_goal"] - middle, jaw=CLOSE, gain=LIFT_GAIN, speed=0.4)
        # The jaws are symmetric; of the two orientations across the needle the one with a yaw within 90 degrees of 0 is
        # taken, not the nearer one: it is always within reach of the roll joint, and the choice flips where no episode
        # starts. Where it flips, learners would find no action between the two.
        turn = nearest_yaw(needle_yaw, np.pi, middle=0.0) - nearest_yaw(yaw)
        return grasp(to_grasp, turn)
