"""The four objectives: what each may see, and that it can be learned.

A leak is looked for in gradients: where the answer cannot be reached, the prediction's derivative is exactly zero.
"""

import copy

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import nn

from lerobot_gcdt import GCDTConfig, GCDTPolicy
from lerobot_gcdt.averaging import without_resting
from lerobot_gcdt.data.trajectories import Pieces
from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, STATE, TIME_TO_GOAL
from lerobot_gcdt.policy import objectives
from lerobot_gcdt.policy.tokens import ORDER

LOSSES = {
    "dynamics": objectives.dynamics_loss,
    "time_to_goal": objectives.time_to_goal_loss,
    "action": lambda policy, sequences: objectives.action_errors(policy, sequences).mean(),
    "reconstruction": lambda policy, sequences: objectives.reconstruction_loss(
        policy, sequences, objectives.draw_hidden(sequences, 0, 0.3)
    ),
}


@pytest.fixture(params=["paper", "relative_goal", "one_token"])
def policy(request, tiny_config, needle_pick_meta):
    torch.manual_seed(0)
    tiny_config.relative_goal = request.param != "paper"
    tiny_config.one_token = request.param == "one_token"
    tiny_config.time_to_goal_dropout = 1.0 if request.param == "one_token" else 0.0
    return GCDTPolicy(tiny_config, dataset_meta=needle_pick_meta)


@pytest.fixture
def sequences(policy):
    """Two pieces of ten steps and one of seven, packed."""
    pieces = policy._bank.pieces(torch.tensor([0, 50, 100]), 10)
    pieces = Pieces(*(getattr(pieces, field)[::5] for field in ("first", "last", "source", "key")))
    return policy._bank.sequences(pieces, torch.tensor([0, 50, 107]))


def predictions(policy, sequences, objective, monkeypatch, hidden=None):
    """What the heads of an objective predict, by kind of item: steps and values."""
    seen = {}

    def record(policy, sequences, key, states, where, head):
        steps = torch.nonzero(where, as_tuple=True)
        seen[key] = steps, head(policy.modules_of(0), states[steps])
        return states.new_zeros(())

    monkeypatch.setattr(objectives, "mean_error", record)
    if hidden is None:
        LOSSES[objective](policy, sequences)
    else:
        objectives.reconstruction_loss(policy, sequences, hidden)
    return seen


def dependence(policy, sequences, objective, key, step, monkeypatch, hidden=None):
    """Gradient of what is predicted of one step, with respect to all items."""
    sequences = copy.deepcopy(sequences)
    for value in sequences.items.values():
        value.requires_grad_()
    if objective == "action":
        predicted = policy.predict_actions(sequences)[step]
    else:
        (rows, columns), values = predictions(policy, sequences, objective, monkeypatch, hidden)[key]
        predicted = values[(rows == step[0]) & (columns == step[1])]
        assert len(predicted) == 1
    # A weighted sum, so that no head can cancel out.
    (predicted * torch.arange(1, predicted.shape[-1] + 1)).sum().backward()
    return {k: torch.zeros_like(v) if v.grad is None else v.grad for k, v in sequences.items.items()}


@pytest.mark.parametrize("t", range(10))
def test_an_action_is_predicted_without_itself(policy, sequences, t, monkeypatch):
    gradient = dependence(policy, sequences, "action", ACTION, (0, t), monkeypatch)
    assert (gradient[ACTION][0, t:] == 0).all()
    assert (gradient[STATE][0, t] != 0).any() and (gradient[GOAL][0, t] != 0).any()
    shown = policy.config.time_to_goal_dropout == 0
    assert (gradient[TIME_TO_GOAL][0, t] != 0).any() == shown


@pytest.mark.parametrize("t", range(1, 10))
def test_dynamics_sees_past_observations_and_actions_only(policy, sequences, t, monkeypatch):
    gradient = dependence(policy, sequences, "dynamics", STATE, (0, t), monkeypatch)
    for key in (TIME_TO_GOAL, GOAL, ACHIEVED_GOAL):
        assert (gradient[key] == 0).all(), key
    assert (gradient[STATE][0, t:] == 0).all() and (gradient[ACTION][0, t:] == 0).all()
    assert (gradient[STATE][0, t - 1] != 0).any() and (gradient[ACTION][0, t - 1] != 0).any()


