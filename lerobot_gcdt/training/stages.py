"""The stages of training, each one run of `lerobot-train` that can be interrupted and repeated."""

import json
import os
import shlex
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from lerobot.configs.parser import parse_arg
from lerobot.utils.device_utils import is_torch_device_available

from lerobot_gcdt.locking import alone_in
from lerobot_gcdt.training.going_on import Asked, arguments_to_reach
from lerobot_gcdt.training.outputs import LOSS_FILE, checkpoint, existing_checkpoint, trainer_folder
from lerobot_gcdt.training.recipes import recipe, short_average, steps_to_train
from lerobot_gcdt.training.whole_data import check_whole

SET_HERE = {"steps": "--steps", "output_dir": "--output", "dataset.root": "--dataset", "policy.path": "--start"}
"""Options of `lerobot-train` that ``train`` sets itself, and what says them instead."""


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
        steps: Optimiser steps of the whole training. None for those of its recipe.
        device: Where to train, such as ``"cuda"``. None for LeRobot's choice.
        launcher: Command that runs a module, such as ``"accelerate launch --num_processes=4 -m"``. None to train in
            this process.
        options: Further arguments of `lerobot-train` but those of ``SET_HERE``; they win over those of
            the recipe. A
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
    first = [
        f"--policy.path={start}" if start else f"--policy.type={policy}",
        *settings.options,
        *(short_average(policy, steps) if start else ()),
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
        arguments = arguments_to_reach(Asked(dataset, output, policy, stage, start, steps, options), first)
        if arguments is None:
            print(f"{output} is complete already.")
        else:
            print("lerobot-train \\\n  " + " \\\n  ".join(map(shlex.quote, arguments)), flush=True)
            _run(arguments, output / LOSS_FILE, stage, launcher)
    return checkpoint(output)


def refuse_options(options: Sequence[str], set_here: Mapping[str, str]) -> None:
    """Raises ValueError for an option of `lerobot-train` that would be overridden, with what says it instead."""
    for option in options:
        name = option.partition("=")[0]
        if name.startswith("--") and (ours := set_here.get(name.removeprefix("--"))):
            raise ValueError(f"{option} of lerobot-train is set by gcdt; say it with {ours} of gcdt's own.")


def policy_type(checkpoint: Path) -> str:
    """Returns the type of the policy in a checkpoint's folder, such as ``"gcdt"``."""
    return json.loads((checkpoint / "config.json").read_text())["type"]


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
