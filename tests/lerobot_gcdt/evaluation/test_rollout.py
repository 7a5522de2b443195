"""One row an episode, the same whatever runs beside it."""

import json

import gymnasium as gym
import numpy as np
import pandas as pd
import pytest
import torch

import surrol_gym
from lerobot_gcdt.evaluation import evaluate
from surrol_gym.wrappers import ImperfectSensors, NoisyActions

TASKS = ["NeedleReach", "NeedlePick", "BiPegBoard"]


class Zeros:
    """A policy that does nothing. It notes how it is used."""

    def __init__(self):
        self.resets = 0
        self.batches = []

    def reset(self):
        self.resets += 1

    def select_action(self, batch):
        self.batches.append(batch)
        return torch.zeros(len(batch["observation.state"]), 5)


class ScriptedExpert:
    """The scripted expert of the task that the batch names, behind a policy's interface."""

    def __init__(self):
        self.experts = {}
        for task in TASKS:
            env = gym.make(f"surrol/{task}-v0")
            self.experts[env.unwrapped.task_description] = surrol_gym.make_expert(env)
            env.close()
        self.step = 0

    def reset(self):
        self.step = 0

    def select_action(self, batch):
        self.step += 1
        keys = ("observation.state", "observation.achieved_goal", "observation.goal")
        rows = zip(batch["task"], *(batch[key].numpy() for key in keys), strict=True)
        return torch.from_numpy(np.stack([self.act(*row) for row in rows]))

    def act(self, sentence, state, achieved, desired):
        observation = {"observation": state, "achieved_goal": achieved, "desired_goal": desired}
        return self.experts[sentence].act(observation)


class ReachesAndLeaves(ScriptedExpert):
    """Follows the expert for 40 steps, then moves straight up."""

    def act(self, *row):
        return super().act(*row) if self.step <= 40 else np.array([0, 0, 1, 0, 0], dtype=np.float32)


@pytest.fixture(scope="module")
def of_the_expert():
    """The expert's episodes, all tasks, three seeds in one batch."""
    return evaluate(ScriptedExpert(), TASKS, [100, 101, 102])


# Rows.


def test_a_row_an_episode_in_the_order_of_tasks_and_seeds(of_the_expert):
    columns = ["task", "seed", "reached", "held", "steps", "achieved_goal", "desired_goal"]
    assert list(of_the_expert.columns) == columns
    assert list(zip(of_the_expert.task, of_the_expert.seed, strict=True)) == [
        (task, seed) for task in TASKS for seed in (100, 101, 102)
    ]


def test_the_expert_reaches_and_holds_the_goal(of_the_expert):
    assert of_the_expert.reached.all()
    assert of_the_expert.held.all()


def test_a_policy_that_does_nothing_never_succeeds():
    episodes = evaluate(Zeros(), TASKS[:2], [0])
    assert not episodes.reached.any()
    assert not episodes.held.any()
    assert episodes.steps.isna().all()


def test_a_goal_that_is_left_again_was_reached_but_not_held():
    episodes = evaluate(ReachesAndLeaves(), ["NeedleReach"], [0, 1])
    assert episodes.reached.all()
    assert not episodes.held.any()


def test_steps_count_to_the_first_success(needle_pick_root):
    recorded = json.loads((needle_pick_root / "meta" / "surrol.json").read_text())
    episodes = evaluate(ScriptedExpert(), ["NeedlePick"], recorded["seeds"])
    assert episodes.steps.tolist() == recorded["steps_to_success"]


def test_the_goals_of_a_row_are_those_at_the_end(of_the_expert):
    left = evaluate(ReachesAndLeaves(), ["NeedleReach"], [100])
    for row in [*of_the_expert.itertuples(), *left.itertuples()]:
        env = gym.make(f"surrol/{row.task}-v0")
        observation, _ = env.reset(seed=row.seed)
        np.testing.assert_array_equal(row.desired_goal, observation["desired_goal"])
        assert env.unwrapped.is_success(row.achieved_goal, row.desired_goal) == row.held
        env.close()


def test_steps_are_missing_exactly_where_the_goal_was_not_reached(of_the_expert):
    episodes = pd.concat([of_the_expert, evaluate(Zeros(), ["NeedleReach"], [0])])
    assert (episodes.steps.isna() == ~episodes.reached).all()


# Seeds and batches.


def test_a_seed_gives_the_same_row_whatever_else_is_evaluated(of_the_expert):
    alone = evaluate(ScriptedExpert(), ["NeedlePick"], [101])
    wanted = of_the_expert[(of_the_expert.task == "NeedlePick") & (of_the_expert.seed == 101)]
    pd.testing.assert_frame_equal(alone, wanted.reset_index(drop=True))


def test_the_order_of_the_seeds_changes_nothing_but_the_order_of_the_rows(of_the_expert):
    shuffled = evaluate(ScriptedExpert(), TASKS[::-1], [102, 100, 101])
    pd.testing.assert_frame_equal(
        shuffled.sort_values(["task", "seed"], ignore_index=True),
        of_the_expert.sort_values(["task", "seed"], ignore_index=True),
    )


