"""The environment type ``surrol``: LeRobot makes it, and its observations carry the keys of the datasets."""

import json
import multiprocessing

import draccus
import gymnasium as gym
import numpy as np
import pytest
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.envs import make_env, make_env_pre_post_processors, preprocess_observation
from lerobot.envs.configs import EnvConfig
from lerobot.envs.factory import make_env_config
from lerobot.envs.utils import NEW_ROLLOUT_OPTION, env_to_policy_features

import surrol_gym
from lerobot_gcdt import SurRoLEnvConfig
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.recording.features import Extras

BOTH = "NeedleReach-v0,NeedlePick-v0"


@pytest.fixture
def make():
    """Makes the vector environments of a configuration and closes them in the end."""
    made = []

    def make(config, *arguments, **options):
        envs = make_env(config, *arguments, **options)
        made.extend(env for tasks in envs.values() for env in tasks.values())
        return envs

    yield make
    for env in made:
        env.close()


def only(envs):
    """The single vector environment of a single task."""
    [[env]] = [list(tasks.values()) for tasks in envs.values()]
    return env


# Making it.


def test_lerobot_knows_the_type():
    assert EnvConfig.get_choice_class("surrol") is SurRoLEnvConfig
    assert isinstance(make_env_config("surrol", task="NeedleReach-v0"), SurRoLEnvConfig)


@pytest.mark.parametrize("task", surrol_gym.TASKS)
def test_a_task_becomes_one_vector_environment(task, make):
    envs = make(SurRoLEnvConfig(task=f"{task}-v0"), n_envs=2)
    assert list(envs) == [f"{task}-v0"]
    assert only(envs).num_envs == 2
    assert only(envs).get_attr("spec")[0].id == f"surrol/{task}-v0"


@pytest.mark.parametrize("separator", [",", ", "])
def test_a_comma_separates_tasks(separator, make):
    envs = make(SurRoLEnvConfig(task=BOTH.replace(",", separator)))
    assert list(envs) == BOTH.split(",")
    assert [f"{tasks[0].get_attr('task')[0]}-v0" for tasks in envs.values()] == BOTH.split(",")


def test_the_command_line_chooses_task_and_picture(make):
    arguments = ["--task=NeedleReach-v0", "--camera=overview", "--width=64", "--height=32"]
    env = only(make(draccus.parse(SurRoLEnvConfig, args=arguments)))
    env.reset(seed=0)
    assert env.call("render")[0].shape == (32, 64, 3)


def test_a_picture_is_small_and_has_even_sides_by_default(make):
    env = only(make(SurRoLEnvConfig()))
    env.reset(seed=0)
    height, width, channels = env.call("render")[0].shape
    assert (height % 2, width % 2, channels) == (0, 0, 3)
    assert max(height, width) <= 256


def test_the_environments_tell_lerobots_rollout_what_it_asks_for(make):
    env = only(make(SurRoLEnvConfig(task="NeedlePick-v0"), n_envs=2))
    unwrapped = env.envs[0].unwrapped
    assert env.call("task_description") == (unwrapped.task_description,) * 2
    assert env.call("task") == ("NeedlePick",) * 2
    assert env.call("_max_episode_steps") == (gym.spec("surrol/NeedlePick-v0").max_episode_steps,) * 2
    assert env.unwrapped.metadata["render_fps"] == SurRoLEnvConfig().fps


def test_a_finished_episode_waits_for_the_others(make):
    env = only(make(SurRoLEnvConfig(task="NeedleReach-v0")))
    env.reset(seed=[0], options={NEW_ROLLOUT_OPTION: True})
    action = np.full((1, 5), 0.5, dtype=np.float32)
    for _ in range(env.call("_max_episode_steps")[0]):
        last, *_, truncated, _ = env.step(action)
    assert truncated.all()
    after, *_ = env.step(action)
    np.testing.assert_array_equal(after["observation"], last["observation"])


# Features.


