"""The player, on a fake of the CRTK client that keeps to its contract: it knows no ROS, and moves nothing."""

import io
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lerobot_gcdt.robot.episodes import play
from lerobot_gcdt.robot.files import write_npz
from lerobot_gcdt.robot.set_points import interpolate

TIMEOUT = 0.25
"""Seconds without a command after which a dVRK ends its motion."""


@dataclass
class Frame:
    """What the player uses of PyKDL's frames."""

    M: Rotation
    p: np.ndarray

    def __mul__(self, other):
        return Frame(self.M * other.M, self.M.apply(other.p) + self.p)

    def Inverse(self):
        return Frame(self.M.inv(), -self.M.inv().apply(self.p))


def rotation(*numbers):
    return Rotation.from_matrix(np.reshape(numbers, (3, 3)))


rotation.Quaternion = lambda *numbers: Rotation.from_quat(numbers)


class Robot:
    """Two arms and what happens to them; time passes only where somebody sleeps."""

    def __init__(self):
        self.now, self.base, self.state = 100.0, Frame(Rotation.identity(), np.zeros(3)), "ENABLED"
        self.commands, self.answers, self.key_at, self.silent_from = [], ["yes", "yes"], np.inf, np.inf
        self.lost = False
        self.fault_at = self.invalid_from = self.lost_at = np.inf

    def sleep(self, seconds):
        assert seconds < TIMEOUT, "the arm would end its motion"
        self.now += seconds

    def measure(self):
        if self.now >= self.lost_at:
            raise TimeoutError("no message for 0.25 s")
        return None, 0.0 if self.now >= self.invalid_from else 1 + min(self.now, self.silent_from)

    def pressed(self):
        return self.now >= self.key_at

    def psm(self, ral, name):
        assert ral.connected is None
        send = lambda kind, value: self.commands.append((self.now, name, kind, value))  # noqa: E731

        def move(kind):
            return lambda goal: send(kind, goal) or SimpleNamespace(wait=lambda: send("arrived", None))

        def joints(kind):
            def command(goal):
                assert isinstance(goal, np.ndarray) and goal.shape == (1,)
                return move(kind)(goal)

            return command

        start = Frame(Rotation.from_euler("x", 2), np.array([0.01, 0.02, -0.1]))
        return SimpleNamespace(
            setpoint_cp=lambda: (self.base * start, 0.0 if self.lost else 1 + self.now),
            local=SimpleNamespace(setpoint_cp=lambda: (start, 1 + self.now)),
            measured_cp=self.measure,
            operating_state=lambda: "FAULT" if self.now >= self.fault_at else self.state,
            move_cp=move("move_cp"),
            servo_cp=lambda goal: send("servo_cp", goal),
            hold=lambda: send("hold", None),
            jaw=SimpleNamespace(move_jp=joints("jaw/move_jp"), servo_jp=joints("jaw/servo_jp")),
        )

    def sent(self, kind, arm="PSM1"):
        return [(now, value) for now, name, sent, value in self.commands if (name, sent) == (arm, kind)]


class Ral:
    connected = False

    def __init__(self, name):
        pass

    def check_connections(self):
        self.connected = True

    def spin(self):
        assert self.connected


@pytest.fixture
def robot(monkeypatch):
    """A robot behind the modules that the player imports, with somebody at the keyboard."""
    robot = Robot()
    for name, content in {
        "crtk": {"ral": Ral},
        "dvrk": {"psm": lambda ral, name: robot.psm(SimpleNamespace(connected=None), name)},
        "PyKDL": {"Frame": Frame, "Rotation": rotation, "Vector": lambda *numbers: np.array(numbers)},
    }.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr("time.sleep", robot.sleep)
    monkeypatch.setattr("time.monotonic", lambda: robot.now)
    monkeypatch.setattr("select.select", lambda *_: ([sys.stdin] if robot.pressed() else [], [], []))
    monkeypatch.setattr("builtins.input", lambda prompt: robot.answers.pop(0))
    return robot


@pytest.fixture(scope="module")
def trajectory():
    return interpolate(play("NeedleRegrasp", 3), rate=20)


@pytest.fixture
def file(trajectory, tmp_path):
    write_npz(trajectory, tmp_path)
    return tmp_path / "trajectory.npz"


def test_it_approaches_and_plays_all_set_points_of_both_arms(robot, file, trajectory, run_example):
    run_example("crtk_player", file, "--speed=0.5")
    for arm, points in trajectory.arms.items():
        kinds = [kind for _, name, kind, _ in robot.commands if name == arm]
        assert kinds[:4] == ["move_cp", "arrived", "jaw/move_jp", "arrived"]
        assert kinds[4:] == [*["servo_cp", "jaw/servo_jp"] * len(trajectory.time), "hold"]
        [(_, start)] = robot.sent("move_cp", arm)
        np.testing.assert_allclose(start.p, points.position[0])
        goals = [goal for _, goal in robot.sent("servo_cp", arm)]
        np.testing.assert_allclose([goal.p for goal in goals], points.position)
        turns = Rotation.concatenate([goal.M for goal in goals])
        assert (turns.inv() * Rotation.from_quat(points.quaternion)).magnitude().max() < 1e-9
        np.testing.assert_array_equal([jaw[0] for _, jaw in robot.sent("jaw/servo_jp", arm)], points.jaw)


@pytest.mark.parametrize("speed", [1, 0.5])
def test_the_speed_factor_stretches_time(robot, file, run_example, speed):
    run_example("crtk_player", file, f"--speed={speed}")
    times = [now for now, _ in robot.sent("servo_cp")]
    np.testing.assert_allclose(np.diff(times), 0.05 / speed)


