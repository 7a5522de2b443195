"""What each type of policy is trained with in each stage, where nothing else is asked for."""

from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from lerobot.configs.policies import PreTrainedConfig
from lerobot.utils.import_utils import register_third_party_plugins

STAGES = ("pretrain", "generalist", "finetune", "scratch")
"""The second and the third begin with a checkpoint, the others with random weights; the first two are GCDT's."""


class Recipe(NamedTuple):
    """What a stage is trained with where nothing else is asked for; None for steps that have to be said."""

    steps: int | None
    batch_size: int
    options: tuple[str, ...] = ()


def _lerobots(
    steps: int, batch_size: int, normalisation: str, *settings: str, training: tuple[str, ...] = ()
) -> Recipe:
    """A recipe of one of LeRobot's policies, which leave the goal as it is unless they are told to normalise it.

    Goals may hold a constant, of which LeRobot's mean is rounded; divided by a deviation of 0 that would be hundreds.
    """
    modes = f'{{"STATE": "{normalisation}", "ENV": "MIN_MAX", "ACTION": "{normalisation}"}}'
    settings = (f"normalization_mapping={modes}", *settings)
    return Recipe(steps, batch_size, (*(f"--policy.{setting}" for setting in settings), *training))


def _cosine(peak_lr: float) -> tuple[str, ...]:
    """AdamW, a warm-up over a twentieth and a cosine decay to a hundredth, which LeRobot shrinks to any training."""
    return (
        *("--use_policy_training_preset=false", "--optimizer.type=adamw", f"--optimizer.lr={peak_lr}"),
        *("--optimizer.weight_decay=1e-4", "--scheduler.type=cosine_decay_with_warmup"),
        *("--scheduler.num_warmup_steps=50000", "--scheduler.num_decay_steps=1000000"),
        *(f"--scheduler.peak_lr={peak_lr}", f"--scheduler.decay_lr={peak_lr / 100}"),
    )


RECIPES = {
    # Ten tasks share the transformer, so it is wider than the default, which is for one.
    ("gcdt", "pretrain"): Recipe(
        20_000, 4, ("--policy.training_stage=pretrain", "--policy.width=192", "--policy.inner_width=768")
    ),
    ("gcdt", "generalist"): Recipe(30_000, 8, ("--policy.training_stage=finetune",)),
    # The full learning rate would undo what is learned.
    ("gcdt", "finetune"): Recipe(2_000, 4, ("--policy.training_stage=finetune", "--policy.optimizer_lr=5e-4")),
    ("gcdt", "scratch"): Recipe(12_000, 2),
    ("bc", "scratch"): Recipe(24_000, 4),
    ("dt", "scratch"): Recipe(10_000, 2),
    ("vinn", "scratch"): Recipe(1, 8),
    ("iql", "scratch"): Recipe(12_000, 4),
    # Within ±2, the default, it held .80 instead of .99 (examples/paper_table/notes.md).
    ("plas", "scratch"): Recipe(12_000, 4, ("--policy.max_latent=0.5",)),
    # Small enough for a few dozen numbers, and observed anew every second or two: LeRobot's settings are for pictures.
    ("act", "scratch"): _lerobots(
        *(5_000, 32, "MEAN_STD", "chunk_size=10", "n_action_steps=5", "dim_model=128", "n_heads=4"),
        *("dim_feedforward=512", "n_vae_encoder_layers=2", "dropout=0"),
        training=_cosine(5e-4),
    ),
    # Predicting the noise in 16 actions it held .08, predicting 8 actions .87 (examples/paper_table/notes.md).
    ("diffusion", "scratch"): _lerobots(
        *(5_000, 32, "MIN_MAX", "horizon=8", "n_action_steps=4", "drop_n_last_frames=3", "down_dims=[64,128]"),
        *("optimizer_lr=1e-3", "prediction_type=sample", "noise_scheduler_type=DDIM", "num_inference_steps=10"),
    ),
}
"""By type of policy and stage. The others are trained with LeRobot's settings, for as many steps as are said."""

EXTRAS = {"diffusion": "diffusers"}
"""Packages that types of policies need beside LeRobot, whose extra has the name of the type."""


def recipe(policy: str, stage: str, start: Path | None = None) -> Recipe:
    """Returns the settings of a stage.

    Raises:
        ValueError: There is no such policy, what it needs is not installed, or it has no such stage with this start or
            without one.
    """
    register_third_party_plugins()
    known = PreTrainedConfig.get_known_choices()
    if policy not in known:
        raise ValueError(f"Unknown policy type {policy!r}; choose one of {', '.join(sorted(known))}.")
    stages = STAGES if policy == "gcdt" else STAGES[2:]
    if stage not in stages:
        raise ValueError(f"A policy of type {policy} has no stage {stage!r}; choose one of {', '.join(stages)}.")
    goes_on = stage in STAGES[1:3]
    if goes_on != (start is not None):
        begins = "a checkpoint; add --start" if goes_on else "random weights; leave out --start"
        raise ValueError(f"The stage {stage} begins with {begins}.")
    if policy in EXTRAS and not find_spec(EXTRAS[policy]):
        raise ValueError(
            f"A policy of type {policy} needs {EXTRAS[policy]}, which is not installed: "
            f"`pip install 'lerobot[{policy}]'`."
        )
    return RECIPES.get((policy, stage), Recipe(None, 8))


def steps_to_train(policy: str, settings: Recipe, steps: int | None) -> int:
    """Returns the steps that are asked for, or else those of the settings.

    Raises:
        ValueError: Neither says how many, or they are not positive.
    """
    steps = settings.steps if steps is None else steps
    if steps is None:
        raise ValueError(f"How long a policy of type {policy} has to train is not known here; say it with --steps.")
    if steps < 1:
        raise ValueError(f"The number of steps must be positive, got {steps}.")
    return steps


def short_average(policy: str, steps: int) -> list[str]:
    """Returns options that let the average of a policy's weights forget those that it begins with, if it keeps one."""
    default = getattr(PreTrainedConfig.get_choice_class(policy), "average_steps", None)
    return [] if default is None else [f"--policy.average_steps={max(1, min(default, steps // 7))}"]
