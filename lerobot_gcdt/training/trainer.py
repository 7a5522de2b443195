"""LeRobot's trainer, with its losses in a file; also what a launcher runs, in one process or several:

accelerate launch --num_processes=4 -m lerobot_gcdt.training.trainer LOSS_FILE STAGE ARGUMENTS_OF_LEROBOT_TRAIN
"""

import io
import logging
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr
from pathlib import Path
from typing import Any

from draccus.utils import DecodingError, ParsingError
from lerobot.common.train_utils import load_training_step
from lerobot.configs import parser
from lerobot.configs.train import TrainPipelineConfig
from lerobot.scripts import lerobot_train
from lerobot.utils.import_utils import get_safe_default_video_backend
from lerobot.utils.logging_utils import MetricsTracker

from lerobot_gcdt.locking import alone_in
from lerobot_gcdt.training.beginnings import beginning, note_beginning
from lerobot_gcdt.training.learned_data import fingerprint, note_datasets
from lerobot_gcdt.training.outputs import loss_curve, trainer_folder, training_seconds
from lerobot_gcdt.training.windows import windows_from_memory

FIRST_STEP = "Start offline training"
"""What LeRobot logs when everything is prepared; were it not found, a second or two of that would count as training."""

MAY_CHANGE = (
    *("log_freq", "save_", "eval", "env", "max_eval_samples", "num_workers", "prefetch_factor", "persistent_workers"),
    *("job", "wandb.", "policy.device"),
    *("policy.push_to_hub", "policy.repo_id", "policy.private", "policy.tags", "policy.license"),
)
"""What settings begin with that have no part in what is learned: a training may go on with others."""

CHECKPOINT = "Checkpoint policy after step"
"""What LeRobot logs before it writes a checkpoint; were it not found, other data or stages would not be noticed."""

DECODERS = logging.getLogger(get_safe_default_video_backend.__module__)
"""Tells in a hundred lines that FFmpeg is missing, twice a training, whether or not a dataset has films."""


def run(arguments: Sequence[str], losses: Path, stage: str) -> None:
    """Runs `lerobot-train` in this process, and notes beside the first checkpoint its data and what it began with.

    Args:
        arguments: Of `lerobot-train`, with ``--dataset.root=FOLDER``.
        losses: File that a row is added to whenever LeRobot logs (``lerobot_gcdt.training.outputs.LOSS_FILE``); only
            one of several processes does.
        stage: The stage of the training, which is noted.

    Raises:
        ValueError: LeRobot or the policy refuses an option after the command line was read.
    """
    last = losses.parent / "checkpoints/last"
    before = training_seconds(losses.parent, load_training_step(last / "training_state")) if last.exists() else 0.0
    timed = not losses.exists() or "seconds" in loss_curve(losses.parent)
    begun = _clocks()
    dataset = Path(parser.parse_arg("dataset.root", arguments))
    data = {dataset.name: fingerprint(dataset)}
    goes_on = parser.parse_arg("resume", arguments)
    begins = None if goes_on else beginning(stage, parser.parse_arg("policy.path", arguments))

    def keep_row(message: logging.LogRecord) -> bool:
        nonlocal begun
        if isinstance(message.msg, MetricsTracker):
            row = message.msg.to_dict()
            clock = "cpu" if message.msg.accelerator.device.type == "cpu" else "wall"
            seconds = f",{before + _clocks()[clock] - begun[clock]:.3f}" if timed else ""
            losses.parent.mkdir(parents=True, exist_ok=True)
            header = "" if losses.exists() else "step,loss,seconds\n"
            with losses.open("a") as stream:
                stream.write(f"{header}{row['steps']},{row['loss']}{seconds}\n")
        elif str(message.msg).startswith(FIRST_STEP):
            begun = _clocks()
        elif str(message.msg).startswith(CHECKPOINT):
            note_datasets(losses.parent, data)
            if begins:
                note_beginning(losses.parent, begins)
        return True

    logger = logging.getLogger()
    logger.addFilter(keep_row)
    try:
        with _command_line(arguments), windows_from_memory():
            lerobot_train.main()
    finally:
        logger.removeFilter(keep_row)


def check_options(arguments: Sequence[str]) -> None:
    """Raises ValueError, with LeRobot's message, unless `lerobot-train` takes these arguments."""
    _settings(arguments)


def check_same_settings(config: Path, options: Sequence[str]) -> None:
    """Raises ValueError if options would change what a training learns.

    Args:
        config: Its settings, `train_config.json`.
        options: Arguments of `lerobot-train`.
    """
    saved = [f"--config_path={config}", "--resume=true"]
    wanted = _settings([*saved, *options])  # first, because options may name the plugin of which settings are
    held = _settings(saved)
    differ = sorted(
        name
        for name in held.keys() | wanted.keys()
        if held.get(name) != wanted.get(name) and not name.startswith(MAY_CHANGE)
    )
    if differ:
        told = ", ".join(f"{name}={held.get(name)} (not {wanted.get(name)})" for name in differ)
        raise ValueError(
            f"The training in {config.parents[3]} was begun with {told}; leave these options out, or choose another "
            "--output."
        )


def _settings(arguments: Sequence[str]) -> dict[str, Any]:
    """Returns the settings of `lerobot-train` that arguments stand for, by names such as ``policy.layers``."""

    @parser.wrap()
    def read(config: TrainPipelineConfig) -> dict[str, Any]:
        return config.to_dict()

    with _command_line(arguments), redirect_stderr(io.StringIO()) as told:
        try:
            return dict(_flat(read()))
        except SystemExit:
            last = told.getvalue().strip().splitlines()[-1].strip()
            raise ValueError(last.removeprefix("lerobot-train: ").removeprefix("error: ")) from None


def _flat(settings: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in settings.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _clocks() -> dict[str, float]:
    return {"cpu": time.process_time(), "wall": time.perf_counter()}


@contextmanager
def _command_line(arguments: Sequence[str]) -> Iterator[None]:
    """Lets `lerobot-train` find its arguments where it reads parts of its configuration from alone.

    Meanwhile ``DECODERS`` keeps its warnings to itself.

    Draccus's errors, of which ``lerobot_gcdt.errors.OptionError`` is one, become ValueErrors: LeRobot tells those in a
    sentence that come while it reads the command line, not those that come later, from a checkpoint's or a policy.
    """
    before, sys.argv = sys.argv, ["lerobot-train", *arguments]
    level = DECODERS.level
    DECODERS.setLevel(logging.ERROR)
    try:
        yield
    except DecodingError as error:
        raise ValueError(str(error)) from error
    except ParsingError as error:  # hides what it was raised from
        raise ValueError(str(error.__cause__ or error)) from error
    finally:
        sys.argv = before
        DECODERS.setLevel(level)


def main() -> None:
    """Runs what the command line says, in one process or several, the first of which keeps other trainers out."""
    losses, stage, *arguments = sys.argv[1:]
    first = os.environ.get("RANK", "0") == "0"
    with alone_in(trainer_folder(Path(losses).parent), "--output") if first else nullcontext():
        run(arguments, Path(losses), stage)


if __name__ == "__main__":
    try:
        main()
    except ValueError as error:
        sys.exit(f"lerobot-train: {error}")
