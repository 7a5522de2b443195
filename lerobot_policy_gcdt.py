"""Discovery shim: LeRobot imports the module that has the name of the distribution."""

from lerobot_gcdt import *  # noqa: F403