def test_the_batch_size_does_not_change_the_outcome(of_the_expert):
    pd.testing.assert_frame_equal(evaluate(ScriptedExpert(), TASKS, [100, 101, 102], batch_size=2), of_the_expert)


def test_the_seeds_are_those_of_the_environments_resets():
    policy = Zeros()
    evaluate(policy, ["NeedlePick"], [7])
    env = gym.make("surrol/NeedlePick-v0")
    observation, _ = env.reset(seed=7)
    env.close()
    seen = policy.batches[0]
    np.testing.assert_array_equal(seen["observation.state"][0], observation["observation"])
    np.testing.assert_array_equal(seen["observation.goal"][0], observation["desired_goal"])


def test_seeds_may_come_from_a_generator():
    assert evaluate(Zeros(), (task for task in ["NeedleReach"]), iter(range(2))).seed.tolist() == [0, 1]


def test_the_policy_is_reset_before_every_batch():
    policy = Zeros()
    evaluate(policy, ["NeedleReach"], [0, 1, 2], batch_size=2)
    assert policy.resets == 2


def test_every_episode_runs_to_its_time_limit():
    policy = Zeros()
    evaluate(policy, ["NeedleReach"], [0])
    assert len(policy.batches) == gym.spec("surrol/NeedleReach-v0").max_episode_steps


def test_policies_see_the_keys_of_the_dataset(needle_pick_meta):
    policy = Zeros()
    evaluate(policy, ["NeedlePick"], [0, 1])
    expected = {key for key in needle_pick_meta.features if key.startswith("observation.")}
    assert set(policy.batches[0]) == expected - {"observation.time_to_goal"} | {"task"}
    assert policy.batches[0]["task"] == list(needle_pick_meta.tasks.index) * 2


# Imperfect sensors and noisy actions.


def test_the_policy_sees_what_the_sensors_show():
    policy = Zeros()
    evaluate(policy, ["NeedlePick"], [7, 8], sensors={"position_std": 0.01, "delay": 1})
    with gym.make("surrol/NeedlePick-v0") as env:
        shown, _ = ImperfectSensors(env, position_std=0.01, delay=1).reset(seed=8)
    for batch in policy.batches[:2]:  # the first reading is shown twice
        np.testing.assert_array_equal(batch["observation.state"][1], shown["observation"])


def test_rows_are_judged_by_the_truth_and_tell_the_sensors():
    blind, perfect = (evaluate(Zeros(), ["NeedlePick"], [7], sensors=sensors) for sensors in ({"angle_std": 1.0}, {}))
    pd.testing.assert_frame_equal(blind[perfect.columns], perfect)
    assert blind.iloc[0, len(perfect.columns) :].to_dict() == {
        "position_std": 0,
        "angle_std": 1,
        "dropout": 0,
        "delay": 0,
        "action_std": 0,
    }


def test_noise_does_not_depend_on_what_runs_beside():
    sensors = {"position_std": 0.01, "angle_std": 0.1}
    together, alone = (evaluate(ScriptedExpert(), ["NeedlePick"], seeds, sensors=sensors) for seeds in ([3, 4], [4]))
    pd.testing.assert_frame_equal(together[1:].reset_index(drop=True), alone)


def test_the_expert_fails_where_it_sees_badly():
    episodes = evaluate(ScriptedExpert(), ["NeedlePick"], [100, 101, 102], sensors={"position_std": 0.1})
    assert not episodes.held.all()


def test_actions_are_as_noisy_as_is_asked_for():
    still, moved = (
        evaluate(Zeros(), ["NeedleReach"], [7], sensors=sensors).achieved_goal[0] for sensors in ({}, {"action_std": 1})
    )
    with gym.make("surrol/NeedleReach-v0") as env:
        noisy = NoisyActions(env, action_std=1)
        noisy.reset(seed=7)
        for _ in range(env.spec.max_episode_steps):
            observation, *_ = noisy.step(np.zeros(5, dtype=np.float32))
    np.testing.assert_array_equal(moved, observation["achieved_goal"])
    assert np.linalg.norm(np.subtract(moved, still)) > 0.01


# Bad input.


def test_an_unknown_task_is_an_error_that_names_it_and_the_known_ones():
    policy = Zeros()
    with pytest.raises(ValueError, match=f"NeedleThread.*{', '.join(surrol_gym.TASKS)}"):
        evaluate(policy, ["NeedleReach", "NeedleThread"], [0])
    assert not policy.batches


def test_no_seeds_is_an_error():
    with pytest.raises(ValueError, match="seeds"):
        evaluate(Zeros(), ["NeedleReach"], [])


@pytest.mark.parametrize("batch_size", [0, -1])
def test_a_batch_of_nothing_is_an_error(batch_size):
    with pytest.raises(ValueError, match="batch_size"):
        evaluate(Zeros(), ["NeedleReach"], [0], batch_size)


def test_an_error_of_the_policy_comes_through():
    class Broken(Zeros):
        def select_action(self, batch):
            raise KeyError("no such task")

    with pytest.raises(KeyError, match="no such task"):
        evaluate(Broken(), ["NeedleReach"], [0])
