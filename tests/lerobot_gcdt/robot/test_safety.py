"""Limits that are broken on purpose are found, and named with step, joint and value."""

import json
from dataclasses import replace

import numpy as np
import pytest

from lerobot_gcdt.robot.base_frame import Placement, simulated
from lerobot_gcdt.robot.limits import PSM
from lerobot_gcdt.robot.safety import check, distance_from_box, distance_of_arms
from lerobot_gcdt.robot.set_points import interpolate
from surrol_gym.psm.kinematics import JOINT_NAMES

STEP = 30
JOINTS = [(-1.5708, 1.5708), (-0.7854, 0.7854), (0, 0.240), (-4.538, 4.538), (-1.2217, 1.2217), (-1.396, 1.396)]
VELOCITY = [5, 5, 0.4, 50, 50, 50]


def change(trajectory, **changed):
    """A trajectory whose first arm has other set-points."""
    [arm, points], *others = trajectory.arms.items()
    return replace(trajectory, arms=dict([(arm, replace(points, **changed)), *others]))


def changed_joint(trajectory, joint, value, count=1):
    joints = trajectory.arms["PSM1"].joints.copy()
    start = trajectory.knots[STEP] + 1
    joints[start : start + count, joint] = value
    return change(trajectory, joints=joints)


def broken(trajectory):
    return {(found.arm, found.quantity): found for found in check(trajectory).broken}


@pytest.mark.parametrize("name", ["trajectory", "two_arms"])
def test_episodes_of_the_expert_break_no_limit(name, request):
    assert check(request.getfixturevalue(name)).broken == []


def test_the_limits_are_those_of_the_dvrks_simulator():
    assert list(PSM.joints) == JOINTS
    assert list(PSM.velocity) == VELOCITY
    assert (PSM.jaw, PSM.jaw_velocity) == ((-0.349, 1.396), 0.4)


@pytest.mark.parametrize("joint", range(6), ids=JOINT_NAMES)
@pytest.mark.parametrize("side", [0, 1], ids=["low", "high"])
def test_a_joint_past_its_range_is_named_with_step_and_value(trajectory, joint, side):
    value = JOINTS[joint][side] + (2 * side - 1) * 0.01
    found = broken(changed_joint(trajectory, joint, value))["PSM1", JOINT_NAMES[joint]]
    assert (found.steps, found.step, found.value) == ([STEP], STEP, value)
    assert f"PSM1, step {STEP} (" in found.describe() and f"{JOINT_NAMES[joint]} = {value:.4f}" in found.describe()


@pytest.mark.parametrize("joint", range(6), ids=JOINT_NAMES)
def test_a_jump_breaks_velocity_and_acceleration(trajectory, joint):
    jump = 2 * VELOCITY[joint] / trajectory.rate
    joints = trajectory.arms["PSM1"].joints.copy()
    joints[trajectory.knots[STEP] + 2 :, joint] += jump
    found = broken(change(trajectory, joints=joints))
    name = JOINT_NAMES[joint]
    assert found["PSM1", f"{name} velocity"].step == found["PSM1", f"{name} acceleration"].step == STEP
    assert found["PSM1", f"{name} velocity"].value == pytest.approx(2 * VELOCITY[joint], rel=0.1)


def test_jaws_that_are_too_fast_or_too_wide_are_found(trajectory):
    jaw = trajectory.arms["PSM1"].jaw.copy()
    at = trajectory.knots[STEP] + 1
    jaw[at:] += 0.41 / trajectory.rate
    found = broken(change(trajectory, jaw=jaw))
    assert found["PSM1", "jaw velocity"].value == pytest.approx(0.41)
    assert found["PSM1", "jaw velocity"].steps == [STEP]
    jaw[at] = 1.4
    assert broken(change(trajectory, jaw=jaw))["PSM1", "jaw"].value == 1.4


def test_a_tip_in_the_table_is_found(trajectory):
    points = trajectory.arms["PSM1"]
    height = points.in_frame(points.rcm)[0][:, 2]
    position = points.position.copy()
    lowest = int(height.argmin())
    position[lowest, 2] -= height[lowest] + 0.001  # z of the RCM frame is that of the table
    found = broken(change(trajectory, position=position))["PSM1", "height above the table"]
    assert (found.step, found.value) == (trajectory.step[lowest], pytest.approx(-0.001))


def test_an_arm_that_leaves_the_workspace_is_found(trajectory):
    position = trajectory.arms["PSM1"].position.copy()
    position[trajectory.knots[STEP]] += (0.2, 0, 0)
    found = broken(change(trajectory, position=position))
    assert {"workspace x", "workspace y"} & {quantity for _, quantity in found}


def test_a_tool_that_is_in_its_cannula_is_found(trajectory):
    found = broken(changed_joint(trajectory, 2, 0.049))["PSM1", "insertion past the cannula"]
    assert (found.low, found.value, found.step) == (0.050, 0.049, STEP)


