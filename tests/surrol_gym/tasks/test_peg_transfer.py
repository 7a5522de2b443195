import numpy as np
import pybullet
import pytest

import surrol_gym
from surrol_gym.tasks.peg_transfer import PegTransferEnv

OPEN, CLOSE = 1.0, -1.0
REST_HEIGHT, GOAL_HEIGHT = 3.523, 3.5405  # docs/scenes.md#peg-transfer
TARGETS = np.array([(2.6, 0.215), (2.7, 0.215), (2.8, 0.215), (2.6, 0.065), (2.7, 0.065), (2.8, 0.065)])
SOURCES = np.array(
    [(2.585, -0.135), (2.815, -0.135), (2.6425, -0.0354), (2.7575, -0.0354), (2.6425, -0.2346), (2.7575, -0.2346)]
)


@pytest.fixture(scope="module")
def env():
    env = PegTransferEnv()
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
    """Lets the expert act, from a reset if there is a seed; returns all observations and infos."""
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


def carried(env, height=0.08, seed=0):
    """Lets the expert lift the block; returns the last observation."""
    return run(env, 50, lambda observation: observation["achieved_goal"][2] > REST_HEIGHT + height, seed)[-1][0]


def put(env, position, euler=(0, 0, 0)):
    """Puts the red block somewhere and lets it settle, the arm still and open; returns what the last step returned."""
    state = env.get_state()
    env.world.place(env._board.body, position, pybullet.getQuaternionFromEuler(euler))
    for _ in range(5):
        returned = env.step(np.array((0, 0, 0.2, 0, OPEN)))
    env.set_state(state)
    return returned


# -------------------------------------------------------------------------------------------------------- how it starts


def test_the_blocks_rest_at_their_measured_height(resets):
    for _, (red, _), others in resets:
        np.testing.assert_allclose([red[2], *(other[2] for other, _ in others)], REST_HEIGHT, rtol=0, atol=5e-4)


def test_the_red_block_starts_on_any_source_peg_and_three_others_on_further_ones(resets):
    """docs/scenes.md#peg-transfer: sources shuffled, one of the blocks at random is the task's."""
    reds = [nearest(red, SOURCES) for _, (red, _), _ in resets]
    others = [{nearest(other, SOURCES) for other, _ in blues} for _, _, blues in resets]
    assert all(len(pegs) == 3 and red not in pegs for red, pegs in zip(reds, others, strict=True))
    # 300 draws of six pegs: four standard deviations around 50 and 150.
    assert np.all(np.abs(np.bincount(reds, minlength=6) - 50) < 4 * 6.5)
    assert np.all(np.abs([sum(peg in pegs for pegs in others) - 150 for peg in range(6)]) < 4 * 8.7)
    assert len({(red, *sorted(pegs)) for red, pegs in zip(reds, others, strict=True)}) > 55  # of 60


def test_every_block_is_turned_by_up_to_30_degrees(resets):
    yaws = np.rad2deg([[red[1], *(yaw for _, yaw in others)] for _, red, others in resets])
    assert np.abs(yaws).max() < 31
    assert np.abs(yaws).max() > 29
    np.testing.assert_allclose(yaws.std(axis=0), 30 / np.sqrt(3), rtol=0.12)
    assert np.all(np.abs(np.corrcoef(yaws.T) - np.eye(4)) < 4 / np.sqrt(300))


def test_the_goal_is_the_frame_of_any_target_peg(resets):
    goals = np.array([observation["desired_goal"] for observation, _, _ in resets])
    np.testing.assert_allclose(goals[:, 2], GOAL_HEIGHT, rtol=0, atol=1e-6)
    pegs = [nearest(goal, TARGETS) for goal in goals]
    np.testing.assert_allclose(goals[:, :2], TARGETS[pegs], rtol=0, atol=1e-4)
    assert np.all(np.abs(np.bincount(pegs, minlength=6) - 50) < 4 * 6.5)


def test_the_blocks_stay_where_they_are(env):
    env.reset(seed=0)
    before = blocks(env, b"block_red") + blocks(env, b"block")
    for _ in range(10):
        env.step(np.zeros(5))
    for (position, _), (now, _) in zip(before, blocks(env, b"block_red") + blocks(env, b"block"), strict=True):
        np.testing.assert_allclose(now, position, rtol=0, atol=1e-4)


# ----------------------------------------------------------------------------------------------------- what is observed


