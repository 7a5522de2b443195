"""Fixtures of the simulator's tests."""

from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from functools import cache

import gymnasium as gym
import pytest

import surrol_gym

CONTRACT = (*surrol_gym.TASKS, "new_task:PushBlock")
"""The tasks that keep the contract: the ten, and the one of ``examples/new_task.py``; ``--task`` adds more."""


def pytest_generate_tests(metafunc):
    marked = any("env" in mark.args[0] for mark in metafunc.definition.iter_markers("parametrize"))
    if "env" in metafunc.fixturenames and not marked and not hasattr(metafunc.module, "env"):
        tasks = (*CONTRACT, *metafunc.config.getoption("task"))
        metafunc.parametrize("env", tasks, indirect=True, scope="session")


@dataclass
class Demonstration:
    """An episode of the expert to the time limit.

    Attributes:
        observations: What the expert acted upon, and at last what it left.
        actions: What it did.
        returned: What each step returned.
        attached: For each grasp of the environment whether it held its object after each step.
    """

    observations: list
    actions: list = field(default_factory=list)
    returned: list = field(default_factory=list)
    attached: list = field(default_factory=list)

    @property
    def successes(self):
        """Whether each step was a success."""
        return [info["is_success"] for *_, info in self.returned]

    @property
    def first(self):
        """Number of steps to the first success."""
        return 1 + self.successes.index(True)

    @property
    def holds(self):
        """Whether every step after the first success is one, too."""
        return all(self.successes[self.first :])


def demonstrate(env, seed):
    """Plays a demonstration."""
    expert = surrol_gym.make_expert(env)
    one, truncated = Demonstration([env.reset(seed=seed)[0]]), False
    while not truncated:
        one.actions.append(expert.act(one.observations[-1]))
        one.returned.append(env.step(one.actions[-1]))
        one.attached.append([grasp.attached for grasps in env.unwrapped.grasps for grasp in grasps])
        observation, _, _, truncated, _ = one.returned[-1]
        one.observations.append(observation)
    return one


@pytest.fixture(scope="session")
def demonstrations():
    """Demonstrations of a task, by its name, from the seeds from 0 on; each is played once for all tests."""
    with ExitStack() as envs:

        @cache
        def made(task):
            return envs.enter_context(closing(gym.make(surrol_gym.find_task(task))))

        @cache
        def demonstration(task, seed):
            return demonstrate(made(task), seed)

        yield lambda task, count=10: [demonstration(task, seed) for seed in range(count)]


@pytest.fixture(scope="session")
def grip():
    """Lets the expert of a task with one arm close the jaws on its object; returns the last observation."""

    def grip(env, seed=0):
        expert = surrol_gym.make_expert(env)
        observation, _ = env.reset(seed=seed)
        action = expert.act(observation)
        while action[4] > 0:
            observation, *_ = env.step(action)
            action = expert.act(observation)
        return env.step(action)[0]

    return grip


@pytest.fixture
def make():
    """Makes environments by the name of their task and closes them after the test."""
    made = []

    def make(task, **kwargs):
        made.append(gym.make(surrol_gym.find_task(task), **kwargs))
        return made[-1]

    yield make
    for env in made:
        env.close()


@pytest.fixture(scope="session")
def env(request):
    """An environment of each task; tests share it, so each starts with a seeded reset."""
    env = gym.make(surrol_gym.find_task(request.param))
    yield env
    env.close()
