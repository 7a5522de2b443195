"""MatchBoardPanel: slide a lid open, lay the letter in a cell below it and slide the lid closed again."""

from math import cos, sin, sumprod

import numpy as np
import pybullet

from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state_names, rpy, xyz
from surrol_gym.experts import CLOSE, OPEN, Target, heading, nearest_yaw
from surrol_gym.psm.arm import JAWS
from surrol_gym.stage import Camera

PANEL_POSITION = (2.75, -0.1, 3.3855)
CELL_PITCH = 0.125
CELL_HEIGHT = 3.3854
LID_POSITION = np.array((2.625, -0.1, 3.4229))
"""Where the closed lid of row 0 is, su; the other rows follow along x."""
HANDLE = np.array((0.0, 0.18125, 0.0125))
"""Handle in the frame of its lid, su."""
JAW_FRICTION = 2.0
"""Of the jaws, instead of 1. SurRoL's resist the letter's swinging by spinning friction (facts, section 1.2), which
PyBullet does not compute the same way every time."""

LID_FRICTION = 240.0
"""Push that a lid withstands, N su (facts, section 4.8)."""

# In the letter's frame: the point above its back where it is taken, su, and its orientation.
_GRIP = (0.0, -0.03125, 0.0375), pybullet.getQuaternionFromEuler((0.0, 0.0, np.pi / 2))

# Of the expert; lengths in su.
HELD_JAW = (0.03, 0.3)
"""Opening angle of jaws that hold the letter, radians: closed on nothing they are at 0, open at 0.7."""
ARC_OFFSET, ARC_RADIUS = 0.0052, 0.0272
"""Centre of the letter's arc, ahead of its centre of mass, and the radius of its middle line."""
GRASP_HEIGHT = 0.0431
"""Height of link 5 above the letter in the grasp."""
GRASP_ANGLES = np.pi + np.deg2rad((0, 90, -90, 45, -45, 130, -130))
"""Where along its arc the letter may be grasped: at its back, at both arms, in between and at its ends."""
GRASP_COSTS = 0.001 * np.array((0, 3, 3, 4, 4, 5, 5))
"""What each grasp is worse than the one at the back, in the unit of obstructions."""
OBSTRUCTED = 4.0
"""Weight of an obstruction when grasps, or the two sides of a standing letter, are compared."""
PARKED = np.array((3.005, 0.185, 3.3882))
"""Where a letter is put down that is in the way of the lid."""
CLOSED = 0.004
"""A lid that has slid no further is closed."""
CARRY_SPEED = 0.7
"""Largest action along an axis with the letter between the jaws."""
REST = 0.0045
"""Height of a letter that lies in its cell above its goal."""
FLAT = 0.8
"""A letter whose plane leans further, by the vertical part of its normal, stands or leans and cannot be grasped."""
TOPPLE_HEIGHT, RUN_UP, TOPPLE_SPEED = 0.06, 0.035, 0.5
"""Height of link 5 above such a letter, how far beside it the push begins, and its largest action along an axis."""
TRANSIT = 3.55
"""Height of link 5 at which a letter that has swung down between its jaws still passes above lids and handles."""
PUSH_HEIGHT = 0.048
"""Height of link 5 above the handle that it pushes."""
TOUCH = 0.0106
"""Distance from link 5 to the handle that it pushes, along y."""
GAIN = 0.8
"""Share of a large offset that one step covers."""
OPEN_ENOUGH = 0.355
"""How far a lid has slid that leaves room for the letter in any cell below it."""
PUSH_SPEED = 0.7
"""Largest action along an axis while pushing."""


