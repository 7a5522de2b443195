"""Trainings begin, go on, or are complete; every stage starts from the weights of the one before it."""

import json
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest
from safetensors.torch import load_file

from lerobot_gcdt import training
from lerobot_gcdt.policy.objectives import OBJECTIVES
from lerobot_gcdt.training import checkpoint, loss_curve, recipes, trainer
from lerobot_gcdt.training.recipes import RECIPES

TINY = ["--policy.layers=1", "--policy.width=16", "--policy.heads=2", "--policy.inner_width=16"]


@pytest.fixture(scope="session")
def train(command):
    """Trains in this process."""
    return lambda *arguments, **options: command(lambda: training.train(*arguments, **options))


@pytest.fixture
def asked(monkeypatch):
    """The arguments of every call of `lerobot-train`, which is not run."""
    calls = []
    monkeypatch.setattr(trainer, "run", lambda arguments, losses, stage: calls.append(arguments))
    return calls


@pytest.fixture(scope="module")
def trained(uneven_root, needle_pick_root, train, tmp_path_factory):
    """Folder of three stages, one after the other, with a learning rate of next to nothing."""
    output = tmp_path_factory.mktemp("trained")
    slow = ["--policy.optimizer_lr=1e-12", "--policy.device=cpu"]
    train(uneven_root, output / "pretrain", stage="pretrain", steps=2, options=[*TINY, *slow])
    train(uneven_root, output / "generalist", stage="generalist", start=output / "pretrain", steps=1, options=slow)
    train(needle_pick_root, output / "finetune", start=output / "generalist", steps=1, options=slow)
    return output


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


# Going on.


def test_a_complete_training_is_not_repeated(trained, uneven_root, asked, capsys):
    last = training.train(uneven_root, trained / "pretrain", stage="pretrain", steps=2)
    assert last == checkpoint(trained / "pretrain")
    assert "pretrain is complete already" in capsys.readouterr().out
    assert not asked


def test_what_a_policy_chose_itself_is_no_other_setting(needle_pick_root, train, tmp_path, capsys):
    options = ["--policy.neighbours=0", "--policy.temperature=0.0", "--policy.device=cpu"]
    for _ in range(2):
        train(needle_pick_root, tmp_path / "new", "vinn", options=options)
    assert "new is complete already" in capsys.readouterr().out


def test_a_training_goes_on_even_where_it_and_its_data_were_moved(trained, uneven_root, train, tmp_path):
    shutil.copytree(trained / "pretrain", tmp_path / "moved", symlinks=True)
    shutil.copytree(uneven_root, tmp_path / uneven_root.name)
    train(tmp_path / uneven_root.name, tmp_path / "moved", stage="pretrain", steps=3)
    assert checkpoint(tmp_path / "moved").resolve().parent.name == "000003"
    assert checkpoint(trained / "pretrain").resolve().parent.name == "000002"
    curve = loss_curve(tmp_path / "moved")
    assert curve.step.tolist() == [1, 2, 3]
    assert 0 < curve.seconds[0] < curve.seconds[1] < curve.seconds[2]


def without_link(trained, folder):
    """A copy of a training of two steps, of which a checkpoint more was interrupted, that lost `checkpoints/last`."""
    shutil.copytree(trained / "pretrain", folder, symlinks=True)
    checkpoints = folder / "checkpoints"
    shutil.copytree(checkpoints / "000002", checkpoints / "000003")
    (checkpoints / "000003/training_state/scheduler_state.json").unlink()
    (checkpoints / "last").unlink()
    return folder


def test_a_training_without_the_link_to_its_last_checkpoint_goes_on_from_the_newest_whole_one(
    trained, uneven_root, asked, tmp_path
):
    output = without_link(trained, tmp_path / "copied")
    training.train(uneven_root, output, stage="pretrain", steps=4)
    assert f"--config_path={output}/checkpoints/last/pretrained_model/train_config.json" in asked[0]
    assert checkpoint(output).resolve().parent.name == "000002"


def test_a_checkpoint_without_a_scheduler_is_whole(trained, uneven_root, asked, tmp_path):
    output = without_link(trained, tmp_path / "copied")
    config = output / "checkpoints/000003/pretrained_model/train_config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | {"scheduler": None}))
    training.train(uneven_root, output, stage="pretrain", steps=4)
    assert checkpoint(output).resolve().parent.name == "000003"


