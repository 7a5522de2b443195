"""What a dataset holds on request: arms as a dVRK reports them, films; and the time that is left to the goal."""

import itertools

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit
from lerobot.datasets.lerobot_dataset import LeRobotDataset

import surrol_gym
from lerobot_gcdt.environment.surrol_env import env_class
from lerobot_gcdt.hub.cards import dataset_card
from lerobot_gcdt.recording import demonstrations, record
from lerobot_gcdt.recording.episodes import run_episode
from lerobot_gcdt.recording.features import Extras, describe_columns, time_to_goal, to_columns
from lerobot_gcdt.recording.fields import FIELDS, register_field
from lerobot_gcdt.recording.openh import describe_cartesian_state, observe_cartesian_state
from surrol_gym.psm.arm import euler_to_matrix, quaternion_to_matrix
from surrol_gym.units import to_metres

RICH = Extras(["openh"], ["overview", "closeup"], 32)
STATE, OVERVIEW = "observation.cartesian_state", "observation.images.overview"


def names(env_class):
    """Names of the numbers of ``observation.cartesian_state``."""
    return list(describe_cartesian_state(env_class)[STATE])


@pytest.fixture(params=surrol_gym.TASKS)
def env(request):
    """Each task."""
    env = gym.make(f"surrol/{request.param}-v0")
    yield env
    env.close()


@pytest.fixture(scope="module")
def rich_root(tmp_path_factory):
    """Folder of a NeedlePick dataset of two episodes with everything that can be asked for."""
    return record("NeedlePick", 2, 0, tmp_path_factory.mktemp("rich") / "needle_pick", 0.3, RICH)


# Columns.


def test_an_episode_has_the_columns_that_are_described(env):
    columns = to_columns(run_episode(TimeLimit(env, 2), 0, 0.0, RICH))
    described = describe_columns(env, RICH)
    assert columns.keys() == described.keys()
    for key, values in columns.items():
        assert values.shape[1:] == described[key]["shape"], key
        assert values.dtype == ("uint8" if described[key]["dtype"] == "video" else described[key]["dtype"]), key


@pytest.mark.parametrize("env", ["PegTransfer", "NeedleRegrasp"], indirect=True)
def test_what_is_recorded_beside_changes_nothing_else(env):
    plain, rich = run_episode(env, 1, 0.3), run_episode(env, 1, 0.3, RICH)
    for key, values in plain.items():
        np.testing.assert_array_equal(rich[key], values)


# Open-H-Embodiment.


def test_the_numbers_of_an_arm_have_the_names_and_the_order_of_the_norm():
    assert names(env_class("surrol/NeedlePick-v0")) == [
        *(f"psm1_pose.position.{axis}" for axis in "xyz"),
        *(f"psm1_pose.orientation.{axis}" for axis in "xyzw"),
        "psm1_jaw",
    ]
    first, second = np.split(np.array(names(env_class("surrol/NeedleRegrasp-v0"))), 2)
    assert [name.replace("psm1", "psm2") for name in first] == list(second)


def test_the_base_frames_lead_to_the_tips_and_orientations_in_the_world(env):
    env.reset(seed=0)
    expert, observation = surrol_gym.make_expert(env), env.unwrapped.set_state(env.unwrapped.get_state())
    for _ in range(30):
        observation = env.step(expert.act(observation))[0]
    numbers = observe_cartesian_state(env.unwrapped)[STATE].reshape(-1, 8)
    for arm, mount, (*position, x, y, z, w, jaw) in zip(env.unwrapped.arms, env.unwrapped.mounts, numbers, strict=True):
        base = euler_to_matrix((0, 0, mount.base_yaw))
        remote_centre = mount.base_position + base @ (0, 0.4864, 0)
        np.testing.assert_allclose(remote_centre + base @ position, to_metres(arm.tip()), atol=1e-5)
        axes = base @ quaternion_to_matrix((x, y, z, w))
        link = euler_to_matrix(arm.pose()[1])
        np.testing.assert_allclose(axes[:, 2], link[:, 1], atol=1e-4, err_msg="z points along the jaws")
        np.testing.assert_allclose(axes[:, 0], -link[:, 2], atol=1e-4, err_msg="x is the axis of the hinge")
        assert jaw == np.float32(arm.jaw_angle())


def test_quaternions_have_length_1_and_never_jump(env):
    quaternions = run_episode(env, 2, 0.3, Extras(["openh"]))[STATE].reshape(-1, len(env.unwrapped.mounts), 8)[..., 3:7]
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=-1), 1, atol=1e-6)
    assert np.linalg.norm(np.diff(quaternions, axis=0), axis=-1).max() < 0.5


