import numpy as np
import pytest

import surrol_gym
from surrol_gym.tasks.bi_peg_board import BiPegBoardEnv

CLOSE = -1.0
STILL = np.array((0, 0, 0, 0, CLOSE) * 2)
HANGING_Y = (-0.3237, -0.1943, -0.0648)  # docs/scenes.md#bi-peg-board
HANGING_HEIGHT, FLAT_HEIGHT = 3.780, 3.456
GOAL = np.array((2.75, 0.185, 3.4545))
FLAT = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))


@pytest.fixture(scope="module")
def env():
    env = BiPegBoardEnv()
    yield env
    env.close()


@pytest.fixture(scope="module")
def resets(env):
    """Observation, information and centres of the two blue rings of 300 resets."""
    env.reset(seed=0)
    return [(*env.reset(), [env.world.pose(ring)[0] for ring in bodies(env, "ring")]) for _ in range(300)]


def bodies(env, name):
    client = env.world.client
    return [body for body in range(client.getNumBodies()) if client.getBodyInfo(body)[1] == name.encode()]


def red_ring(env):
    return bodies(env, "ring_red")[0]


def attached(env):
    return [grasps[0].attached for grasps in env.grasps]


def play(env, until, seed=0, limit=100):
    """Lets the expert act from a reset until something holds; returns what the last step returned."""
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=seed)
    for _ in range(limit):
        returned = env.step(expert.act(observation))
        observation = returned[0]
        if until(observation):
            return returned
    raise AssertionError("the expert did not get there")


def put(env, position, orientation=FLAT, steps=5):
    """Puts the ring somewhere and lets it come to rest, the arms still; returns what the last step returned."""
    env.reset(seed=0)
    env.world.place(red_ring(env), position, orientation)
    for _ in range(steps):
        returned = env.step(STILL)
    return returned


# -------------------------------------------------------------------------------------------------------- how it starts


def test_the_rings_hang_on_three_pegs(resets):
    """docs/scenes.md#bi-peg-board."""
    for observation, _, others in resets:
        rings = np.array([observation["observation"][14:17], *others])
        np.testing.assert_allclose(rings[:, 0], 2.3985, rtol=0, atol=1e-3)
        np.testing.assert_allclose(sorted(rings[:, 1]), HANGING_Y, rtol=0, atol=1e-3)
        np.testing.assert_allclose(rings[:, 2], HANGING_HEIGHT, rtol=0, atol=1e-3)


def test_the_red_ring_hangs_on_each_peg_equally_often(resets):
    pegs = [np.abs(np.subtract(HANGING_Y, observation["observation"][15])).argmin() for observation, *_ in resets]
    # Four standard deviations of a binomial count.
    np.testing.assert_allclose(np.bincount(pegs, minlength=3), 100, rtol=0, atol=4 * np.sqrt(300 * 2 / 9))


def test_the_rings_hang_still(env):
    before = env.reset(seed=0)[0]["observation"][14:17]
    for _ in range(10):
        observation, *_ = env.step(STILL)
    np.testing.assert_allclose(observation["observation"][14:17], before, rtol=0, atol=1e-4)


def test_the_goal_is_around_the_right_upright_peg(resets):
    for observation, *_ in resets:
        np.testing.assert_allclose(observation["desired_goal"], GOAL, rtol=0, atol=1e-6)


def test_the_arms_start_in_front_of_the_board_without_touching_it(resets):
    """docs/psm.md#start-poses, but for x: 2.35 there, inside the board."""
    for observation, info, _ in resets[:3]:
        state = observation["observation"]
        np.testing.assert_allclose(state[:3], (2.365, 0.25, 3.976), rtol=0, atol=1e-3)
        np.testing.assert_allclose(np.abs(state[3:6]), (0, 0, np.pi), rtol=0, atol=1e-3)
        np.testing.assert_allclose(state[7:10], (2.365, -0.375, 3.976), rtol=0, atol=1e-3)
        np.testing.assert_allclose(state[10:13], (-np.pi / 2, 0, 0), rtol=0, atol=1e-3)
        np.testing.assert_allclose(state[[6, 13]], 0, rtol=0, atol=1e-3)
        assert info["contact_force"] == 0


