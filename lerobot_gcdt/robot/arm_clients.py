"""Arms of a dVRK as this package talks to them: through CRTK's Python client, or on paper.

dvrk_python 2.4 on crtk 1.4: what is measured comes as a pair of the value and its time stamp, and a stamp of 0 means
that it is invalid; what is older than it may be raises ``TimeoutError`` (change logs of the dVRK, 2.4.0, and of
crtk_python_client, 1.4.0). Commands go by ``servo_cp`` and ``jaw.servo_jp``, in metres and radians, in the frame that
the arm measures in.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

INSTALL = (
    "robot.type=dvrk_psm drives arms through dvrk_python 2.4 and crtk 1.4, which come with the dVRK's ROS 2 workspace "
    "and not with pip: build it as https://dvrk.readthedocs.io says, source its setup.bash and use the Python of that "
    "ROS. --robot.dry_run=true needs neither"
)


class ArmClient(Protocol):
    """One arm.

    Attributes:
        name: ``PSM1`` or ``PSM2``.
    """

    name: str

    def measure(self) -> tuple[np.ndarray, float]:
        """Returns the pose of the tool tip, (4, 4), metres, and the opening angle of the jaws, radians.

        Raises:
            RuntimeError: What was measured is invalid or too old.
        """

    def servo(self, pose: np.ndarray, jaw: float) -> None:
        """Sends a set-point: the pose of the tool tip, (4, 4), metres, and the opening angle of the jaws, radians."""

    def close(self) -> None:
        """Ends the connection."""


class CRTKArm:
    """An arm of ``dvrk_python``.

    Args:
        name: Name of the arm.
        arm: A ``dvrk.psm``.
        ral: CRTK's layer over ROS that it was made with, which ``close`` shuts down.
    """

    def __init__(self, name: str, arm: Any, ral: Any):
        self.name, self._arm, self._ral = name, arm, ral

    def measure(self) -> tuple[np.ndarray, float]:
        """See ``ArmClient.measure``."""
        frame = self._valid("measured_cp", self._arm.measured_cp)
        pose = np.eye(4)
        pose[:3, :3] = [[frame.M[row, column] for column in range(3)] for row in range(3)]
        pose[:3, 3] = [frame.p[axis] for axis in range(3)]
        return pose, float(self._valid("jaw/measured_jp", self._arm.jaw.measured_jp)[0])

    def servo(self, pose: np.ndarray, jaw: float) -> None:
        """See ``ArmClient.servo``."""
        import PyKDL

        rotation = PyKDL.Rotation.Quaternion(*Rotation.from_matrix(pose[:3, :3]).as_quat())
        self._arm.servo_cp(PyKDL.Frame(rotation, PyKDL.Vector(*pose[:3, 3])))
        self._arm.jaw.servo_jp(np.array([jaw]))

    def close(self) -> None:
        """See ``ArmClient.close``."""
        self._ral.shutdown()

    def _valid(self, what: str, measure: Any) -> Any:
        try:
            value, stamp = measure()
        except TimeoutError as error:
            raise RuntimeError(
                f"{self.name} does not report {what} any more ({error}); is the dVRK running?"
            ) from error
        seconds = stamp if isinstance(stamp, int | float) else self._ral.to_sec(stamp)
        if seconds == 0:
            raise RuntimeError(f"{self.name} reports an invalid {what} (stamp 0); is it powered and homed?")
        return value


class PaperArm:
    """An arm that is always where it was sent, and prints every so many set-points.

    Args:
        name: Name of the arm.
        pose: Pose of the tool tip at first, (4, 4), metres.
        every: How many set-points make one printed line.
    """

    def __init__(self, name: str, pose: np.ndarray, every: int = 10):
        self.name, self._pose, self._jaw, self._every, self._sent = name, pose, 0.0, every, 0

    def measure(self) -> tuple[np.ndarray, float]:
        """See ``ArmClient.measure``."""
        return self._pose, self._jaw

    def servo(self, pose: np.ndarray, jaw: float) -> None:
        """See ``ArmClient.servo``."""
        self._pose, self._jaw, self._sent = pose, jaw, self._sent + 1
        if self._sent % self._every == 0:
            x, y, z = 1000 * pose[:3, 3]
            turned = ", ".join(f"{number:.4f}" for number in Rotation.from_matrix(pose[:3, :3]).as_quat())
            print(
                f"{self.name} set-point {self._sent}: servo_cp ({x:.2f}, {y:.2f}, {z:.2f}) mm, quaternion ({turned}); "
                f"jaw/servo_jp {jaw:.3f} rad"
            )

    def close(self) -> None:
        """See ``ArmClient.close``."""
        print(f"{self.name}: {self._sent} set-points.")


def connect(names: Sequence[str]) -> list[ArmClient]:
    """Connects to arms of a running dVRK.

    Args:
        names: Names of the arms.

    Returns:
        The arms, in this order.

    Raises:
        ImportError: The Python client is not installed; says how to.
        RuntimeError: Arms do not answer.
    """
    try:
        import crtk
        import dvrk
        import PyKDL  # noqa: F401
    except ImportError as error:
        raise ImportError(f"{INSTALL} ({error}).") from error
    ral = crtk.ral("lerobot_gcdt")
    arms = [dvrk.psm(ral, name) for name in names]
    try:
        ral.check_connections()
    except Exception as error:  # of a type that the documentation does not name
        ral.shutdown()
        raise RuntimeError(
            f"{', '.join(names)} do not answer: {error}. Is the dVRK running, with these arms?"
        ) from error
    ral.spin()
    return [CRTKArm(name, arm, ral) for name, arm in zip(names, arms, strict=True)]
