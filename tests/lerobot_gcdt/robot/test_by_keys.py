"""LeRobot's commands and ours under a virtual display, driven by key presses."""

import json
from importlib.util import find_spec
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from lerobot_gcdt.data.columns import read_columns

HERE = Path(__file__).parent

pytestmark = pytest.mark.study  # takes minutes beside other work


@pytest.fixture(scope="module")
def folder(on_display, tmp_path_factory):
    """What ``by_keys.py`` left: two recordings, and how teleoperators moved the arm."""
    if not find_spec("pynput"):
        pytest.skip("pynput is not installed (lerobot[core_scripts])")
    folder = tmp_path_factory.mktemp("by_keys")
    on_display(HERE / "by_keys.py", folder, timeout=600, HF_LEROBOT_HOME=folder / "home")
    return folder


@pytest.mark.parametrize("teleoperator", ["psm_keyboard", "keyboard_ee"])
def test_lerobot_teleoperate_moves_the_arm(folder, teleoperator):
    moved = json.loads((folder / "told.json").read_text())[teleoperator]
    assert moved["psm1_x.pos"] > 0.015
    assert moved["psm1_jaw.pos"] > 0.6
    assert moved["psm1_z.pos"] == pytest.approx(0, abs=1e-3)
    if teleoperator == "psm_keyboard":
        assert moved["psm1_yaw.pos"] > 0.2
    else:
        assert moved["psm1_y.pos"] < -0.015


def test_lerobot_record_keeps_what_the_keys_did(folder):
    columns = read_columns(folder / "by_hand", ["action", "observation.state"])
    info = json.loads((folder / "by_hand/meta/info.json").read_text())
    assert info["robot_type"] == "surrol_psm"
    assert info["features"]["action"]["names"][:2] == ["psm1_dx.vel", "psm1_dy.vel"]
    pressed = columns["action"][:, 0] > 0
    assert pressed.any() and not pressed.all()
    assert columns["observation.state"][-1, 0] > columns["observation.state"][0, 0]


@pytest.fixture(scope="module")
def human(folder):
    """The columns of the episode that a person recorded."""
    names = ["state", "goal", "environment_state", "achieved_goal", "time_to_goal"]
    return read_columns(
        folder / "human", [*(f"observation.{name}" for name in names), "action", "disturbance", "next.success"]
    )


def test_gcdt_record_marks_the_episode_as_a_humans(folder, human):
    facts = json.loads((folder / "human/meta/surrol.json").read_text())
    assert facts["human"] == "keyboard"
    assert (facts["env_id"], facts["seeds"], facts["frames"]) == ("surrol/NeedlePick-v0", [15], len(human["action"]))


def test_the_humans_episode_picks_the_needle_and_holds_the_goal(human):
    assert human["next.success"][-5:].all() and not human["next.success"][:-5].all()


def test_time_to_goal_counts_down_to_the_humans_success(human):
    first = np.flatnonzero(human["next.success"])[0]
    expected = np.maximum(first + 1 - np.arange(len(human["action"])), 0)
    np.testing.assert_array_equal(human["observation.time_to_goal"], expected)


def test_actions_are_those_that_keys_can_make(human):
    assert set(np.round(np.abs(human["action"][:, :4]).astype(float), 6).ravel().tolist()) <= {0.0, 0.1, 0.5}
    assert not human["disturbance"].any()


def test_the_humans_episode_replays_to_the_same_numbers(human):
    env = gym.make("surrol/NeedlePick-v0")
    observation, _ = env.reset(seed=15)
    for t, action in enumerate(human["action"]):
        np.testing.assert_array_equal(observation["observation"], human["observation.state"][t])
        np.testing.assert_array_equal(observation["desired_goal"], human["observation.goal"][t])
        np.testing.assert_array_equal(observation["achieved_goal"], human["observation.achieved_goal"][t])
        observation, _, _, _, info = env.step(action)
        assert info["is_success"] == human["next.success"][t]
    env.close()
