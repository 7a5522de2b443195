import numpy as np
import pytest

import surrol_gym
from surrol_gym.tasks.gauze_retrieve import GauzeRetrieveEnv

OPEN, CLOSE = 1.0, -1.0
REST_HEIGHT = 3.3891  # docs/reference_values.md#heights-at-rest


@pytest.fixture(scope="module")
def env():
    env = GauzeRetrieveEnv()
    yield env
    env.close()


@pytest.fixture(scope="module")
def resets(env):
    """Observations of 300 resets."""
    env.reset(seed=0)
    return [env.reset()[0] for _ in range(300)]


def body(env, name):
    client = env.world.client
    return next(body for body in range(client.getNumBodies()) if client.getBodyInfo(body)[1].decode() == name)


def move(env, goal, gripper, steps):
    """Moves link 5 towards a point; returns what the last step returned."""
    for _ in range(steps):
        position = env.arms[0].pose()[0]
        returned = env.step(np.array((*np.clip((goal - position) / 0.05, -1, 1), 0, gripper)))
    return returned


def lift(env, height, seed=0):
    """Lets the expert lift the gauze from its rest until it is higher than that; returns the last observation."""
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=seed)
    for _ in range(60):
        observation, *_ = env.step(expert.act(observation))
        if observation["achieved_goal"][2] > REST_HEIGHT + height:
            return observation
    raise AssertionError("the gauze was not lifted")


# -------------------------------------------------------------------------------------------------------- how it starts


def test_the_gauze_rests_flat_at_its_measured_height(resets):
    poses = np.array([one["observation"][[9, 15, 16, 17, 18]] for one in resets])
    np.testing.assert_allclose(poses[:, :2], REST_HEIGHT, rtol=0, atol=5e-4)
    np.testing.assert_allclose(poses[:, 2:], 0, rtol=0, atol=5e-3)


def test_the_tray_lies_where_the_original_has_it(env):
    env.reset(seed=0)
    assert env.world.client.rayTest((2.85, 0.3, 5), (2.85, 0.3, 0))[0][3][2] == pytest.approx(3.3816, abs=2e-4)


def test_the_arm_starts_above_the_tray_with_closed_jaws(resets):
    """docs/psm.md#start-poses."""
    for one in resets[:20]:
        np.testing.assert_allclose(
            one["observation"][:7], (2.5, 0.25, 3.601, -np.pi / 2, 0, np.pi / 2, 0), rtol=0, atol=1e-3
        )


def test_the_gauze_lies_anywhere_in_its_range(resets):
    """docs/scenes.md#gauze-retrieve: within 0.05 of (2.75, 0), uniform."""
    draws = np.array([one["observation"][7:9] - (2.75, 0) for one in resets])
    assert np.all(np.abs(draws) < 0.05 + 2e-3)
    assert np.all(draws.max(axis=0) > 0.0475)
    assert np.all(draws.min(axis=0) < -0.0475)
    np.testing.assert_allclose(draws.std(axis=0), 0.05 / np.sqrt(3), rtol=0.1)
    assert abs(np.corrcoef(draws.T)[0, 1]) < 4 / np.sqrt(300)


def test_goals_are_normally_distributed_in_the_air(resets):
    """docs/scenes.md#gauze-retrieve: around (2.75, 0), standard deviation 0.1, height 3.626; but within reach."""
    goals = np.array([one["desired_goal"] for one in resets])
    np.testing.assert_allclose(goals[:, 2], 3.626, rtol=0, atol=1e-6)
    # Four standard errors of 300 draws.
    np.testing.assert_allclose(goals[:, :2].mean(axis=0), (2.75, 0), rtol=0, atol=4 * 0.1 / np.sqrt(300))
    np.testing.assert_allclose(goals[:, :2].std(axis=0), 0.1, rtol=4 / np.sqrt(600))
    assert np.all(np.abs(goals[:, :2] - (2.75, 0)) < 0.27)
    assert np.any(np.abs(goals[:, :2] - (2.75, 0)) > 0.2)


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
    centre, orientation = env.world.client.getBasePositionAndOrientation(body(env, "gauze"))
    np.testing.assert_allclose(state[7:10], centre, atol=1e-6)
    np.testing.assert_allclose(state[10:13], state[7:10] - state[:3], atol=1e-6)
    np.testing.assert_array_equal(state[13:16], state[7:10])
    np.testing.assert_allclose(state[16:19], env.world.client.getEulerFromQuaternion(orientation), atol=1e-6)
    np.testing.assert_array_equal(observation["achieved_goal"], state[7:10])


def test_the_names_of_the_observation_say_the_same(env):
    names = env.observation_names
    assert len(names) == 19
    assert len(set(names)) == 19
    assert [names[index].rsplit("_", 1)[1] for index in (*range(3), *range(7, 16))] == ["x", "y", "z"] * 4
    assert [names[index].rsplit("_", 1)[1] for index in (3, 4, 5, 6)] == ["roll", "pitch", "yaw", "jaw"]
    assert [name.rsplit("_", 1)[1] for name in names[16:]] == ["roll", "pitch", "yaw"]