def test_a_training_that_goes_on_finds_its_plugin(uneven_root, train, tmp_path, monkeypatch):
    (tmp_path / "my_objective").mkdir()
    (tmp_path / "my_objective/__init__.py").write_text(
        "from lerobot_gcdt.policy.objectives import register_objective, time_to_goal_loss\n"
        "register_objective('mine', time_to_goal_loss, lambda dims, width: {})\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    options = [*TINY, "--policy.discover_packages_path=my_objective", '--policy.objectives={"mine": 0.1}']
    for steps in (1, 2):
        train(uneven_root, tmp_path / "new", stage="pretrain", steps=steps, device="cpu", options=options)
        OBJECTIVES.pop("mine")
        sys.modules.pop("my_objective")
    assert checkpoint(tmp_path / "new").resolve().parent.name == "000002"


def test_checkpoints_that_no_training_can_go_on_with_are_not_removed(needle_pick_root, tmp_path, asked):
    for step in ("000500", "001000"):
        (tmp_path / "checkpoints" / step).mkdir(parents=True)
    with pytest.raises(ValueError, match="no checkpoint that lerobot-train could go on with; choose another --output"):
        training.train(needle_pick_root, tmp_path)
    assert (tmp_path / "checkpoints/000500").exists() and not asked


@pytest.mark.parametrize(("numbered", "remedy"), [(True, "rm -r .*/last"), (False, "mv .*/last .*/checkpoints/000002")])
def test_a_copy_of_the_last_checkpoint_in_place_of_the_link_is_told_with_the_way_out(
    trained, uneven_root, asked, tmp_path, numbered, remedy
):
    shutil.copytree(trained / "pretrain", output := tmp_path / "copied")
    if not numbered:
        shutil.rmtree(output / "checkpoints/000002")
    with pytest.raises(ValueError, match=f"last is a folder, where lerobot-train keeps a link; `{remedy}`"):
        training.train(uneven_root, output, stage="pretrain", steps=3)
    training.train(uneven_root, output, stage="pretrain", steps=2)  # which is complete
    assert not asked


def test_a_training_without_its_training_state_may_be_complete_and_cannot_go_on(
    trained, uneven_root, asked, tmp_path, capsys
):
    shutil.copytree(trained / "pretrain", output := tmp_path / "pruned", symlinks=True)
    shutil.rmtree(output / "checkpoints/000002/training_state")
    assert training.train(uneven_root, output, stage="pretrain", steps=2) == checkpoint(output)
    assert "pruned is complete already" in capsys.readouterr().out
    with pytest.raises(
        ValueError, match="last/training_state/.* is missing, .* to step 3; choose another --output, or "
    ):
        training.train(uneven_root, output, stage="pretrain", steps=3)
    assert checkpoint(output).exists() and not asked


def test_a_second_process_in_the_same_folder_is_refused(needle_pick_root, tmp_path, asked, at_work):
    output = tmp_path / "new"
    (output / "checkpoints/000500").mkdir(parents=True)
    at_work(tmp_path / "new.training")
    with pytest.raises(OSError, match="at work in .*new.training; wait for its end, or choose another --output"):
        training.train(needle_pick_root, output)
    assert (output / "checkpoints/000500").exists() and not asked


def test_nothing_is_left_beside_the_output_folder(needle_pick_root, tmp_path, monkeypatch):
    inside = []
    monkeypatch.setattr(trainer, "run", lambda *_: inside.extend(file.name for file in tmp_path.iterdir()))
    training.train(needle_pick_root, tmp_path / "new")
    assert inside == ["new.training"] and not list(tmp_path.iterdir())


def test_steps_that_were_repeated_count_once_in_the_loss_curve(tmp_path):
    (tmp_path / "loss.csv").write_text("step,loss\n1,0.5\n2,0.4\n3,0.35\n2,0.4\n3,0.3\n4,0.2\n")
    curve = loss_curve(tmp_path)
    assert curve.step.tolist() == [1, 2, 3, 4] and curve.loss.tolist() == [0.5, 0.4, 0.3, 0.2]


def test_what_ended_before_its_first_checkpoint_begins_anew(needle_pick_root, tmp_path, asked):
    output = tmp_path / "new"
    (output / "checkpoints/000500").mkdir(parents=True)
    (output / "loss.csv").write_text("step,loss\n12,0.5\n")
    for note in ("datasets.json", "beginning.json"):
        (output / note).write_text("{}")
    training.train(needle_pick_root, output)
    assert "--policy.type=gcdt" in asked[0]
    assert not output.exists()


@pytest.mark.parametrize("file", ["thesis.txt", "checkpoints/epoch_1.pt"])
def test_a_folder_with_something_else_is_left_alone(needle_pick_root, tmp_path, asked, file):
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text("ten years of work")
    with pytest.raises(ValueError, match="choose another --output"):
        training.train(needle_pick_root, tmp_path)
    assert (tmp_path / file).exists() and not asked


def test_the_folder_of_another_training_is_refused(trained, uneven_root, needle_pick_root, asked):
    for dataset, policy in ((uneven_root, "bc"), (needle_pick_root, "gcdt")):
        with pytest.raises(ValueError, match=f"of gcdt on local/uneven, not of {policy} on local/{dataset.name};"):
            training.train(dataset, trained / "pretrain", policy)
    assert not asked


def test_other_data_in_a_folder_of_the_same_name_are_refused(trained, uneven_root, needle_pick_root, asked, tmp_path):
    shutil.copytree(needle_pick_root, other := tmp_path / uneven_root.name)
    with pytest.raises(ValueError, match=f"on other data than those in {other}; choose another --output"):
        training.train(other, trained / "pretrain", stage="pretrain", steps=3)
    assert not asked


def test_data_that_replaced_others_in_place_are_refused(trained, uneven_root, needle_pick_root, asked, tmp_path):
    shutil.copytree(trained / "pretrain", output := tmp_path / "copied", symlinks=True)
    shutil.copytree(uneven_root, dataset := tmp_path / uneven_root.name)
    config = checkpoint(output) / "train_config.json"
    config.write_text(config.read_text().replace(str(uneven_root), str(dataset)))
    training.train(dataset, output, stage="pretrain", steps=3)
    shutil.rmtree(dataset)
    shutil.copytree(needle_pick_root, dataset)
    with pytest.raises(ValueError, match=f"on other data than those in {dataset}; choose another --output"):
        training.train(dataset, output, stage="pretrain", steps=3)
    assert len(asked) == 1
    (output / "datasets.json").unlink()  # as in a training of an earlier version
    training.train(dataset, output, stage="pretrain", steps=3)
    assert len(asked) == 2


@pytest.mark.parametrize("steps", [1, 2])
@pytest.mark.parametrize(
    ("folder", "stage", "start", "told"),
    [
        ("pretrain", "scratch", None, r"begun with --stage pretrain \(not scratch\); choose another --output"),
        ("finetune", None, None, r"begun with --stage finetune \(not scratch\)"),
        ("generalist", "finetune", "pretrain", r"begun with --stage generalist \(not finetune\)"),
        ("finetune", "finetune", "pretrain", "begun with other weights than those in .*pretrain.*; choose another"),
    ],
)
def test_another_stage_or_start_in_an_existing_folder_is_refused(
    trained, uneven_root, needle_pick_root, asked, folder, stage, start, told, steps
):
    dataset = needle_pick_root if folder == "finetune" else uneven_root
    with pytest.raises(ValueError, match=told):
        training.train(dataset, trained / folder, stage=stage, start=start and trained / start, steps=steps)
    assert not asked


def test_a_start_that_was_moved_is_the_same(trained, needle_pick_root, asked, tmp_path):
    shutil.copytree(checkpoint(trained / "generalist"), moved := tmp_path / "moved")
    training.train(needle_pick_root, trained / "finetune", start=moved, steps=2)
    assert len(asked) == 1


def test_a_training_of_an_earlier_version_goes_on_without_a_note_of_its_stage(trained, uneven_root, asked, tmp_path):
    shutil.copytree(trained / "pretrain", output := tmp_path / "copied", symlinks=True)
    (output / "beginning.json").unlink()
    training.train(uneven_root, output, steps=3)
    assert len(asked) == 1


@pytest.mark.parametrize("steps", [2, 3])
@pytest.mark.parametrize(
    ("option", "told"),
    [
        ("--policy.context_length=20", r"begun with policy.context_length=1 \(not 20\); leave .* or choose another"),
        ("--batch_size=0", r"batch_size=4 \(not 0\)"),
        ("--policy.contxt=7", "unrecognized arguments: --policy.contxt=7"),
    ],
)
def test_other_settings_in_an_existing_folder_are_refused(trained, uneven_root, asked, steps, option, told):
    with pytest.raises(ValueError, match=told):
        training.train(uneven_root, trained / "pretrain", stage="pretrain", steps=steps, options=[option])
    assert not asked


def test_the_settings_of_its_beginning_and_of_what_it_writes_go_on(trained, uneven_root, asked):
    options = [*TINY, "--batch_size", "4", "--policy.optimizer_lr=0.000000000001", "--save_freq=7"]
    training.train(uneven_root, trained / "pretrain", stage="pretrain", steps=3, device="cpu", options=options)
    assert {*options} < {*asked[0]}


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
