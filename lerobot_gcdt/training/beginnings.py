"""A note of the stage and the weights that a training was begun with, so that others in its folder are noticed."""

import hashlib
import json
from pathlib import Path
from typing import TypedDict

from huggingface_hub.constants import SAFETENSORS_SINGLE_FILE

BEGINNING_FILE = "beginning.json"
"""In the output folder of a training."""


class Beginning(TypedDict):
    """What a training was begun with: its stage, and a digest of the weights, None where these were random."""

    stage: str
    weights: str | None


def beginning(stage: str, start: str | Path | None) -> Beginning:
    """Returns what a stage begins with that starts from the checkpoint in a folder, or from none."""
    weights = Path(start) / SAFETENSORS_SINGLE_FILE if start else None
    if weights is None or not weights.exists():
        return {"stage": stage, "weights": None}
    with weights.open("rb") as stream:
        return {"stage": stage, "weights": hashlib.file_digest(stream, "sha256").hexdigest()}


def note_beginning(output: Path, begun: Beginning) -> None:
    """Writes the note in the output folder of a training."""
    (output / BEGINNING_FILE).write_text(json.dumps(begun, indent=2) + "\n")


def check_same_beginning(output: Path, stage: str, start: Path | None) -> None:
    """Raises ValueError if the training in a folder was begun with another stage or other weights, as far as noted."""
    file = output / BEGINNING_FILE
    if not file.exists():
        return  # of an earlier version, or of lerobot-train alone
    begun: Beginning = json.loads(file.read_text())
    if begun["stage"] != stage:
        raise ValueError(
            f"The training in {output} was begun with --stage {begun['stage']} (not {stage}); choose another --output."
        )
    if begun != beginning(stage, start):
        raise ValueError(
            f"The training in {output} was begun with other weights than those in {start}; choose another --output."
        )
