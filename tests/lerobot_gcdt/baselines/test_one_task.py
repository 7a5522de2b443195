"""Baselines learn one task, also from a dataset that was merged or that LeRobot split off a merged one."""

import pytest
import torch
from lerobot.datasets.dataset_metadata import LeRobotDatasetMetadata
from lerobot.datasets.dataset_tools import split_dataset
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.policies.factory import get_policy_class, make_policy_config

from lerobot_gcdt.recording import merge, record

KINDS = ["bc", "dt", "vinn", "iql", "plas"]


@pytest.fixture(scope="module")
def metas(needle_reach_root, uneven_root, tmp_path_factory):
    """Metadata of NeedleReach: two datasets in one, and an episode whose vectors are padded to those of NeedlePick."""
    folder = tmp_path_factory.mktemp("one_task")
    both = merge([needle_reach_root, record("NeedleReach", 1, 9, folder / "more")], folder / "both")
    mixed = LeRobotDataset("local/uneven", root=uneven_root, video_backend="pyav")
    split = split_dataset(mixed, {"reach": [4]}, folder / "split")["reach"].meta
    return {"merged": LeRobotDatasetMetadata("local/both", root=both), "split": split}


@pytest.mark.parametrize("source", ["merged", "split"])
@pytest.mark.parametrize("kind", KINDS)
def test_what_it_learns_and_does_has_the_sizes_of_the_task(metas, kind, source):
    config = make_policy_config(kind, device="cpu", push_to_hub=False)
    policy = get_policy_class(kind)(config, dataset_meta=metas[source])
    policy.forward({"index": torch.tensor([0, 3])})[0].backward()
    observation = {"observation.state": torch.zeros(1, 7)}
    goals = dict.fromkeys(("observation.goal", "observation.achieved_goal"), torch.zeros(1, 3))
    assert policy.eval().select_action(observation | goals).shape == (1, 5)


@pytest.mark.parametrize("kind", KINDS)
def test_an_unknown_task_is_named_with_the_one_that_is_known(needle_reach_meta, kind):
    config = make_policy_config(kind, device="cpu", push_to_hub=False)
    policy = get_policy_class(kind)(config, dataset_meta=needle_reach_meta)
    of_a_robot = {"observation.state": torch.zeros(1, 13), "task": ["Sew."]}
    with pytest.raises(KeyError, match="Unknown task 'Sew.'; this policy knows .*'Move the closed jaw tips"):
        policy.select_action(of_a_robot)