def test_dynamics_predicts_all_but_the_first_observation_of_a_piece(policy, sequences, monkeypatch):
    (rows, columns), _ = predictions(policy, sequences, "dynamics", monkeypatch)[STATE]
    assert len(rows) == 9 + 9 + 6
    assert (columns > 0).all()


@pytest.mark.parametrize("t", range(10))
def test_time_to_goal_is_predicted_without_any_time_to_goal(policy, sequences, t, monkeypatch):
    gradient = dependence(policy, sequences, "time_to_goal", TIME_TO_GOAL, (0, t), monkeypatch)
    assert (gradient[TIME_TO_GOAL] == 0).all()
    assert (gradient[ACTION][0, t:] == 0).all()
    assert (gradient[STATE][0, t] != 0).any() and (gradient[GOAL][0, t] != 0).any()


@pytest.mark.parametrize("key", ORDER)
@pytest.mark.parametrize("t", [0, 4, 9])
def test_a_hidden_item_is_reconstructed_without_itself(policy, sequences, key, t, monkeypatch):
    hidden = torch.zeros(*sequences.segment.shape, 4, dtype=torch.bool)
    hidden[0, t, ORDER.index(key)] = True
    gradient = dependence(policy, sequences, "reconstruction", key, (0, t), monkeypatch, hidden)
    assert (gradient[key][0, t] == 0).all()
    if key == STATE:
        assert (gradient[ACHIEVED_GOAL][0, t] == 0).all()  # a part of the observation, which goal tokens may hold
    others = [k for k in (STATE, ACTION) if k != key]
    assert all((gradient[k][0, t] != 0).any() for k in others)
    assert (gradient[STATE][0, (t + 1) % 10] != 0).any()  # the future, too


def test_reconstruction_hides_items_of_every_kind_and_goals_as_a_whole(policy):
    sequences = policy._bank.sequences(policy._bank.pieces(torch.arange(0, 200, 50), 10))
    hidden = objectives.draw_hidden(sequences, 0, 0.3)
    share = hidden.float().mean((0, 1))
    assert ((share > 0.1) & (share < 0.6)).all()
    for piece in sequences.segment.unique():
        assert len(hidden[..., ORDER.index(GOAL)][sequences.segment == piece].unique()) == 1


def test_an_action_error_is_the_mean_square_over_the_actions_of_a_step(policy, sequences):
    errors = objectives.action_errors(policy, sequences)
    predicted = policy.predict_actions(sequences)
    expected = (predicted - sequences.items[ACTION]).square().mean(-1)[sequences.real]
    torch.testing.assert_close(errors, expected)
    assert len(errors) == 27


@pytest.mark.parametrize("objective", LOSSES)
def test_padding_has_no_influence(policy, sequences, objective):
    assert not sequences.real.all()
    changed = copy.deepcopy(sequences)
    for value in changed.items.values():
        value[~sequences.real] += 1
    assert torch.equal(LOSSES[objective](policy, changed), LOSSES[objective](policy, sequences))


@pytest.mark.parametrize("objective", LOSSES)
def test_an_optimiser_step_lowers_the_loss(policy, sequences, objective):
    optimizer = torch.optim.AdamW(policy.parameters(), lr=1e-3)
    before = LOSSES[objective](policy, sequences)
    before.backward()
    optimizer.step()
    assert LOSSES[objective](policy, sequences) < before


@pytest.mark.parametrize("objective", LOSSES)
def test_a_handful_of_pieces_can_be_learned_by_heart(tiny_config, needle_pick_meta, objective):
    torch.manual_seed(0)
    policy = GCDTPolicy(tiny_config, dataset_meta=needle_pick_meta)
    sequences = policy._bank.sequences(policy._bank.pieces(torch.tensor([0, 50]), 10))
    start = LOSSES[objective](policy, sequences).item()
    optimizer = torch.optim.AdamW(policy.parameters(), lr=3e-3)
    for _ in range(300):
        value = LOSSES[objective](policy, sequences)
        if value.item() < start / 10:
            break
        value.backward()
        optimizer.step()
        optimizer.zero_grad()
    assert value.item() < start / 10


# An objective of one's own: a loss, heads, and one registration.


def inverse_dynamics_loss(policy, sequences):
    """Which action led from an observation to the next one."""
    seen = policy.encode(sequences, (STATE,), causal=False)[:, :, 0]
    going_on = nn.functional.pad(sequences.segment[:, 1:] == sequences.segment[:, :-1], (0, 1)) & sequences.real
    return objectives.mean_error(policy, sequences, ACTION, seen, going_on, lambda modules, x: modules.inverse_head(x))


