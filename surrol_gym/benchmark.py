"""Measures the environments: ``python -m surrol_gym.benchmark [--tasks NeedlePick,PegTransfer] [--episodes 10]``.

Times are CPU times of one process. Look at the ratios: they are taken within one run, while milliseconds depend on the
machine and on what else it does.
"""

import argparse
import os
import resource
import time
from collections.abc import Callable, Sequence

import gymnasium as gym
import numpy as np

import surrol_gym
from surrol_gym.envs.goal_env import SUB_STEPS
from surrol_gym.registry import task_name

ORIGINAL = {
    "NeedleReach": (57, 134),
    "GauzeRetrieve": (102, 115),
    "NeedlePick": (100, 36),
    "PegTransfer": (46, 55),
    "NeedleRegrasp": (75, 441),
    "BiPegTransfer": (19, 85),
    "BiPegBoard": (45, 75),
    "MatchBoardPanel": (26, 133),
    "PickAndPlace": (68, 64),
    "MatchBoard": (22, 170),
}
"""Control steps a second and milliseconds a reset of the original simulator, on two cores of an EPYC server."""

COLUMNS = {
    "steps/s": "control steps a second, the expert acting",
    "x orig.": "the same over the original's",
    "x bare": "CPU time of env.step over that of its 48 calls of stepSimulation",
    "reset ms": "median of a reset",
    "renders/s": "pictures of 256 x 256 a second",
    "vector": f"control steps a second of a synchronous vector of {(VECTOR := 4)}, random actions",
    "MB": "memory that an environment adds, its pictures included",
}


def measure(task: str, episodes: int) -> dict[str, float]:
    """Measures one task.

    Args:
        task: Name of the task; see ``surrol_gym.find_task``.
        episodes: Number of episodes of the expert.

    Returns:
        One number for each of ``COLUMNS``, by name.
    """
    memory = _memory()
    env_id = surrol_gym.find_task(task)
    env = gym.make(env_id, render_mode="rgb_array")
    expert = surrol_gym.make_expert(env)
    world = env.get_wrapper_attr("world")
    simulate, simulated = world.step, []

    def timed_simulate(count: int) -> None:
        start = time.process_time()
        simulate(count)
        simulated.append((count, time.process_time() - start))

    world.step = timed_simulate
    resets, steps, acting = [], [], 0.0
    for seed in range(episodes):
        start = time.process_time()
        observation, _ = env.reset(seed=seed)
        resets.append(time.process_time() - start)
        truncated = False
        while not truncated:
            start = time.process_time()
            action = expert.act(observation)
            middle = time.process_time()
            observation, _, _, truncated, _ = env.step(action)
            acting += middle - start
            steps.append(time.process_time() - middle)
    del world.step
    bare = sum(seconds for count, seconds in simulated if count == SUB_STEPS)
    renders = _rate(env.render, 10)
    memory = _memory() - memory
    env.close()
    vector = gym.make_vec(env_id, VECTOR)
    vector.reset(seed=0)
    vector.action_space.seed(0)
    vector_steps = VECTOR * _rate(lambda: vector.step(vector.action_space.sample()), 30)
    vector.close()
    per_second = len(steps) / (sum(steps) + acting)
    return dict(
        zip(
            COLUMNS,
            (
                per_second,
                per_second / ORIGINAL.get(task_name(env_id), (np.nan,))[0],
                sum(steps) / bare,
                1e3 * float(np.median(resets)),
                renders,
                vector_steps,
                memory,
            ),
            strict=True,
        )
    )


def _rate(call: Callable[[], object], count: int) -> float:
    """Calls a second, after one that is not counted."""
    call()
    start = time.process_time()
    for _ in range(count):
        call()
    return count / (time.process_time() - start)


def _memory() -> float:
    """Largest memory of this process so far, MB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1024 if os.uname().sysname == "Linux" else peak / 1024**2


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table, one row a task."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--tasks", default=",".join(surrol_gym.TASKS), help="names separated by commas")
    parser.add_argument("--episodes", type=int, default=10, help="episodes of the expert in each task")
    options = parser.parse_args(arguments)
    tasks = options.tasks.split(",")
    if options.episodes < 1:
        parser.error(f"at least one episode is needed, got {options.episodes}")
    for task in tasks:
        try:
            surrol_gym.find_task(task)
        except ValueError as error:
            parser.error(str(error))
    print(f"{'task':<16}" + "".join(f"{column:>11}" for column in COLUMNS))
    for task in tasks:
        row = measure(task, options.episodes)
        print(f"{task:<16}" + "".join(f"{value:>11.2f}" for value in row.values()), flush=True)
    print(*(f"{column}: {meaning}" for column, meaning in COLUMNS.items()), sep="\n")


if __name__ == "__main__":
    main()
