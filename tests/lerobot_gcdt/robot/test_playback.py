"""The round trip: what is exported, played back in the simulator, does what the episode did."""

from dataclasses import replace

import numpy as np
import pytest

from lerobot_gcdt import GENERALIST
from lerobot_gcdt.evaluation import load_policy
from lerobot_gcdt.robot.episodes import play
from lerobot_gcdt.robot.playback import play_back
from lerobot_gcdt.robot.set_points import interpolate

PAPERS = ["NeedlePick", "GauzeRetrieve", "PegTransfer", "NeedleRegrasp", "BiPegTransfer", "BiPegBoard"]
"""Tasks that the paper executes on a real robot."""


@pytest.fixture(scope="module")
def policies():
    return {"expert": None, "generalist": load_policy(GENERALIST)}


@pytest.mark.parametrize("who", ["expert", "generalist"])
@pytest.mark.parametrize("task", PAPERS)
def test_exported_joints_reproduce_the_tip_path_and_the_success(task, who, policies):
    episode = play(task, 3, policies[who], who)
    assert episode.success[-1] and len(episode.tips) == len(episode.success) + 1
    played = play_back(interpolate(episode))
    assert played.success[-1]
    assert np.linalg.norm(played.tips - episode.tips, axis=-1).max() < 0.2e-3


def test_joints_that_are_off_end_elsewhere(episode, trajectory):
    points = trajectory.arms["PSM1"]
    played = play_back(replace(trajectory, arms={"PSM1": replace(points, joints=points.joints + 0.01)}))
    assert np.linalg.norm(played.tips - episode.tips, axis=-1).max() > 1e-3


def test_jaws_that_stay_open_pick_nothing(trajectory):
    points = trajectory.arms["PSM1"]
    wide = replace(points, jaw=np.full_like(points.jaw, 0.7))
    assert not play_back(replace(trajectory, arms={"PSM1": wide})).success[-1]
