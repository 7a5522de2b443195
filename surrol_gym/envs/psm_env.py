"""Base of the tasks: arms, their action semantics and their part of the observation."""

from dataclasses import dataclass
from math import degrees
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np

from surrol_gym.envs.goal_env import GoalEnv
from surrol_gym.envs.grasping import Grasp
from surrol_gym.psm.arm import DOWN, JAW_CLOSED, JAW_OPEN, Arm, euler_to_matrix
from surrol_gym.psm.kinematics import JAW_LENGTH, RCM_OFFSET
from surrol_gym.quantities import RPY, Quantity, euler, point
from surrol_gym.units import to_metres, to_su

STEP_SIZE = 0.05
"""Motion of a full action along one axis, su."""

YAW, PITCH = 2, 1
"""Index of the Euler angle that an action turns."""

_PADDING = np.array([[-0.02, 0.02], [-0.02, 0.02], [0.0, 0.08]])  # su


@dataclass(frozen=True)
class Mount:
    """One arm of a task: where it stands, where it starts and how it moves (docs/psm.md#start-poses, docs/actions.md).

    Attributes:
        start_position: Position of link 5 at reset, su, world frame.
        start_euler: Its orientation at reset, fixed-axis x-y-z Euler angles, radians.
        euler: Orientation of the tool; the angle ``turns`` is controlled, the two others are fixed.
        turns: ``YAW`` turns the tool about the vertical, ``PITCH`` about its second Euler angle.
        turn_step: Turn of a full action, radians; 0 keeps the orientation.
        workspace: Limits of the tips along x, y and z, metres, shape (3, 2).
        base_position: Position of the base, metres, world frame.
        base_yaw: Rotation of the base about z, radians.
        look: URDF that pictures show.
    """

    start_position: tuple[float, float, float]
    start_euler: tuple[float, float, float] = tuple(DOWN)
    euler: tuple[float, float, float] = tuple(DOWN)
    turns: int = YAW
    turn_step: float = np.deg2rad(30)
    workspace: tuple[tuple[float, float], ...] = ((0.50, 0.60), (-0.05, 0.05), (0.675, 0.745))
    base_position: tuple[float, float, float] = (0.05, 0.24, 0.8524)
    base_yaw: float = np.deg2rad(-110)
    look: str = "psm.urdf"

    def limits(self) -> np.ndarray:
        """Returns the lowest and the highest position of link 5, shape (2, 3), su: workspaces are those of the tips."""
        return (to_su(np.array(self.workspace) + [[0.0], [0.0], [JAW_LENGTH]]) + _PADDING).T

    def rcm(self) -> np.ndarray:
        """Returns the pose of the arm's remote centre of motion, a (4, 4) matrix, metres, world frame."""
        pose = np.eye(4)
        pose[:3, :3] = euler_to_matrix((0, 0, self.base_yaw))
        pose[:3, 3] = self.base_position + RCM_OFFSET * pose[:3, 1]
        return pose

    def tool_direction(self) -> np.ndarray:
        """Returns where the jaws point, a unit vector, world frame; turning the tool does not change it."""
        return euler_to_matrix(self.euler)[:, 1]


def psm2(**kwargs: Any) -> Mount:
    """Returns the mount of the second arm, on the other side of the table."""
    return Mount(base_position=(0.05, -0.24, 0.8524), base_yaw=np.deg2rad(-70), look="psm2.urdf", **kwargs)


def robot_state(arms: int = 1) -> tuple[Quantity, ...]:
    """Describes the seven numbers of each arm, with which every observation begins."""
    quantities = []
    for arm in range(1, arms + 1):
        of = _of(arm, arms)
        quantities += [
            point(f"psm{arm}", f"position of link 5{of}"),
            euler(f"psm{arm}", f"fixed-axis x-y-z Euler angles of link 5{of}"),
            Quantity(f"psm{arm}_jaw", f"opening angle of the jaws{of}", unit="rad"),
        ]
    return tuple(quantities)


def _actions(mounts: tuple[Mount, ...], has_gripper: bool) -> tuple[Quantity, ...]:
    """Describes the five numbers of each arm in an action."""
    step = f"{STEP_SIZE} su ({1000 * to_metres(STEP_SIZE):g} mm)"
    jaws = f"negative closes them, 0 and above opens them to {degrees(JAW_OPEN):g} degrees"
    quantities = []
    for arm, mount in enumerate(mounts, 1):
        of = _of(arm, len(mounts))
        about = "about the vertical" if mount.turns == YAW else "about itself, its pitch within [-90, 90] degrees"
        turn = f"{degrees(mount.turn_step):g} degrees" if mount.turn_step else "none in this task"
        quantities += [
            Quantity(f"psm{arm}", f"motion of link 5{of} along world x, y, z", ("dx", "dy", "dz"), step),
            Quantity(f"psm{arm}_d{RPY[mount.turns]}", f"turn of the tool{of} {about}", unit=turn),
            Quantity(f"psm{arm}_gripper", f"jaws{of}: {jaws if has_gripper else 'they stay closed in this task'}"),
        ]
    return tuple(quantities)


def _of(arm: int, arms: int) -> str:
    """How tables say of which arm they speak."""
    return f" of PSM{arm}" if arms > 1 else ""


