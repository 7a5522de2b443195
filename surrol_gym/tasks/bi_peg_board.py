"""BiPegBoard: take a ring off its peg, hand it from arm to arm and put it over an upright peg."""

import numpy as np

from surrol_gym.envs.grasping import Grasp, exclude_each_other
from surrol_gym.envs.psm_env import PITCH, Mount, PSMEnv, robot_state
from surrol_gym.quantities import euler, point
from surrol_gym.stage import Camera

# The board (docs/scenes.md#bi-peg-board): six hanging pegs in each of two rows along x, two upright ones.
BOARD_POSITION = (2.75, 0.0, 3.4305)
HANGING_X, HANGING_TIP_X = 2.3985, 2.4566
HANGING_Y, HANGING_Z = np.array([-0.3237, -0.1943, -0.0648, 0.0648, 0.1943, 0.3237]), np.array([3.8005, 3.6155])
UPRIGHT_X, UPRIGHT_Y, UPRIGHT_TOP = 2.75, np.array([-0.185, 0.185]), 3.5626
GOAL = np.array([UPRIGHT_X, UPRIGHT_Y[1], 3.4545])

RING_RADIUS, HOLE_RADIUS = 0.0417, 0.0358
POINT_1, POINT_2 = np.array([0.0, 0.074, 0.0]), np.array([0.0, -0.0231, 0.0786])
"""Where the arms take a hanging ring: link 5 of PSM1 and of PSM2, in the ring's frame, whose x axis is the ring's."""

PSM1_ROLL = np.deg2rad(-15)

ATTACH_HEIGHT = 0.05
"""Height above the goal over which a grasp attaches the ring, su (docs/grasping.md#the-rule)."""


class BiPegBoardEnv(PSMEnv):
    """
    ## Description

    Three rings hang on the pegs of an upright board; one of them is red. PSM2, whose jaws point down, has to take the
    red ring off its peg and hand it over to PSM1, whose jaws point sideways and roll about their own direction. PSM1
    has to lay the ring flat, put it over the right one of two upright pegs and lower it onto the floor plate. A ring
    beside the peg, above it or over the other one is no success.

    ## Action Space

    {actions}

    ## Observation Space

    {observation}

    The ring's axis is the x axis of both points' frames, so a ring that lies flat is in gimbal lock.

    ## Rewards

    0 where the centre of the ring is within 0.025 su (5 mm) of the goal, -1 elsewhere. `info["is_success"]` says the
    same. No ring that the peg does not go through is so near.

    ## Starting State

    Link 5 of PSM1 at (2.365, 0.25, 3.976), its tool along -y, that of PSM2 at (2.365, -0.375, 3.976), its tool down;
    jaws closed. (In SurRoL both start at x = 2.35, 0.01 su inside the board, which pushes them out.) The rings hang
    at z = 3.780 on three pegs, y -0.3237, -0.1943 and -0.0648, in random order. The goal is always
    (2.75, 0.185, 3.4545).

    ## Episode End

    Truncated after 100 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup", "both_arms" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; docs/scenes.md#bi-peg-board.
    """

    task_description = "Take the red ring off its peg, hand it over and put it over the upright peg on the right."
    cameras = {
        "closeup": Camera(eye=(3.75, 0.15, 4.3), target=(2.55, 0.0, 3.7), field_of_view=45.0),
        "both_arms": Camera(eye=(4.6, 0.0, 4.8), target=(2.3, 0.0, 3.95), field_of_view=42.0),
        "overview": Camera(eye=(7.588, 0.0, 6.4), target=(-0.25, 0.0, 1.875)),
    }
    observation_quantities = (
        *robot_state(arms=2),
        point("ring", "centre of the red ring"),
        point("ring_rel_psm1", "the same relative to link 5 of PSM1", derived_from=("ring", "psm1")),
        point("ring_rel_psm2", "the same relative to link 5 of PSM2", derived_from=("ring", "psm2")),
        point("point1", "point 1, where link 5 of PSM1 is when it takes a hanging ring; fixed to the ring"),
        euler("point1", "its fixed-axis x-y-z Euler angles"),
        point("point2", "point 2, the same for PSM2"),
        euler("point2", "its fixed-axis x-y-z Euler angles"),
    )
    goal_quantities = (point("ring", "centre of the red ring", "where it is when it lies around the peg"),)
    mounts = (
        Mount(
            start_position=(2.365, 0.25, 3.976),
            start_euler=(0.0, 0.0, -np.pi),
            euler=(PSM1_ROLL, 0.0, -np.pi),
            turns=PITCH,
            turn_step=np.deg2rad(15),
            workspace=((0.47, 0.66), (0.0, 0.10), (0.606, 0.785)),
            base_position=(0.05, 0.25, 0.8224),
        ),
        Mount(
            start_position=(2.365, -0.375, 3.976),
            start_euler=(-np.pi / 2, 0.0, 0.0),
            euler=(-np.pi / 2, 0.0, 0.0),
            workspace=((0.47, 0.66), (-0.15, 0.0), (0.606, 0.785)),
            base_position=(0.05, -0.26, 0.8524),
            base_yaw=np.deg2rad(-70),
            look="psm2.urdf",
        ),
    )

    def _build_scene(self) -> None:
        super()._build_scene()
        self._ring = self.world.load("ring_red.urdf", fixed=False)
        self._others = [self.world.load("ring.urdf", fixed=False) for _ in range(2)]
        self.world.load("ring_board.urdf", BOARD_POSITION)
        for arm, grasps in zip(self.arms, self.grasps, strict=True):
            grasps.append(Grasp(self.world, arm, self._ring, self._is_high, max_force=30.0, needs_both_jaws=True))
        exclude_each_other(self._all_grasps())

    def _pose_scene(self) -> None:
        super()._pose_scene()
        pegs = self.np_random.permutation(HANGING_Y[:3])
        for ring, y in zip((self._ring, *self._others), pegs, strict=True):
            self.world.place(ring, (HANGING_X, y, HANGING_Z[0]))

    def _sample_goal(self) -> np.ndarray:
        return GOAL

    def _is_high(self) -> bool:
        return self.world.pose(self._ring)[0][2] > GOAL[2] + ATTACH_HEIGHT

    def _observe(self) -> np.ndarray:
        return self._robot_and_object(
            self._achieved_goal(), self.world.frame(self._ring, POINT_1), self.world.frame(self._ring, POINT_2)
        )

    def _achieved_goal(self) -> np.ndarray:
        return self.world.pose(self._ring)[0]
