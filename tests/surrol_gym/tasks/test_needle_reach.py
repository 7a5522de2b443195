import numpy as np
import pytest

from surrol_gym.tasks.needle_reach import NeedleReachEnv


@pytest.fixture(scope="module")
def env():
    env = NeedleReachEnv()
    yield env
    env.close()


def needle(env):
    """Centre and middle of the needle's arc and the needle's yaw.

    The centre of mass lies 0.0635 su from the centre, along the needle's -x; the middle 0.1 su
    (docs/objects.md#needle).
    """
    client = env.world.client
    body = next(body for body in range(client.getNumBodies()) if client.getBodyInfo(body)[1] == b"needle")
    position, orientation = client.getBasePositionAndOrientation(body)
    axis = np.reshape(client.getMatrixFromQuaternion(orientation), (3, 3))[:, 0]
    centre = position + 0.0635 * axis
    return centre, centre - 0.1 * axis, np.arctan2(axis[1], axis[0])


@pytest.mark.parametrize("seed", range(5))
def test_the_goal_is_0_025_above_the_middle_of_the_needle(env, seed):
    observation, _ = env.reset(seed=seed)
    _, middle, _ = needle(env)
    np.testing.assert_allclose(observation["desired_goal"], middle + (0, 0, 0.025), atol=1e-5)
    assert observation["desired_goal"][2] == pytest.approx(3.4469, abs=5e-4)  # docs/scenes.md#needle-reach


def test_the_needle_lies_anywhere_in_its_range(env):
    """docs/scenes.md#needle-reach: centre of the arc within 0.05 of (2.75, 0), yaw within 90 degrees, each uniform."""
    env.reset(seed=0)
    draws = []
    for _ in range(100):
        env.reset()
        centre, _, yaw = needle(env)
        assert centre[2] == pytest.approx(3.4219, abs=5e-4)
        draws.append((centre[0] - 2.75, centre[1], yaw))
    reach = np.array((0.05, 0.05, np.pi / 2))
    assert np.all(np.abs(draws) < reach + 2e-3)
    assert np.all(np.max(draws, axis=0) > 0.9 * reach)
    assert np.all(np.min(draws, axis=0) < -0.9 * reach)
    np.testing.assert_allclose(np.std(draws, axis=0), reach / np.sqrt(3), rtol=0.2)


def test_the_achieved_goal_is_the_tip_of_the_tool(env):
    """The tip is 0.051 su below link 5 of a tool that points down (docs/psm.md#link-5-and-the-tip)."""
    observation, _ = env.reset(seed=0)
    for action in np.random.default_rng(0).uniform(-1, 1, (5, 5)):
        np.testing.assert_allclose(
            observation["achieved_goal"], observation["observation"][:3] - (0, 0, 0.051), atol=1e-4
        )
        observation, *_ = env.step(action)


def test_the_observation_is_the_pose_of_link_5_and_the_jaw_angle(env):
    observation, _ = env.reset(seed=0)
    np.testing.assert_allclose(observation["observation"], (2.5, 0.25, 3.776, -np.pi / 2, 0, np.pi / 2, 0), atol=1e-3)


@pytest.mark.parametrize(("turn", "gripper"), [(1, 1), (-1, 0), (0.3, -1)])
def test_turn_and_gripper_have_no_effect(env, turn, gripper):
    motions = np.random.default_rng(0).uniform(-1, 1, (8, 3))
    played = []
    for rest in ((0, 0), (turn, gripper)):
        env.reset(seed=0)
        played.append([env.step(np.array((*motion, *rest)))[0]["observation"] for motion in motions])
    np.testing.assert_array_equal(played[0], played[1])
    assert np.all(np.abs(np.array(played)[..., 6]) < 1e-2)


@pytest.mark.parametrize(("distance", "success"), [(0.0, True), (0.0249, True), (0.0251, False), (1.0, False)])
def test_success_is_within_0_025_of_the_goal(env, distance, success):
    goal = np.array((2.7, 0.1, 3.45))
    for direction in ((1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0, 0.8)):
        assert env.is_success(goal + np.multiply(direction, distance), goal) == success


def test_the_needle_stays_where_it_is_while_the_tool_is_above(env):
    env.reset(seed=0)
    before = needle(env)[1]
    for _ in range(10):
        observation, *_ = env.step(np.zeros(5))
    np.testing.assert_allclose(needle(env)[1], before, rtol=0, atol=1e-4)
    np.testing.assert_allclose(observation["desired_goal"], before + (0, 0, 0.025), atol=1e-4)


def test_tray_and_table_are_where_the_original_has_them(env):
    env.reset(seed=0)
    assert height_at(env, 2.85, 0.3) == pytest.approx(3.4178, abs=2e-4)  # pad
    assert height_at(env, 2.75, -0.7) == pytest.approx(3.380, abs=2e-4)  # table


def height_at(env, x, y):
    """Height of the highest surface that a ray from above meets."""
    return env.world.client.rayTest((x, y, 5), (x, y, 0))[0][3][2]
