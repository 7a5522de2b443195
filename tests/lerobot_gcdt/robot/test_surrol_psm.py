"""The simulated arms under LeRobot's own commands, unmodified."""

import json

import numpy as np
import pytest
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.robots import make_robot_from_config
from lerobot.rollout.strategies import base
from lerobot.scripts import lerobot_replay, lerobot_rollout

from lerobot_gcdt import GENERALIST, SurRoLPSMConfig
from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.recording import record
from lerobot_gcdt.robot.names import BEGIN
from lerobot_gcdt.robot.surrol_psm import SurRoLPSM


@pytest.fixture(scope="module")
def disturbed_root(tmp_path_factory):
    """Folder of a dataset of two episodes of NeedleReach in which the arm was pushed."""
    return record("NeedleReach", 2, 5, tmp_path_factory.mktemp("datasets") / "pushed", disturb=0.5)


@pytest.fixture
def robot():
    """Makes connected robots."""
    made = []

    def robot(**options):
        made.append(make_robot_from_config(SurRoLPSMConfig(**options)))
        made[-1].connect()
        return made[-1]

    yield robot
    for one in made:
        if one.is_connected:
            one.disconnect()


@pytest.fixture
def observed(monkeypatch):
    """What robots observed, as rows of numbers; LeRobot's commands do not wait."""
    rows, observe = [], SurRoLPSM.get_observation

    def watched(robot):
        observation = observe(robot)
        rows.append(list(observation.values()))
        return observation

    monkeypatch.setattr(SurRoLPSM, "get_observation", watched)
    monkeypatch.setattr(lerobot_replay, "precise_sleep", lambda seconds: None)
    return rows


# LeRobot's commands.


@pytest.mark.parametrize("episode", [0, 1])
def test_lerobot_replay_reproduces_an_episode_to_the_last_bit(disturbed_root, episode, command, observed):
    command(
        lerobot_replay.main,
        *("--robot.type=surrol_psm", f"--robot.recording={disturbed_root}", f"--robot.episode={episode}"),
        *("--dataset.repo_id=local/pushed", f"--dataset.root={disturbed_root}", f"--dataset.episode={episode}"),
        "--play_sounds=false",
    )
    columns = read_columns(
        disturbed_root,
        ["observation.state", "observation.goal", "observation.achieved_goal", "disturbance", "episode_index"],
    )
    this = columns["episode_index"] == episode
    assert columns["disturbance"][this].any()
    recorded = np.concatenate([columns[key][this] for key in list(columns)[:3]], axis=1)
    np.testing.assert_array_equal(np.array(observed), recorded.astype(float))


def test_lerobot_replay_takes_task_and_seed_by_hand_too(needle_pick_root, command, observed, capfd):
    seed = json.loads((needle_pick_root / "meta/surrol.json").read_text())["seeds"][0]
    command(
        lerobot_replay.main,
        *("--robot.type=surrol_psm", "--robot.task=NeedlePick", f"--robot.seed={seed}", "--play_sounds=false"),
        *("--dataset.repo_id=local/x", f"--dataset.root={needle_pick_root}", "--dataset.episode=0"),
    )
    state = LeRobotDataset("local/x", root=needle_pick_root, episodes=[0]).hf_dataset["observation.state"]
    np.testing.assert_array_equal(np.array(observed)[:, :19], np.stack(state).astype(float))
    told = capfd.readouterr().err
    assert "NeedlePick, seed 0: 50 steps, the goal reached in step" in told and ", held at the end" in told


