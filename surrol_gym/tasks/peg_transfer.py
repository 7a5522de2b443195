"""PegTransfer: move the red block to another peg."""

import numpy as np

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state_names, rpy, xyz
from surrol_gym.stage import OVERVIEW, Camera
from surrol_gym.tasks.peg_board import REST, Block, Hand, PegBoard, is_on_peg

PEG_TIP = 0.07
"""Height of a peg's tip above its frame, su."""


class PegTransferEnv(PSMEnv):
    """
    ## Description

    Four triangular blocks sit on the pegs of a board. One Patient Side Manipulator has to grasp the red one at a wall,
    lift it off its peg and lower it onto another. Beside the peg, on another peg or in the air above the peg is no
    success.

    ## Action Space

    `Box(-1, 1, (5,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | turn of the tool about the vertical | 20 degrees |
    | 4 | jaws: negative closes them, 0 and above opens them to 40 degrees | |

    Link 5 stays within x [2.48, 3.02], y [-0.27, 0.27], z [3.426, 3.856]. The red block is attached to link 5 as soon
    as both closed jaws touch it, and detached when one loses touch or the jaws open.

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | position of link 5 (x, y, z), su |
    | 3, 4, 5 | fixed-axis x-y-z Euler angles of link 5, radians |
    | 6 | opening angle of the jaws, radians |
    | 7, 8, 9 | centre of the red block (x, y, z), su |
    | 10, 11, 12 | the same relative to link 5, su |
    | 13, 14, 15 | middle of the block's wall at +60 degrees (x, y, z), su |
    | 16, 17, 18 | its fixed-axis x-y-z Euler angles, radians; the wall's x axis points into the hole |

    `achieved_goal` (3): centre of the red block. `desired_goal` (3): frame of the target peg, half-way up.

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

    * v0: first version; facts, section 4.4.
    """

    task = "PegTransfer"
    task_description = "Transfer the red block to the marked peg."
    cameras = {
        "closeup": Camera(eye=(3.55, 0.0, 4.35), target=(2.73, 0.0, 3.55), field_of_view=42.0),
        "overview": OVERVIEW,
    }
    observation_names = (
        *robot_state_names("psm1"),
        *xyz("block"),
        *xyz("block_rel"),
        *xyz("wall"),
        *rpy("wall"),
    )
    goal_names = xyz("goal_block")
    mounts = (Mount(start_position=(2.5, 0.25, 3.776), turn_step=np.deg2rad(20)),)

    def _build_scene(self):
        super()._build_scene()
        self._board = PegBoard(self.world, "peg_board_tall.urdf", height=3.4305, blocks=4)
        self.grasps[0].append(Grasp(self.world, self.arms[0], self._board.body, max_force=30.0, needs_both_jaws=True))

    def _pose_scene(self):
        super()._pose_scene()
        self._board.place_blocks(self.np_random)

    def _sample_goal(self):
        return self._board.sample_goal(self.np_random)

    def _observe(self):
        return self._robot_and_object(self._board.centre(), self._board.wall(0))

    def _achieved_goal(self):
        return self._board.centre()

    def is_success(self, achieved_goal, desired_goal):
        """Tests whether blocks are on their pegs; returns booleans of shape (...)."""
        return is_on_peg(achieved_goal, desired_goal)

    @staticmethod
    def expert_target(observation):
        """Grasp a wall, lift, carry, lower, let go, retreat; a block that fell over is stood up at the goal's peg."""
        state, goal = observation["observation"], observation["desired_goal"]
        rest = goal - (0.0, 0.0, REST)
        block = Block(observation["achieved_goal"], state[16:19], ground=rest[2], tip=goal[2] + PEG_TIP)
        hand = Hand(state[:7], block, PegTransferEnv.mounts[0].limits())
        # Once the peg is in the hole the block falls the rest of the way; a tilted one might jam if it were lowered.
        if block.is_threaded(goal) or (is_on_peg(block.centre, goal) and not hand.holds):
            return hand.retreat()
        if not hand.holds:
            return hand.grasp()
        return hand.carry(rest) if block.stands else hand.lay_across(goal[:2])
