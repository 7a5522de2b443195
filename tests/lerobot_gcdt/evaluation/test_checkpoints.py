"""Evaluating checkpoints: the tasks that a policy knows, on the seeds that were asked for, once."""

from functools import partial

import pandas as pd
import pytest
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from lerobot.policies.act.processor_act import make_act_pre_post_processors
from safetensors.torch import load_file, save_file

from lerobot_gcdt import GCDTPolicy, make_gcdt_pre_post_processors
from lerobot_gcdt.evaluation import evaluate_checkpoint, rollout
from lerobot_gcdt.evaluation.tasks import tasks_of


@pytest.fixture
def checkpoint(tmp_path, tiny_config, uneven_meta):
    """A policy of NeedleReach and NeedlePick that learned nothing."""
    policy = GCDTPolicy(tiny_config, dataset_meta=uneven_meta)
    for part in (policy, *make_gcdt_pre_post_processors(policy.config)):
        part.save_pretrained(tmp_path / "000001/pretrained_model")
    return tmp_path / "000001/pretrained_model"


@pytest.fixture
def checkpoint_of_act(tmp_path):
    """The same of ACT, which does not say what tasks it knows."""
    config = ACTConfig(
        input_features={
            "observation.state": PolicyFeature(FeatureType.STATE, (7,)),
            "observation.environment_state": PolicyFeature(FeatureType.ENV, (3,)),
        },
        output_features={"action": PolicyFeature(FeatureType.ACTION, (5,))},
        **{"dim_model": 16, "n_heads": 2, "dim_feedforward": 16, "chunk_size": 5, "n_action_steps": 5},
        **{"pretrained_backbone_weights": None, "device": "cpu", "push_to_hub": False},
    )
    for part in (ACTPolicy(config), *make_act_pre_post_processors(config)):
        part.save_pretrained(tmp_path / "000002/pretrained_model")
    return tmp_path / "000002/pretrained_model"


def starts(episodes: pd.DataFrame) -> list[tuple[str, int]]:
    return list(zip(episodes.task, episodes.seed, strict=True))


def kept(checkpoint) -> pd.DataFrame:
    return pd.read_parquet(checkpoint.parent / "episodes.parquet")


def test_a_policy_is_evaluated_once_on_the_tasks_that_it_knows(checkpoint):
    first = evaluate_checkpoint(checkpoint, ["NeedleReach", "BiPegBoard"], range(7, 9))
    assert starts(first) == [("NeedleReach", 7), ("NeedleReach", 8)]
    written = (checkpoint.parent / "episodes.parquet").stat().st_mtime_ns
    again = evaluate_checkpoint(checkpoint, ["NeedleReach"], range(7, 9))
    pd.testing.assert_frame_equal(again, kept(checkpoint))
    assert starts(again) == starts(first)
    assert (checkpoint.parent / "episodes.parquet").stat().st_mtime_ns == written


def test_other_seeds_add_episodes_and_remove_none(checkpoint):
    evaluate_checkpoint(checkpoint, ["NeedleReach"], range(100, 103))
    asked = evaluate_checkpoint(checkpoint, ["NeedleReach"], [8, 102])
    assert asked.seed.tolist() == [8, 102]
    assert kept(checkpoint).seed.tolist() == [100, 101, 102, 8]


def test_the_other_tasks_that_it_knows_add_episodes_and_remove_none(checkpoint):
    evaluate_checkpoint(checkpoint, ["NeedlePick"], [3])
    assert starts(evaluate_checkpoint(checkpoint, seeds=[3])) == [("NeedleReach", 3), ("NeedlePick", 3)]
    assert starts(kept(checkpoint)) == [("NeedlePick", 3), ("NeedleReach", 3)]


def test_an_interrupted_evaluation_goes_on_after_its_last_batch(checkpoint, monkeypatch):
    whole = rollout.rollout
    batches = []

    def interrupted(policy, task, seeds, **options):
        batches.append(seeds)
        if len(batches) == 2:
            raise KeyboardInterrupt
        return whole(policy, task, seeds, **options)

    monkeypatch.setattr(rollout, "rollout", interrupted)
    with pytest.raises(KeyboardInterrupt):
        evaluate_checkpoint(checkpoint, ["NeedleReach"], range(4), batch_size=2)
    assert kept(checkpoint).seed.tolist() == [0, 1]
    assert evaluate_checkpoint(checkpoint, ["NeedleReach"], range(4), batch_size=2).seed.tolist() == [0, 1, 2, 3]
    assert batches == [[0, 1], [2, 3], [2, 3]]


def test_a_policy_that_does_not_say_what_it_knows_needs_tasks(checkpoint_of_act):
    with pytest.raises(ValueError, match="type act, .* add --tasks"):
        tasks_of(checkpoint_of_act)
    assert starts(evaluate_checkpoint(checkpoint_of_act, ["NeedleReach"], [3])) == [("NeedleReach", 3)]


@pytest.mark.parametrize(
    ("tasks", "seeds", "told"),
    [
        (["NeedleSew"], [0], "NeedleSew.*; choose one of NeedleReach"),
        (["BiPegBoard"], [0], "but none of BiPegBoard"),
        (None, [], "seeds"),
        (None, [-1], "-1"),
    ],
    ids=["unknown task", "another task", "no seeds", "negative seed"],
)
def test_a_bad_request_is_told_before_anything_is_evaluated(checkpoint, tasks, seeds, told):
    with pytest.raises(ValueError, match=told):
        evaluate_checkpoint(checkpoint, tasks, seeds)
    assert [file.name for file in checkpoint.parent.iterdir()] == ["pretrained_model"]