@pytest.mark.parametrize("turn", [1.0, -0.4])
def test_the_turn_has_no_effect(env, turn):
    """docs/actions.md#what-an-action-does: the orientation is fixed in this task."""
    motions = np.random.default_rng(0).uniform(-1, 1, (6, 3))
    played = []
    for angle in (0.0, turn):
        env.reset(seed=0)
        played.append([env.step(np.array((*motion, angle, OPEN)))[0]["observation"] for motion in motions])
    np.testing.assert_array_equal(played[0], played[1])


# -------------------------------------------------------------------------------------------------------------- success


@pytest.mark.parametrize(("distance", "success"), [(0.0, True), (0.0249, True), (0.0251, False), (1.0, False)])
def test_success_is_within_0_025_of_the_goal(env, distance, success):
    goal = np.array((2.7, 0.1, 3.626))
    for direction in ((1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0, 0.8)):
        assert env.is_success(goal + np.multiply(direction, distance), goal) == success


@pytest.mark.parametrize("gripper", [OPEN, CLOSE])
def test_bringing_the_tool_to_the_goal_without_the_gauze_is_no_success(env, gripper):
    observation, _ = env.reset(seed=0)
    for height in (0.051, 0.0):  # the tips at the goal, then link 5
        _, reward, _, _, info = move(env, observation["desired_goal"] + (0, 0, height), gripper, 10)
        assert not info["is_success"]
        assert reward == -1


def test_lifting_from_the_gauze_with_open_jaws_is_no_success(env):
    observation, _ = env.reset(seed=0)
    gauze = observation["achieved_goal"].astype(float)
    move(env, gauze + (0, 0, 0.1), OPEN, 10)
    move(env, gauze + (0, 0, 0.046), OPEN, 3)
    observation, _, _, _, info = move(env, observation["desired_goal"] + (0, 0, 0.046), OPEN, 10)
    assert not info["is_success"]
    assert observation["achieved_goal"][2] < REST_HEIGHT + 0.005


def test_the_expert_succeeds_in_time_and_holds_the_goal(demonstrations):
    for episode in demonstrations("GauzeRetrieve"):
        assert episode.first <= 37
        assert episode.holds


def test_the_expert_retries_a_missed_grasp(env, grip):
    """Without the gauze between them the jaws close on nothing; the expert opens them and starts again."""
    expert = surrol_gym.make_expert(env)
    grip(env)
    env.world.place(body(env, "gauze"), (2.75, 0.08, REST_HEIGHT))
    observation, *_ = env.step(np.array((0, 0, 0, 0, CLOSE)))
    assert observation["observation"][6] < 0.05
    assert expert.act(observation)[4] > 0
    for _ in range(50):
        observation, _, _, _, info = env.step(expert.act(observation))
    assert info["is_success"]


# -------------------------------------------------------------------------------------------------------------- holding


@pytest.mark.parametrize("seed", range(3))
def test_the_gauze_is_attached_only_after_it_was_lifted_by_0_0125(env, grip, seed):
    """docs/grasping.md#the-rule; until then friction alone holds it."""
    rest = grip(env, seed)["achieved_goal"][2]
    history = []
    for _ in range(12):
        observation, *_ = env.step(np.array((0, 0, 0.06, 0, CLOSE)))
        history.append((env.grasps[0][0].attached, observation["achieved_goal"][2] - rest))
    attached = [height for held, height in history if held]
    free = [height for held, height in history if not held]
    assert min(attached) > 0.0125
    assert 0.005 < max(free) <= 0.0125
    assert [held for held, _ in history] == sorted(held for held, _ in history)


def test_the_jaws_stay_open_around_the_gauze_that_they_hold(env):
    """The gauze is 0.01 su wide, and held by its upper edges 0.04 su from the hinge."""
    observation = lift(env, 0.1)
    assert observation["observation"][6] == pytest.approx(0.2, abs=0.05)


def test_a_held_gauze_follows_the_tool(env):
    observation = lift(env, 0.1)
    held = observation["observation"][10:13]
    for action in ((1, 0, 0), (0, -1, 0), (-1, 0.5, 0.5)):
        observation, _, _, _, info = env.step(np.array((*action, 0, CLOSE)))
        np.testing.assert_allclose(observation["observation"][10:13], held, rtol=0, atol=0.01)
        assert info["contact_force"] > 0


def test_opening_the_jaws_releases_the_gauze_and_it_falls(env):
    lift(env, 0.1)
    assert env.grasps[0][0].attached
    for _ in range(5):
        observation, _, _, _, info = env.step(np.array((0, 0, 0, 0, OPEN)))
        assert not env.grasps[0][0].attached
    assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=0.005)
    assert not info["is_success"]


@pytest.mark.parametrize("attached", [False, True], ids=["by friction", "attached"])
def test_a_held_gauze_is_part_of_the_state(env, grip, attached):
    """The episode goes on from there as if never left, in this environment and in another."""
    if attached:
        lift(env, 0.1)
    else:
        grip(env)
    assert env.grasps[0][0].attached == attached
    state = env.get_state()
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (10, 5))
    actions[:, 2], actions[:, 4] = 0.2, CLOSE
    uninterrupted = [env.step(action) for action in actions]
    assert uninterrupted[-1][0]["achieved_goal"][2] > REST_HEIGHT + 0.02
    other = GauzeRetrieveEnv()
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


def test_a_reset_lets_the_gauze_go(env):
    lift(env, 0.1)
    observation, info = env.reset(seed=0)
    assert not env.grasps[0][0].attached
    assert info["contact_force"] == 0
    assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=5e-4)
