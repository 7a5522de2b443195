"""Plays NeedlePick in its window, by key presses: ``play_by_keys.py PICTURE`` also takes a picture of the screen."""

import sys

import gymnasium as gym
from person import Person, Watched
from PIL import ImageGrab

from surrol_gym import play


class Photographed(Watched):
    """Takes a picture of the screen when the window is about to be closed."""

    def close(self):
        ImageGrab.grab(xdisplay="").save(sys.argv[1])
        super().close()


def make(*arguments, make=gym.make, **options):
    env = Photographed(make(*arguments, **options))
    Person(env).start()
    return env


gym.make = make
play.main(["--task", "NeedlePick", "--seed", "15", "--episodes", "1"])
