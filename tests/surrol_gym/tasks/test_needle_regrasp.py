import numpy as np
import pytest

import surrol_gym
from surrol_gym.tasks.needle_regrasp import NeedleRegraspEnv

OPEN, CLOSE = 1.0, -1.0


@pytest.fixture(scope="module")
def env():
    env = NeedleRegraspEnv()
    yield env
    env.close()


@pytest.fixture(scope="module")
def resets(env):
    """Observations of 300 resets."""
    env.reset(seed=0)
    return [env.reset()[0] for _ in range(300)]


def attached(env):
    return tuple(grasps[0].attached for grasps in env.grasps)


def stay(gripper1, gripper2):
    action = np.zeros(10)
    action[[4, 9]] = gripper1, gripper2
    return action


def play(env, done, seed=0):
    """Lets the expert act until the observation and its action fulfil a condition; returns the observation."""
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=seed)
    for _ in range(60):
        action = expert.act(observation)
        if done(observation["observation"], action):
            return observation
        observation, *_ = env.step(action)
    raise AssertionError("the expert never got there")


def both_hold(state, action):
    return action[4] > 0


def handed_over(state, action):
    return state[6] > 0.6 and action[5:8].any()


# -------------------------------------------------------------------------------------------------------- how it starts


def test_psm1_holds_the_needle_from_the_start(env):
    for seed in range(10):
        _, info = env.reset(seed=seed)
        assert attached(env) == (True, False)
        assert info["contact_force"] > 0
        before = env.reset(seed=seed)[0]["observation"]
        for _ in range(5):
            observation, *_ = env.step(stay(CLOSE, CLOSE))
        assert attached(env) == (True, False)
        np.testing.assert_allclose(observation["observation"][14:17], before[14:17], rtol=0, atol=2e-3)


def test_the_needle_hangs_anywhere_in_its_range(resets):
    """docs/scenes.md#needle-regrasp: the middle third of PSM1's workspace, uniform."""
    draws = np.array([one["observation"][14:17] for one in resets])
    low, high = np.array((2.8333, 0.1667, 3.6093)), np.array((2.9167, 0.2833, 3.6927))
    assert np.all((low - 2e-3 < draws) & (draws < high + 2e-3))
    np.testing.assert_allclose(draws.min(axis=0), low, rtol=0, atol=5e-3)
    np.testing.assert_allclose(draws.max(axis=0), high, rtol=0, atol=5e-3)
    np.testing.assert_allclose(draws.std(axis=0), (high - low) / np.sqrt(12), rtol=0.1)
    np.testing.assert_allclose(np.corrcoef(draws.T) - np.eye(3), 0, atol=4 / np.sqrt(300))


def test_psm1_and_the_needle_start_as_in_the_released_demonstrations(resets):
    """docs/reference_values.md#released-demonstrations, NeedleRegraspRL."""
    states = np.array([one["observation"] for one in resets])
    np.testing.assert_allclose(states[:, :3].mean(axis=0), (2.832, 0.309, 3.662), rtol=0, atol=0.008)
    assert states[:, 4].mean() == pytest.approx(-0.534, abs=0.03)
    assert states[:, 4].std() == pytest.approx(0.148, rel=0.1)
    np.testing.assert_allclose(states[:, 6], 0.19, rtol=0, atol=0.025)
    np.testing.assert_allclose(states[:, 14:17].mean(axis=0), (2.879, 0.224, 3.649), rtol=0, atol=0.008)
    np.testing.assert_allclose(np.linalg.norm(states[:, 23:26] - states[:, 29:32], axis=1), 0.1732, rtol=0, atol=1e-4)
    # PSM1 holds the right point, 7.5e-3 behind its tips.
    np.testing.assert_allclose(states[:, 29:32] - states[:, :3], [(0.0435, 0, 0)] * 300, rtol=0, atol=3e-3)


def test_psm2_waits_with_closed_jaws(resets):
    """docs/reference_values.md#released-demonstrations: Euler angles (0, -1.5708, 4.7115), the last up to whole
    turns."""
    states = np.array([one["observation"][7:14] for one in resets])
    np.testing.assert_allclose(states[:, :3], [(2.875, -0.225, 3.651)] * 300, rtol=0, atol=1e-3)
    np.testing.assert_allclose(states[:, 4], -np.pi / 2, rtol=0, atol=2e-3)
    np.testing.assert_allclose(states[:, 6], 0, rtol=0, atol=1e-3)


