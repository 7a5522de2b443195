"""Episodes that somebody acts out: when a step is taken, and when they end."""

from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

import surrol_gym
from surrol_gym import by_hand
from surrol_gym.by_hand import HOLD, PATIENCE, BeginAgain, Stop, act_out
from surrol_gym.envs.goal_env import GoalEnv

CLOSED, OPEN = np.array([0, 0, 0, 0, -1.0]), np.array([0, 0, 0, 0, 1.0])


@pytest.fixture(autouse=True)
def time(monkeypatch):
    """Time that passes at once, and what was slept."""
    slept = []
    monkeypatch.setattr(by_hand, "time", SimpleNamespace(perf_counter=lambda: 0.0, sleep=slept.append))
    return slept


@pytest.fixture
def acted(make):
    """Acts out an episode of NeedleReach by a list of commands; returns how many steps were taken."""

    def acted(*commands, task="NeedleReach"):
        waiting = list(commands)

        def command():
            if not waiting:
                raise Stop
            if isinstance(waiting[0], type):
                raise waiting.pop(0)
            return waiting.pop(0)

        env = make(task)
        with pytest.raises(Stop):
            act_out(env, 0, command)
        return env.unwrapped.elapsed_steps

    return acted


def test_time_stands_still_while_nothing_is_commanded(acted):
    assert acted(CLOSED, CLOSED, CLOSED) == 0


def test_motion_takes_a_step(acted):
    assert acted(CLOSED, CLOSED + [0.1, 0, 0, 0, 0], CLOSED) == 1


def test_a_change_of_the_jaws_takes_a_step(acted):
    assert acted(OPEN, OPEN, CLOSED, CLOSED, task="NeedlePick") == 2


def test_a_step_lasts_as_long_as_its_simulated_time(acted, time):
    acted(CLOSED + [0.1, 0, 0, 0, 0])
    assert time[-1] == pytest.approx(0.2)


def test_a_window_is_kept_alive_while_time_stands_still(acted, monkeypatch):
    times = []
    monkeypatch.setattr(GoalEnv, "render", lambda env: times.append(env.elapsed_steps))
    acted(CLOSED, CLOSED, CLOSED)
    assert times == [0, 0, 0, 0]


def test_beginning_anew_forgets_the_steps(acted):
    motion = CLOSED + [0.1, 0, 0, 0, 0]
    assert acted(motion, motion, BeginAgain, motion) == 1


class Seen(gym.Wrapper):
    """Keeps what steps returned."""

    def reset(self, **kwargs):
        self.observation, info = self.env.reset(**kwargs)
        self.successes = []
        return self.observation, info

    def step(self, action):
        self.observation, *rest, info = self.env.step(action)
        self.successes.append(info["is_success"])
        return self.observation, *rest, info


def test_an_episode_ends_when_the_goal_has_been_held(make):
    env = Seen(make("NeedleReach"))
    expert = surrol_gym.make_expert(env)

    def command():
        # The person lets go as soon as the goal is reached.
        return CLOSED if env.successes and env.successes[-1] else expert.act(env.observation)

    assert act_out(env, 0, command)
    assert env.successes[-HOLD:] == [True] * HOLD
    assert not any(env.successes[:-HOLD])


def test_patience_ends(make, monkeypatch):
    monkeypatch.setattr(by_hand, "PATIENCE", 0.1)
    env = make("NeedleReach")
    assert not act_out(env, 0, lambda: CLOSED + [0, 0, 1, 0, 0])
    assert env.unwrapped.elapsed_steps == 5
    assert PATIENCE > 1