class MatchBoardPanelEnv(PSMEnv):
    """
    ## Description

    Three lids cover three rows of three cells; a letter C lies beside them on the table. One Patient Side Manipulator
    has to push the lid of one row open by its handle, lay the letter in one cell of that row, and push the lid closed
    again. Only friction between the jaws holds the letter. The lids slide hard and stay where they are left.

    ## Action Space

    `Box(-1, 1, (5,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | turn of the tool about the vertical | 30 degrees |
    | 4 | jaws: negative closes them, 0 and above opens them to 40 degrees | |

    Link 5 stays within x [2.38, 3.02], y [-0.27, 0.52], z [3.431, 3.706].

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | position of link 5 (x, y, z), su |
    | 3, 4, 5 | fixed-axis x-y-z Euler angles of link 5, radians |
    | 6 | opening angle of the jaws, radians |
    | 7, 8, 9 | centre of mass of the letter (x, y, z), su |
    | 10, 11, 12 | the same relative to link 5, su |
    | 13, 14, 15 | grip point, 0.0375 above the back of the letter (x, y, z), su |
    | 16, 17, 18 | fixed-axis x-y-z Euler angles of the jaws' best orientation there, radians |
    | 19, 20, 21 | centre of the lid over the goal's row (x, y, z), su |
    | 22, 23, 24 | handle of that lid (x, y, z), su |
    | 25 - 30 | the desired goal |

    `achieved_goal` (6): centre of mass of the letter, then the handle of the lid over the goal's row. `desired_goal`
    (6): 0.01 above the centre of the cell, then where the handle is while the lid is closed.

    ## Rewards

    0 where the achieved goal is within 0.025 su (5 mm) of the desired goal, all six numbers together, -1 elsewhere:
    the letter has to be in its cell and the lid closed. `info["is_success"]` says the same.

    ## Starting State

    Link 5 at (2.4, 0.125, 3.626), tool down, jaws closed, all lids closed. Letter uniform in
    [3.0, 3.01] x [0.175, 0.195], upright. Row and column of the goal each uniform over the three.

    ## Episode End

    Truncated after 100 steps; never terminated.

    ## Arguments

    * `render_mode`, `camera` ("closeup" or "overview"), `width`, `height`: see `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; facts, section 4.8. Panel and letter stand upright, where SurRoL rolls them by 1.57 radians.
    """

    task = "MatchBoardPanel"
    task_description = "Open the lid, put the letter C in its cell and close the lid again."
    cameras = {
        "closeup": Camera(eye=(3.5, 0.1, 4.4), target=(2.8, 0.09, 3.44), field_of_view=40.0),
        "overview": Camera(eye=(6.9, 0.1, 6.2), target=(1.0, 0.0, 2.9)),
    }
    observation_names = (
        *robot_state_names("psm1"),
        *xyz("letter"),
        *xyz("letter_rel"),
        *xyz("grip"),
        *rpy("grip"),
        *xyz("lid"),
        *xyz("handle"),
        *xyz("goal_letter"),
        *xyz("goal_handle"),
    )
    goal_names = (*xyz("goal_letter"), *xyz("goal_handle"))
    jaw_mass = 2.02  # as in SurRoL's gripper for this task; friction alone holds the letter, and lighter jaws drop it
    mounts = (Mount(start_position=(2.4, 0.125, 3.626), workspace=((0.48, 0.60), (-0.05, 0.10), (0.676, 0.715))),)

    def _build_scene(self):
        super()._build_scene()
        for jaw in JAWS:
            self.world.client.changeDynamics(self.arms[0].body, jaw, lateralFriction=JAW_FRICTION)
        self._letter = self.world.load("letter_C.urdf", (3.005, 0.185, 3.389), fixed=False)
        self._panel = self.world.load("match_panel.urdf", PANEL_POSITION)
        self.world.client.setJointMotorControlArray(
            self._panel, range(3), pybullet.VELOCITY_CONTROL, targetVelocities=(0,) * 3, forces=(LID_FRICTION,) * 3
        )

    def _pose_scene(self):
        super()._pose_scene()
        x, y = self.np_random.uniform((3.0, 0.175), (3.01, 0.195))
        self.world.place(self._letter, (x, y, 3.389))

    def _sample_goal(self):
        row, column = self.np_random.integers(3, size=2)
        cell = (2.625 + CELL_PITCH * row, -0.225 + CELL_PITCH * column, CELL_HEIGHT + 0.01)
        return np.concatenate([cell, LID_POSITION + (CELL_PITCH * row, 0.0, 0.0) + HANDLE])

    def _lid(self):
        """Centre of the lid over the goal's row, shape (3,), su."""
        row = round((self._goal[0] - LID_POSITION[0]) / CELL_PITCH)
        slid = self.world.client.getJointState(self._panel, row)[0]
        return LID_POSITION + (CELL_PITCH * row, slid, 0.0)

    def _observe(self):
        letter, grip, lid = self.world.pose(self._letter)[0], self.world.frame(self._letter, *_GRIP), self._lid()
        return np.concatenate([self._robot_and_object(letter, grip), lid, lid + HANDLE, self._goal])

    def _achieved_goal(self):
        return np.concatenate([self.world.pose(self._letter)[0], self._lid() + HANDLE])

    @staticmethod
    def expert_target(observation):
        """Open the lid, lay the letter in its cell, close the lid; each phase is recognised from the state.

        Jaws that closed on nothing open again. A letter that lies where the lid passes is put aside first, and one that
        stands on its edge is pushed over.
        """
        state = observation["observation"]
        position, yaw, jaw, letter = state[:3], nearest_yaw(state[5]), state[6], state[7:10]
        goal, handle, slid = state[25:28], state[22:25], state[23] - state[29]
        grasps, yaws = _grasps(letter, state[18])
        to_grasps = grasps - position
        lateral, height = np.hypot(to_grasps[:, 0], to_grasps[:, 1]), to_grasps[0, 2]
        near = lateral.min() < 0.015 and -0.025 < height < 0.015
        to_goal = goal + (0.0, 0.0, REST) - letter
        held = near and HELD_JAW[0] < jaw < HELD_JAW[1]
        if _lies_at(to_goal, held):
            if near:
                return Target(np.array((0.0, 0.0, 0.05 if jaw > 0.4 else 0.0)), jaw=OPEN, gain=GAIN)
            if slid > CLOSED:
                return _push(position, yaw, jaw, handle, side=1, to=state[29] - 0.001)
            return Target(np.array((0.0, 0.0, max(0.0, TRANSIT - position[2]))), -yaw, gain=GAIN)
        if held:
            if slid < OPEN_ENOUGH:
                to_goal = PARKED - letter
                if _lies_at(to_goal, held):
                    return Target(np.zeros(3), jaw=OPEN)
            return Target(_over(to_goal + (0.0, 0.0, 0.003), position), gain=GAIN, speed=CARRY_SPEED)
        normal = _normal(state[16:19])
        if abs(normal[2]) < FLAT:
            return _topple(position, yaw, letter, normal, handle)
        on_the_way = abs(letter[0] - handle[0]) < 0.1 and letter[1] > 0.09 and letter[2] < handle[2] - 0.02
        if on_the_way and slid > max(letter[1] - 0.13, CLOSED):
            return _push(position, yaw, jaw, handle, side=1, to=state[29] - 0.001)
        if slid < OPEN_ENOUGH and not on_the_way:
            return _push(position, yaw, jaw, handle, side=-1, to=state[29] + OPEN_ENOUGH + 0.015)
        best = np.argmin(OBSTRUCTED * _obstructions(grasps, yaws, handle) + GRASP_COSTS)
        to_grasp, turn = to_grasps[best], yaws[best] - yaw
        there = max(lateral[best], abs(height), 0.05 * abs(turn)) < 0.003
        return Target(_over(to_grasp, position, turn), turn, CLOSE if there and jaw > HELD_JAW[0] else OPEN, gain=GAIN)


