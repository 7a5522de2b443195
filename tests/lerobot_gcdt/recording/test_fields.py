"""Fields of one's own that do not keep to the contract: one error that names the field, and nothing is written."""

import gymnasium as gym
import numpy as np
import pytest

from lerobot_gcdt.keys import COLUMNS, STATE
from lerobot_gcdt.recording import record
from lerobot_gcdt.recording.features import NO_EXTRAS, Extras, describe_columns
from lerobot_gcdt.recording.fields import FIELDS, Field, observe_field


def vector(*numbers):
    return np.array(numbers, dtype=np.float32)


def field(key, observed, names=("a",)):
    """A field of one column."""
    return Field(lambda env_class: {key: dict.fromkeys(names, "x")}, lambda env: observed)


def refused(monkeypatch, tmp_path, **fields):
    """What a recording with these fields is refused with."""
    for name, given in fields.items():
        monkeypatch.setitem(FIELDS, name, given)
    with pytest.raises(ValueError) as error:
        record("NeedleReach", 1, 0, tmp_path / "reach", extras=Extras([*fields]))
    assert not list(tmp_path.iterdir())
    return str(error.value)


W = "observation.w"


@pytest.mark.parametrize(
    ("observed", "told"),
    [
        ({W: vector(1, 2)}, "shape (1,), got float32 of shape (2,)"),
        ({W: np.array([1.0])}, "float32 array of shape (1,), got float64 of shape (1,)"),
        ({W: np.array([None])}, "got object of shape (1,)"),
        ({W: 0.5}, "got 0.5"),
        ({W: vector(np.nan)}, "not finite: [nan]"),
        ({}, "describes observation.w, but its observe returns "),
        ({W: vector(1), "more": vector(1)}, "returns observation.w, more"),
        (None, "returns None"),
    ],
    ids=["two numbers", "float64", "objects", "a float", "nan", "no column", "a column more", "nothing"],
)
def test_what_is_observed_must_be_what_is_described(observed, told, monkeypatch, tmp_path):
    line = refused(monkeypatch, tmp_path, wrong=field(W, observed))
    assert "field 'wrong'" in line and told in line


def test_a_number_that_is_not_finite_is_noticed_at_any_moment(monkeypatch):
    moments = iter([vector(1), vector(np.inf)])
    monkeypatch.setitem(FIELDS, "late", Field(lambda env_class: {W: {"a": "x"}}, lambda env: {W: next(moments)}))
    with gym.make("surrol/NeedleReach-v0") as env:
        observe_field("late", env.unwrapped)
        with pytest.raises(ValueError, match="'late' observes .* not finite"):
            observe_field("late", env.unwrapped)


@pytest.mark.parametrize("key", [STATE, "next.success", "index", "task", "reward", "observation.images.x"])
def test_a_field_has_no_column_that_datasets_hold_already(key, monkeypatch, tmp_path):
    line = refused(monkeypatch, tmp_path, taking=field(key, {key: vector(1)}))
    assert f"'taking' describes {key}, which datasets hold already" in line


def test_two_fields_do_not_share_a_column(monkeypatch, tmp_path):
    line = refused(monkeypatch, tmp_path, one=field(W, {W: vector(1)}), two=field(W, {W: vector(2)}))
    assert "'one' and 'two' both describe observation.w" in line


@pytest.mark.parametrize(("key", "names"), [("observation/w", ["a"]), (W, [])], ids=["slash", "no numbers"])
def test_a_column_has_a_name_that_lerobot_takes_and_numbers(key, names, monkeypatch, tmp_path):
    assert f"'odd' describes {key!r} without" in refused(monkeypatch, tmp_path, odd=field(key, {key: vector()}, names))


def test_the_columns_that_fields_may_not_have_are_those_of_every_dataset():
    with gym.make("surrol/NeedleReach-v0") as env:
        assert describe_columns(env, NO_EXTRAS).keys() == set(COLUMNS)
