"""Recordings in which a policy acts: the expert says what to do, the disturbance what was done instead."""

import json
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import torch
from lerobot.configs.types import FeatureType, NormalizationMode, PolicyFeature

import surrol_gym
from lerobot_gcdt import GCDTPolicy
from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.recording import Learner, record
from lerobot_gcdt.recording.episodes import run_episode

LIMIT = 50
"""Steps of an episode of NeedleReach."""


class Constant:
    """A policy that always does the same. It notes how it is used."""

    def __init__(self, *action):
        self.action = torch.tensor([action])
        self.resets, self.batches = 0, []

    def reset(self):
        self.resets, self.batches = self.resets + 1, []

    def select_action(self, batch):
        self.batches.append(batch)
        return self.action


@pytest.fixture(scope="module")
def env():
    """NeedleReach, which reaches its goal also from where a bad policy leaves it."""
    env = gym.make("surrol/NeedleReach-v0")
    yield env
    env.close()


@pytest.fixture
def upwards():
    """A policy that goes up and aside."""
    return Constant(0.2, 0.0, 0.3, 0.0, 1.0)


def executed(episode):
    return episode["action"] + episode["disturbance"]


def follows(episode, policy):
    """Whether each step executed the policy's action."""
    return np.isclose(executed(episode), policy.action.numpy(), atol=1e-6).all(axis=1)


def facts(root):
    return json.loads((root / "meta/surrol.json").read_text())


