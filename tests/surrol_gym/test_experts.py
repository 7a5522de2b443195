import gymnasium as gym
import numpy as np
import pytest

import surrol_gym

ON_THE_PAD = 3.4219
"""Height of the needle at rest, su (docs/reference_values.md#heights-at-rest)."""
JAW, HEIGHT = 6, 15
"""In the observation of NeedlePick: opening angle of the jaws, height of the needle's middle."""


def run(env, seed, disturb, stop_after=None):
    """Plays an episode to the time limit; ``disturb(observation, action)`` may change an action.

    With ``stop_after`` the episode ends at the first success after that many steps.

    Returns:
        Whether each step was a success.
    """
    expert = surrol_gym.make_expert(env)
    observation, _ = env.reset(seed=seed)
    successes, truncated = [], False
    while not truncated and not (stop_after is not None and any(successes[stop_after:])):
        observation, _, _, truncated, info = env.step(disturb(observation, expert.act(observation)))
        successes.append(info["is_success"])
    return successes


@pytest.fixture
def episodes(env, demonstrations):
    return demonstrations(env.unwrapped.task)


@pytest.fixture(scope="module")
def patient_pick():
    """NeedlePick with twice the time."""
    env = gym.make("surrol/NeedlePick-v0", max_episode_steps=100)
    yield env
    env.close()


def test_experts_succeed_in_every_episode_and_still_do_at_its_end(episodes):
    assert len(episodes) == 10
    assert all(any(episode.successes) and episode.successes[-1] for episode in episodes)


@pytest.mark.parametrize("env", surrol_gym.TASKS, indirect=True)
def test_experts_leave_a_quarter_of_the_time(env, episodes):
    """On average; pushed aside, they still succeed in time."""
    assert np.mean([episode.first for episode in episodes]) <= 0.75 * env.spec.max_episode_steps


def test_experts_do_not_chatter(episodes):
    """The jaws change their mind only a few times in an episode, and the last steps are still."""
    for episode in episodes:
        jaws = np.array(episode.actions)[:, 4::5] < 0
        assert np.abs(np.diff(jaws.astype(int), axis=0)).sum(axis=0).max() <= 8


def test_actions_of_experts_are_in_the_action_space(env, episodes):
    for episode in episodes:
        assert np.max(np.abs(episode.actions)) <= 1
        assert all(action in env.action_space for action in episode.actions)


def test_an_expert_is_a_law_of_the_observation_alone(env, episodes):
    """The same observation gives the same action: twice, in any order, from an expert that saw no episode."""
    fresh, episode = surrol_gym.make_expert(env), episodes[0]
    for observation, action in reversed(list(zip(episode.observations[:-1], episode.actions, strict=True))):
        np.testing.assert_array_equal(fresh.act(observation), action)
        np.testing.assert_array_equal(fresh.act(observation), action)


def test_an_expert_leaves_the_observation_as_it_was(env, episodes):
    expert = surrol_gym.make_expert(env)
    for observation in episodes[0].observations:
        before = {key: value.copy() for key, value in observation.items()}
        expert.act(observation)
        for key, value in before.items():
            np.testing.assert_array_equal(observation[key], value)


@pytest.mark.parametrize("env", ["PegTransfer", "NeedleRegrasp"], indirect=True)
def test_an_expert_leaves_the_environment_as_it_was(env):
    observation, _ = env.reset(seed=0)
    untouched = env.step(env.action_space.high)[0]["observation"]
    env.reset(seed=0)
    surrol_gym.make_expert(env).act(observation)
    np.testing.assert_array_equal(env.step(env.action_space.high)[0]["observation"], untouched)


@pytest.mark.parametrize("env", ["PegTransfer"], indirect=True)
def test_an_expert_may_be_made_of_the_wrapped_or_of_the_bare_environment(env):
    observation, _ = env.reset(seed=0)
    wrapped, bare = surrol_gym.make_expert(env), surrol_gym.make_expert(env.unwrapped)
    np.testing.assert_array_equal(wrapped.act(observation), bare.act(observation))