# ----------------------------------------------------------------------------------------------------- what is observed


@pytest.mark.parametrize("steps", [0, 20, 35])
def test_every_index_of_the_observation_holds_what_the_docstring_says(env, steps):
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=3)
    for _ in range(steps):
        observation, *_ = env.step(expert.act(observation))
    state = observation["observation"]
    for arm, start in zip(env.arms, (0, 7), strict=True):
        np.testing.assert_allclose(state[start : start + 3], arm.pose()[0], atol=1e-6)
        np.testing.assert_allclose(state[start + 3 : start + 6], arm.pose()[1], atol=1e-6)
        assert state[start + 6] == pytest.approx(arm.jaw_angle(), abs=1e-6)
    client = env.world.client
    centre, orientation = client.getBasePositionAndOrientation(red_ring(env))
    axes = np.reshape(client.getMatrixFromQuaternion(orientation), (3, 3))
    np.testing.assert_allclose(state[14:17], centre, atol=1e-6)
    np.testing.assert_allclose(state[17:20], state[14:17] - state[:3], atol=1e-6)
    np.testing.assert_allclose(state[20:23], state[14:17] - state[7:10], atol=1e-6)
    for start, point in ((23, (0, 0.074, 0)), (29, (0, -0.0231, 0.0786))):  # docs/scenes.md#bi-peg-board
        np.testing.assert_allclose(state[start : start + 3], centre + axes @ point, atol=1e-5)
        turned = client.getMatrixFromQuaternion(client.getQuaternionFromEuler(state[start + 3 : start + 6].tolist()))
        np.testing.assert_allclose(np.reshape(turned, (3, 3)), axes, atol=1e-3)
    np.testing.assert_array_equal(observation["achieved_goal"], state[14:17])


def test_the_names_say_the_same(env):
    names = env.observation_names
    ends = [name.rsplit("_", 1)[1] for name in names]
    assert ends == [
        *("x", "y", "z", "roll", "pitch", "yaw", "jaw") * 2,
        *("x", "y", "z") * 3,
        *("x", "y", "z", "roll", "pitch", "yaw") * 2,
    ]
    assert len(set(names)) == len(names) == 35
    assert [name.rsplit("_", 1)[1] for name in env.action_names] == [
        *("dx", "dy", "dz", "dpitch", "gripper"),
        *("dx", "dy", "dz", "dyaw", "gripper"),
    ]


@pytest.mark.parametrize(("arm", "angle", "step"), [(0, 1, 15), (1, 2, 30)], ids=["PSM1 pitches", "PSM2 yaws"])
def test_a_full_turn_action_turns_by_its_step(env, arm, angle, step):
    """docs/actions.md#what-an-action-does."""
    env.reset(seed=0)
    away = STILL.copy()
    away[[0, 5]] = 1
    for _ in range(2):
        env.step(away)
    for turn in (1.0, -0.5):
        before = env.arms[arm].pose()[1][angle]
        action = STILL.copy()
        action[5 * arm + 3] = turn
        env.step(action)
        assert np.rad2deg(env.arms[arm].pose()[1][angle] - before) == pytest.approx(0.9936 * step * turn, rel=0.02)


def test_psm1_points_sideways_and_pitch_rolls_it(env):
    """docs/actions.md#what-an-action-does: at pitch 0 the tool points along (0, -0.966, -0.259), at 90 degrees it is
    horizontal."""
    env.reset(seed=0)
    client = env.world.client
    action = STILL.copy()
    action[0] = 0.5
    env.step(action)
    for pitch in (0, 30, 60):
        matrix = np.reshape(client.getMatrixFromQuaternion(env.world.pose(env.arms[0].body)[1]), (3, 3))
        s, c = np.sin(np.deg2rad(pitch)), np.cos(np.deg2rad(pitch))
        np.testing.assert_allclose(matrix[:, 1], (0.259 * s, -0.966, -0.259 * c), rtol=0, atol=0.01)
        action = STILL.copy()
        action[3] = 1
        for _ in range(2):
            env.step(action)


