import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surrol_gym.psm.kinematics import (
    INSERTION_OFFSET,
    JOINT_LIMITS,
    JOINT_NAMES,
    JointLimitError,
    forward,
    inverse,
)

INSERTION, ROLL, WRIST_PITCH = 2, 3, 4

# RCM point, metres, and yaw of the base, degrees (docs/psm.md#where-the-arms-stand).
PSM1 = ((0.507066, 0.073641, 0.8524), -110)
PSM2 = ((0.507066, -0.073641, 0.8524), -70)
BOARD_PSM1 = ((0.507066, 0.083641, 0.8224), -110)
BOARD_PSM2 = ((0.507066, -0.093641, 0.8524), -70)

DOWN, FORWARD, LEFT, BOARD_DOWN = (-90, 0, 90), (0, -90, -90), (0, 0, -180), (-90, 0, 0)
# Arm, position of link 5 (su), Euler angles (degrees) and joints of every start (docs/psm.md#start-poses).
STARTS = [
    (PSM1, (2.5, 0.25, 3.776), DOWN, (0.2505, -0.0078, 0.1068, -0.3388, -0.0776, -0.2386)),
    (PSM1, (2.5, 0.25, 3.601), DOWN, (0.1855, -0.0072, 0.1410, -0.3434, -0.0564, -0.1770)),
    (PSM2, (2.5, -0.25, 3.776), DOWN, (-0.2505, -0.0078, 0.1068, 0.3388, -0.0776, 0.2386)),
    (PSM1, (2.4, 0.125, 3.626), DOWN, (0.4123, 0.0763, 0.1455, -0.3261, -0.2098, -0.3652)),
    (PSM1, (2.875, 0.225, 3.651), FORWARD, (0.0454, -0.5459, 0.1494, 1.2906, 0.2157, -1.0634)),
    (PSM2, (2.875, -0.225, 3.651), FORWARD, (-0.0454, -0.5459, 0.1494, 1.8510, -0.2157, -1.0634)),
    (BOARD_PSM1, (2.35, 0.25, 3.976), LEFT, (0.9269, 0.3986, 0.0648, -1.2873, 0.5862, 0.8338)),
    (BOARD_PSM2, (2.35, -0.375, 3.976), BOARD_DOWN, (-0.5219, 0.3945, 0.0775, 2.1175, -0.3057, -0.5750)),
]


def random_joints(count, seed=0):
    low, high = JOINT_LIMITS.T.copy()
    low[INSERTION] = INSERTION_OFFSET
    return np.random.default_rng(seed).uniform(low, high, (count, 6))


def denavit_hartenberg(joints):
    """Link 5 in the RCM frame by the table of docs/psm.md#kinematics, modified convention."""
    q1, q2, q3, q4, q5, q6 = joints
    half = np.pi / 2
    rows = [
        (half, 0, 0, q1 + half),
        (-half, 0, 0, q2 - half),
        (half, 0, q3 - 0.4318, 0),
        (0, 0, 0.4162, q4),
        (-half, 0, 0, q5 - half),
        (-half, 0.0091, 0, q6 - half),
    ]
    pose = np.eye(4)
    for alpha, a, d, theta in rows:
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        pose = pose @ [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]]
    return pose[:3, 3], pose[:3, :3]


@pytest.mark.parametrize(("arm", "position", "euler", "joints"), STARTS)
def test_start_poses_need_the_joints_of_the_original(arm, position, euler, joints):
    rcm, yaw = arm
    to_rcm = Rotation.from_euler("z", yaw, degrees=True).inv()
    rotation = to_rcm * Rotation.from_euler("xyz", euler, degrees=True)
    solved = inverse(to_rcm.apply(np.divide(position, 5) - rcm), rotation.as_matrix())
    np.testing.assert_allclose(solved, joints, rtol=0, atol=1e-4)


def test_forward_is_the_denavit_hartenberg_chain():
    for joints in random_joints(200):
        position, rotation = forward(joints)
        expected_position, expected_rotation = denavit_hartenberg(joints)
        np.testing.assert_allclose(position, expected_position, rtol=0, atol=1e-12)
        np.testing.assert_allclose(rotation, expected_rotation, rtol=0, atol=1e-12)


def test_ten_thousand_reachable_poses_round_trip():
    joints = random_joints(10_000)
    position, rotation = forward(joints)
    solved = inverse(position, rotation, near=joints)
    np.testing.assert_allclose(solved, joints, rtol=0, atol=1e-9)
    again_position, again_rotation = forward(solved)
    np.testing.assert_allclose(again_position, position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again_rotation, rotation, rtol=0, atol=1e-9)


