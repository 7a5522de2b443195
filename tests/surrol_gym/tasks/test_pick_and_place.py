import numpy as np
import pytest

import surrol_gym
from surrol_gym.tasks.pick_and_place import POTS, PickAndPlaceEnv

OPEN, CLOSE = 1.0, -1.0
UPRIGHT = 3.4295
"""Height of the top of a jack that stands on the table."""
SMALL_LIFT = np.array((0, 0, 0.16, 0, CLOSE))
"""An action that lifts the tool by less than 0.01."""


@pytest.fixture(scope="module")
def env():
    env = PickAndPlaceEnv()
    yield env
    env.close()


@pytest.fixture(scope="module")
def resets(env):
    """Observations of 300 resets."""
    env.reset(seed=0)
    return [env.reset()[0]["observation"] for _ in range(300)]


def put(env, red, green):
    """Starts an episode, drops the jacks upright and returns what a step returns after they came to rest."""
    env.reset(seed=0)
    for jack, position in zip(env._jacks, (red, green), strict=True):
        orientation = env.world.client.getQuaternionFromEuler((np.pi / 2, 0, 0.3))
        env.world.place(jack, np.add(position, (0, 0, -0.002)), orientation)
    for _ in range(6):
        returned = env.step(np.array((0, 0, 0, 0, OPEN)))
    return returned


def lift(env, height, seed=0):
    """Lets the expert lift the red jack until its top is higher than that; returns the last observation."""
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=seed)
    rest = observation["observation"][21]
    for _ in range(60):
        observation, *_ = env.step(expert.act(observation))
        if observation["observation"][21] > rest + height:
            return observation
    raise AssertionError("the jack was not lifted")


# -------------------------------------------------------------------------------------------------------- how it starts


def test_the_jacks_stand_at_their_measured_heights(resets):
    """docs/scenes.md#pick-and-place: origins 3.380 to 3.390, tops 3.430 to 3.438; a few still tip or rock."""
    resets = np.array(resets)
    origins, tops = resets[:, [9, 12]], resets[:, [21, 24]]
    assert np.median(origins) == pytest.approx(3.380, abs=1e-3)
    assert np.median(tops) == pytest.approx(3.430, abs=1e-3)
    assert 3.379 < origins.min() < origins.max() < 3.393
    assert 3.428 < tops.min() < tops.max() < 3.442


def test_jacks_right_themselves(resets):
    tilt = np.abs(np.array(resets)[:, [25, 26, 28, 29]]).reshape(-1, 2).max(axis=1)
    assert np.median(tilt) < 0.06
    assert tilt.max() < 0.75


def test_the_jacks_are_scattered_and_apart(resets):
    """docs/scenes.md#pick-and-place: within 0.05 of (2.75, 0) where they drop; they fall aside by up to 0.04."""
    resets = np.array(resets)
    offsets = resets[:, [7, 8, 10, 11]].reshape(-1, 2, 2) - (2.75, 0)
    assert np.abs(offsets).max() < 0.1
    assert np.all(offsets.reshape(-1, 2).max(axis=0) > 0.04)
    assert np.all(offsets.reshape(-1, 2).min(axis=0) < -0.04)
    assert np.linalg.norm(offsets[:, 0] - offsets[:, 1], axis=-1).min() > 0.04
    # Neither colour has a side.
    np.testing.assert_allclose((offsets[:, 0] - offsets[:, 1]).mean(axis=0), 0, atol=4 * 0.1 / np.sqrt(300))


def test_the_jacks_are_turned_anyhow(resets):
    yaws = np.array(resets)[:, [27, 30]]
    assert yaws.std() == pytest.approx(np.pi / np.sqrt(12), rel=0.15)
    assert abs(np.corrcoef(yaws.T)[0, 1]) < 4 / np.sqrt(300)


