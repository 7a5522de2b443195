"""The safety report: everything that a trajectory asks of the arms, against its limit."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from lerobot_gcdt.robot import tool_tip
from lerobot_gcdt.robot.episodes import STEP
from lerobot_gcdt.robot.limits import PSM, Limits
from lerobot_gcdt.robot.set_points import SetPoints, Trajectory
from surrol_gym.psm.kinematics import INSERTION_OFFSET, JOINT_NAMES

SHAFT_RADIUS, GRIPPER_RADIUS = 0.0042, 0.0025
"""Of the instrument's shaft, and of its wrist with the jaws shut, metres (docs/dvrk.md#limits)."""

POINTS = 81
"""Points of a shaft that are held against a no-go box: at most 3 mm apart."""

ROUNDING = 1e-6
"""What a quantity may be beyond its limit: a micrometre, a microradian."""

INSERTION = JOINT_NAMES.index("insertion")


@dataclass(frozen=True)
class Check:
    """One quantity of one arm, over a whole trajectory.

    Attributes:
        arm: The arm, or the pair of arms.
        quantity: What was looked at.
        unit: Its unit.
        low: Its lower limit; None for none.
        high: Its upper limit; None for none.
        lowest: The lowest value.
        highest: The highest value.
        steps: The steps of the episode in which it is beyond a limit.
        step: The step in which it comes nearest to a limit, or is farthest beyond it.
        time: When, seconds.
        value: Its value then.
    """

    arm: str
    quantity: str
    unit: str
    low: float | None
    high: float | None
    lowest: float
    highest: float
    steps: list[int]
    step: int
    time: float
    value: float

    def describe(self) -> str:
        """Says where a limit is broken, and by what."""
        low, high = ("none" if limit is None else f"{limit:g}" for limit in (self.low, self.high))
        others = f", and in {len(self.steps) - 1} further steps" if len(self.steps) > 1 else ""
        return (
            f"{self.arm}, step {self.step} ({self.time:.3f} s): {self.quantity} = {self.value:.4f} {self.unit}, limits "
            f"{low} and {high}{others}"
        )


@dataclass(frozen=True)
class Report:
    """What a trajectory asks of the arms.

    Attributes:
        trajectory: The trajectory.
        limits: The limits that it was held against.
        checks: Every quantity.
    """

    trajectory: Trajectory
    limits: Limits
    checks: list[Check]

    @property
    def broken(self) -> list[Check]:
        """The checks whose limits are broken."""
        return [check for check in self.checks if check.steps]

    def summary(self) -> str:
        """Returns what there is to know in a few lines."""
        lines = [self._headline(), self._stretch()]
        if self.broken:
            lines += ["Limits are broken:", *(f"  {check.describe()}" for check in self.broken)]
        else:
            lines.append("No limit is broken.")
        if not self.trajectory.success:
            lines.append("In the simulator the episode does not end in success.")
        return "\n".join(lines)

    def text(self) -> str:
        """Returns the report for reading: the summary and a table of all checks."""
        lines = [self.summary(), ""]
        lines.append(f"{'':10}{'':36}{'lowest':>10}{'highest':>10}{'limits':>20}")
        for check in self.checks:
            low, high = ("" if limit is None else f"{limit:.4g}" for limit in (check.low, check.high))
            lines.append(
                f"{check.arm:10}{check.quantity + ', ' + check.unit:36}{check.lowest:10.4f}{check.highest:10.4f}"
                f"{low + ' to ' + high:>20}{'  BROKEN' if check.steps else ''}"
            )
        return "\n".join(lines) + "\n"

    def json(self) -> str:
        """Returns the report for programs."""
        trajectory = self.trajectory
        told = {name: getattr(trajectory, name) for name in ("task", "seed", "source", "success", "rate", "frame")}
        told |= {"seconds": float(trajectory.time[-1]), "stretched_steps": trajectory.stretched()}
        told |= {"safe": not self.broken, "limits": asdict(self.limits), "checks": [asdict(c) for c in self.checks]}
        return json.dumps(told, indent=1) + "\n"

    def _headline(self) -> str:
        trajectory = self.trajectory
        return (
            f"{trajectory.task}, seed {trajectory.seed}, {trajectory.source}: {len(trajectory.time)} set-points for "
            f"each of {', '.join(trajectory.arms)}, {trajectory.rate:g} a second, {trajectory.time[-1]:.2f} s"
        )

    def _stretch(self) -> str:
        trajectory = self.trajectory
        steps, stretched = len(trajectory.knots) - 1, trajectory.stretched()
        if not stretched:
            return f"All {steps} steps take {STEP:g} s, as in the simulator."
        moves = [np.diff(arm.jaw[trajectory.knots])[stretched] != 0 for arm in trajectory.arms.values()]
        return (
            f"{len(stretched)} of {steps} steps would be too fast in {STEP:g} s and were stretched (steps "
            f"{', '.join(map(str, stretched))}; in {np.any(moves, axis=0).sum()} of them jaws open or close). In the "
            f"simulator the episode takes {steps * STEP:g} s."
        )


