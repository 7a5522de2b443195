"""LeRobot's own tools and policies work on our datasets and in our environments as they are."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from lerobot.scripts import lerobot_dataset_viz, lerobot_edit_dataset, lerobot_eval

from lerobot_gcdt import SurRoLEnvConfig, evaluation
from lerobot_gcdt.evaluation import load_policy
from lerobot_gcdt.recording import record
from lerobot_gcdt.recording.features import Extras

ON_CPU = ["--policy.device=cpu", "--policy.push_to_hub=false"]
SMALL = {
    "act": [
        *("dim_model=32", "n_heads=2", "dim_feedforward=32", "n_encoder_layers=1", "n_vae_encoder_layers=1"),
        *("chunk_size=5", "n_action_steps=5", "pretrained_backbone_weights=null"),
    ],
    "diffusion": ["down_dims=[16,32]", "n_groups=4", "diffusion_step_embed_dim=16", "num_inference_steps=2"],
}
"""Options that make LeRobot's policies small and quick; none is about features."""


def dataset(root: Path) -> list[str]:
    return [f"--dataset.repo_id=local/{root.name}", f"--dataset.root={root}"]


@pytest.fixture(scope="module")
def disturbed_root(tmp_path_factory):
    """Folder of a NeedlePick dataset of four episodes with pushes, as the published ones have."""
    return record("NeedlePick", 4, 0, tmp_path_factory.mktemp("disturbed") / "disturbed", 0.3)


@pytest.fixture(scope="module")
def rich_root(tmp_path_factory):
    """Folder of a NeedlePick dataset of two episodes with films and the fields of Open-H-Embodiment."""
    extras = Extras(["openh"], ["overview", "closeup"], 64)
    return record("NeedlePick", 2, 0, tmp_path_factory.mktemp("rich") / "rich", 0.3, extras)


@pytest.fixture
def edit(command):
    """Runs ``lerobot-edit-dataset`` in this process."""
    return lambda *arguments: command(lerobot_edit_dataset.main, *arguments)


@pytest.fixture(params=["disturbed_root", "rich_root"], ids=["numbers", "numbers and films"])
def root(request):
    """A dataset of numbers only, and one with films."""
    return request.getfixturevalue(request.param)


# Policies.


@pytest.fixture(scope="module", params=SMALL)
def model(request, disturbed_root, tmp_path_factory, train):
    """Folder of a checkpoint of each of LeRobot's own policies, of two steps."""
    if request.param == "diffusion":
        pytest.importorskip("diffusers", reason="comes with lerobot[diffusion]")
    output = tmp_path_factory.mktemp(request.param) / "training"
    train(
        *(f"--policy.type={request.param}", *(f"--policy.{option}" for option in SMALL[request.param]), *ON_CPU),
        *(*dataset(disturbed_root), "--batch_size=4", "--num_workers=0", "--steps=2", f"--output_dir={output}"),
    )
    return output / "checkpoints" / "last" / "pretrained_model"


@pytest.fixture(scope="module")
def model_of_pictures(rich_root, tmp_path_factory, train):
    """Folder of a checkpoint of ACT that looks at two cameras, of one step."""
    output = tmp_path_factory.mktemp("pictures") / "training"
    train(
        *("--policy.type=act", *(f"--policy.{option}" for option in SMALL["act"]), *ON_CPU, *dataset(rich_root)),
        *("--dataset.video_backend=pyav", "--batch_size=2", "--num_workers=0", "--steps=1", f"--output_dir={output}"),
    )
    return output / "checkpoints" / "last" / "pretrained_model"


def test_lerobots_own_policies_train_on_a_dataset_and_are_evaluated(model, tmp_path, evaluate):
    config = PreTrainedConfig.from_pretrained(model)
    assert {"observation.state", "observation.environment_state"} <= set(config.input_features)
    assert set(config.output_features) == {"action"}
    evaluate(
        *(f"--policy.path={model}", "--policy.device=cpu", "--env.type=surrol", "--env.task=NeedlePick-v0"),
        *("--env.width=64", "--env.height=64", "--eval.n_episodes=1", "--eval.batch_size=1"),
        *("--eval.use_async_envs=false", f"--output_dir={tmp_path / 'evaluation'}"),
    )
    overall = json.loads((tmp_path / "evaluation" / "eval_info.json").read_text())["overall"]
    assert overall["n_episodes"] == 1
    assert overall["pc_success"] in (0, 100)


def bare(model: Path):
    """A policy without its processors."""
    config = PreTrainedConfig.from_pretrained(model)
    return get_policy_class(config.type).from_pretrained(model, config=config)


def lerobots_actions(model: Path, seeds: list[int], **pictures) -> np.ndarray:
    """The actions of LeRobot's own rollout, shape (T, B, A)."""
    policy, config = bare(model), SurRoLEnvConfig(task="NeedlePick-v0", **pictures)
    envs = config.create_envs(len(seeds))["NeedlePick-v0"][0]
    processors = make_pre_post_processors(policy.config, pretrained_path=str(model))
    torch.manual_seed(0)
    episodes = lerobot_eval.rollout(envs, policy, *config.get_env_processors(), *processors, seeds=seeds)
    envs.close()
    return episodes["action"].numpy().swapaxes(0, 1)