# -------------------------------------------------------------------------------------------------------------- success


def test_a_ring_around_the_peg_is_success(env):
    observation, reward, _, _, info = put(env, (2.75, 0.185, 3.48))
    assert observation["achieved_goal"][2] == pytest.approx(FLAT_HEIGHT, abs=1e-3)
    assert info["is_success"]
    assert reward == 0


@pytest.mark.parametrize(
    ("position", "orientation"),
    [
        ((2.75 + 0.065, 0.185, 3.46), FLAT),
        ((2.75, 0.185 - 0.065, 3.46), FLAT),
        ((2.75, -0.185, 3.48), FLAT),
        ((2.70, 0.185, 3.50), (0, 0, 0, 1)),
        ((2.60, 0.0, 3.46), FLAT),
    ],
    ids=["beside the peg", "in front of it", "around the other peg", "leaning on the peg", "on the plate"],
)
def test_a_ring_on_the_plate_elsewhere_is_no_success(env, position, orientation):
    observation, reward, _, _, info = put(env, position, orientation)
    assert observation["achieved_goal"][2] < 3.51
    assert not info["is_success"]
    assert reward == -1


def test_every_ring_within_the_tolerance_has_the_peg_in_it(env):
    """No pose is near enough that leaves the board alone but not around the peg."""
    env.reset(seed=0)
    client, rng = env.world.client, np.random.default_rng(0)
    ring, board = red_ring(env), bodies(env, "ring_board")[0]
    free = 0
    for _ in range(4000):
        offset = rng.uniform(-0.025, 0.025, 3)
        axis = rng.normal(size=3) * (0.5, 0.5, 1)
        axis /= np.linalg.norm(axis)
        if np.linalg.norm(offset) > 0.025:
            continue
        turn = np.array((0.0, -axis[2], axis[1], 1.0 + axis[0]))  # from the x axis
        client.resetBasePositionAndOrientation(ring, GOAL + offset, turn / np.linalg.norm(turn))
        if any(point[8] < -1e-3 for point in client.getClosestPoints(ring, board, 0.0)):
            continue
        free += 1
        dx, dy, _ = offset
        rise = (dx * axis[0] + dy * axis[1]) / axis[2]
        assert np.linalg.norm((dx, dy, rise)) < 0.036
    assert free > 50


def test_a_ring_held_above_the_goal_is_no_success(env):
    _, reward, _, _, info = play(env, lambda one: np.linalg.norm((one["achieved_goal"] - GOAL)[:2]) < 0.01)
    assert attached(env) == [True, False]
    for _ in range(3):
        observation, reward, _, _, info = env.step(STILL)
        assert observation["achieved_goal"][2] > GOAL[2] + 0.03
        assert not info["is_success"]
        assert reward == -1


def test_bringing_the_tool_to_the_goal_without_the_ring_is_no_success(env):
    env.reset(seed=0)
    for _ in range(20):
        action = STILL.copy()
        action[:3] = np.clip((np.array((2.75, 0.26, 3.5)) - env.arms[0].pose()[0]) / 0.05, -1, 1)
        *_, info = env.step(action)
        assert not info["is_success"]


# -------------------------------------------------------------------------------------------------------------- holding


def test_the_ring_is_attached_to_one_arm_at_a_time_and_for_a_step_to_none(env):
    """docs/grasping.md#the-rule: while PSM2 holds the ring PSM1 cannot become active, so friction holds it in
    between."""
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=0)
    history = []
    for _ in range(100):
        observation, *_ = env.step(expert.act(observation))
        history.append(tuple(attached(env)))
    phases = [phase for step, phase in enumerate(history) if step == 0 or phase != history[step - 1]]
    assert phases == [(False, False), (False, True), (False, False), (True, False), (False, False)]
    between = [history.index((True, False)) - 1 - step for step, phase in enumerate(history) if phase == (False, True)]
    assert min(between) == 1


@pytest.mark.parametrize(("arm", "held"), [(6, [True, False]), (13, [False, True])], ids=["PSM1", "PSM2"])
def test_the_jaws_close_on_the_tube_of_the_ring(env, arm, held):
    observation, *_ = play(env, lambda one: attached(env) == held)
    for _ in range(2):
        observation, *_ = env.step(STILL)
    # 0.0118 su thick, 0.04 to 0.044 su from the hinge.
    assert 0.19 < observation["observation"][arm] < 0.3


