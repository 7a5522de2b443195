"""An eleventh task in one file: push the block to the goal.

    PYTHONPATH=examples gcdt record --task new_task:PushBlock --episodes 100 --root datasets/push_block

Wherever a task is named, ``module:Task`` finds one of your own, as in Gymnasium: importing the module registers it.
"""

from math import hypot, sumprod

import numpy as np
import pybullet

import surrol_gym
from surrol_gym.envs.goal_env import Reading
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state
from surrol_gym.experts import Target
from surrol_gym.psm.arm import TIP_OFFSET
from surrol_gym.quantities import point
from surrol_gym.stage import OVERVIEW, Camera

REST_HEIGHT = 3.4166
"""Of the block's centre on the table; lengths are su."""


class PushBlockEnv(PSMEnv):
    """
    ## Description

    A block stands on the table. One Patient Side Manipulator, its jaws closed, has to push it to the goal.

    ## Action Space

    {actions}

    ## Observation Space

    {observation}

    ## Rewards

    0 where the block is within 0.025 su (5 mm) of the goal, -1 elsewhere. `info["is_success"]` says the same.

    ## Starting State

    Link 5 at (2.55, 0, 3.6), tool down. Block uniform in [2.65, 2.75] x [-0.1, 0.1], turned by any angle. Goal 0.1 su
    further along x and up to 0.05 su aside.
    """

    task_description = "Push the block to the goal."
    # Said once: names of recorded features, the tables above, cards and what `law` reads come from it.
    observation_quantities = (*robot_state(), point("block", "centre of the block"))
    goal_quantities = (point("block", "centre of the block", "where it has to be"),)
    mounts = (Mount(start_position=(2.55, 0.0, 3.6), turn_step=0.0),)
    has_gripper = False
    cameras = {"closeup": Camera(eye=(3.75, 0.0, 4.35), target=(2.74, 0.0, 3.5)), "overview": OVERVIEW}

    def _build_scene(self) -> None:
        super()._build_scene()
        self._block = self.world.load("block_red.urdf", fixed=False)

    def _pose_scene(self) -> None:
        super()._pose_scene()
        # All that is random comes from self.np_random, so that a seed gives the same episode everywhere.
        x, y, yaw = self.np_random.uniform((2.65, -0.1, -np.pi), (2.75, 0.1, np.pi))
        self.world.place(self._block, (x, y, REST_HEIGHT), pybullet.getQuaternionFromEuler((0.0, 0.0, yaw)))

    def _sample_goal(self) -> np.ndarray:
        return self._achieved_goal() + (0.1, self.np_random.uniform(-0.05, 0.05), 0.0)

    def _observe(self) -> np.ndarray:
        return np.concatenate([self._robot_state(), self._achieved_goal()])

    def _achieved_goal(self) -> np.ndarray:
        return self.world.pose(self._block)[0]


def law(seen: Reading) -> Target:
    """Goes behind the block, as seen from the goal, and pushes: what to do next follows from what is seen alone."""
    ahead = seen.goal_block - seen.block
    distance = hypot(ahead[0], ahead[1])
    if distance < 0.005:
        return Target(np.zeros(3))
    ahead = ahead / distance
    to_block = seen.block + (0.0, 0.0, TIP_OFFSET - 0.01) - seen.psm1
    along = sumprod(to_block, ahead)
    if along > 0 and np.abs(to_block - along * ahead).max() < 0.012:
        return Target(to_block + (distance - 0.03) * ahead, gain=0.3, speed=0.5)
    to_start = to_block - 0.06 * ahead
    if np.abs(to_start[:2]).max() > 0.012:  # over the block first: up, across, and then down behind it
        to_start[2] += 0.09
        to_start[:2] *= to_start[2] < 0.03
    return Target(to_start, gain=0.3, speed=0.8)


surrol_gym.register_task(PushBlockEnv, max_episode_steps=50, expert=law)
