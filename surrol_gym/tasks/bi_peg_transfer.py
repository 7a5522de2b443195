"""BiPegTransfer: take the red block with one arm, hand it to the other and put it on another peg."""

import numpy as np

from surrol_gym.envs.grasping import Grasp, exclude_each_other
from surrol_gym.envs.psm_env import Mount, PSMEnv, psm2, robot_state
from surrol_gym.quantities import euler, point
from surrol_gym.stage import OVERVIEW, Camera
from surrol_gym.tasks.peg_board import CLOSEUP, PegBoard, is_on_peg


class BiPegTransferEnv(PSMEnv):
    """
    ## Description

    Six triangular blocks sit on the source pegs of a board. Only the second Patient Side Manipulator reaches them, and
    only the first reaches the target pegs. The second has to grasp the red block at a wall, lift it off its peg and
    hand it over in the air; the first has to take it at another wall and lower it onto the marked peg. Beside the peg,
    on another peg or in the air above the peg is no success.

    ## Action Space

    {actions}

    The red block is attached to link 5 as soon as both closed jaws of an arm touch it, and detached when one loses
    touch or the jaws open. It is attached to one arm only: the receiving arm holds it by friction until the step after
    the giving arm has opened.

    ## Observation Space

    {observation}

    ## Rewards

    0 where the block is within 0.025 su (5 mm) across and 0.02 su up or down of the goal, -1 elsewhere. There the peg
    is in its hole; at rest it is 0.0175 su below the goal. `info["is_success"]` says the same.

    ## Starting State

    Links 5 at (2.5, +-0.25, 3.776), tools down, jaws closed. Blocks on all six source pegs (y < 0), the red one on any
    of them, each turned by a uniform angle in [-30, 30] degrees. The goal is one of the six target pegs (y > 0).

    ## Episode End

    Truncated after 100 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup", "overview" or "both_arms"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; docs/scenes.md#bi-peg-transfer.
    """

    task_description = "Hand the red block from the second arm to the first and put it on the marked peg."
    cameras = {
        "closeup": CLOSEUP,
        "overview": OVERVIEW,
        "both_arms": Camera(eye=(5.2, 0.0, 5.3), target=(2.5, 0.0, 3.75)),
    }
    observation_quantities = (
        *robot_state(arms=2),
        point("block", "centre of the red block"),
        point("block_rel1", "the same relative to link 5 of PSM1", derived_from=("block", "psm1")),
        point("block_rel2", "the same relative to link 5 of PSM2", derived_from=("block", "psm2")),
        point("wall1", "middle of the block's wall at +60 degrees, for PSM1"),
        euler("wall1", "its fixed-axis x-y-z Euler angles; the wall's x axis points into the hole"),
        point("wall2", "middle of the block's wall at -60 degrees, for PSM2"),
        euler("wall2", "its fixed-axis x-y-z Euler angles"),
    )
    goal_quantities = (point("block", "centre of the red block", "frame of the target peg, half-way up"),)
    mounts = (
        Mount(
            start_position=(2.5, 0.25, 3.776),
            turn_step=np.deg2rad(20),
            workspace=((0.50, 0.60), (0.0, 0.05), (0.686, 0.745)),
        ),
        psm2(
            start_position=(2.5, -0.25, 3.776),
            turn_step=np.deg2rad(20),
            workspace=((0.50, 0.60), (-0.05, 0.0), (0.686, 0.745)),
        ),
    )

    def _build_scene(self) -> None:
        super()._build_scene()
        self._board = PegBoard(self.world, "peg_board_short.urdf", height=3.435, blocks=6)
        for arm, grasps in zip(self.arms, self.grasps, strict=True):
            grasps.append(Grasp(self.world, arm, self._board.body, max_force=30.0, needs_both_jaws=True))
        exclude_each_other(self._all_grasps())

    def _pose_scene(self) -> None:
        super()._pose_scene()
        self._board.place_blocks(self.np_random)

    def _sample_goal(self) -> np.ndarray:
        return self._board.sample_goal(self.np_random)

    def _observe(self) -> np.ndarray:
        return self._robot_and_object(self._board.centre(), self._board.wall(0), self._board.wall(1))

    def _achieved_goal(self) -> np.ndarray:
        return self._board.centre()

    def is_success(self, achieved_goal: np.ndarray, desired_goal: np.ndarray) -> np.ndarray:
        """Tests whether blocks are on their pegs; returns booleans of shape (...)."""
        return is_on_peg(achieved_goal, desired_goal)
