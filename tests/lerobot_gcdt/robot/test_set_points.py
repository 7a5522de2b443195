from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lerobot_gcdt.robot.base_frame import TABLE_ORIGIN, Placement, simulated
from lerobot_gcdt.robot.limits import Limits
from lerobot_gcdt.robot.set_points import interpolate
from surrol_gym.psm import kinematics

ROLL = 3
NO_HURRY = Limits(jaw_velocity=100.0)


def on_table(points):
    return points.in_frame(points.rcm)[0]


def test_at_the_knots_the_joints_are_those_that_the_simulator_sent(episode, trajectory):
    np.testing.assert_allclose(trajectory.arms["PSM1"].joints[trajectory.knots], episode.joints[:, 0], atol=1e-9)
    np.testing.assert_array_equal(trajectory.arms["PSM1"].jaw[trajectory.knots], episode.jaws[:, 0])


@pytest.mark.parametrize("name", ["trajectory", "two_arms"])
def test_cartesian_and_joint_set_points_agree_through_the_kinematics(name, request):
    for points in request.getfixturevalue(name).arms.values():
        hinge, rotation = kinematics.forward(points.joints)
        # The tip lies 10.2 mm along y of link 5; its z axis points there, and its y axis along the hinge of the jaws.
        np.testing.assert_allclose(points.position, hinge + 0.0102 * rotation[..., 1], rtol=0, atol=1e-6)
        tip = Rotation.from_quat(points.quaternion).as_matrix()
        np.testing.assert_allclose(tip[..., 2], rotation[..., 1], rtol=0, atol=1e-6)
        np.testing.assert_allclose(tip[..., 0], -rotation[..., 2], rtol=0, atol=1e-6)
        np.testing.assert_allclose(tip[..., 1], -rotation[..., 0], rtol=0, atol=1e-6)


def test_positions_are_the_measured_ones_in_metres(episode, trajectory):
    tips = on_table(trajectory.arms["PSM1"])[trajectory.knots] + TABLE_ORIGIN
    # The arm does 0.9936 of each motion of at most 17 mm.
    np.testing.assert_allclose(tips, episode.tips[:, 0], rtol=0, atol=2e-4)
    assert np.ptp(tips, axis=0).max() > 0.03


def test_between_two_knots_the_tip_never_leaves_what_lies_between_them(trajectory):
    tips, knots = on_table(trajectory.arms["PSM1"]), trajectory.knots
    for start, end in zip(knots[:-1], knots[1:], strict=True):
        low, high = np.minimum(tips[start], tips[end]), np.maximum(tips[start], tips[end])
        assert (tips[start:end] >= low - 1e-9).all() and (tips[start:end] <= high + 1e-9).all()


def test_the_motion_begins_and_ends_at_rest(trajectory):
    tips = on_table(trajectory.arms["PSM1"])
    fastest = np.linalg.norm(np.diff(tips, axis=0), axis=-1).max()
    assert np.linalg.norm(tips[1] - tips[0]) < 0.02 * fastest
    assert np.linalg.norm(tips[-1] - tips[-2]) < 0.02 * fastest


@pytest.mark.parametrize("name", ["trajectory", "two_arms"])
def test_steps_are_stretched_until_nothing_is_too_fast(name, request):
    found = request.getfixturevalue(name)
    limits = Limits()
    for points in found.arms.values():
        assert (np.abs(np.diff(points.joints, axis=0)) * found.rate <= limits.velocity).all()
        assert np.abs(np.diff(points.jaw)).max() * found.rate <= limits.jaw_velocity
    stretched = found.stretched()
    moved = [np.diff(points.jaw[found.knots]) != 0 for points in found.arms.values()]
    assert stretched == np.flatnonzero(np.any(moved, axis=0)).tolist()
    # Opening by 0.698 rad at 0.4 rad/s takes 1.745 s, one and a half times as long from rest to rest.
    assert np.diff(found.knots)[stretched] / found.rate == pytest.approx(2.64, abs=0.03)


def test_steps_that_are_slow_enough_take_what_they_take_in_the_simulator(episode):
    found = interpolate(episode, limits=NO_HURRY)
    assert found.stretched() == []
    assert found.time[-1] == pytest.approx(10)
    assert found.step[[0, 1, 40, 41, -1]].tolist() == [0, 0, 0, 1, 49]


@pytest.mark.parametrize(("rate", "seconds"), [(5, 10), (7, 50 * 2 / 7), (1000, 10)])
def test_a_step_is_a_whole_number_of_set_points(episode, rate, seconds):
    found = interpolate(episode, rate=rate, limits=NO_HURRY)
    assert found.time[-1] == pytest.approx(seconds)
    np.testing.assert_allclose(found.arms["PSM1"].joints[found.knots], episode.joints[:, 0], atol=1e-9)


def test_a_rate_below_one_set_point_a_step_is_an_error_that_names_it(episode):
    with pytest.raises(ValueError, match="at least 5 .* got 4"):
        interpolate(episode, rate=4)


def test_a_tool_that_turns_more_than_once_does_not_jump(episode):
    joints = np.tile(episode.joints[:1], (len(episode.joints), 1, 1))
    joints[..., ROLL] = np.linspace(-4.4, 4.4, len(joints))[:, None]
    roll = interpolate(replace(episode, joints=joints)).arms["PSM1"].joints[:, ROLL]
    assert (np.diff(roll) >= -1e-9).all()
    assert roll[[0, -1]] == pytest.approx([-4.4, 4.4])


def test_quaternions_do_not_change_their_sign(two_arms):
    for points in two_arms.arms.values():
        assert (np.sum(points.quaternion[1:] * points.quaternion[:-1], axis=-1) > 0.99).all()


def test_where_the_arms_stand_changes_the_joints_and_not_what_the_tips_do(episode, trajectory):
    moved = simulated(episode.mounts).rcm["PSM1"].copy()
    moved[:3, :3] = Rotation.from_euler("z", -90, degrees=True).as_matrix()
    moved[:3, 3] += (0.01, 0.02, 0.03)
    found = interpolate(episode, Placement("camera", {"PSM1": moved}, {"PSM1": np.eye(4)})).arms["PSM1"]
    expected = trajectory.arms["PSM1"]
    np.testing.assert_allclose(on_table(found), on_table(expected), rtol=0, atol=1e-12)
    assert np.abs(found.joints - expected.joints).max() > 0.1
    hinge, rotation = kinematics.forward(found.joints)
    np.testing.assert_allclose(found.position, hinge + 0.0102 * rotation[..., 1], rtol=0, atol=1e-6)
