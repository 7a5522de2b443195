"""Real arms of a dVRK as a robot of LeRobot's, with the numbers and actions of the simulated ones."""

import time
from pkgutil import resolve_name
from typing import Any

import numpy as np
from lerobot.cameras import make_cameras_from_configs
from lerobot.robots import Robot
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected
from scipy.spatial.transform import Rotation, Slerp

from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.robot import tool_tip
from lerobot_gcdt.robot.arm_clients import ArmClient, PaperArm, connect
from lerobot_gcdt.robot.base_frame import TABLE_ORIGIN, arm_names, read_placement, simulated
from lerobot_gcdt.robot.config_dvrk_psm import DVRKPSMConfig
from lerobot_gcdt.robot.episodes import STEP
from lerobot_gcdt.robot.limits import PSM
from lerobot_gcdt.robot.names import DELTAS, POSITION, ActionReader, action_names, observation_names
from lerobot_gcdt.robot.names import arm_names as measured_names
from surrol_gym.envs.psm_env import Mount, aim
from surrol_gym.psm.arm import JAW_CLOSED, JAW_OPEN, euler_to_matrix
from surrol_gym.psm.kinematics import JOINT_NAMES
from surrol_gym.registry import env_class
from surrol_gym.units import to_metres, to_su

RATE = 100
"""Set-points a second."""

PEAK = 1.875
"""Highest speed of a minimum-jerk motion, in units of its mean."""

FOLLOWING = 0.005
"""Metres: an arm that is farther from where it was sent has not followed."""

START = 0.02
"""Metres: how far outside of its workspace an arm may be when it is connected."""


