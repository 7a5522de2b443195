"""Recordings of a person: the same format, marked as human."""

import json
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

import gcdt_cli
import surrol_gym
from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.hub.cards import dataset_card
from lerobot_gcdt.recording import Person, merge, record
from lerobot_gcdt.robot.names import BEGIN, ActionReader
from lerobot_gcdt.robot.person import TeleoperatorCommand
from surrol_gym import by_hand
from surrol_gym.by_hand import BeginAgain, Stop
from surrol_gym.registry import env_class

AT_ONCE = SimpleNamespace(perf_counter=lambda: 0.0, sleep=lambda seconds: None)
"""Time that nobody waits for."""


@pytest.fixture(autouse=True)
def _no_waiting(monkeypatch):
    monkeypatch.setattr(by_hand, "time", AT_ONCE)


class Rehearsed:
    """A person who does what the expert does from some seeds, one after the other, and then stops.

    Time stands still where they command nothing, and they do nothing now and then.
    """

    def __init__(self, *seeds):
        self.left = [action for seed in seeds for action in rehearse(seed)]
        self.asked = 0

    def __call__(self):
        self.asked += 1
        if not self.left:
            raise Stop
        if self.asked % 3 == 0:
            return np.array([0, 0, 0, 0, -1], dtype=np.float32)
        return self.left.pop(0)


def rehearse(seed):
    """The expert's actions in NeedleReach up to the goal."""
    env = gym.make("surrol/NeedleReach-v0")
    expert = surrol_gym.make_expert(env)
    observation, info = env.reset(seed=seed)
    actions = []
    while not info["is_success"]:
        actions.append(expert.act(observation))
        observation, *_, info = env.step(actions[-1])
    env.close()
    return actions


@pytest.fixture(scope="module")
def human_root(tmp_path_factory):
    """Folder of a NeedleReach dataset of two episodes that a person acted out."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(by_hand, "time", AT_ONCE)
        folder = tmp_path_factory.mktemp("human") / "needle_reach"
        # Five more steps hold the goal; the next episode's first actions are not lost to them.
        command = Rehearsed(0)
        command.left += [np.array([0, 0, 0, 0, -1], dtype=np.float32)] * 4 + rehearse(1)
        command.left += [np.array([0, 0, 0, 0, -1], dtype=np.float32)] * 9
        return record("NeedleReach", 2, 0, folder, person=Person("keyboard", command, window=False))


def facts(root):
    return json.loads((root / "meta/surrol.json").read_text())


def test_the_recording_is_marked_as_human(human_root):
    assert facts(human_root)["human"] == "keyboard"
    assert facts(human_root)["seeds"] == [0, 1]


def test_episodes_are_as_long_as_the_person_took(human_root):
    episode = read_columns(human_root, ["episode_index"])["episode_index"]
    lengths = np.bincount(episode)
    assert facts(human_root)["frames"] == lengths.sum()
    assert (lengths == np.array(facts(human_root)["steps_to_success"]) + 4).all()


def test_every_episode_replays(human_root):
    columns = read_columns(human_root, ["observation.state", "action", "disturbance", "episode_index"])
    env = gym.make("surrol/NeedleReach-v0")
    for i, seed in enumerate(facts(human_root)["seeds"]):
        observation, _ = env.reset(seed=seed)
        this = columns["episode_index"] == i
        for state, action in zip(columns["observation.state"][this], columns["action"][this], strict=True):
            np.testing.assert_array_equal(observation["observation"], state)
            observation, *_ = env.step(action)
    assert not columns["disturbance"].any()
    env.close()


def test_it_merges_with_the_experts(human_root, needle_pick_root, tmp_path):
    root = merge([human_root, needle_pick_root], tmp_path / "both")
    assert [part.get("human") for part in facts(root)["merged_from"]] == ["keyboard", None]
    assert "A person acted" in dataset_card(root)


def test_the_card_says_who_acted(human_root):
    text = " ".join(dataset_card(human_root).split())
    assert "demonstrations by a person, of `surrol/NeedleReach-v0`" in text
    assert "A person acted, with LeRobot's teleoperator keyboard" in text
    assert "gcdt record --teleop keyboard --task NeedleReach --episodes 2 --seed 0" in text
    assert "human demonstrations" in text and "scripted" not in text.lower()


def test_who_stops_keeps_what_is_finished_and_goes_on_later(tmp_path):
    command = Rehearsed(0)
    command.left += [np.array([0, 0, 0, 0, -1], dtype=np.float32)] * 4
    with pytest.raises(
        RuntimeError, match="The 1 episodes of 2 that are finished.*goes on with seed 1, and with --episodes 1"
    ):
        record("NeedleReach", 2, 0, tmp_path / "reach", person=Person("keyboard", command, window=False))
    assert not (tmp_path / "reach").exists()
    command = Rehearsed(1)
    command.left += [np.array([0, 0, 0, 0, -1], dtype=np.float32)] * 9
    root = record("NeedleReach", 2, 0, tmp_path / "reach", person=Person("keyboard", command, window=False))
    assert facts(root)["seeds"] == [0, 1]


# A person at one of LeRobot's teleoperators.


def command_of(said, connected=True):
    device = SimpleNamespace(is_connected=connected, get_action=lambda: said)
    return TeleoperatorCommand(device, ActionReader(env_class("NeedlePick"), "-y", 0.2))


def test_what_a_teleoperator_says_is_the_action():
    said = {"delta_x": 0.0, "delta_y": 1.0, "delta_z": 0.0, "gripper": 2.0}
    np.testing.assert_allclose(command_of(said)()[:3], (0.2, 0, 0), atol=1e-7)


def test_a_teleoperator_can_begin_anew():
    with pytest.raises(BeginAgain):
        command_of({BEGIN: 1.0})()


def test_a_teleoperator_that_is_disconnected_stops():
    with pytest.raises(Stop):
        command_of({}, connected=False)()


# The command.


@pytest.mark.parametrize("other", [["--policy", "generalist"], ["--disturb", "0.3"]])
def test_a_person_acts_alone(other, tmp_path):
    with pytest.raises(SystemExit, match="--teleop lets a person act alone"):
        gcdt_cli.main(["record", "--teleop", "keyboard", "--task", "NeedlePick", "--root", str(tmp_path / "x"), *other])
    assert not list(tmp_path.iterdir())


def test_a_person_needs_a_window(tmp_path, no_display):
    with pytest.raises(SystemExit, match="needs a display"):
        gcdt_cli.main(["record", "--teleop", "keyboard", "--task", "NeedlePick", "--root", str(tmp_path / "x")])
    assert not list(tmp_path.iterdir())
