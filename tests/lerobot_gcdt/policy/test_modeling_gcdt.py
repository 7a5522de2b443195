"""The policy: what it may see, what must not matter, and that remembering equals recomputing."""

import copy

import pytest
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDatasetMetadata
from safetensors.torch import load_file, save_file

from lerobot_gcdt import GCDTConfig, GCDTPolicy, precision
from lerobot_gcdt.averaging import without_resting
from lerobot_gcdt.data.statistics import SMALLEST_STD
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, STATE, TIME_TO_GOAL

PICK = "Pick up the needle and bring its middle to the goal."
REACH = "Move the closed jaw tips to the point above the needle."


def paper(config):
    """The same configuration with a token an item, and time-to-goal that counts down."""
    config = copy.deepcopy(config)
    config.one_token, config.time_to_goal_dropout = False, 0.0
    return config


@pytest.fixture
def policy(tiny_config, needle_pick_meta):
    torch.manual_seed(0)
    return GCDTPolicy(tiny_config, dataset_meta=needle_pick_meta)


@pytest.fixture
def paper_policy(tiny_config, needle_pick_meta):
    torch.manual_seed(0)
    return GCDTPolicy(paper(tiny_config), dataset_meta=needle_pick_meta)


@pytest.fixture
def two_task_policy(tiny_config):
    torch.manual_seed(0)
    config = copy.deepcopy(tiny_config)
    config.task_dims = {PICK: [19, 3, 5], REACH: [7, 3, 4]}
    config.expected_steps = {PICK: 37.0, REACH: 20.0}
    return GCDTPolicy(config).eval()


def whole(policy, *episodes):
    """The packed demonstrations of some episodes."""
    return policy._bank.sequences(policy._bank.pieces(torch.tensor(episodes) * 50, 50))


def observation(batch, task=PICK, size=19):
    return {
        STATE: torch.randn(batch, size),
        GOAL: torch.randn(batch, 3),
        ACHIEVED_GOAL: torch.randn(batch, 3),
        "task": [task] * batch,
    }


def rows(batch, chosen):
    """Some rows of a batch."""
    return {key: value[chosen] if isinstance(value, torch.Tensor) else [PICK] for key, value in batch.items()}


# What the prediction may depend on.


@pytest.mark.parametrize("key", [STATE, GOAL, ACHIEVED_GOAL, TIME_TO_GOAL, ACTION])
def test_a_change_after_t_changes_no_action_up_to_t(paper_policy, key):
    t, policy = 20, paper_policy
    sequences = whole(policy, 0)
    before = policy.predict_actions(sequences)
    changed = copy.deepcopy(sequences)
    changed.items[key][:, t + 1 :] += 1
    after = policy.predict_actions(changed)
    assert torch.equal(before[:, : t + 1], after[:, : t + 1])
    assert not torch.equal(before[:, t + 1 :], after[:, t + 1 :])


@pytest.mark.parametrize("key", [STATE, GOAL, ACHIEVED_GOAL])
def test_what_is_joined_into_one_token_is_not_visible_earlier_either(policy, key):
    sequences = whole(policy, 0)
    before = policy.predict_actions(sequences)
    sequences.items[key][:, 21:] += 1
    after = policy.predict_actions(sequences)
    assert torch.equal(before[:, :21], after[:, :21])
    assert not torch.equal(before[:, 21:], after[:, 21:])


@pytest.mark.parametrize("key", [ACTION, TIME_TO_GOAL])
def test_neither_past_actions_nor_a_hidden_time_to_goal_are_visible(policy, key):
    sequences = whole(policy, 0)
    before = policy.predict_actions(sequences)
    sequences.items[key] += 1
    assert torch.equal(before, policy.predict_actions(sequences))


def test_an_action_is_not_visible_to_its_own_prediction(paper_policy):
    policy = paper_policy
    sequences = whole(policy, 0)
    before = policy.predict_actions(sequences)
    sequences.items[ACTION][:, 20] += 1
    after = policy.predict_actions(sequences)
    assert torch.equal(before[:, :21], after[:, :21])
    assert not torch.equal(before[:, 21], after[:, 21])


@pytest.mark.parametrize("key", [STATE, GOAL, ACHIEVED_GOAL, TIME_TO_GOAL])
def test_an_action_depends_on_what_is_known_at_its_step(paper_policy, key):
    policy = paper_policy
    sequences = whole(policy, 0)
    before = policy.predict_actions(sequences)
    sequences.items[key][:, 20] += 1
    assert not torch.equal(before[:, 20], policy.predict_actions(sequences)[:, 20])


