"""PickAndPlace: put two jacks into the pots of their colours."""

from dataclasses import replace
from functools import partial
from math import cos

import numpy as np
import pybullet

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state_names, rpy, xyz
from surrol_gym.experts import CLOSE, OPEN, Target, grasp, nearest_yaw
from surrol_gym.stage import OVERVIEW, Camera

COLOURS = ("red", "green")
TRAY_POSITION = (2.75, 0.0, 3.3755)
POTS = np.array([(2.75, -0.125, 3.3905), (2.75, 0.15, 3.3905)])
DROP_HEIGHT = 3.436
"""Height from which the lying jacks drop, su."""

SPREAD, APART = 0.05, 0.1
"""Half side of the square over which the jacks are scattered, and their smallest distance in it, su."""

ATTACH_HEIGHT = 0.025
"""Lift of a jack's top at which a grasp attaches it, su (facts, section 2.1)."""

GRASP_HEIGHT = 0.0275
"""Height of link 5 above the top of a jack in the grasp, su (facts, section 5.9)."""

STANDING = -0.0065
"""Height of a jack's origin above the middle of the pot it stands in, su; its top is 0.05 higher."""

HELD_JAW = (0.15, 0.6)
"""Opening angle of jaws that hold a jack, radians: closed on nothing they are at 0, open at 0.7."""

HOVER = 0.07
"""Height above the grasp, or above standing in a pot, at which the tool travels, su."""

PLACED = 0.02
"""Largest offset of a jack that is left where it stands, along each axis, su."""

FOOT = 0.027
"""Distance of a jack's feet from its axis, su."""

RETREAT_HEIGHT = 3.6
"""Height to which link 5 rises when both jacks are in place, su."""

GAIN, SPEED = 0.22, 0.8
"""Share of the way to a distant target that one step covers, and the largest action along an axis."""

# The top of a jack, its z axis along the rod, in the jack's frame, where that rod is y.
_TOP = (0.0, 0.05, 0.0), pybullet.getQuaternionFromEuler((-np.pi / 2, 0.0, 0.0))


