"""Imperfect sensors: what is shown, what stays true, and that a seed tells all of it. Then noisy actions."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import FilterObservation, FlattenObservation

import surrol_gym
from surrol_gym.wrappers import PERFECT, ImperfectSensors, NoisyActions, complete_sensors, imperfect

IMPERFECT = {"position_std": 0.01, "angle_std": 0.1, "dropout": 0.3, "delay": 2}
ARRAYS = ("observation", "achieved_goal", "desired_goal")


@pytest.fixture
def sense(make):
    """Makes an environment by the name of its task, and looks at it through imperfect sensors."""
    return lambda task, **sensors: ImperfectSensors(make(task), **sensors)


def play(env, seed=0, steps=10):
    """Shown and true observations of the expert's first steps; the expert sees the true ones."""
    expert = surrol_gym.make_expert(env)
    observation, info = env.reset(seed=seed)
    shown, true = [observation], [info["true_observation"]]
    for _ in range(steps):
        observation, *_, info = env.step(expert.act(true[-1]))
        shown.append(observation)
        true.append(info["true_observation"])
    return shown, true


def stacked(observations):
    return {key: np.stack([observation[key] for observation in observations]) for key in ARRAYS}


def errors(env, **kwargs):
    """Shown minus true numbers of a played episode, by array."""
    shown, true = map(stacked, play(env, **kwargs))
    return {key: shown[key] - true[key] for key in ARRAYS}


def assert_same(some, others):
    for key in ARRAYS:
        np.testing.assert_array_equal(stacked(some)[key], stacked(others)[key])


# What is noisy.


def test_perfect_sensors_show_the_truth(sense):
    assert_same(*play(sense("NeedlePick")))


def test_positions_get_the_noise_of_positions_and_angles_that_of_angles(sense):
    env = sense("BiPegTransfer", position_std=0.01, angle_std=0.5)
    noise = errors(env, steps=100)["observation"]
    names = np.array(env.unwrapped.observation_names)
    relative = np.char.find(names, "_rel") >= 0
    angles = np.array([name.endswith(("_roll", "_pitch", "_yaw", "_jaw")) for name in names])
    assert angles.sum() == 14
    spread = noise.std(axis=0)
    np.testing.assert_allclose(spread[angles], 0.5, rtol=0.3)
    np.testing.assert_allclose(spread[~angles & ~relative], 0.01, rtol=0.3)
    np.testing.assert_allclose(spread[relative], 0.01 * np.sqrt(2), rtol=0.3)
    np.testing.assert_allclose(noise.mean(axis=0) / spread, 0, atol=0.5)


def test_noise_is_new_in_every_step(sense):
    noise = errors(sense("NeedleReach", position_std=0.01, angle_std=0.1))["observation"]
    assert (np.diff(noise, axis=0) != 0).all()


def test_a_class_is_exact(sense):
    env = sense("MatchBoard", position_std=0.01, angle_std=0.1)
    assert not errors(env)["observation"][:, env.unwrapped.observation_names.index("piece_class")].any()


def test_the_desired_goal_is_exact_also_where_the_observation_repeats_it(sense):
    env = sense("MatchBoardPanel", position_std=0.01, angle_std=0.1)
    found = errors(env)
    copies = [name in env.unwrapped.goal_names for name in env.unwrapped.observation_names]
    assert sum(copies) == 6
    assert not found["desired_goal"].any() and not found["observation"][:, copies].any()
    assert found["observation"][:, ~np.array(copies)].all()


def test_an_achieved_goal_that_is_observed_is_the_same_in_both_places(sense):
    env = sense("PickAndPlace", position_std=0.01)
    for shown in play(env)[0]:
        seen = env.unwrapped.read(shown)
        np.testing.assert_array_equal([*seen.red_top, *seen.green_top], shown["achieved_goal"])