def test_other_trajectories_of_the_row_change_nothing(policy):
    cuts = torch.tensor([45, 56, 107, 160])  # lengths 45, 6, 7, 10: the short ones share a row
    sequences = policy._bank.sequences(policy._bank.pieces(cuts, 50), cuts)
    assert len(sequences.segment) < 4
    packed = policy.predict_actions(sequences)
    for i in range(4):
        cut = cuts[i : i + 1]
        alone = policy.predict_actions(policy._bank.sequences(policy._bank.pieces(cut, 50), cut))
        torch.testing.assert_close(packed[sequences.segment == i], alone[0], atol=1e-4, rtol=0)


def test_steps_beyond_the_context_length_are_out_of_sight(tiny_config, needle_pick_meta):
    config = copy.deepcopy(tiny_config)
    config.context_length, config.layers = 5, 1
    policy = GCDTPolicy(config, dataset_meta=needle_pick_meta)
    sequences = whole(policy, 0)
    before = policy.predict_actions(sequences)
    sequences.items[STATE][:, 10] += 1
    changed = (before != policy.predict_actions(sequences)).any(-1)[0]
    assert torch.nonzero(changed).flatten().tolist() == list(range(10, 15))


def test_the_achieved_goal_is_out_of_sight_without_relative_goals(tiny_config, needle_pick_meta):
    tiny_config.relative_goal = False
    policy = GCDTPolicy(tiny_config, dataset_meta=needle_pick_meta)
    sequences = whole(policy, 0)
    before = policy.predict_actions(sequences)
    sequences.items[ACHIEVED_GOAL] += 1
    assert torch.equal(before, policy.predict_actions(sequences))


# Remembering equals recomputing.


def test_training_reads_pieces_of_drawn_lengths(policy):
    policy.config.context_length = 50
    policy.train()
    drawn = []
    for step in range(400):
        policy.training_step.fill_(step)
        drawn.append(policy._piece_length())
    assert min(drawn) == 1 and max(drawn) <= 50
    assert sum(length <= 6 for length in drawn) / 400 == pytest.approx(0.5, abs=0.08)  # half of the orders of magnitude
    policy.config.draw_context = False
    assert policy._piece_length() == 50
    policy.config.draw_context = True
    assert policy.eval()._piece_length() == 50


@pytest.mark.parametrize("context_length", [100, 8, 1])
@pytest.mark.parametrize("one_token", [True, False])
@pytest.mark.parametrize("dropout", [0.0, 0.5, 1.0])
def test_the_cached_rollout_equals_the_full_forward_pass(
    tiny_config, needle_pick_meta, monkeypatch, context_length, one_token, dropout
):
    torch.manual_seed(0)
    tiny_config.context_length, tiny_config.one_token = context_length, one_token
    tiny_config.time_to_goal_dropout = dropout
    policy = GCDTPolicy(tiny_config, dataset_meta=needle_pick_meta).eval()
    seen = []
    step_tokens = policy._step_tokens
    monkeypatch.setattr(policy, "_step_tokens", lambda *args: seen.append(dict(args[2])) or step_tokens(*args))
    sequences, rolled_out, times = whole(policy, 0), [], []
    for t in range(50):
        batch = {key: sequences.items[key][:, t] for key in (STATE, GOAL, ACHIEVED_GOAL)}
        rolled_out.append(policy.select_action(batch | {"task": [PICK]}))
        times += [items[TIME_TO_GOAL] for items in seen if TIME_TO_GOAL in items]
        seen.clear()
    sequences.items[ACTION] = torch.stack(rolled_out, 1)
    assert len(times) == (0 if dropout == 1 else 50)
    if times:
        sequences.items[TIME_TO_GOAL] = torch.stack(times, 1)
    with torch.no_grad():
        states = policy.read(sequences, torch.full((1, 50), dropout == 1))
        full = policy.predict_actions(sequences, states)
    torch.testing.assert_close(sequences.items[ACTION], full, atol=1e-4, rtol=0)


def test_the_batch_size_changes_nothing(policy):
    policy.eval()
    batches = [observation(5) for _ in range(6)]
    together = torch.stack([policy.select_action(batch) for batch in batches])
    for row in range(5):
        policy.reset()
        alone = [policy.select_action(rows(batch, slice(row, row + 1))) for batch in batches]
        torch.testing.assert_close(together[:, row : row + 1], torch.stack(alone), atol=1e-4, rtol=0)


