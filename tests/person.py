"""A scripted person, who looks at the scene and taps keys of the X server's keyboard, as ``xdotool`` does for them.

What a hand does is decided by the scripted expert's law, as coarsely as keys allow; the actions come from the keys.
"""

import subprocess
import threading
import time

import gymnasium as gym
import numpy as np

import surrol_gym
from surrol_gym.keyboard import FINE, MOTIONS, SPEED


class Watched(gym.Wrapper):
    """Lets the person see what the last step, or the reset, left."""

    seen = None
    steps = 0

    def reset(self, **kwargs):
        self.seen, info = self.env.reset(**kwargs)
        return self.seen, info

    def step(self, action):
        self.seen, *rest = self.env.step(action)
        self.steps += 1
        return self.seen, *rest


class Person(threading.Thread):
    """Taps keys until the end.

    Args:
        env: A ``Watched`` environment of one arm.
    """

    def __init__(self, env):
        super().__init__(daemon=True)
        self._env, self._expert = env, surrol_gym.make_expert(env)
        self._jaws = -1.0

    def run(self):
        while True:
            if self._env.seen is None:
                time.sleep(0.02)
                continue
            before = self._env.steps
            tap(self._keys(self._expert.act(self._env.seen)))
            for _ in range(100):  # a second; then the key was not heard, or meant nothing
                if self._env.steps != before:
                    break
                time.sleep(0.01)

    def _keys(self, action):
        if np.sign(action[4]) != self._jaws:
            self._jaws = np.sign(action[4])
            return ["c" if self._jaws < 0 else "v"]
        # The person takes one size of motion at a time: far away the large one, near by the fine one.
        size = SPEED if np.abs(action[:4]).max() > 0.6 * SPEED else FINE
        keys = [key for key, (place, sign) in MOTIONS.items() if sign * action[place] > 0.3 * size]
        return (["shift"] if size == FINE else []) + (keys or ["r"])


def hold(keys):
    """Presses keys."""
    _xdotool(*(word for key in keys for word in ("keydown", key)))


def let_go(keys):
    """Releases keys."""
    _xdotool(*(word for key in keys for word in ("keyup", key)))


def tap(keys):
    """Presses keys together and lets them go at once, which is a single step however busy the machine is."""
    _xdotool(*(word for key in keys for word in ("keydown", key)), *(word for key in keys for word in ("keyup", key)))


def _xdotool(*words):
    subprocess.run(["xdotool", *words], check=True)