def test_without_near_the_roll_lies_within_half_a_turn():
    joints = random_joints(1000)
    solved = inverse(*forward(joints))
    assert np.all(np.abs(solved[:, ROLL]) <= np.pi)
    turns = (joints - solved)[:, ROLL] / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), rtol=0, atol=1e-9)


def test_rotations_are_proper():
    _, rotation = forward(random_joints(1000))
    np.testing.assert_allclose(rotation @ np.swapaxes(rotation, -1, -2), np.tile(np.eye(3), (1000, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1, atol=1e-12)


@pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3), (0,)])
def test_leading_axes_are_a_loop(shape):
    joints = random_joints(int(np.prod(shape))).reshape(*shape, 6)
    position, rotation = forward(joints)
    solved = inverse(position, rotation, near=joints)
    assert (position.shape, rotation.shape, solved.shape) == ((*shape, 3), (*shape, 3, 3), (*shape, 6))
    for index in np.ndindex(shape):
        one_position, one_rotation = forward(joints[index])
        np.testing.assert_allclose(position[index], one_position, rtol=0, atol=1e-15)
        np.testing.assert_allclose(rotation[index], one_rotation, rtol=0, atol=1e-15)
        one = inverse(one_position, one_rotation, near=joints[index])
        np.testing.assert_allclose(solved[index], one, rtol=0, atol=1e-12)


def test_the_arguments_are_left_as_they_were():
    joints = random_joints(5)
    position, rotation = forward(joints)
    before = position.copy(), rotation.copy(), joints.copy()
    inverse(position, rotation, near=joints, on_limit="clip")
    for argument, copy in zip((position, rotation, joints), before, strict=True):
        np.testing.assert_array_equal(argument, copy)


def beyond_limits(joint):
    """Joints in the middle of their ranges but for one, which is 0.05 beyond its upper limit."""
    joints = JOINT_LIMITS.mean(axis=1)
    joints[joint] = JOINT_LIMITS[joint, 1] + 0.05
    return joints


@pytest.mark.parametrize("joint", range(6), ids=JOINT_NAMES)
def test_a_pose_out_of_reach_is_an_error_that_names_joint_and_value(joint):
    joints = beyond_limits(joint)
    with pytest.raises(JointLimitError, match=rf"{JOINT_NAMES[joint]} = {re.escape(f'{joints[joint]:.4f}')}"):
        inverse(*forward(joints), near=joints)


def test_one_pose_out_of_reach_among_many_is_an_error():
    joints = random_joints(20)
    joints[13] = beyond_limits(WRIST_PITCH)
    with pytest.raises(JointLimitError, match="wrist_pitch"):
        inverse(*forward(joints), near=joints)


def test_a_pose_that_is_not_a_number_is_an_error():
    position, rotation = forward(random_joints(1)[0])
    with pytest.raises(JointLimitError):
        inverse(position * np.nan, rotation)


@pytest.mark.parametrize("joint", range(6), ids=JOINT_NAMES)
def test_clip_stops_a_joint_at_its_limit(joint):
    joints = beyond_limits(joint)
    solved = inverse(*forward(joints), near=joints, on_limit="clip")
    joints[joint] = JOINT_LIMITS[joint, 1]
    np.testing.assert_allclose(solved, joints, rtol=0, atol=1e-9)


def test_clip_stays_within_the_limits_whatever_the_pose():
    rng = np.random.default_rng(0)
    position = rng.uniform(-0.3, 0.3, (10_000, 3))
    rotation = Rotation.random(10_000, rng).as_matrix()
    solved = inverse(position, rotation, on_limit="clip")
    assert np.all((solved >= JOINT_LIMITS[:, 0]) & (solved <= JOINT_LIMITS[:, 1]))


def test_an_unknown_limit_rule_is_an_error_that_names_it():
    with pytest.raises(ValueError, match="'stop'"):
        inverse(*forward(random_joints(1)[0]), on_limit="stop")


@pytest.mark.parametrize("joint", range(6), ids=JOINT_NAMES)
def test_ignore_finds_the_joints_of_a_pose_beyond_the_limits(joint):
    joints = beyond_limits(joint)
    np.testing.assert_allclose(inverse(*forward(joints), near=joints, on_limit="ignore"), joints, rtol=0, atol=1e-9)


@pytest.mark.parametrize("roll", [-4.4, -3.3, -1.0, 0.0, 2.0, 3.3, 4.4])
def test_near_picks_the_turn_of_the_roll(roll):
    joints = JOINT_LIMITS.mean(axis=1)
    joints[ROLL] = roll
    nearby = joints + 0.1 * np.sign(np.arange(6) - 2.5)
    np.testing.assert_allclose(inverse(*forward(joints), near=nearby), joints, rtol=0, atol=1e-9)