def test_poses_are_sent_in_the_base_frame_that_the_robot_has(robot, file, trajectory, run_example):
    turn, shift = Rotation.from_euler("z", 1), np.array([0.1, 0.2, 0.3])
    robot.base = Frame(turn, shift)
    run_example("crtk_player", file, "--speed=0.5")
    expected = turn.apply(trajectory.arms["PSM2"].position) + shift
    np.testing.assert_allclose([goal.p for _, goal in robot.sent("servo_cp", "PSM2")], expected)


def test_an_arm_that_does_not_know_where_it_is_is_refused(robot, file, run_example):
    robot.lost = True
    with pytest.raises(SystemExit, match="no valid pose"):
        run_example("crtk_player", file, "--speed=0.5")
    assert robot.commands == []


def test_an_arm_that_is_not_enabled_is_refused(robot, file, run_example):
    robot.state = "DISABLED"
    with pytest.raises(SystemExit, match="PSM1 is DISABLED"):
        run_example("crtk_player", file, "--speed=0.5")
    assert robot.commands == []


def test_it_asks_twice(robot, file, run_example):
    robot.answers = [""]
    with pytest.raises(SystemExit, match="Nothing was moved"):
        run_example("crtk_player", file, "--speed=0.5")
    assert robot.commands == []
    robot.answers = ["yes", "no"]
    with pytest.raises(SystemExit, match="stay at the start"):
        run_example("crtk_player", file, "--speed=0.5")
    assert robot.sent("move_cp") and not robot.sent("servo_cp")


def check_stopped(robot, seconds):
    last = [(name, kind) for _, name, kind, _ in robot.commands[-2:]]
    assert last == [("PSM1", "hold"), ("PSM2", "hold")]
    assert robot.now == pytest.approx(seconds, abs=0.2)  # two set-points


def test_a_key_stops_both_arms(robot, file, run_example):
    robot.key_at = 102.0
    with pytest.raises(SystemExit, match="a key"):
        run_example("crtk_player", file, "--speed=0.5")
    check_stopped(robot, 102.0)


@pytest.mark.parametrize("trouble", ["silent_from", "invalid_from"])
def test_an_arm_that_tells_nothing_new_stops_both_arms(robot, file, run_example, trouble):
    setattr(robot, trouble, 102.0)
    with pytest.raises(SystemExit, match="PSM1 is silent"):
        run_example("crtk_player", file, "--speed=0.5")
    check_stopped(robot, 102.0 + TIMEOUT)


def test_an_arm_that_tells_nothing_from_the_start_is_not_played(robot, file, run_example):
    robot.invalid_from = 0.0
    with pytest.raises(SystemExit, match="set-point 0: PSM1 is silent"):
        run_example("crtk_player", file, "--speed=0.5")
    assert not robot.sent("servo_cp")


@pytest.mark.parametrize("error", [TimeoutError, KeyboardInterrupt])
def test_whatever_ends_the_program_stops_both_arms(robot, file, run_example, monkeypatch, error):
    def fail(*_):
        if robot.now >= 102.0:
            raise error
        return [], [], []

    monkeypatch.setattr("select.select", fail)
    with pytest.raises(error):
        run_example("crtk_player", file, "--speed=0.5")
    check_stopped(robot, 102.0)


def test_a_client_that_complains_of_old_measurements_stops_both_arms(robot, file, run_example):
    robot.lost_at = 102.0
    with pytest.raises(TimeoutError):
        run_example("crtk_player", file, "--speed=0.5")
    check_stopped(robot, 102.0)


def test_a_fault_stops_both_arms(robot, file, run_example):
    robot.fault_at = 102.0
    with pytest.raises(SystemExit, match="not enabled"):
        run_example("crtk_player", file, "--speed=0.5")
    check_stopped(robot, 102.0)


def test_a_file_that_is_not_there_is_named(run_example, capsys):
    with pytest.raises(SystemExit):
        run_example("crtk_player", "none.npz")
    assert "none.npz" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("speed", [0.4, 1.5, -1, 0], ids=["commands would time out", "too fast", "backwards", "none"])
def test_a_bad_speed_is_an_error_that_names_it(robot, file, run_example, capsys, speed):
    with pytest.raises(SystemExit):
        run_example("crtk_player", file, f"--speed={speed}")
    assert f"got {speed:g}" in capsys.readouterr().err
    assert robot.commands == []


@pytest.mark.parametrize("name", ["crtk", "dvrk", "PyKDL"])
def test_without_ros_it_says_what_to_build_and_source(robot, file, run_example, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(SystemExit, match=f"{name}.*: build the dVRK's ROS 2 workspace .* source its setup.bash"):
        run_example("crtk_player", file, "--speed=0.5")


def test_a_dry_run_needs_no_ros_and_prints_what_would_be_sent(file, trajectory, run_example, monkeypatch):
    for name in ("crtk", "dvrk", "PyKDL"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    first, *lines = run_example("crtk_player", file, "--speed=0.5", "--dry_run").splitlines()
    assert first == f"PSM1, PSM2: {len(trajectory.time)} set-points in {len(trajectory.time) / 10:.1f} s"
    assert lines[0].split()[:3] == ["0.0", "s", "PSM1"]
    assert f"{trajectory.arms['PSM1'].position[0, 2]:.4f}" in lines[0]
    seconds = [float(line.split()[0]) for line in lines if "PSM2" in line]
    assert all(after - before == pytest.approx(1, abs=0.11) for before, after in pairwise(seconds))


def test_it_is_short():
    assert len((Path(__file__).parents[2] / "examples/crtk_player.py").read_text().splitlines()) <= 80
