import numpy as np
import pytest

import surrol_gym
from surrol_gym.tasks.needle_pick import NeedlePickEnv

OPEN, CLOSE = 1.0, -1.0
REST_HEIGHT = 3.4219  # docs/reference_values.md#heights-at-rest
SMALL_LIFT = np.array((0, 0, 0.16, 0, CLOSE))
"""An action that lifts the tool by less than 0.01."""


@pytest.fixture(scope="module")
def env():
    env = NeedlePickEnv()
    yield env
    env.close()


@pytest.fixture(scope="module")
def pinned():
    env = NeedlePickEnv(randomize=False)
    yield env
    env.close()


@pytest.mark.parametrize("value", ["no", 0, None])
def test_only_true_and_false_randomize(value):
    with pytest.raises(ValueError, match=f"randomize .* got {value!r}"):
        NeedlePickEnv(randomize=value)


@pytest.fixture(scope="module")
def resets(env):
    """Observations of 300 resets."""
    env.reset(seed=0)
    return [env.reset()[0] for _ in range(300)]


def move(env, goal, gripper, steps):
    """Moves link 5 towards a point; returns what the last step returned."""
    for _ in range(steps):
        position = env.arms[0].pose()[0]
        action = np.array((*np.clip((goal - position) / 0.05, -1, 1), 0, gripper), dtype=np.float32)
        returned = env.step(action)
    return returned


def lift(env, height, seed=0):
    """Lets the expert lift the needle from its rest until it is higher than that; returns the last observation."""
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=seed)
    for _ in range(60):
        observation, *_ = env.step(expert.act(observation))
        if observation["achieved_goal"][2] > REST_HEIGHT + height:
            return observation
    raise AssertionError("the needle was not lifted")


# -------------------------------------------------------------------------------------------------------- how it starts


def test_the_needle_rests_at_its_measured_height(resets):
    heights = np.array([[one["observation"][9], one["observation"][15]] for one in resets])
    np.testing.assert_allclose(heights, REST_HEIGHT, rtol=0, atol=5e-4)


def test_the_needle_lies_still(env):
    before = env.reset(seed=0)[0]["observation"][7:10]
    for _ in range(10):
        observation, *_ = env.step(np.zeros(5))
    np.testing.assert_allclose(observation["observation"][7:10], before, rtol=0, atol=1e-5)


def test_the_needle_lies_anywhere_in_its_range(resets):
    """docs/scenes.md#needle-pick: centre of the arc within 0.05 of (2.75, 0), yaw within 90 degrees, each uniform."""
    draws = []
    for one in resets:
        middle, yaw = one["observation"][13:15], one["observation"][18]
        centre = middle + 0.1 * np.array((np.cos(yaw), np.sin(yaw)))
        draws.append((*(centre - (2.75, 0)), yaw))
    reach = np.array((0.05, 0.05, np.pi / 2))
    assert np.all(np.abs(draws) < reach + 2e-3)
    assert np.all(np.max(draws, axis=0) > 0.95 * reach)
    assert np.all(np.min(draws, axis=0) < -0.95 * reach)
    np.testing.assert_allclose(np.std(draws, axis=0), reach / np.sqrt(3), rtol=0.1)


def test_goals_are_normally_distributed_in_the_air(resets):
    """docs/scenes.md#needle-pick: around (2.75, 0), standard deviation 0.05, height 3.576."""
    goals = np.array([one["desired_goal"] for one in resets])
    np.testing.assert_allclose(goals[:, 2], 3.576, rtol=0, atol=1e-6)
    # Four standard errors of 300 draws.
    np.testing.assert_allclose(goals[:, :2].mean(axis=0), (2.75, 0), rtol=0, atol=4 * 0.05 / np.sqrt(300))
    np.testing.assert_allclose(goals[:, :2].std(axis=0), 0.05, rtol=4 / np.sqrt(600))
    assert abs(np.corrcoef(goals[:, :2].T)[0, 1]) < 4 / np.sqrt(300)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_pinned_the_scene_is_that_of_the_released_demonstration(pinned, seed):
    """docs/reference_values.md#released-demonstrations, NeedlePickRL."""
    observation, _ = pinned.reset(seed=seed)
    state = observation["observation"]
    np.testing.assert_allclose(state[7:10], (2.6896, -0.0196, 3.4219), rtol=0, atol=1e-4)
    np.testing.assert_allclose(state[13:16], (2.6549, -0.0309, 3.4219), rtol=0, atol=1e-4)
    np.testing.assert_allclose(state[16:19], (0, 0, 0.3142), rtol=0, atol=1e-4)
    np.testing.assert_allclose(observation["desired_goal"], (2.75, 0, 3.576), rtol=0, atol=1e-6)


