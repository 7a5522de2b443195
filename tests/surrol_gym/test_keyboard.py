"""Pressed keys become actions."""

import numpy as np
import pytest

from surrol_gym.keyboard import FINE, SPEED, Hands
from surrol_gym.tasks.needle_pick import NeedlePickEnv
from surrol_gym.tasks.needle_regrasp import NeedleRegraspEnv


@pytest.fixture
def hands():
    return Hands(NeedlePickEnv)


@pytest.mark.parametrize(
    ("key", "place", "sign"),
    [("w", 0, -1), ("s", 0, 1), ("a", 1, -1), ("d", 1, 1), ("f", 2, -1), ("r", 2, 1), ("e", 3, -1), ("q", 3, 1)],
)
def test_a_key_moves_one_number(hands, key, place, sign):
    action = hands.act({key})
    assert np.flatnonzero(action[:4]) == place
    assert action[place] == pytest.approx(sign * SPEED)


def test_opposite_keys_cancel_each_other(hands):
    assert not hands.act({"w", "s"})[:4].any()


def test_shift_makes_motions_fine(hands):
    assert hands.act({"shift", "d"})[1] == pytest.approx(FINE)


def test_jaws_stay_as_they_were_told(hands):
    assert hands.act(set())[4] < 0
    assert hands.act({"v"})[4] > 0
    assert hands.act({"w"})[4] > 0
    assert hands.act({"c"})[4] < 0


def test_a_reset_closes_the_jaws(hands):
    hands.act({"v"})
    hands.reset()
    assert hands.act(set())[4] < 0


def test_keys_move_the_arm_that_was_chosen_last():
    hands = Hands(NeedleRegraspEnv)
    assert np.flatnonzero(hands.act({"w"}))[0] == 0
    chosen = hands.act({"2", "w", "v"})
    assert chosen[5] == pytest.approx(-SPEED) and chosen[9] > 0 and chosen[4] < 0
    assert hands.act({"w"})[5] == pytest.approx(-SPEED)
    assert hands.act({"1", "w"})[0] == pytest.approx(-SPEED)


def test_a_second_arm_that_is_not_there_cannot_be_chosen(hands):
    assert hands.act({"2", "w"}).shape == (5,)
    assert hands.act({"2", "w"})[0] == pytest.approx(-SPEED)