def test_arms_that_are_too_near_are_found(two_arms):
    first, second = two_arms.arms.values()
    # PSM1 is where it is, and PSM2 does the same 9 mm beside it: shafts of 8.4 mm leave 0.6 mm, or less at a slant.
    beside = first.rcm.copy()
    beside[:3, 3] += np.array([0.009, 0.0, 0.0])
    twin = replace(first, rcm=beside, workspace=second.workspace)
    report = check(replace(two_arms, arms={"PSM1": first, "PSM2": twin}))
    [found] = [check for check in report.broken if check.arm == "PSM1-PSM2"]
    assert found.quantity == "distance"
    assert -0.003 < found.value <= 0.0006
    assert "PSM1-PSM2, step" in found.describe()


def test_an_arm_in_a_no_go_box_is_found_and_named(trajectory):
    points = trajectory.arms["PSM1"]
    tip = points.in_frame(points.rcm)[0][trajectory.knots[STEP]]
    far, here = np.array([tip + 0.5, tip + 0.6]), np.array([tip - 0.001, tip + 0.001])
    report = check(replace(trajectory, no_go=np.array([far, here])))
    [found] = report.broken
    assert (found.arm, found.quantity) == ("PSM1", "distance from no-go box 2")
    assert STEP in found.steps and found.value < 0


def test_the_shaft_counts_for_a_no_go_box_too(trajectory):
    points = trajectory.arms["PSM1"]
    rcm, tips = points.rcm[:3, 3], points.in_frame(points.rcm)[0]
    # 20 mm below the RCM, the shaft is 4.2 mm from its axis, which a box 10 mm beside is 5.8 mm from, or less.
    shaft = rcm + (tips[0] - rcm) * 0.02 / np.linalg.norm(tips[0] - rcm)
    box = np.array([shaft + (0.010, -0.001, -0.001), shaft + (0.020, 0.001, 0.001)])
    assert 0.003 < distance_from_box(points, box)[0] < 0.0065


def test_the_distance_of_arms_is_that_of_their_points(two_arms):
    first, second = two_arms.arms.values()
    shares = np.linspace(0, 1, 201)[:, None]

    def points_of(arm, index):
        tip = arm.in_frame(arm.rcm)[0][index]
        yaw, pitch, insertion = arm.joints[index, :3]
        along = (np.sin(yaw) * np.cos(pitch), -np.sin(pitch), -np.cos(yaw) * np.cos(pitch))
        wrist = arm.rcm[:3, :3] @ (np.array(along) * (insertion - 0.0156)) + arm.rcm[:3, 3]
        shaft = arm.rcm[:3, 3] + shares * (wrist - arm.rcm[:3, 3])
        return (shaft, 0.0042), (wrist + shares * (tip - wrist), 0.0025)

    expected = [
        min(
            np.linalg.norm(one[:, None] - other, axis=-1).min() - radius - other_radius
            for one, radius in points_of(first, index)
            for other, other_radius in points_of(second, index)
        )
        for index in range(0, len(first.jaw), 150)
    ]
    np.testing.assert_allclose(distance_of_arms(first, second)[::150], expected, rtol=0, atol=3e-4)


def test_an_arm_that_was_placed_too_low_is_found(episode):
    low = simulated(episode.mounts).rcm["PSM1"].copy()
    low[2, 3] = 0.02
    found = broken(interpolate(episode, Placement("table", {"PSM1": low}, {"PSM1": low})))
    assert {"yaw", "pitch"} & {quantity for _, quantity in found}


def test_a_number_that_is_none_breaks_the_limit(trajectory):
    assert ("PSM1", "yaw") in broken(changed_joint(trajectory, 0, np.nan))


def test_the_text_names_what_is_broken_and_how_far_steps_were_stretched(trajectory):
    text = check(changed_joint(trajectory, 4, 1.3)).text()
    assert f"PSM1, step {STEP} (" in text and "wrist_pitch = 1.3000 rad, limits -1.2217 and 1.2217" in text
    assert "2 of 50 steps would be too fast in 0.2 s and were stretched (steps 0, 16; in 2 of them jaws" in text
    assert "No limit is broken" not in text
    assert "No limit is broken" in check(trajectory).text()


def test_an_episode_that_fails_is_told(trajectory):
    assert "does not end in success" in check(replace(trajectory, success=False)).summary()
    assert "success" not in check(trajectory).summary()


def test_programs_read_the_same(trajectory):
    report = check(changed_joint(trajectory, 4, 1.3))
    told = json.loads(report.json())
    assert (told["task"], told["seed"], told["source"], told["safe"]) == ("NeedlePick", 3, "expert", False)
    assert told["stretched_steps"] == trajectory.stretched()
    [wrist] = [found for found in told["checks"] if found["quantity"] == "wrist_pitch"]
    assert (wrist["steps"], wrist["value"], wrist["high"]) == ([STEP], 1.3, 1.2217)
