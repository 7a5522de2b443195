"""The four objectives: what each may see, and that it can be learned.

A leak is looked for in gradients: where the answer cannot be reached, the prediction's derivative is exactly zero.
"""

import copy

import pytest
import torch

from lerobot_gcdt import GCDTPolicy
from lerobot_gcdt.data.trajectories import Pieces
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


@pytest.fixture(params=[True, False], ids=["relative_goal", "absolute_goal"])
def policy(request, tiny_config, needle_pick_meta):
    torch.manual_seed(0)
    tiny_config.relative_goal = request.param
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

    monkeypatch.setattr(objectives, "_mean_error", record)
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
    assert (gradient[TIME_TO_GOAL][0, t] != 0).any()


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
