"""Fixtures of the simulator's tests. Section numbers in the tests are those of the facts, surrol-facts.md."""

import gymnasium as gym
import pytest

import surrol_gym


@pytest.fixture
def make():
    """Makes environments by the name of their task and closes them after the test."""
    made = []

    def make(task, **kwargs):
        made.append(gym.make(f"surrol/{task}-v0", **kwargs))
        return made[-1]

    yield make
    for env in made:
        env.close()


@pytest.fixture(scope="session", params=surrol_gym.TASKS)
def env(request):
    """An environment of each task; tests share it, so each starts with a seeded reset."""
    env = gym.make(f"surrol/{request.param}-v0")
    yield env
    env.close()
