"""The manifest of the published datasets: what every episode holds, byte for byte, and what the cards have to know."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from lerobot_gcdt.data.columns import read_columns
from lerobot_gcdt.keys import ACHIEVED_GOAL, ACTION, DISTURBANCE, GOAL, REWARD, STATE, SUCCESS, TIME_TO_GOAL
from lerobot_gcdt.recording.facts import RECORDING_FILE, card_facts

MANIFEST = Path(__file__).parents[2] / "dataset_cards/manifest.json"
"""The committed one; an installed wheel has none."""

HASHED = (STATE, GOAL, ACHIEVED_GOAL, TIME_TO_GOAL, ACTION, DISTURBANCE, REWARD, SUCCESS)
"""The columns that a hash covers, in this order."""


def episode_hash(columns: dict[str, np.ndarray]) -> str:
    """Computes the SHA-256 of an episode's numbers: float32, little-endian, and a byte for each truth value.

    Args:
        columns: Arrays over the steps, as ``lerobot_gcdt.recording.features.to_columns`` gives them.

    Returns:
        The hash, in hexadecimal digits.
    """
    digest = hashlib.sha256()
    for key in HASHED:
        digest.update(columns[key].astype("u1" if key == SUCCESS else "<f4").tobytes())
    return digest.hexdigest()


def episode_hashes(root: str | Path) -> list[str]:
    """Computes the hash of each episode of a dataset of ``gcdt record``, from its data files alone."""
    columns = read_columns(root, (*HASHED, "episode_index"))
    bounds = np.flatnonzero(np.diff(columns.pop("episode_index"))) + 1
    episodes = zip(*(np.split(column, bounds) for column in columns.values()), strict=True)
    return [episode_hash(dict(zip(HASHED, episode, strict=True))) for episode in episodes]


def write_manifest(roots: Iterable[Path], manifest: Path = MANIFEST) -> None:
    """Writes the manifest of datasets of ``gcdt record``."""
    entries = {}
    for root in roots:
        seeds = json.loads((root / RECORDING_FILE).read_text())["seeds"]
        entries[root.name] = card_facts(root) | {"sha256_by_seed": dict(zip(seeds, episode_hashes(root), strict=True))}
    manifest.write_text(json.dumps(entries, indent=1) + "\n")


def differing_episodes(root: Path, manifest: Path = MANIFEST) -> list[int] | None:
    """Compares a dataset with the manifest's entry of the same name.

    Args:
        root: Folder of the dataset, which may be the beginning of the published one.
        manifest: File of the manifest.

    Returns:
        The episodes that the manifest has not, or holds otherwise; None where the dataset is not a recording of what
        the manifest holds.
    """
    expected = json.loads(manifest.read_text()).get(root.name, {"episodes": 0})
    facts = json.loads((root / RECORDING_FILE).read_text())
    same = all(facts[key] == expected.get(key) for key in ("env_id", "seed", "disturb"))
    if not same or facts["episodes"] > expected["episodes"]:
        return None
    made = list(zip(map(str, facts["seeds"]), episode_hashes(root), strict=True))
    published = list(expected["sha256_by_seed"].items())[: len(made)]
    return [i for i, (mine, theirs) in enumerate(zip(made, published, strict=True)) if mine != theirs]
