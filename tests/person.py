"""A scripted person, who looks at the scene and presses keys of the X server's keyboard, as ``xdotool`` does for them.

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
    """Presses keys until it is told to stop.

    Args:
        env: A ``Watched`` environment of one arm.
    """

    def __init__(self, env):
        super().__init__(daemon=True)
        self._env, self._expert, self._leaves = env, surrol_gym.make_expert(env), threading.Event()
        self._jaws = -1.0

    def run(self):
        while not self._leaves.is_set():
            if self._env.seen is None:
                time.sleep(0.02)
                continue
            action = self._expert.act(self._env.seen)
            before, keys = self._env.steps, self._keys(action)
            xdotool("keydown", keys)
            while self._env.steps == before and not self._leaves.wait(0.005):
                pass
            xdotool("keyup", keys[::-1])

    def leave(self):
        self._leaves.set()
        self.join()

    def _keys(self, action):
        if np.sign(action[4]) != self._jaws:
            self._jaws = np.sign(action[4])
            return ["c" if self._jaws < 0 else "v"]
        # The person takes one size of motion at a time: far away the large one, near by the fine one.
        size = SPEED if np.abs(action[:4]).max() > 0.6 * SPEED else FINE
        keys = [key for key, (place, sign) in MOTIONS.items() if sign * action[place] > 0.3 * size]
        return (["shift"] if size == FINE else []) + (keys or ["r"])


def xdotool(what, keys):
    subprocess.run(["xdotool", *(word for key in keys for word in (what, key))], check=True)
