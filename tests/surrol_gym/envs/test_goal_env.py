import copy
import inspect
import os
import pickle
import random
import re
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ClosedEnvironmentError, NameNotFound, VersionNotFound
from gymnasium.utils.env_checker import check_env

import surrol_gym
from surrol_gym.envs.goal_env import GoalEnv

# Sizes of observation, goal and action (Table I of the paper) and steps of an episode (docs/environments.md).
SIZES = {
    "NeedleReach": (7, 3, 5, 50),
    "GauzeRetrieve": (19, 3, 5, 50),
    "NeedlePick": (19, 3, 5, 50),
    "PegTransfer": (19, 3, 5, 50),
    "NeedleRegrasp": (35, 3, 10, 50),
    "BiPegTransfer": (35, 3, 10, 100),
    "BiPegBoard": (35, 3, 10, 100),
    "MatchBoardPanel": (31, 6, 5, 100),
    "PickAndPlace": (31, 6, 5, 100),
    "MatchBoard": (20, 3, 5, 100),
} | {"PushBlock": (10, 3, 5, 50)}
of_known_size = pytest.mark.parametrize("env", [*surrol_gym.TASKS, "new_task:PushBlock"], indirect=True)
ONE_ARM, TWO_ARMS = "PegTransfer", "NeedleRegrasp"
"""What the base class does is tested on these two tasks; whatever differs by task, on all."""
one_and_two_arms = pytest.mark.parametrize("env", [ONE_ARM, TWO_ARMS], indirect=True)
made_with_one_and_two_arms = pytest.mark.parametrize("task", [ONE_ARM, TWO_ARMS])
one_arm = pytest.mark.parametrize("env", [ONE_ARM], indirect=True)


# -------------------------------------------------------------------------------------- how the tests record an episode


def snapshot(observation, reward=0.0, info=None):
    """What the environment returned, as bytes."""
    info = info or {}
    numbers = [reward, *(float(info.get(key, 0)) for key in ("is_success", "contact_force", "workspace_clipped"))]
    return b"".join(observation[key].tobytes() for key in sorted(observation)) + np.array(numbers).tobytes()


def play(env, actions):
    """Snapshots of the steps of given actions."""
    snapshots = []
    for action in actions:
        observation, reward, _, _, info = env.step(action)
        snapshots.append(snapshot(observation, reward, info))
    return snapshots


def episode(env, seed, steps=50):
    """Snapshots and actions of an episode of the expert with noise, so that the arm touches things."""
    expert = surrol_gym.make_expert(env)
    noise = np.random.default_rng([seed, 1]).normal(0.0, 0.1, (steps, *env.action_space.shape))
    observation, info = env.reset(seed=seed)
    snapshots, actions = [snapshot(observation, info=info)], []
    for deviation in noise:
        actions.append(np.clip(expert.act(observation) + deviation, -1, 1).astype(np.float32))
        observation, reward, _, _, info = env.step(actions[-1])
        snapshots.append(snapshot(observation, reward, info))
    return snapshots, actions


def print_episodes(seed, steps):
    """Prints the snapshots of an episode of every task in hex, one a line; other processes call it."""
    for task in surrol_gym.TASKS:
        env = gym.make(f"surrol/{task}-v0")
        for shot in episode(env, seed, steps)[0]:
            print(task, shot.hex())


def random_actions(env, count, seed=0):
    return np.random.default_rng([seed, 2]).uniform(-1, 1, (count, *env.action_space.shape)).astype(np.float32)


@pytest.fixture(scope="module")
def recorded(env):
    """Snapshots and actions of an episode from seed 6, long enough to have the arm in contact."""
    return episode(env, 6, steps=40)


@pytest.fixture
def demonstration(env, demonstrations):
    """What ``step`` returned in a whole episode of the expert."""
    [played] = demonstrations(env.unwrapped.task, 1)
    return played.returned


# ------------------------------------------------------------------------------------------------------ Gymnasium's API


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("arguments", [{}, {"render_mode": "rgb_array"}, {"obs_type": "pixels_state"}], ids=str)
@pytest.mark.parametrize("task", [ONE_ARM, TWO_ARMS, "new_task:PushBlock"])
def test_gymnasiums_checker_has_no_complaint(make, monkeypatch, task, arguments):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # for the render mode "human"
    assert check_env(make(task, width=32, height=24, **arguments).unwrapped) is None


