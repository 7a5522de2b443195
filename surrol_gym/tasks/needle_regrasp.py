"""NeedleRegrasp: hand the needle from one arm to the other and bring it to a goal in the air."""

import numpy as np
import pybullet

from surrol_gym.envs.grasping import Grasp, exclude_each_other
from surrol_gym.envs.psm_env import PITCH, Mount, PSMEnv, psm2, robot_state
from surrol_gym.psm.arm import JAW_CLOSED, TIP_OFFSET
from surrol_gym.quantities import euler, point
from surrol_gym.stage import OVERVIEW, Camera
from surrol_gym.tasks.needle import Needle

GOAL_CENTRE, GOAL_SCATTER = np.array([2.875, -0.225, 3.651]), 0.025

DEPTH = TIP_OFFSET - 0.0075
"""Distance along the tool from link 5 to the needle between the jaws, su (docs/scenes.md#needle-regrasp)."""

CLOSED_ON_NEEDLE = 0.19
"""Opening angle at which the jaws touch the needle there, radians."""

_PITCHING = {"turns": PITCH, "turn_step": np.deg2rad(15), "start_euler": (0.0, -np.pi / 2, -np.pi / 2)}


class NeedleRegraspEnv(PSMEnv):
    """
    ## Description

    PSM1 holds a needle in the air, near its right end. PSM2 has to grasp it near its left end, PSM1 has to let go, and
    PSM2 has to bring its end to a goal. Both tools lie along the world's x axis and turn about themselves. No table is
    within reach: a needle that is dropped is lost.

    An object is fixed to one arm at a time. PSM2 takes the needle over in the step in which PSM1 opens; during that
    step only the friction of its jaws holds it.

    ## Action Space

    {actions}

    ## Observation Space

    {observation}

    At a pitch of -90 degrees, where PSM2 starts, roll and yaw are ambiguous and jump between steps.

    ## Rewards

    0 where the left grasp point is within 0.025 su (5 mm) of the goal, -1 elsewhere. `info["is_success"]` says the
    same.

    ## Starting State

    PSM1 holds the needle, which is fixed to it: centre of mass uniform in [2.833, 2.917] x [0.167, 0.283] x
    [3.609, 3.693], needle upright across x and tilted by a uniform angle in [-15, 15] degrees, jaws across the right
    grasp point, which is 7.5e-3 su behind their tips. Link 5 of PSM2 at (2.875, -0.225, 3.651), pitch -90 degrees, jaws
    closed. Goal normal around (2.875, -0.225, 3.651), standard deviation 0.025 su along each axis.

    ## Episode End

    Truncated after 50 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup", "both_arms" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; docs/scenes.md#needle-regrasp, without the scripted grasp at reset.
    """

    task_description = "Hand the needle from the first arm to the second and bring its held end to the goal."
    cameras = {
        "closeup": Camera(eye=(3.75, 0.0, 4.05), target=(2.85, 0.0, 3.66), field_of_view=40.0),
        "both_arms": Camera(eye=(5.3, 0.0, 4.8), target=(2.3, 0.0, 4.0), field_of_view=40.0),
        "overview": OVERVIEW,
    }
    observation_quantities = (
        *robot_state(arms=2),
        point("needle", "centre of mass of the needle"),
        point("needle_rel1", "the same relative to link 5 of PSM1", derived_from=("needle", "psm1")),
        point("needle_rel2", "the same relative to link 5 of PSM2", derived_from=("needle", "psm2")),
        point("left", "left grasp point, 60 degrees from the middle of the arc, for PSM2"),
        euler("left", "its fixed-axis x-y-z Euler angles"),
        point("right", "right grasp point, 60 degrees to the other side, held by PSM1 at first"),
        euler("right", "its fixed-axis x-y-z Euler angles"),
    )
    solver_iterations = 20  # a step takes a third less time than with 50, and episodes end the same
    goal_quantities = (point("left", "left grasp point", "where it has to be"),)
    mounts = (
        Mount(
            start_position=(2.875, 0.225, 3.651),
            euler=(0.0, 0.0, -np.pi / 2),
            workspace=((0.55, 0.60), (0.01, 0.08), (0.695, 0.745)),
            **_PITCHING,
        ),
        psm2(
            start_position=(2.875, -0.225, 3.651),
            euler=(-np.pi, 0.0, np.pi / 2),
            workspace=((0.55, 0.60), (-0.08, -0.01), (0.695, 0.745)),
            **_PITCHING,
        ),
    )

    def _build_scene(self) -> None:
        super()._build_scene()
        self._needle = Needle(self.world, tray=False)
        for arm, grasps in zip(self.arms, self.grasps, strict=True):
            grasps.append(Grasp(self.world, arm, self._needle.body))
        exclude_each_other(self._all_grasps())

    def _pose_scene(self) -> None:
        super()._pose_scene()
        centre = self.np_random.uniform((2.8333, 0.1667, 3.6093), (2.9167, 0.2833, 3.6927))
        tilt = self.np_random.uniform(-np.pi / 12, np.pi / 12)
        orientation = pybullet.getQuaternionFromEuler((-np.pi / 2, tilt - np.pi / 2, np.pi / 2))
        self.world.place(self._needle.body, centre, orientation)
        position, euler = self._needle.right()
        self.arms[0].reset(position - (DEPTH, 0.0, 0.0), (0.0, euler[1], -np.pi / 2), CLOSED_ON_NEEDLE)
        self.grasps[0][0].attach()
        self.arms[0].command_jaws(JAW_CLOSED)

    def _sample_goal(self) -> np.ndarray:
        return GOAL_CENTRE + self.np_random.normal(0.0, GOAL_SCATTER, 3)

    def _observe(self) -> np.ndarray:
        return self._robot_and_object(self._needle.centre(), self._needle.left(), self._needle.right())

    def _achieved_goal(self) -> np.ndarray:
        return self._needle.left()[0]