class DVRKPSM(Robot):
    """One or two real PSMs, which do what the simulated ones of a task do.

    An action moves link 5 by up to 10 mm along the world's axes, within the task's workspace, as
    ``surrol_gym.envs.psm_env.PSMEnv`` has it, from where the arm was last sent. ``send_action`` sends set-points along
    a minimum-jerk path and returns when the arm should be there, so nothing moves without the program that sends.

    Never tried on a real arm; read docs/dvrk.md first.

    Args:
        config: The configuration.

    Raises:
        OptionError: The base frame or the tracker is none.
    """

    config_class = DVRKPSMConfig
    name = "dvrk_psm"

    def __init__(self, config: DVRKPSMConfig):
        super().__init__(config)
        self.config, self._class = config, env_class(config.task)
        self._reader = ActionReader(self._class, config.away, config.delta_scale)
        self.cameras = make_cameras_from_configs(config.cameras)
        names = arm_names(len(self._class.mounts))
        try:
            placed = read_placement(config.base_frame, names) if config.base_frame else simulated(self._class.mounts)
            self._tracker = resolve_name(config.tracker) if config.tracker else None
        except (OSError, ValueError, ImportError, AttributeError) as error:
            raise OptionError(f"robot.base_frame or robot.tracker: {error}") from error
        self._arms = [
            _Arm(mount, placed.rcm[name], placed.base[name])
            for name, mount in zip(names, self._class.mounts, strict=True)
        ]
        self._names = names
        self._clients: list[ArmClient] = []

    @property
    def observation_features(self) -> dict[str, Any]:
        """The numbers that the arms measure; with a tracker all that ``surrol_psm`` has; and the cameras' pictures."""
        names = observation_names(self._class) if self._tracker else measured_names(self._class)
        pictures = {name: (camera.height, camera.width, 3) for name, camera in self.config.cameras.items()}
        return dict.fromkeys(names, float) | pictures

    @property
    def action_features(self) -> dict[str, type]:
        """As of ``surrol_psm``."""
        return dict.fromkeys(DELTAS if self.config.deltas else action_names(self._class), float)

    @property
    def is_connected(self) -> bool:
        """Whether there are arms to send to."""
        return bool(self._clients)

    @property
    def is_calibrated(self) -> bool:
        """Always: the dVRK calibrates its arms."""
        return True

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Connects to the arms, without moving them.

        Raises:
            ImportError: CRTK's Python client is not installed.
            RuntimeError: An arm does not answer, or stands far outside of the workspace of its task.
        """
        if self.config.dry_run:
            clients: list[ArmClient] = [
                PaperArm(name, arm.to_robot(np.array(arm.mount.start_position), arm.mount.start_euler))
                for name, arm in zip(self._names, self._arms, strict=True)
            ]
        else:
            clients = connect(self._names)
        try:
            for client, arm in zip(clients, self._arms, strict=True):
                arm.start(*client.measure(), client.name)
        except Exception:
            clients[0].close()
            raise
        self._clients = clients
        self._reader.reset()
        for camera in self.cameras.values():
            camera.connect()

    def calibrate(self) -> None:
        """Does nothing."""

    def configure(self) -> None:
        """Does nothing."""

    @check_if_not_connected
    def get_observation(self) -> dict[str, Any]:
        """Returns what the arms measure, in the simulated arms' units and frame, what the tracker tells, and pictures.

        Raises:
            RuntimeError: An arm measures nothing valid.
            ValueError: The tracker does not tell all that is missing.
        """
        measured = [
            number
            for client, arm in zip(self._clients, self._arms, strict=True)
            for number in arm.numbers(*client.measure())
        ]
        numbers = dict(zip(measured_names(self._class), measured, strict=True))
        if self._tracker:
            told = self._tracker({name.removesuffix(POSITION): number for name, number in numbers.items()})
            others = [name.removesuffix(POSITION) for name in observation_names(self._class)[len(numbers) :]]
            if missing := [name for name in others if name not in told]:
                raise ValueError(f"{self.config.tracker} must also return {', '.join(missing)}.")
            numbers |= {name + POSITION: float(told[name]) for name in others}
        return numbers | {name: camera.async_read() for name, camera in self.cameras.items()}

    @check_if_not_connected
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Moves the arms, and returns when the last set-point is sent.

        Args:
            action: What ``ActionReader`` reads; numbers beyond [-1, 1] are cut off there.

        Returns:
            The action, named as in ``action_names``.

        Raises:
            ValueError: It is no action of this task, or needs a joint beyond its limit; nothing was sent.
            RuntimeError: An arm did not follow the last one, or measures nothing valid; nothing was sent.
        """
        numbers = np.clip(self._reader.read(action), -1, 1).astype(np.float64)
        for client, arm in zip(self._clients, self._arms, strict=True):
            arm.check_following(*client.measure(), client.name)
        motions = [
            arm.plan(numbers[5 * i : 5 * i + 5], self._class.has_gripper, STEP / self.config.speed, self._names[i])
            for i, arm in enumerate(self._arms)
        ]
        duration = max(motion.duration for motion in motions)
        count = int(np.ceil(duration * RATE))
        begun = time.perf_counter()
        for k in range(1, count + 1):
            for client, motion in zip(self._clients, motions, strict=True):
                client.servo(*motion.at(k / count))
            time.sleep(max(k / RATE - (time.perf_counter() - begun), 0.0))
        for arm, motion in zip(self._arms, motions, strict=True):
            arm.sent = motion
        return dict(zip(action_names(self._class), numbers.tolist(), strict=True))

    @check_if_not_connected
    def disconnect(self) -> None:
        """Ends the connection; the arms stay where they are."""
        for client in self._clients:
            client.close()
        self._clients = []
        for camera in self.cameras.values():
            camera.disconnect()


class _Motion:
    """A minimum-jerk motion of one arm, between two poses of its tool tip, (4, 4), metres, and two jaw angles."""

    def __init__(self, start: np.ndarray, end: np.ndarray, jaws: tuple[float, float], duration: float):
        self.end, self.jaw, self.duration = end, jaws[1], duration
        self._positions = start[:3, 3], end[:3, 3]
        self._turn = Slerp([0, 1], Rotation.from_matrix([start[:3, :3], end[:3, :3]]))
        self._jaws = jaws

    def at(self, share: float) -> tuple[np.ndarray, float]:
        """Returns pose and jaw angle when a share of the time has passed."""
        s = share**3 * (10 - 15 * share + 6 * share**2)
        pose = np.eye(4)
        pose[:3, :3] = self._turn(min(s, 1.0)).as_matrix()
        first, last = self._positions
        pose[:3, 3] = first + s * (last - first)
        return pose, self._jaws[0] + s * (self._jaws[1] - self._jaws[0])


