"""Real arms, played by a client that insists on its contract, do what the simulated ones do."""

import json
import re
import sys

import gymnasium as gym
import numpy as np
import pytest
from lerobot.robots import make_robot_from_config

import surrol_gym
from lerobot_gcdt import DVRKPSMConfig, SurRoLPSMConfig
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.robot.names import action_names

GAP = 0.25


def make(task, **options):
    return make_robot_from_config(DVRKPSMConfig(task=task, **options))


@pytest.fixture
def connected(dvrk):
    """Connects a real robot whose arms stand where the simulated ones start."""
    made = []

    def connected(task="NeedlePick", **options):
        robot = make(task, **options)
        for name, arm in zip(robot._names, robot._arms, strict=True):
            dvrk.place[name] = arm.to_robot(np.array(arm.mount.start_position), arm.mount.start_euler)
        robot.connect()
        made.append(robot)
        return robot

    yield connected
    for robot in made:
        if robot.is_connected:
            robot.disconnect()


def action(robot, *numbers):
    return dict(zip(robot.action_features, map(float, numbers), strict=True))


# The same as in simulation.


@pytest.mark.parametrize("task", ["NeedlePick", "BiPegTransfer"])
def test_names_are_those_of_the_simulated_robot(task):
    real, simulated = make(task), make_robot_from_config(SurRoLPSMConfig(task=task))
    assert real.action_features == simulated.action_features
    names = list(real.observation_features)
    assert names == list(simulated.observation_features)[: len(names)]
    assert len(names) == 7 * len(real._names)


@pytest.mark.parametrize("task", ["NeedlePick", "PegTransfer", "BiPegTransfer"])
def test_the_same_actions_lead_to_the_same_numbers(connected, task):
    real, simulated = connected(task), make_robot_from_config(SurRoLPSMConfig(task=task))
    simulated.connect()
    rng = np.random.default_rng(0)
    for _ in range(6):
        sent = action(real, *rng.uniform(-0.6, 0.6, len(real.action_features)))
        real.send_action(sent)
        simulated.send_action(sent)
        measured, expected = real.get_observation(), simulated.get_observation()
        np.testing.assert_allclose(list(measured.values()), list(expected.values())[: len(measured)], rtol=0, atol=0.01)
    simulated.disconnect()


def test_a_recorded_action_is_taken_by_the_names_of_the_dataset(connected):
    robot = connected()
    before = robot.get_observation()["psm1_z.pos"]
    env_class = type(gym.make("surrol/NeedlePick-v0").unwrapped)
    robot.send_action(dict(zip(env_class.action_names, (0, 0, 0.4, 0, -1), strict=True)))
    assert robot.get_observation()["psm1_z.pos"] - before == pytest.approx(0.4 * 0.05, abs=1e-6)
    assert len(action_names(env_class)) == 5


def test_motion_ends_at_the_workspace(connected):
    robot = connected()
    for _ in range(5):
        robot.send_action(action(robot, -1, 0, 0, 0, -1))
    assert robot.get_observation()["psm1_x.pos"] == pytest.approx(2.48, abs=1e-6)


# What the client asks for.


@pytest.mark.parametrize("speed", [1.0, 0.1])
def test_set_points_come_without_a_gap_or_a_jump(connected, dvrk, speed):
    robot = connected(speed=speed)
    robot.send_action(action(robot, 1, 1, 0.5, 1, 1))
    times = np.array(dvrk.arms["PSM1"].times)
    assert np.diff(times).max() < GAP
    assert times[-1] - times[0] >= 0.19 / speed


def test_jaws_are_given_the_time_that_they_need(connected, dvrk):
    robot = connected(speed=1.0)
    robot.send_action(action(robot, 0, 0, 0, 0, 1))
    assert dvrk.arms["PSM1"].angle == pytest.approx(np.deg2rad(40))


def test_both_arms_move_at_the_same_time(connected, dvrk):
    robot = connected("BiPegTransfer")
    robot.send_action(action(robot, *[0.3, 0, 0, 0, -1] * 2))
    assert dvrk.arms["PSM1"].times == dvrk.arms["PSM2"].times


def test_an_idle_arm_does_not_creep(connected, dvrk):
    robot = connected()
    arm = dvrk.arms["PSM1"]
    start = arm.pose.copy()
    for _ in range(3):
        arm.pose = arm.pose + np.array([[0, 0, 0, 0.0004], *np.zeros((3, 4))])  # it sags
        robot.send_action(action(robot, 0, 0, 0, 0, -1))
    np.testing.assert_allclose(arm.pose, start, atol=1e-9)


def test_an_invalid_stamp_ends_it_before_anything_is_sent(connected, dvrk):
    robot = connected()
    dvrk.arms["PSM1"].stamp = 0.0
    with pytest.raises(RuntimeError, match="PSM1.*stamp 0"):
        robot.send_action(action(robot, 1, 0, 0, 0, -1))
    assert not dvrk.arms["PSM1"].sent


def test_an_arm_that_reports_nothing_ends_it_before_anything_is_sent(connected, dvrk):
    robot = connected()
    dvrk.arms["PSM1"].silent = True
    with pytest.raises(RuntimeError, match="PSM1 does not report"):
        robot.send_action(action(robot, 1, 0, 0, 0, -1))
    assert not dvrk.arms["PSM1"].sent


def test_an_arm_that_does_not_follow_is_not_sent_further(connected, dvrk):
    robot = connected()
    dvrk.arms["PSM1"].stuck = True
    robot.send_action(action(robot, 1, 0, 0, 0, -1))
    sent = len(dvrk.arms["PSM1"].sent)
    with pytest.raises(RuntimeError, match=r"PSM1 is 10\.0 mm from where it was sent"):
        robot.send_action(action(robot, 1, 0, 0, 0, -1))
    assert len(dvrk.arms["PSM1"].sent) == sent


