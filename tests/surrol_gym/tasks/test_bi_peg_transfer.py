import numpy as np
import pybullet
import pytest

import surrol_gym
from surrol_gym.tasks.bi_peg_transfer import BiPegTransferEnv

OPEN, CLOSE = 1.0, -1.0
REST_HEIGHT, GOAL_HEIGHT = 3.5275, 3.545  # docs/scenes.md#bi-peg-transfer
TARGETS = np.array([(2.6, 0.215), (2.7, 0.215), (2.8, 0.215), (2.6, 0.065), (2.7, 0.065), (2.8, 0.065)])
SOURCES = np.array(
    [(2.585, -0.135), (2.815, -0.135), (2.6425, -0.0354), (2.7575, -0.0354), (2.6425, -0.2346), (2.7575, -0.2346)]
)


@pytest.fixture(scope="module")
def env():
    env = BiPegTransferEnv()
    yield env
    env.close()


@pytest.fixture(scope="module")
def resets(env):
    """Observation, and poses of the red and the blue blocks, of 300 resets."""
    env.reset(seed=0)
    return [(env.reset()[0], blocks(env, b"block_red")[0], blocks(env, b"block")) for _ in range(300)]


def blocks(env, name):
    """Positions, shape (3,), and yaws of the bodies of a name."""
    client = env.world.client
    found = [body for body in range(client.getNumBodies()) if client.getBodyInfo(body)[1] == name]
    poses = [client.getBasePositionAndOrientation(body) for body in found]
    return [(np.array(position), client.getEulerFromQuaternion(turn)[2]) for position, turn in poses]


def nearest(position, pegs):
    """Index of the peg of a block, which must be on one."""
    distances = np.linalg.norm(pegs - position[:2], axis=1)
    assert distances.min() < 0.01
    return distances.argmin()


def run(env, steps, until=None, seed=None):
    """Lets the expert act from a reset, until something holds; returns all observations and infos."""
    expert = surrol_gym.make_expert(env)
    observation, info = env.reset(seed=seed)
    history = [(observation, info)]
    for _ in range(steps):
        observation, _, _, _, info = env.step(expert.act(observation))
        history.append((observation, info))
        if until is not None and until(observation):
            return history
    assert until is None, "it did not happen"
    return history


def attached(env):
    """Which arm the block is fixed to."""
    return [grasp.attached for (grasp,) in env.grasps]


def put(env, position, euler=(0, 0, 0)):
    """Puts the red block somewhere and lets it settle, both arms away; returns what the last step returned."""
    state = env.get_state()
    env.world.place(env._board.body, position, pybullet.getQuaternionFromEuler(euler))
    for _ in range(5):
        returned = env.step(np.array((0, 0.2, 0.2, 0, OPEN, 0, -0.2, 0.2, 0, OPEN)))
    env.set_state(state)
    return returned


# -------------------------------------------------------------------------------------------------------- how it starts


def test_the_blocks_rest_at_their_measured_height(resets):
    for _, (red, _), others in resets:
        np.testing.assert_allclose([red[2], *(other[2] for other, _ in others)], REST_HEIGHT, rtol=0, atol=5e-4)


def test_there_is_a_block_on_every_source_peg_and_the_red_one_on_any(resets):
    """docs/scenes.md#bi-peg-transfer."""
    reds = [nearest(red, SOURCES) for _, (red, _), _ in resets]
    for red, (_, _, others) in zip(reds, resets, strict=True):
        assert sorted([red, *(nearest(other, SOURCES) for other, _ in others)]) == list(range(6))
    # 300 draws of six pegs: four standard deviations around 50.
    assert np.all(np.abs(np.bincount(reds, minlength=6) - 50) < 4 * 6.5)


def test_every_block_is_turned_by_up_to_30_degrees(resets):
    yaws = np.rad2deg([[red[1], *(yaw for _, yaw in others)] for _, red, others in resets])
    assert 29 < np.abs(yaws).max() < 31
    np.testing.assert_allclose(yaws.std(axis=0), 30 / np.sqrt(3), rtol=0.12)
    assert np.all(np.abs(np.corrcoef(yaws.T) - np.eye(6)) < 4 / np.sqrt(300))


def test_the_goal_is_the_frame_of_any_target_peg(resets):
    goals = np.array([observation["desired_goal"] for observation, _, _ in resets])
    np.testing.assert_allclose(goals[:, 2], GOAL_HEIGHT, rtol=0, atol=1e-6)
    pegs = [nearest(goal, TARGETS) for goal in goals]
    np.testing.assert_allclose(goals[:, :2], TARGETS[pegs], rtol=0, atol=1e-4)
    assert np.all(np.abs(np.bincount(pegs, minlength=6) - 50) < 4 * 6.5)


