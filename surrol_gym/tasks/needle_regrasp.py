"""NeedleRegrasp: hand the needle from one arm to the other and bring it to a goal in the air."""

import numpy as np
import pybullet

from surrol_gym.envs.grasping import Grasp, exclude_each_other
from surrol_gym.envs.psm_env import PITCH, Mount, PSMEnv, psm2, robot_state_names, rpy, xyz
from surrol_gym.experts import CLOSE, OPEN, Target, heading
from surrol_gym.psm.arm import JAW_CLOSED, TIP_OFFSET
from surrol_gym.stage import OVERVIEW, Camera
from surrol_gym.tasks.needle import Needle

GOAL_CENTRE, GOAL_SCATTER = np.array([2.875, -0.225, 3.651]), 0.025

DEPTH = TIP_OFFSET - 0.0075
"""Distance along the tool from link 5 to the needle between the jaws, su (facts, section 4.5)."""

CLOSED_ON_NEEDLE = 0.19
"""Opening angle at which the jaws touch the needle there, radians."""

HELD_JAW = (0.08, 0.6)
"""Opening angle of jaws that hold the needle, radians: closed on nothing they are at 0, open at 0.7."""

LEVEL = np.deg2rad(-30)
"""Pitch of either tool when it holds a needle whose ends are at one height."""

HALF_SPAN = 0.0866
"""Half the distance between the two points where the needle is held, su."""

BEYOND = TIP_OFFSET - DEPTH
"""How far the tips reach beyond the needle that the jaws hold, su."""

MEETING_X, MEETING_Z = (2.83, 2.93), (3.58, 3.75)
"""Where PSM2 can take the needle; every episode starts there, but a disturbed arm may leave."""

_PITCHING = {"turns": PITCH, "turn_step": np.deg2rad(15), "start_euler": (0.0, -np.pi / 2, -np.pi / 2)}


