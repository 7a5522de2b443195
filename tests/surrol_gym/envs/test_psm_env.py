"""What an action does (docs/actions.md#what-an-action-does)."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from surrol_gym.envs.psm_env import PITCH, YAW, Mount, PSMEnv, psm2
from surrol_gym.psm.kinematics import JOINT_LIMITS, JOINT_NAMES

YAW_TASKS = ("NeedlePick", "PegTransfer", "BiPegTransfer", "MatchBoardPanel", "PickAndPlace", "MatchBoard")
# Task, arm, start position, lowest and highest position of link 5, turn of a full action (docs/psm.md#start-poses,
# docs/actions.md).
ARMS = [
    ("NeedleReach", 0, (2.5, 0.25, 3.776), (2.48, -0.27, 3.426), (3.02, 0.27, 3.856), 0),
    ("GauzeRetrieve", 0, (2.5, 0.25, 3.601), (2.48, -0.27, 3.426), (3.02, 0.27, 3.856), 0),
    ("NeedlePick", 0, (2.5, 0.25, 3.601), (2.48, -0.27, 3.426), (3.02, 0.27, 3.856), 30),
    ("PegTransfer", 0, (2.5, 0.25, 3.776), (2.48, -0.27, 3.426), (3.02, 0.27, 3.856), 20),
    ("NeedleRegrasp", 0, None, (2.73, 0.03, 3.526), (3.02, 0.42, 3.856), 15),
    ("NeedleRegrasp", 1, (2.875, -0.225, 3.651), (2.73, -0.42, 3.526), (3.02, -0.03, 3.856), 15),
    ("BiPegTransfer", 0, (2.5, 0.25, 3.776), (2.48, -0.02, 3.481), (3.02, 0.27, 3.856), 20),
    ("BiPegTransfer", 1, (2.5, -0.25, 3.776), (2.48, -0.27, 3.481), (3.02, 0.02, 3.856), 20),
    ("BiPegBoard", 0, None, (2.33, -0.02, 3.081), (3.32, 0.52, 4.056), 15),
    ("BiPegBoard", 1, None, (2.33, -0.77, 3.081), (3.32, 0.02, 4.056), 30),
    ("MatchBoardPanel", 0, (2.4, 0.125, 3.626), (2.38, -0.27, 3.431), (3.02, 0.52, 3.706), 30),
    ("PickAndPlace", 0, (2.5, 0.25, 3.601), (2.48, -0.27, 3.426), (3.02, 0.27, 3.856), 30),
    ("MatchBoard", 0, (2.5, 0.25, 3.601), (2.48, -0.27, 3.426), (3.02, 0.27, 3.856), 30),
]


IDS = [f"{task}-psm{arm + 1}" for task, arm, *_ in ARMS]
either_arm = pytest.mark.parametrize("case", ["NeedlePick-psm1", "NeedleRegrasp-psm2"], indirect=True)
"""What every arm does alike is tested on one that yaws and on one that pitches."""


@pytest.fixture(scope="module", params=IDS)
def case(request):
    """An environment, the number of an arm, and what was measured of it."""
    task, arm, start, low, high, turn = ARMS[IDS.index(request.param)]
    env = gym.make(f"surrol/{task}-v0").unwrapped
    yield env, arm, start, np.array(low), np.array(high), np.deg2rad(turn)
    env.close()


def motion(env, arm, x=0.0, y=0.0, z=0.0, turn=0.0, gripper=-1.0):
    """An action that moves one arm; the jaws of the other, if any, stay closed."""
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    action[4::5] = -1.0
    action[5 * arm : 5 * arm + 5] = x, y, z, turn, gripper
    return action


def link5(env, arm):
    """Position of link 5, as float64."""
    return env.arms[arm].pose()[0]


def to_the_air(env, arm, low, high):
    """Brings the arm high above the scene, into the middle of its workspace."""
    env.reset(seed=0)
    for _ in range(8):
        env.step(motion(env, arm, z=1))
    middle = (low + high) / 2
    for _ in range(20):
        delta = np.clip((middle - link5(env, arm)) / 0.05, -1, 1)
        env.step(motion(env, arm, delta[0], delta[1]))
    while env.task == "BiPegBoard" and link5(env, arm)[2] > 3.85:  # up there the arms come to their joints' limits
        env.step(motion(env, arm, z=-0.5))


def test_an_episode_starts_where_the_original_does(case):
    env, arm, start, low, high, _ = case
    observation = env.reset(seed=1)[0]["observation"][7 * arm : 7 * arm + 7]
    assert np.all(observation[:3] > low - 1e-3)
    assert np.all(observation[:3] < high + 1e-3)
    if start is not None:
        np.testing.assert_allclose(observation[:3], start, atol=1e-5)
    if env.mounts[arm].turns == YAW and env.task in YAW_TASKS:
        np.testing.assert_allclose(observation[3:6], (-np.pi / 2, 0, np.pi / 2), atol=1e-3)
        assert observation[6] == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("size", [1.0, -0.1])
@either_arm
def test_an_action_moves_link_5_by_its_share_of_0_05_su(case, size):
    """docs/reference_values.md#motion: 0.9936 x 0.05 x size."""
    env, arm, _, low, high, _ = case
    to_the_air(env, arm, low, high)
    for _ in range(2):
        env.step(motion(env, arm, z=-0.7))
    for axis in range(3):
        before = link5(env, arm)
        env.step(motion(env, arm, *(size * np.eye(3)[axis])))
        moved = link5(env, arm) - before
        assert moved[axis] == pytest.approx(0.9936 * 0.05 * size, rel=1e-3)
        np.testing.assert_allclose(np.delete(moved, axis), 0, atol=5e-5)


