"""The precision of training: measured, and bfloat16 only where it clearly pays."""

import logging
from contextlib import nullcontext

import pytest
import torch

from lerobot_gcdt import precision


@pytest.fixture(autouse=True)
def _forgotten():
    precision.faster_precision.cache_clear()
    yield
    precision.faster_precision.cache_clear()


@pytest.mark.parametrize("bfloat16_ms, chosen", [(0.5, "bfloat16"), (0.95, "float32"), (20.0, "float32")])
def test_bfloat16_is_chosen_where_it_is_clearly_faster_and_the_choice_is_logged(
    monkeypatch, caplog, bfloat16_ms, chosen
):
    times = {torch.float32: 1.0, torch.bfloat16: bfloat16_ms}
    monkeypatch.setattr(precision, "step_times", lambda device: times)
    with caplog.at_level(logging.INFO):
        assert precision.faster_precision("cpu") == getattr(torch, chosen)
    [line] = [record.getMessage() for record in caplog.records if "policy.dtype=auto" in record.getMessage()]
    assert f"training in {chosen}" in line and f"{bfloat16_ms:.2g} times" in line


def test_timing_takes_both_and_leaves_threads_and_random_numbers_alone():
    threads, state = torch.get_num_threads(), torch.get_rng_state()
    times = precision.step_times("cpu", trials=1)
    assert set(times) == {torch.float32, torch.bfloat16} and all(0 < time < 60 for time in times.values())
    assert torch.get_num_threads() == threads and torch.equal(torch.get_rng_state(), state)


def test_timing_waits_for_any_accelerator(monkeypatch):
    waited = []
    monkeypatch.setattr(torch, "autocast", lambda *_, **__: nullcontext())  # the device of these tensors has none
    monkeypatch.setattr(torch.accelerator, "synchronize", lambda: waited.append(None))
    precision.step_times("meta", trials=1)
    assert len(waited) == 4
