"""Episodes that a person acts out, in real time: time stands still while nothing is commanded."""

import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np

from surrol_gym.display import WindowClosed
from surrol_gym.envs.psm_env import unwrapped

HOLD = 5
"""Steps for which the goal has to be held, at the end of an episode."""

PATIENCE = 10
"""A person has this many times the steps of the task's time limit."""

_GRIPPER = slice(4, None, 5)
_POLL = 0.02  # seconds between two looks at the keys while time stands still


class BeginAgain(Exception):
    """The person wants to begin the episode anew."""


class Stop(Exception):
    """The person wants to stop."""


Command = Callable[[], np.ndarray]
"""Returns the action that a person commands at this moment; raises ``BeginAgain`` or ``Stop`` for other wishes."""


def act_out(env: gym.Env, seed: int, command: Command) -> bool:
    """Lets a person act out one episode.

    A step is taken whenever the command moves an arm or changes what jaws do, and also without while the goal is held,
    which ends the episode after ``HOLD`` steps.

    Args:
        env: The environment.
        seed: Seed of the reset.
        command: The person. Whenever they begin anew, the environment is reset.

    Returns:
        Whether the goal was reached and held; else ``PATIENCE`` ran out.

    Raises:
        Stop: The person wants to stop, or closed the window.
    """
    assert env.spec and env.spec.max_episode_steps  # every task is registered with a time limit
    pace = 1 / env.metadata["render_fps"]
    while True:
        env.reset(seed=seed)
        jaws = np.full(len(unwrapped(env).mounts), -1.0)  # closed
        held = steps = 0
        try:
            while held < HOLD and steps < PATIENCE * env.spec.max_episode_steps:
                begun = time.perf_counter()
                unwrapped(env).render()  # keeps the window alive; before the command, as a gamepad empties its queue
                action = command()
                moves = np.delete(action, _GRIPPER).any() or (np.sign(action[_GRIPPER]) != jaws).any()
                if not moves and not held:
                    time.sleep(_POLL)
                    continue
                jaws = np.sign(action[_GRIPPER])
                info = env.step(action)[-1]
                steps += 1
                held = held + 1 if info["is_success"] else 0
                time.sleep(max(pace - (time.perf_counter() - begun), 0.0))
            return held == HOLD
        except BeginAgain:
            continue
        except WindowClosed as error:
            raise Stop from error
