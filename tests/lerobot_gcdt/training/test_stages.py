"""Every stage starts from the weights of the one before it; bad requests are told before anything is written."""

import json
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest
from safetensors.torch import load_file

from lerobot_gcdt import training
from lerobot_gcdt.training import checkpoint, recipes, trainer
from lerobot_gcdt.training.recipes import RECIPES

# Stages.


@pytest.mark.parametrize(("first", "second"), [("pretrain", "generalist"), ("generalist", "finetune")])
def test_a_stage_starts_from_the_weights_of_the_one_before_it(trained, first, second):
    before, after = (load_file(checkpoint(trained / stage) / "model.safetensors") for stage in (first, second))
    assert before.keys() == after.keys()
    assert after.pop("training_step") > before.pop("training_step")
    assert all((before[key] - after[key]).abs().max() < 1e-6 for key in before)
    objectives = json.loads((checkpoint(trained / second) / "config.json").read_text())["training_stage"]
    assert objectives == "finetune", "only pretraining has all objectives"


def test_a_policy_from_scratch_gets_the_arguments_of_the_quickstart(needle_pick_root, tmp_path, asked, capsys):
    training.train(needle_pick_root, tmp_path / "new", steps=1000, device="cpu")
    assert asked == [
        [
            *("--policy.type=gcdt", "--policy.push_to_hub=false", "--dataset.repo_id=local/needle_pick"),
            *("--batch_size=2", "--save_freq=500", "--log_freq=12", "--num_workers=0", "--policy.device=cpu"),
            *(f"--dataset.root={needle_pick_root}", "--steps=1000", f"--output_dir={tmp_path}/new"),
        ]
    ]
    assert capsys.readouterr().out.startswith("lerobot-train \\\n  --policy.type=gcdt \\\n")


@pytest.mark.parametrize(
    ("policy", "options", "told"),
    [
        ("bc", {}, {"--policy.type=bc", "--steps=24000", "--batch_size=4"}),
        ("vinn", {}, {"--policy.type=vinn", "--steps=1"}),
        ("act", {"steps": 9, "options": ["--policy.chunk_size=5"]}, {"--policy.type=act", "--policy.chunk_size=5"}),
    ],
)
def test_other_policies_have_their_own_settings(needle_pick_root, tmp_path, asked, policy, options, told):
    training.train(needle_pick_root, tmp_path / "new", policy, **options)
    assert told <= set(asked[0])


@pytest.mark.parametrize(("policy", "stage"), RECIPES)
def test_lerobots_trainer_takes_every_recipe(policy, stage):
    options = RECIPES[policy, stage].options
    trainer.check_options([f"--policy.type={policy}", "--policy.push_to_hub=false", "--dataset.repo_id=any", *options])


# Bad input.


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"policy": "gdct", "steps": 5}, "Unknown policy type 'gdct'; choose one of act, bc"),
        ({"policy": "vqbet"}, "type vqbet .* --steps"),
        ({"policy": "bc", "stage": "pretrain"}, "type bc has no stage 'pretrain'; choose one of finetune, scratch"),
        ({"stage": "tuning"}, "no stage 'tuning'; choose one of pretrain, generalist, finetune, scratch"),
        ({"stage": "generalist"}, "add --start"),
        ({"stage": "scratch", "start": "pretrain"}, "leave out --start"),
        ({"policy": "bc", "start": "pretrain"}, "type gcdt, not bc"),
        ({"steps": 0}, "positive, got 0"),
        ({"options": ["--steps=5"]}, "--steps=5 of lerobot-train is set by gcdt; say it with --steps"),
        ({"options": ["--output_dir", "elsewhere"]}, "--output_dir .* say it with --output"),
        ({"options": ["--dataset.root=mine"]}, "--dataset.root=mine .* say it with --dataset"),
        ({"device": "gpu"}, "Unknown device gpu. Supported devices are: cuda, mps, xpu or cpu."),
        ({"options": ["--policy.device=gpu"]}, "Unknown device gpu"),
        ({"options": ["--policy.path=mine"]}, "--policy.path=mine .* say it with --start"),
    ],
    ids=lambda value: "-".join(map(str, value.values())) if isinstance(value, dict) else "",
)
def test_a_bad_request_is_told_before_anything_is_written(trained, needle_pick_root, tmp_path, asked, options, told):
    if "start" in options:
        options = options | {"start": trained / options["start"]}
    with pytest.raises(ValueError, match=told):
        training.train(needle_pick_root, tmp_path / "new", **options)
    assert not asked and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (lambda file: file.write_bytes(file.read_bytes()[:-100]), r"file-000.parquet cannot be read"),
        (lambda file: file.unlink(), "data holds 0 rows, but meta/info.json says total_frames = 200"),
    ],
    ids=["truncated", "missing"],
)
def test_half_of_a_dataset_is_told_before_anything_is_written(needle_pick_root, tmp_path, asked, damage, told):
    shutil.copytree(needle_pick_root, half := tmp_path / "half")
    damage(next(half.glob("data/*/*.parquet")))
    with pytest.raises(ValueError, match=told):
        training.train(half, tmp_path / "new")
    assert not asked and not (tmp_path / "new").exists()


def test_a_value_may_read_like_an_option_that_is_set_here(needle_pick_root, tmp_path, asked):
    training.train(needle_pick_root, tmp_path / "new", options=["--job_name", "steps"])
    assert "steps" in asked[0]


def test_a_package_that_a_policy_needs_is_named_before_anything_is_written(
    needle_pick_root, tmp_path, asked, monkeypatch
):
    monkeypatch.setattr(recipes, "find_spec", lambda package: None)
    with pytest.raises(ValueError, match=r"diffusion needs diffusers, .* `pip install 'lerobot\[diffusion\]'`"):
        training.train(needle_pick_root, tmp_path / "new", "diffusion")
    assert not asked and not list(tmp_path.iterdir())


# Launchers.


def test_a_launched_trainer_keeps_others_out_even_if_its_command_was_killed(
    needle_pick_root, tmp_path, asked, monkeypatch
):
    refused = []

    def begin_again(arguments, losses, stage):
        with pytest.raises(OSError, match="at work in .*new.trainer; wait for its end") as error:
            training.train(needle_pick_root, tmp_path / "new")
        refused.append(error)

    monkeypatch.setattr(sys, "argv", ["trainer", str(tmp_path / "new/loss.csv"), "scratch"])
    with monkeypatch.context() as launched:
        launched.setattr(trainer, "run", begin_again)
        trainer.main()
    assert refused and not asked
    training.train(needle_pick_root, tmp_path / "new")
    assert len(asked) == 1 and not (tmp_path / "new.trainer").exists()


def test_a_launcher_runs_the_same_trainer(needle_pick_root, tmp_path, asked, monkeypatch):
    monkeypatch.delenv("OMP_WAIT_POLICY", raising=False)
    launched = []
    failed = SimpleNamespace(returncode=3)
    monkeypatch.setattr(subprocess, "run", lambda command, env: launched.append((command, env)) or failed)
    training.train(needle_pick_root, tmp_path / "new")
    with pytest.raises(RuntimeError, match="num_processes=4 -m ended with status 3"):
        training.train(needle_pick_root, tmp_path / "new", launcher="accelerate launch --num_processes=4 -m")
    [(command, environment)] = launched
    launcher = ["accelerate", "launch", "--num_processes=4", "-m"]
    assert command == [*launcher, trainer.__name__, str(tmp_path / "new/loss.csv"), "scratch", *asked[0]]
    assert environment["OMP_WAIT_POLICY"] == "passive"