@of_known_size
def test_sizes_are_those_of_the_papers_table(env):
    observation_size, goal_size, action_size, limit = SIZES[env.unwrapped.task]
    assert {key: space.shape for key, space in env.observation_space.items()} == {
        "observation": (observation_size,),
        "achieved_goal": (goal_size,),
        "desired_goal": (goal_size,),
    }
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (action_size,), np.float32)
    observation, _ = env.reset(seed=0)
    for key, space in env.observation_space.items():
        assert (observation[key].shape, observation[key].dtype, space.dtype) == (space.shape, np.float32, np.float32)


def test_every_number_of_observation_goal_and_action_has_its_own_name(env):
    sizes = [env.observation_space[array].shape[0] for array in ("observation", "desired_goal")]
    named = env.unwrapped.observation_names, env.unwrapped.goal_names, env.unwrapped.action_names
    assert [len(names) for names in named] == [*sizes, *env.action_space.shape]
    assert all(len(set(names)) == len(names) for names in named)


@of_known_size
def test_numbers_of_an_observation_with_the_name_of_a_goals_number_repeat_the_desired_goal(env):
    observation, _ = env.reset(seed=0)
    names, goal_names = env.unwrapped.observation_names, env.unwrapped.goal_names
    repeated = [name for name in names if name in goal_names]
    assert repeated == (list(goal_names) if env.unwrapped.task == "MatchBoardPanel" else [])
    for name in repeated:
        assert observation["observation"][names.index(name)] == observation["desired_goal"][goal_names.index(name)]


def test_observations_stay_in_their_space_whatever_the_action(env):
    env.reset(seed=0)
    low, high = env.action_space.low, env.action_space.high
    for action in (*random_actions(env, 20), *[low] * 10, *[high] * 10):
        observation, reward, _, _, info = env.step(action)
        assert observation in env.observation_space
        assert reward in (-1.0, 0.0)
        assert np.isfinite(info["contact_force"])


def test_only_the_time_limit_ends_an_episode(env, demonstration):
    limit = env.spec.max_episode_steps
    assert any(info["is_success"] for *_, info in demonstration[:-1])
    ends = [(terminated, truncated) for _, _, terminated, truncated, _ in demonstration]
    assert ends == [(False, False)] * (limit - 1) + [(False, True)]


@one_and_two_arms
def test_info_says_success_force_and_clipping_at_reset_and_in_every_step(env):
    _, info = env.reset(seed=0)
    infos = [info, *(env.step(action)[4] for action in random_actions(env, 3))]
    for info in infos:
        assert {key: type(value) for key, value in info.items()} == {
            "is_success": bool,
            "contact_force": float,
            "workspace_clipped": bool,
        }
        assert info["contact_force"] >= 0


@one_and_two_arms
def test_actions_are_clipped_to_one(env):
    action = random_actions(env, 1)[0]
    for factor in (10, -10):
        env.reset(seed=0)
        beyond = play(env, [factor * action])
        env.reset(seed=0)
        assert beyond == play(env, [np.clip(factor * action, -1, 1)])


@one_arm
def test_the_action_is_left_as_it_was(env):
    env.reset(seed=0)
    action = 3 * random_actions(env, 1)[0]
    before = action.copy()
    env.step(action)
    np.testing.assert_array_equal(action, before)


@one_arm
def test_reset_options_make_no_difference(env):
    plain, _ = env.reset(seed=0)
    with_options, _ = env.reset(seed=0, options={"whatever": 1})
    assert snapshot(with_options) == snapshot(plain)


def test_a_reset_without_seed_draws_another_start(env):
    first, _ = env.reset(seed=0)
    others = [env.reset()[0] for _ in range(8)]  # BiPegBoard has no more than three starts
    assert any(snapshot(first) != snapshot(other) for other in others)


@pytest.mark.parametrize("env", surrol_gym.TASKS, indirect=True)
def test_docstrings_have_the_sections_of_gymnasium_robotics_and_explain_every_argument(env):
    documentation = type(env.unwrapped).__doc__
    sections = [line.strip().removeprefix("## ") for line in documentation.splitlines() if "## " in line]
    assert sections == [
        *("Description", "Action Space", "Observation Space", "Rewards", "Starting State", "Episode End"),
        *("Arguments", "Version History"),
    ]
    for camera in env.unwrapped.cameras:
        assert f'"{camera}"' in documentation
    arguments = documentation.split("## Arguments\n")[1].split("\n## ")[0]
    assert all(f"`{name}`" in arguments for name in inspect.signature(GoalEnv).parameters)


