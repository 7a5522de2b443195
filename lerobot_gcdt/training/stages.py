"""The stages of training, each one run of `lerobot-train` that can be interrupted and repeated."""

import json
import os
import shlex
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from lerobot.common.train_utils import get_step_checkpoint_dir, load_training_step, update_last_checkpoint
from lerobot.configs.parser import parse_arg
from lerobot.configs.policies import PreTrainedConfig
from lerobot.utils.constants import TRAINING_STATE_DIR, TRAINING_STEP
from lerobot.utils.device_utils import is_torch_device_available
from lerobot.utils.import_utils import register_third_party_plugins

from lerobot_gcdt.locking import alone_in
from lerobot_gcdt.training.beginnings import BEGINNING_FILE, check_same_beginning
from lerobot_gcdt.training.learned_data import DATASETS_FILE, fingerprint, noted_datasets
from lerobot_gcdt.training.outputs import LOSS_FILE, checkpoint, existing_checkpoint, trainer_folder
from lerobot_gcdt.training.whole_data import check_whole

STAGES = ("pretrain", "generalist", "finetune", "scratch")
"""The second and the third begin with a checkpoint, the others with random weights; the first two are GCDT's."""


SET_HERE = {"steps": "--steps", "output_dir": "--output", "dataset.root": "--dataset", "policy.path": "--start"}
"""Options of `lerobot-train` that ``train`` sets itself, and what says them instead."""


class Recipe(NamedTuple):
    """What a stage is trained with where nothing else is asked for; None for steps that have to be said."""

    steps: int | None
    batch_size: int
    options: tuple[str, ...] = ()


def _lerobots(steps: int, batch_size: int, normalisation: str, *options: str) -> Recipe:
    """A recipe of one of LeRobot's policies, which leave the goal as it is unless they are told to normalise it."""
    modes = ", ".join(f'"{kind}": "{normalisation}"' for kind in ("STATE", "ENV", "ACTION"))
    settings = (f"normalization_mapping={{{modes}}}", *options)
    return Recipe(steps, batch_size, tuple(f"--policy.{option}" for option in settings))


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
    ("dt", "scratch"): Recipe(5_000, 8),
    ("vinn", "scratch"): Recipe(1, 8),
    ("iql", "scratch"): Recipe(12_000, 4),
    ("plas", "scratch"): Recipe(12_000, 4),
    # Small enough for a few dozen numbers, and observed anew every second or two: LeRobot's settings are for pictures.
    ("act", "scratch"): _lerobots(
        *(5_000, 32, "MEAN_STD", "chunk_size=10", "n_action_steps=5", "dim_model=128", "n_heads=4"),
        *("dim_feedforward=512", "n_vae_encoder_layers=2", "optimizer_lr=5e-4"),
    ),
    ("diffusion", "scratch"): _lerobots(
        *(5_000, 32, "MIN_MAX", "horizon=16", "n_action_steps=8", "down_dims=[64,128]", "optimizer_lr=5e-4"),
        *("noise_scheduler_type=DDIM", "num_inference_steps=10"),
    ),
}
"""By type of policy and stage. The others are trained with LeRobot's settings, for as many steps as are said."""

EXTRAS = {"diffusion": "diffusers"}
"""Packages that types of policies need beside LeRobot, whose extra has the name of the type."""


