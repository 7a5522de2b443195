"""BiPegTransfer: take the red block with one arm, hand it to the other and put it on another peg."""

from math import hypot

import numpy as np

from surrol_gym.envs.grasping import Grasp, exclude_each_other
from surrol_gym.envs.psm_env import Mount, PSMEnv, psm2, robot_state_names, rpy, xyz
from surrol_gym.experts import CLOSE, OPEN, Target
from surrol_gym.stage import OVERVIEW, Camera
from surrol_gym.tasks.peg_board import CARRIED, REST, Block, Hand, PegBoard, is_on_peg

PEG_TIP = 0.042
"""Height of a peg's tip above its frame, su."""

MEETING_POINT = np.array((2.7, 0.02))
"""Where the block changes hands; there both arms reach it."""


class BiPegTransferEnv(PSMEnv):
    """
    ## Description

    Six triangular blocks sit on the source pegs of a board. Only the second Patient Side Manipulator reaches them, and
    only the first reaches the target pegs. The second has to grasp the red block at a wall, lift it off its peg and
    hand it over in the air; the first has to take it at another wall and lower it onto the marked peg. Beside the peg,
    on another peg or in the air above the peg is no success.

    ## Action Space

    `Box(-1, 1, (10,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of the first arm's link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | turn of its tool about the vertical | 20 degrees |
    | 4 | its jaws: negative closes them, 0 and above opens them to 40 degrees | |
    | 5-9 | the same of the second arm | |

    Link 5 stays within x [2.48, 3.02], z [3.481, 3.856], and y [-0.02, 0.27] for the first, [-0.27, 0.02] for the
    second arm. The red block is attached to link 5 as soon as both closed jaws of an arm touch it, and detached when
    one loses touch or the jaws open. It is attached to one arm only: the receiving arm holds it by friction until the
    step after the giving arm has opened.

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | position of the first arm's link 5 (x, y, z), su |
    | 3, 4, 5 | its fixed-axis x-y-z Euler angles, radians |
    | 6 | opening angle of its jaws, radians |
    | 7-13 | the same of the second arm |
    | 14, 15, 16 | centre of the red block (x, y, z), su |
    | 17, 18, 19 | the same relative to the first arm's link 5, su |
    | 20, 21, 22 | the same relative to the second arm's link 5, su |
    | 23, 24, 25 | middle of the block's wall at +60 degrees, for the first arm (x, y, z), su |
    | 26, 27, 28 | its fixed-axis x-y-z Euler angles, radians; the wall's x axis points into the hole |
    | 29, 30, 31 | middle of the block's wall at -60 degrees, for the second arm (x, y, z), su |
    | 32, 33, 34 | its fixed-axis x-y-z Euler angles, radians |

    `achieved_goal` (3): centre of the red block. `desired_goal` (3): frame of the target peg, half-way up.

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

    * v0: first version; facts, section 4.6.
    """

    task = "BiPegTransfer"
    task_description = "Hand the red block from the second arm to the first and put it on the marked peg."
    cameras = {
        "closeup": Camera(eye=(3.55, 0.0, 4.35), target=(2.73, 0.0, 3.55), field_of_view=42.0),
        "overview": OVERVIEW,
        "both_arms": Camera(eye=(5.2, 0.0, 5.3), target=(2.5, 0.0, 3.75)),
    }
    observation_names = (
        *robot_state_names("psm1"),
        *robot_state_names("psm2"),
        *xyz("block"),
        *xyz("block_rel1"),
        *xyz("block_rel2"),
        *xyz("wall1"),
        *rpy("wall1"),
        *xyz("wall2"),
        *rpy("wall2"),
    )
    goal_names = xyz("goal_block")
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

    def _build_scene(self):
        super()._build_scene()
        self._board = PegBoard(self.world, "peg_board_short.urdf", height=3.435, blocks=6)
        for arm, grasps in zip(self.arms, self.grasps, strict=True):
            grasps.append(Grasp(self.world, arm, self._board.body, max_force=30.0, needs_both_jaws=True))
        exclude_each_other(self._all_grasps())

    def _pose_scene(self):
        super()._pose_scene()
        self._board.place_blocks(self.np_random)

    def _sample_goal(self):
        return self._board.sample_goal(self.np_random)

    def _observe(self):
        return self._robot_and_object(self._board.centre(), self._board.wall(0), self._board.wall(1))

    def _achieved_goal(self):
        return self._board.centre()

    def is_success(self, achieved_goal, desired_goal):
        """Tests whether blocks are on their pegs; returns booleans of shape (...)."""
        return is_on_peg(achieved_goal, desired_goal)

    @staticmethod
    def expert_target(observation):
        """The second arm grasps its wall and brings the block to the meeting point, the first takes over and places it.

        Whichever arm reaches a block that was dropped picks it up. One that fell over is stood up by the first arm, at
        the goal's peg; the second lays it down where the first reaches it.
        """
        state, goal = observation["observation"], observation["desired_goal"]
        rest = goal - (0.0, 0.0, REST)
        block = Block(observation["achieved_goal"], state[26:29], ground=rest[2], tip=goal[2] + PEG_TIP)
        limits1, limits2 = (mount.limits() for mount in BiPegTransferEnv.mounts)
        hand2 = Hand(state[7:14], block, limits2, walls=(1, 0, 2))
        hand1 = Hand(state[:7], block, limits1, walls=(0, 1, 2), avoid=state[7:10] if hand2.holds else None)
        meeting = np.array((*MEETING_POINT, block.tip + CARRIED))
        if hand2.holds:  # at a wall that may keep it from bringing the block all the way
            meeting[1] = min(meeting[1], block.centre[1] + limits2[1][1] - 0.005 - state[8])
        still = np.zeros(3)
        # Out of the way: up, then towards the own side.
        park2 = Target(_park(state[7:10], -0.12, block.ground), jaw=OPEN)
        if is_on_peg(block.centre, goal) and not (hand1.holds and block.centre[2] > goal[2]):
            return hand1.retreat(), park2
        if hand1.holds and hand2.holds:
            return Target(still, jaw=CLOSE), Target(still, jaw=OPEN)
        if hand1.holds:
            if hypot(*hand2.offset) < 0.06:
                return Target(still, jaw=CLOSE), hand2.retreat()
            return (hand1.carry(rest) if block.stands else hand1.lay_across(goal[:2])), park2
        if hand2.holds:
            if not block.stands:
                return Target(_park(state[:3], 0.15, block.ground), jaw=OPEN), hand2.lay_down(MEETING_POINT)
            return hand1.grasp(_beyond(meeting - block.centre)), hand2.carry(meeting)
        if hand1.reaches and block.centre[1] > 0.0:
            return hand1.grasp(), park2
        return hand1.grasp(meeting - block.centre), hand2.grasp()


def _park(position, y, ground):
    aside = y - position[1] if (y - position[1]) * y > 0 else 0.0
    rise = max(ground + 0.23 - position[2], 0.0)
    return np.array((0.0, aside if rise < 0.05 else 0.0, rise))


def _beyond(offset):
    """An offset, or zero when it is small: a held block need not be followed any more."""
    return offset if np.abs(offset).max() > 0.004 else np.zeros(3)