def test_docstrings_explain_every_number(env):
    documentation = type(env.unwrapped).__doc__
    for section, names in (
        ("Action Space", env.unwrapped.action_names),
        ("Observation Space", env.unwrapped.observation_names),
    ):
        told = documentation.split(f"## {section}\n")[1].split("\n## ")[0]
        rows = [line.split(" | ") for line in told.splitlines() if line.startswith("| ")][2:]
        assert ", ".join(row[0].strip("| ") for row in rows) == ", ".join(map(str, range(len(names))))
        assert ", ".join(row[1] for row in rows) == ", ".join(f"`{name}`" for name in names)


def test_tasks_describe_themselves_in_a_sentence(env):
    sentence = env.unwrapped.task_description
    assert sentence[0].isupper()
    assert sentence.endswith(".")
    assert "\n" not in sentence


@made_with_one_and_two_arms
def test_a_spec_makes_the_same_environment_again(make, task):
    original = make(task, render_mode="rgb_array", width=32, height=24)
    original.reset(seed=5)
    for spec in (
        original.spec,
        pickle.loads(pickle.dumps(original.spec)),
        EnvSpec.from_json(original.spec.to_json()),
    ):
        again = gym.make(spec)
        assert again.spec == original.spec
        again.reset(seed=5)
        np.testing.assert_array_equal(again.render(), original.render())
        again.close()


# --------------------------------------------------------------------------------------------------- the goal interface


def test_the_reward_of_a_step_is_that_of_its_goals(env, demonstration):
    observations, rewards, _, _, infos = zip(*demonstration, strict=True)
    assert set(rewards) == {-1.0, 0.0}
    assert [reward == 0 for reward in rewards] == [info["is_success"] for info in infos]
    achieved, desired = (np.array([one[key] for one in observations]) for key in ("achieved_goal", "desired_goal"))
    np.testing.assert_array_equal(env.unwrapped.compute_reward(achieved, desired, infos), rewards)
    for goal, target, reward, info in zip(achieved, desired, rewards, infos, strict=True):
        assert env.unwrapped.compute_reward(goal, target, info) == reward


def test_goal_functions_are_vectorised_over_leading_axes(env):
    compute = env.unwrapped
    size = len(compute.goal_names)
    for shape in ((1,), (4,), (2, 3), (2, 1, 2), (0,)):
        rng = np.random.default_rng(0)
        desired = rng.uniform(2, 4, (*shape, size))
        achieved = desired + rng.normal(0, 0.01, (*shape, size))
        reward = compute.compute_reward(achieved, desired, {})
        terminated = compute.compute_terminated(achieved, desired, {})
        truncated = compute.compute_truncated(achieved, desired, {})
        assert reward.shape == terminated.shape == truncated.shape == shape
        assert not np.any(terminated)
        assert not np.any(truncated)
        for index in np.ndindex(shape):
            assert reward[index] == compute.compute_reward(achieved[index], desired[index], {})


def test_a_goal_and_many_are_as_many(env):
    goal = np.ones(len(env.unwrapped.goal_names))
    many = np.stack([goal, goal + 1, goal])
    for one, other in ((goal, many), (many, goal)):
        np.testing.assert_array_equal(env.unwrapped.compute_reward(one, other, {}), [0, -1, 0])
        assert env.unwrapped.compute_terminated(one, other, {}).shape == (3,)
        assert env.unwrapped.compute_truncated(one, other, {}).shape == (3,)


@pytest.mark.parametrize("compute", ["compute_reward", "compute_terminated", "compute_truncated"])
@one_and_two_arms
def test_goals_of_another_size_are_refused(env, compute):
    goals = np.zeros((4, 3))
    for achieved, desired in ((np.zeros((4, 19)),) * 2, (goals, np.zeros(1)), (0.0, goals)):
        with pytest.raises(ValueError, match=r"takes goals of shape \(..., 3\), got \((4, 19|1,)?\)"):
            getattr(env.unwrapped, compute)(achieved, desired, {})


