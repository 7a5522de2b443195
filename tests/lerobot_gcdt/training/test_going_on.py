"""A training goes on where it was interrupted, in the folder that is its own."""

import json
import shutil
import sys

import pytest

from lerobot_gcdt import training
from lerobot_gcdt.policy.objectives import OBJECTIVES
from lerobot_gcdt.training import checkpoint, loss_curve, trainer


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


def test_a_training_that_goes_on_finds_its_plugin(uneven_root, train, tiny, tmp_path, monkeypatch):
    (tmp_path / "my_objective").mkdir()
    (tmp_path / "my_objective/__init__.py").write_text(
        "from lerobot_gcdt.policy.objectives import register_objective, time_to_goal_loss\n"
        "register_objective('mine', time_to_goal_loss, lambda dims, width: {})\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    options = [*tiny, "--policy.discover_packages_path=my_objective", '--policy.objectives={"mine": 0.1}']
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


def test_the_settings_of_its_beginning_and_of_what_it_writes_go_on(trained, uneven_root, tiny, asked):
    options = [*tiny, "--batch_size", "4", "--policy.optimizer_lr=0.000000000001", "--save_freq=7"]
    training.train(uneven_root, trained / "pretrain", stage="pretrain", steps=3, device="cpu", options=options)
    assert {*options} < {*asked[0]}