@pytest.mark.parametrize("steps", [0, 10, 22])
def test_every_index_of_the_observation_holds_what_the_docstring_says(env, steps):
    observation, _ = run(env, steps, seed=3)[-1]
    state = observation["observation"]
    position, euler = env.arms[0].pose()
    np.testing.assert_allclose(state[:3], position, atol=1e-6)
    np.testing.assert_allclose(state[3:6], euler, atol=1e-6)
    assert state[6] == pytest.approx(env.arms[0].jaw_angle(), abs=1e-6)
    [(centre, yaw)] = blocks(env, b"block_red")
    np.testing.assert_allclose(state[7:10], centre, atol=1e-6)
    np.testing.assert_allclose(state[10:13], state[7:10] - state[:3], atol=1e-6)
    if steps == 0:  # upright
        wall = np.deg2rad(60) + yaw
        np.testing.assert_allclose(state[13:16], centre + 0.025 * np.array((np.cos(wall), np.sin(wall), 0)), atol=1e-4)
        np.testing.assert_allclose(state[16:18], 0, atol=1e-3)
        assert np.cos(state[18] - wall) == pytest.approx(-1, abs=1e-6)
    np.testing.assert_array_equal(observation["achieved_goal"], state[7:10])


def test_a_turn_of_one_is_20_degrees(env):
    """docs/actions.md#what-an-action-does."""
    env.reset(seed=0)
    for turn in (1.0, -0.5):
        before = env.arms[0].pose()[1][2]
        env.step(np.array((0, 0, 0, turn, CLOSE)))
        assert np.rad2deg(env.arms[0].pose()[1][2] - before) == pytest.approx(0.9936 * 20 * turn, rel=0.01)


# -------------------------------------------------------------------------------------------------------------- success


@pytest.mark.parametrize(
    ("offset", "success"),
    [
        ((0, 0, -0.0175), True),  # at rest
        ((0.0249, 0, 0), True),
        ((0, -0.0251, 0), False),
        ((0.018, 0.018, 0), False),
        ((0, 0, 0.0199), True),
        ((0, 0, 0.0201), False),
        ((0, 0, -0.0201), False),
        ((0.02, 0, -0.019), True),  # across and height count separately
    ],
)
def test_success_is_within_0_025_across_and_0_02_up_or_down(env, offset, success):
    goal = np.array((2.6, 0.065, GOAL_HEIGHT))
    assert env.is_success(goal + offset, goal) == success
    np.testing.assert_array_equal(env.is_success(np.stack([goal + offset, goal]), np.stack([goal, goal])), (success, 1))


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
    observation, reward, _, _, info = put(env, beside, (0, 0, angle))  # its flat side at -x faces the peg
    assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=1e-3)
    assert not info["is_success"]
    assert reward == -1


def test_a_block_on_another_peg_is_no_success(env):
    observation, _ = env.reset(seed=0)
    for peg in TARGETS:
        observation, _, _, _, info = put(env, (*peg, GOAL_HEIGHT + 0.02))
        assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=1e-3)
        assert info["is_success"] == (np.linalg.norm(peg - observation["desired_goal"][:2]) < 0.01)


@pytest.mark.parametrize("euler", [(np.pi / 2, 0, 0), (0, np.pi / 2, 0)])
def test_a_block_lying_at_the_peg_is_no_success(env, euler):
    observation, _ = env.reset(seed=0)
    *_, info = put(env, observation["desired_goal"] + (0, 0.04, -0.02), euler)
    assert not info["is_success"]


def test_a_block_held_above_the_goal_is_no_success(env):
    def above(observation):
        offset = observation["achieved_goal"] - observation["desired_goal"]
        return np.hypot(offset[0], offset[1]) < 0.01 and offset[2] > 0.06

    observation, info = run(env, 50, above, seed=0)[-1]
    assert not info["is_success"]
    for _ in range(3):
        *_, info = env.step(np.array((0, 0, 0, 0, CLOSE)))
        assert env.grasps[0][0].attached
        assert not info["is_success"]


def test_bringing_the_tool_to_the_goal_without_the_block_is_no_success(env):
    observation, _ = env.reset(seed=0)
    for _ in range(15):
        offset = observation["desired_goal"] + (0, 0, 0.1) - observation["observation"][:3]
        observation, *_, info = env.step(np.array((*np.clip(offset / 0.05, -1, 1), 0, CLOSE)))
        assert not info["is_success"]


# -------------------------------------------------------------------------------------------------------------- holding


def test_the_block_is_attached_as_soon_as_closed_jaws_touched_it(env):
    """docs/grasping.md#the-rule: active in the step after both jaws touched, attached at its end, before any lift."""
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=0)
    touched = []
    for _ in range(50):
        observation, *_ = env.step(expert.act(observation))
        touched.append(all(env.arms[0].touches(env._board.body)))
        if env.grasps[0][0].attached:
            break
    assert touched[-2:] == [True, True]
    assert sum(touched) == 2
    assert observation["achieved_goal"][2] < REST_HEIGHT + 0.005