def test_reset_forgets_the_episode(policy):
    policy.eval()
    first, second = observation(2), observation(2)
    fresh = policy.select_action(first)
    policy.select_action(second)
    assert not torch.equal(policy.select_action(first), fresh)
    policy.reset()
    assert torch.equal(policy.select_action(first), fresh)


def test_history_matters(policy):
    policy.eval()
    now = observation(1)
    policy.select_action(observation(1))
    after_one = policy.select_action(now)
    policy.reset()
    policy.select_action(observation(1))
    assert not torch.equal(after_one, policy.select_action(now))


def test_inference_ignores_autocast(policy):
    policy.eval()
    batch = observation(2)
    exact = policy.select_action(batch)
    policy.reset()
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(policy.select_action(batch), exact)


def test_in_the_papers_way_time_to_goal_starts_at_the_expected_length_and_stays_above_zero(paper_policy):
    expected = paper_policy.config.expected_steps[PICK]
    assert paper_policy._countdown(PICK, 0) == pytest.approx(expected)
    assert paper_policy._countdown(PICK, 10) == pytest.approx(expected - 10)
    assert paper_policy._countdown(PICK, 99) == 1


def test_only_the_papers_way_knows_which_step_it_is(policy, paper_policy):
    batch = observation(1)
    for each, same in ((policy, True), (paper_policy, False)):
        each.config.context_length = 1
        each.eval().reset()
        first, second = each.select_action(batch), each.select_action(batch)
        assert torch.equal(first, second) == same


def test_time_to_goal_is_hidden_in_training_but_for_what_is_relabelled(policy):
    policy.config.time_to_goal_dropout = 0.5
    sequences = policy.train()._draw(torch.arange(200), 1)
    hidden = policy._without_time(sequences)
    assert 0.3 < hidden[~sequences.relabelled].float().mean() < 0.7
    assert not hidden[sequences.relabelled].any()
    assert policy.eval()._without_time(sequences).all()


def test_a_policy_without_a_clock_learns_to_predict_time_to_goal(policy):
    batch, steps = {"index": torch.arange(0, 200, 5)}, whole(policy, 0)
    optimiser = torch.optim.AdamW(policy.get_optim_params(), lr=3e-3)
    policy.train()
    for _ in range(60):
        policy.forward(batch)[0].backward()
        optimiser.step()
        optimiser.zero_grad()
    with torch.no_grad():
        states = policy.eval().read(steps, torch.ones(1, 50, dtype=torch.bool))
        predicted = policy.modules_of(PICK).predict_time_to_goal(states)
    assert (predicted - steps.items[TIME_TO_GOAL]).abs().mean() < 3


@pytest.mark.parametrize("dropout", [0.5, 1.0])
def test_a_running_policy_tells_how_many_steps_it_still_needs(two_task_policy, dropout):
    two_task_policy.config.time_to_goal_dropout = dropout
    batch = {**observation(3), "task": [PICK, PICK, PICK]}
    two_task_policy.eval().reset()
    two_task_policy.select_action(batch)
    left = two_task_policy.predict_time_to_goal()
    assert left.shape == (3,) and (left >= 0).all()
    assert torch.equal(two_task_policy.predict_time_to_goal(), left), "asking changes nothing"
    two_task_policy.reset()
    two_task_policy.select_action(rows(batch, slice(1, 2)))
    torch.testing.assert_close(two_task_policy.predict_time_to_goal(), left[1:2])


def test_time_to_goal_is_told_while_episodes_run_by_policies_that_predict_it(policy, paper_policy):
    policy.eval().reset()
    with pytest.raises(RuntimeError, match="No episode is running"):
        policy.predict_time_to_goal()
    paper_policy.eval().reset()
    paper_policy.select_action(observation(1))
    with pytest.raises(RuntimeError, match="time_to_goal_dropout=0 is told"):
        paper_policy.predict_time_to_goal()
    policy.select_action(observation(1))
    policy.config.time_to_goal_weight = 0.0
    with pytest.raises(RuntimeError, match="time_to_goal_weight=0 never learned"):
        policy.predict_time_to_goal()


def test_a_chunk_is_one_action(policy):
    policy.eval()
    batch = observation(3)
    chunk = policy.predict_action_chunk(batch)
    policy.reset()
    assert torch.equal(chunk[:, 0], policy.select_action(batch))
    assert chunk.shape == (3, 1, 5)


