"""The round trip: what is exported, played back in the simulator, does what the episode did."""

from dataclasses import replace

import numpy as np
import pytest

from lerobot_gcdt import GENERALIST
from lerobot_gcdt.evaluation import load_policy
from lerobot_gcdt.robot.config_surrol_psm import SurRoLPSMConfig
from lerobot_gcdt.robot.episodes import play
from lerobot_gcdt.robot.names import action_names, observation_names
from lerobot_gcdt.robot.playback import action_to, at_knots, play_back
from lerobot_gcdt.robot.set_points import interpolate
from lerobot_gcdt.robot.surrol_psm import SurRoLPSM
from surrol_gym.psm.arm import euler_to_matrix
from surrol_gym.registry import env_class

PAPERS = ["NeedlePick", "GauzeRetrieve", "PegTransfer", "NeedleRegrasp", "BiPegTransfer", "BiPegBoard"]
"""Tasks that the paper executes on a real robot."""


@pytest.fixture(scope="module")
def policies():
    return {"expert": None, "generalist": load_policy(GENERALIST)}


def tips_of(numbers, arms):
    """Tips of the jaws, metres, from the seven numbers of each arm: 10.2 mm along y of link 5."""
    return [row[:3] / 5 + 0.0102 * euler_to_matrix(row[3:6])[:, 1] for row in np.reshape(numbers[: 7 * arms], (-1, 7))]


def through_surrol_psm(trajectory):
    """Sends a trajectory to LeRobot's simulated robot, which logs how it ends; returns the path of the tips."""
    task = env_class(trajectory.task)
    names, arms = observation_names(task), len(task.mounts)
    robot = SurRoLPSM(SurRoLPSMConfig(task=trajectory.task, seed=trajectory.seed))
    robot.connect()
    try:
        seen = [np.array([robot.get_observation()[name] for name in names])]
        for joints, jaws in at_knots(trajectory):
            action = action_to(task.mounts, seen[-1], joints, jaws)
            robot.send_action(dict(zip(action_names(task), action.tolist(), strict=True)))
            seen.append(np.array([robot.get_observation()[name] for name in names]))
    finally:
        robot.disconnect()
    return np.array([tips_of(numbers, arms) for numbers in seen])


@pytest.mark.parametrize("who", ["expert", "generalist"])
@pytest.mark.parametrize("task", PAPERS)
def test_exported_joints_through_surrol_psm_reproduce_the_tip_path_and_the_success(task, who, policies, caplog):
    episode = play(task, 3, policies[who], who)
    assert episode.success[-1] and len(episode.tips) == len(episode.success) + 1
    caplog.set_level("INFO")
    tips = through_surrol_psm(interpolate(episode, rate=20))
    assert np.linalg.norm(tips - episode.tips, axis=-1).max() < 0.2e-3
    assert f"{len(episode.success)} steps, the goal reached in step" in caplog.text
    assert ", held at the end" in caplog.text


def test_the_same_happens_in_the_bare_environment(episode, trajectory):
    played = play_back(trajectory)
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
