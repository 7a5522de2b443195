import numpy as np
import pybullet
import pytest

import surrol_gym
from surrol_gym.tasks.match_board_panel import MatchBoardPanelEnv

OPEN, CLOSE = 1.0, -1.0
REST_HEIGHT = 3.3882  # docs/reference_values.md#heights-at-rest
CELL_REST = 3.3999
"""Height of a letter that lies on a plate: half its thickness and PyBullet's margin above it."""


@pytest.fixture(scope="module")
def env():
    env = MatchBoardPanelEnv()
    yield env
    env.close()


@pytest.fixture(scope="module")
def resets(env):
    """Observations of 300 resets."""
    env.reset(seed=0)
    return [env.reset()[0] for _ in range(300)]


@pytest.fixture(scope="module")
def episode(env):
    """Observations, states and infos of an expert's episode."""
    expert = surrol_gym.make_expert(env)
    observation, info = env.reset(seed=3)
    history = [(observation, env.get_state(), info)]
    for _ in range(100):
        observation, _, _, _, info = env.step(expert.act(observation))
        history.append((observation, env.get_state(), info))
    return history


def slid(observation):
    return float(observation["observation"][20] + 0.1)


def arrange(env, letter, opened, euler=(0, 0, 0), seed=0):
    """Puts the letter somewhere and opens the lid over the goal's row; returns what the next step returns."""
    observation, _ = env.reset(seed=seed)
    panel, row = env._panel, round((observation["desired_goal"][0] - 2.625) / 0.125)
    env.world.place(env._letter, letter, pybullet.getQuaternionFromEuler(euler))
    env.world.client.resetJointState(panel, row, opened)
    for _ in range(2):
        returned = env.step(np.array((0, 0, 0, 0, CLOSE)))
    return returned


# -------------------------------------------------------------------------------------------------------- how it starts


def test_the_letter_lies_beside_the_panel(resets):
    """docs/scenes.md#match-board-panel: x in [3.0, 3.01], y in [0.175, 0.195], each uniform; at rest 3.3882 high."""
    letters = np.array([one["observation"][7:10] for one in resets])
    np.testing.assert_allclose(letters[:, 2], REST_HEIGHT, rtol=0, atol=3e-4)
    low, high = np.array((3.0, 0.175)), np.array((3.01, 0.195))
    assert np.all(letters[:, :2] > low - 1e-4)
    assert np.all(letters[:, :2] < high + 1e-4)
    np.testing.assert_allclose(letters[:, :2].mean(axis=0), (low + high) / 2, rtol=0, atol=2e-3)
    np.testing.assert_allclose(letters[:, :2].std(axis=0), (high - low) / np.sqrt(12), rtol=0.1)


def test_each_of_the_nine_cells_is_the_goal_equally_often(resets):
    goals = np.array([one["desired_goal"] for one in resets])
    np.testing.assert_allclose(goals[:, 2], 3.3954, rtol=0, atol=1e-6)
    rows, columns = (goals[:, 0] - 2.625) / 0.125, (goals[:, 1] + 0.225) / 0.125
    np.testing.assert_allclose(rows, np.round(rows), rtol=0, atol=1e-4)
    np.testing.assert_allclose(columns, np.round(columns), rtol=0, atol=1e-4)
    counts = np.bincount(np.round(3 * rows + columns).astype(int), minlength=9)
    # 33 are expected, with a standard deviation of 5.4.
    assert len(counts) == 9
    assert counts.min() > 33 - 4 * 5.4
    assert counts.max() < 33 + 4 * 5.4


def test_the_goal_of_the_handle_is_where_it_is_while_the_lid_is_closed(resets):
    for one in resets:
        np.testing.assert_allclose(one["desired_goal"][3:], one["achieved_goal"][3:], rtol=0, atol=1e-6)
        np.testing.assert_allclose(one["desired_goal"][3:], (one["desired_goal"][0], 0.08125, 3.4354), atol=1e-4)