# Several tasks.


def test_tasks_mix_within_a_batch(two_task_policy):
    state = torch.randn(2, 19)
    state[1, 7:] = 0  # padding of the smaller task
    batch = {STATE: state, GOAL: torch.randn(2, 3), ACHIEVED_GOAL: torch.randn(2, 3), "task": [PICK, REACH]}
    mixed = two_task_policy.select_action(batch)
    two_task_policy.reset()
    pick = two_task_policy.select_action(rows(batch, slice(0, 1)))
    two_task_policy.reset()
    reach = two_task_policy.select_action(rows(batch, slice(1, 2)) | {STATE: state[1:, :7], "task": [REACH]})
    assert mixed.shape == (2, 5) and reach.shape == (1, 4)
    torch.testing.assert_close(mixed[:1], pick, atol=1e-4, rtol=0)
    torch.testing.assert_close(mixed[1:, :4], reach, atol=1e-4, rtol=0)
    assert mixed[1, 4] == 0


def test_a_new_task_is_added_beside_the_known_ones(policy, needle_reach_root, tmp_path):
    policy.save_pretrained(tmp_path)
    meta = LeRobotDatasetMetadata("local/needle_reach", root=needle_reach_root)
    tuned = GCDTPolicy.from_pretrained(tmp_path, dataset_meta=meta)
    assert set(tuned.config.task_dims) == {PICK, REACH}
    old, new = policy.state_dict(), tuned.state_dict()
    assert all(torch.equal(value, new[key]) for key, value in old.items())


# Training.


def test_an_optimiser_step_lowers_the_loss(policy):
    policy.eval()  # no relabelling: the same trajectories twice
    batch = {"index": torch.arange(0, 150, 10)}
    optimizer = torch.optim.AdamW(policy.get_optim_params(), lr=1e-3)
    before, _ = policy.forward(batch)
    before.backward()
    optimizer.step()
    after, log = policy.forward(batch)
    assert after < before
    assert log["action_loss"] == pytest.approx(after.item())


@pytest.mark.parametrize(
    "dtype, chosen", [("float32", None), ("bfloat16", None), ("auto", "bfloat16"), ("auto", "float32")]
)
def test_only_the_transformer_trains_in_the_chosen_precision(policy, monkeypatch, dtype, chosen):
    policy.config.dtype = dtype
    monkeypatch.setattr(precision, "faster_precision", lambda device: getattr(torch, chosen))
    seen = []
    layer = policy.transformer.blocks[0].mlp[0]
    layer.register_forward_hook(lambda _, __, output: seen.append(output.dtype))
    policy.modules_of(PICK).action_head.register_forward_hook(lambda _, __, output: seen.append(output.dtype))
    policy.forward({"index": torch.tensor([0])})
    assert seen == [getattr(torch, chosen or dtype), torch.float32]


def test_hindsight_happens_in_training_mode_only(policy):
    batch = {"index": torch.arange(10, 50)}
    policy.eval()
    demonstrations = policy.forward(batch)[0]
    policy.train()
    assert policy.forward(batch)[0] != demonstrations


def test_the_unreduced_loss_has_an_entry_a_frame(policy):
    policy.eval()
    batch = {"index": torch.tensor([0, 50, 100])}
    each, _ = policy.forward(batch, reduction="none")
    assert each.shape == (3,)
    assert each.mean().item() == pytest.approx(policy.forward(batch)[0].item(), rel=1e-5)  # equally long episodes


def test_windows_of_whole_episodes_give_the_loss_of_their_frames(policy, needle_pick_windows):
    policy.eval()
    windows = policy.forward(needle_pick_windows, reduction="none")[0]
    frames = policy.forward({"index": torch.tensor([0, 50])}, reduction="none")[0]
    torch.testing.assert_close(windows[:2], frames)


def test_windows_train_a_policy_without_a_dataset_in_both_stages(two_task_policy, needle_pick_windows):
    two_task_policy.train()
    assert list(two_task_policy.forward(needle_pick_windows)[1]) == ["action_loss", "time_to_goal_loss"]
    two_task_policy.config.training_stage = "pretrain"
    loss, log = two_task_policy.forward(needle_pick_windows)
    assert len(log) == 4
    loss.backward()
    assert all(p.grad is not None for p in two_task_policy.modules_of(PICK).parameters())