def test_a_turn_of_one_is_the_angle_of_the_task(case):
    env, arm, _, low, high, turn = case
    to_the_air(env, arm, low, high)
    index = env.mounts[arm].turns
    for size in (-0.5, 0.5):
        env.step(motion(env, arm, turn=np.sign(size) * 0.25))  # away from the ends of a pitch
        before = env.arms[arm].pose()
        env.step(motion(env, arm, turn=size))
        after = env.arms[arm].pose()
        turned = (after[1][index] - before[1][index] + np.pi) % (2 * np.pi) - np.pi
        at_an_end = index == PITCH and np.abs(after[1][index]) > np.pi / 2 - 0.05
        if not at_an_end:
            assert turned == pytest.approx(0.9936 * turn * size, abs=2e-3)
        np.testing.assert_allclose(after[0], before[0], rtol=0, atol=1e-4)


@pytest.mark.parametrize("turn", [-1.0, 1.0, 0.3])
@pytest.mark.parametrize("case", ["NeedlePick-psm1", "BiPegTransfer-psm2", "BiPegBoard-psm2"], indirect=True)
def test_a_tool_at_the_end_of_its_roll_stops_turning_and_link_5_holds_its_place(case, turn):
    env, arm, _, low, high, step = case
    to_the_air(env, arm, low, high)
    start = link5(env, arm)
    for _ in range(60):
        env.step(motion(env, arm, turn=turn))
    np.testing.assert_allclose(link5(env, arm), start, rtol=0, atol=2e-4)
    roll = JOINT_NAMES.index("roll")
    left = JOINT_LIMITS[roll, 1] - np.abs(env.arms[arm].joints()[roll])
    assert 0 <= left < 0.2 * step * np.abs(turn) + 0.01
    before = env.arms[arm].pose()
    env.step(motion(env, arm, turn=-0.5 * turn))
    turned = (env.arms[arm].pose()[1] - before[1])[YAW]
    assert turned == pytest.approx(-0.9936 * 0.5 * turn * step, abs=2e-3)
    np.testing.assert_allclose(link5(env, arm), start, rtol=0, atol=3e-4)


@pytest.mark.parametrize("case", ["BiPegBoard-psm1"], indirect=True)
def test_a_tool_at_the_end_of_its_wrist_pitch_stops_turning_and_link_5_holds_its_place(case):
    env, arm, *_ = case
    env.reset(seed=0)
    for _ in range(6):
        env.step(motion(env, arm, x=-1, y=1))
    start = link5(env, arm)
    for _ in range(30):
        env.step(motion(env, arm, turn=-1))
    assert env.arms[arm].joints()[JOINT_NAMES.index("wrist_pitch")] > 1.35
    np.testing.assert_allclose(link5(env, arm), start, rtol=0, atol=2e-4)