class PickAndPlaceEnv(PSMEnv):
    """
    ## Description

    Two jacks, a red and a green one, stand between two shallow pots. One Patient Side Manipulator has to grasp each by
    its upper ball and put it into the pot of its colour, in any order. Jacks in the wrong pots are no success, nor is
    a single one in its pot.

    ## Action Space

    `Box(-1, 1, (5,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | turn of the tool about the vertical | 30 degrees |
    | 4 | jaws: negative closes them, 0 and above opens them to 40 degrees | |

    Link 5 stays within x [2.48, 3.02], y [-0.27, 0.27], z [3.426, 3.856]. Closed jaws hold a jack by friction, and
    firmly once its top was lifted by 0.025 su.

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | position of link 5 (x, y, z), su |
    | 3, 4, 5 | fixed-axis x-y-z Euler angles of link 5, radians |
    | 6 | opening angle of the jaws, radians |
    | 7, 8, 9 | origin of the red jack, which is its centre of mass, below its feet (x, y, z), su |
    | 10, 11, 12 | origin of the green jack |
    | 13, 14, 15 | origin of the red jack relative to link 5 |
    | 16, 17, 18 | origin of the green jack relative to link 5 |
    | 19, 20, 21 | top of the red jack, 0.05 su from the origin along its upper rod |
    | 22, 23, 24 | top of the green jack |
    | 25, 26, 27 | fixed-axis x-y-z Euler angles of the red jack, radians |
    | 28, 29, 30 | fixed-axis x-y-z Euler angles of the green jack, radians |

    The z axis of these angles is the upper rod: a jack that stands has (0, 0, yaw). In SurRoL it is the y axis.

    `achieved_goal` (6): tops of the red and of the green jack. `desired_goal` (6): middles of the red and of the green
    pot.

    ## Rewards

    0 where each top is within 0.053 su (10.6 mm) of the middle of its pot, -1 elsewhere; the top of a jack that stands
    in the middle is 0.043 su above it. `info["is_success"]` says the same.

    ## Starting State

    Link 5 at (2.5, 0.25, 3.601), tool down, jaws closed. Each jack drops from a height of 3.436 su, lying, uniform in
    [2.70, 2.80] x [-0.05, 0.05] and at least 0.1 su from the other, turned by a uniform angle in [-90, 90] degrees; it
    rights itself, but some hang on the rim of the red pot and rock. Pots at (2.75, -0.125, 3.3905), red, and
    (2.75, 0.15, 3.3905), green.

    ## Episode End

    Truncated after 100 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; facts, sections 4.9 and 5.9.
    """

    task = "PickAndPlace"
    task_description = "Put the red jack into the red pot and the green jack into the green pot."
    cameras = {
        "closeup": Camera(eye=(3.45, 0.015, 4.25), target=(2.73, 0.015, 3.46), field_of_view=32.0),
        "overview": OVERVIEW,
    }
    observation_names = (
        *robot_state_names("psm1"),
        *xyz("red"),
        *xyz("green"),
        *xyz("red_rel"),
        *xyz("green_rel"),
        *xyz("red_top"),
        *xyz("green_top"),
        *rpy("red_top"),
        *rpy("green_top"),
    )
    goal_names = (*xyz("goal_red_top"), *xyz("goal_green_top"))
    mounts = (Mount(start_position=(2.5, 0.25, 3.601)),)
    goal_tolerance = 0.053
    """Distance of each jack's top from the middle of its pot that is success, su."""

    def _build_scene(self):
        super()._build_scene()
        for colour, position in zip(COLOURS, POTS, strict=True):
            self.world.load(f"pot_{colour}.urdf", position)
        self._jacks = [self.world.load(f"jack_{colour}.urdf", fixed=False) for colour in COLOURS]
        self.world.load("tray.urdf", TRAY_POSITION, drawn=False)
        # The tray stands a little deeper than the table (facts, section 4.0); a picture should show its floor.
        self.world.draw("tray.urdf", np.add(TRAY_POSITION, (0.0, 0.0, 0.003)))
        for index, jack in enumerate(self._jacks):
            self.grasps[0].append(Grasp(self.world, self.arms[0], jack, partial(self._is_lifted, index)))

    def _pose_scene(self):
        super()._pose_scene()
        offsets = np.zeros((2, 2))
        while np.hypot(*(offsets[1] - offsets[0])) < APART:
            offsets = self.np_random.uniform(-SPREAD, SPREAD, (2, 2))
        yaws = self.np_random.uniform(-np.pi / 2, np.pi / 2, 2)
        for jack, offset, yaw in zip(self._jacks, offsets, yaws, strict=True):
            position = (*np.add(TRAY_POSITION[:2], offset), DROP_HEIGHT)
            self.world.place(jack, position, pybullet.getQuaternionFromEuler((0.0, 0.0, yaw)))

    def _sample_goal(self):
        self._rest_heights = [self._top(index)[0][2] for index in range(2)]
        return POTS.ravel()

    def _is_lifted(self, index):
        return self._top(index)[0][2] > self._rest_heights[index] + ATTACH_HEIGHT

    def _top(self, index):
        return self.world.frame(self._jacks[index], *_TOP)

    def _observe(self):
        robot = self._robot_state()
        origins = [self.world.pose(jack)[0] for jack in self._jacks]
        positions, eulers = zip(*(self._top(index) for index in range(2)), strict=True)
        return np.concatenate([robot, *origins, *(origin - robot[:3] for origin in origins), *positions, *eulers])

    def _achieved_goal(self):
        return np.concatenate([self._top(index)[0] for index in range(2)])

    def is_success(self, achieved_goal, desired_goal):
        """Tests the tops of both jacks against the middles of their pots; shapes as in ``GoalEnv.is_success``."""
        offset = np.reshape(np.subtract(achieved_goal, desired_goal), (*np.shape(achieved_goal)[:-1], 2, 3))
        return (np.linalg.norm(offset, axis=-1) < self.goal_tolerance).all(axis=-1)

    def _get_task_state(self):
        return super()._get_task_state() | {"rest_heights": self._rest_heights}

    def _set_task_state(self, state):
        super()._set_task_state(state)
        self._rest_heights = state["rest_heights"]

    @staticmethod
    def expert_target(observation):
        """Puts the red jack into its pot, then the green one; a jack that is not where it should be is fetched.

        Jaws that close along a jack's own x axis find it symmetric, even when its third foot hangs on a rim.
        """
        state, goal = observation["observation"], observation["desired_goal"]
        position, tool_yaw, jaw = state[:3], nearest_yaw(state[5], 2 * np.pi), state[6]
        origins, tops, eulers = state[7:13].reshape(2, 3), state[19:25].reshape(2, 3), state[25:31].reshape(2, 3)
        to_places = goal.reshape(2, 3) + (0.0, 0.0, STANDING) - origins
        to_grasps = tops + (0.0, 0.0, GRASP_HEIGHT) - position
        for to_place, to_grasp, euler in zip(to_places, to_grasps, eulers, strict=True):
            if HELD_JAW[0] < jaw < HELD_JAW[1] and np.abs(to_grasp).max() < 0.02:
                return _carry(to_place, euler)
        # The green one goes first where it stands in the way.
        order = (0, 1) if np.abs(goal[:2] - origins[1, :2]).max() > 0.045 else (1, 0)
        for to_place, to_grasp, euler in zip(to_places[order, :], to_grasps[order, :], eulers[order, :], strict=True):
            if np.abs(to_place).max() > PLACED:
                turn = nearest_yaw(euler[2], np.pi) - tool_yaw  # the jaws are symmetric
                target = grasp(to_grasp, turn, HOVER, aligned=0.004, gain=GAIN, speed=SPEED)
                # Jaws that closed on nothing open again.
                gripper = target.jaw if jaw > HELD_JAW[0] else OPEN
                return replace(target, offset=_rise_first(target.offset), jaw=gripper)
        return Target(np.array((0.0, 0.0, max(0.0, RETREAT_HEIGHT - position[2]))), jaw=OPEN, speed=0.4)


def _carry(to_place, euler):
    """Moves a held jack, above everything else, over the place where it will stand, and lets go just above it."""
    slant = np.sqrt(max(0.0, 1.0 - (cos(euler[0]) * cos(euler[1])) ** 2))
    to_place = to_place + (0.0, 0.0, 0.003 + FOOT * slant)
    lateral = np.hypot(to_place[0], to_place[1])
    if lateral < 0.004 and abs(to_place[2]) < 0.003:
        return Target(np.zeros(3), jaw=OPEN)
    wanted = to_place + (0.0, 0.0, np.clip(3 * (lateral - 0.003), 0.0, HOVER))
    return Target(_rise_first(wanted), jaw=CLOSE, gain=GAIN, speed=SPEED)


def _rise_first(offset):
    """Reduces the horizontal part of an offset while its end is much higher."""
    share = np.clip(1.0 - (offset[2] - 0.01) / 0.02, 0.0, 1.0)
    return offset * (share, share, 1.0)