@pytest.mark.parametrize("stage, alone", [("finetune", True), ("pretrain", False)])
def test_time_to_goal_shapes_the_transformer_in_pretraining_only(two_task_policy, needle_pick_windows, stage, alone):
    config = two_task_policy.train().config
    config.training_stage, config.dynamics_weight, config.reconstruction_weight = stage, 0.0, 0.0
    gradients = []
    for config.time_to_goal_weight in (0.1, 10.0):
        two_task_policy.zero_grad()
        two_task_policy.training_step.zero_()
        two_task_policy.forward(needle_pick_windows)[0].backward()
        assert two_task_policy.modules_of(PICK).time_to_goal_head.weight.grad.any()
        gradients.append(two_task_policy.transformer.blocks[0].mlp[0].weight.grad)
    assert torch.allclose(*gradients) == alone


@pytest.mark.parametrize("key", [STATE, GOAL, TIME_TO_GOAL])
def test_items_are_standardised_as_training_sees_them(policy, key):
    sequences = policy._draw(torch.arange(200), 1)
    items = {name: value[:, 0] for name, value in sequences.items.items()}
    scaled = policy.modules_of(PICK).target(key, items)
    varying = items[key].std(0) > SMALLEST_STD
    assert scaled.mean(0).abs().max() < 0.2
    torch.testing.assert_close(scaled.std(0)[varying], torch.ones(int(varying.sum())), atol=0.2, rtol=0)
    assert scaled.abs().max() < 50  # numbers that hardly change do not explode


# Saving and loading.


def test_a_saved_policy_acts_the_same(policy, tmp_path):
    policy.eval()
    batch = observation(2)
    action = policy.select_action(batch)
    policy.save_pretrained(tmp_path)
    loaded = GCDTPolicy.from_pretrained(tmp_path)
    assert torch.equal(loaded.select_action(batch), action)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["config.json", "model.safetensors"]


def test_weights_that_do_not_fit_the_configuration_are_named(policy, tmp_path):
    policy.save_pretrained(tmp_path)
    config = GCDTConfig.from_pretrained(tmp_path)
    config.task_dims = {PICK: [20, 3, 5]}
    with pytest.raises(ValueError, match="do not fit"):
        GCDTPolicy.from_pretrained(tmp_path, config=config)


# Bad input.


def test_an_unknown_task_names_the_known_ones(policy):
    with pytest.raises(KeyError, match="(?s)Sew a button.*Pick up the needle"):
        policy.select_action(observation(1, task="Sew a button."))


def test_a_missing_observation_is_named(policy):
    with pytest.raises(KeyError, match=GOAL):
        policy.select_action({STATE: torch.zeros(1, 19), ACHIEVED_GOAL: torch.zeros(1, 3), "task": [PICK]})


def test_an_observation_of_another_size_names_both(policy):
    with pytest.raises(ValueError, match=r"(?s)\(1, 19\).*\(1, 7\)"):
        policy.select_action(observation(1, size=7))


def test_another_batch_size_without_reset_is_an_error(policy):
    policy.select_action(observation(2))
    with pytest.raises(ValueError, match="reset"):
        policy.select_action(observation(3))


def test_a_dataset_of_other_dimensions_is_named(tiny_config, needle_pick_meta):
    config = copy.deepcopy(tiny_config)
    config.task_dims = {PICK: [12, 3, 5]}
    with pytest.raises(ValueError, match=r"\[12, 3, 5\].*\[19, 3, 5\]"):
        GCDTPolicy(config, dataset_meta=needle_pick_meta)


def test_training_without_a_dataset_is_an_error(two_task_policy):
    with pytest.raises(RuntimeError, match="dataset_meta"):
        two_task_policy.forward({"index": torch.tensor([0])})


# Pretraining on several tasks.


@pytest.fixture
def pretraining(tiny_config, uneven_meta):
    torch.manual_seed(0)
    tiny_config.training_stage = "pretrain"
    return GCDTPolicy(tiny_config, dataset_meta=uneven_meta)


def test_a_merged_dataset_gives_every_task_its_natural_sizes(pretraining):
    assert pretraining.config.task_dims == {PICK: [19, 3, 5], REACH: [7, 3, 5]}
    assert pretraining.modules_of(REACH).dynamics_head.out_features == 7