def check(trajectory: Trajectory, limits: Limits = PSM) -> Report:
    """Holds a trajectory against the limits.

    Args:
        trajectory: The trajectory.
        limits: The limits.

    Returns:
        The report. Whoever sends the trajectory somewhere has to look at ``Report.broken``.
    """
    checks = []
    for arm, set_points in trajectory.arms.items():
        checks += [_held(trajectory, arm, *quantity) for quantity in _quantities(set_points, trajectory.rate, limits)]
        for number, box in enumerate(trajectory.no_go, 1):
            name = f"distance from no-go box {number}"
            checks.append(_held(trajectory, arm, name, "m", distance_from_box(set_points, box), limits.arms, None))
    for (one, first), (other, second) in combinations(trajectory.arms.items(), 2):
        distance = distance_of_arms(first, second)
        checks.append(_held(trajectory, f"{one}-{other}", "distance", "m", distance, limits.arms, None))
    return Report(trajectory, limits, checks)


def speeds(values: np.ndarray, rate: float) -> np.ndarray:
    """Returns how fast values change on the way to each set-point, from rest. Shape of ``values``."""
    return np.diff(values, axis=0, prepend=values[:1]) * rate


def accelerations(values: np.ndarray, rate: float) -> np.ndarray:
    """Returns how fast the speed changes at each set-point, from rest and to rest. Shape of ``values``."""
    return np.diff(speeds(values, rate), axis=0, append=np.zeros_like(values[:1])) * rate


def height_of_tip(set_points: SetPoints) -> np.ndarray:
    """Returns how high the jaw tips are above the table, metres, (N,)."""
    return set_points.in_frame(set_points.rcm)[0][:, 2]


def distance_of_arms(first: SetPoints, second: SetPoints) -> np.ndarray:
    """Returns the distance between the surfaces of two arms' shafts and grippers, metres, (N,)."""
    distances = [
        _distance_of_segments(*one, *other) - radius - other_radius
        for *one, radius in _capsules(first)
        for *other, other_radius in _capsules(second)
    ]
    return np.min(distances, axis=0)


def distance_from_box(arm: SetPoints, box: np.ndarray) -> np.ndarray:
    """Returns the distance of an arm's shaft and gripper from a box, looked at every few millimetres.

    Args:
        arm: The set-points of the arm.
        box: Its lowest and highest corner in the table frame, (2, 3), metres.

    Returns:
        Distances, metres, (N,), negative inside of the box.
    """
    centre, half = box.mean(axis=0), np.ptp(box, axis=0) / 2
    distances = []
    for start, end, radius in _capsules(arm):
        for share in np.linspace(0, 1, POINTS):
            beyond = np.abs(start + share * (end - start) - centre) - half
            outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
            distances.append(outside + np.minimum(beyond.max(axis=-1), 0) - radius)
    return np.min(distances, axis=0)


Quantity = tuple[str, str, np.ndarray, float | None, float | None]
"""Name, unit, values (N,), and the limits."""