@one_and_two_arms
def test_goal_functions_are_those_of_what_gymnasium_makes(env):
    goals = np.zeros((4, 3)), np.ones((4, 3))
    for compute in ("compute_reward", "compute_terminated", "compute_truncated"):
        np.testing.assert_array_equal(getattr(env, compute)(*goals, {}), getattr(env.unwrapped, compute)(*goals, {}))


@pytest.mark.parametrize("task", ["BiPegBoard", "PickAndPlace"])
def test_who_writes_into_a_goal_changes_this_episode_only(make, task):
    """These tasks have the same goal in every episode."""
    env, other = make(task), make(task)
    observation, _ = env.reset(seed=0)
    goal, state = observation["desired_goal"].copy(), env.unwrapped.get_state()
    observation["desired_goal"][:] = 7
    env.unwrapped._goal[:] = 9
    for later, _ in (env.reset(), other.reset()):
        np.testing.assert_array_equal(later["desired_goal"], goal)
    for _ in range(2):
        np.testing.assert_array_equal(env.unwrapped.set_state(state)["desired_goal"], goal)
        env.unwrapped._goal[:] = 9


def test_goal_functions_of_a_single_goal_are_plain_numbers(env):
    goal = np.ones(len(env.unwrapped.goal_names))
    assert env.unwrapped.compute_reward(goal, goal, {}) == 0.0
    assert env.unwrapped.compute_reward(goal + 1, goal, {}) == -1.0
    assert env.unwrapped.compute_terminated(goal, goal, {}) is False
    assert env.unwrapped.compute_truncated(goal, goal, {}) is False


# -------------------------------------------------------------------------------------------------------------- seeding


def test_the_same_seed_gives_the_same_bytes_in_another_process_on_a_plainer_processor(capsys):
    """The other process does without all vector instructions for which NumPy and OpenBLAS have code of their own."""
    code = "import runpy, sys; runpy.run_path(sys.argv[1])['print_episodes'](11, 32)"
    instructions = " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", ()))
    plainer = os.environ | {"NPY_DISABLE_CPU_FEATURES": instructions, "OPENBLAS_CORETYPE": "Nehalem"}
    command = [sys.executable, "-c", code, __file__]
    result = subprocess.run(command, capture_output=True, text=True, check=True, env=plainer)
    print_episodes(11, 32)
    for task in surrol_gym.TASKS:
        theirs = [line for line in result.stdout.splitlines() if line.startswith(f"{task} ")]
        assert len(theirs) == 33
    tasks = tuple(f"{task} " for task in surrol_gym.TASKS)
    ours = [line for line in capsys.readouterr().out.splitlines() if line.startswith(tasks)]
    assert ours == [line for line in result.stdout.splitlines() if line.startswith(tasks)]


@one_and_two_arms
def test_the_order_of_resets_does_not_matter(env):
    first = {seed: episode(env, seed, steps=34)[0] for seed in (3, 5)}
    second = {seed: episode(env, seed, steps=34)[0] for seed in (5, 3)}
    assert first == second
    assert first[3] != first[5]


def test_a_used_environment_behaves_as_a_new_one(make, env, recorded):
    fresh = make(env.unwrapped.task)
    assert episode(fresh, 6, steps=40)[0] == recorded[0]


@pytest.mark.parametrize("task", ["PegTransfer", "MatchBoard"])
def test_an_object_that_was_let_go_does_not_depend_on_earlier_episodes(make, task):
    def last_observation(env, seed):
        observation, _ = env.reset(seed=seed)
        for _ in range(50):
            observation, *_ = env.step(expert.act(observation))
        return observation["observation"].tobytes()

    used, fresh = make(task), make(task)
    expert = surrol_gym.make_expert(used)
    for seed in (30002, 30000):
        last_observation(used, seed)
    assert last_observation(used, 30003) == last_observation(fresh, 30003)


@one_and_two_arms
def test_two_environments_in_one_process_do_not_touch(make, env, recorded):
    other = make(env.unwrapped.task)
    env.reset(seed=6)
    other.reset(seed=7)
    for shot, action in zip(recorded[0][1:], recorded[1], strict=True):
        assert play(env, [action]) == [shot]
        other.step(-action)


