"""What a dataset's ``meta/surrol.json`` tells of how it was made, for its card and for the manifest."""

import json
from pathlib import Path

import numpy as np
from lerobot.utils.constants import DEFAULT_FEATURES

from surrol_gym.registry import NAMESPACE, task_name, task_spec

RECORDING_FILE = "meta/surrol.json"
"""Beside LeRobot's metadata: what it takes to replay any episode, and how the expert did."""


def card_facts(root: Path) -> dict:
    """Reads what the card of a dataset has to know.

    Args:
        root: Folder of the dataset.

    Returns:
        Of a recording its settings, attempts, steps to success, and ``statistics`` of each column, of an import also
        the files, ``imported_from``; of a merged dataset ``merged_from``, a list of the same of each of its parts,
        without statistics.
    """
    facts = json.loads((root / RECORDING_FILE).read_text())
    if "merged_from" in facts:
        return {"merged_from": [_summarised(part) for part in recordings(facts)]}
    statistics = {
        key: {name: [round(number, 3) + 0.0 for number in values[name]] for name in ("min", "mean", "max")}
        for key, values in json.loads((root / "meta/stats.json").read_text()).items()
        if key not in DEFAULT_FEATURES and not key.startswith("observation.images.")
    }
    return _summarised(facts) | {"statistics": statistics}


def recordings(facts: dict) -> list[dict]:
    """Returns the facts of each recording that a dataset was merged from, or those of a recording itself."""
    return [part for whole in facts["merged_from"] for part in recordings(whole)] if "merged_from" in facts else [facts]


def summary(root: str | Path) -> str:
    """Describes a recorded dataset: the expert's success rate and its steps to success."""
    facts = json.loads((Path(root) / RECORDING_FILE).read_text())
    steps = np.array(facts["steps_to_success"])
    who = "a person" if "human" in facts else "a policy and the expert" if "policy" in facts else "the expert"
    return (
        f"{facts['env_id']}: {len(steps)} episodes from {facts['attempts']} attempts of {who} "
        f"(success rate {len(steps) / facts['attempts']:.3f}), first success after {steps.mean():.1f} steps "
        f"({steps.min()}-{steps.max()})"
    )


def is_imported(facts: dict) -> bool:
    """Whether the episodes come from files instead of an expert."""
    return "imported_from" in facts


def is_human(facts: dict) -> bool:
    """Whether a person acted instead of an expert."""
    return "human" in facts


def task_of(facts: dict) -> str:
    """Returns the name of the task of a recording."""
    return task_name(facts["env_id"])


def task_named(facts: dict) -> str:
    """Returns how a command names the task of a recording, with the module that registers it where that is known."""
    return facts["env_id"].replace(NAMESPACE, "").rpartition("-v")[0]


def frames_of(facts: dict) -> int:
    """Returns the number of frames of a dataset; what experts recorded runs to the time limit."""
    return facts.get("frames") or facts["episodes"] * task_spec(facts["env_id"]).max_episode_steps


def _summarised(facts: dict) -> dict:
    """The facts of a recording with a summary of its episodes instead of lists."""
    steps = np.array(facts["steps_to_success"])
    summary = {"min": int(steps.min()), "mean": round(float(steps.mean()), 1), "max": int(steps.max())}
    return {key: value for key, value in facts.items() if key != "seeds"} | {"steps_to_success": summary}