def _grasps(letter, yaw):
    """Where link 5 may grasp the letter, one place for each of ``GRASP_ANGLES``, su, and the yaws of the jaws."""
    along = yaw + GRASP_ANGLES
    outward = np.array([(cos(angle), sin(angle), 0.0) for angle in along])
    middle = letter - ARC_OFFSET * outward[0] + (0.0, 0.0, GRASP_HEIGHT)
    return middle + ARC_RADIUS * outward, along % np.pi


def _obstructions(grasps, yaws, handle):
    """How far open jaws at each grasp would reach out of the workspace or onto a lid, su."""
    x, y = grasps[:, 0], grasps[:, 1]
    width, length = 0.008 + 0.0175 * np.abs([(cos(yaw), sin(yaw)) for yaw in yaws]).T
    outside = np.maximum(x - 3.018, 0.0) + np.maximum(-0.268 - y, 0.0)
    across, over_panel = np.abs(x - handle[0]), 0.19 - np.abs(x - PANEL_POSITION[0]) + width
    closed_lids = np.minimum.reduce((across + width - 0.0625, over_panel, 0.0875 - y + length))
    open_lid = np.minimum(0.0625 - across + width, y + length - handle[1] + 0.36875)
    return outside + np.maximum(np.maximum(closed_lids, open_lid), 0.0)