def test_vector_environments_give_the_same_bytes_as_single_ones(make):
    """Sync and Async, through the end of an episode and the reset that follows it."""
    seeds, limit = (21, 22), 32
    single = make(TWO_ARMS, max_episode_steps=limit)
    expected, actions = [], []
    for seed in seeds:
        shots, taken = episode(single, seed, limit)
        observation, info = single.reset()
        shots.append(snapshot(observation, info=info))
        after = random_actions(single, 3, seed)
        expected.append(shots + play(single, after))
        actions.append([*taken, after[0], *after])  # the action of the step that resets is ignored
    for mode, vector_kwargs in (("sync", {}), ("async", {"context": "spawn"})):
        vector = gym.make_vec(single.spec, len(seeds), mode, vector_kwargs)
        observations, infos = vector.reset(seed=list(seeds))
        recorded = [[row_snapshot(observations, 0.0, infos, row)] for row in range(len(seeds))]
        for row_actions in zip(*actions, strict=True):
            observations, rewards, _, _, infos = vector.step(np.array(row_actions))
            for row in range(len(seeds)):
                recorded[row].append(row_snapshot(observations, rewards[row], infos, row))
        vector.close()
        assert recorded == expected, mode


def row_snapshot(observations, reward, infos, row):
    observation = {key: value[row] for key, value in observations.items()}
    return snapshot(observation, reward, {key: infos[key][row] for key in infos if not key.startswith("_")})


def global_state():
    return pickle.dumps((np.random.get_state(), random.getstate()))  # noqa: NPY002


@one_and_two_arms
def test_the_global_generators_are_neither_read_nor_advanced(env, recorded):
    np.random.seed(1)  # noqa: NPY002
    random.seed(1)
    before = global_state()
    assert episode(env, 6, steps=40)[0] == recorded[0]
    assert global_state() == before


@one_and_two_arms
def test_a_step_draws_no_random_numbers(env):
    env.reset(seed=0)
    before = env.unwrapped.np_random.bit_generator.state
    play(env, random_actions(env, 5))
    assert env.unwrapped.np_random.bit_generator.state == before


# ------------------------------------------------------------------------------------------------- saving and restoring


@one_and_two_arms
def test_an_episode_continues_from_a_saved_state_as_if_never_left(env, recorded):
    """Saved at several moments, restored in another order, once twice, and played on to the end once."""
    shots, actions = recorded
    env.reset(seed=6)
    states = []
    for action in actions:
        states.append(env.unwrapped.get_state())
        env.step(action)
    for moment, end in ((35, 40), (0, 5), (27, 34), (27, 40), (12, 20)):
        env.unwrapped.set_state(states[moment])
        assert play(env.unwrapped, actions[moment:end]) == shots[moment + 1 : end + 1]


@pytest.mark.parametrize("moment", [0, 30])
@one_and_two_arms
def test_a_state_can_be_restored_in_another_environment(make, env, recorded, moment):
    shots, actions = recorded
    env.reset(seed=6)
    play(env, actions[:moment])
    state = pickle.loads(pickle.dumps(env.unwrapped.get_state()))
    used = make(env.unwrapped.task)
    episode(used, 9, steps=30)
    used.unwrapped.set_state(state)
    assert play(used.unwrapped, actions[moment : moment + 10]) == shots[moment + 1 : moment + 11]


@one_and_two_arms
def test_a_state_can_be_restored_in_an_environment_that_was_never_reset(make, env, recorded):
    shots, actions = recorded
    env.reset(seed=6)
    fresh = make(env.unwrapped.task).unwrapped
    fresh.set_state(env.unwrapped.get_state())
    assert play(fresh, actions[:15]) == shots[1:16]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
@one_and_two_arms
def test_a_copy_goes_on_by_itself(env, recorded, copied):
    shots, actions = recorded
    env.reset(seed=6)
    play(env, actions[:30])
    other = copied(env)
    assert play(other, actions[30:36]) == shots[31:37]
    other.close()
    assert play(env, actions[30:36]) == shots[31:37]


def test_a_copy_has_the_arguments_and_the_time_limit_of_the_original(make):
    env = make("NeedlePick", randomize=False, render_mode="rgb_array", width=32, height=24, max_episode_steps=3)
    other = copy.deepcopy(env)
    for one in (env, other):
        one.reset(seed=1)
    np.testing.assert_array_equal(other.render(), env.render())
    assert [other.step(np.zeros(5))[3] for _ in range(3)] == [False, False, True]
    other.close()