@pytest.fixture
def inverse_dynamics():
    """Its name, registered for one test."""
    objectives.register_objective(
        "inverse_dynamics", inverse_dynamics_loss, lambda dims, width: {"inverse_head": nn.Linear(width, dims[2])}
    )
    yield "inverse_dynamics"
    del objectives.OBJECTIVES["inverse_dynamics"]


@pytest.fixture
def saved(tiny_config, needle_pick_meta, tmp_path):
    """Folder of a checkpoint from before the objective was thought of."""
    tiny_config.training_stage = "pretrain"
    GCDTPolicy(tiny_config, dataset_meta=needle_pick_meta).save_pretrained(tmp_path)
    return tmp_path


def with_objective(folder, name):
    config = GCDTConfig.from_pretrained(folder)
    config.objectives = {name: 0.5}
    return config


def test_an_objective_of_ones_own_is_learned_beside_the_others(tiny_config, needle_pick_meta, inverse_dynamics):
    tiny_config.training_stage, tiny_config.objectives = "pretrain", {inverse_dynamics: 0.5}
    policy = GCDTPolicy(tiny_config, dataset_meta=needle_pick_meta)
    loss, log = policy.forward({"index": torch.tensor([0, 60])})
    assert list(log)[-1] == "inverse_dynamics_loss"
    auxiliary = sum(log[f"{name}_loss"] for name in ("dynamics", "time_to_goal", "reconstruction"))
    expected = log["action_loss"] + 0.1 * auxiliary + 0.5 * log["inverse_dynamics_loss"]
    assert loss.item() == pytest.approx(expected, rel=1e-5)
    loss.backward()
    assert policy.modules_of(0).inverse_head.weight.grad.abs().max() > 0


def test_a_checkpoint_from_before_loads_as_it_is(saved, inverse_dynamics):
    assert GCDTPolicy.from_pretrained(saved).state_dict().keys() == load_file(saved / "model.safetensors").keys()


def test_training_goes_on_from_such_a_checkpoint_with_new_heads(saved, inverse_dynamics, needle_pick_meta, tmp_path):
    weights = load_file(saved / "model.safetensors")
    policy = GCDTPolicy.from_pretrained(
        saved, config=with_objective(saved, inverse_dynamics), dataset_meta=needle_pick_meta
    )
    assert all(torch.equal(value, weights[key]) for key, value in policy.state_dict().items() if key in weights)
    assert "inverse_dynamics_loss" in policy.train().forward({"index": torch.tensor([0])})[1]
    policy.save_pretrained(tmp_path / "next")
    again = GCDTPolicy.from_pretrained(tmp_path / "next")
    assert torch.equal(again.modules_of(0).inverse_head.weight, policy.modules_of(0).inverse_head.weight)


@pytest.mark.parametrize("lost", ["dynamics_head", "linear"])
def test_what_else_such_a_checkpoint_lacks_is_named(saved, inverse_dynamics, lost):
    weights = load_file(saved / "model.safetensors")
    missing = sorted(key for key in without_resting(weights) if lost in key)
    save_file({key: value for key, value in weights.items() if key not in missing}, saved / "model.safetensors")
    with pytest.raises(ValueError, match=missing[0].replace(".", r"\.")):
        GCDTPolicy.from_pretrained(saved, config=with_objective(saved, inverse_dynamics))


@pytest.mark.parametrize(
    ("chosen", "told"),
    [
        ({"sewing": 0.1}, "'sewing', but there are dynamics, time_to_goal, reconstruction"),
        ({"dynamics": 0.1}, "policy.dynamics_weight"),
        ({"inverse_dynamics": -0.1}, "inverse_dynamics must not be negative, got -0.1"),
    ],
    ids=["not registered", "has an option of its own", "negative weight"],
)
def test_objectives_that_cannot_be_had_are_named(chosen, told, inverse_dynamics):
    with pytest.raises(OptionError, match=told):
        GCDTConfig(objectives=chosen, device="cpu", push_to_hub=False)


def test_a_name_is_registered_once():
    with pytest.raises(ValueError, match="'dynamics' already"):
        objectives.register_objective("dynamics", inverse_dynamics_loss, lambda dims, width: {})