class NeedleRegraspEnv(PSMEnv):
    """
    ## Description

    PSM1 holds a needle in the air, near its right end. PSM2 has to grasp it near its left end, PSM1 has to let go, and
    PSM2 has to bring its end to a goal. Both tools lie along the world's x axis and turn about themselves. No table is
    within reach: a needle that is dropped is lost.

    An object is fixed to one arm at a time. PSM2 takes the needle over in the step in which PSM1 opens; during that
    step only the friction of its jaws holds it.

    ## Action Space

    `Box(-1, 1, (10,), float32)`. One step is 0.2 s.

    | Index | Action | Effect of 1 |
    | --- | --- | --- |
    | 0, 1, 2 | motion of PSM1's link 5 along world x, y, z | 0.05 su (10 mm) |
    | 3 | pitch: turn of its tool about itself, within [-90, 90] degrees | 15 degrees |
    | 4 | its jaws: negative closes them, 0 and above opens them to 40 degrees | |
    | 5-9 | the same of PSM2 | |

    Link 5 stays within x [2.73, 3.02], z [3.526, 3.856]; PSM1 within y [0.03, 0.42], PSM2 within y [-0.42, -0.03].

    ## Observation Space

    A dictionary of float32 arrays in scaled units (1 su = 0.2 m) and radians, world frame.

    | `observation` | Content |
    | --- | --- |
    | 0, 1, 2 | PSM1: position of link 5 (x, y, z), su |
    | 3, 4, 5 | PSM1: fixed-axis x-y-z Euler angles of link 5, radians |
    | 6 | PSM1: opening angle of the jaws, radians |
    | 7, 8, 9 | PSM2: position of link 5 (x, y, z), su |
    | 10, 11, 12 | PSM2: fixed-axis x-y-z Euler angles of link 5, radians |
    | 13 | PSM2: opening angle of the jaws, radians |
    | 14, 15, 16 | centre of mass of the needle (x, y, z), su |
    | 17, 18, 19 | the same relative to link 5 of PSM1, su |
    | 20, 21, 22 | the same relative to link 5 of PSM2, su |
    | 23, 24, 25 | left grasp point, 60 degrees from the middle of the arc, for PSM2 (x, y, z), su |
    | 26, 27, 28 | its fixed-axis x-y-z Euler angles, radians |
    | 29, 30, 31 | right grasp point, 60 degrees to the other side, held by PSM1 at first (x, y, z), su |
    | 32, 33, 34 | its fixed-axis x-y-z Euler angles, radians |

    At a pitch of -90 degrees, where PSM2 starts, roll and yaw are ambiguous and jump between steps.

    `achieved_goal` (3): left grasp point. `desired_goal` (3): where it has to be.

    ## Rewards

    0 where the left grasp point is within 0.025 su (5 mm) of the goal, -1 elsewhere. `info["is_success"]` says the
    same.

    ## Starting State

    PSM1 holds the needle, which is fixed to it: centre of mass uniform in [2.833, 2.917] x [0.167, 0.283] x
    [3.609, 3.693], needle upright across x and tilted by a uniform angle in [-15, 15] degrees, jaws across the right
    grasp point, which is 7.5e-3 su behind their tips. Link 5 of PSM2 at (2.875, -0.225, 3.651), pitch -90 degrees, jaws
    closed. Goal normal around (2.875, -0.225, 3.651), standard deviation 0.025 su along each axis.

    ## Episode End

    Truncated after 50 steps; never terminated.

    ## Arguments

    `render_mode`, `camera` ("closeup", "both_arms" or "overview"), `width`, `height`: see
    `surrol_gym.envs.goal_env.GoalEnv`.

    ## Version History

    * v0: first version; facts, section 4.5, without the scripted grasp at reset.
    """

    task = "NeedleRegrasp"
    task_description = "Hand the needle from the first arm to the second and bring its held end to the goal."
    cameras = {
        "closeup": Camera(eye=(3.75, 0.0, 4.05), target=(2.85, 0.0, 3.66), field_of_view=40.0),
        "both_arms": Camera(eye=(5.3, 0.0, 4.8), target=(2.3, 0.0, 4.0), field_of_view=40.0),
        "overview": OVERVIEW,
    }
    observation_names = (
        *robot_state_names("psm1"),
        *robot_state_names("psm2"),
        *xyz("needle"),
        *xyz("needle_rel1"),
        *xyz("needle_rel2"),
        *xyz("left"),
        *rpy("left"),
        *xyz("right"),
        *rpy("right"),
    )
    solver_iterations = 20  # a step takes a third less time than with 50, and episodes end the same
    goal_names = xyz("goal_left")
    mounts = (
        Mount(
            start_position=(2.875, 0.225, 3.651),
            euler=(0.0, 0.0, -np.pi / 2),
            workspace=((0.55, 0.60), (0.01, 0.08), (0.695, 0.745)),
            **_PITCHING,
        ),
        psm2(
            start_position=(2.875, -0.225, 3.651),
            euler=(-np.pi, 0.0, np.pi / 2),
            workspace=((0.55, 0.60), (-0.08, -0.01), (0.695, 0.745)),
            **_PITCHING,
        ),
    )

    def _build_scene(self):
        super()._build_scene()
        self._needle = Needle(self.world, tray=False)
        for arm, grasps in zip(self.arms, self.grasps, strict=True):
            grasps.append(Grasp(self.world, arm, self._needle.body))
        exclude_each_other(self._all_grasps())

    def _pose_scene(self):
        super()._pose_scene()
        centre = self.np_random.uniform((2.8333, 0.1667, 3.6093), (2.9167, 0.2833, 3.6927))
        tilt = self.np_random.uniform(-np.pi / 12, np.pi / 12)
        orientation = pybullet.getQuaternionFromEuler((-np.pi / 2, tilt - np.pi / 2, np.pi / 2))
        self.world.place(self._needle.body, centre, orientation)
        position, euler = self._needle.right()
        self.arms[0].reset(position - (DEPTH, 0.0, 0.0), (0.0, euler[1], -np.pi / 2), CLOSED_ON_NEEDLE)
        self.grasps[0][0].attach()
        self.arms[0].command_jaws(JAW_CLOSED)

    def _sample_goal(self):
        return GOAL_CENTRE + self.np_random.normal(0.0, GOAL_SCATTER, 3)

    def _observe(self):
        return self._robot_and_object(self._needle.centre(), self._needle.left(), self._needle.right())

    def _achieved_goal(self):
        return self._needle.left()[0]

    @staticmethod
    def expert_target(observation):
        """Bring needle and PSM2 together, close, let PSM1 go and retreat, carry; each phase is seen in the state.

        PSM1 opens only where both hold the needle, and PSM2 only where PSM1 does.
        """
        state = observation["observation"]
        left, right = state[23:26], state[29:32]
        to_right, to_left = right - (DEPTH, 0.0, 0.0) - state[:3], left - (DEPTH, 0.0, 0.0) - state[7:10]
        jaw1, jaw2 = state[6], state[13]
        first_holds, second_holds = _holds(jaw1, to_right, 0.03), _holds(jaw2, to_left, 0.012)
        if first_holds and second_holds:
            return _stay(OPEN), _stay(CLOSE)
        if first_holds:
            return _meet(state, left, right, to_left)
        if HELD_JAW[0] < jaw2 < HELD_JAW[1]:
            return _part(state, to_right, observation["desired_goal"] - left)
        return _stay(OPEN), _stay(OPEN)