def test_without_a_spec_there_is_no_copy_but_a_way_out(make):
    env = type(make(ONE_ARM).unwrapped)()
    with pytest.raises(TypeError, match=r"other.set_state\(env.get_state\(\)\)"):
        copy.deepcopy(env)
    env.close()


@one_and_two_arms
def test_set_state_returns_the_observation_of_that_moment(env):
    env.reset(seed=0)
    observation = [env.step(action)[0] for action in random_actions(env, 8)][-1]
    state = env.unwrapped.get_state()
    env.reset(seed=1)
    assert snapshot(env.unwrapped.set_state(state)) == snapshot(observation)


@one_and_two_arms
def test_looking_at_the_state_or_at_a_picture_changes_nothing(env, recorded):
    shots, actions = recorded
    env.reset(seed=6)
    for step, action in enumerate(actions):
        env.unwrapped.get_state()
        if step % 6 == 0 or step > 30:
            env.unwrapped.picture(width=16, height=16)
        assert play(env, [action]) == [shots[step + 1]]


@one_and_two_arms
def test_a_state_holds_the_random_generator(env):
    env.reset(seed=0)
    state = env.unwrapped.get_state()
    following = [snapshot(env.reset()[0]) for _ in range(3)]
    env.reset(seed=99)
    env.unwrapped.set_state(state)
    assert [snapshot(env.reset()[0]) for _ in range(3)] == following


def test_a_restored_episode_goes_on_to_its_own_time_limit(make):
    """From its end, from its middle, and from another episode, as the wrapped environment counts."""
    env = make("NeedleReach", max_episode_steps=8)
    action = np.zeros(5, dtype=np.float32)

    def steps_to_the_end():
        return next(steps for steps in range(1, 20) if env.step(action)[3])

    env.reset(seed=0)
    states = []
    for _ in range(8):
        states.append(env.unwrapped.get_state())
        truncated = env.step(action)[3]
    assert truncated
    for moment in (3, 0, 7):
        env.unwrapped.set_state(states[moment])
        assert steps_to_the_end() == 8 - moment
    env.reset(seed=1)
    env.step(action)
    env.unwrapped.set_state(states[5])
    assert steps_to_the_end() == 3
    env.reset()
    assert steps_to_the_end() == 8


def test_an_episode_may_have_no_time_limit(make):
    env = make("NeedleReach", max_episode_steps=-1)
    env.reset(seed=0)
    assert not any(env.step(env.action_space.high)[3] for _ in range(60))


# ------------------------------------------------------------------------------------------------------- resets in bulk


def test_resets_load_nothing(env):
    client = env.unwrapped.world.client
    env.reset(seed=0)
    bodies, constraints = client.getNumBodies(), client.getNumConstraints()
    for _ in range(5):
        env.reset()
        play(env, random_actions(env, 2))
    episode(env, 0, steps=32)
    env.reset()
    assert (client.getNumBodies(), client.getNumConstraints()) == (bodies, constraints)


# ------------------------------------------------------------------------------------------------------------ bad input


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@one_and_two_arms
def test_an_action_that_is_not_finite_is_refused_and_the_episode_goes_on(env, recorded, value):
    shots, actions = recorded
    env.reset(seed=6)
    assert play(env, actions[:4]) == shots[1:5]
    bad = actions[4].copy()
    bad[1] = value
    with pytest.raises(ValueError, match=str(value)):
        env.step(bad)
    assert play(env, actions[4:8]) == shots[5:9]


@pytest.mark.parametrize("extra", [-1, 1])
@one_and_two_arms
def test_an_action_of_wrong_size_is_refused_and_the_episode_goes_on(env, recorded, extra):
    shots, actions = recorded
    env.reset(seed=6)
    play(env, actions[:4])
    size = SIZES[env.unwrapped.task][2]
    with pytest.raises(ValueError, match=rf"\({size},\), got \({size + extra},\)"):
        env.step(np.zeros(size + extra))
    assert play(env, actions[4:8]) == shots[5:9]