def train(
    dataset: str | Path,
    output: str | Path,
    policy: str | None = None,
    stage: str | None = None,
    start: str | Path | None = None,
    steps: int | None = None,
    device: str | None = None,
    launcher: str | None = None,
    options: Sequence[str] = (),
) -> Path:
    """Trains a policy with `lerobot-train`, or goes on where an earlier call was interrupted.

    Args:
        dataset: Folder of the dataset.
        output: Folder of the checkpoints and of the losses (``loss_curve``).
        policy: Type of the policy: ``"gcdt"``, a baseline such as ``"bc"``, or one of LeRobot's. None for that of
            ``start``, or ``"gcdt"``.
        stage: ``"pretrain"``: all objectives, usually on many tasks; ``"generalist"``: actions only, on the same;
            ``"finetune"``: actions only, on one task; ``"scratch"``: from random weights. None for ``"finetune"`` where
            there is a start, and else ``"scratch"``.
        start: Training, or folder of a checkpoint, to begin with.
        steps: Optimiser steps of the whole training. None for those of ``RECIPES``.
        device: Where to train, such as ``"cuda"``. None for LeRobot's choice.
        launcher: Command that runs a module, such as ``"accelerate launch --num_processes=4 -m"``. None to train in
            this process.
        options: Further arguments of `lerobot-train` but those of ``SET_HERE``; they win over those of ``RECIPES``. A
            training that goes on keeps the settings of its beginning, but for the steps and what has no part in what is
            learned, such as ``--save_freq``.

    Returns:
        Folder of the last checkpoint.

    Raises:
        FileNotFoundError: There is no dataset, no checkpoint to start from, or no such launcher.
        ValueError: The dataset is not whole, the device, the policy or the stage is unknown, they do not go together,
            the steps have to be said, an option is one that is set here or that LeRobot or the policy refuses, or the
            output folder holds something else, a training on other data, of another stage, from another start or with
            other settings, or of the last checkpoint a copy instead of the link to it or no training state.
        OSError: Another process trains in the output folder.
        RuntimeError: The launcher ended with an error.
    """
    dataset, output = Path(dataset), Path(output)
    refuse_options(options, SET_HERE)
    if not (dataset / "meta/info.json").exists():
        raise FileNotFoundError(f"{dataset} holds no dataset; `gcdt record --task TASK --root {dataset}` records one.")
    if start is not None:
        start = existing_checkpoint(start)
        found = policy_type(start)
        if policy not in (None, found):
            raise ValueError(f"{start} is a policy of type {found}, not {policy}.")
        policy = found
    policy = policy or "gcdt"
    stage = stage or ("finetune" if start else "scratch")
    settings = recipe(policy, stage, start)
    steps = steps_to_train(policy, settings, steps)
    for chosen in (device, parse_arg("policy.device", options)):
        if chosen:
            is_torch_device_available(chosen)  # raises for one that it does not know; LeRobot then hides its message
    check_whole(dataset)
    if device:
        options = [f"--policy.device={device}", *options]
    beginning = [
        f"--policy.path={start}" if start else f"--policy.type={policy}",
        *settings.options,
        *(_short_average(policy, steps) if start else ()),
        "--policy.push_to_hub=false",
        f"--dataset.repo_id=local/{dataset.name}",
        f"--batch_size={settings.batch_size}",
        f"--save_freq={max(500, steps // 40)}",
        f"--log_freq={max(1, steps // 80)}",
        "--num_workers=0",
        *options,
    ]
    there = output.resolve()
    # Beside the folder, because LeRobot begins no training in one that exists.
    with alone_in(there.with_name(f"{there.name}.training"), "--output"):
        with alone_in(trainer_folder(output), "--output"):
            pass  # a trainer may go on after the command that launched it was killed
        arguments = _arguments_to_reach(steps, output, beginning, policy, dataset, stage, start, options)
        if arguments is None:
            print(f"{output} is complete already.")
        else:
            print("lerobot-train \\\n  " + " \\\n  ".join(map(shlex.quote, arguments)), flush=True)
            _run(arguments, output / LOSS_FILE, stage, launcher)
    return checkpoint(output)


def _short_average(policy: str, steps: int) -> list[str]:
    """Lets the average of a policy's weights forget those that it begins with, if it keeps one."""
    default = getattr(PreTrainedConfig.get_choice_class(policy), "average_steps", None)
    return [] if default is None else [f"--policy.average_steps={max(1, min(default, steps // 7))}"]


