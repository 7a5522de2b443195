"""Episodes of the expert and their set-points, which nobody may change, and a dVRK that is not there.

That is CRTK's Python client, whose arms insist on what it asks for.
"""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lerobot_gcdt.robot import dvrk_psm
from lerobot_gcdt.robot.episodes import play
from lerobot_gcdt.robot.set_points import interpolate
from surrol_gym.psm import kinematics
from surrol_gym.psm.kinematics import JAW_LENGTH, TIP_AXES

TIME_OUT, JUMP, JAW_SPEED = 0.25, 0.001, 0.4
JOINTS = np.array(
    [[-1.5708, 1.5708], [-0.7854, 0.7854], [0.0, 0.240], [-4.538, 4.538], [-1.2217, 1.2217], [-1.396, 1.396]]
)


@pytest.fixture(scope="session")
def episode():
    """NeedlePick: one arm."""
    return play("NeedlePick", 3)


@pytest.fixture(scope="session")
def trajectory(episode):
    """The set-points of ``episode``."""
    return interpolate(episode)


@pytest.fixture(scope="session")
def two_arms():
    """Set-points of BiPegTransfer, 50 a second."""
    return interpolate(play("BiPegTransfer", 3), rate=50)


@pytest.fixture(autouse=True)
def _calibration(tmp_path, monkeypatch):
    """Keeps LeRobot's calibration folders out of the home folder."""
    monkeypatch.setattr("lerobot.robots.robot.HF_LEROBOT_CALIBRATION", tmp_path)
    monkeypatch.setattr("lerobot.teleoperators.teleoperator.HF_LEROBOT_CALIBRATION", tmp_path)


class Clock:
    """Time that passes by sleeping only."""

    def __init__(self):
        self.now = 100.0

    def perf_counter(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(dvrk_psm, "time", clock)
    return clock


class Frame:
    """As much of ``PyKDL.Frame`` as is used."""

    def __init__(self, rotation, vector):
        self.M, self.p = rotation, vector


class Quaternion(np.ndarray):
    """``PyKDL.Rotation``: indexed by row and column."""

    def __new__(cls, x, y, z, w):
        return Rotation.from_quat([x, y, z, w]).as_matrix().view(cls)


class Arm:
    """A ``dvrk.psm``: complains about jumps, limits, what is not finite, and commands before it is connected."""

    def __init__(self, ral, name):
        self.ral, self.name = ral, name
        self.pose, self.angle = np.eye(4), 0.0
        self.stamp, self.silent, self.stuck = 1.0, False, False
        self.times, self.jaw_times, self.sent = [], [], []
        self.jaw = SimpleNamespace(servo_jp=self._servo_jaw, measured_jp=self._measured_jaw)
        ral.arms[name] = self

    def measured_cp(self):
        return self._told(Frame(self.pose[:3, :3].copy(), self.pose[:3, 3].copy()))

    def servo_cp(self, frame):
        assert self.ral.spins, "commands before ral.spin()"
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = np.asarray(frame.M), np.asarray(frame.p)
        assert np.isfinite(pose).all()
        assert np.linalg.norm(pose[:3, 3] - self.pose[:3, 3]) < JUMP or self.stuck, "a jump"
        local = pose
        joints = kinematics.inverse(
            local[:3, 3] - JAW_LENGTH * local[:3, 2], local[:3, :3] @ TIP_AXES.T, on_limit="ignore"
        )
        assert (joints >= JOINTS[:, 0] - 1e-9).all() and (joints <= JOINTS[:, 1] + 1e-9).all(), joints
        self.times.append(self.ral.clock.now)
        self.sent.append(pose)
        if not self.stuck:
            self.pose = pose

    def _servo_jaw(self, angles):
        assert isinstance(angles, np.ndarray) and angles.shape == (1,)
        assert -0.349 <= angles[0] <= 1.396
        if self.jaw_times and self.ral.clock.now - self.jaw_times[-1] < TIME_OUT:
            speed = abs(angles[0] - self.angle) / (self.ral.clock.now - self.jaw_times[-1])
            assert speed < JAW_SPEED * 1.001, f"jaw at {speed} rad/s"
        self.jaw_times.append(self.ral.clock.now)
        self.angle = float(angles[0])

    def _measured_jaw(self):
        return self._told(np.array([self.angle]))

    def _told(self, value):
        if self.silent:
            raise TimeoutError("no message")
        return value, self.stamp


@pytest.fixture
def dvrk(monkeypatch, clock):
    """The client's modules; gives its layer over ROS, whose ``arms`` hold those that were made."""
    ral = SimpleNamespace(arms={}, spins=False, clock=clock, shut=False, place={})

    def check_connections():
        for name, arm in ral.arms.items():
            if name not in ral.place:
                raise RuntimeError(f"nobody publishes {name}/measured_cp")
            arm.pose = ral.place[name]

    def spin():
        ral.spins = True

    def shutdown():
        ral.shut = True

    ral.check_connections, ral.spin, ral.shutdown, ral.to_sec = check_connections, spin, shutdown, float
    for name, contents in {
        "crtk": {"ral": lambda node: ral},
        "dvrk": {"psm": Arm},
        "PyKDL": {"Frame": Frame, "Rotation": SimpleNamespace(Quaternion=Quaternion), "Vector": lambda *p: np.array(p)},
    }.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    return ral