def test_the_letter_and_the_lids_stay_where_they_are(env):
    before = env.reset(seed=0)[0]["observation"]
    for _ in range(10):
        observation, *_ = env.step(np.zeros(5))
    np.testing.assert_allclose(observation["observation"][7:10], before[7:10], rtol=0, atol=1e-5)
    np.testing.assert_array_equal(observation["observation"][19:25], before[19:25])


def test_the_arm_starts_as_the_original(env):
    """docs/psm.md#start-poses."""
    state = env.reset(seed=0)[0]["observation"]
    np.testing.assert_allclose(state[:3], (2.4, 0.125, 3.626), rtol=0, atol=1e-4)
    np.testing.assert_allclose(state[3:7], (-np.pi / 2, 0, np.pi / 2, 0), rtol=0, atol=1e-3)


# ----------------------------------------------------------------------------------------------------- what is observed


@pytest.mark.parametrize("step", [0, 18, 40, 90])
def test_every_index_of_the_observation_holds_what_the_docstring_says(env, episode, step):
    observation, state, _ = episode[step]
    env.set_state(state)
    numbers = observation["observation"]
    position, euler = env.arms[0].pose()
    np.testing.assert_allclose(numbers[:3], position, atol=1e-6)
    np.testing.assert_allclose(numbers[3:6], euler, atol=1e-6)
    assert numbers[6] == pytest.approx(env.arms[0].jaw_angle(), abs=1e-6)
    client = env.world.client
    bodies = {client.getBodyInfo(body)[1]: body for body in range(client.getNumBodies())}
    letter = client.getBasePositionAndOrientation(bodies[b"letter_C"])
    np.testing.assert_allclose(numbers[7:10], letter[0], atol=1e-6)
    np.testing.assert_allclose(numbers[10:13], numbers[7:10] - numbers[:3], atol=1e-6)
    turn = pybullet.getQuaternionFromEuler((0, 0, np.pi / 2))
    grip = pybullet.multiplyTransforms(*letter, (0, -0.03125, 0.0375), turn)  # docs/scenes.md#match-board-panel
    np.testing.assert_allclose(numbers[13:16], grip[0], atol=1e-6)
    np.testing.assert_allclose(numbers[16:19], pybullet.getEulerFromQuaternion(grip[1]), atol=1e-6)
    row = round((observation["desired_goal"][0] - 2.625) / 0.125)
    lid = np.array(client.getLinkState(bodies[b"match_panel"], row, computeForwardKinematics=True)[4])
    np.testing.assert_allclose(numbers[19:22], lid, atol=1e-5)
    np.testing.assert_allclose(numbers[22:25], lid + (0, 0.18125, 0.0125), atol=1e-5)
    np.testing.assert_array_equal(numbers[25:31], observation["desired_goal"])
    np.testing.assert_array_equal(observation["achieved_goal"], numbers[[7, 8, 9, 22, 23, 24]])


def test_the_names_of_the_observation_say_the_same(env):
    names = env.observation_names
    assert len(names) == 31
    assert [name.rsplit("_", 1)[1] for name in names[7:]] == [*"xyz" * 3, "roll", "pitch", "yaw", *"xyz" * 4]
    assert len(env.goal_names) == 6


# -------------------------------------------------------------------------------------------------------------- success


def test_the_letter_in_its_cell_below_the_closed_lid_is_success(env):
    goal = env.reset(seed=0)[0]["desired_goal"]
    observation, reward, _, _, info = arrange(env, (*goal[:2], CELL_REST), opened=0)
    assert info["is_success"]
    assert reward == 0
    np.testing.assert_allclose(observation["achieved_goal"][:3], (*goal[:2], CELL_REST), rtol=0, atol=1e-3)


@pytest.mark.parametrize("opened", [0.03, 0.2, 0.375])
def test_the_letter_in_its_cell_below_an_open_lid_is_no_success(env, opened):
    goal = env.reset(seed=0)[0]["desired_goal"]
    observation, reward, _, _, info = arrange(env, (*goal[:2], CELL_REST), opened)
    assert slid(observation) == pytest.approx(opened, abs=1e-4)
    assert not info["is_success"]
    assert reward == -1