def test_a_ring_low_above_the_plate_is_held_by_friction_alone(env):
    """docs/grasping.md#the-rule: attached only 0.05 above the goal."""
    observation = put(env, (2.6, -0.1, 3.46))[0]
    expert = surrol_gym.make_expert(env)
    heights = []
    while not any(attached(env)):
        observation, *_ = env.step(expert.act(observation))
        heights.append(float(observation["achieved_goal"][2]))
        assert len(heights) < 80
    assert heights[-1] > GOAL[2] + 0.05
    assert max(heights[:-1]) > FLAT_HEIGHT + 0.01, "friction alone lifts it at first"


def test_opening_the_jaws_releases_the_ring_and_it_falls(env):
    play(env, lambda one: one["achieved_goal"][0] > 2.53)
    assert attached(env) == [False, True]
    action = STILL.copy()
    action[9] = 1
    for _ in range(6):
        observation, _, _, _, info = env.step(action)
        assert attached(env) == [False, False]
    assert observation["achieved_goal"][2] < 3.55
    assert not info["is_success"]


@pytest.mark.parametrize("phase", ["PSM2 holds it", "both do", "friction holds it", "PSM1 holds it"])
def test_a_held_ring_is_part_of_the_state(env, phase):
    """The episode goes on from there as if never left, in this environment and in another."""
    until = {
        "PSM2 holds it": lambda one: one["achieved_goal"][0] > 2.45,
        "both do": lambda one: attached(env)[1] and 0.1 < one["observation"][6] < 0.5 < one["observation"][14] / 5,
        "friction holds it": lambda one: not any(attached(env)) and one["achieved_goal"][0] > 2.5,
        "PSM1 holds it": lambda one: attached(env)[0],
    }[phase]
    play(env, until)
    state, holds = env.get_state(), attached(env)
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (8, 10))
    actions[:, [4, 9]] = CLOSE
    uninterrupted = [env.step(action) for action in actions]
    other = BiPegBoardEnv()
    env.reset(seed=1)
    for restored in (env, other):
        restored.set_state(state)
        assert attached(restored) == holds
        for action, (observation, reward, _, _, info) in zip(actions, uninterrupted, strict=True):
            again, again_reward, _, _, again_info = restored.step(action)
            assert {key: value.tobytes() for key, value in again.items()} == {
                key: value.tobytes() for key, value in observation.items()
            }
            assert (again_reward, again_info) == (reward, info)
    other.close()


def test_a_reset_lets_the_ring_go(env):
    play(env, lambda one: attached(env)[0])
    observation, info = env.reset(seed=0)
    assert attached(env) == [False, False]
    assert info["contact_force"] == 0
    assert observation["observation"][16] == pytest.approx(HANGING_HEIGHT, abs=1e-3)


# --------------------------------------------------------------------------------------------------------------- expert


def test_the_expert_puts_the_ring_around_the_peg_and_leaves_it_there(demonstrations):
    for episode in demonstrations("BiPegBoard"):
        assert episode.first <= 50  # half of the time limit
        assert episode.holds
        assert episode.attached[-1] == [False, False]
        np.testing.assert_allclose(episode.actions[-1][[0, 1, 2, 3, 5, 6, 7, 8]], 0, rtol=0, atol=0.02)


@pytest.mark.parametrize(
    "position",
    [(2.6, -0.1, 3.46), (2.68, -0.19, 3.46), (2.65, 0.13, 3.46), (2.76, 0.27, 3.46)],
    ids=["near PSM2", "at the other peg", "near PSM1", "behind the goal"],
)
def test_the_expert_picks_up_a_dropped_ring(env, position):
    observation, *_ = put(env, position)
    expert = surrol_gym.make_expert(env)
    for _ in range(180):
        observation, _, _, _, info = env.step(expert.act(observation))
        if info["is_success"]:
            return
    raise AssertionError("the expert did not recover")
