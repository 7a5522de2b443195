"""PegTransfer: move the red block to another peg."""

import numpy as np

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state
from surrol_gym.quantities import euler, point
from surrol_gym.stage import OVERVIEW
from surrol_gym.tasks.peg_board import CLOSEUP, PegBoard, is_on_peg


class PegTransferEnv(PSMEnv):
    """
    ## Description

    Four triangular blocks sit on the pegs of a board. One Patient Side Manipulator has to grasp the red one at a wall,
    lift it off its peg and lower it onto another. Beside the peg, on another peg or in the air above the peg is no
    success.

    ## Action Space

    {actions}

    The red block is attached to link 5 as soon as both closed jaws touch it, and detached when one loses touch or the
    jaws open.

    ## Observation Space

    {observation}

    ## Rewards

    0 where the block is within 0.025 su (5 mm) across and 0.02 su up or down of the goal, -1 elsewhere. There the peg
    is in its hole; at rest it is 0.0175 su below the goal. `info["is_success"]` says the same.

    ## Starting State

    Link 5 at (2.5, 0.25, 3.776), tool down, jaws closed. Blocks on four of the six source pegs (y < 0), drawn without
    replacement, the red one on any of them, each turned by a uniform angle in [-30, 30] degrees. The goal is one of the
    six target pegs (y > 0).

    ## Episode End

    Truncated after 50 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; docs/scenes.md#peg-transfer.
    """

    task_description = "Transfer the red block to the marked peg."
    cameras = {"closeup": CLOSEUP, "overview": OVERVIEW}
    observation_quantities = (
        *robot_state(),
        point("block", "centre of the red block"),
        point("block_rel", "the same relative to link 5", derived_from=("block", "psm1")),
        point("wall", "middle of the block's wall at +60 degrees"),
        euler("wall", "its fixed-axis x-y-z Euler angles; the wall's x axis points into the hole"),
    )
    goal_quantities = (point("block", "centre of the red block", "frame of the target peg, half-way up"),)
    mounts = (Mount(start_position=(2.5, 0.25, 3.776), turn_step=np.deg2rad(20)),)

    def _build_scene(self) -> None:
        super()._build_scene()
        self._board = PegBoard(self.world, "peg_board_tall.urdf", height=3.4305, blocks=4)
        self.grasps[0].append(Grasp(self.world, self.arms[0], self._board.body, max_force=30.0, needs_both_jaws=True))

    def _pose_scene(self) -> None:
        super()._pose_scene()
        self._board.place_blocks(self.np_random)

    def _sample_goal(self) -> np.ndarray:
        return self._board.sample_goal(self.np_random)

    def _observe(self) -> np.ndarray:
        return self._robot_and_object(self._board.centre(), self._board.wall(0))

    def _achieved_goal(self) -> np.ndarray:
        return self._board.centre()

    def is_success(self, achieved_goal: np.ndarray, desired_goal: np.ndarray) -> np.ndarray:
        """Tests whether blocks are on their pegs; returns booleans of shape (...)."""
        return is_on_peg(achieved_goal, desired_goal)