def test_a_joint_beyond_its_limit_is_named_and_nothing_is_sent(connected, dvrk, monkeypatch):
    robot = connected()
    narrow = ((-1.5708, 1.5708), (-0.7854, 0.7854), (0.0, 0.24), (-4.538, 4.538), (-1.2217, 1.2217), (-0.01, 0.01))
    monkeypatch.setattr("lerobot_gcdt.robot.dvrk_psm.PSM", type("Limits", (), {"joints": narrow})())
    with pytest.raises(ValueError, match=r"PSM1.*wrist_yaw = .*-0\.01 to 0\.01"):
        robot.send_action(action(robot, 1, 0, 0, 0, -1))
    assert not dvrk.arms["PSM1"].sent


def test_an_action_of_another_task_is_refused(connected, dvrk):
    robot = connected()
    with pytest.raises(ValueError, match="psm1_dyaw.vel"):
        robot.send_action({"shoulder_pan.pos": 1.0})
    assert not dvrk.arms["PSM1"].sent


# Connecting.


def test_an_arm_outside_of_its_workspace_is_not_taken(dvrk):
    robot = make("NeedlePick")
    dvrk.place["PSM1"] = robot._arms[0].to_robot(np.array([2.9, 1.0, 3.6]), robot._arms[0].mount.start_euler)
    with pytest.raises(RuntimeError, match="PSM1 is at .*0.2.* outside of its workspace"):
        robot.connect()
    assert not robot.is_connected and dvrk.shut


def test_an_arm_that_is_not_there_is_named(dvrk):
    with pytest.raises(RuntimeError, match="PSM1 do not answer: nobody publishes PSM1"):
        make("NeedlePick").connect()


def test_without_the_client_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "crtk", None)
    with pytest.raises(ImportError, match="dvrk_python 2.4 and crtk 1.4.*dvrk.readthedocs.io.*dry_run"):
        make("NeedlePick").connect()


def test_a_base_frame_is_where_the_arm_measures(connected, dvrk, tmp_path):
    frame = np.eye(4)
    frame[:3, 3] = (0.1, -0.02, 0.3)
    table = frame @ np.linalg.inv(make("NeedlePick")._arms[0]._from_rcm)
    file = tmp_path / "frames.json"
    file.write_text(json.dumps({"frame": "camera", "PSM1": frame.tolist(), "table": table.tolist()}))
    moved = make("NeedlePick", base_frame=str(file))._arms[0]
    plain = make("NeedlePick")._arms[0]
    start = np.array(plain.mount.start_position), plain.mount.start_euler
    np.testing.assert_allclose(moved.to_robot(*start), frame @ plain.to_robot(*start), atol=1e-9)
    np.testing.assert_allclose(moved.from_robot(moved.to_robot(*start))[0], start[0], atol=1e-9)


def test_a_missing_base_frame_is_an_error():
    with pytest.raises((OptionError, ValueError), match="nowhere.json"):
        make("NeedlePick", base_frame="nowhere.json")


# What arms do not measure.


def needle(arms):
    """A tracker that sees the needle below the arm, and the goal above it."""
    names = surrol_gym.registry.env_class("NeedlePick").observation_names
    told = {name: arms["psm1_z"] - 0.1 for name in names}
    return told | {f"{which}_goal.middle_{axis}": 1.5 for which in ("desired", "achieved") for axis in "xyz"}


def test_a_tracker_completes_the_observation(connected):
    robot = connected(tracker=f"{__name__}:needle")
    observation = robot.get_observation()
    assert list(observation) == list(make_robot_from_config(SurRoLPSMConfig()).observation_features)
    assert observation["needle_x.pos"] == pytest.approx(observation["psm1_z.pos"] - 0.1)
    assert observation["desired_goal.middle_x.pos"] == 1.5
    assert list(observation) == list(robot.observation_features)


def test_a_tracker_that_tells_too_little_is_told_what_is_missing(connected, monkeypatch):
    robot = connected(tracker=f"{__name__}:needle")
    monkeypatch.setattr(robot, "_tracker", lambda arms: {"needle_x": 0.0})
    with pytest.raises(ValueError, match="must also return needle_y"):
        robot.get_observation()


# On paper.


def test_a_dry_run_needs_no_client_and_prints_what_it_would_send(monkeypatch, clock, capsys):
    monkeypatch.setitem(sys.modules, "crtk", None)
    robot = make("NeedlePick", dry_run=True)
    robot.connect()
    robot.send_action(action(robot, 0, 0, 1, 0, -1))
    robot.disconnect()
    printed = capsys.readouterr().out
    heights = [float(z) for z in re.findall(r"PSM1 set-point \d+: servo_cp \(.*?, .*?, (.*?)\) mm", printed)]
    assert len(heights) == 8
    assert heights == sorted(heights)
    # The first of the printed set-points is the tenth of 80: a minimum-jerk motion has hardly begun.
    assert heights[-1] - heights[0] == pytest.approx(10.0, abs=0.3)
    assert "PSM1: 80 set-points." in printed
    assert "jaw/servo_jp 0.000 rad" in printed


def test_a_dry_run_starts_where_the_simulation_does(clock):
    real, simulated = make("NeedlePick", dry_run=True), make_robot_from_config(SurRoLPSMConfig())
    real.connect()
    simulated.connect()
    measured, expected = real.get_observation(), simulated.get_observation()
    np.testing.assert_allclose(list(measured.values()), list(expected.values())[:7], atol=1e-4)
    simulated.disconnect()