@pytest.mark.parametrize("dropout, tuned", [(1.0, 2), (0.0, 1)])
def test_pretraining_logs_all_four_objectives_and_fine_tuning_those_it_acts_by(pretraining, dropout, tuned):
    pretraining.config.time_to_goal_dropout = dropout
    batch = {"index": torch.arange(0, 250, 30)}
    names = ["action_loss", "time_to_goal_loss", "dynamics_loss", "reconstruction_loss"]
    loss, log = pretraining.forward(batch)
    assert sorted(log) == sorted(names)
    assert loss.item() == pytest.approx(log["action_loss"] + 0.1 * sum(log[name] for name in names[1:]), rel=1e-5)
    pretraining.config.training_stage = "finetune"
    assert list(pretraining.forward(batch)[1]) == names[:tuned]


@pytest.mark.parametrize("name", ["dynamics", "time_to_goal", "reconstruction"])
def test_each_auxiliary_objective_can_be_left_out(pretraining, name):
    setattr(pretraining.config, f"{name}_weight", 0.0)
    log = pretraining.forward({"index": torch.arange(0, 250, 30)})[1]
    assert len(log) == 3 and f"{name}_loss" not in log


def test_what_is_drawn_for_a_batch_follows_from_its_frames_and_the_step(pretraining):
    def logged(index, step):
        pretraining.training_step.fill_(step)
        return pretraining.forward({"index": index})[1]

    index = torch.arange(0, 250, 30)
    assert logged(index, 3) == logged(index, 3)
    assert logged(index, 3) != logged(index, 4)
    assert logged(index, 3) != logged(index + 1, 3)


def test_every_training_step_counts_and_the_count_is_saved(pretraining, tmp_path):
    batch = {"index": torch.arange(0, 250, 30)}
    for expected, reduction in ((1, "mean"), (2, "none")):
        pretraining.forward(batch, reduction)
        assert pretraining.training_step == expected
    pretraining.eval().forward(batch)
    pretraining.save_pretrained(tmp_path)
    assert GCDTPolicy.from_pretrained(tmp_path).training_step == 2


def test_a_checkpoint_from_before_steps_were_counted_loads(pretraining, tmp_path):
    pretraining.save_pretrained(tmp_path)
    weights = load_file(tmp_path / "model.safetensors")
    del weights["training_step"]
    save_file(weights, tmp_path / "model.safetensors")
    assert GCDTPolicy.from_pretrained(tmp_path).training_step == 0


def test_everything_that_training_needs_moves_with_the_policy(pretraining):
    pretraining.to("meta")
    assert pretraining.action_sizes.is_meta
    bank = copy.copy(pretraining._bank).to("meta")
    assert bank.timestep.is_meta and all(value.is_meta for value in bank.items.values())


def test_tasks_whose_sentences_differ_in_punctuation_share_no_weights(tiny_config):
    tiny_config.task_dims = {PICK: [19, 3, 5], PICK.replace(".", "!"): [19, 3, 5]}
    policy = GCDTPolicy(tiny_config)
    assert policy.modules_of(0) is not policy.modules_of(1)


@pytest.mark.parametrize("dropout, idle", [(0.0, []), (1.0, ["timestep_embedding.weight"])])
def test_every_task_and_the_shared_weights_learn_from_one_batch(pretraining, dropout, idle):
    pretraining.config.time_to_goal_dropout = dropout
    pretraining.forward({"index": torch.arange(0, 250, 10)})[0].backward()
    without = [name for name, parameter in pretraining.named_parameters() if parameter.grad is None]
    assert without == idle


def test_fine_tuning_starts_from_the_pretrained_weights_of_backbone_and_task(pretraining, needle_pick_meta, tmp_path):
    pretraining.save_pretrained(tmp_path)
    config = GCDTConfig.from_pretrained(tmp_path)
    config.training_stage = "finetune"
    tuned = GCDTPolicy.from_pretrained(tmp_path, config=config, dataset_meta=needle_pick_meta)
    before, after = pretraining.state_dict(), tuned.state_dict()
    assert before.keys() == after.keys()
    assert all(torch.equal(value, after[key]) for key, value in before.items())
    assert list(tuned.train().forward({"index": torch.tensor([0])})[1]) == ["action_loss", "time_to_goal_loss"]


def test_a_checkpoint_without_a_head_names_it(pretraining, tmp_path):
    pretraining.save_pretrained(tmp_path)
    weights = load_file(tmp_path / "model.safetensors")
    lost = next(key for key in without_resting(weights) if "dynamics_head" in key)
    del weights[lost]
    save_file(weights, tmp_path / "model.safetensors")
    with pytest.raises(ValueError, match=lost.replace(".", r"\.")):
        GCDTPolicy.from_pretrained(tmp_path)
