"""A baseline of one's own is one file with LeRobot's registration: nothing of this package is edited for it."""

import importlib
from pathlib import Path

import pytest
from lerobot.configs.default import DatasetConfig
from lerobot.configs.train import TrainPipelineConfig
from lerobot.policies.factory import make_pre_post_processors

from lerobot_gcdt.evaluation import evaluate, load_policy
from lerobot_gcdt.hub.checks import check_card, check_checkpoint
from lerobot_gcdt.hub.model_card import model_card


@pytest.fixture
def checkpoint(needle_reach_meta, tmp_path, monkeypatch):
    """Folder of a checkpoint of the policy in ``nearest_frame.py``, as `lerobot-train` saves it."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    nearest_frame = importlib.import_module("nearest_frame")
    config = nearest_frame.NearestFrameConfig(device="cpu", push_to_hub=False)
    nearest_frame.NearestFramePolicy(config, dataset_meta=needle_reach_meta).save_pretrained(tmp_path)
    for processor in make_pre_post_processors(config):
        processor.save_pretrained(tmp_path)
    data = DatasetConfig("local/needle_reach", root=str(needle_reach_meta.root), video_backend="pyav")
    TrainPipelineConfig(dataset=data, policy=config)._save_pretrained(tmp_path)
    return tmp_path


def test_it_is_evaluated(checkpoint):
    assert evaluate(load_policy(checkpoint), ["NeedleReach"], [0]).reached.all(), "an episode that it has seen"


def test_it_is_published_with_a_card(checkpoint):
    check_checkpoint(checkpoint)
    check_card(card := model_card(checkpoint, "me/nearest"), "model")
    assert "A look-up of the nearest frame,\nfor the surgical tasks" in card
    loading = "from nearest_frame import NearestFramePolicy\n\npolicy = NearestFramePolicy.from_pretrained"
    assert f'{loading}("me/nearest")' in card
    assert "lerobot-train --policy.type=nearest_frame" in " ".join(card.replace("\\\n", "").split())