def test_the_expert_succeeds_in_the_pinned_scene(pinned):
    expert = surrol_gym.make_expert(pinned)
    observation, _ = pinned.reset(seed=0)
    for _ in range(50):
        observation, _, _, _, info = pinned.step(expert.act(observation))
    assert info["is_success"]


# ----------------------------------------------------------------------------------------------------- what is observed


@pytest.mark.parametrize("steps", [0, 15, 35])
def test_every_index_of_the_observation_holds_what_the_docstring_says(env, steps):
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=3)
    for _ in range(steps):
        observation, *_ = env.step(expert.act(observation))
    state = observation["observation"]
    position, euler = env.arms[0].pose()
    np.testing.assert_allclose(state[:3], position, atol=1e-6)
    np.testing.assert_allclose(state[3:6], euler, atol=1e-6)
    assert state[6] == pytest.approx(env.arms[0].jaw_angle(), abs=1e-6)
    client = env.world.client
    body = next(body for body in range(client.getNumBodies()) if client.getBodyInfo(body)[1] == b"needle")
    centre_of_mass, orientation = client.getBasePositionAndOrientation(body)
    axis = np.reshape(client.getMatrixFromQuaternion(orientation), (3, 3))[:, 0]
    arc_centre = centre_of_mass + 0.0635 * axis  # docs/objects.md#needle
    np.testing.assert_allclose(state[7:10], centre_of_mass, atol=1e-6)
    np.testing.assert_allclose(state[10:13], state[7:10] - state[:3], atol=1e-6)
    np.testing.assert_allclose(state[13:16], arc_centre - 0.1 * axis, atol=1e-5)
    np.testing.assert_allclose(state[16:19], client.getEulerFromQuaternion(orientation), atol=1e-6)
    np.testing.assert_array_equal(observation["achieved_goal"], state[13:16])


def test_the_names_of_the_observation_say_the_same(env):
    names = env.observation_names
    assert [names[index].rsplit("_", 1)[1] for index in (*range(3), *range(7, 16))] == ["x", "y", "z"] * 4
    assert [name.rsplit("_", 1)[1] for name in (*names[3:7], *names[16:])] == [
        *("roll", "pitch", "yaw", "jaw"),
        *("roll", "pitch", "yaw"),
    ]


def test_a_turn_of_one_is_30_degrees(env):
    """docs/actions.md#what-an-action-does."""
    env.reset(seed=0)
    env.step(np.array((0, 0, 0.5, 0, CLOSE)))
    for turn in (1.0, -0.5):
        before = env.arms[0].pose()[1][2]
        env.step(np.array((0, 0, 0, turn, CLOSE)))
        assert np.rad2deg(env.arms[0].pose()[1][2] - before) == pytest.approx(0.9936 * 30 * turn, rel=0.01)


def test_a_turn_leaves_link_5_in_place_and_the_tool_down(env):
    env.reset(seed=0)
    before = env.arms[0].pose()[0]
    for _ in range(3):
        env.step(np.array((0, 0, 0, -1, CLOSE)))
    position, euler = env.arms[0].pose()
    np.testing.assert_allclose(position, before, rtol=0, atol=2e-3)
    np.testing.assert_allclose(euler[:2], (-np.pi / 2, 0), rtol=0, atol=5e-3)


@pytest.mark.parametrize(("gripper", "angle"), [(-1, 0), (-0.01, 0), (0, 40), (0.01, 40), (1, 40)])
def test_a_negative_gripper_closes_and_any_other_opens(env, gripper, angle):
    env.reset(seed=0)
    for action in (np.array((0, 0, 0, 0, -np.sign(gripper) or CLOSE)), *[np.array((0, 0, 0, 0, gripper))] * 2):
        observation, *_ = env.step(action)
    assert np.rad2deg(observation["observation"][6]) == pytest.approx(angle, abs=0.1)


# -------------------------------------------------------------------------------------------------------------- success


@pytest.mark.parametrize(("distance", "success"), [(0.0, True), (0.0249, True), (0.0251, False), (1.0, False)])
def test_success_is_within_0_025_of_the_goal(env, distance, success):
    goal = np.array((2.7, 0.1, 3.576))
    for direction in ((1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0, 0.8)):
        assert env.is_success(goal + np.multiply(direction, distance), goal) == success


@pytest.mark.parametrize("gripper", [OPEN, CLOSE])
def test_bringing_the_tool_to_the_goal_without_the_needle_is_no_success(env, gripper):
    observation, _ = env.reset(seed=0)
    for height in (0.051, 0.0):  # the tips at the goal, then link 5
        goal = observation["desired_goal"] + (0, 0, height)
        _, reward, _, _, info = move(env, goal, gripper, 10)
        np.testing.assert_allclose(env.arms[0].pose()[0], goal, rtol=0, atol=1e-3)
        assert not info["is_success"]
        assert reward == -1


