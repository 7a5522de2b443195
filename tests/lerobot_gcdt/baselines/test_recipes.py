"""What GCDT is compared with trains by its recipe, through the same trainer, and acts on the goal."""

import json

import pytest
import torch

from lerobot_gcdt import SurRoLEnvConfig, training
from lerobot_gcdt.evaluation import evaluate, load_policy
from lerobot_gcdt.keys import ACHIEVED_GOAL, ENVIRONMENT_STATE, GOAL, STATE
from lerobot_gcdt.training.recipes import RECIPES
from surrol_gym.tasks.needle_reach import NeedleReachEnv


@pytest.fixture(scope="module", params=["bc", "dt", "vinn", "iql", "plas", "act", "diffusion"])
def policy(request, needle_reach_root, command, tmp_path_factory):
    """Each rival after one step, between its processors."""
    if request.param == "diffusion":
        pytest.importorskip("diffusers", reason="comes with lerobot[diffusion]")
    output = tmp_path_factory.mktemp("recipes") / request.param
    options = ["--policy.device=cpu"]
    command(lambda: training.train(needle_reach_root, output, request.param, steps=1, options=options))
    return load_policy(training.checkpoint(output))


def test_the_goal_decides_what_it_does(policy):
    state, goal = torch.zeros(1, policy.config.input_features[STATE].shape[0]), torch.zeros(1, 3)

    def act(goal):
        policy.reset()
        torch.manual_seed(0)
        seen = {STATE: state, GOAL: goal, ENVIRONMENT_STATE: goal, ACHIEVED_GOAL: torch.zeros(1, 3)}
        return policy.select_action(seen | {"task": [NeedleReachEnv.task_description]})

    blind = policy.config.type == "dt"  # unless it is asked for
    assert torch.equal(act(goal), act(goal + 1.0)) == blind


def test_it_is_evaluated(policy):
    assert len(evaluate(policy, ["NeedleReach"], [20_000, 20_001])) == 2


@pytest.mark.parametrize("kind", ["act", "diffusion"])
def test_lerobots_policies_normalise_the_goal_and_look_again_within_two_seconds(kind):
    options = dict(option.removeprefix("--policy.").split("=") for option in RECIPES[kind, "scratch"].options)
    assert json.loads(options["normalization_mapping"])["ENV"] != "IDENTITY"
    assert int(options["n_action_steps"]) <= 2 * SurRoLEnvConfig().fps