def _holds(jaw, offset, tolerance):
    """Whether jaws are closed on the needle where they should be."""
    return HELD_JAW[0] < jaw < HELD_JAW[1] and np.abs(offset).max() < tolerance


def _stay(jaw):
    return Target(np.zeros(3), jaw=jaw)


def _meet(state, left, right, to_left):
    """PSM1 brings the needle to y = 0 and levels it; PSM2 goes where its point will be and closes on it from behind."""
    span = right - left
    tilt = heading(span[2], span[1])
    meeting = np.array([np.clip(right[0], *MEETING_X), HALF_SPAN, np.clip(right[2], *MEETING_Z)])
    ahead = meeting - right
    turn = LEVEL - state[11]
    aside = np.hypot(to_left[1], to_left[2])
    misalignment = max(aside, 0.05 * abs(turn), 0.05 * abs(tilt))
    if misalignment < 0.002 and abs(to_left[0]) < 0.002 and np.abs(ahead).max() < 0.005:
        return _stay(CLOSE), Target(to_left, turn, CLOSE)
    if to_left[0] < BEYOND and misalignment > 0.006 and aside < 0.08:
        # Something went wrong: the tips of PSM2 are beyond the needle, but beside its point. Out the way they came.
        return Target(ahead * (1.0, 0.0, 0.0)), Target(np.array([to_left[0] - 0.03, 0.0, 0.0]), jaw=OPEN)
    clearance = np.clip(3 * (misalignment - 0.001), 0.0, 0.03) if state[13] > HELD_JAW[1] else 0.03
    behind = np.array([left[0] + ahead[0] - DEPTH - clearance, -HALF_SPAN, meeting[2]]) - state[7:10]
    return (
        Target(ahead, -tilt, CLOSE, gain=0.16, speed=0.4, turn_speed=1.0),
        Target(behind, turn, OPEN, gain=0.16, speed=0.4, turn_speed=1.0),
    )


def _part(state, to_right, to_goal):
    """PSM1 draws back along its tool, then aside; PSM2 waits until the way is clear and carries the needle."""
    in_the_way = np.hypot(to_right[1], to_right[2]) < 0.04
    back = to_right[0] - BEYOND - 0.02
    if in_the_way and back < -0.01:
        return Target(np.array([back, 0.0, 0.0]), jaw=OPEN, gain=0.5), _stay(CLOSE)
    aside = np.array([min(back, 0.0) if in_the_way else 0.0, max(HALF_SPAN + 0.05 - state[1], 0.0), 0.0])
    carry = Target(to_goal, LEVEL - state[11], CLOSE, gain=0.16, speed=0.4)
    return Target(aside, jaw=OPEN, gain=0.16, speed=0.4), carry