def test_lifting_from_the_needle_with_open_jaws_is_no_success(env):
    observation, _ = env.reset(seed=0)
    middle = observation["observation"][13:16].astype(float)
    move(env, middle + (0, 0, 0.1), OPEN, 10)
    move(env, middle + (0, 0, 0.0475), OPEN, 3)
    observation, _, _, _, info = move(env, observation["desired_goal"] + (0, 0, 0.0475), OPEN, 10)
    assert not info["is_success"]
    assert observation["achieved_goal"][2] < REST_HEIGHT + 0.005


# -------------------------------------------------------------------------------------------------------------- holding


@pytest.mark.parametrize("seed", range(3))
def test_the_needle_is_attached_only_after_it_was_lifted_by_0_025(env, grip, seed):
    """docs/grasping.md#the-rule; until then friction alone holds it."""
    grip(env, seed)
    env.step(SMALL_LIFT)
    history = []
    for _ in range(12):
        observation, *_ = env.step(np.array((0, 0, 0.06, 0, CLOSE)))
        history.append((env.grasps[0][0].attached, observation["observation"][15] - REST_HEIGHT))
    attached = [height for held, height in history if held]
    free = [height for held, height in history if not held]
    assert min(attached) > 0.025
    assert 0.02 < max(free) <= 0.025
    assert [held for held, _ in history] == sorted(held for held, _ in history)


def test_the_jaws_hold_the_needle_at_the_measured_angle(env):
    """docs/reference_values.md: about 0.168 rad."""
    observation = lift(env, 0.1)
    assert observation["observation"][6] == pytest.approx(0.168, abs=0.02)


def test_the_arm_feels_the_needle_that_it_holds(env):
    lift(env, 0.1)
    for _ in range(5):
        _, _, _, _, info = env.step(np.array((0, 0, 0, 0, CLOSE)))
        assert info["contact_force"] > 0


def test_opening_the_jaws_releases_the_needle_and_it_falls(env):
    lift(env, 0.1)
    assert env.grasps[0][0].attached
    for _ in range(5):
        observation, _, _, _, info = env.step(np.array((0, 0, 0, 0, OPEN)))
        assert not env.grasps[0][0].attached
    assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=0.005)
    assert not info["is_success"]
    assert info["contact_force"] == 0


def test_a_held_needle_follows_the_tool(env):
    observation = lift(env, 0.1)
    held = observation["observation"][10:13]
    for action in ((1, 0, 0), (0, -1, 0), (-1, 0.5, 0.5)):
        observation, *_ = env.step(np.array((*action, 0, CLOSE)))
        np.testing.assert_allclose(observation["observation"][10:13], held, rtol=0, atol=0.01)


@pytest.mark.parametrize("attached", [False, True], ids=["by friction", "attached"])
def test_a_held_needle_is_part_of_the_state(env, grip, attached):
    """The episode goes on from there as if never left, in this environment and in another."""
    if attached:
        lift(env, 0.1)
    else:
        grip(env)
        env.step(SMALL_LIFT)
    assert env.grasps[0][0].attached == attached
    state = env.get_state()
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (10, 5))
    actions[:, 2] = 0.4
    actions[:, 4] = CLOSE
    uninterrupted = [env.step(action) for action in actions]
    assert uninterrupted[-1][0]["achieved_goal"][2] > REST_HEIGHT + 0.02
    other = NeedlePickEnv()
    env.reset(seed=1)
    for restored in (env, other):
        restored.set_state(state)
        assert restored.grasps[0][0].attached == attached
        for action, (observation, reward, _, _, info) in zip(actions, uninterrupted, strict=True):
            again, again_reward, _, _, again_info = restored.step(action)
            assert {key: value.tobytes() for key, value in again.items()} == {
                key: value.tobytes() for key, value in observation.items()
            }
            assert (again_reward, again_info) == (reward, info)
    other.close()


def test_restoring_a_state_from_before_the_grasp_lets_the_needle_go(env):
    observation, _ = env.reset(seed=0)
    state = env.get_state()
    lift(env, 0.1)
    restored = env.set_state(state)
    assert not env.grasps[0][0].attached
    np.testing.assert_array_equal(restored["observation"], observation["observation"])


def test_a_reset_lets_the_needle_go(env):
    lift(env, 0.1)
    observation, info = env.reset(seed=0)
    assert not env.grasps[0][0].attached
    assert info["contact_force"] == 0
    assert observation["observation"][9] == pytest.approx(REST_HEIGHT, abs=5e-4)