@pytest.mark.parametrize("action", [None, 0.0, "up", np.zeros((1, 5)), [[0.0] * 5] * 2])
@one_arm
def test_what_is_not_an_action_is_refused(env, action):
    env.reset(seed=0)
    with pytest.raises(ValueError, match="shape|convert"):
        env.step(action)


@pytest.mark.parametrize("method", ["reset", "step", "render", "picture", "get_state", "set_state"])
def test_a_closed_environment_says_so(make, method):
    env = make(ONE_ARM, render_mode="rgb_array")
    env.reset(seed=0)
    arguments = {"step": [env.action_space.sample()], "set_state": [env.unwrapped.get_state()]}.get(method, [])
    env.close()
    with pytest.raises(ClosedEnvironmentError, match=f"{ONE_ARM} environment is closed"):
        getattr(env.unwrapped, method)(*arguments)


@one_arm
def test_what_is_no_state_is_refused(env):
    with pytest.raises(TypeError, match="set_state takes what get_state returned, got None"):
        env.unwrapped.set_state(None)


@pytest.mark.parametrize(
    ("method", "told"),
    [("_observe", "7 numbers of observation"), ("_achieved_goal", "3 numbers of achieved_goal")],
)
def test_a_task_that_returns_other_numbers_than_it_says_is_refused(make, monkeypatch, method, told):
    env = make("NeedleReach")
    monkeypatch.setattr(env.unwrapped, method, lambda: np.zeros(2))
    with pytest.raises(ValueError, match=rf"NeedleReach says what {told} .* shape \(2,\)"):
        env.reset(seed=0)


def test_closing_twice_is_harmless_and_others_live_on(make):
    env, other = make(ONE_ARM), make(ONE_ARM)
    other.reset(seed=0)
    env.close()
    env.close()
    assert other.step(other.action_space.sample())[0] in other.observation_space


def test_an_unknown_task_is_an_error_that_names_it():
    with pytest.raises(NameNotFound, match="NeedlePok"):
        gym.make("surrol/NeedlePok-v0")


def test_an_unknown_version_is_an_error_that_names_it():
    with pytest.raises(VersionNotFound, match="v99"):
        gym.make("surrol/NeedlePick-v99")


@pytest.mark.filterwarnings("ignore:.*render_mode")
@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("camera", "ceiling"),
        ("camera", None),
        ("camera", ["closeup"]),
        ("render_mode", "ascii"),
        ("obs_type", "pixels"),
        ("width", 0),
        ("height", -3),
        ("width", 2.5),
        ("height", "tall"),
        ("width", None),
        ("width", True),
    ],
)
def test_an_unknown_picture_argument_is_an_error_that_names_the_value(make, argument, value):
    arguments = {"render_mode": "rgb_array", argument: value}
    with pytest.raises(ValueError, match=re.escape(str(value))):
        make(ONE_ARM, **arguments)


@one_arm
def test_an_unknown_camera_or_size_of_a_picture_is_an_error_and_the_next_picture_works(env):
    env.reset(seed=0)
    for arguments, named in (
        ({"camera": "ceiling"}, "ceiling"),
        ({"width": 0}, "0"),
        ({"height": 2.5}, "2.5"),
        ({"kind": "x-ray"}, "x-ray"),
    ):
        with pytest.raises(ValueError, match=named):
            env.unwrapped.picture(**arguments)
    assert env.unwrapped.picture(width=16, height=8).shape == (8, 16, 3)


def test_an_unknown_argument_is_an_error_that_names_it(make):
    with pytest.raises(TypeError, match="colour"):
        make(ONE_ARM, colour="red")


# ------------------------------------------------------------------------------------------------------------- pictures


