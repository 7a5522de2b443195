import numpy as np
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient
from scipy.spatial.transform import Rotation

from surrol_gym.bullet import ASSETS, World
from surrol_gym.psm import kinematics
from surrol_gym.psm.arm import (
    DOWN,
    JAW_CLOSED,
    JAW_OPEN,
    JAWS,
    Arm,
    euler_to_matrix,
    matrix_to_quaternion,
    quaternion_to_matrix,
)

# Base position, metres, yaw of the base and RCM point, metres (docs/psm.md#where-the-arms-stand).
PSM1 = (0.05, 0.24, 0.8524), np.deg2rad(-110), (0.507066, 0.073641, 0.8524)
PSM2 = (0.05, -0.24, 0.8524), np.deg2rad(-70), (0.507066, -0.073641, 0.8524)
SUB_STEPS = 48
CONVERGENCE = 0.9936
"""Share of the commanded motion that one control step realises (docs/psm.md#motors)."""


@pytest.fixture(scope="module")
def world():
    world = World()
    yield world
    world.close()


@pytest.fixture(scope="module")
def arm(world):
    return Arm(world, *PSM1[:2])


@pytest.fixture
def ready(arm):
    """The arm above the middle of the table, tool down."""
    arm.reset((2.75, 0.0, 3.7), DOWN)
    return arm


@pytest.mark.parametrize(
    ("position", "euler"),
    [
        ((2.5, 0.25, 3.776), DOWN),
        ((2.5, 0.25, 3.601), DOWN),
        ((2.4, 0.125, 3.626), DOWN),
        ((2.875, 0.225, 3.651), np.deg2rad((0, -90, -90))),
        ((2.75, 0.0, 3.5), np.deg2rad((-80, 10, 120))),
    ],
)
def test_reset_puts_link_5_at_the_asked_pose_with_jaws_closed(arm, position, euler):
    arm.command_jaws(JAW_OPEN)
    arm.reset(position, euler)
    measured_position, measured_euler = arm.pose()
    np.testing.assert_allclose(measured_position, position, rtol=0, atol=1e-6)
    np.testing.assert_allclose(euler_to_matrix(measured_euler), euler_to_matrix(euler), rtol=0, atol=1e-6)
    assert arm.jaw_angle() == pytest.approx(0)


def test_motors_hold_the_pose_after_a_reset(world, ready):
    before, _ = ready.pose()
    world.step(240)
    np.testing.assert_allclose(ready.pose()[0], before, rtol=0, atol=1e-4)
    assert ready.jaw_angle() == pytest.approx(0, abs=2e-3)


def test_reset_out_of_reach_is_an_error(ready):
    with pytest.raises(kinematics.JointLimitError, match="insertion"):
        ready.reset((2.53533, 0.36821, 2.9), DOWN)


def test_a_motion_out_of_reach_stops_at_the_limit(world, ready):
    ready.reset((2.53533, 0.36821, 3.2), DOWN)
    ready.move_to((2.53533, 0.36821, 2.9), DOWN)
    world.step(4 * SUB_STEPS)
    assert ready.joints()[2] == pytest.approx(kinematics.JOINT_LIMITS[2, 1], abs=2e-4)


def test_at_the_end_of_its_roll_the_tool_moves_and_turns_no_further(world, ready):
    position, _ = ready.pose()
    for _ in range(30):
        ready.move_to(position, ready.pose()[1] + (0, 0, 0.4))
        world.step(SUB_STEPS)
    before, euler = ready.pose()
    ready.move_to(before + (-0.02, 0.03, 0.04), euler + (0, 0, 0.4))
    world.step(SUB_STEPS)
    after, turned = ready.pose()
    np.testing.assert_allclose(after - before, np.multiply(CONVERGENCE, (-0.02, 0.03, 0.04)), rtol=0, atol=3e-4)
    np.testing.assert_allclose(turned, euler, rtol=0, atol=0.06)


