"""What takes long to show: ``pytest -m study tests/surrol_gym`` (about an hour; ``-k PegTransfer`` for one task)."""

import gc

import gymnasium as gym
import numpy as np
import pytest

import surrol_gym

pytestmark = [pytest.mark.study, pytest.mark.parametrize("task", surrol_gym.TASKS)]


def run(env, act, seed, steps, since=None):
    """Plays an episode, if ``since`` is given to its first success after that many steps.

    Returns:
        Whether each step was a success.
    """
    observation, _ = env.reset(seed=seed)
    successes = []
    while len(successes) < steps and not (since is not None and any(successes[since:])):
        observation, _, _, _, info = env.step(act(observation, len(successes)))
        successes.append(info["is_success"])
    return np.array(successes)


def test_experts_succeed_in_99_percent_of_episodes_hold_the_goal_and_leave_time(make, task, seeds):
    env = make(task)
    expert = surrol_gym.make_expert(env)
    steps = env.spec.max_episode_steps
    played = [run(env, lambda observation, _: expert.act(observation), seed, steps) for seed in seeds(30_000, 500)]
    held = np.mean([successes[-1] for successes in played])
    firsts = [1 + successes.argmax() for successes in played if successes.any()]
    print(f"{task}: held {held:.3f} of {len(played)}, first success at step {np.mean(firsts):.1f} of {steps}")
    assert min(held, len(firsts) / len(played)) >= 0.99
    assert np.mean(firsts) <= 0.75 * steps


def test_experts_recover_from_five_random_actions(make, task, seeds):
    """In NeedleRegrasp the jaws obey: the needle would fall to where no arm reaches."""
    env = make(task).unwrapped
    expert = surrol_gym.make_expert(env)
    limit = gym.spec(f"surrol/{task}-v0").max_episode_steps
    recovered = []
    for seed in seeds(40_000, 200):
        rng = np.random.default_rng([seed, 1])
        begin = rng.integers(0, limit - 5)

        def act(observation, step, rng=rng, begin=begin):
            action = expert.act(observation)
            if not 0 <= step - begin < 5:
                return action
            disturbed = rng.uniform(-1, 1, env.action_space.shape)
            if task == "NeedleRegrasp":
                disturbed[4::5] = action[4::5]
            return disturbed

        recovered.append(run(env, act, seed, 2 * limit, since=begin + 5)[begin + 5 :].any())
    print(f"{task}: {sum(recovered)} of {len(recovered)} succeeded after the random actions")
    assert np.mean(recovered) >= 0.95


def test_a_random_policy_succeeds_in_nothing_but_reaching(make, task, seeds):
    env = make(task)
    env.action_space.seed(0)
    steps = env.spec.max_episode_steps
    episodes = seeds(50_000, 200)
    reached = sum(run(env, lambda *_: env.action_space.sample(), seed, steps).any() for seed in episodes)
    print(f"{task}: {reached} of {len(episodes)} by chance")
    if task != "NeedleReach":
        assert reached == 0


def test_memory_and_clients_stay_flat(make, task):
    """1,000 resets, then 200 times made and closed."""
    env = make(task)
    for seed in range(50):
        env.reset(seed=seed)
    before = memory()
    for seed in range(1000):
        env.reset(seed=seed)
    assert memory() - before < 3
    for _ in range(20):
        used_and_closed(task)
    before = memory()
    clients = [used_and_closed(task) for _ in range(200)]
    gc.collect()
    print(f"{task}: {memory() - before:+.1f} MB")
    assert memory() - before < 10
    assert not any(client.isConnected() for client in clients)


def used_and_closed(task):
    """Makes an environment, uses and closes it; returns its PyBullet client."""
    env = gym.make(f"surrol/{task}-v0")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    client = env.unwrapped.world.client
    env.close()
    return client


def memory():
    """Memory of this process now, MB."""
    with open("/proc/self/statm") as statistics:
        return int(statistics.read().split()[1]) * 4096 / 2**20
