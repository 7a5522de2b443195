"""Episodes that somebody acts out: when a step is taken, and when they end."""

import numpy as np
import pytest

import surrol_gym
from surrol_gym import by_hand
from surrol_gym.by_hand import HOLD, PATIENCE, BeginAgain, Stop, act_out

CLOSED, OPEN = np.array([0, 0, 0, 0, -1.0]), np.array([0, 0, 0, 0, 1.0])


@pytest.fixture(autouse=True)
def time(monkeypatch):
    """Time that passes at once, and what was slept."""
    slept = []
    monkeypatch.setattr(by_hand.time, "sleep", slept.append)
    return slept


@pytest.fixture
def acted(make):
    """Acts out an episode of NeedleReach by a list of commands; returns the actions of its steps."""

    def acted(*commands, task="NeedleReach"):
        waiting, steps = list(commands), []

        def command():
            if not waiting:
                raise Stop
            if isinstance(waiting[0], type):
                raise waiting.pop(0)
            return waiting.pop(0)

        with pytest.raises(Stop):
            act_out(make(task), 0, command, lambda _, action, *__: steps.append(action), steps.clear)
        return steps

    return acted


def test_time_stands_still_while_nothing_is_commanded(acted):
    assert acted(CLOSED, CLOSED, CLOSED) == []


def test_motion_takes_a_step(acted):
    assert len(acted(CLOSED, CLOSED + [0.1, 0, 0, 0, 0], CLOSED)) == 1


def test_a_change_of_the_jaws_takes_a_step(acted):
    assert len(acted(OPEN, OPEN, CLOSED, CLOSED, task="NeedlePick")) == 2


def test_a_step_lasts_as_long_as_its_simulated_time(acted, time):
    acted(CLOSED + [0.1, 0, 0, 0, 0])
    assert 0.1 < time[-1] <= 0.2


def test_beginning_anew_forgets_the_steps(acted):
    motion = CLOSED + [0.1, 0, 0, 0, 0]
    assert len(acted(motion, motion, BeginAgain, motion)) == 1


def test_an_episode_ends_when_the_goal_has_been_held(make):
    env, infos, seen = make("NeedleReach"), [], []
    expert = surrol_gym.make_expert(env)
    env.reset(seed=0)

    def command():
        # The person lets go as soon as the goal is reached.
        if infos and infos[-1]["is_success"]:
            return CLOSED
        return expert.act(seen[-1] if seen else env.unwrapped.set_state(env.unwrapped.get_state()))

    def on_step(observation, action, reward, info):
        infos.append(info)
        seen.append(env.unwrapped.set_state(env.unwrapped.get_state()))

    assert act_out(env, 0, command, on_step, infos.clear)
    assert [info["is_success"] for info in infos[-HOLD:]] == [True] * HOLD
    assert not infos[-HOLD - 1]["is_success"]


def test_patience_ends(make, monkeypatch):
    monkeypatch.setattr(by_hand, "PATIENCE", 0.1)
    steps = []
    held = act_out(
        make("NeedleReach"), 0, lambda: CLOSED + [0, 0, 1, 0, 0], lambda *step: steps.append(step), steps.clear
    )
    assert not held and len(steps) == 5
    assert PATIENCE > 1
