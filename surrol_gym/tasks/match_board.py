"""MatchBoard: put a letter or digit into its recess of the board."""

from dataclasses import replace
from math import cos, hypot, sin, sumprod

import numpy as np

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state_names, rpy, xyz
from surrol_gym.experts import CLOSE, OPEN, Target, grasp, heading, nearest_yaw
from surrol_gym.psm.arm import TIP_OFFSET, euler_to_matrix
from surrol_gym.stage import OVERVIEW, Camera

GLYPHS = "012456ABC"
"""The pieces in the order of their class numbers; on the board they fill rows of three."""

TRAY_POSITION = (2.75, 0.0, 3.3755)
BOARD_POSITION = np.array((2.75, 0.0, 3.3905))
CELL, TILE = 0.125, 0.120
"""Distance between the goals of neighbouring tiles and between the tiles themselves, su; SurRoL's differ."""

STARTS = ((-0.15, -0.225), (-0.15, 0.225), (0.0, -0.225), (0.0, 0.225), (0.15, -0.225))
"""Where pieces drop onto the table, from the middle of the board, su."""

DROP_HEIGHT = 0.0605
"""Height above the middle of the board from which they drop, su; the 1 would roll on its side from some others."""

ATTACH_HEIGHT = 0.04
"""Lift of a mark at which a grasp attaches its piece, su (facts, section 2.1)."""

MARKS = {
    **dict.fromkeys("12456", (0.0006, 0.0, 0.0)),
    "0": (0.0, -0.0045, 0.0015),
    **dict.fromkeys("ABC", (0.0006, -0.0009, 0.0006)),
}
"""The point of each piece that has to be at the goal, in the frame of the piece, su (facts, section 4.10)."""

CATCHES = {
    "0": (0.0, 0.0148, 0.0),
    "1": (0.0, 0.0, 0.0),
    "2": (0.0031, 0.0044, -35.2),
    "4": (0.0133, 0.0038, -90.0),
    "5": (-0.0045, -0.0015, -90.0),
    "6": (0.0364, 0.0, -90.0),
    "A": (0.0119, 0.0, -90.0),
    "B": (0.0, -0.0050, -90.0),
    "C": (0.0, -0.0315, 0.0),
}
"""Where the expert grasps a piece: a point in its frame, x and y, su, and the direction of the stroke there, degrees.

Open jaws have room on both sides, also beside the board (0 and 4: off the middle of the stroke, for the room), and the
line along which they close passes the centre of mass, or nearly: so the piece hangs level from them.
"""

GRASP_DEPTHS = dict.fromkeys(GLYPHS, 0.006) | {"1": 0.002}
"""How far below the middle of a piece the closed tips are in the grasp, su; the 1 is thin."""

BOARD_TOP = 0.009
"""Height of the tiles above the middle of the board, su."""

SEATED = dict.fromkeys(GLYPHS, 0.0122) | {"1": 0.0055}
"""Largest height of a mark above its goal while the piece lies in its recess, su; on the rim it is higher."""

REACH = 0.2695
"""Distance from the middle that link 5 can reach along y, su."""

TILT_REACH = 0.045
"""Half the length of a piece, roughly, by which a slanting one is let go higher, su."""

HELD_JAW = (0.03, 0.6)
"""Opening angle of jaws that hold a piece, radians: closed on nothing they are at 0, open at 0.7."""

HOVER = 0.045
"""Height above the place of release at which a piece travels, su."""

RETREAT_HEIGHT = 3.55
"""Height to which link 5 rises when the piece is in its recess, su."""

GAIN, SPEED = 0.24, 0.9
"""Share of the way to a distant target that one step covers, and the largest action along an axis."""

# The same as arrays, by class.
_CATCHES = np.array([(*CATCHES[glyph][:2], np.deg2rad(CATCHES[glyph][2]), GRASP_DEPTHS[glyph]) for glyph in GLYPHS])
_SEATED = np.array([SEATED[glyph] for glyph in GLYPHS])


