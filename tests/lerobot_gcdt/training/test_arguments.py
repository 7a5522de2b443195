"""Trainings begin, go on or are complete."""

from lerobot_gcdt.training import arguments_to_reach, checkpoint


def reached(output, step):
    folder = output / "checkpoints" / f"{step:06}"
    (folder / "pretrained_model").mkdir(parents=True)
    (output / "checkpoints/last").symlink_to(folder.name)


def test_a_new_training_begins(tmp_path):
    arguments = arguments_to_reach(100, tmp_path / "run", ["--policy.type=gcdt"])
    assert arguments == ["--policy.type=gcdt", "--steps=100", f"--output_dir={tmp_path / 'run'}"]


def test_a_folder_without_a_checkpoint_is_cleared(tmp_path):
    (tmp_path / "run").mkdir()
    assert "--steps=100" in arguments_to_reach(100, tmp_path / "run", [])
    assert not (tmp_path / "run").exists()


def test_an_interrupted_training_goes_on_from_its_last_checkpoint(tmp_path):
    reached(tmp_path, 40)
    arguments = arguments_to_reach(100, tmp_path, ["--policy.type=gcdt"])
    assert arguments == [f"--config_path={checkpoint(tmp_path)}/train_config.json", "--resume=true", "--steps=100"]


def test_a_complete_training_has_nothing_left(tmp_path):
    reached(tmp_path, 100)
    assert arguments_to_reach(100, tmp_path, []) is None