def _quantities(arm: SetPoints, rate: float, limits: Limits) -> Iterator[Quantity]:
    velocity, acceleration = speeds(arm.joints, rate), accelerations(arm.joints, rate)
    for number, name in enumerate(JOINT_NAMES):
        unit = "m" if number == INSERTION else "rad"
        yield name, unit, arm.joints[:, number], *limits.joints[number]
        for kind, power, values, most in (
            ("velocity", "", velocity, limits.velocity),
            ("acceleration", "2", acceleration, limits.acceleration),
        ):
            yield f"{name} {kind}", f"{unit}/s{power}", values[:, number], -most[number], most[number]
    yield "jaw", "rad", arm.jaw, *limits.jaw
    yield "jaw velocity", "rad/s", speeds(arm.jaw, rate), -limits.jaw_velocity, limits.jaw_velocity
    strongest = limits.jaw_acceleration
    yield "jaw acceleration", "rad/s2", accelerations(arm.jaw, rate), -strongest, strongest
    yield "insertion past the cannula", "m", arm.joints[:, INSERTION], limits.insertion, None
    yield "height above the table", "m", height_of_tip(arm), limits.table, None
    hinge = _hinge(arm, arm.rcm)
    for axis, values, low, high in zip("xyz", hinge.T, *arm.workspace, strict=True):
        yield f"workspace {axis}", "m", values, low, high


def _held(
    trajectory: Trajectory, arm: str, name: str, unit: str, values: np.ndarray, low: float | None, high: float | None
) -> Check:
    floor, ceiling = -np.inf if low is None else low, np.inf if high is None else high
    beyond = np.where(np.isfinite(values), np.maximum(floor - values, values - ceiling), np.inf)
    worst = int(beyond.argmax())
    broken = np.unique(trajectory.step[beyond > ROUNDING])
    return Check(
        arm,
        name,
        unit,
        None if low is None else float(low),
        None if high is None else float(high),
        float(values.min()),
        float(values.max()),
        broken.tolist(),
        int(trajectory.step[worst]),
        float(trajectory.time[worst]),
        float(values[worst]),
    )


def _hinge(arm: SetPoints, frame: np.ndarray) -> np.ndarray:
    """Positions of link 5, (N, 3), in a frame in which the RCM has the pose ``frame``."""
    position, quaternion = arm.in_frame(frame)
    return tool_tip.to_link5(position, Rotation.from_quat(quaternion).as_matrix())[0]


def _capsules(arm: SetPoints) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Shaft and gripper as segments in the table frame, each with its radius: from the RCM to the wrist, on to the tip.

    The shaft's end is found from the joints, since it does not follow from the tip alone.
    """
    tip, _ = arm.in_frame(arm.rcm)
    yaw, pitch, insertion = arm.joints[:, :3].T
    along = np.stack([np.sin(yaw) * np.cos(pitch), -np.sin(pitch), -np.cos(yaw) * np.cos(pitch)], axis=-1)
    wrist = ((insertion - INSERTION_OFFSET)[:, None] * along) @ arm.rcm[:3, :3].T + arm.rcm[:3, 3]
    yield np.broadcast_to(arm.rcm[:3, 3], wrist.shape), wrist, SHAFT_RADIUS
    yield wrist, tip, GRIPPER_RADIUS


def _distance_of_segments(start: np.ndarray, end: np.ndarray, start2: np.ndarray, end2: np.ndarray) -> np.ndarray:
    """Distances between pairs of segments, whose ends have the shape (N, 3): the nearest points of both lines, clamped
    to one segment after the other."""
    first, second, between = end - start, end2 - start2, start - start2
    a, e, f = (np.sum(u * v, axis=-1) for u, v in ((first, first), (second, second), (second, between)))
    b, c = (np.sum(u * v, axis=-1) for u, v in ((first, second), (first, between)))
    parallel = a * e - b * b
    s = np.clip(np.where(parallel > 1e-12, (b * f - c * e) / np.where(parallel > 1e-12, parallel, 1), 0), 0, 1)
    t = np.clip((b * s + f) / e, 0, 1)
    s = np.clip((b * t - c) / a, 0, 1)
    return np.linalg.norm(between + s[:, None] * first - t[:, None] * second, axis=-1)