def test_the_goal_is_always_the_same(env):
    for seed in range(3):
        goal = env.reset(seed=seed)[0]["desired_goal"]
        np.testing.assert_allclose(goal, (2.75, -0.125, 3.3905, 2.75, 0.15, 3.3905), atol=1e-6)


# ----------------------------------------------------------------------------------------------------- what is observed


@pytest.mark.parametrize("steps", [0, 25, 60])
def test_every_index_of_the_observation_holds_what_the_docstring_says(env, steps):
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=3)
    for _ in range(steps):
        observation, *_ = env.step(expert.act(observation))
    state = observation["observation"]
    assert state.shape == (31,)
    position, euler = env.arms[0].pose()
    np.testing.assert_allclose(state[:6], (*position, *euler), atol=1e-6)
    assert state[6] == pytest.approx(env.arms[0].jaw_angle(), abs=1e-6)
    client = env.world.client
    names = {client.getBodyInfo(body)[1].decode(): body for body in range(client.getNumBodies())}
    for index, colour in enumerate(("red", "green")):
        origin, orientation = client.getBasePositionAndOrientation(names[f"jack_{colour}"])
        rotation = np.reshape(client.getMatrixFromQuaternion(orientation), (3, 3))
        top = origin + 0.05 * rotation[:, 1]
        np.testing.assert_allclose(state[7 + 3 * index : 10 + 3 * index], origin, atol=1e-6)
        np.testing.assert_allclose(state[13 + 3 * index : 16 + 3 * index], origin - position, atol=1e-6)
        np.testing.assert_allclose(state[19 + 3 * index : 22 + 3 * index], top, atol=1e-6)
        np.testing.assert_array_equal(
            observation["achieved_goal"][3 * index : 3 * index + 3], state[19 + 3 * index : 22 + 3 * index]
        )
        turned = client.getQuaternionFromEuler(state[25 + 3 * index : 28 + 3 * index].tolist())
        frame = np.reshape(client.getMatrixFromQuaternion(turned), (3, 3))
        np.testing.assert_allclose(frame[:, 0], rotation[:, 0], atol=1e-5)
        np.testing.assert_allclose(frame[:, 2], rotation[:, 1], atol=1e-5)


def test_the_names_of_the_observation_say_the_same(env):
    names = env.observation_names
    assert len(names) == 31
    assert [names[index] for index in (7, 10, 13, 16, 19, 22, 25, 30)] == [
        *("red_x", "green_x", "red_rel_x", "green_rel_x"),
        *("red_top_x", "green_top_x", "red_top_roll", "green_top_yaw"),
    ]


# -------------------------------------------------------------------------------------------------------------- success


@pytest.mark.parametrize("offset", [(0, 0), (0.02, 0), (0, -0.02), (0.014, 0.014)])
def test_each_jack_in_its_pot_is_success(env, offset):
    _, reward, _, _, info = put(env, POTS[0] + (*offset, 0), POTS[1] - (*offset, 0))
    assert info["is_success"]
    assert reward == 0


@pytest.mark.parametrize(
    ("red", "green"),
    [
        (POTS[1], POTS[0]),
        (POTS[0], (2.75, 0.0, 3.3835)),
        ((2.75, 0.0, 3.3835), POTS[1]),
        (POTS[0] + (0.12, 0, -0.005), POTS[1]),
        (POTS[0] + (0, 0.085, 0), POTS[1]),
        (POTS[0], POTS[1] + (0, 0.08, 0)),
    ],
    ids=["swapped", "red only", "green only", "beside", "on the rim", "green on the rim"],
)
def test_jacks_elsewhere_are_no_success(env, red, green):
    _, reward, _, _, info = put(env, red, green)
    assert not info["is_success"]
    assert reward == -1