@pytest.mark.parametrize("size", [1.0, 0.5, 0.1, -0.5, -1.0])
@pytest.mark.parametrize("axis", range(3))
def test_a_control_step_moves_link_5_by_a_fixed_share_of_the_command(world, ready, axis, size):
    command = 0.05 * size * np.eye(3)[axis]
    start, euler = ready.pose()
    ready.move_to(start + command, euler)
    world.step(SUB_STEPS)
    moved = ready.pose()[0] - start
    assert moved[axis] == pytest.approx(CONVERGENCE * command[axis], rel=1e-3)
    np.testing.assert_allclose(np.delete(moved, axis), 0, atol=1e-3 * 0.05)


def test_a_control_step_turns_the_tool_by_a_fixed_share_of_the_command(world, ready):
    position, euler = ready.pose()
    ready.move_to(position, euler + (0, 0, 0.5))
    world.step(SUB_STEPS)
    assert ready.pose()[1][2] - euler[2] == pytest.approx(CONVERGENCE * 0.5, rel=1e-2)


@pytest.mark.parametrize("direction", [-1, 1])
def test_the_roll_goes_on_past_half_a_turn_instead_of_jumping_back(world, ready, direction):
    position, _ = ready.pose()
    rolls = [ready.joints()[3]]
    for _ in range(18):
        ready.move_to(position, ready.pose()[1] + (0, 0, 0.2 * direction))
        world.step(SUB_STEPS)
        rolls.append(ready.joints()[3])
    assert np.max(np.abs(rolls)) > 3.2
    np.testing.assert_allclose(np.abs(np.diff(rolls)), 0.2, rtol=0, atol=0.1)


def test_jaws_open_to_40_degrees_and_close_to_0(world, ready):
    ready.command_jaws(JAW_OPEN)
    world.step(3 * SUB_STEPS)
    assert np.rad2deg(ready.jaw_angle()) == pytest.approx(40, abs=0.01)
    ready.command_jaws(JAW_CLOSED)
    world.step(3 * SUB_STEPS)
    assert np.rad2deg(ready.jaw_angle()) == pytest.approx(0, abs=0.01)


def test_opening_the_jaws_leaves_link_5_in_place(world, ready):
    before, _ = ready.pose()
    ready.command_jaws(JAW_OPEN)
    world.step(2 * SUB_STEPS)
    np.testing.assert_allclose(ready.pose()[0], before, rtol=0, atol=1e-3)


@pytest.mark.parametrize("euler", [DOWN, np.deg2rad((0, -90, -90)), np.deg2rad((-60, 5, 100))])
def test_the_tip_is_10_2_mm_ahead_along_the_tool(arm, euler):
    """docs/psm.md#link-5-and-the-tip: 0.051 su along the y axis of link 5."""
    arm.reset((2.75, 0.1, 3.6), euler)
    ahead = arm.tip() - arm.pose()[0]
    np.testing.assert_allclose(ahead, 0.051 * Rotation.from_euler("xyz", euler).as_matrix()[:, 1], rtol=0, atol=1e-6)


@pytest.mark.parametrize(("base_position", "base_yaw", "rcm"), [PSM1, PSM2], ids=["PSM1", "PSM2"])
def test_the_drawn_arm_has_the_chain_of_the_closed_form(base_position, base_yaw, rcm):
    """The joints of the URDF that pictures show put link 5 where ``kinematics.forward`` says."""
    client = BulletClient(pybullet.DIRECT)
    turn = Rotation.from_euler("z", base_yaw).as_matrix()
    body = client.loadURDF(
        str(ASSETS / "psm.urdf"),
        5 * np.array(base_position),
        pybullet.getQuaternionFromEuler((0, 0, base_yaw)),
        useFixedBase=True,
        globalScaling=5,
    )
    for joints in np.random.default_rng(0).uniform(*kinematics.JOINT_LIMITS.T, (50, 6)):
        for joint, value in enumerate(joints * (1, 1, 5, 1, 1, 1)):
            client.resetJointState(body, joint, value)
        position, rotation = kinematics.forward(joints)
        measured = client.getLinkState(body, 5, computeForwardKinematics=1)
        np.testing.assert_allclose(measured[4], 5 * (rcm + turn @ position), rtol=0, atol=1e-5)
        np.testing.assert_allclose(quaternion_to_matrix(measured[5]), turn @ rotation, rtol=0, atol=1e-5)
    limits = np.array([client.getJointInfo(body, joint)[8:10] for joint in range(6)])
    limits[2] /= 5
    np.testing.assert_allclose(limits, kinematics.JOINT_LIMITS, rtol=0, atol=1e-9)
    client.disconnect()