class _Arm:
    """Where one arm stands, and where it was last sent.

    Args:
        mount: The task's.
        rcm: Pose of its remote centre of motion in the table frame, (4, 4), metres.
        base: The same in the frame that the arm measures in.
    """

    sent: _Motion

    def __init__(self, mount: Mount, rcm: np.ndarray, base: np.ndarray):
        self.mount, self._base, self._from_rcm = mount, base, rcm
        self._limits = mount.limits()

    def to_robot(self, position: np.ndarray, euler: Any) -> np.ndarray:
        """Returns the tool tip's pose, (4, 4), metres, for position, su, and Euler angles of link 5, world frame."""
        on_table = np.eye(4)
        of_link5 = to_metres(position) - TABLE_ORIGIN, euler_to_matrix(euler)
        on_table[:3, 3], on_table[:3, :3] = tool_tip.from_link5(*of_link5)
        return self._base @ np.linalg.inv(self._from_rcm) @ on_table

    def from_robot(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns position, su, and Euler angles of link 5, world frame, of a pose of the tool tip, (4, 4), metres."""
        on_table = self._from_rcm @ np.linalg.inv(self._base) @ pose
        hinge, rotation = tool_tip.to_link5(on_table[:3, 3], on_table[:3, :3])
        return to_su(hinge + TABLE_ORIGIN), Rotation.from_matrix(rotation).as_euler("xyz")

    def start(self, pose: np.ndarray, jaw: float, name: str) -> None:
        """Takes where the arm is for where it was sent; raises RuntimeError where that is far from its workspace."""
        position, _ = self.from_robot(pose)
        low, high = self._limits + to_su([[-START], [START]])
        if (position < low).any() or (position > high).any():
            raise RuntimeError(
                f"{name} is at {np.round(to_metres(position), 3).tolist()} m in the world frame, outside of its "
                f"workspace of {np.round(to_metres(low), 3).tolist()} to {np.round(to_metres(high), 3).tolist()} m: "
                "move it there, or check robot.base_frame, and that the dVRK has the base frame that the file says."
            )
        self.sent = _Motion(pose, pose, (jaw, jaw), 0.0)

    def numbers(self, pose: np.ndarray, jaw: float) -> list[float]:
        """Returns the seven numbers of an observation."""
        position, euler = self.from_robot(pose)
        return [*position.tolist(), *euler.tolist(), jaw]

    def check_following(self, pose: np.ndarray, jaw: float, name: str) -> None:
        """Raises RuntimeError where the arm is not where it was sent."""
        off = float(np.linalg.norm(pose[:3, 3] - self.sent.end[:3, 3]))
        if off > FOLLOWING:
            raise RuntimeError(
                f"{name} is {1000 * off:.1f} mm from where it was sent, more than {1000 * FOLLOWING:g} mm: something "
                "holds or moves it. Nothing more was sent; disconnect, look, and connect again."
            )

    def plan(self, action: np.ndarray, has_gripper: bool, duration: float, name: str) -> _Motion:
        """Plans what an action asks for, at least as long as given and as its joints and jaws need."""
        start = self.sent.end
        position, euler, _ = aim(self.mount, self._limits, *self.from_robot(start), action[:3], action[3])
        end = self.to_robot(position, euler)
        jaw = JAW_CLOSED if action[4] < 0 or not has_gripper else JAW_OPEN
        now, then = self._joints(start), self._joints(end, name)
        fastest = PEAK * max(
            float(np.max(np.abs(then - now) / PSM.velocity)), abs(jaw - self.sent.jaw) / PSM.jaw_velocity
        )
        return _Motion(start, end, (self.sent.jaw, jaw), max(duration, fastest))

    def _joints(self, pose: np.ndarray, name: str = "") -> np.ndarray:
        """Joints of a pose of the tool tip; with the arm's name those beyond their limits are an error."""
        local = np.linalg.inv(self._base) @ pose
        joints = tool_tip.joints(local[:3, 3], local[:3, :3])
        for joint, value, (low, high) in zip(JOINT_NAMES, joints, PSM.joints, strict=True):
            if name and not low <= value <= high:
                raise ValueError(
                    f"{name}: the action needs {joint} = {value:.4f}, beyond its limits {low:g} to {high:g}; "
                    "nothing was sent."
                )
        return joints
