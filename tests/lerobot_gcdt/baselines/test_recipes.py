"""What GCDT is compared with trains by its recipe, through the same trainer, and acts on the goal."""

import json

import numpy as np
import pytest
import torch
from lerobot.configs.types import FeatureType, NormalizationMode, PolicyFeature
from lerobot.processor import NormalizerProcessorStep, TransitionKey, create_transition

from lerobot_gcdt import SurRoLEnvConfig, training
from lerobot_gcdt.baselines.one_task import whole_cosine
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


@pytest.fixture(params=["act", "diffusion"])
def lerobots(request):
    """Settings of the recipe of one of LeRobot's policies."""
    return dict(option.removeprefix("--policy.").split("=") for option in RECIPES[request.param, "scratch"].options)


def test_lerobots_policies_look_again_within_two_seconds(lerobots):
    assert int(lerobots["n_action_steps"]) <= 2 * SurRoLEnvConfig().fps


def test_lerobots_policies_normalise_the_goal_also_where_it_is_constant(lerobots):
    goal = np.full(1, 3.475, dtype=np.float32)
    rounded = np.nextafter(goal, np.float32(4))  # as LeRobot's mean over many episodes is
    mode = NormalizationMode(json.loads(lerobots["normalization_mapping"])["ENV"])
    assert mode is not NormalizationMode.IDENTITY
    normalise = NormalizerProcessorStep(
        features={ENVIRONMENT_STATE: PolicyFeature(FeatureType.ENV, (1,))},
        norm_map={FeatureType.ENV: mode},
        stats={ENVIRONMENT_STATE: {"mean": rounded, "std": np.zeros(1), "min": goal, "max": goal}},
    )
    seen = normalise(create_transition({ENVIRONMENT_STATE: torch.from_numpy(goal)}))[TransitionKey.OBSERVATION]
    assert seen[ENVIRONMENT_STATE].abs() <= 1


def test_acts_learning_rate_falls_as_that_of_the_baselines_does():
    options = dict(option.removeprefix("--").split("=") for option in RECIPES["act", "scratch"].options)
    schedule = whole_cosine(float(options["optimizer.lr"]))
    assert options["scheduler.type"] == schedule.type
    assert {name: float(options[f"scheduler.{name}"]) for name in vars(schedule)} == vars(schedule)
