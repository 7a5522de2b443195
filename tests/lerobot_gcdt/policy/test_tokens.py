"""Tokenizers and heads of a task."""

import pytest
import torch

from lerobot_gcdt.data.statistics import SMALLEST_STD
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, GOAL, STATE, TIME_TO_GOAL
from lerobot_gcdt.policy.tokens import ORDER, ItemTokenizer, TaskModules, module_names


def test_the_tokens_of_a_step_come_in_the_papers_order():
    assert ORDER == (TIME_TO_GOAL, GOAL, STATE, ACTION)


def test_tokens_are_layer_normalised():
    tokens = ItemTokenizer(3, 16)(torch.randn(5, 3))
    torch.testing.assert_close(tokens.mean(-1), torch.zeros(5), atol=1e-5, rtol=0)
    torch.testing.assert_close(tokens.var(-1, unbiased=False), torch.ones(5), atol=1e-2, rtol=0)


def test_fitting_makes_scale_and_offset_of_the_items_irrelevant():
    torch.manual_seed(0)
    plain, scaled = ItemTokenizer(2, 8), ItemTokenizer(2, 8)
    scaled.load_state_dict(plain.state_dict())
    items = torch.randn(100, 2)
    plain.fit(items)
    scaled.fit(1000 * items + 5)
    torch.testing.assert_close(plain(items), scaled(1000 * items + 5), atol=1e-3, rtol=1e-3)


def test_numbers_that_hardly_vary_are_not_blown_up():
    tokenizer = ItemTokenizer(2, 8)
    tokenizer.fit(torch.tensor([[7.0, 0.0], [7.0, 1e-4]]))
    assert tokenizer.mean.tolist() == pytest.approx([7, 5e-5])
    assert tokenizer.std.tolist() == pytest.approx([SMALLEST_STD, SMALLEST_STD])


def test_numbers_beyond_the_size_are_padding():
    tokenizer, items = ItemTokenizer(3, 8), torch.randn(4, 5)
    assert torch.equal(tokenizer(items), tokenizer(items[:, :3]))


def test_actions_are_bounded():
    actions = TaskModules([7, 3, 5], 8).predict_action(100 * torch.randn(50, 8))
    assert actions.shape == (50, 5)
    assert actions.abs().max() <= 1


@pytest.mark.parametrize("key", ORDER)
def test_every_kind_of_item_becomes_a_token(key):
    items = {TIME_TO_GOAL: torch.randn(6, 1), STATE: torch.randn(6, 7), ACTION: torch.randn(6, 5)}
    items |= {GOAL: torch.randn(6, 3), ACHIEVED_GOAL: torch.randn(6, 3)}
    assert TaskModules([7, 3, 5], 8).tokenize(key, items).shape == (6, 8)


def test_a_relative_goal_token_holds_what_is_left_to_the_goal():
    goal = {GOAL: torch.randn(4, 3), ACHIEVED_GOAL: torch.randn(4, 3)}
    elsewhere = goal | {ACHIEVED_GOAL: torch.randn(4, 3)}
    relative, absolute = TaskModules([7, 3, 5], 8), TaskModules([7, 3, 5], 8, relative_goal=False)
    assert not torch.equal(relative.tokenize(GOAL, goal), relative.tokenize(GOAL, elsewhere))
    assert torch.equal(absolute.tokenize(GOAL, goal), absolute.tokenize(GOAL, elsewhere))


@pytest.mark.parametrize("key", ORDER)
def test_a_target_is_the_standardised_item_alone(key):
    items = {TIME_TO_GOAL: torch.randn(6, 1), STATE: torch.randn(6, 7), ACTION: torch.randn(6, 5)}
    items |= {GOAL: torch.randn(6, 3), ACHIEVED_GOAL: torch.randn(6, 3)}
    modules = TaskModules([7, 3, 5], 8)
    modules.fit(items)
    expected = items[key] if key == ACTION else (items[key] - items[key].mean(0)) / items[key].std(0)
    torch.testing.assert_close(modules.target(key, items), expected)


def test_sentences_become_module_names():
    assert module_names(["Pick up the needle, twice."]) == {"Pick up the needle, twice.": "pick_up_the_needle_twice"}


def test_sentences_that_differ_in_punctuation_have_modules_of_their_own():
    names = module_names(["Pick it up.", "Pick it up!", "pick it up"])
    assert names["Pick it up."] == "pick_it_up" and len(set(names.values())) == 3


@pytest.mark.parametrize("sentence", ["缝合伤口。", "Pop.", "..."])
def test_any_sentence_becomes_a_name_that_a_module_may_have(sentence):
    [name] = module_names([sentence]).values()
    torch.nn.ModuleDict({name: torch.nn.Identity()})