def test_a_block_that_open_jaws_touch_is_not_attached(env):
    carried(env)
    for _ in range(2):
        env.step(np.array((0, 0, 0, 0, OPEN)))
        assert not env.grasps[0][0].attached


def test_the_jaws_close_on_the_block_at_the_measured_angle(env):
    """docs/reference_values.md: about 0.147 rad; lifted, it tilts by a few degrees, and then a wall looks thicker to
    the jaws."""
    for seed in range(6):
        closed = run(env, 50, lambda observation: 0.05 < observation["observation"][6] < 0.5, seed)[-1][0]
        assert closed["observation"][6] == pytest.approx(0.147, abs=0.02)
        assert carried(env, seed=seed)["observation"][6] == pytest.approx(0.147, abs=0.045)


def test_a_held_block_follows_the_tool(env):
    held = carried(env, 0.14)["observation"][10:13]
    for action in ((1, 0, 0), (0, -1, 0), (-1, 0.5, 0.5)):
        observation, *_ = env.step(np.array((*action, 0, CLOSE)))
        np.testing.assert_allclose(observation["observation"][10:13], held, rtol=0, atol=0.01)


def test_losing_touch_with_one_jaw_releases_the_block(env):
    carried(env)
    grasp, arm = env.grasps[0][0], env.arms[0]
    assert grasp.attached
    arm._touching = {(env._board.body, 0)}
    grasp.after_step()
    assert not grasp.attached


def test_opening_the_jaws_releases_the_block_and_it_falls_back_onto_its_peg(env):
    carried(env, 0.03)
    for _ in range(3):
        observation, *_ = env.step(np.array((0, 0, 0, 0, OPEN)))
        assert not env.grasps[0][0].attached
    assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=2e-3)


def test_a_blue_block_is_never_attached(env):
    observation, _ = env.reset(seed=0)
    blue = blocks(env, b"block")[0][0]
    for gripper in (*[OPEN] * 25, *[CLOSE] * 4):
        target = blue + (0.025, 0, 0.066)
        offset = target - observation["observation"][:3]
        far = np.hypot(offset[0], offset[1]) > 0.005
        action = np.array((*np.clip((offset + (0, 0, 0.1 * far)) / 0.05, -1, 1), 0, gripper))
        observation, *_ = env.step(action)
        assert not env.grasps[0][0].attached


@pytest.mark.parametrize("height", [0.002, 0.1])
def test_a_held_block_is_part_of_the_state(env, height):
    """The episode goes on from there as if never left, in this environment and in another."""
    carried(env, height)
    state = env.get_state()
    assert env.grasps[0][0].attached
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (10, 5))
    actions[:, 2], actions[:, 4] = 0.4, CLOSE
    uninterrupted = [env.step(action) for action in actions]
    other = PegTransferEnv()
    env.reset(seed=1)
    for restored in (env, other):
        restored.set_state(state)
        assert restored.grasps[0][0].attached
        for action, (observation, reward, _, _, info) in zip(actions, uninterrupted, strict=True):
            again, again_reward, _, _, again_info = restored.step(action)
            assert {key: value.tobytes() for key, value in again.items()} == {
                key: value.tobytes() for key, value in observation.items()
            }
            assert (again_reward, again_info) == (reward, info)
    other.close()


# --------------------------------------------------------------------------------------------------------------- expert


def test_the_expert_transfers_the_block_and_leaves_it_there(demonstrations):
    """docs/reference_values.md: first success after 28 to 45 steps; ours is a little faster."""
    for episode in demonstrations("PegTransfer"):
        assert 25 <= episode.first <= 42
        assert episode.holds
        observation = episode.observations[-1]
        assert observation["observation"][6] > 0.6, "let go"
        assert observation["achieved_goal"][2] == pytest.approx(REST_HEIGHT, abs=1e-3)


@pytest.mark.parametrize("euler", [(np.pi / 2, 0, 0.5), (0, np.pi / 2, 0)])
def test_the_expert_stands_up_a_block_that_fell_over(env, euler):
    expert = surrol_gym.make_expert(env)
    env.reset(seed=2)
    env.world.place(env._board.body, (2.7, 0.0, 3.54), pybullet.getQuaternionFromEuler(euler))
    observation, *_ = env.step(np.zeros(5))
    for _ in range(90):
        observation, *_, info = env.step(expert.act(observation))
    assert info["is_success"]


def test_the_expert_grasps_again_after_losing_the_block(env):
    expert = surrol_gym.make_expert(env)
    observation = carried(env, 0.03)
    observation, *_ = env.step(np.array((0, 0, 0, 0, OPEN)))
    for _ in range(50):
        observation, *_, info = env.step(expert.act(observation))
    assert info["is_success"]