class PSMEnv(GoalEnv):
    """A task with one or two PSMs.

    An action holds five numbers in [-1, 1] for each arm, ``(dx, dy, dz, turn, gripper)``: the first three move link 5
    by up to 0.05 su along the world's axes from where it is measured, within the workspace; the fourth turns the tool;
    a negative gripper closes the jaws, any other opens them to 40 degrees (docs/actions.md#what-an-action-does).
    """

    mounts: ClassVar[tuple[Mount, ...]] = ()
    """The arms."""
    has_gripper = True
    """Whether actions move the jaws; otherwise they stay closed."""
    jaw_mass = 0.03
    """Mass of each jaw, kg (docs/psm.md#mass-of-the-jaws): light ones do not press themselves into light objects, while
    between heavy ones flat objects swing less."""

    def __init_subclass__(cls, **kwargs: Any):
        cls.action_quantities = _actions(cls.mounts, cls.has_gripper)
        super().__init_subclass__(**kwargs)

    @classmethod
    def _describe_actions(cls) -> str:
        told = [super()._describe_actions(), ""]
        for arm, mount in enumerate(cls.mounts, 1):
            ranges = zip("xyz", *mount.limits(), strict=True)
            within = ", ".join(f"{axis} [{low:g}, {high:g}]" for axis, low, high in ranges)
            told.append(f"Link 5{_of(arm, len(cls.mounts))} stays within {within}.")
        return "\n".join(told)

    def _build_scene(self) -> None:
        self.arms = [
            Arm(self.world, mount.base_position, mount.base_yaw, mount.look, self.jaw_mass) for mount in self.mounts
        ]
        self.grasps: list[list[Grasp]] = [[] for _ in self.mounts]
        """For each arm the grasps that its jaws may take."""
        self._limits = [mount.limits() for mount in self.mounts]

    def _pose_scene(self) -> None:
        for grasp in self._all_grasps():
            grasp.reset()
        for arm, mount in zip(self.arms, self.mounts, strict=True):
            arm.reset(mount.start_position, mount.start_euler)

    def _apply_action(self, action: np.ndarray) -> bool:
        clipped = False
        for index, (arm, mount) in enumerate(zip(self.arms, self.mounts, strict=True)):
            dx_dy_dz, turn, gripper = action[5 * index : 5 * index + 3], action[5 * index + 3], action[5 * index + 4]
            target, euler, cut = aim(mount, self._limits[index], *arm.pose(), dx_dy_dz, turn)
            clipped |= cut
            arm.move_to(target, euler)
            closing = gripper < 0 or not self.has_gripper
            for grasp in self.grasps[index]:
                grasp.before_step(closing)
            arm.command_jaws(JAW_CLOSED if closing else JAW_OPEN)
        return clipped

    def _after_sub_steps(self) -> None:
        for arm in self.arms:
            arm.sense()
        for grasp in self._all_grasps():
            grasp.after_step()

    def _contact_force(self) -> float:
        return sum(arm.contact_force for arm in self.arms)

    def _robot_state(self) -> np.ndarray:
        """Pose of link 5 and opening angle of the jaws of each arm, shape (7 * arms,)."""
        return np.concatenate([part for arm in self.arms for part in (*arm.pose(), (arm.jaw_angle(),))])

    def _robot_and_object(self, position: np.ndarray, *waypoints: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """The usual observation: the arms, an object, where it is from link 5 of each arm, poses on the object."""
        robot = self._robot_state()
        relative = [position - robot[start : start + 3] for start in range(0, len(robot), 7)]
        return np.concatenate([robot, position, *relative, *(part for waypoint in waypoints for part in waypoint)])

    def _all_grasps(self) -> list[Grasp]:
        return [grasp for grasps in self.grasps for grasp in grasps]

    def _get_task_state(self) -> dict[str, Any]:
        return super()._get_task_state() | {
            "arms": [arm.get_state() for arm in self.arms],
            "grasps": [grasp.get_state() for grasp in self._all_grasps()],
        }

    def _set_task_state(self, state: dict[str, Any]) -> None:
        super()._set_task_state(state)
        for arm, arm_state in zip(self.arms, state["arms"], strict=True):
            arm.set_state(arm_state)
        for grasp, grasp_state in zip(self._all_grasps(), state["grasps"], strict=True):
            grasp.set_state(grasp_state)


def unwrapped(env: gym.Env) -> PSMEnv:
    """Returns the environment of a task without its wrappers.

    Raises:
        TypeError: It is none of this package's kind.
    """
    task = env.unwrapped
    if not isinstance(task, PSMEnv):
        raise TypeError(f"{env} is no environment of surrol_gym.")
    return task


def aim(
    mount: Mount, limits: np.ndarray, position: np.ndarray, euler: np.ndarray, dx_dy_dz: np.ndarray, turn: float
) -> tuple[np.ndarray, list[float], bool]:
    """Computes where an action sends an arm (docs/actions.md#what-an-action-does).

    Args:
        mount: The arm.
        limits: What its ``limits`` returns.
        position: Where its link 5 is, shape (3,), su, world frame.
        euler: The orientation of link 5, radians, shape (3,).
        dx_dy_dz: The action's motion, shape (3,).
        turn: The action's turn.

    Returns:
        Position and Euler angles that link 5 is sent to, and whether the limits cut the motion off.
    """
    wanted = position + STEP_SIZE * dx_dy_dz
    low, high = limits
    target = np.minimum(np.maximum(wanted, low), high)  # faster than np.clip
    orientation = _turned(mount, euler[mount.turns] + mount.turn_step * turn)
    return target, orientation, bool((wanted != target).any())


def _turned(mount: Mount, angle: float) -> list[float]:
    """The orientation of a tool whose controlled Euler angle is ``angle``."""
    euler = list(mount.euler)
    euler[mount.turns] = angle if mount.turns == YAW else np.clip(angle, -np.pi / 2, np.pi / 2)
    return euler