class Clock:
    """Time that passes by sleeping only."""

    def __init__(self):
        self.now = 0.0

    def perf_counter(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


def test_lerobot_rollout_lets_the_built_in_policy_solve_a_task(command, monkeypatch, observed, capfd):
    clock = Clock()
    monkeypatch.setattr(base, "time", clock)
    monkeypatch.setattr(base, "precise_sleep", clock.sleep)
    command(
        lerobot_rollout.main,
        *(f"--policy.path={GENERALIST}", "--policy.device=cpu", "--device=cpu", "--fps=5", "--duration=9.9"),
        *("--robot.type=surrol_psm", "--robot.task=NeedleReach", "--robot.seed=100000"),
        *("--task=Move the closed jaw tips to the point above the needle.", "--return_to_initial_position=false"),
    )
    told = capfd.readouterr().err
    assert "NeedleReach, seed 100000: 50 steps, the goal reached" in told and ", held at the end" in told


# As a robot.


@pytest.mark.parametrize("task", ["NeedlePick", "BiPegTransfer", "MatchBoardPanel"])
def test_observations_have_the_features_that_are_told_before(robot, task):
    one = robot(task=task, cameras="closeup", camera_size=32)
    observation = one.get_observation()
    features = one.observation_features
    assert list(observation) == list(features)
    assert observation["closeup"].shape == features["closeup"] == (32, 32, 3)
    assert all(kind is float for name, kind in features.items() if name != "closeup")


def test_the_same_seed_starts_the_same_episode(robot):
    assert robot(seed=7).get_observation() == robot(seed=7).get_observation() != robot(seed=8).get_observation()


def test_an_action_tells_what_was_executed(robot):
    one = robot()
    sent = dict.fromkeys(one.action_features, 2.0)
    assert one.send_action(sent) == dict.fromkeys(one.action_features, 1.0)


def test_beginning_anew_goes_to_the_next_seed(robot):
    one, other = robot(seed=3), robot(seed=4)
    idle = dict.fromkeys(one.action_features, 0.0)
    one.send_action(idle)
    one.send_action(idle | {BEGIN: 1.0})
    other.send_action(idle)
    assert one.get_observation() == other.get_observation()


def test_deltas_are_an_action_too(robot):
    one = robot(away="-y", delta_scale=0.5)
    before = one.get_observation()
    one.send_action({"delta_x": 1.0, "delta_y": 1.0, "delta_z": -1.0, "gripper": 2.0})
    after = one.get_observation()
    motion = [after[f"psm1_{axis}.pos"] - before[f"psm1_{axis}.pos"] for axis in "xyz"]
    np.testing.assert_allclose(motion, [0.025, -0.025, -0.025], atol=1e-3)
    assert after["psm1_jaw.pos"] > 0.6


def test_lerobot_record_keeps_deltas_where_it_is_told_to(robot):
    assert list(robot(deltas=True).action_features) == ["delta_x", "delta_y", "delta_z", "gripper"]


# Bad input.


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"task": "NeedleThread"}, "NeedleThread"),
        ({"seed": -1}, "-1"),
        ({"cameras": "ceiling"}, "ceiling"),
        ({"camera_size": 0}, "0"),
        ({"task": "BiPegTransfer", "deltas": True}, "BiPegTransfer"),
    ],
)
def test_a_bad_option_is_named(options, named):
    with pytest.raises(OptionError, match=named):
        SurRoLPSMConfig(**options)


def test_a_window_without_a_display_is_named(no_display):
    with pytest.raises(OptionError, match="robot.window: .* DISPLAY is not set"):
        SurRoLPSMConfig(window=True)


@pytest.mark.parametrize(("options", "named"), [({"away": "up"}, "up"), ({"delta_scale": 0.0}, "0.0")])
def test_a_bad_option_of_deltas_is_named(options, named):
    with pytest.raises(ValueError, match=named):
        make_robot_from_config(SurRoLPSMConfig(**options))


def test_an_episode_that_is_not_there_is_named(disturbed_root):
    with pytest.raises(ValueError, match="2 episodes, counted from 0; there is no 2"):
        make_robot_from_config(SurRoLPSMConfig(recording=str(disturbed_root), episode=2))


@pytest.mark.parametrize("task", ["PegTransfer", "NeedlePick"], ids=["another", "the one without a recording"])
def test_a_recording_of_another_task_is_named(disturbed_root, task):
    with pytest.raises(OptionError, match=f"is of surrol/NeedleReach-v0, not of {task}; leave out robot.task"):
        SurRoLPSMConfig(task=task, recording=str(disturbed_root))


def test_a_folder_without_a_recording_is_named(tmp_path):
    with pytest.raises(OptionError, match="no dataset of `gcdt record`"):
        SurRoLPSMConfig(recording=str(tmp_path))


def test_an_action_of_another_robot_is_refused_with_the_names_that_are_known(robot):
    with pytest.raises(ValueError, match="psm1_dx.vel.*delta_x.*got elbow.pos"):
        robot().send_action({"elbow.pos": 1.0})


def test_positions_are_not_taken_for_motions(robot):
    """`lerobot-rollout` sends them at its end, to go back to the start."""
    one = robot()
    with pytest.raises(ValueError, match="psm1_dx.vel"):
        one.send_action({name: value for name, value in one.get_observation().items() if name.endswith(".pos")})
