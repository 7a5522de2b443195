"""A checkpoint of the past still loads, whole, and acts as it did.

``artefacts/checkpoint_0_1_0`` was trained by version 0.1.0 before objectives were registered: 40 steps of pretraining
on four demonstrations each of NeedlePick and NeedleRegrasp, 2 layers of width 16 that see 4 steps.
``artefacts/actions_0_1_0.safetensors`` holds twelve steps of observations of two episodes of each task and the actions
that it then gave. Neither is ever made anew.
"""

from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from lerobot_gcdt import GCDTPolicy
from lerobot_gcdt.averaging import without_resting
from lerobot_gcdt.evaluation import load_policy
from lerobot_gcdt.hub.checks import check_checkpoint
from lerobot_gcdt.keys import ACHIEVED_GOAL, GOAL, STATE

ARTEFACTS = Path(__file__).parent / "artefacts"
CHECKPOINT = ARTEFACTS / "checkpoint_0_1_0"
TASKS = {
    "needle_pick": "Pick up the needle and bring its middle to the goal.",
    "needle_regrasp": "Hand the needle from the first arm to the second and bring its held end to the goal.",
}

TOLERANCE = 1e-5
"""Between actions in [-1, 1]. Between processors with AMX, AVX-512, AVX2 and without any of them the largest difference
was 3e-7."""


def test_every_weight_is_loaded_and_no_other_is_there():
    saved = load_file(CHECKPOINT / "model.safetensors")
    loaded = GCDTPolicy.from_pretrained(CHECKPOINT).state_dict()
    assert without_resting(loaded) == set(saved)
    assert all(torch.equal(loaded[key], value) for key, value in saved.items())


@pytest.mark.parametrize("task", TASKS)
def test_it_acts_as_it_did(task):
    policy, stored = load_policy(CHECKPOINT), load_file(ARTEFACTS / "actions_0_1_0.safetensors")
    policy.reset()
    for t, expected in enumerate(stored[f"{task}/action"]):
        batch = {key: stored[f"{task}/{key}"][t] for key in (STATE, GOAL, ACHIEVED_GOAL)}
        action = policy.select_action(batch | {"task": [TASKS[task]] * 2})
        torch.testing.assert_close(action, expected, atol=TOLERANCE, rtol=0)


def test_it_can_still_be_published():
    check_checkpoint(CHECKPOINT)
