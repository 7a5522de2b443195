"""BiPegBoard: PSM2 fetches the ring, PSM1 takes it over and puts it over the peg."""

from math import cos, hypot, sin, sumprod
from typing import Any

import numpy as np

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import CLOSE, OPEN, Target, heading
from surrol_gym.psm.arm import TIP_OFFSET
from surrol_gym.tasks.bi_peg_board import (
    GOAL,
    HANGING_TIP_X,
    HANGING_Y,
    HANGING_Z,
    HOLE_RADIUS,
    POINT_1,
    POINT_2,
    PSM1_ROLL,
    RING_RADIUS,
    UPRIGHT_TOP,
    UPRIGHT_X,
    UPRIGHT_Y,
)

HANDOVER = np.array([2.56, -0.01, 3.78])
"""Where the ring's centre is when it changes hands, su."""

RELEASE_HEIGHT = GOAL[2] + 0.036
"""Height of the ring's centre at which PSM1 lets go, around the peg; the lower jaw needs the room to open, su."""

GAIN = 0.4
"""Share of a large offset that one step covers."""

ALIGNED = 0.006
"""Misalignment below which the jaws close; 0.05 su of it count as one radian."""

GRIP_1, GRIP_2, GRIP_2_FLAT = 0.042, 0.044, 0.0465
"""Distance along the tool from link 5 to the tube it grasps, su; a flat ring is grasped as deep as the plate allows."""

HELD_JAW = (0.1, 0.5)
"""Opening angle of jaws that hold the ring, radians: closed on nothing they are at 0, open at 0.7."""

REACHABLE_Y, DRAWN_Y = 0.012, -0.01
"""A free ring whose centre has a smaller y is for PSM2; PSM1 draws one that it has got hold of a little further, su."""

FLAT = 0.9
"""Vertical component of the axis of a ring that counts as flat."""

REST_2 = np.array([2.5, -0.2, 3.95])
PITCH_LIMIT = np.deg2rad(86)
_X, _Y, _Z = np.eye(3)
_STILL = np.zeros(3)


def law(seen: Reading) -> tuple[Target, Target]:
    """Recognises each phase from the state.

    A ring that was dropped lies flat on the plate. PSM2 picks it up where it can; elsewhere PSM1 puts its closed jaws
    into the hole and draws the ring to where PSM2 can.
    """
    scene = Scene(seen)
    if scene.held1:
        return scene.put_down(), scene.let_go()
    if scene.held2:
        return scene.take_over(), scene.bring()
    if scene.is_around_peg():
        return scene.back_off(), scene.step_aside()
    if scene.is_for_psm2():
        return scene.wait(), scene.fetch()
    return scene.draw_nearer() if scene.flat or scene.leans() else scene.take(), scene.step_aside()


def _psm1_tool(pitch: float) -> np.ndarray:
    """Direction of PSM1's jaws at a pitch."""
    s, c = sin(PSM1_ROLL), cos(PSM1_ROLL)
    return np.array([-s * sin(pitch), -c, s * cos(pitch)])


WAIT_1 = HANDOVER + (RING_RADIUS + 0.05) * _Y - GRIP_1 * _psm1_tool(0.0)


def _move(offset: np.ndarray, turn: float = 0.0, jaw: float = CLOSE, **kwargs: Any) -> Target:
    return Target(offset, turn, jaw, **({"gain": GAIN} | kwargs))


def _grasp(
    to_grasp: np.ndarray, away: np.ndarray, turn: float, hover: float, aligned: float = ALIGNED, **kwargs: Any
) -> Target:
    """As ``surrol_gym.experts.grasp``, approaching against any direction and never from beside the object.

    Args:
        to_grasp: From link 5 to where it should be when the jaws close, shape (3,), su.
        away: Unit vector from the object to where the tool comes from.
        turn: Rotation of the tool that is left to do, radians.
        hover: Distance from the grasp at which the tool waits until it is aligned, su.
        aligned: Misalignment below which the jaws close, su.
        **kwargs: Further attributes of the target.
    """
    height = -sumprod(to_grasp, away)
    across = to_grasp + height * away
    misalignment = max(hypot(*across), 0.05 * abs(turn))
    if misalignment < aligned and abs(height) < aligned:
        return _move(to_grasp, turn, CLOSE, **kwargs)
    clearance = np.clip(3 * (misalignment - aligned), 0.0, hover)
    across *= np.clip(1.0 - (clearance - height - 0.01) / 0.02, 0.0, 1.0)
    return _move(across + (clearance - height) * away, turn, OPEN, **kwargs)