def test_goals_are_normally_distributed_on_the_side_of_psm2(resets):
    """docs/scenes.md#needle-regrasp: around (2.875, -0.225, 3.651), standard deviation 0.025."""
    goals = np.array([one["desired_goal"] for one in resets])
    np.testing.assert_allclose(goals.mean(axis=0), (2.875, -0.225, 3.651), rtol=0, atol=4 * 0.025 / np.sqrt(300))
    np.testing.assert_allclose(goals.std(axis=0), 0.025, rtol=4 / np.sqrt(600))
    np.testing.assert_allclose(np.corrcoef(goals.T) - np.eye(3), 0, atol=4 / np.sqrt(300))


# ----------------------------------------------------------------------------------------------------- what is observed


@pytest.mark.parametrize("steps", [0, 12, 40])
def test_every_index_of_the_observation_holds_what_the_docstring_says(env, steps):
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=3)
    for _ in range(steps):
        observation, *_ = env.step(expert.act(observation))
    state = observation["observation"]
    for start, arm in zip((0, 7), env.arms, strict=True):
        position, euler = arm.pose()
        np.testing.assert_allclose(state[start : start + 3], position, atol=1e-6)
        np.testing.assert_allclose(state[start + 3 : start + 6], euler, atol=1e-6)
        assert state[start + 6] == pytest.approx(arm.jaw_angle(), abs=1e-6)
    client = env.world.client
    body = next(body for body in range(client.getNumBodies()) if client.getBodyInfo(body)[1] == b"needle")
    centre, orientation = client.getBasePositionAndOrientation(body)
    axes = np.reshape(client.getMatrixFromQuaternion(orientation), (3, 3)).T
    np.testing.assert_allclose(state[14:17], centre, atol=1e-6)
    np.testing.assert_allclose(state[17:20], state[14:17] - state[:3], atol=1e-6)
    np.testing.assert_allclose(state[20:23], state[14:17] - state[7:10], atol=1e-6)
    arc_centre = centre + 0.0635 * axes[0]  # docs/objects.md#needle
    for start, side in ((23, -1), (29, 1)):  # docs/objects.md#needle, waypoints 4 and 5
        radial = 0.5 * axes[0] - side * np.sqrt(0.75) * axes[1]
        np.testing.assert_allclose(state[start : start + 3], arc_centre - 0.1 * radial, atol=1e-4)
        turned = client.getMatrixFromQuaternion(client.getQuaternionFromEuler(state[start + 3 : start + 6]))
        np.testing.assert_allclose(np.reshape(turned, (3, 3)).T[[0, 2]], (radial, axes[2]), atol=1e-4)
    np.testing.assert_array_equal(observation["achieved_goal"], state[23:26])


def test_the_names_of_the_observation_say_the_same(env):
    names = env.observation_names
    assert len(names) == 35
    assert len(set(names)) == 35
    for start in (0, 7, 14, 17, 20, 23, 29):
        assert [name.rsplit("_", 1)[1] for name in names[start : start + 3]] == ["x", "y", "z"]
    for start in (3, 10, 26, 32):
        assert [name.rsplit("_", 1)[1] for name in names[start : start + 3]] == ["roll", "pitch", "yaw"]
    assert (names[6], names[13]) == ("psm1_jaw", "psm2_jaw")
    assert (env.action_names[3], env.action_names[8]) == ("psm1_dpitch", "psm2_dpitch")


def test_a_pitch_of_one_turns_either_tool_about_itself_by_15_degrees(env):
    """docs/actions.md#what-an-action-does."""
    env.reset(seed=0)
    for index, arm in enumerate(env.arms):
        before = arm.pose()
        action = stay(CLOSE, CLOSE)
        action[5 * index + 3] = 1.0
        env.step(action)
        after = arm.pose()
        assert np.rad2deg(after[1][1] - before[1][1]) == pytest.approx(0.9936 * 15, rel=0.02)
        np.testing.assert_allclose(after[0], before[0], rtol=0, atol=2e-3)


# -------------------------------------------------------------------------------------------------------------- success


@pytest.mark.parametrize(("distance", "success"), [(0.0, True), (0.0249, True), (0.0251, False), (1.0, False)])
def test_success_is_within_0_025_of_the_goal(env, distance, success):
    goal = np.array((2.875, -0.225, 3.651))
    for direction in ((1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0, 0.8)):
        assert env.is_success(goal + np.multiply(direction, distance), goal) == success