def test_success_is_within_0_053_of_both_goals(env):
    goal = POTS.ravel()
    for part in (slice(0, 3), slice(3, 6)):
        for direction in ((1, 0, 0), (0, -1, 0), (0, 0.6, 0.8)):
            achieved = np.tile(goal, (2, 1))
            achieved[0, part] += np.multiply(direction, 0.0529)
            achieved[1, part] += np.multiply(direction, 0.0531)
            np.testing.assert_array_equal(env.is_success(achieved, np.tile(goal, (2, 1))), [True, False])
            assert env.is_success(achieved[0], goal)
            np.testing.assert_array_equal(env.compute_reward(achieved, np.tile(goal, (2, 1)), {}), [0, -1])


# -------------------------------------------------------------------------------------------------------------- holding


def test_each_jack_is_attached_by_a_grasp_of_its_own_after_a_lift_of_0_025(demonstrations):
    """docs/grasping.md#the-rule; until then friction alone holds it."""
    for episode in demonstrations("PickAndPlace", 3):
        tops = np.array([observation["observation"][[21, 24]] for observation in episode.observations])
        attached, heights = np.array(episode.attached), tops[1:] - tops[0]
        for jack in range(2):
            first = attached[:, jack].argmax()
            assert heights[first, jack] > 0.025
            assert heights[:first, jack].max() <= 0.025
        assert not attached.all(axis=1).any()
        assert attached[:, 0].argmax() < attached[:, 1].argmax()


def test_the_jaws_hold_the_ball_of_a_jack(env):
    """0.33 radians: a ball of 0.0067 su, 0.033 to 0.04 su from the hinge."""
    observation = lift(env, 0.04)
    assert observation["observation"][6] == pytest.approx(0.31, abs=0.06)


def test_opening_the_jaws_releases_the_jack_and_it_rights_itself(env):
    lift(env, 0.04)
    assert env.grasps[0][0].attached
    for _ in range(15):
        observation, _, _, _, info = env.step(np.array((0, 0, 0, 0, OPEN)))
        assert not env.grasps[0][0].attached
    assert observation["observation"][21] < UPRIGHT + 0.015
    assert not info["is_success"]


@pytest.mark.parametrize("attached", [False, True], ids=["by friction", "attached"])
def test_a_held_jack_is_part_of_the_state(env, grip, attached):
    if attached:
        lift(env, 0.04)
    else:
        grip(env)
        env.step(SMALL_LIFT)
    assert env.grasps[0][0].attached == attached
    state = env.get_state()
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (10, 5))
    actions[:, 2] = 0.3
    actions[:, 4] = CLOSE
    uninterrupted = [env.step(action) for action in actions]
    other = PickAndPlaceEnv()
    env.reset(seed=1)
    for restored in (env, other):
        restored.set_state(state)
        assert [grasp.attached for grasp in restored.grasps[0]] == [attached, False]
        for action, (observation, reward, _, _, info) in zip(actions, uninterrupted, strict=True):
            again, again_reward, _, _, again_info = restored.step(action)
            assert {key: value.tobytes() for key, value in again.items()} == {
                key: value.tobytes() for key, value in observation.items()
            }
            assert (again_reward, again_info) == (reward, info)
    other.close()


# --------------------------------------------------------------------------------------------------------------- expert


def test_the_expert_puts_both_jacks_into_their_pots(demonstrations):
    for episode in demonstrations("PickAndPlace"):
        assert episode.successes[-1]
        assert episode.first <= 75


@pytest.mark.parametrize(
    ("red", "green"),
    [((2.75, 0, 3.3835), POTS[0]), (POTS[1], (2.8, 0, 3.3835)), (POTS[0] + (0.03, 0, 0), POTS[1])],
    ids=["green in the red pot", "red in the green pot", "off the middle"],
)
def test_the_expert_fetches_jacks_from_wrong_places(env, red, green):
    observation, *_ = put(env, red, green)
    expert = surrol_gym.make_expert(env)
    for _ in range(100):
        observation, _, _, _, info = env.step(expert.act(observation))
    assert info["is_success"]