@pytest.mark.parametrize("env", ["PegTransfer"], indirect=True)
def test_an_observation_of_another_task_is_refused(env, demonstrations):
    with pytest.raises(ValueError, match=r"PegTransfer has 19 numbers in observation, not \(7,\)"):
        surrol_gym.make_expert(env).act(demonstrations("NeedleReach", 1)[0].observations[0])


def test_a_foreign_environment_has_no_expert():
    env = gym.make("CartPole-v1")
    with pytest.raises(TypeError, match="CartPole"):
        surrol_gym.make_expert(env)


# ------------------------------------------------------------------------------------------------ NeedlePick, disturbed


class Disturbance:
    """Changes a number of actions in a row, from the first one on at which a condition holds.

    Args:
        begins: ``begins(observation, action)``, the condition.
        change: ``change(action)``, what is done instead.
        count: Number of actions that are changed.
    """

    def __init__(self, begins, change, count):
        self._begins, self._change, self._count = begins, change, count
        self.before = None
        """Observation at the first changed action."""
        self.after = None
        """Observation after the last one."""

    def __call__(self, observation, action):
        if self.before is None and self._begins(observation["observation"], action):
            self.before = observation["observation"]
        elif self.before is None or self._count == 0:
            if self.before is not None and self.after is None:
                self.after = observation["observation"]
            return action
        self._count -= 1
        return np.array(self._change(action), dtype=np.float32)


@pytest.mark.parametrize("seed", range(2))
def test_jaws_that_closed_on_nothing_open_and_try_again(patient_pick, seed):
    above_the_needle = Disturbance(
        begins=lambda state, action: state[2] - state[15] < 0.09 and np.hypot(*(state[:2] - state[13:15])) < 0.05,
        change=lambda action: (0, 0, 0.1, 0, -1),
        count=8,
    )
    successes = run(patient_pick, seed, above_the_needle)
    assert above_the_needle.after[JAW] == pytest.approx(0, abs=0.01)
    assert above_the_needle.after[HEIGHT] == pytest.approx(ON_THE_PAD, abs=5e-4)
    assert successes[-1]


@pytest.mark.parametrize("seed", range(2))
def test_a_needle_that_fell_is_picked_up_again(patient_pick, seed):
    in_the_air = Disturbance(
        begins=lambda state, action: state[HEIGHT] > ON_THE_PAD + 0.06,
        change=lambda action: (*action[:4], 1),
        count=3,
    )
    successes = run(patient_pick, seed, in_the_air)
    assert in_the_air.after[HEIGHT] == pytest.approx(ON_THE_PAD, abs=5e-3)
    assert successes[-1]


@pytest.mark.parametrize("seed", range(2))
def test_a_needle_that_was_pushed_away_is_followed(patient_pick, seed):
    at_the_first_closing = Disturbance(
        begins=lambda state, action: action[4] < 0,
        change=lambda action: (0.6, 0.6, 0, 0, 1),
        count=3,
    )
    successes = run(patient_pick, seed, at_the_first_closing)
    pushed = at_the_first_closing.after[13:16] - at_the_first_closing.before[13:16]
    assert np.linalg.norm(pushed[:2]) > 0.02
    assert abs(pushed[2]) < 0.02
    assert successes[-1]


def test_the_needle_is_picked_in_spite_of_five_random_actions_at_a_random_moment(patient_pick):
    succeeded = 0
    for seed in range(40):
        rng = np.random.default_rng([seed, 1])
        begin = int(rng.integers(0, 45))
        steps = iter(range(patient_pick.spec.max_episode_steps))
        at_random = Disturbance(
            begins=lambda state, action, steps=steps, begin=begin: next(steps) == begin,
            change=lambda action, rng=rng: rng.uniform(-1, 1, 5),
            count=5,
        )
        successes = run(patient_pick, seed, at_random, stop_after=begin + 5)
        assert at_random.after is not None
        succeeded += any(successes[begin + 5 :])
    assert succeeded >= 38
