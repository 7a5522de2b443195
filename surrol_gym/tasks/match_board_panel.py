"""MatchBoardPanel: slide a lid open, lay the letter in a cell below it and slide the lid closed again."""

import numpy as np
import pybullet

from surrol_gym.envs.psm_env import Mount, PSMEnv, robot_state
from surrol_gym.psm.arm import JAWS
from surrol_gym.quantities import euler, point
from surrol_gym.stage import Camera

PANEL_POSITION = (2.75, -0.1, 3.3855)
CELL_PITCH = 0.125
CELL_HEIGHT = 3.3854
LID_POSITION = np.array((2.625, -0.1, 3.4229))
"""Where the closed lid of row 0 is, su; the other rows follow along x."""
HANDLE = np.array((0.0, 0.18125, 0.0125))
"""Handle in the frame of its lid, su."""
JAW_FRICTION = 2.0
"""Of the jaws, instead of 1. SurRoL's resist the letter's swinging by spinning friction (docs/psm.md#jaws), which
PyBullet does not compute the same way every time."""

LID_FRICTION = 240.0
"""Push that a lid withstands, N su (docs/scenes.md#match-board-panel)."""

# In the letter's frame: the point above its back where it is taken, su, and its orientation.
_GRIP = (0.0, -0.03125, 0.0375), pybullet.getQuaternionFromEuler((0.0, 0.0, np.pi / 2))


class MatchBoardPanelEnv(PSMEnv):
    """
    ## Description

    Three lids cover three rows of three cells; a letter C lies beside them on the table. One Patient Side Manipulator
    has to push the lid of one row open by its handle, lay the letter in one cell of that row, and push the lid closed
    again. Only friction between the jaws holds the letter. The lids slide hard and stay where they are left.

    ## Action Space

    {actions}

    ## Observation Space

    {observation}

    ## Rewards

    0 where the achieved goal is within 0.025 su (5 mm) of the desired goal, all six numbers together, -1 elsewhere:
    the letter has to be in its cell and the lid closed. `info["is_success"]` says the same.

    ## Starting State

    Link 5 at (2.4, 0.125, 3.626), tool down, jaws closed, all lids closed. Letter uniform in
    [3.0, 3.01] x [0.175, 0.195], upright. Row and column of the goal each uniform over the three.

    ## Episode End

    Truncated after 100 steps; never terminated.

    ## Arguments

    * `render_mode`, `obs_type`, `camera` ("closeup" or "overview"), `width`, `height`: see
      `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; docs/scenes.md#match-board-panel. Panel and letter stand upright, where SurRoL rolls them by
    1.57 radians.
    """

    task_description = "Open the lid, put the letter C in its cell and close the lid again."
    cameras = {
        "closeup": Camera(eye=(3.5, 0.1, 4.4), target=(2.8, 0.09, 3.44), field_of_view=40.0),
        "overview": Camera(eye=(6.9, 0.1, 6.2), target=(1.0, 0.0, 2.9)),
    }
    observation_quantities = (
        *robot_state(),
        point("letter", "centre of mass of the letter"),
        point("letter_rel", "the same relative to link 5", derived_from=("letter", "psm1")),
        point("grip", "grip point, 0.0375 above the back of the letter"),
        euler("grip", "fixed-axis x-y-z Euler angles of the jaws' best orientation there"),
        point("lid", "centre of the lid over the goal's row"),
        point("handle", "handle of that lid"),
        point("goal_letter", "the desired goal: of the letter"),
        point("goal_handle", "the desired goal: of the handle"),
    )
    goal_quantities = (
        point("letter", "centre of mass of the letter", "0.01 su above the centre of the cell"),
        point("handle", "handle of the lid over the goal's row", "where the handle is while the lid is closed"),
    )
    jaw_mass = 2.02  # as in SurRoL's gripper for this task; friction alone holds the letter, and lighter jaws drop it
    mounts = (Mount(start_position=(2.4, 0.125, 3.626), workspace=((0.48, 0.60), (-0.05, 0.10), (0.676, 0.715))),)

    def _build_scene(self) -> None:
        super()._build_scene()
        for jaw in JAWS:
            self.world.client.changeDynamics(self.arms[0].body, jaw, lateralFriction=JAW_FRICTION)
        self._letter = self.world.load("letter_C.urdf", (3.005, 0.185, 3.389), fixed=False)
        self._panel = self.world.load("match_panel.urdf", PANEL_POSITION)
        self.world.client.setJointMotorControlArray(
            self._panel, range(3), pybullet.VELOCITY_CONTROL, targetVelocities=(0,) * 3, forces=(LID_FRICTION,) * 3
        )

    def _pose_scene(self) -> None:
        super()._pose_scene()
        x, y = self.np_random.uniform((3.0, 0.175), (3.01, 0.195))
        self.world.place(self._letter, (x, y, 3.389))

    def _sample_goal(self) -> np.ndarray:
        row, column = self.np_random.integers(3, size=2)
        cell = (2.625 + CELL_PITCH * row, -0.225 + CELL_PITCH * column, CELL_HEIGHT + 0.01)
        return np.concatenate([cell, LID_POSITION + (CELL_PITCH * row, 0.0, 0.0) + HANDLE])

    def _lid(self) -> np.ndarray:
        """Centre of the lid over the goal's row, shape (3,), su."""
        row = round((self._goal[0] - LID_POSITION[0]) / CELL_PITCH)
        slid = self.world.client.getJointState(self._panel, row)[0]
        return LID_POSITION + (CELL_PITCH * row, slid, 0.0)

    def _observe(self) -> np.ndarray:
        letter, grip, lid = self.world.pose(self._letter)[0], self.world.frame(self._letter, *_GRIP), self._lid()
        return np.concatenate([self._robot_and_object(letter, grip), lid, lid + HANDLE, self._goal])

    def _achieved_goal(self) -> np.ndarray:
        return np.concatenate([self.world.pose(self._letter)[0], self._lid() + HANDLE])