def _half_turn(angle: float, low: float) -> float:
    """The equivalent of an angle for something that looks the same after half a turn, in [low, low + pi)."""
    return (angle - low) % np.pi + low


class Scene:
    """What the expert sees, and what either arm should do about it."""

    def __init__(self, seen: Reading):
        seen = Reading(**{name: np.float64(value) for name, value in vars(seen).items()})
        self.position1, self.pitch = seen.psm1, seen.psm1_pitch
        self.position2, self.yaw = seen.psm2, seen.psm2_yaw
        self.centre = seen.ring
        # From the two points, because Euler angles of a flat ring say little.
        y = (seen.point1 - self.centre) / POINT_1[1]
        z = (seen.point2 - self.centre - POINT_2[1] * y) / POINT_2[2]
        self.axis = np.cross(y, z)
        self.flat = abs(self.axis[2]) > FLAT
        tool1 = _psm1_tool(self.pitch)
        self.grip1, self.tip1 = self.position1 + GRIP_1 * tool1, self.position1 + TIP_OFFSET * tool1
        self.held1 = self._is_held(self.grip1, seen.psm1_jaw)
        self.held2 = self._is_held(self.position2 - GRIP_2 * _Z, seen.psm2_jaw)

    def _is_held(self, grip: np.ndarray, jaw: float) -> bool:
        """Whether jaws of that opening angle hold the ring's tube."""
        offset = grip - self.centre
        along = sumprod(offset, self.axis)
        distance = hypot(hypot(*(offset - along * self.axis)) - RING_RADIUS, along)
        return distance < 0.015 and HELD_JAW[0] < jaw < HELD_JAW[1]

    def is_around_peg(self) -> bool:
        """Whether the goal's peg goes through the ring."""
        dx, dy = self.centre[:2] - GOAL[:2]
        ax, ay, az = self.axis
        if abs(az) < 0.3:
            return False
        rise = (dx * ax + dy * ay) / az  # from the centre to where the peg's axis meets the ring's plane
        return hypot(dx, dy, rise) < HOLE_RADIUS and self.centre[2] + rise < UPRIGHT_TOP

    def is_for_psm2(self) -> bool:
        """Whether PSM2 has to fetch a ring that nobody holds."""
        return self.centre[1] < (DRAWN_Y if self.flat and self.tip1_in_hole() else REACHABLE_Y)

    def tip1_in_hole(self) -> bool:
        """Whether the tips of PSM1 are in a flat ring's hole, as far as they may go when they draw it."""
        x, y, z = self.tip1 - self.centre
        return hypot(x, y) < 0.046 and z < 0.0095

    def leans(self) -> bool:
        """Whether the ring leans towards or away from PSM1, whose jaws cannot lay it flat then."""
        _, ay, az = np.abs(self.axis)
        return ay > 0.4 and az > 0.5 and self.centre[2] < 3.52

    def _way(self, target: np.ndarray) -> np.ndarray:
        """From the ring's centre towards a target: off a hanging peg and clear of the upright ones first."""
        x, y, z = self.centre
        offset = target - self.centre
        if x > HANGING_TIP_X + 0.02:
            offset[:2] *= np.clip((z - 3.56) / 0.03, 0.0, 1.0)
            return offset
        to_peg = np.array([pegs[np.abs(pegs - at).argmin()] - at for pegs, at in ((HANGING_Y, y), (HANGING_Z, z))])
        distance = hypot(*to_peg)
        if distance < HOLE_RADIUS:
            return np.array([(HANDOVER[0] - x) * np.clip((0.016 - distance) / 0.006, 0.0, 1.0), *to_peg])
        return np.array([HANDOVER[0] - x, 0.0, max(3.47 - z, 0.0)])

    # What PSM2 does.

    def fetch(self) -> Target:
        """Grasps the ring from above: a flat one at the side, a hanging one beside its peg."""
        if self.flat:
            # At +x, or at -x where an upright peg is in the way.
            blocked = 0.0 < UPRIGHT_X - self.centre[0] < 0.12 and np.abs(UPRIGHT_Y - self.centre[1]).min() < 0.045
            rim = self.centre + (-RING_RADIUS if blocked else RING_RADIUS) * _X
            to_grasp = rim + GRIP_2_FLAT * _Z - self.position2
            # Under the hanging pegs from the front.
            under_pegs = rim[0] < HANGING_TIP_X + 0.02
            if under_pegs and to_grasp[2] < -0.04:
                to_grasp[0] = max(to_grasp[0], HANGING_TIP_X + 0.06 - self.position2[0])
                return _move(to_grasp + 0.03 * _Z, -self.yaw, OPEN)
            return _grasp(to_grasp, _Z, -self.yaw, hover=0.03 if under_pegs else 0.12)
        up = _Z - self.axis[2] * self.axis
        up /= hypot(*up)
        side = np.cross(self.axis, up)
        side *= -1.0 if side[1] > 0 else 1.0
        below_pegs = self.centre[0] < HANGING_TIP_X + 0.02 and self.centre[2] < 3.55
        if below_pegs:
            # Between two of them.
            ys = [self.centre[1] + 0.554 * RING_RADIUS * sign * side[1] for sign in (1.0, -1.0)]
            side *= 1.0 if np.abs(HANGING_Y - ys[0]).min() > np.abs(HANGING_Y - ys[1]).min() else -1.0
        rim = self.centre + RING_RADIUS * (0.832 * up + 0.554 * side)
        yaw = _half_turn(heading(self.axis[1], self.axis[0]), -np.pi / 2)
        return _grasp(rim + GRIP_2 * _Z - self.position2, _Z, yaw - self.yaw, hover=0.25 if below_pegs else 0.03)

    def bring(self) -> Target:
        """Carries the ring to where it is handed over, and turns its axis into the x-z plane."""
        turn = -_half_turn(heading(self.axis[1], self.axis[0]), -np.pi / 2)
        turn *= np.clip((FLAT - abs(self.axis[2])) / 0.3, 0.0, 1.0)  # the flatter the ring, the less its direction says
        # Slowly while friction alone holds the ring.
        return _move(self._way(HANDOVER), turn, CLOSE, speed=0.25 if self.centre[2] < 3.52 else 1.0)

    def let_go(self) -> Target:
        """Opens the jaws, then leaves the ring to PSM1."""
        return _move(_STILL, jaw=OPEN) if self.held2 else self.step_aside()

    def step_aside(self) -> Target:
        """Goes up and out of PSM1's way."""
        offset = REST_2 - self.position2
        offset[:2] *= np.clip((self.position2[2] - 3.87) / 0.03, 0.0, 1.0)
        return _move(offset, jaw=OPEN)

    # What PSM1 does.

    def wait(self) -> Target:
        """Goes to where it waits for the ring, out of a ring's hole first."""
        offset = WAIT_1 - self.position1
        offset[:2] *= np.clip((self.position1[2] - 3.56) / 0.05, 0.0, 1.0)
        return _move(offset, -2 * self.pitch, CLOSE if self.position1[2] < 3.58 else OPEN, turn_speed=1.0)

    def take_over(self) -> Target:
        """Waits for PSM2 to bring the ring, then takes it."""
        if hypot(*(self.centre - HANDOVER)) > 0.06:
            turn = self._grasping_pitch() - self.pitch
            return _move(WAIT_1 - self.position1, 2 * turn, OPEN, turn_speed=1.0)
        return self.take()

    def take(self) -> Target:
        """Grasps the ring at its +y side, from there."""
        if self._is_through_ring():
            return _move(-0.06 * _psm1_tool(self.pitch), speed=0.6)
        pitch = self._grasping_pitch()
        rim = _Y - self.axis[1] * self.axis
        rim = self.centre + RING_RADIUS * rim / hypot(*rim)
        to_grasp = rim - GRIP_1 * _psm1_tool(pitch) - self.position1
        return _grasp(to_grasp, _Y, 2 * (pitch - self.pitch), hover=0.05, aligned=ALIGNED / 2, turn_speed=1.0)

    def _is_through_ring(self) -> bool:
        """Whether PSM1's gripper is through the ring, which it would take along."""
        back = -_psm1_tool(self.pitch)
        across = sumprod(back, self.axis)
        if abs(across) < 0.25:
            return False
        depth = sumprod(self.centre - self.tip1, self.axis) / across
        return 0.0 < depth < 0.1 and hypot(*(self.tip1 + depth * back - self.centre)) < HOLE_RADIUS

    def _grasping_pitch(self) -> float:
        """Pitch at which the jaws close along the ring's axis."""
        pitch = _half_turn(heading(self.axis[2], self.axis[0]), -np.pi / 3)
        return np.clip(pitch, -PITCH_LIMIT, PITCH_LIMIT)

    def put_down(self) -> Target:
        """Lays the ring flat on the way to the peg, lowers it around the peg and lets go."""
        if self.held2:
            return _move(_STILL)
        if self.is_around_peg() and self.centre[2] < RELEASE_HEIGHT:
            return self.back_off()
        pitch = _half_turn(self.pitch + heading(self.axis[0], self.axis[2]), -np.pi / 6)
        if abs(self.axis[1]) > 0.7 or pitch > np.deg2rad(125):
            return _move(_STILL, jaw=OPEN)  # cannot be laid flat like this: drops it, to begin again
        turn = min(pitch, PITCH_LIMIT) - self.pitch
        offset = GOAL - self.centre
        away = max(hypot(offset[0], offset[1]), 0.05 * abs(turn))
        offset[2] += RELEASE_HEIGHT - 0.004 - GOAL[2] + np.clip(5 * (away - 0.012), 0.0, 0.14)
        if not self.is_around_peg():
            offset = self._way(self.centre + offset)
        # Until PSM2 has left, friction alone may hold the ring.
        speed = np.clip(20 * (hypot(*(self.position2 - TIP_OFFSET * _Z - self.grip1)) - 0.075), 0.05, 0.7)
        return _move(offset, 2 * turn, CLOSE, speed=speed, turn_speed=speed)

    def back_off(self) -> Target:
        """Opens the jaws and draws them off the ring, then stays beside it."""
        offset = np.array([2.73, 0.36, 3.53]) - self.position1
        offset[[0, 2]] *= np.clip((self.position1[1] - 0.30) / 0.03, 0.0, 1.0)
        return _move(offset, jaw=OPEN)

    def draw_nearer(self) -> Target:
        """Puts the closed jaws into a flat ring's hole and draws it towards PSM2, around the goal's peg."""
        x, y, z = self.centre
        beside = x - GOAL[0]
        side = 1.0 if beside > 0 else -1.0
        if self.tip1_in_hole():
            sideways = y > GOAL[1] and abs(beside) < 0.066
            offset = np.array([0.1 * side, -0.06, 0.0]) if sideways else -0.1 * _Y
            offset = offset * np.clip((z + 0.006 - self.tip1[2]) / 0.004, 0.0, 1.0)
            offset[2] = z - 0.0005 - self.tip1[2]
            return _move(offset, -2 * self.pitch, CLOSE, speed=0.2 if sideways else 0.4)
        # Not in the middle of the hole if the gripper would meet the peg there.
        shift = side * np.clip(0.032 - abs(beside), 0.0, 0.022) if 0.04 < y < GOAL[1] + 0.01 else 0.0
        to_hole = self.centre + (shift, 0.0, -0.0005) - self.position1 - TIP_OFFSET * _psm1_tool(0.0)
        misalignment = max(hypot(to_hole[0], to_hole[1]), 0.05 * abs(self.pitch))
        # Under the hanging pegs from the front, elsewhere from above.
        under_pegs = x < HANGING_TIP_X + 0.04
        to_hole[2] += np.clip(5 * (misalignment - 0.006), 0.0, 0.05 if under_pegs else 0.12)
        if under_pegs and self.tip1[2] > z + 0.08:
            to_hole[0] = max(to_hole[0], HANGING_TIP_X + 0.06 - self.position1[0])
        return _move(to_hole, -2 * self.pitch, CLOSE, turn_speed=1.0)