def _lies_at(offset, held):
    """Whether the letter lies where ``offset`` leads; while held it has to be nearer than later."""
    return np.hypot(offset[0], offset[1]) < (0.005 if held else 0.012) and offset[2] > -0.006


def _normal(euler):
    """The direction across the letter's plane, shape (3,)."""
    return np.array(pybullet.getMatrixFromQuaternion(pybullet.getQuaternionFromEuler(euler)))[2::3]


def _topple(position, yaw, letter, normal, handle):
    """Pushes the letter over, across its plane, with jaws open along it: closed ones would slip through the C."""
    across = normal * (1.0, 1.0, 0.0) / np.hypot(normal[0], normal[1])
    jaws = heading(across[0], -across[1]) % np.pi
    offset, turn = letter + (0.0, 0.0, TOPPLE_HEIGHT) - position, jaws - yaw
    distance = sumprod(offset, across)
    if np.abs(offset - distance * across).max() < 0.01 and abs(turn) < 0.25:
        return Target(offset + np.copysign(0.03, distance) * across, turn, OPEN, speed=TOPPLE_SPEED)
    starts = offset + np.outer((-RUN_UP, RUN_UP), across)
    obstructions = _obstructions(position + starts, np.full(2, jaws), handle)
    start = starts[np.argmin(OBSTRUCTED * obstructions + 0.2 * np.linalg.norm(starts, axis=1))]
    return Target(_over(start, position, turn), turn, OPEN, gain=GAIN)


def _push(position, yaw, jaw, handle, side, to):
    """Pushes the handle along y with closed jaws, from its side ``side``, until it is at ``to``.

    The jaws are turned so that the handle does not push them open. They go slowly enough not to jump over it.
    """
    offset = handle + (0.0, side * TOUCH, PUSH_HEIGHT) - position
    gap = -side * offset[1]
    if max(abs(offset[0]), abs(offset[2])) < 0.004 and -0.005 < gap < 0.025 and abs(yaw) < 0.12:
        return Target(offset + (0.0, to - handle[1], 0.0), -yaw, gain=GAIN, speed=PUSH_SPEED)
    # Jaws that closed around the handle let it go on their way up.
    stuck = jaw > 0.1 and offset[2] > -0.03 and np.hypot(offset[0], gap + TOUCH) < 0.05
    return Target(_over(offset + (0.0, side * 0.012, 0.0), position), -yaw, OPEN if stuck else CLOSE, gain=GAIN)


def _over(offset, position, turn=0.0):
    """The next part of a way up, across everything and, once turned, down to ``offset``."""
    misalignment = max(np.hypot(offset[0], offset[1]), 0.05 * abs(turn))
    clearance = np.clip(3 * (misalignment - 0.006), 0.0, TRANSIT - (position[2] + offset[2]))
    rise = offset[2] + clearance
    across = np.clip((0.045 - rise) / 0.03, 0.0, 1.0)
    return np.array((across * offset[0], across * offset[1], rise))