def test_episodes_are_kept_beside_checkpoints_of_trainings_only(checkpoint):
    bare = checkpoint.rename(checkpoint.with_name("downloaded"))
    with pytest.raises(ValueError, match="downloaded is no folder pretrained_model"):
        evaluate_checkpoint(bare, seeds=[0])


def test_episodes_of_any_policy_are_kept_in_the_file_that_is_named(checkpoint, tmp_path):
    policy = checkpoint.rename(tmp_path / "policy")
    with pytest.raises(ValueError, match="policy is no folder pretrained_model.*--episodes"):
        evaluate_checkpoint(policy, ["NeedleReach"], [7])
    episodes = evaluate_checkpoint(policy, ["NeedleReach"], [7], file=tmp_path / "results/mine.parquet")
    pd.testing.assert_frame_equal(episodes, pd.read_parquet(tmp_path / "results/mine.parquet"))


def test_a_file_keeps_the_episodes_of_one_policy(checkpoint, tmp_path):
    file = tmp_path / "mine.parquet"
    evaluate_checkpoint(checkpoint, ["NeedleReach"], [7], file=file)
    weights = load_file(checkpoint / "model.safetensors")
    save_file(weights | {"training_step": weights["training_step"] + 1}, checkpoint / "model.safetensors")
    with pytest.raises(ValueError, match="mine.parquet keeps episodes of the policy .* name another file with --episo"):
        evaluate_checkpoint(checkpoint, ["NeedleReach"], [7], file=file)
    pd.read_parquet(file).drop(columns="policy").to_parquet(file)  # as earlier versions did
    episodes = evaluate_checkpoint(checkpoint, ["NeedleReach"], [7, 8], file=file)
    assert episodes.seed.tolist() == [7, 8] and episodes.policy.notna().tolist() == [False, True]


def test_a_file_of_another_kind_is_named_and_kept(checkpoint, tmp_path):
    text, table = tmp_path / "text.parquet", tmp_path / "table.parquet"
    text.write_text("ten years of work")
    pd.DataFrame({"year": [1]}).to_parquet(table)
    for file, told in ((text, "no Parquet file"), (table, "keeps year, but no episodes")):
        before = file.read_bytes()
        with pytest.raises(ValueError, match=rf"{file} (is )?{told}"):
            evaluate_checkpoint(checkpoint, ["NeedleReach"], range(1), file=file)
        assert file.read_bytes() == before


def test_a_task_that_is_named_twice_counts_once(checkpoint):
    episodes = evaluate_checkpoint(checkpoint, ["NeedleReach", "surrol/NeedleReach-v0"], [7])
    assert starts(episodes) == [("NeedleReach", 7)]


def test_a_file_keeps_the_episodes_of_one_kind_of_sensors(checkpoint, tmp_path):
    noisy = {"position_std": 0.01, "delay": 1}
    evaluated = partial(evaluate_checkpoint, checkpoint, ["NeedleReach"], [7])
    evaluated(file=tmp_path / "noisy.parquet", sensors=noisy)
    assert evaluated(file=tmp_path / "noisy.parquet", sensors=noisy).position_std.tolist() == [0.01]
    for sensors in (None, {"position_std": 0.01}):
        with pytest.raises(
            ValueError, match="noisy.parquet is not for episodes of sensors with .* delay 0, action_std 0"
        ):
            evaluated(file=tmp_path / "noisy.parquet", sensors=sensors)
    evaluated(file=tmp_path / "perfect.parquet")
    with pytest.raises(ValueError, match="perfect.parquet is not for episodes of sensors with position_std 0.01"):
        evaluated(file=tmp_path / "perfect.parquet", sensors=noisy)


def test_a_file_keeps_the_episodes_of_one_noise_of_actions(checkpoint, tmp_path):
    evaluated = partial(evaluate_checkpoint, checkpoint, ["NeedleReach"], [7], file=tmp_path / "noisy.parquet")
    assert evaluated(sensors={"action_std": 0.1}).action_std.tolist() == [0.1]
    with pytest.raises(ValueError, match="not for episodes of sensors with .* action_std 0.2"):
        evaluated(sensors={"action_std": 0.2})


def test_a_file_from_before_there_was_noise_of_actions_is_of_exact_ones(checkpoint, tmp_path):
    evaluated = partial(evaluate_checkpoint, checkpoint, ["NeedleReach"], file=tmp_path / "late.parquet")
    evaluated([7], sensors={"delay": 1})
    before = pd.read_parquet(tmp_path / "late.parquet").drop(columns="action_std")
    before.to_parquet(tmp_path / "late.parquet")
    assert evaluated([7, 8], sensors={"delay": 1}).seed.tolist() == [7, 8]
    with pytest.raises(ValueError, match="late.parquet is not for episodes of sensors with .* action_std 0.1"):
        evaluated([7], sensors={"delay": 1, "action_std": 0.1})


def test_episodes_beside_a_checkpoint_are_of_perfect_sensors(checkpoint):
    for file in (None, checkpoint.parent / "episodes.parquet"):
        with pytest.raises(ValueError, match="episodes.parquet is not for episodes of sensors with .* --episodes"):
            evaluate_checkpoint(checkpoint, ["NeedleReach"], [7], file=file, sensors={"dropout": 0.1})
    assert [file.name for file in checkpoint.parent.iterdir()] == ["pretrained_model"]


def test_bad_sensors_are_told_before_anything_is_kept(checkpoint, tmp_path):
    with pytest.raises(ValueError, match="dropout .* got 2"):
        evaluate_checkpoint(checkpoint, ["NeedleReach"], [7], file=tmp_path / "x.parquet", sensors={"dropout": 2})
    assert not (tmp_path / "x.parquet").exists()
