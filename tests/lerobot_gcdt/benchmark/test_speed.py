"""The benchmark prints its ratios; what they are depends on the machine."""

import re

import pytest

from lerobot_gcdt.benchmark.speed import measure
from lerobot_gcdt.precision import faster_precision


@pytest.fixture(scope="module")
def lines(needle_pick_root):
    return measure(needle_pick_root, "cpu", 100, rounds=1)


def test_every_figure_is_printed(lines):
    assert [re.sub(r"[\d.]+", "#", line.split(":")[0]) for line in lines] == [
        "training step of # episodes (# steps)",
        "training step in bfloat# / in float#",
        "training step / transformer alone on the same tokens",
        "data and relabelling / training step",
        "real tokens / computed tokens",
        "training step with LeRobot's windows of # steps / with the bank",
        "LeRobot's windows / the same from memory",
        "select_action at step #",
    ]
    assert all(float(number) > 0 for line in lines for number in re.findall(r": ([\d.]+)", line))


def test_the_precision_that_auto_chooses_is_named(lines):
    assert lines[1].endswith(f"policy.dtype=auto chooses {str(faster_precision('cpu')).removeprefix('torch.')}")


def test_computed_tokens_are_mostly_real(lines):
    assert 0.8 <= float(lines[4].split()[-1]) <= 1