def test_a_closed_lid_alone_is_no_success(resets):
    for one in resets:
        assert np.linalg.norm(one["achieved_goal"] - one["desired_goal"]) > 0.025


def test_the_letter_in_another_cell_is_no_success(env):
    goal = env.reset(seed=0)[0]["desired_goal"]
    for x in (2.625, 2.75, 2.875):
        for y in (-0.225, -0.1, 0.025):
            info = arrange(env, (x, y, CELL_REST), opened=0)[4]
            assert info["is_success"] == (abs(x - goal[0]) + abs(y - goal[1]) < 1e-3)


def test_the_letter_on_the_lid_above_its_cell_is_no_success(env):
    goal = env.reset(seed=0)[0]["desired_goal"]
    observation, _, _, _, info = arrange(env, (*goal[:2], 3.4377), opened=0)
    assert observation["achieved_goal"][2] > 3.43
    assert not info["is_success"]


@pytest.mark.parametrize(("parts", "success"), [((0.017, 0.017), True), ((0.019, 0.019), False), ((0.0, 0.026), False)])
def test_success_is_within_0_025_of_both_parts_together(env, parts, success):
    goal = np.array((2.75, -0.1, 3.3954, 2.75, 0.08125, 3.4354))
    assert env.is_success(goal + (parts[0], 0, 0, 0, parts[1], 0), goal) == success


# ------------------------------------------------------------------------------------------------------------- the lids


def test_lids_stay_where_they_are_left_and_move_only_when_pushed(episode):
    """docs/scenes.md#match-board-panel: only the arm overcomes the 240 N su of their motors."""
    amounts = np.array([slid(observation) for observation, _, _ in episode])
    opened = np.argmax(amounts > 0.354)
    placed = next(
        step for step in range(opened, 100) if episode[step][0]["observation"][9] < 3.41 and amounts[step] < 0.3
    )
    still = amounts[opened + 2 : placed - 2]
    assert len(still) > 20
    np.testing.assert_allclose(still, still[0], rtol=0, atol=1e-4)
    assert amounts[-1] < 0.006


def test_a_letter_falling_on_an_open_lid_does_not_move_it(env):
    goal = env.reset(seed=0)[0]["desired_goal"]
    observation, *_ = arrange(env, (goal[0], 0.25, 3.5), opened=0.3)
    assert slid(observation) == pytest.approx(0.3, abs=1e-4)


# -------------------------------------------------------------------------------------------------------------- holding


def test_friction_alone_holds_the_letter(env, episode):
    """docs/grasping.md#the-rule: no constraint attaches it in this task."""
    assert not env.grasps[0]
    assert env.world.client.getNumConstraints() == 1, "the one that holds link 5"
    carried = [one["observation"] for one, _, _ in episode if one["observation"][9] > 3.43]
    assert len(carried) > 8
    assert all(0.05 < state[6] < 0.25 for state in carried)


def test_opening_the_jaws_drops_the_letter(env, episode):
    state = next(state for observation, state, _ in episode if observation["observation"][9] > 3.45)
    env.set_state(state)
    for _ in range(5):
        observation, *_ = env.step(np.array((0, 0, 0, 0, OPEN)))
    assert observation["observation"][9] < 3.44


@pytest.mark.parametrize("phase", ["pushing", "carrying"])
def test_what_is_touched_is_part_of_the_state(env, episode, phase):
    """The episode goes on from there as if never left, in this environment and in another."""
    low, high, index = (0.0, 0.2, 20) if phase == "pushing" else (3.45, 4.0, 9)
    state = next(state for one, state, _ in episode if low < one["observation"][index] < high)
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (8, 5))
    actions[:, 4] = CLOSE
    env.set_state(state)
    uninterrupted = [env.step(action) for action in actions]
    other = MatchBoardPanelEnv()
    env.reset(seed=1)
    for restored in (env, other):
        restored.set_state(state)
        for action, (observation, reward, _, _, info) in zip(actions, uninterrupted, strict=True):
            again, again_reward, _, _, again_info = restored.step(action)
            assert {key: value.tobytes() for key, value in again.items()} == {
                key: value.tobytes() for key, value in observation.items()
            }
            assert (again_reward, again_info) == (reward, info)
    other.close()