@pytest.mark.parametrize(("gripper", "angle"), [(-1, 0), (-0.01, 0), (0, 40), (1, 40)])
@pytest.mark.parametrize("case", ["NeedleReach-psm1", "NeedlePick-psm1", "NeedleRegrasp-psm2"], indirect=True)
def test_a_negative_gripper_closes_and_any_other_opens(case, gripper, angle):
    env, arm, _, low, high, _ = case
    to_the_air(env, arm, low, high)
    for action in (motion(env, arm, gripper=-np.sign(gripper) or -1), *[motion(env, arm, gripper=gripper)] * 2):
        env.step(action)
    expected = angle if env.has_gripper else 0
    assert np.rad2deg(env.arms[arm].jaw_angle()) == pytest.approx(expected, abs=0.5)


def test_the_workspace_is_that_of_the_original(case):
    env, arm, _, low, high, _ = case
    np.testing.assert_allclose(env.mounts[arm].limits(), (low, high))


# Downwards the scene is in the way: see the next test.
@pytest.mark.parametrize(("axis", "direction"), [(0, -1), (0, 1), (1, -1), (1, 1), (2, 1)])
@either_arm
def test_the_workspace_stops_link_5_and_info_says_so(case, axis, direction):
    env, arm, _, low, high, _ = case
    to_the_air(env, arm, low, high)
    action = motion(env, arm, *(direction * np.eye(3)[axis]))
    clipped = []
    for _ in range(12):
        clipped.append(env.step(action)[4]["workspace_clipped"])
        assert np.all(link5(env, arm) > low - 1e-3)
        assert np.all(link5(env, arm) < high + 1e-3)
    assert clipped[-1]
    assert link5(env, arm)[axis] == pytest.approx((low, high)[direction > 0][axis], abs=1e-3)
    back = (
        env.step(-action)[4] if len(env.arms) == 1 else env.step(motion(env, arm, *(-direction * np.eye(3)[axis])))[4]
    )
    assert not back["workspace_clipped"]


def test_an_arm_pressed_onto_the_scene_yields_and_feels_it(case):
    env, arm, _, low, high, _ = case
    to_the_air(env, arm, low, high)
    if env.task == "NeedleRegrasp":
        pytest.skip("nothing but the table, out of reach")
    forces = [env.step(motion(env, arm, z=-1))[4]["contact_force"] for _ in range(20)]
    assert np.max(forces) < 2000
    assert np.all(link5(env, arm) > low - 2e-3)


@either_arm
def test_an_action_starts_from_the_measured_position_not_from_the_last_target(case):
    env, arm, _, low, high, _ = case
    to_the_air(env, arm, low, high)
    start = link5(env, arm)
    for _ in range(2):
        env.step(motion(env, arm, y=1))
    # Each step leaves out 0.64 % of its command; targets that added up would leave it out only once.
    assert link5(env, arm)[1] - start[1] == pytest.approx(2 * 0.9936 * 0.05, rel=1e-3)


@either_arm
def test_an_action_of_zero_keeps_the_pose(case):
    env, arm, _, low, high, _ = case
    to_the_air(env, arm, low, high)
    before = link5(env, arm)
    for _ in range(5):
        env.step(motion(env, arm))
    np.testing.assert_allclose(link5(env, arm), before, rtol=0, atol=2e-4)


def test_mounts_say_where_link_5_may_be():
    low, high = Mount(start_position=(2.5, 0.25, 3.6)).limits()
    np.testing.assert_allclose(low, (2.48, -0.27, 3.426))
    np.testing.assert_allclose(high, (3.02, 0.27, 3.856))


def test_actions_are_named_after_their_arm_and_their_turn():
    class Task(PSMEnv):
        first = Mount(start_position=(2.5, 0.25, 3.6))
        mounts = (replace(first, turns=PITCH), psm2(start_position=(2.5, -0.25, 3.6)))

    assert Task.action_names == (
        *("psm1_dx", "psm1_dy", "psm1_dz", "psm1_dpitch", "psm1_gripper"),
        *("psm2_dx", "psm2_dy", "psm2_dz", "psm2_dyaw", "psm2_gripper"),
    )