def test_an_achieved_goal_that_is_not_observed_has_noise_of_its_own(sense):
    found = errors(sense("NeedleReach", position_std=0.01))
    assert found["achieved_goal"].all()
    assert (found["achieved_goal"] != found["observation"][:, :3]).all()


@pytest.mark.parametrize("sensors", [{}, IMPERFECT], ids=["true", "shown"])
def test_what_is_derived_follows_from_what_it_is_derived_from(env, sensors):
    """Of every task: the quantities say so as data."""
    env = ImperfectSensors(env, **sensors)
    for observation in play(env)[0]:
        seen = vars(env.unwrapped.read(observation))
        for quantity in env.unwrapped.observation_quantities:
            if quantity.derived_from:
                first, *second = (seen[key] for key in quantity.derived_from)
                np.testing.assert_allclose(seen[quantity.key], first - sum(second), atol=2e-6)


def test_every_relative_position_is_derived():
    for task in surrol_gym.TASKS:
        env_class = surrol_gym.registry.env_class(task)
        relative = {quantity.name for quantity in env_class.observation_quantities if "relative" in quantity.meaning}
        relative |= {quantity.name for quantity in env_class.observation_quantities if "_rel" in quantity.name}
        assert relative <= {quantity.name for quantity in env_class.observation_quantities if quantity.derived_from}


# What is missed and late.


def test_a_missed_reading_is_replaced_by_the_one_before(sense):
    env = sense("NeedleReach", position_std=0.01, angle_std=0.1, dropout=0.5)
    shown = stacked(play(env, steps=49)[0])["observation"]
    missed = (np.diff(shown, axis=0) == 0).all(axis=1)
    assert 10 < missed.sum() < 40
    assert ((np.diff(shown, axis=0) == 0).any(axis=1) == missed).all(), "everything is missed, or nothing"


def test_sensors_that_miss_everything_show_the_first_reading(sense):
    shown, true = play(sense("NeedleReach", dropout=1.0))
    assert_same(shown, [true[0]] * len(true))


def test_what_is_shown_lags_by_the_delay(sense):
    shown, true = play(sense("NeedleReach", delay=3))
    assert_same(shown, [true[0]] * 3 + true[:-3])


def test_nothing_of_an_episode_is_shown_in_the_next(sense):
    env = sense("NeedlePick", delay=5)
    play(env, seed=0)
    shown, true = play(env, seed=1, steps=1)
    assert_same(shown, [true[0]] * 2)


def test_pictures_are_as_late_as_the_numbers(make):
    env = ImperfectSensors(make("NeedleReach", obs_type="pixels_state", width=16, height=16), delay=1)
    shown, true = play(env, steps=3)
    for t in range(3):
        np.testing.assert_array_equal(shown[t + 1]["pixels"], true[t]["pixels"])


# What stays true.


def test_the_episode_is_the_same_as_with_perfect_sensors(sense, demonstrations):
    env, perfect = sense("NeedlePick", **IMPERFECT), demonstrations("NeedlePick", 1)[0]
    assert_same(play(env, steps=50)[1], perfect.observations)


def test_reward_and_success_judge_the_truth(sense, demonstrations):
    env, perfect = sense("NeedleReach", position_std=1.0), demonstrations("NeedleReach", 1)[0]
    env.reset(seed=0)
    returned = [env.step(action) for action in perfect.actions]
    assert [(reward, info["is_success"]) for _, reward, *_, info in returned] == [
        (reward, info["is_success"]) for _, reward, *_, info in perfect.returned
    ]


def test_what_is_shown_lies_in_the_observation_space(sense):
    env = sense("NeedlePick", **IMPERFECT)
    assert all(env.observation_space.contains(shown) for shown in play(env)[0])


# Seeds.


def test_a_seed_gives_the_same_noise_whatever_ran_before(sense):
    env = sense("NeedlePick", **IMPERFECT)
    first = play(env, seed=3)[0]
    play(env, seed=4)
    assert_same(play(env, seed=3)[0], first)


