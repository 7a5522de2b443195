"""A scripted person, who looks at the scene and presses keys of the X server's keyboard, by its XTEST extension.

What a hand does is decided by the scripted expert's law, as coarsely as keys allow; the actions come from the keys.
"""

import threading
import time
from functools import partial

import gymnasium as gym
import numpy as np
from Xlib import XK, X
from Xlib.display import Display
from Xlib.ext import xtest

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
    """Presses keys until the end, each time until the arm has moved.

    Args:
        env: A ``Watched`` environment of one arm.
    """

    def __init__(self, env):
        super().__init__(daemon=True)
        self._env, self._expert, self._keyboard = env, surrol_gym.make_expert(env), Keys()

    def run(self):
        while True:
            if self._env.seen is None:
                time.sleep(0.02)
                continue
            wanted = self._env.steps + 1
            self._keyboard.hold(self._keys(self._expert.act(self._env.seen)), partial(self._has_done, wanted))

    def _has_done(self, steps):
        return self._env.steps >= steps

    def _keys(self, action):
        jaws_are_open = self._env.seen["observation"][6] > 0.55
        if (action[4] > 0) != jaws_are_open:
            return ["c" if jaws_are_open else "v"]
        # The person takes one size of motion at a time: far away the large one, near by the fine one.
        size = SPEED if np.abs(action[:4]).max() > 0.6 * SPEED else FINE
        keys = [key for key, (place, sign) in MOTIONS.items() if sign * action[place] > 0.3 * size]
        return (["Shift_L"] if size == FINE else []) + (keys or ["r"])


class Keys:
    """The keys of the X server's keyboard."""

    def __init__(self):
        self._display = Display()

    def hold(self, keys, until):
        """Holds keys, named as X does, until something is seen; presses them anew if nobody listened yet."""
        while not until():
            self._send(X.KeyPress, keys)
            patience = time.monotonic() + 10.0
            while not until() and time.monotonic() < patience:
                time.sleep(0.005)
            self._send(X.KeyRelease, keys[::-1])

    def tap(self, key):
        """Presses a key and lets it go."""
        self._send(X.KeyPress, [key])
        self._send(X.KeyRelease, [key])

    def _send(self, event, keys):
        for key in keys:
            xtest.fake_input(self._display, event, self._display.keysym_to_keycode(XK.string_to_keysym(key)))
        self._display.sync()
