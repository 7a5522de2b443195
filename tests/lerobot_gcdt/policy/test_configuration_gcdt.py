"""The configuration: saved and loaded without loss, bad values refused by name, optimiser as documented."""

import dataclasses
import itertools
import json

import draccus
import pytest
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.optim.optimizers import AdamWConfig

from lerobot_gcdt import GCDTConfig
from lerobot_gcdt.errors import OptionError


def cpu_config(**values) -> GCDTConfig:
    return GCDTConfig(device="cpu", push_to_hub=False, **values)


# Saving and loading.


def test_a_saved_configuration_loads_as_an_equal_one(tmp_path, tiny_config):
    tiny_config.task_dims = {"Pick up the needle.": [19, 3, 5], "Reach.": [7, 3, 5]}
    tiny_config.expected_steps = {"Pick up the needle.": 38.25, "Reach.": 20.0}
    tiny_config.hindsight_ratio = 0.75
    tiny_config.save_pretrained(tmp_path)
    assert PreTrainedConfig.from_pretrained(tmp_path) == tiny_config


def test_the_saved_file_names_the_policy_type(tmp_path, tiny_config):
    tiny_config.save_pretrained(tmp_path)
    assert json.loads((tmp_path / "config.json").read_text())["type"] == "gcdt"


def test_values_of_the_command_line_win_over_the_saved_ones(tmp_path, tiny_config):
    tiny_config.save_pretrained(tmp_path)
    loaded = PreTrainedConfig.from_pretrained(tmp_path, cli_overrides=["--dropout=0.25"])
    assert loaded == dataclasses.replace(tiny_config, dropout=0.25)


def test_the_command_line_takes_the_task_tables():
    config = draccus.parse(
        GCDTConfig, args=["--device=cpu", '--task_dims={"Reach.": [7, 3, 5]}', '--expected_steps={"Reach.": 20.5}']
    )
    assert config.task_dims == {"Reach.": [7, 3, 5]}
    assert config.expected_steps == {"Reach.": 20.5}


def test_two_configurations_share_no_table():
    first, second = cpu_config(), cpu_config()
    first.task_dims["Reach."] = [7, 3, 5]
    assert second.task_dims == {}


# Bad values.


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *((name, value) for name in ("layers", "heads", "width", "inner_width", "context_length") for value in (0, -1)),
        *((name, value) for name in ("dropout", "hindsight_ratio") for value in (-0.1, 1.5, float("nan"))),
        ("dtype", "float16"),
        ("optimizer_eps", 0),
    ],
)
def test_a_bad_value_is_one_error_that_names_it(name, value):
    with pytest.raises(OptionError, match=rf"policy\.{name}\b.*{value}"):
        cpu_config(**{name: value})


def test_a_width_that_the_heads_do_not_share_equally_is_an_error_that_names_both():
    with pytest.raises(OptionError, match=r"policy\.width.*30.*policy\.heads.*4"):
        cpu_config(width=30, heads=4)


@pytest.mark.parametrize("ratio", [0.0, 1.0])
def test_the_bounds_of_a_ratio_belong_to_it(ratio):
    assert cpu_config(hindsight_ratio=ratio).hindsight_ratio == ratio


# What LeRobot asks of it.


def test_the_loader_is_asked_for_single_frames():
    config = cpu_config()
    assert config.observation_delta_indices is None
    assert config.action_delta_indices is None
    assert config.reward_delta_indices is None


def test_the_optimiser_is_adamw_with_the_configured_values():
    preset = cpu_config(
        optimizer_lr=3e-4, optimizer_eps=1e-5, optimizer_weight_decay=0.02, optimizer_grad_clip_norm=0.7
    ).get_optimizer_preset()
    assert isinstance(preset, AdamWConfig)
    assert (preset.lr, preset.eps, preset.weight_decay, preset.grad_clip_norm) == (3e-4, 1e-5, 0.02, 0.7)


def test_gradients_after_far_smaller_ones_do_not_move_a_weight_far():
    weight = torch.nn.Parameter(torch.zeros(1))
    optimizer = cpu_config(optimizer_weight_decay=0.0).get_optimizer_preset().build([weight])
    places = [0.0]
    for gradient in [1e-9] * 1000 + [1e-7] * 20:
        weight.grad = torch.tensor([gradient])
        optimizer.step()
        places.append(weight.item())
    steps = [abs(after - before) for before, after in itertools.pairwise(places)]
    assert max(steps) < cpu_config().optimizer_lr, "PyTorch's own eps makes it three times as far"


def rates(config: GCDTConfig, steps: int) -> list[float]:
    """Learning rate of every step of a training."""
    optimizer = config.get_optimizer_preset().build([torch.nn.Parameter(torch.zeros(1))])
    scheduler = config.get_scheduler_preset().build(optimizer, steps)
    seen = []
    for _ in range(steps):
        seen.append(optimizer.param_groups[0]["lr"])
        optimizer.step()
        scheduler.step()
    return seen


def test_the_learning_rate_warms_up_to_its_peak_and_decays_to_a_hundredth():
    config = cpu_config(optimizer_lr=2e-3, scheduler_warmup_steps=100, scheduler_decay_steps=1_000)
    seen = rates(config, 1_000)
    peak = seen.index(max(seen))
    assert peak == pytest.approx(100, abs=1)
    assert seen[peak] == pytest.approx(2e-3, rel=0.05)
    assert all(a < b for a, b in zip(seen[:peak], seen[1 : peak + 1], strict=True))
    assert all(a >= b for a, b in zip(seen[peak:], seen[peak + 1 :], strict=False))
    assert seen[-1] == pytest.approx(2e-5, rel=0.05)


def test_a_short_training_shrinks_the_whole_schedule():
    long = rates(cpu_config(scheduler_warmup_steps=100, scheduler_decay_steps=1_000), 1_000)
    short = rates(cpu_config(scheduler_warmup_steps=100, scheduler_decay_steps=1_000), 100)
    assert short.index(max(short)) == pytest.approx(10, abs=1)
    assert short[-1] == pytest.approx(long[-1], rel=0.2)


def test_a_decay_of_zero_steps_keeps_the_learning_rate_constant():
    assert cpu_config(scheduler_decay_steps=0).get_scheduler_preset() is None