class MatchBoardEnv(PSMEnv):
    """
    ## Description

    A letter or digit lies beside a board of nine tiles, each with a recess for one of the pieces 0, 1, 2, 4, 5, 6, A, B
    and C. One Patient Side Manipulator has to grasp the piece by a stroke, lift it over the board and let it drop into
    its own recess. A piece on the rim of the recess is no success, nor is one in another recess.

    ## Action Space

    `Box(-1, 1, (5,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | turn of the tool about the vertical | 30 degrees |
    | 4 | jaws: negative closes them, 0 and above opens them to 40 degrees | |

    Link 5 stays within x [2.48, 3.02], y [-0.27, 0.27], z [3.426, 3.856]. Closed jaws hold a piece by friction, and
    firmly once its mark was lifted by 0.04 su.

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | position of link 5 (x, y, z), su |
    | 3, 4, 5 | fixed-axis x-y-z Euler angles of link 5, radians |
    | 6 | opening angle of the jaws, radians |
    | 7 | class of the piece: 0 to 8 for 0, 1, 2, 4, 5, 6, A, B, C |
    | 8, 9, 10 | centre of mass of the piece (x, y, z), su |
    | 11, 12, 13 | the same relative to link 5, su |
    | 14, 15, 16 | mark of the piece (x, y, z), a point within 0.005 su of its middle, su |
    | 17, 18, 19 | fixed-axis x-y-z Euler angles of the piece, radians |

    The frame of a piece stands upright, its x axis from the top of the glyph to its bottom: a piece that lies face up
    has the Euler angles (0, 0, yaw). SurRoL's frames lie on their sides, where Euler angles are degenerate.

    `achieved_goal` (3): the mark. `desired_goal` (3): where it has to be, at the middle height of the board.

    ## Rewards

    0 where the mark is within 0.02 su (4 mm) of the goal and as low as in the recess (0.0122 su above the goal, 0.0055
    su for the thin 1), -1 elsewhere. `info["is_success"]` says the same. Without the second condition, which SurRoL
    lacks, pieces that slant on the rim would pass.

    ## Starting State

    Link 5 at (2.5, 0.25, 3.601), tool down, jaws closed. Class uniform over the nine. The piece lies upright at an
    offset from the middle of the board, (2.75, 0), that is uniform over (-0.15, -0.225), (-0.15, 0.225), (0, -0.225),
    (0, 0.225) and (0.15, -0.225); a C only over those with negative y. Goal (2.75, 0, 3.3905) + 0.125 (row, column, 0),
    rows and columns counted from the 5 in the middle. The tiles are 0.120 su apart, as SurRoL's are, so a goal is up to
    0.007 su off the middle of its recess.

    ## Episode End

    Truncated after 100 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; facts, sections 4.10 and 5.10.
    """

    task = "MatchBoard"
    task_description = "Put the piece into its recess of the board."
    cameras = {
        "closeup": Camera(eye=(3.45, 0.0, 4.25), target=(2.73, 0.0, 3.46), field_of_view=34.0),
        "overview": OVERVIEW,
    }
    observation_names = (
        *robot_state_names("psm1"),
        "piece_class",
        *xyz("piece"),
        *xyz("piece_rel"),
        *xyz("mark"),
        *rpy("mark"),
    )
    goal_names = xyz("goal_mark")
    mounts = (Mount(start_position=(2.5, 0.25, 3.601)),)
    jaw_mass = 0.3  # between lighter ones flat pieces swing before they are attached
    goal_tolerance = 0.02
    """Distance of the mark from the goal that success allows, su."""

    def _build_scene(self):
        super()._build_scene()
        self.world.load("match_board.urdf", BOARD_POSITION)
        self.world.load("tray.urdf", TRAY_POSITION, drawn=False)
        # The tray stands a little deeper than the table (facts, section 4.0); a picture should show its floor.
        self.world.draw("tray.urdf", np.add(TRAY_POSITION, (0.0, 0.0, 0.003)))
        self._pieces = [self.world.load(f"glyph_{glyph}.urdf", fixed=False) for glyph in GLYPHS]
        for piece in self._pieces:
            self.grasps[0].append(Grasp(self.world, self.arms[0], piece, self._is_lifted))
        self._class = 0

    def _pose_scene(self):
        super()._pose_scene()
        self._class = int(self.np_random.integers(len(GLYPHS)))
        start = STARTS[self.np_random.integers(len(STARTS))]
        while GLYPHS[self._class] == "C" and start[1] > 0:
            start = STARTS[self.np_random.integers(len(STARTS))]
        for index, piece in enumerate(self._pieces):
            if index != self._class:
                self.world.park(piece)
        self.world.place(self._pieces[self._class], BOARD_POSITION + (*start, DROP_HEIGHT))

    def _sample_goal(self):
        self._rest_height = self._mark()[0][2]
        row, column = divmod(self._class, 3)
        return BOARD_POSITION + CELL * np.array((row - 1, column - 1, 0))

    def _is_lifted(self):
        return self._mark()[0][2] > self._rest_height + ATTACH_HEIGHT

    def _mark(self):
        return self.world.frame(self._pieces[self._class], MARKS[GLYPHS[self._class]])

    def _observe(self):
        robot, piece = self._robot_state(), self.world.pose(self._pieces[self._class])[0]
        return np.concatenate([robot, (self._class,), piece, piece - robot[:3], *self._mark()])

    def _achieved_goal(self):
        return self._mark()[0]

    def _get_task_state(self):
        return super()._get_task_state() | {"class": self._class, "rest_height": self._rest_height}

    def _set_task_state(self, state):
        super()._set_task_state(state)
        self._class, self._rest_height = state["class"], state["rest_height"]

    def is_success(self, achieved_goal, desired_goal):
        """Tests marks against goals: near enough, and as low as in the recess; shapes as in ``GoalEnv.is_success``."""
        height = np.subtract(achieved_goal, desired_goal)[..., 2]
        cell = np.rint(np.subtract(desired_goal, BOARD_POSITION)[..., :2] / CELL).astype(int)
        cell = np.minimum(np.maximum(cell, -1), 1)  # faster than np.clip
        seated = height < _SEATED[cell @ (3, 1) + 4]
        return super().is_success(achieved_goal, desired_goal) & seated

    @staticmethod
    def expert_target(observation):
        """Grasps the piece by its stroke, carries it over the board, turns it and lets it drop into its recess.

        A piece that lies anywhere else, be it on the rim or upside down, is grasped again; one that stands is toppled.
        """
        state, goal = observation["observation"], observation["desired_goal"]
        position, tool_yaw, jaw, piece = state[:3], nearest_yaw(state[5], 2 * np.pi), state[6], state[8:11]
        number = round(float(state[7]))
        catch_x, catch_y, catch_direction, depth = _CATCHES[number]
        rotation = euler_to_matrix(state[17:20])
        catch = piece + catch_x * rotation[:, 0] + catch_y * rotation[:, 1]
        stroke = cos(catch_direction) * rotation[:, 0] + sin(catch_direction) * rotation[:, 1]
        to_grasp = catch + (0.0, 0.0, TIP_OFFSET - depth) - position
        # Tips must not touch the tiles. A little beyond the workspace, jaws at its limit still enclose the stroke.
        above_tiles = BOARD_POSITION[2] + BOARD_TOP + TIP_OFFSET - position[2]
        reachable = to_grasp + (0.0, np.clip(catch[1], -REACH, REACH) - catch[1], 0.0)
        if np.abs(catch[:2] - BOARD_POSITION[:2]).max() < 1.5 * TILE + 0.03:
            reachable[2] = max(to_grasp[2], above_tiles + 0.0005)
        # The recesses are not where the goals are.
        seat = BOARD_POSITION + (goal - BOARD_POSITION) * (TILE / CELL)
        if HELD_JAW[0] < jaw < HELD_JAW[1] and np.abs(to_grasp).max() < 0.025:
            # Upside down it fits both ways.
            upright = heading(rotation[1, 0], rotation[0, 0])
            turn = nearest_yaw(tool_yaw - upright, 2 * np.pi if rotation[2, 2] > 0 else np.pi) - tool_yaw
            slant = TILT_REACH * np.sqrt(max(0.0, 1.0 - rotation[2, 2] ** 2))
            to_release = seat + (0.0, 0.0, BOARD_TOP + 0.001 + depth + slant) - piece
            to_release[2] = max(to_release[2], above_tiles + 0.001)
            return _carry(to_release, turn, 0.001 + 0.1 * slant)
        from_seat = piece - seat
        if np.hypot(from_seat[0], from_seat[1]) < 0.012 and from_seat[2] < _SEATED[number] - 0.001:
            return Target(np.array((0.0, 0.0, max(0.0, RETREAT_HEIGHT - position[2]))), jaw=OPEN, speed=0.4)
        if abs(rotation[2, 2]) < 0.6:
            return _topple(piece, rotation[:2, 2], position, jaw)
        turn = nearest_yaw(heading(stroke[1], stroke[0]) + np.pi / 2, np.pi) - tool_yaw  # the jaws are symmetric
        target = grasp(reachable, turn, gain=GAIN)
        # Jaws that closed on nothing open again.
        return target if jaw > HELD_JAW[0] else replace(target, jaw=OPEN)