def test_bringing_psm2_to_the_goal_without_the_needle_is_no_success(env):
    observation, _ = env.reset(seed=0)
    for _ in range(20):
        action = stay(CLOSE, CLOSE)
        to_goal = observation["desired_goal"] - (0.0435, 0, 0) - observation["observation"][7:10]
        action[5:8] = np.clip(to_goal / 0.05, -1, 1)
        observation, _, _, _, info = env.step(action)
        assert not info["is_success"]


def test_psm1_alone_cannot_reach_the_goal(env):
    """Its workspace ends before: the needle has to be handed over."""
    observation, _ = env.reset(seed=0)
    for _ in range(30):
        action = stay(CLOSE, CLOSE)
        action[:3] = np.clip((observation["desired_goal"] - observation["achieved_goal"]) / 0.05, -1, 1)
        observation, _, _, _, info = env.step(action)
        assert not info["is_success"]
    assert attached(env) == (True, False)


def test_the_expert_succeeds_in_time_and_holds_the_goal(demonstrations):
    for episode in demonstrations("NeedleRegrasp"):
        assert episode.first <= 37
        assert episode.holds
        # PSM1 opens only when the jaws of PSM2 are closed around the needle.
        opens = next(step for step, action in enumerate(episode.actions) if action[4] > 0)
        assert 0.1 < episode.observations[opens]["observation"][13] < 0.3
        held = [step for step, (_, second) in enumerate(episode.attached) if second]
        jaws = [episode.observations[step + 1]["observation"][13] for step in held]
        assert min(held) >= opens
        # Deeper between the jaws than PSM1 holds it, at 0.19.
        np.testing.assert_allclose(jaws, 0.215, rtol=0, atol=0.015)


# -------------------------------------------------------------------------------------------------------------- holding


def test_only_one_arm_holds_the_needle_at_a_time(env):
    """docs/grasping.md#the-rule: PSM2 takes it in the step in which PSM1 opens."""
    play(env, both_hold)
    for _ in range(3):
        env.step(stay(CLOSE, CLOSE))
        assert attached(env) == (True, False)
    env.step(stay(OPEN, CLOSE))
    assert attached(env) == (False, True)
    env.step(stay(OPEN, CLOSE))
    assert attached(env) == (False, True)


def test_a_needle_that_nobody_holds_falls_onto_the_table(env):
    env.reset(seed=0)
    for _ in range(5):
        observation, _, _, _, info = env.step(stay(OPEN, CLOSE))
        assert attached(env) == (False, False)
    assert observation["observation"][16] < 3.5
    assert not info["is_success"]


def test_the_expert_stays_where_it_is_when_the_needle_is_lost(env):
    expert = surrol_gym.make_expert(env)
    env.reset(seed=0)
    for _ in range(5):
        observation, *_ = env.step(stay(OPEN, CLOSE))
    np.testing.assert_array_equal(expert.act(observation)[[0, 1, 2, 3, 5, 6, 7, 8]], 0)


@pytest.mark.parametrize(
    ("moment", "held"),
    [(lambda *_: True, (True, False)), (both_hold, (True, False)), (handed_over, (False, True))],
    ids=["at reset", "both hold", "handed over"],
)
def test_a_held_needle_is_part_of_the_state(env, moment, held):
    """The episode goes on from there as if never left, in this environment and in another."""
    play(env, moment)
    assert attached(env) == held
    state = env.get_state()
    actions = np.random.default_rng(0).uniform(-0.1, 0.1, (8, 10))
    actions[:, [4, 9]] = OPEN if held[1] else CLOSE, CLOSE
    uninterrupted = [env.step(action) for action in actions]
    assert attached(env) == held
    other = NeedleRegraspEnv()
    env.reset(seed=1)
    for restored in (env, other):
        restored.set_state(state)
        assert attached(restored) == held
        for action, (observation, reward, _, _, info) in zip(actions, uninterrupted, strict=True):
            again, again_reward, _, _, again_info = restored.step(action)
            assert {key: value.tobytes() for key, value in again.items()} == {
                key: value.tobytes() for key, value in observation.items()
            }
            assert (again_reward, again_info) == (reward, info)
    other.close()


def test_a_reset_gives_the_needle_back_to_psm1(env):
    before = env.reset(seed=0)[0]["observation"]
    play(env, handed_over, seed=1)
    assert attached(env) == (False, True)
    again = env.reset(seed=0)[0]["observation"]
    assert attached(env) == (True, False)
    np.testing.assert_array_equal(again, before)
