"""GauzeRetrieve: pick up a piece of gauze and bring it to a goal in the air."""

import numpy as np

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state_names, rpy, xyz
from surrol_gym.experts import Target, grasp
from surrol_gym.psm.arm import TIP_OFFSET
from surrol_gym.stage import OVERVIEW, Camera

TRAY_POSITION = (2.75, 0.0, 3.3798)
DROP_HEIGHT = 3.436
"""Height from which the gauze drops into the tray, su."""

GOAL_CENTRE, GOAL_SCATTER = np.array([2.75, 0.0, 3.626]), 0.1

REST_HEIGHT = 3.3891
"""Height of the centre of the gauze in the tray, su (facts, section 9)."""

ATTACH_HEIGHT = 0.0125
"""Lift of the gauze at which a grasp attaches it, su (facts, section 2.1)."""

GRASP_HEIGHT = TIP_OFFSET - 0.005
"""Height of link 5 above the centre of the gauze in the grasp, su: the tips are 2.5e-3 above the tray."""

HELD_JAW = (0.12, 0.62)
"""Opening angle of jaws that hold the gauze, radians: closed on nothing they are at 0, open at 0.7."""


class GauzeRetrieveEnv(PSMEnv):
    """
    ## Description

    A folded piece of gauze lies in a tray. One Patient Side Manipulator, its tool pointing straight down, has to grasp
    it in the middle and bring it to a goal in the air. Only a small box in the middle of the gauze is felt, as if the
    rest gave way.

    ## Action Space

    `Box(-1, 1, (5,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | turn of the tool | none in this task |
    | 4 | jaws: negative closes them, 0 and above opens them to 40 degrees | |

    Link 5 stays within x [2.48, 3.02], y [-0.27, 0.27], z [3.426, 3.856].

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | position of link 5 (x, y, z), su |
    | 3, 4, 5 | fixed-axis x-y-z Euler angles of link 5, radians |
    | 6 | opening angle of the jaws, radians |
    | 7, 8, 9 | centre of the gauze (x, y, z), su |
    | 10, 11, 12 | the same relative to link 5, su |
    | 13, 14, 15 | where to grasp the gauze: its centre again (x, y, z), su |
    | 16, 17, 18 | its fixed-axis x-y-z Euler angles, radians |

    `achieved_goal` (3): centre of the gauze. `desired_goal` (3): where it has to be.

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

    `render_mode`, `camera` ("closeup" or "overview"), `width`, `height`: see `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; facts, section 4.2.
    """

    task = "GauzeRetrieve"
    task_description = "Pick up the gauze and bring it to the goal."
    cameras = {
        "closeup": Camera(eye=(3.75, 0.0, 4.35), target=(2.74, 0.0, 3.53), field_of_view=40.0),
        "overview": OVERVIEW,
    }
    observation_names = (
        *robot_state_names("psm1"),
        *xyz("gauze"),
        *xyz("gauze_rel"),
        *xyz("grasp_point"),
        *rpy("grasp_point"),
    )
    solver_iterations = 20  # a step takes a third less time than with 50, and episodes end the same
    goal_names = xyz("goal_gauze")
    mounts = (Mount(start_position=(2.5, 0.25, 3.601), turn_step=0.0),)

    def _build_scene(self):
        super()._build_scene()
        self.world.load("tray.urdf", TRAY_POSITION)
        self._gauze = self.world.load("gauze.urdf", (*TRAY_POSITION[:2], DROP_HEIGHT), fixed=False)
        self.grasps[0].append(Grasp(self.world, self.arms[0], self._gauze, self._is_lifted))

    def _pose_scene(self):
        super()._pose_scene()
        x, y = TRAY_POSITION[:2] + self.np_random.uniform(-0.05, 0.05, 2)
        self.world.place(self._gauze, (x, y, DROP_HEIGHT))

    def _sample_goal(self):
        self._rest_height = self._achieved_goal()[2]
        low, high = self.mounts[0].limits()
        while True:
            goal = GOAL_CENTRE + (*self.np_random.normal(0.0, GOAL_SCATTER, 2), 0.0)
            if np.all((low < goal) & (goal < high)):
                return goal

    def _is_lifted(self):
        return self._achieved_goal()[2] > self._rest_height + ATTACH_HEIGHT

    def _observe(self):
        grasp_point = self.world.frame(self._gauze, (0, 0, 0))
        return self._robot_and_object(grasp_point[0], grasp_point)

    def _achieved_goal(self):
        return self.world.pose(self._gauze)[0]

    def _get_task_state(self):
        return super()._get_task_state() | {"rest_height": self._rest_height}

    def _set_task_state(self, state):
        super()._set_task_state(state)
        self._rest_height = state["rest_height"]

    @staticmethod
    def expert_target(observation):
        """Approach above the gauze, descend, close, lift, carry; each phase is recognised from the state.

        Jaws that closed on nothing open again.
        """
        state = observation["observation"]
        position, jaw, gauze = state[:3], state[6], state[7:10]
        to_grasp = gauze + (0.0, 0.0, GRASP_HEIGHT) - position
        if not (HELD_JAW[0] < jaw < HELD_JAW[1] and np.abs(to_grasp).max() < 0.02):
            return grasp(to_grasp, gain=0.25)
        to_goal = observation["desired_goal"] - gauze
        if gauze[2] < REST_HEIGHT + ATTACH_HEIGHT + 0.001:
            # Friction alone holds the gauze; moved aside or fast, it would turn or slip.
            return Target(to_goal * (0.0, 0.0, 1.0), gain=0.25, speed=0.4)
        return Target(to_goal, gain=0.25, speed=0.5)
