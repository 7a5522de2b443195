"""Windows from memory are those that LeRobot reads, and its trainer reads them so."""

import pytest
import torch
from lerobot.configs.default import DatasetConfig
from lerobot.configs.train import TrainPipelineConfig
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.scripts import lerobot_train

from lerobot_gcdt.baselines.configuration_bc import BCConfig
from lerobot_gcdt.keys import ACTION, STATE
from lerobot_gcdt.training import trainer
from lerobot_gcdt.training.windows import RowsInMemory, windows_from_memory

OFFSETS = {STATE: [-0.2, 0.0], ACTION: [0.2 * i for i in range(10)], "timestamp": [-0.2, 0.0], "next.success": [0.0]}
ENDS = (0, 99, 100, -1)
"""First and last frames of episodes, where windows are padded."""


def items(root, frames, **options):
    """Items of a dataset, as LeRobot reads them and from memory."""
    for in_memory in (False, True):
        dataset = LeRobotDataset("local/any", root=root, delta_timestamps=OFFSETS, video_backend="pyav", **options)
        if in_memory:
            dataset.reader.hf_dataset = RowsInMemory(dataset.hf_dataset)
        yield [dataset[i % len(dataset)] for i in frames]


@pytest.mark.parametrize("episodes", [None, [1, 3]])
def test_from_memory_an_item_is_what_lerobot_reads(needle_pick_root, episodes):
    for before, now in zip(*items(needle_pick_root, ENDS, episodes=episodes), strict=True):
        assert before.keys() == now.keys()
        assert before.pop("task") == now.pop("task")
        assert [x.dtype for x in before.values()] == [x.dtype for x in now.values()]
        assert all(torch.equal(x, now[key]) for key, x in before.items())


@pytest.mark.parametrize(("policy", "from_memory"), [(ACTConfig, True), (BCConfig, False)])
def test_the_trainers_rows_are_in_memory_where_a_policy_learns_from_windows(needle_pick_root, policy, from_memory):
    dataset = DatasetConfig("local/needle_pick", root=str(needle_pick_root), video_backend="pyav")
    config = TrainPipelineConfig(dataset=dataset, policy=policy(device="cpu", push_to_hub=False))
    with windows_from_memory():
        [made, _] = lerobot_train.make_train_eval_datasets(config)
    assert isinstance(made.reader.hf_dataset, RowsInMemory) == from_memory
    assert len(made.reader.hf_dataset) == len(made)


def test_lerobots_trainer_reads_so_in_a_training_and_is_left_as_it_was(tmp_path, monkeypatch):
    def interrupted():
        assert lerobot_train.make_train_eval_datasets is not make
        raise KeyboardInterrupt

    make = lerobot_train.make_train_eval_datasets
    monkeypatch.setattr(lerobot_train, "main", interrupted)
    with pytest.raises(KeyboardInterrupt):
        trainer.run(["--dataset.root=none"], tmp_path / "loss.csv", "scratch")
    assert lerobot_train.make_train_eval_datasets is make