def files(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


# Who acts.


def test_the_policy_acts_first_and_the_expert_alone_afterwards(env, upwards):
    episode = run_episode(env, 3, learner=Learner(upwards, "upwards"))
    handover = len(upwards.batches)
    assert 0 < handover < LIMIT
    assert follows(episode, upwards)[:handover].all()
    assert not episode["disturbance"][handover:].any()
    assert episode["success"][-1]


def test_the_expert_takes_over_anywhere_in_the_episode(env, upwards):
    handovers = []
    for seed in range(20):
        run_episode(env, seed, learner=Learner(upwards, "upwards"))
        handovers.append(len(upwards.batches))
    assert min(handovers) < LIMIT / 4 and max(handovers) > 3 * LIMIT / 4
    assert 0.3 * LIMIT < np.mean(handovers) < 0.7 * LIMIT


def test_the_mix_is_the_share_of_steps_that_the_expert_takes_before(env, upwards):
    policys, all_steps = 0, 0
    for seed in range(20):
        episode = run_episode(env, seed, learner=Learner(upwards, "upwards", mix=0.25))
        policys += follows(episode, upwards).sum()
        all_steps += len(upwards.batches)
    assert 0.65 < policys / all_steps < 0.85


def test_with_a_mix_of_1_the_policy_only_looks_on(env, upwards):
    episode = run_episode(env, 3, learner=Learner(upwards, "upwards", mix=1.0))
    assert upwards.batches
    for key, values in run_episode(env, 3).items():
        np.testing.assert_array_equal(episode[key], values)


def test_the_policy_sees_each_step_as_a_dataset_has_it(env, upwards):
    episode = run_episode(env, 3, learner=Learner(upwards, "upwards"))
    assert upwards.resets == 1
    for t, batch in enumerate(upwards.batches):
        np.testing.assert_array_equal(batch["observation.state"], episode["observation"][[t]])
        np.testing.assert_array_equal(batch["observation.goal"], episode["desired_goal"][[t]])
        assert batch["task"] == [env.unwrapped.task_description]


# What is recorded.


@pytest.mark.parametrize("disturb", [0.0, 0.5], ids=["not pushed", "pushed"])
def test_the_action_is_always_what_the_expert_would_do(env, upwards, disturb):
    episode = run_episode(env, 3, disturb, learner=Learner(upwards, "upwards", mix=0.5))
    expert = surrol_gym.make_expert(env)
    for t, action in enumerate(episode["action"]):
        seen = {key: episode[key][t] for key in ("observation", "achieved_goal", "desired_goal")}
        np.testing.assert_array_equal(expert.act(seen), action)


def test_the_pushes_are_those_of_a_disturbed_episode_on_top_of_what_the_policy_does(env, upwards):
    episode = run_episode(env, 3, 0.5, learner=Learner(upwards, "upwards"))
    before = np.arange(LIMIT) < len(upwards.batches)
    pushed = before & ~follows(episode, upwards)
    assert 0 < pushed.sum() < before.sum() / 2
    push = executed(episode)[pushed] - upwards.action.numpy()
    assert np.abs(push).max() <= 0.5 + 1e-6 and push[:, 2].min() >= -1e-6
    np.testing.assert_allclose(push[:, 4], 0, atol=1e-6)


def test_actions_out_of_range_are_recorded_as_the_environment_executes_them(env):
    episode = run_episode(env, 3, learner=Learner(Constant(5.0, -5.0, 5.0, 0.0, 0.0), "wild"))
    np.testing.assert_allclose(executed(episode)[0], [1, -1, 1, 0, 0], atol=1e-6)


@pytest.mark.parametrize(("task", "size", "disturb"), [("NeedleReach", 5, 0.0), ("NeedleRegrasp", 10, 0.3)])
def test_an_episode_replays_from_its_seed_and_its_columns_to_the_same_numbers(tmp_path, task, size, disturb):
    root = record(task, 1, 0, tmp_path / "x", disturb, learner=Learner(Constant(*[0.1] * size), "x", mix=0.5))
    columns = read_columns(root, ("observation.state", "action", "disturbance", "next.success"))
    with gym.make(f"surrol/{task}-v0") as env:
        observation, _ = env.reset(seed=facts(root)["seeds"][0])
        for t, action in enumerate(columns["action"] + columns["disturbance"]):
            np.testing.assert_array_equal(observation["observation"], columns["observation.state"][t])
            observation, *_, info = env.step(action)
            assert info["is_success"] == columns["next.success"][t]
    assert columns["disturbance"].any() and columns["next.success"].any()


def test_a_recording_tells_the_policy_and_the_mix_and_others_tell_none(tmp_path, upwards, needle_reach_root):
    root = record("NeedleReach", 1, 0, tmp_path / "reach", learner=Learner(upwards, "outputs/upwards", mix=0.25))
    assert (facts(root)["policy"], facts(root)["mix"]) == ("outputs/upwards", 0.25)
    assert not {"policy", "mix"} & set(facts(needle_reach_root))
    assert list(facts(root))[:6] == list(facts(needle_reach_root))[:6]


# The same arguments, the same bytes.


def test_an_interrupted_recording_goes_on_to_the_same_bytes(tmp_path, upwards, interrupted_in_the_second):
    with pytest.raises(KeyboardInterrupt):
        record("NeedleReach", 2, 0, tmp_path / "parts", learner=Learner(upwards, "upwards", mix=0.5))
    again = record("NeedleReach", 2, 0, tmp_path / "parts", learner=Learner(upwards, "upwards", mix=0.5))
    assert interrupted_in_the_second == [0, 1, 1]
    whole = record("NeedleReach", 2, 0, tmp_path / "whole", learner=Learner(upwards, "upwards", mix=0.5))
    assert files(again) == files(whole)


def test_a_folder_holds_the_recording_of_one_policy_and_mix(tmp_path, upwards, needle_reach_root):
    def recorded(root, episodes, *learner):
        return record("NeedleReach", episodes, 0, root, learner=Learner(upwards, *learner) if learner else None)

    root = recorded(tmp_path / "reach", 1, "upwards", 0.5)
    before = files(root)
    for learner, named in ((("downwards", 0.5), "policy"), (("upwards", 0.0), "mix"), ((), "policy")):
        with pytest.raises(ValueError, match=named):
            recorded(root, 1, *learner)
    with pytest.raises(ValueError, match="policy = None, not 'upwards'"):
        recorded(needle_reach_root, facts(needle_reach_root)["episodes"], "upwards")
    assert files(root) == before


# Bad input.


@pytest.mark.parametrize("mix", [-0.1, 1.5, float("nan")])
def test_a_mix_out_of_range_is_named(upwards, mix):
    with pytest.raises(ValueError, match=f"got {mix}"):
        Learner(upwards, "upwards", mix)


def test_a_policy_that_needs_pictures_is_refused(upwards):
    picture = PolicyFeature(FeatureType.VISUAL, (3, 64, 64))
    upwards.config = SimpleNamespace(image_features={"observation.images.closeup": picture})
    with pytest.raises(ValueError, match="upwards sees observation.images.closeup"):
        Learner(upwards, "upwards")


def test_a_policy_without_its_processors_is_refused(needle_reach_meta, tiny_config):
    tiny_config.normalization_mapping = {"STATE": NormalizationMode.MEAN_STD}
    with pytest.raises(ValueError, match="bare GCDTPolicy .*load_policy"):
        Learner(GCDTPolicy(tiny_config, dataset_meta=needle_reach_meta), "bare")