# ----------------------------------------------------------------------------------------------------- what is observed


@pytest.mark.parametrize("steps", [0, 10, 25, 40])
def test_every_index_of_the_observation_holds_what_the_docstring_says(env, steps):
    observation, _ = run(env, steps, seed=3)[-1]
    state = observation["observation"]
    for arm, part in zip(env.arms, (state[:7], state[7:14]), strict=True):
        position, euler = arm.pose()
        np.testing.assert_allclose(part[:3], position, atol=1e-6)
        np.testing.assert_allclose(part[3:6], euler, atol=1e-6)
        assert part[6] == pytest.approx(arm.jaw_angle(), abs=1e-6)
    [(centre, yaw)] = blocks(env, b"block_red")
    np.testing.assert_allclose(state[14:17], centre, atol=1e-6)
    np.testing.assert_allclose(state[17:20], state[14:17] - state[:3], atol=1e-6)
    np.testing.assert_allclose(state[20:23], state[14:17] - state[7:10], atol=1e-6)
    for azimuth, part in ((60, state[23:29]), (-60, state[29:35])):
        assert np.linalg.norm(part[:3] - centre) == pytest.approx(0.025, abs=1e-4)
        if steps == 0:  # upright
            wall = np.deg2rad(azimuth) + yaw
            np.testing.assert_allclose(part[:3], centre + 0.025 * np.array((np.cos(wall), np.sin(wall), 0)), atol=1e-4)
            np.testing.assert_allclose(part[3:5], 0, atol=1e-3)
            assert np.cos(part[5] - wall) == pytest.approx(-1, abs=1e-6)
    np.testing.assert_array_equal(observation["achieved_goal"], state[14:17])


@pytest.mark.parametrize("arm", [0, 1])
def test_the_first_five_numbers_of_an_action_move_the_first_arm_and_the_others_the_second(env, arm):
    env.reset(seed=0)
    before = [(*env.arms[index].pose(), env.arms[index].jaw_angle()) for index in (arm, 1 - arm)]
    action = np.zeros(10)
    action[[4, 9]] = CLOSE
    action[5 * arm : 5 * arm + 5] = (0.2, 0, -0.2, 1, OPEN)
    env.step(action)
    (position, euler, jaw), (other_position, other_euler, _) = before
    np.testing.assert_allclose(env.arms[arm].pose()[0] - position, (0.01, 0, -0.01), rtol=0, atol=3e-4)
    assert np.rad2deg(env.arms[arm].pose()[1][2] - euler[2]) == pytest.approx(20, rel=0.02)
    assert env.arms[arm].jaw_angle() > jaw + 0.6
    np.testing.assert_allclose(env.arms[1 - arm].pose()[0], other_position, rtol=0, atol=1e-4)
    np.testing.assert_allclose(env.arms[1 - arm].pose()[1], other_euler, rtol=0, atol=1e-3)


def test_only_the_first_arm_reaches_the_targets_and_only_the_second_the_sources(env):
    (low1, high1), (low2, high2) = (mount.limits() for mount in env.mounts)
    np.testing.assert_allclose((low1, high1), ((2.48, -0.02, 3.481), (3.02, 0.27, 3.856)), rtol=0, atol=1e-9)
    np.testing.assert_allclose((low2, high2), ((2.48, -0.27, 3.481), (3.02, 0.02, 3.856)), rtol=0, atol=1e-9)


# -------------------------------------------------------------------------------------------------------------- success


def test_a_block_on_the_peg_is_success(env):
    observation, _ = env.reset(seed=0)
    observation, reward, _, _, info = put(env, observation["desired_goal"] + (0, 0, 0.05))
    assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=1e-3)
    assert info["is_success"]
    assert reward == 0


@pytest.mark.parametrize("angle", np.deg2rad([0, 90, 180, 270]))
def test_a_block_beside_the_peg_is_no_success(env, angle):
    """Flat against the peg, upright: the nearest that it can be without being on it."""
    observation, _ = env.reset(seed=0)
    beside = observation["desired_goal"] + 0.032 * np.array((np.cos(angle), np.sin(angle), 0)) - (0, 0, 0.0175)
    observation, reward, _, _, info = put(env, beside, (0, 0, angle))
    assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=1e-3)
    assert not info["is_success"]
    assert reward == -1