@pytest.mark.parametrize("task", surrol_gym.TASKS)
def test_the_features_have_the_shapes_of_the_spaces(task):
    config = SurRoLEnvConfig(task=f"{task}-v0")
    env = gym.make(f"surrol/{task}-v0")
    spaces, action_space = env.observation_space, env.action_space
    env.close()
    assert {key: feature.shape for key, feature in config.features.items()} == {
        "observation.state": spaces["observation"].shape,
        "observation.goal": spaces["desired_goal"].shape,
        "observation.environment_state": spaces["desired_goal"].shape,
        "observation.achieved_goal": spaces["achieved_goal"].shape,
        "action": action_space.shape,
    }


def test_the_features_are_the_datasets_own(needle_pick_meta):
    from lerobot.utils.feature_utils import dataset_to_policy_features

    of_the_dataset = dataset_to_policy_features(needle_pick_meta.features)
    of_the_environment = env_to_policy_features(SurRoLEnvConfig(task="NeedlePick-v0"))
    assert of_the_environment == {key: of_the_dataset[key] for key in of_the_environment}
    assert set(of_the_dataset) - set(of_the_environment) == {"observation.time_to_goal"}


def test_a_configuration_survives_encoding():
    config = SurRoLEnvConfig(task=BOTH, width=64, camera="overview")
    assert draccus.decode(EnvConfig, json.loads(json.dumps(draccus.encode(config, EnvConfig)))) == config


# Observations.


def processed(config, observation):
    """An observation as LeRobot's rollout hands it to the policy's preprocessor."""
    preprocessor, _ = make_env_pre_post_processors(env_cfg=config, policy_cfg=None)
    return preprocessor(preprocess_observation(observation))


@pytest.mark.parametrize(
    ("task", "fixture"), [("NeedlePick", "needle_pick_root"), ("NeedleReach", "needle_reach_root")]
)
def test_a_reset_looks_like_the_first_frame_of_the_dataset(task, fixture, make, request):
    root = request.getfixturevalue(fixture)
    dataset = LeRobotDataset("local/x", root=root)
    seeds = json.loads((root / "meta" / "surrol.json").read_text())["seeds"]
    config = SurRoLEnvConfig(task=f"{task}-v0")
    observation, _ = only(make(config, n_envs=2)).reset(seed=seeds[:2])
    batch = processed(config, observation)
    keys = {key for key in dataset.features if key.startswith("observation.")} - {"observation.time_to_goal"}
    assert {key for key in batch if key.startswith("observation.")} == keys
    for row, first in enumerate(dataset.meta.episodes["dataset_from_index"][:2]):
        for key in keys:
            np.testing.assert_array_equal(batch[key][row], dataset[first][key])


def test_policies_see_the_pictures_that_recordings_hold(make):
    extras = Extras(cameras=["overview", "closeup"], camera_size=32)
    config = SurRoLEnvConfig(task="NeedlePick-v0", cameras="overview,closeup", camera_size=32)
    env = only(make(config, n_envs=2))
    observation, _ = env.reset(seed=[3, 4])
    assert env.observation_space.contains(observation)
    batch = processed(config, observation)
    for row, single in enumerate(env.envs):
        for key, picture in extras.observe(single).items():
            np.testing.assert_array_equal(np.rint(255 * batch[key][row].permute(1, 2, 0).numpy()), picture)
            assert env_to_policy_features(config)[key].shape == batch[key][row].shape
    assert {key for key in batch if key.startswith("observation.")} == set(config.features) - {"action"}


def test_policies_see_through_imperfect_sensors_that_are_asked_for(make):
    exact = only(make(SurRoLEnvConfig(task="NeedleReach-v0"))).reset(seed=[3])[0]
    noisy, info = only(make(SurRoLEnvConfig(task="NeedleReach-v0", position_std=0.05))).reset(seed=[3])
    assert np.abs(noisy["observation"] - exact["observation"])[0, :3].max() > 0.001
    np.testing.assert_array_equal(info["true_observation"]["observation"], exact["observation"])


