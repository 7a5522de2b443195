"""A baseline of one's own is one file with LeRobot's registration: nothing of this package is edited for it."""

import importlib
from pathlib import Path

import pytest

from lerobot_gcdt import training
from lerobot_gcdt.evaluation import evaluate, load_policy
from lerobot_gcdt.hub.checks import check_card, check_checkpoint
from lerobot_gcdt.hub.model_card import model_card


@pytest.fixture(scope="module")
def checkpoint(needle_reach_root, command, tmp_path_factory):
    """Folder of a checkpoint of the policy in ``nearest_frame.py``, after one step."""
    output = tmp_path_factory.mktemp("own") / "nearest"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parent)
        importlib.import_module("nearest_frame")
        command(lambda: training.train(needle_reach_root, output, "nearest_frame", steps=1, device="cpu"))
        yield training.checkpoint(output)


def test_it_is_evaluated(checkpoint):
    assert evaluate(load_policy(checkpoint), ["NeedleReach"], [0]).reached.all(), "an episode that it has seen"


def test_it_is_published_with_a_card(checkpoint):
    check_checkpoint(checkpoint)
    check_card(card := model_card(checkpoint, "me/nearest"), "model")
    assert "A look-up of the nearest frame,\nfor the surgical tasks" in card
    loading = "from nearest_frame import NearestFramePolicy\n\npolicy = NearestFramePolicy.from_pretrained"
    assert f'{loading}("me/nearest")' in card
    assert "lerobot-train --policy.type=nearest_frame" in " ".join(card.replace("\\\n", "").split())