def test_pictures_are_256_by_256_by_default(make):
    env = make(ONE_ARM, render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert (picture.shape, picture.dtype) == ((256, 256, 3), np.uint8)


def test_size_and_camera_of_render_are_arguments(make):
    for camera in ("closeup", "overview"):
        env = make(ONE_ARM, render_mode="rgb_array", camera=camera, width=80, height=60)
        env.reset(seed=0)
        picture = env.render()
        assert picture.shape == (60, 80, 3)
        np.testing.assert_array_equal(env.unwrapped.picture(camera, 80, 60), picture)


@one_arm
def test_without_a_render_mode_render_is_none_and_picture_still_works(env):
    env.reset(seed=0)
    assert env.unwrapped.render_mode is None
    assert env.unwrapped.render() is None
    picture = env.unwrapped.picture()
    assert (picture.shape, picture.dtype) == ((256, 256, 3), np.uint8)


@pytest.mark.parametrize(
    ("mode", "kind", "dtype"), [("depth_array", "depth", np.float32), ("segmentation", "segmentation", np.int32)]
)
def test_depth_and_segmentation_are_render_modes(make, mode, kind, dtype):
    env = make(ONE_ARM, render_mode=mode, width=40, height=30)
    env.reset(seed=0)
    picture = env.render()
    assert (picture.shape, picture.dtype) == ((30, 40), dtype)
    np.testing.assert_array_equal(env.unwrapped.picture("closeup", 40, 30, kind), picture)


def test_the_segmentation_tells_arms_table_and_goal_apart(env):
    env.reset(seed=0)
    names = env.unwrapped.segment_names
    seen = {
        names[index]
        for camera in env.unwrapped.cameras
        for index in np.unique(env.unwrapped.picture(camera, 200, 150, "segmentation"))
        if index >= 0
    }
    arms = {mount.look.removesuffix(".urdf") for mount in env.unwrapped.mounts}
    assert arms | {"table", "goal"} <= seen


@made_with_one_and_two_arms
def test_observations_may_hold_pixels(make, task):
    env = make(task, obs_type="pixels_state", width=32, height=24)
    plain = make(task)
    observation, _ = env.reset(seed=0)
    expected, _ = plain.reset(seed=0)
    assert observation.keys() == expected.keys() | {"pixels"}
    action = random_actions(env, 1)[0]
    for _ in range(2):
        assert observation in env.observation_space
        assert snapshot({key: observation[key] for key in expected}) == snapshot(expected)
        np.testing.assert_array_equal(observation["pixels"], env.unwrapped.picture("closeup", 32, 24))
        observation, *_ = env.step(action)
        expected, *_ = plain.step(action)


def test_every_camera_shows_another_picture_of_more_than_one_colour(env):
    env.reset(seed=0)
    pictures = [env.unwrapped.picture(camera) for camera in env.unwrapped.cameras]
    assert len({picture.tobytes() for picture in pictures}) == len(pictures) > 1
    for picture in pictures:
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100


def test_the_goal_is_a_red_spot_where_the_camera_should_see_it(env):
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        picture = env.unwrapped.picture("closeup").astype(int)
        red = (picture[..., 0] > 110) & (picture[..., 1:].max(axis=-1) < 0.4 * picture[..., 0])
        assert red.sum() >= 20
        goal = observation["desired_goal"][-3:]  # MatchBoardPanel's first is under a lid
        row, column = pixel_of(env.unwrapped.cameras["closeup"], goal, 256)
        rows, columns = np.nonzero(red)
        assert np.hypot(rows - row, columns - column).min() < 3


def pixel_of(camera, point, size):
    """Row and column of a point in a square picture of a pinhole camera whose up is the world's z."""
    forward = np.subtract(camera.target, camera.eye)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0, 0, 1))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    to_point = np.subtract(point, camera.eye)
    focal = size / 2 / np.tan(np.deg2rad(camera.field_of_view) / 2) / (to_point @ forward)
    return size / 2 - focal * (to_point @ up), size / 2 + focal * (to_point @ right)


@one_and_two_arms
def test_pictures_change_with_the_scene_and_only_with_it(env):
    env.reset(seed=0)
    before = env.unwrapped.picture()
    np.testing.assert_array_equal(env.unwrapped.picture(), before)
    for _ in range(4):
        env.step(-env.action_space.high)
    after = env.unwrapped.picture()
    assert np.any(after != before)
    env.reset(seed=0)
    np.testing.assert_array_equal(env.unwrapped.picture(), before)


@one_arm
def test_a_picture_is_not_overwritten_by_the_next(env):
    env.reset(seed=0)
    picture = env.unwrapped.picture()
    copy = picture.copy()
    env.step(env.action_space.high)
    env.unwrapped.picture()
    np.testing.assert_array_equal(picture, copy)


def test_a_window_without_a_display_is_a_clear_error(make, no_display):
    with pytest.raises(ValueError, match="needs a display: DISPLAY is not set"):
        type(make(ONE_ARM).unwrapped)(render_mode="human")