def test_policies_act_with_the_noise_that_is_asked_for(make):
    exact, noisy = (only(make(SurRoLEnvConfig(task="NeedleReach-v0", action_std=std))) for std in (0.0, 0.2))
    action = np.zeros((1, 5), dtype=np.float32)
    for env in (exact, noisy):
        env.reset(seed=[3])
    assert np.abs(exact.step(action)[0]["achieved_goal"] - noisy.step(action)[0]["achieved_goal"]).max() > 0.001


def test_the_task_sentence_passes_the_processors():
    observation = {key: np.zeros((1, 3), dtype=np.float32) for key in ("observation", "achieved_goal", "desired_goal")}
    preprocessor, _ = SurRoLEnvConfig().get_env_processors()
    assert preprocessor(preprocess_observation(observation) | {"task": ["Reach."]})["task"] == ["Reach."]


def test_actions_pass_the_processors_unchanged():
    _, postprocessor = SurRoLEnvConfig().get_env_processors()
    action = torch.linspace(-1, 1, 5)[None]
    assert torch.equal(postprocessor({"action": action})["action"], action)


def test_processes_of_their_own_give_the_same_episodes(make):
    # The processes are forked from one that has imported LeRobot already, instead of importing it one by one.
    multiprocessing.set_forkserver_preload(["lerobot_gcdt"])
    config = SurRoLEnvConfig(task="NeedlePick-v0")
    actions = np.random.default_rng(0).uniform(-1, 1, (4, 2, 5)).astype(np.float32)

    def episodes(use_async_envs):
        env = only(make(config, n_envs=2, use_async_envs=use_async_envs))
        assert isinstance(env, gym.vector.AsyncVectorEnv) == use_async_envs
        frames = [env.reset(seed=[3, 4])[0]]
        frames += [{k: v.copy() for k, v in env.step(action)[0].items()} for action in actions]
        return frames

    for beside, apart in zip(episodes(False), episodes(True), strict=True):
        for key in beside:
            np.testing.assert_array_equal(beside[key], apart[key])


def test_a_single_environment_needs_no_process_of_its_own(make):
    assert isinstance(only(make(SurRoLEnvConfig(), n_envs=1, use_async_envs=True)), gym.vector.SyncVectorEnv)


# Bad input.


@pytest.mark.parametrize(
    "task", ["NeedleThread-v0", "needlepick", "NeedlePick-v9", "", "NeedleReach-v0,NeedleThread-v0"]
)
def test_an_unknown_task_is_one_error_that_names_it_and_the_known_ones(task):
    with pytest.raises(OptionError, match="NeedlePick") as error:
        SurRoLEnvConfig(task=task)
    assert repr(task.split(",")[-1]) in str(error.value)


def test_an_unknown_camera_of_policies_names_the_known_ones():
    with pytest.raises(OptionError, match="(?s)closeup, overview.*endoscope"):
        SurRoLEnvConfig(cameras="overview,endoscope")


@pytest.mark.parametrize(
    ("picture", "named"),
    [
        ({"camera": "endoscope"}, "endoscope"),
        ({"width": 0}, "width must be positive, got 0"),
        ({"height": -8}, "height must be positive, got -8"),
        ({"camera_size": 0}, "camera_size"),
    ],
    ids=["camera", "width", "height", "camera_size"],
)
def test_a_bad_picture_is_one_error_that_names_it(picture, named):
    with pytest.raises(OptionError, match=named):
        SurRoLEnvConfig(**picture)


@pytest.mark.parametrize(
    ("sensors", "told"),
    [
        ({"dropout": 2.0}, "env.dropout is a probability, in .* got 2"),
        ({"position_std": -1.0}, "env.position_std must be a finite number from 0 on, got -1"),
        ({"delay": -1}, "env.delay must be a whole number of steps from 0 on, got -1"),
        ({"action_std": float("nan")}, "env.action_std must be a finite number from 0 on, got nan"),
    ],
    ids=["dropout", "position_std", "delay", "action_std"],
)
def test_sensors_out_of_range_are_named_before_an_environment_is_made(sensors, told):
    with pytest.raises(OptionError, match=told):
        SurRoLEnvConfig(task="NeedleReach-v0", **sensors)