def test_a_seed_gives_the_same_noise_in_any_process(sense):
    code = f"""
import gymnasium as gym, surrol_gym
from surrol_gym.wrappers import ImperfectSensors
env = ImperfectSensors(gym.make("surrol/NeedlePick-v0"), **{IMPERFECT})
print(env.reset(seed=3)[0]["observation"].tolist())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.splitlines()[-1] == str(
        play(sense("NeedlePick", **IMPERFECT), seed=3)[0][0]["observation"].tolist()
    )


def test_another_seed_gives_other_noise_and_so_does_the_next_episode(sense):
    env = sense("NeedleReach", position_std=0.01)
    of_seeds = [errors(env, seed=seed)["achieved_goal"] for seed in (0, 1, None)]
    assert (of_seeds[0] != of_seeds[1]).all() and (of_seeds[1] != of_seeds[2]).all()


def test_noise_of_a_seed_grows_with_its_standard_deviation(sense):
    small, large = (errors(sense("NeedleReach", position_std=std))["achieved_goal"] for std in (0.01, 0.02))
    np.testing.assert_allclose(large, 2 * small, atol=1e-6)


# In Gymnasium.


def test_the_spec_makes_the_same_environment_again(sense):
    env = sense("NeedlePick", **IMPERFECT)
    again = gym.make(env.spec)
    assert_same(play(env)[0], play(again)[0])
    again.close()


def test_a_vector_environment_shows_and_tells_what_its_parts_do(sense):
    envs = gym.make_vec("surrol/NeedlePick-v0", 2, "sync", wrappers=[lambda env: ImperfectSensors(env, **IMPERFECT)])
    observation, info = envs.reset(seed=[3, 4])
    envs.close()
    env = sense("NeedlePick", **IMPERFECT)
    for row, seed in enumerate((3, 4)):
        shown, told = env.reset(seed=seed)
        for key in ARRAYS:
            np.testing.assert_array_equal(observation[key][row], shown[key])
            np.testing.assert_array_equal(info["true_observation"][key][row], told["true_observation"][key])


# Bad input.


@pytest.mark.parametrize(
    ("sensors", "told"),
    [
        ({"position_std": -0.01}, "position_std .* got -0.01"),
        ({"angle_std": -1}, "angle_std .* got -1"),
        ({"angle_std": float("nan")}, "angle_std .* got nan"),
        ({"position_std": float("inf")}, "position_std .* got inf"),
        ({"dropout": 1.5}, "dropout .* got 1.5"),
        ({"dropout": -0.5}, "dropout .* got -0.5"),
        ({"delay": -1}, "delay .* got -1"),
        ({"delay": 0.5}, "delay .* got 0.5"),
        ({"delay": True}, "delay .* got True"),
        ({"position_std": "a"}, "position_std .* got 'a'"),
        ({"dropout": None}, "dropout .* got None"),
    ],
)
def test_an_argument_out_of_range_is_named(sense, sensors, told):
    with pytest.raises(ValueError, match=told):
        sense("NeedleReach", **sensors)


def test_an_environment_of_another_kind_is_refused():
    with pytest.raises(TypeError, match="CartPole.* does not say what its numbers are"):
        ImperfectSensors(gym.make("CartPole-v1"))


@pytest.mark.parametrize(
    ("changed", "missing"),
    [
        (FlattenObservation, "observation"),
        (lambda env: FilterObservation(env, ["observation", "desired_goal"]), "achieved_goal"),
    ],
)
def test_an_environment_whose_observations_were_changed_is_refused(make, changed, missing):
    with pytest.raises(TypeError, match=f"does not show {missing} .*beneath"):
        ImperfectSensors(changed(make("NeedlePick")), position_std=0.01)


# Noisy actions.


@pytest.fixture
def actuate(make):
    """Makes an environment by the name of its task, whose actions are noisy; and a list of those that it gets."""

    def actuate(task, action_std):
        env = make(task)
        done, step = [], env.unwrapped.step
        env.unwrapped.step = lambda action: done.append(action) or step(action)
        return NoisyActions(env, action_std), done

    return actuate


def done_of(env, done, seed=0, steps=20, action=0.0):
    """What an arm does that is told the same in every step, array (steps, A)."""
    done.clear()
    env.reset(seed=seed)
    for _ in range(steps):
        env.step(np.full(env.action_space.shape, action, dtype=np.float32))
    return np.array(done)


def test_every_number_of_an_action_gets_noise_that_is_new_in_every_step(actuate):
    noise = done_of(*actuate("BiPegTransfer", 0.2), steps=100)
    assert noise.shape == (100, 10) and (np.diff(noise, axis=0) != 0).all()
    np.testing.assert_allclose(noise.std(axis=0), 0.2, rtol=0.3)
    np.testing.assert_allclose(noise.mean(axis=0), 0, atol=0.1)


def test_noisy_actions_stay_in_the_action_space(actuate):
    env, done = actuate("NeedleReach", 0.5)
    noisy = done_of(env, done, action=1.0)
    assert all(env.action_space.contains(action) for action in done)
    assert 0 < (noisy == 1).sum() < noisy.size


def test_without_noise_an_arm_does_what_it_is_told(actuate):
    assert (done_of(*actuate("NeedleReach", 0.0), action=0.3) == np.float32(0.3)).all()


def test_a_seed_gives_the_same_noise_of_actions_and_another_seed_another(actuate):
    env, done = actuate("NeedleReach", 0.1)
    first, other, again = (done_of(env, done, seed) for seed in (3, 4, 3))
    np.testing.assert_array_equal(first, again)
    assert (first != other).all() and (done_of(env, done, seed=None) != first).all()


def test_actions_and_sensors_do_not_share_their_noise(make):
    alone = ImperfectSensors(make("NeedleReach"), **IMPERFECT).reset(seed=3)[0]
    both = imperfect(make("NeedleReach"), IMPERFECT | {"action_std": 0.1})
    assert_same([alone], [both.reset(seed=3)[0]])
    assert isinstance(both.env, NoisyActions)


@pytest.mark.parametrize("sensors", [None, {}, PERFECT, {"action_std": 0.0}])
def test_what_changes_nothing_wraps_nothing(make, sensors):
    env = make("NeedleReach")
    assert imperfect(env, sensors) is env


def test_the_spec_makes_noisy_actions_again(make):
    env = NoisyActions(make("NeedleReach"), action_std=0.3)
    again = gym.make(env.spec)
    for one in (env, again):
        one.reset(seed=3)
    told = np.zeros(5, dtype=np.float32)
    assert_same([env.step(told)[0]], [again.step(told)[0]])
    again.close()


def test_noise_does_not_hide_an_action_of_another_shape(make):
    env = NoisyActions(make("NeedleReach"), action_std=0.1)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"takes actions of shape \(5,\), got \(1,\)"):
        env.step(np.zeros(1))


@pytest.mark.parametrize(
    ("action", "told"), [([0, np.inf, 0, 0, 0], "not finite: .*inf"), (None, "takes actions"), ("up", "convert")]
)
def test_noise_does_not_hide_what_is_no_action(make, action, told):
    env = NoisyActions(make("NeedleReach"), action_std=0.1)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=told):
        env.step(action)


@pytest.mark.parametrize("std", [-0.1, float("nan"), float("inf"), "a"])
def test_noise_of_actions_out_of_range_is_named(make, std):
    with pytest.raises(ValueError, match=f"action_std .* got {std!r}"):
        NoisyActions(make("NeedleReach"), std)


def test_sensors_know_no_actions():
    with pytest.raises(ValueError, match="Sensors have no action_std; choose from position_std, .*, delay"):
        complete_sensors({"action_std": 0.1})
