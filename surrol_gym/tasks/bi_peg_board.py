"""BiPegBoard: take a ring off its peg, hand it from arm to arm and put it over an upright peg."""

import numpy as np

from surrol_gym.envs.grasping import Grasp, exclude_each_other
from surrol_gym.envs.psm_env import PITCH, Mount, PSMEnv, robot_state_names, rpy, xyz
from surrol_gym.stage import Camera
from surrol_gym.tasks.ring_board import (
    BOARD_POSITION,
    GOAL,
    HANGING_X,
    HANGING_Y,
    HANGING_Z,
    POINT_1,
    POINT_2,
    PSM1_ROLL,
    Scene,
)

ATTACH_HEIGHT = 0.05
"""Height above the goal over which a grasp attaches the ring, su (facts, section 2.1)."""


class BiPegBoardEnv(PSMEnv):
    """
    ## Description

    Three rings hang on the pegs of an upright board; one of them is red. PSM2, whose jaws point down, has to take the
    red ring off its peg and hand it over to PSM1, whose jaws point sideways and roll about their own direction. PSM1
    has to lay the ring flat, put it over the right one of two upright pegs and lower it onto the floor plate. A ring
    beside the peg, above it or over the other one is no success.

    ## Action Space

    `Box(-1, 1, (10,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of PSM1's link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | change of PSM1's pitch, which stays within [-90, 90] degrees | 15 degrees |
    | 4 | PSM1's jaws: negative closes them, 0 and above opens them to 40 degrees | |
    | 5, 6, 7 | motion of PSM2's link 5 along world x, y, z | 0.05 su (10 mm) |
    | 8 | turn of PSM2's tool about the vertical | 30 degrees |
    | 9 | PSM2's jaws, as PSM1's | |

    Link 5 of PSM1 stays within x [2.33, 3.32], y [-0.02, 0.52], z [3.081, 4.056], that of PSM2 within the same x and z
    and y [-0.77, 0.02].

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | position of PSM1's link 5 (x, y, z), su |
    | 3, 4, 5 | fixed-axis x-y-z Euler angles of PSM1's link 5, radians |
    | 6 | opening angle of PSM1's jaws, radians |
    | 7, 8, 9 | position of PSM2's link 5 (x, y, z), su |
    | 10, 11, 12 | fixed-axis x-y-z Euler angles of PSM2's link 5, radians |
    | 13 | opening angle of PSM2's jaws, radians |
    | 14, 15, 16 | centre of the red ring (x, y, z), su |
    | 17, 18, 19 | the same relative to PSM1's link 5, su |
    | 20, 21, 22 | the same relative to PSM2's link 5, su |
    | 23, 24, 25 | point 1, where PSM1's link 5 is when it takes a hanging ring (x, y, z), su; fixed to the ring |
    | 26, 27, 28 | its fixed-axis x-y-z Euler angles, radians |
    | 29, 30, 31 | point 2, the same for PSM2 (x, y, z), su |
    | 32, 33, 34 | its fixed-axis x-y-z Euler angles, radians |

    The ring's axis is the x axis of both points' frames, so a ring that lies flat is in gimbal lock.
    `achieved_goal` (3): centre of the red ring. `desired_goal` (3): where it is when it lies around the peg.

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

    * `render_mode`, `camera` ("closeup", "both_arms" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; facts, sections 1.7, 2, 3 and 4.7.
    """

    task = "BiPegBoard"
    task_description = "Take the red ring off its peg, hand it over and put it over the upright peg on the right."
    cameras = {
        "closeup": Camera(eye=(3.75, 0.15, 4.3), target=(2.55, 0.0, 3.7), field_of_view=45.0),
        "both_arms": Camera(eye=(4.6, 0.0, 4.8), target=(2.3, 0.0, 3.95), field_of_view=42.0),
        "overview": Camera(eye=(7.588, 0.0, 6.4), target=(-0.25, 0.0, 1.875)),
    }
    observation_names = (
        *robot_state_names("psm1"),
        *robot_state_names("psm2"),
        *xyz("ring"),
        *xyz("ring_rel_psm1"),
        *xyz("ring_rel_psm2"),
        *xyz("point1"),
        *rpy("point1"),
        *xyz("point2"),
        *rpy("point2"),
    )
    goal_names = xyz("goal_ring")
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

    def _build_scene(self):
        super()._build_scene()
        self._ring = self.world.load("ring_red.urdf", fixed=False)
        self._others = [self.world.load("ring.urdf", fixed=False) for _ in range(2)]
        self.world.load("ring_board.urdf", BOARD_POSITION)
        for arm, grasps in zip(self.arms, self.grasps, strict=True):
            grasps.append(Grasp(self.world, arm, self._ring, self._is_high, max_force=30.0, needs_both_jaws=True))
        exclude_each_other(self._all_grasps())

    def _pose_scene(self):
        super()._pose_scene()
        pegs = self.np_random.permutation(HANGING_Y[:3])
        for ring, y in zip((self._ring, *self._others), pegs, strict=True):
            self.world.place(ring, (HANGING_X, y, HANGING_Z[0]))

    def _sample_goal(self):
        return GOAL

    def _is_high(self):
        return self.world.pose(self._ring)[0][2] > GOAL[2] + ATTACH_HEIGHT

    def _observe(self):
        return self._robot_and_object(
            self._achieved_goal(), self.world.frame(self._ring, POINT_1), self.world.frame(self._ring, POINT_2)
        )

    def _achieved_goal(self):
        return self.world.pose(self._ring)[0]

    @staticmethod
    def expert_target(observation):
        """PSM2 fetches the ring, PSM1 takes it over and puts it over the peg; each phase is recognised from the state.

        A ring that was dropped lies flat on the plate. PSM2 picks it up where it can; elsewhere PSM1 puts its closed
        jaws into the hole and draws the ring to where PSM2 can.
        """
        scene = Scene(observation["observation"].astype(np.float64))
        if scene.held1:
            return scene.put_down(), scene.let_go()
        if scene.held2:
            return scene.take_over(), scene.bring()
        if scene.is_around_peg():
            return scene.back_off(), scene.step_aside()
        if scene.is_for_psm2():
            return scene.wait(), scene.fetch()
        return scene.draw_nearer() if scene.flat or scene.leans() else scene.take(), scene.step_aside()