def _topple(piece, normal, position, jaw):
    """Pushes a piece that stands on its edge, along the normal of its plane, with closed jaws from the nearer side."""
    normal = np.append(normal, 0.0) / hypot(*normal)
    push_at = piece + (0.0, 0.0, 0.008 + TIP_OFFSET) - position
    distance = sumprod(push_at, normal)
    side = 1.0 if distance < 0 else -1.0
    gripper = CLOSE if jaw < HELD_JAW[0] or abs(distance) > 0.03 else OPEN  # not around the piece
    across = push_at - distance * normal
    if np.abs(across).max() < 0.008:
        return Target(push_at - 0.03 * side * normal, jaw=gripper, speed=0.3)
    beside = push_at + 0.045 * side * normal
    return Target(beside + (0.0, 0.0, np.clip(3 * (np.hypot(*beside[:2]) - 0.005), 0.0, 0.06)), jaw=gripper)


def _carry(to_release, turn, tolerance):
    """Moves a held piece above the board to the place where it is let go, and turns it on the way."""
    misalignment = max(np.hypot(to_release[0], to_release[1]), 0.05 * abs(turn))
    if misalignment < tolerance and abs(to_release[2]) < 0.001:
        return Target(np.zeros(3), jaw=OPEN)
    wanted = to_release + (0.0, 0.0, np.clip(12 * (misalignment - tolerance), 0.0, HOVER))
    share = np.clip(1.0 - (wanted[2] - 0.005) / 0.015, 0.0, 1.0)  # up first
    return Target(wanted * (share, share, 1.0), turn * share, CLOSE, gain=GAIN * (0.6 + 0.4 * share), speed=SPEED)
