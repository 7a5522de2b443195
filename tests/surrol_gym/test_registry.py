"""Anybody's task has the rights of the ten: registered in one call, found by its name, with the module in front."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import surrol_gym
from surrol_gym import registry
from surrol_gym.experts import Target
from surrol_gym.tasks.needle_reach import NeedleReachEnv

PACKAGE = """
import surrol_gym
from surrol_gym.experts import Target
from surrol_gym.tasks.needle_reach import NeedleReachEnv

class SlowReachEnv(NeedleReachEnv):
    task_description = "Reach slowly."

def law(seen):
    return Target(seen.goal_tip - seen.tip, speed=0.1)

surrol_gym.register_task(SlowReachEnv, 7, law)
"""


class DownwardReachEnv(NeedleReachEnv):
    """A task of one's own."""


def straight_down(seen):
    return Target(np.array([0.0, 0.0, seen.goal_tip_z - seen.tip_z]))


@pytest.fixture(autouse=True)
def forgetful(monkeypatch):
    """What a test registers is gone after it."""
    monkeypatch.setattr(registry, "_ids", [*registry._ids])
    monkeypatch.setattr(registry, "_laws", {**registry._laws})
    before = set(gym.registry)
    yield
    for env_id in set(gym.registry) - before:
        del gym.registry[env_id]


def test_a_class_defined_anywhere_is_a_task_after_one_call():
    assert surrol_gym.register_task(DownwardReachEnv, 7, straight_down) == "surrol/DownwardReach-v0"
    assert surrol_gym.registered_tasks()[:10] == surrol_gym.TASKS
    assert surrol_gym.registered_tasks()[-1] == "DownwardReach"
    env = gym.make("surrol/DownwardReach-v0")
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(np.sign(surrol_gym.make_expert(env).act(observation)), [0, 0, -1, 0, -1])
    assert [env.step(np.zeros(5))[3] for _ in range(7)] == [False] * 6 + [True]
    env.close()


def test_a_task_without_an_expert_has_none_even_if_the_class_that_it_derives_from_has():
    surrol_gym.register_task(DownwardReachEnv, 7)
    env = gym.make("surrol/DownwardReach-v0")
    with pytest.raises(TypeError, match="DownwardReach"):
        surrol_gym.make_expert(env)
    env.close()


@pytest.mark.parametrize("task", ["NeedlePick", "NeedlePick-v0", "surrol/NeedlePick", "surrol/NeedlePick-v0"])
def test_a_task_is_found_by_its_name_or_id(task):
    assert surrol_gym.find_task(task) == "surrol/NeedlePick-v0"


def test_without_a_version_the_newest_is_meant():
    surrol_gym.register_task(DownwardReachEnv, 7, version=10)
    surrol_gym.register_task(DownwardReachEnv, 7, version=9)
    assert surrol_gym.find_task("DownwardReach") == "surrol/DownwardReach-v10"
    assert surrol_gym.find_task("DownwardReach-v9") == "surrol/DownwardReach-v9"


def test_the_module_in_front_is_imported_and_stays_in_front(tmp_path, monkeypatch):
    (tmp_path / "slow_reach.py").write_text(PACKAGE)
    monkeypatch.syspath_prepend(tmp_path)
    assert surrol_gym.find_task("slow_reach:SlowReach") == "slow_reach:surrol/SlowReach-v0"
    assert surrol_gym.find_task("slow_reach:surrol/SlowReach-v0") == "slow_reach:surrol/SlowReach-v0"
    assert registry.task_spec("slow_reach:SlowReach").max_episode_steps == 7
    assert registry.env_class("slow_reach:SlowReach").task_description == "Reach slowly."
    assert registry.task_name("slow_reach:surrol/SlowReach-v0") == "SlowReach"


def test_another_class_under_a_registered_name_is_refused():
    surrol_gym.register_task(DownwardReachEnv, 7)
    with pytest.raises(ValueError, match=r"surrol/DownwardReach-v0 .*another name"):
        surrol_gym.register_task(DownwardReachEnv, 9)


@pytest.mark.parametrize(
    ("task", "named"),
    [
        ("NeedleThread", "NeedleThread.*NeedleReach, .*my_module:MyTask"),
        ("NeedlePick-v7", "NeedlePick-v7.*surrol/NeedlePick-v0"),
        ("nowhere:NeedlePick", "No module named 'nowhere'.*PYTHONPATH"),
        ("math:NeedleThread", "math:NeedleThread"),
        ("", "''"),
    ],
)
def test_a_task_that_is_not_found_is_one_line_that_names_it_and_the_way_out(task, named):
    with pytest.raises(ValueError, match=named) as error:
        surrol_gym.find_task(task)
    assert "\n" not in str(error.value)


def test_names_and_lookups_load_no_simulation():
    code = "import sys, surrol_gym; surrol_gym.find_task('NeedlePick'); print('pybullet' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