def _arguments_to_reach(
    steps: int,
    output: Path,
    beginning: list[str],
    policy: str,
    dataset: Path,
    stage: str,
    start: Path | None,
    options: Sequence[str],
) -> list[str] | None:
    """Arguments that begin a training or go on with it; None where nothing is left to do."""
    checkpoints = output / "checkpoints"
    last = checkpoints / "last"
    common = [f"--dataset.root={dataset}", f"--steps={steps}", f"--output_dir={output}"]
    if not last.exists() and (
        whole := sorted(filter(_is_whole, checkpoints.glob("*")), key=lambda saved: int(saved.name))
    ):
        update_last_checkpoint(whole[-1])  # copies may lose the link, and LeRobot removes it before it makes another
    if not last.exists():
        if output.exists():
            if not all(map(_is_leftover, output.iterdir())):
                raise ValueError(
                    f"{output} exists and holds no checkpoint that lerobot-train could go on with; choose another "
                    "--output."
                )
            shutil.rmtree(output)  # an earlier run ended before its first checkpoint
        return [*beginning, *common]
    config = last / "pretrained_model/train_config.json"
    settings = json.loads(config.read_text())
    held, wanted = (settings["policy"]["type"], settings["dataset"]["repo_id"]), (policy, f"local/{dataset.name}")
    if held != wanted:
        raise ValueError(
            f"{output} holds a training of {' on '.join(held)}, not of {' on '.join(wanted)}; choose another --output."
        )
    # A training of before there were notes is on whatever lies where its data did.
    before = noted_datasets(output).get(dataset.name) or fingerprint(Path(settings["dataset"]["root"] or dataset))
    if before and before != fingerprint(dataset):
        raise ValueError(f"{output} holds a training on other data than those in {dataset}; choose another --output.")
    check_same_beginning(output, stage, start)
    if options:
        from lerobot_gcdt.training.trainer import check_same_settings  # here, for the reason in _run

        check_same_settings(config, options)
    step = _step(last)
    if step >= steps:
        return None
    if not (state := last / TRAINING_STATE_DIR / TRAINING_STEP).exists():
        raise ValueError(
            f"{state} is missing, without which lerobot-train cannot go on to step {steps}; choose another --output, "
            f"or remove {output} to begin anew."
        )
    if not last.is_symlink():
        numbered = get_step_checkpoint_dir(output, settings["steps"], step)
        remedy = f"rm -r {last}" if numbered.exists() else f"mv {last} {numbered}"
        raise ValueError(f"{last} is a folder, where lerobot-train keeps a link; `{remedy}`, and repeat the command.")
    # Among the options may be a plugin, which no checkpoint names.
    return [f"--config_path={config}", "--resume=true", *options, *common]


def _step(saved: Path) -> int:
    """The step of a checkpoint, that of its name where somebody removed its training state to save space, or else 0."""
    state, name = saved / TRAINING_STATE_DIR, saved.resolve().name
    if (state / TRAINING_STEP).exists():
        return load_training_step(state)
    return int(name) if name.isdigit() else 0


def refuse_options(options: Sequence[str], set_here: Mapping[str, str]) -> None:
    """Raises ValueError for an option of `lerobot-train` that would be overridden, with what says it instead."""
    for option in options:
        name = option.partition("=")[0]
        if name.startswith("--") and (ours := set_here.get(name.removeprefix("--"))):
            raise ValueError(f"{option} of lerobot-train is set by gcdt; say it with {ours} of gcdt's own.")


def policy_type(checkpoint: Path) -> str:
    """Returns the type of the policy in a checkpoint's folder, such as ``"gcdt"``."""
    return json.loads((checkpoint / "config.json").read_text())["type"]


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


def _is_leftover(file: Path) -> bool:
    """Whether a file may be of a training that ended before its first checkpoint was whole."""
    if file.name == "checkpoints":
        parts = [part.name for part in file.iterdir()]
        return len(parts) <= 1 and all(map(str.isdigit, parts))
    return file.name in (LOSS_FILE, DATASETS_FILE, BEGINNING_FILE)


def _is_whole(saved: Path) -> bool:
    """Whether a folder is a checkpoint with all that a training goes on with, which LeRobot writes in this order."""
    config, state = saved / "pretrained_model/train_config.json", saved / "training_state"
    if not saved.name.isdigit() or not (state / "optimizer_param_groups.json").exists():
        return False
    return not json.loads(config.read_text())["scheduler"] or (state / "scheduler_state.json").exists()


def _run(arguments: Sequence[str], losses: Path, stage: str, launcher: str | None) -> None:
    if launcher is None:
        from lerobot_gcdt.training.trainer import run  # here, because a launcher has to be the first to import it

        run(arguments, losses, stage)
        return
    command = [*shlex.split(launcher), "lerobot_gcdt.training.trainer", str(losses), stage, *arguments]
    # Threads that wait busily for each other make a training beside other work take up to 40 times as long.
    status = subprocess.run(command, env={"OMP_WAIT_POLICY": "passive"} | os.environ).returncode
    if status:
        raise RuntimeError(f"{launcher} ended with status {status}; repeat the command to go on.")
