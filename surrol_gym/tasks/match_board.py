"""MatchBoard: put a letter or digit into its recess of the board."""

from typing import Any

import numpy as np

from surrol_gym.envs.grasping import Grasp
from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state
from surrol_gym.quantities import Quantity, euler, point
from surrol_gym.stage import OVERVIEW, Camera
from surrol_gym.tasks.tray import load_tray

GLYPHS = "012456ABC"
"""The pieces in the order of their class numbers; on the board they fill rows of three."""

BOARD_POSITION = np.array((2.75, 0.0, 3.3905))
CELL, TILE = 0.125, 0.120
"""Distance between the goals of neighbouring tiles and between the tiles themselves, su; SurRoL's differ."""

STARTS = ((-0.15, -0.225), (-0.15, 0.225), (0.0, -0.225), (0.0, 0.225), (0.15, -0.225))
"""Where pieces drop onto the table, from the middle of the board, su."""

DROP_HEIGHT = 0.0605
"""Height above the middle of the board from which they drop, su; the 1 would roll on its side from some others."""

ATTACH_HEIGHT = 0.04
"""Lift of a mark at which a grasp attaches its piece, su (docs/grasping.md#the-rule)."""

MARKS = {
    **dict.fromkeys("12456", (0.0006, 0.0, 0.0)),
    "0": (0.0, -0.0045, 0.0015),
    **dict.fromkeys("ABC", (0.0006, -0.0009, 0.0006)),
}
"""The point of each piece that has to be at the goal, in the frame of the piece, su (docs/scenes.md#match-board)."""

BOARD_TOP = 0.009
"""Height of the tiles above the middle of the board, su."""

SEATED = np.array([0.0055 if glyph == "1" else 0.0122 for glyph in GLYPHS])
"""Largest height of a mark above its goal while the piece lies in its recess, su, by class; on the rim it is higher."""


class MatchBoardEnv(PSMEnv):
    """
    ## Description

    A letter or digit lies beside a board of nine tiles, each with a recess for one of the pieces 0, 1, 2, 4, 5, 6, A, B
    and C. One Patient Side Manipulator has to grasp the piece by a stroke, lift it over the board and let it drop into
    its own recess. A piece on the rim of the recess is no success, nor is one in another recess.

    ## Action Space

    {actions}

    Closed jaws hold a piece by friction, and firmly once its mark was lifted by 0.04 su.

    ## Observation Space

    {observation}

    The frame of a piece stands upright, its x axis from the top of the glyph to its bottom: a piece that lies face up
    has the Euler angles (0, 0, yaw). SurRoL's frames lie on their sides, where Euler angles are degenerate.

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

    * v0: first version; docs/scenes.md#match-board.
    """

    task_description = "Put the piece into its recess of the board."
    cameras = {
        "closeup": Camera(eye=(3.45, 0.0, 4.25), target=(2.73, 0.0, 3.46), field_of_view=34.0),
        "overview": OVERVIEW,
    }
    observation_quantities = (
        *robot_state(),
        Quantity("piece_class", "class of the piece: 0 to 8 for 0, 1, 2, 4, 5, 6, A, B, C"),
        point("piece", "centre of mass of the piece"),
        point("piece_rel", "the same relative to link 5", derived_from=("piece", "psm1")),
        point("mark", "mark of the piece, a point within 0.005 su of its middle"),
        euler("mark", "fixed-axis x-y-z Euler angles of the piece"),
    )
    goal_quantities = (point("mark", "mark of the piece", "where it has to be, at the middle height of the board"),)
    mounts = (Mount(start_position=(2.5, 0.25, 3.601)),)
    jaw_mass = 0.3  # between lighter ones flat pieces swing before they are attached
    goal_tolerance = 0.02
    """Distance of the mark from the goal that success allows, su."""

    def _build_scene(self) -> None:
        super()._build_scene()
        self.world.load("match_board.urdf", BOARD_POSITION)
        load_tray(self.world)
        self._pieces = [self.world.load(f"glyph_{glyph}.urdf", fixed=False) for glyph in GLYPHS]
        for piece in self._pieces:
            self.grasps[0].append(Grasp(self.world, self.arms[0], piece, self._is_lifted))
        self._class = 0

    def _pose_scene(self) -> None:
        super()._pose_scene()
        self._class = int(self.np_random.integers(len(GLYPHS)))
        start = STARTS[self.np_random.integers(len(STARTS))]
        while GLYPHS[self._class] == "C" and start[1] > 0:
            start = STARTS[self.np_random.integers(len(STARTS))]
        for index, piece in enumerate(self._pieces):
            if index != self._class:
                self.world.park(piece)
        self.world.place(self._pieces[self._class], BOARD_POSITION + (*start, DROP_HEIGHT))

    def _sample_goal(self) -> np.ndarray:
        self._rest_height = self._mark()[0][2]
        row, column = divmod(self._class, 3)
        return BOARD_POSITION + CELL * np.array((row - 1, column - 1, 0))

    def _is_lifted(self) -> bool:
        return self._mark()[0][2] > self._rest_height + ATTACH_HEIGHT

    def _mark(self) -> tuple[np.ndarray, np.ndarray]:
        return self.world.frame(self._pieces[self._class], MARKS[GLYPHS[self._class]])

    def _observe(self) -> np.ndarray:
        robot, piece = self._robot_state(), self.world.pose(self._pieces[self._class])[0]
        return np.concatenate([robot, (self._class,), piece, piece - robot[:3], *self._mark()])

    def _achieved_goal(self) -> np.ndarray:
        return self._mark()[0]

    def _get_task_state(self) -> dict[str, Any]:
        return super()._get_task_state() | {"class": self._class, "rest_height": self._rest_height}

    def _set_task_state(self, state: dict[str, Any]) -> None:
        super()._set_task_state(state)
        self._class, self._rest_height = state["class"], state["rest_height"]

    def is_success(self, achieved_goal: np.ndarray, desired_goal: np.ndarray) -> np.ndarray:
        """Tests marks against goals: near enough, and as low as in the recess; shapes as in ``GoalEnv.is_success``."""
        height = np.subtract(achieved_goal, desired_goal)[..., 2]
        cell = np.rint(np.subtract(desired_goal, BOARD_POSITION)[..., :2] / CELL).astype(int)
        cell = np.minimum(np.maximum(cell, -1), 1)  # faster than np.clip
        seated = height < SEATED[cell @ (3, 1) + 4]
        return super().is_success(achieved_goal, desired_goal) & seated