def test_a_dataset_holds_the_numbers_of_its_episodes(rich_root):
    stored = LeRobotDataset("local/rich", root=rich_root, video_backend="pyav")
    env = gym.make("surrol/NeedlePick-v0")
    episode = run_episode(env, 0, 0.3, Extras(["openh"]))
    env.close()
    assert stored.features[STATE]["names"] == names(type(env.unwrapped))
    np.testing.assert_array_equal(np.stack([stored[t][STATE] for t in range(50)]), episode[STATE])


# A field of one's own: what it is called, how it is observed, and one registration.

TEMPERATURE = """
import numpy as np
from lerobot_gcdt.recording.fields import register_field

register_field(
    "temperature",
    lambda env_class: {"observation.temperature": {"room": "of the room (K)"}},
    lambda env: {"observation.temperature": np.array([300], dtype=np.float32)},
)
"""


@pytest.fixture
def thermometer(tmp_path, monkeypatch):
    """A module on the path that registers a field."""
    (tmp_path / "thermometer.py").write_text(TEMPERATURE)
    monkeypatch.syspath_prepend(tmp_path)
    yield
    del FIELDS["temperature"]


def test_a_field_of_ones_own_is_recorded_and_described(thermometer, tmp_path):
    root = record("NeedleReach", 1, 0, tmp_path / "reach", extras=Extras(["thermometer:temperature"]))
    stored = LeRobotDataset("local/reach", root=root, video_backend="pyav")
    assert stored.features["observation.temperature"]["names"] == ["room"]
    assert stored[0]["observation.temperature"] == 300
    card = dataset_card(root)
    assert "| `observation.temperature`, `room` | of the room (K) | 300 |" in card
    assert "--fields thermometer:temperature " in card


def test_a_name_is_registered_once():
    with pytest.raises(ValueError, match="'openh' already"):
        register_field("openh", *vars(FIELDS["openh"]).values())


# Films.


def test_films_show_what_the_cameras_see(rich_root):
    stored = LeRobotDataset("local/rich", root=rich_root, video_backend="pyav")
    env = gym.make("surrol/NeedlePick-v0")
    pictures = run_episode(env, 0, 0.3, RICH)
    env.close()
    assert stored.meta.camera_keys == [OVERVIEW, "observation.images.closeup"]
    for t in (0, 30, 49):
        for key in stored.meta.camera_keys:
            shown = stored[t][key].permute(1, 2, 0).numpy() * 255
            assert np.abs(shown - pictures[key][t]).mean() < 8, "but for compression"


def test_filmed_recordings_go_on_after_an_interruption_without_rendering_again(rich_root, tmp_path, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    root = tmp_path / "needle_pick"
    with monkeypatch.context() as patch:
        patch.setattr(demonstrations, "build_dataset", interrupted)
        with pytest.raises(KeyboardInterrupt):
            record("NeedlePick", 2, 0, root, 0.3, RICH)
    monkeypatch.setattr(demonstrations, "run_episode", interrupted)
    record("NeedlePick", 2, 0, root, 0.3, RICH)
    for file in rich_root.rglob("*"):
        if file.is_file():
            assert (root / file.relative_to(rich_root)).read_bytes() == file.read_bytes(), file


# Bad input: one clear error each.


@pytest.mark.parametrize(
    ("extras", "named"),
    [
        (Extras(["dvrk"]), "openh"),
        (Extras(["no_module:dvrk"]), "no_module"),
        (Extras(["openh", "openh"]), "openh, openh"),
        (Extras(cameras=["both_arms"]), "closeup, overview"),
        (Extras(cameras=["overview", "overview"]), "closeup, overview"),
        (Extras(cameras=["overview"], camera_size=33), "33"),
        (Extras(cameras=["overview"], camera_size=0), "0"),
    ],
    ids=["unknown field", "unknown module", "field twice", "no such camera", "camera twice", "odd size", "no size"],
)
def test_what_cannot_be_recorded_is_named_and_leaves_no_trace(extras, named, tmp_path):
    with pytest.raises(ValueError, match=named):
        record("NeedlePick", 1, 0, tmp_path / "needle_pick", extras=extras)
    assert not list(tmp_path.iterdir())


def test_a_dataset_without_films_is_not_taken_for_one_with_films(needle_pick_root):
    with pytest.raises(ValueError, match="extras"):
        record("NeedlePick", 4, 0, needle_pick_root, extras=Extras(cameras=["overview"]))


# Time to goal.


def test_time_to_goal_of_every_short_episode():
    for length in range(1, 7):
        for success in itertools.product([False, True], repeat=length):
            if any(success):
                expected = [max(success.index(True) + 1 - t, 0) for t in range(length)]
                assert time_to_goal(np.array(success)).tolist() == expected


def test_time_to_goal_is_float32():
    assert time_to_goal(np.array([False, True])).dtype == np.float32