def test_the_drawn_jaws_are_where_the_simulated_ones_are(world, ready):
    """docs/psm.md#link-5-and-the-tip: the drawn gripper stands for the simulated one, wherever it went."""
    ready.command_jaws(JAW_OPEN)
    ready.move_to((2.7, 0.05, 3.68), DOWN + (0, 0, 0.4))
    world.step(2 * SUB_STEPS)
    client = BulletClient(pybullet.DIRECT)
    prop = world.props[0]
    body = client.loadURDF(
        str(ASSETS / prop.file_name),
        prop.position,
        pybullet.getQuaternionFromEuler((0, 0, prop.yaw)),
        useFixedBase=True,
        globalScaling=5,
    )
    for joint, value in enumerate(prop.joints()):
        client.resetJointState(body, joint, value)
    for drawn, simulated in ((6, JAWS[0]), (7, JAWS[1])):
        expected = world.client.getLinkState(ready.body, simulated, computeForwardKinematics=1)
        measured = client.getLinkState(body, drawn, computeForwardKinematics=1)
        np.testing.assert_allclose(measured[4], expected[4], rtol=0, atol=1e-4)
        np.testing.assert_allclose(
            quaternion_to_matrix(measured[5]), quaternion_to_matrix(expected[5]), rtol=0, atol=1e-3
        )
    client.disconnect()


def test_matrices_and_quaternions_convert_into_each_other():
    for rotation in Rotation.random(50, random_state=0):
        quaternion = matrix_to_quaternion(rotation.as_matrix())
        np.testing.assert_allclose(quaternion_to_matrix(quaternion), rotation.as_matrix(), rtol=0, atol=1e-9)


def test_euler_angles_turn_about_fixed_axes_in_the_order_x_y_z():
    for euler in np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 3)):
        expected = Rotation.from_euler("xyz", euler).as_matrix()
        np.testing.assert_allclose(euler_to_matrix(euler), expected, rtol=0, atol=1e-12)


def test_a_free_arm_touches_nothing(world, ready):
    world.step(SUB_STEPS)
    ready.sense()
    assert ready.contact_force == 0


def test_jaws_that_squeeze_an_object_both_touch_it_and_feel_it(world, ready):
    arc_centre = np.array((2.75, 0.0, 3.6))
    needle = world.load("needle.urdf", arc_centre, yaw=np.pi / 2)
    try:
        ready.reset(arc_centre + (0, -0.1, 0.12), DOWN)
        ready.sense()
        assert ready.touches(needle) == (False, False)
        ready.command_jaws(JAW_OPEN)
        world.step(2 * SUB_STEPS)
        ready.move_to(arc_centre + (0, -0.1, 0.0475), DOWN)
        world.step(2 * SUB_STEPS)
        ready.command_jaws(JAW_CLOSED)
        world.step(2 * SUB_STEPS)
        ready.sense()
        assert ready.touches(needle) == (True, True)
        assert ready.contact_force > 0
        # docs/reference_values.md#motion: the jaws close on the needle at about 0.168 rad.
        assert ready.jaw_angle() == pytest.approx(0.168, abs=0.02)
    finally:
        world.client.removeBody(needle)