def test_a_block_on_another_peg_is_no_success(env):
    observation, _ = env.reset(seed=0)
    for peg in TARGETS:
        observation, _, _, _, info = put(env, (*peg, GOAL_HEIGHT + 0.02))
        assert info["is_success"] == (np.linalg.norm(peg - observation["desired_goal"][:2]) < 0.01)


def test_a_block_held_above_the_goal_is_no_success(env):
    def above(observation):
        offset = observation["achieved_goal"] - observation["desired_goal"]
        return np.hypot(offset[0], offset[1]) < 0.01 and offset[2] > 0.06

    _, info = run(env, 100, above, seed=0)[-1]
    for _ in range(3):
        assert attached(env) == [True, False]
        assert not info["is_success"]
        *_, info = env.step(np.array((0, 0, 0, 0, CLOSE, 0, 0, 0, 0, OPEN)))


# -------------------------------------------------------------------------------------------------------------- holding


def test_the_block_changes_hands_and_is_never_attached_to_both_arms(demonstrations):
    """docs/grasping.md#the-rule: the receiving arm attaches it in the step after the giving arm opened."""
    for episode in demonstrations("BiPegTransfer", 3):
        pairs = zip(episode.attached, episode.actions, strict=True)
        holders = [(*attached, bool(action[9] >= 0)) for attached, action in pairs]
        heights = [observation["achieved_goal"][2] for observation in episode.observations[1:]]
        phases = [holder[:2] for i, holder in enumerate(holders) if i == 0 or holder[:2] != holders[i - 1][:2]]
        assert phases == [(False, False), (False, True), (False, False), (True, False), (False, False)]
        given = max(index for index, holder in enumerate(holders) if holder[1]) + 1
        assert holders[given] == (False, False, True), "held by friction"
        assert holders[given + 1] == (True, False, True)
        assert heights[given + 1] == pytest.approx(heights[given - 1], abs=0.01)


def test_an_arm_cannot_attach_the_block_that_the_other_holds(env):
    def both(observation):
        jaws = observation["observation"][[6, 13]]
        return all(0.05 < jaw < 0.5 for jaw in jaws)

    run(env, 100, both, seed=0)
    for _ in range(3):
        env.step(np.array((0, 0, 0, 0, CLOSE) * 2))
        assert attached(env) == [False, True]


def test_the_jaws_hold_the_block_at_the_measured_angle(env):
    """docs/reference_values.md: about 0.147 rad; a few degrees of tilt make a wall look thicker to the jaws."""
    lifted = [run(env, 50, lambda one: one["achieved_goal"][2] > REST_HEIGHT + 0.05, seed)[-1][0] for seed in range(6)]
    np.testing.assert_allclose([one["observation"][13] for one in lifted], 0.147, rtol=0, atol=0.045)


@pytest.mark.parametrize("holder", [[False, True], [True, False]], ids=["by PSM2", "by PSM1"])
def test_a_held_block_is_part_of_the_state(env, holder):
    """The episode goes on from there as if never left, in this environment and in another."""
    expert = surrol_gym.make_expert(env)
    run(env, 100, lambda _: attached(env) == holder, seed=0)
    state = env.get_state()
    observation = env.set_state(state)
    actions, uninterrupted = [], []
    for _ in range(15):
        actions.append(expert.act(observation))
        uninterrupted.append(env.step(actions[-1]))
        observation = uninterrupted[-1][0]
    other = BiPegTransferEnv()
    env.reset(seed=1)
    for restored in (env, other):
        restored.set_state(state)
        assert attached(restored) == holder
        for action, (observation, reward, _, _, info) in zip(actions, uninterrupted, strict=True):
            again, again_reward, _, _, again_info = restored.step(action)
            assert {key: value.tobytes() for key, value in again.items()} == {
                key: value.tobytes() for key, value in observation.items()
            }
            assert (again_reward, again_info) == (reward, info)
    other.close()


# --------------------------------------------------------------------------------------------------------------- expert


def test_the_expert_hands_the_block_over_and_puts_it_on_its_peg(demonstrations):
    for episode in demonstrations("BiPegTransfer"):
        assert episode.first <= 75
        assert episode.holds
        observation = episode.observations[-1]
        assert observation["observation"][[6, 13]].min() > 0.6, "let go"
        assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=1e-3)


def test_the_expert_goes_on_after_the_block_fell_at_the_meeting_point(env):
    expert = surrol_gym.make_expert(env)
    observation, _ = run(env, 40, lambda observation: observation["achieved_goal"][1] > -0.01, seed=4)[-1]
    observation, *_ = env.step(np.array((0, 0, 0, 0, OPEN) * 2))
    for _ in range(150):
        observation, *_, info = env.step(expert.act(observation))
    assert info["is_success"]
