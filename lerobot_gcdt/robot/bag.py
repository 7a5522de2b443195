"""Trajectories as ROS 2 bags, as the dVRK's own replay script reads them (docs/dvrk.md#the-bag)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_gcdt.robot.base_frame import LOCAL
from lerobot_gcdt.robot.set_points import SetPoints, Trajectory
from surrol_gym.psm.kinematics import JOINT_NAMES

POSE, JOINTS = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"
"""Types of the messages."""

FIRST_STAMP = 1.0
"""Stamp of the first set-point, seconds: a stamp of 0 is invalid."""


def check_rosbags() -> None:
    """Raises RuntimeError where rosbags is not installed."""
    try:
        import rosbags.rosbag2  # noqa: F401
    except ImportError:
        raise RuntimeError(
            "A bag needs rosbags, which is not installed: `pip install 'lerobot_policy_gcdt[dvrk]'`."
        ) from None


def write_bag(trajectory: Trajectory, folder: Path) -> None:
    """Writes a bag of four topics an arm, with one message each for every set-point.

    These are, for PSM1, ``/PSM1/setpoint_cp`` and ``/PSM1/local/setpoint_cp``, the tool tip in ``Trajectory.frame`` and
    in the RCM frame, and ``/PSM1/setpoint_js`` and ``/PSM1/jaw/setpoint_js``, with velocities.

    Args:
        trajectory: The trajectory.
        folder: The folder to make.

    Raises:
        RuntimeError: rosbags is not installed.
    """
    check_rosbags()
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    stamps = np.round((FIRST_STAMP + trajectory.time) * 1e9).astype(np.int64)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topics = []
        for arm, points in trajectory.arms.items():
            for topic, kind, message in _topics(arm, points, trajectory, store.types):
                topics.append((bag.add_connection(f"/{arm}/{topic}", kind, typestore=store), kind, message))
        for index, stamp in enumerate(stamps.tolist()):
            for connection, kind, message in topics:
                bag.write(connection, stamp, store.serialize_cdr(message(index, stamp), kind))


Message = Callable[[int, int], Any]
"""Makes the message of a set-point from its index and its stamp, nanoseconds."""


def _topics(arm: str, points: SetPoints, trajectory: Trajectory, types: Any) -> list[tuple[str, str, Message]]:
    """Name, type and messages of the topics of one arm."""
    own = f"{arm}_base"

    def header(stamp: int, frame: str) -> Any:
        time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
        return types["std_msgs/msg/Header"](time, frame)

    def poses(position: np.ndarray, quaternion: np.ndarray, frame: str) -> Message:
        point, turn, pose = (types[f"geometry_msgs/msg/{name}"] for name in ("Point", "Quaternion", "Pose"))
        at, turned = position.tolist(), quaternion.tolist()
        return lambda index, stamp: types[POSE](header(stamp, frame), pose(point(*at[index]), turn(*turned[index])))

    def joints(names: list[str], values: np.ndarray) -> Message:
        velocities, nothing = np.gradient(values, 1 / trajectory.rate, axis=0), np.zeros(0)
        return lambda index, stamp: types[JOINTS](header(stamp, own), names, values[index], velocities[index], nothing)

    frame = own if trajectory.frame == LOCAL else trajectory.frame
    return [
        ("setpoint_cp", POSE, poses(*points.in_frame(points.base), frame)),
        ("local/setpoint_cp", POSE, poses(points.position, points.quaternion, own)),
        ("setpoint_js", JOINTS, joints([*JOINT_NAMES], points.joints)),
        ("jaw/setpoint_js", JOINTS, joints(["jaw"], points.jaw[:, None])),
    ]
