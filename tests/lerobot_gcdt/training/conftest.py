"""Trainings: tiny ones, and those that are only asked for."""

import pytest

from lerobot_gcdt import training
from lerobot_gcdt.training import trainer

TINY = ["--policy.layers=1", "--policy.width=16", "--policy.heads=2", "--policy.inner_width=16"]


@pytest.fixture(scope="session")
def tiny():
    """Options of a policy that is trained in no time."""
    return TINY


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


@pytest.fixture(scope="session")
def trained(uneven_root, needle_pick_root, train, tmp_path_factory):
    """Folder of three stages, one after the other, with a learning rate of next to nothing."""
    output = tmp_path_factory.mktemp("trained")
    slow = ["--policy.optimizer_lr=1e-12", "--policy.device=cpu"]
    train(uneven_root, output / "pretrain", stage="pretrain", steps=2, options=[*TINY, *slow])
    train(uneven_root, output / "generalist", stage="generalist", start=output / "pretrain", steps=1, options=slow)
    train(needle_pick_root, output / "finetune", start=output / "generalist", steps=1, options=slow)
    return output
