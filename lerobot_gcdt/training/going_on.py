"""How a training that was interrupted goes on, and what is refused as another one than that in its folder."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from lerobot.common.train_utils import get_step_checkpoint_dir, load_training_step, update_last_checkpoint
from lerobot.utils.constants import TRAINING_STATE_DIR, TRAINING_STEP

from lerobot_gcdt.training.beginnings import BEGINNING_FILE, check_same_beginning
from lerobot_gcdt.training.learned_data import DATASETS_FILE, fingerprint, noted_datasets
from lerobot_gcdt.training.outputs import LOSS_FILE


class Asked(NamedTuple):
    """The training that is asked for, as ``lerobot_gcdt.training.train`` takes it."""

    dataset: Path
    output: Path
    policy: str
    stage: str
    start: Path | None
    steps: int
    options: Sequence[str]


def arguments_to_reach(asked: Asked, first: Sequence[str]) -> list[str] | None:
    """Returns the arguments of `lerobot-train` that begin a training or go on with it.

    Args:
        asked: The training.
        first: Arguments that it begins with, where there is no checkpoint of it yet.

    Returns:
        The arguments; None where nothing is left to do.

    Raises:
        ValueError: The output folder holds something else or another training, or not all that it would go on with.
    """
    common = [f"--dataset.root={asked.dataset}", f"--steps={asked.steps}", f"--output_dir={asked.output}"]
    last = _restored_last(asked.output / "checkpoints")
    if not last.exists():
        _clear(asked.output)
        return [*first, *common]
    config = last / "pretrained_model/train_config.json"
    settings = json.loads(config.read_text())
    _check_same(asked, config, settings)
    if _step(last) >= asked.steps:
        return None
    _check_state(asked, last, settings)
    # Among the options may be a plugin, which no checkpoint names.
    return [f"--config_path={config}", "--resume=true", *asked.options, *common]


def _restored_last(checkpoints: Path) -> Path:
    """The link to the last checkpoint, which copies may lose, and which LeRobot removes before it makes another."""
    last = checkpoints / "last"
    if not last.exists():
        whole = sorted(filter(_is_whole, checkpoints.glob("*")), key=lambda saved: int(saved.name))
        if whole:
            update_last_checkpoint(whole[-1])
    return last


def _clear(output: Path) -> None:
    """Removes what an earlier run left that ended before its first checkpoint; ValueError for anything else."""
    if not output.exists():
        return
    if not all(map(_is_leftover, output.iterdir())):
        raise ValueError(
            f"{output} exists and holds no checkpoint that lerobot-train could go on with; choose another --output."
        )
    shutil.rmtree(output)


def _check_same(asked: Asked, config: Path, settings: dict[str, Any]) -> None:
    """Raises ValueError unless the training with these settings is the one that is asked for."""
    output, dataset = asked.output, asked.dataset
    held = settings["policy"]["type"], settings["dataset"]["repo_id"]
    wanted = asked.policy, f"local/{dataset.name}"
    if held != wanted:
        raise ValueError(
            f"{output} holds a training of {' on '.join(held)}, not of {' on '.join(wanted)}; choose another --output."
        )
    # A training of before there were notes is on whatever lies where its data did.
    before = noted_datasets(output).get(dataset.name) or fingerprint(Path(settings["dataset"]["root"] or dataset))
    if before and before != fingerprint(dataset):
        raise ValueError(f"{output} holds a training on other data than those in {dataset}; choose another --output.")
    check_same_beginning(output, asked.stage, asked.start)
    if asked.options:
        from lerobot_gcdt.training.trainer import check_same_settings  # here, for the reason in stages.py

        check_same_settings(config, asked.options)


def _check_state(asked: Asked, last: Path, settings: dict[str, Any]) -> None:
    """Raises ValueError, with the way out, where the last checkpoint is not as LeRobot needs it to go on."""
    if not (state := last / TRAINING_STATE_DIR / TRAINING_STEP).exists():
        raise ValueError(
            f"{state} is missing, without which lerobot-train cannot go on to step {asked.steps}; choose another "
            f"--output, or remove {asked.output} to begin anew."
        )
    if not last.is_symlink():
        numbered = get_step_checkpoint_dir(asked.output, settings["steps"], _step(last))
        remedy = f"rm -r {last}" if numbered.exists() else f"mv {last} {numbered}"
        raise ValueError(f"{last} is a folder, where lerobot-train keeps a link; `{remedy}`, and repeat the command.")


def _step(saved: Path) -> int:
    """The step of a checkpoint, that of its name where somebody removed its training state to save space, or else 0."""
    state, name = saved / TRAINING_STATE_DIR, saved.resolve().name
    if (state / TRAINING_STEP).exists():
        return load_training_step(state)
    return int(name) if name.isdigit() else 0


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