def test_all_lids_are_part_of_the_state(env):
    env.reset(seed=0)
    for lid, amount in enumerate((0.1, 0.2, 0.3)):
        env.world.client.resetJointState(env._panel, lid, amount)
    env.step(np.zeros(5))
    state = env.get_state()
    env.reset(seed=1)
    env.set_state(state)
    amounts = [joint[0] for joint in env.world.client.getJointStates(env._panel, range(3))]
    np.testing.assert_allclose(amounts, (0.1, 0.2, 0.3), rtol=0, atol=1e-6)


# ----------------------------------------------------------------------------------------------------------- the expert


def test_the_expert_puts_the_letter_away_and_leaves_it_there(demonstrations):
    for episode in demonstrations("MatchBoardPanel"):
        assert episode.first <= 85
        assert episode.holds


def test_the_expert_puts_a_letter_aside_that_is_in_the_way_of_the_lid(env):
    expert = surrol_gym.make_expert(env)
    goal = env.reset(seed=0)[0]["desired_goal"]
    observation, *_ = arrange(env, (goal[0], 0.25, REST_HEIGHT), opened=0.375)
    for _ in range(180):
        observation, _, _, _, info = env.step(expert.act(observation))
    assert info["is_success"]


@pytest.mark.parametrize("seed", range(3))
def test_the_letter_passes_above_the_handles_of_closed_lids(env, seed):
    """Where it hits one it swings round between the jaws and falls."""
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=seed)
    distances = []
    for _ in range(60):
        observation, *_ = env.step(expert.act(observation))
        x, y, z = observation["observation"][7:10]
        if x < 2.97 and abs(y - 0.08) < 0.08 and z > 3.45:
            distances += [point[8] for point in env.world.client.getClosestPoints(env._letter, env._panel, 0.1)]
    assert min(distances) > 0.015


@pytest.mark.parametrize(
    ("letter", "yaw", "seed"),
    [
        ((2.657, -0.266, CELL_REST), 0.63, 0),
        ((2.65, -0.245, CELL_REST), 1.03, 0),
        ((2.855, 0.126, REST_HEIGHT), -0.57, 2),
    ],
    ids=["near a closed lid and the limit", "near a closed lid", "between closed and open lid"],
)
def test_the_expert_grasps_the_letter_where_the_jaws_have_room(env, letter, yaw, seed):
    expert = surrol_gym.make_expert(env)
    observation, *_ = arrange(env, letter, 0.359, (0, 0, yaw), seed)
    for _ in range(100):
        observation, _, _, _, info = env.step(expert.act(observation))
    assert info["is_success"]


@pytest.mark.parametrize("yaw", [0.0, 1.6])
def test_the_expert_pushes_a_letter_over_that_stands_on_its_edge(env, yaw):
    expert = surrol_gym.make_expert(env)
    observation, *_ = arrange(env, (2.97, 0.15, 3.406), 0.359, (np.pi / 2, 0, yaw))
    assert observation["observation"][9] > 3.4
    for _ in range(150):
        observation, _, _, _, info = env.step(expert.act(observation))
    assert info["is_success"]


def test_the_expert_turns_the_tool_back_the_way_it_came(env):
    """Half a turn away from the handle, a joint would stop the shorter way."""
    observation, _ = env.reset(seed=0)
    for yaw in (3.1, -3.1):
        observation["observation"][5] = yaw
        assert surrol_gym.make_expert(env).act(observation)[3] < -0.1