def our_actions(model: Path, seeds: list[int], monkeypatch) -> np.ndarray:
    """The actions that our own evaluation executes, shape (T, B, A)."""
    step, actions = gym.vector.SyncVectorEnv.step, []
    monkeypatch.setattr(gym.vector.SyncVectorEnv, "step", lambda envs, a: (actions.append(a), step(envs, a))[1])
    policy = load_policy(model)
    torch.manual_seed(0)
    evaluation.evaluate(policy, ["NeedlePick"], seeds)
    return np.stack(actions)


def test_our_evaluation_executes_the_actions_of_lerobots(model, monkeypatch):
    theirs = lerobots_actions(model, [7, 8])
    np.testing.assert_array_equal(our_actions(model, [7, 8], monkeypatch), theirs)


def test_a_policy_without_its_processors_is_refused_with_the_way_out(model):
    with pytest.raises(ValueError, match=r"(ACT|Diffusion)Policy .*load_policy"):
        evaluation.evaluate(bare(model), ["NeedlePick"], [7])


def test_our_evaluation_shows_policies_the_pictures_that_lerobots_does(model_of_pictures, monkeypatch):
    theirs = lerobots_actions(model_of_pictures, [7], cameras="overview,closeup", camera_size=64)
    np.testing.assert_array_equal(our_actions(model_of_pictures, [7], monkeypatch), theirs)


def test_lerobots_own_policies_train_on_films_and_are_evaluated_on_pictures(model_of_pictures, tmp_path, evaluate):
    assert {"observation.images.overview", "observation.images.closeup"} <= set(
        PreTrainedConfig.from_pretrained(model_of_pictures).input_features
    )
    evaluate(
        *(f"--policy.path={model_of_pictures}", "--policy.device=cpu", "--env.type=surrol", "--env.task=NeedlePick-v0"),
        *("--env.cameras=overview,closeup", "--env.camera_size=64", "--eval.n_episodes=1", "--eval.batch_size=1"),
        *("--eval.use_async_envs=false", f"--output_dir={tmp_path / 'evaluation'}"),
    )
    assert json.loads((tmp_path / "evaluation" / "eval_info.json").read_text())["overall"]["n_episodes"] == 1


def test_a_share_of_the_episodes_is_held_out_of_the_training_of_lerobots_own_policies(
    disturbed_root, tmp_path, train, capfd
):
    train(
        *("--policy.type=act", *(f"--policy.{option}" for option in SMALL["act"]), *ON_CPU, *dataset(disturbed_root)),
        *("--dataset.eval_split=0.25", "--eval_steps=1", "--batch_size=4", "--num_workers=0", "--steps=1"),
        f"--output_dir={tmp_path / 'training'}",
    )
    assert "eval_loss=" in "".join(capfd.readouterr())


# Tools.


def frames(root: Path) -> dict[str, np.ndarray]:
    """The columns of the state and the action, over all frames."""
    table = pq.read_table(root / "data")
    return {key: np.stack(table[key].to_numpy()) for key in ("observation.state", "action", "disturbance")}


def test_lerobot_edit_dataset_describes_a_dataset(root, edit, capsys):
    edit("--repo_id=local/x", f"--root={root}", "--operation.type=info", "--operation.show_features=true")
    printed = capsys.readouterr().out
    recorded = json.loads((root / "meta" / "surrol.json").read_text())
    assert f"Total episode: {recorded['episodes']}" in printed
    assert "FPS: 5" in printed
    assert "disturbance" in printed


def test_lerobot_edit_dataset_splits_a_dataset_and_merges_the_parts(root, edit, tmp_path):
    edit(
        *("--repo_id=local/x", f"--root={root}", f"--new_root={tmp_path / 'parts'}", "--operation.type=split"),
        '--operation.splits={"early": 0.5, "late": 0.5}',
    )
    parts = [tmp_path / "parts" / name for name in ("early", "late")]
    whole = LeRobotDataset("local/x", root=root, video_backend="pyav")
    assert [LeRobotDataset("local/x", root=part).num_episodes for part in parts] == [whole.num_episodes // 2] * 2
    edit(
        *("--new_repo_id=local/merged", f"--new_root={tmp_path / 'merged'}", "--operation.type=merge"),
        *("--operation.repo_ids=['local/early','local/late']", f"--operation.roots={[str(part) for part in parts]}"),
    )
    merged = LeRobotDataset("local/merged", root=tmp_path / "merged", video_backend="pyav")
    assert merged.meta.camera_keys == whole.meta.camera_keys
    assert merged[len(merged) - 1]["task"] == whole[0]["task"]
    for key, values in frames(root).items():
        np.testing.assert_array_equal(frames(tmp_path / "merged")[key], values)


def test_lerobot_dataset_viz_shows_an_episode(root, command, tmp_path):
    pytest.importorskip("rerun", reason="comes with lerobot[viz]")
    command(
        lerobot_dataset_viz.main,
        *("--repo-id=local/x", f"--root={root}", "--episode-index=1", "--save=1", "--num-workers=0"),
        f"--output-dir={tmp_path}",
    )
    [shown] = tmp_path.glob("*.rrd")
    assert shown.stat().st_size > 10_000
