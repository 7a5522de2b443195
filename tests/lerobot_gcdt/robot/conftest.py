"""Episodes of the expert and their set-points, shared by the tests; nobody may change them."""

import pytest

from lerobot_gcdt.robot.episodes import play
from lerobot_gcdt.robot.set_points import interpolate


@pytest.fixture(scope="session")
def episode():
    """NeedlePick: one arm."""
    return play("NeedlePick", 3)


@pytest.fixture(scope="session")
def trajectory(episode):
    """The set-points of ``episode``."""
    return interpolate(episode)


@pytest.fixture(scope="session")
def two_arms():
    """Set-points of BiPegTransfer, 50 a second."""
    return interpolate(play("BiPegTransfer", 3), rate=50)
