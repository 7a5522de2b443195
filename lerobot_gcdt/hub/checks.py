"""Is a folder fit to be published? Whole, readable, made by this package, with a card that others can find."""

from dataclasses import fields
from pathlib import Path

import yaml
from huggingface_hub import DatasetCard, ModelCard
from safetensors import SafetensorError, safe_open

from lerobot_gcdt.hub.model_card import find_policy
from lerobot_gcdt.recording.facts import RECORDING_FILE
from lerobot_gcdt.training.whole_data import LEROBOTS_FILES, check_files, check_whole, read_json
from surrol_gym import find_task

DATASET_FILES = (*LEROBOTS_FILES, RECORDING_FILE)
PROCESSOR_FILES = ("policy_preprocessor.json", "policy_postprocessor.json")
CHECKPOINT_FILES = ("config.json", "model.safetensors", *PROCESSOR_FILES, "train_config.json")

REQUIRED_METADATA = {
    "dataset": {"license": "", "tags": "LeRobot", "task_categories": "robotics"},
    "model": {"license": "", "library_name": "lerobot", "pipeline_tag": "robotics"},
}
"""What a card must say, by kind of repository: any licence, and the words by which others find it."""


def check_dataset(root: Path) -> None:
    """Raises ValueError unless a dataset is whole and was recorded in an environment of this package."""
    check_files(root, DATASET_FILES)
    check_whole(root)
    for env_id in _environments(read_json(root / RECORDING_FILE)):
        try:
            find_task(env_id)
        except ValueError as error:
            raise ValueError(f"{root / RECORDING_FILE}: {error}") from None


def check_checkpoint(folder: Path) -> None:
    """Raises ValueError unless a checkpoint is whole, readable and of a policy that can be described."""
    check_files(folder, CHECKPOINT_FILES)
    steps = [step for name in PROCESSOR_FILES for step in read_json(folder / name)["steps"]]
    check_files(folder, [step["state_file"] for step in steps if "state_file" in step])
    for file in sorted(folder.glob("*.safetensors")):
        try:
            with safe_open(file, "np"):
                pass
        except SafetensorError as error:
            raise ValueError(f"{file} is truncated or no safetensors file: {error}") from error
    kind = read_json(folder / "config.json")["type"]
    if "task_dims" not in {field.name for field in fields(find_policy(kind).config_class)}:
        raise ValueError(
            f"{folder} is a policy of type {kind}, which does not tell what tasks it knows (task_dims in its "
            "configuration): LeRobot can publish it."
        )


def check_card(card: str, kind: str) -> None:
    """Raises ValueError unless a card says what REQUIRED_METADATA asks for."""
    try:
        data = (DatasetCard if kind == "dataset" else ModelCard)(card).data.to_dict()
    except yaml.YAMLError as error:
        raise ValueError(f"The front matter of the card (README.md) is no YAML: {one_line(error)}") from error
    for name, wanted in REQUIRED_METADATA[kind].items():
        if wanted not in (data.get(name) or []):
            raise ValueError(f"The card (README.md) lacks {name}{f': {wanted}' if wanted else ''} in its front matter.")


def one_line(error: Exception) -> str:
    """The message of an error, on one line."""
    return " ".join(str(error).split()) or type(error).__name__


def _environments(facts: dict) -> list[str]:
    """The environments that a dataset's recordings were made in."""
    if "merged_from" in facts:
        return [env_id for part in facts["merged_from"] for env_id in _environments(part)]
    return [facts["env_id"]]
