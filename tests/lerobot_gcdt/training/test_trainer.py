"""The loss file tells the seconds of training, in which neither preparations nor lost steps count."""

import inspect
import logging
import math
import runpy
import sys
from types import SimpleNamespace

import pytest
from lerobot.common.train_utils import save_training_step, update_last_checkpoint
from lerobot.scripts import lerobot_train
from lerobot.utils.import_utils import get_safe_default_video_backend
from lerobot.utils.logging_utils import AverageMeter, MetricsTracker

from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.training import loss_curve, trainer, training_seconds


class Training:
    """Stands for `lerobot-train`: a run prepares for 10 s, then takes 2 s of CPU time and 3 s of wall time a step."""

    def __init__(self, output, monkeypatch):
        self.output, self.cpu, self.wall = output, 0.0, 0.0
        clocks = SimpleNamespace(process_time=lambda: self.cpu, perf_counter=lambda: self.wall)
        monkeypatch.setattr(trainer, "time", clocks)
        monkeypatch.setattr(lerobot_train, "main", lambda: self.main())

    def run(self, steps, device="cpu", checkpoint=None):
        """Trains and keeps a checkpoint; without one an interruption loses what was done."""
        self.steps, self.device = steps, SimpleNamespace(type=device)
        trainer.run(["--dataset.root=none"], self.output / "loss.csv", "scratch")
        if checkpoint:
            saved = self.output / f"checkpoints/{checkpoint:06d}"
            save_training_step(checkpoint, saved / "training_state")
            update_last_checkpoint(saved)

    def main(self):
        logger = logging.getLogger()
        logger.setLevel(logging.INFO)
        self.cpu, self.wall = self.cpu + 10, self.wall + 10
        logger.info("Start offline training on a fixed dataset, with effective batch size: 4")
        for step in self.steps:
            self.cpu, self.wall = self.cpu + 2, self.wall + 3
            accelerator = SimpleNamespace(num_processes=1, device=self.device)
            logger.info(MetricsTracker(4, 9, 1, {"loss": AverageMeter("loss")}, step, accelerator))


@pytest.fixture
def training(tmp_path, monkeypatch):
    level = logging.getLogger().level
    yield Training(tmp_path / "training", monkeypatch)
    logging.getLogger().setLevel(level)


@pytest.mark.parametrize(("device", "seconds"), [("cpu", [2, 4, 6]), ("cuda", [3, 6, 9])])
def test_seconds_are_cpu_time_on_the_cpu_and_wall_time_elsewhere(training, device, seconds):
    training.run([1, 2, 3], device)
    assert loss_curve(training.output).seconds.tolist() == seconds


def test_lerobot_says_when_it_is_prepared_and_before_it_writes_a_checkpoint():
    source = inspect.getsource(lerobot_train.train)
    assert f'f"{trainer.FIRST_STEP}' in source
    assert source.index(f'f"{trainer.CHECKPOINT}') < source.index(" save_checkpoint(")


def test_seconds_go_on_from_the_checkpoint_after_an_interruption(training):
    training.run([1, 2, 3, 4], checkpoint=2)
    training.run([3, 4, 5], checkpoint=5)
    assert loss_curve(training.output).seconds.tolist() == [2, 4, 6, 8, 10]


def test_between_two_rows_seconds_are_interpolated(training):
    training.run([2, 4])
    assert [training_seconds(training.output, step) for step in (1, 2, 3, 4)] == [1, 2, 3, 4]


def test_a_training_that_was_begun_without_seconds_goes_on_without_them(training):
    training.output.mkdir()
    (training.output / "loss.csv").write_text("step,loss\n1,0.5\n")
    save_training_step(1, training.output / "checkpoints/000001/training_state")
    update_last_checkpoint(training.output / "checkpoints/000001")
    training.run([2, 3])
    assert loss_curve(training.output).to_dict("list") == {"step": [1, 2, 3], "loss": [0.5, 0.0, 0.0]}
    assert math.isnan(training_seconds(training.output, 2))


def test_a_training_of_lerobots_own_command_has_no_seconds_even_where_it_goes_on(training):
    save_training_step(1, training.output / "checkpoints/000001/training_state")
    update_last_checkpoint(training.output / "checkpoints/000001")
    assert math.isnan(training_seconds(training.output, 1))
    training.run([2, 3])
    assert math.isnan(training_seconds(training.output, 3))


def test_an_option_that_lerobot_does_not_take_is_named_in_one_line(capsys):
    needed = ["--policy.type=gcdt", "--policy.push_to_hub=false", "--dataset.repo_id=any"]
    trainer.check_options([*needed, "--policy.context_length=7", "--seed=3"])
    for bad in ("--policy.contxt=7", "--policy.context_length=0", "--speed=3"):
        with pytest.raises(ValueError, match=bad.removeprefix("--").partition("=")[0]) as told:
            trainer.check_options([*needed, bad])
        assert "\n" not in str(told.value)
    assert not capsys.readouterr().err


def test_a_launched_process_ends_with_one_line_about_an_option_that_the_policy_refuses(tmp_path, monkeypatch):
    def main():
        raise OptionError("policy.layers must be positive, got 0.")

    monkeypatch.setattr(lerobot_train, "main", main)
    monkeypatch.setattr(sys, "argv", [trainer.__file__, str(tmp_path / "loss.csv"), "scratch", "--dataset.root=none"])
    with pytest.raises(SystemExit, match=r"^lerobot-train: policy.layers must be positive, got 0.$"):
        runpy.run_path(trainer.__file__, run_name="__main__")


def test_missing_decoders_of_films_are_not_told(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "torchcodec", None)
    trainer.check_options(["--policy.type=gcdt", "--policy.push_to_hub=false", "--dataset.repo_id=any"])
    assert "torchcodec" not in caplog.text
    get_safe_default_video_backend()
    assert "torchcodec" in caplog.text
