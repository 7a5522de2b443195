"""A note of the data that are learned from, so that others under the same name are noticed."""

import hashlib
import json
from pathlib import Path

DATASETS_FILE = "datasets.json"
"""In the output folder of a training or a benchmark: the fingerprint of each dataset, by its name."""


def fingerprint(dataset: Path) -> str | None:
    """Returns what tells the data in a folder from others: a digest of LeRobot's statistics of them, None without."""
    statistics = dataset / "meta/stats.json"
    return hashlib.sha256(statistics.read_bytes()).hexdigest() if statistics.exists() else None


def noted_datasets(output: Path) -> dict[str, str | None]:
    """Returns the note in an output folder, empty where there is none."""
    file = output / DATASETS_FILE
    return json.loads(file.read_text()) if file.exists() else {}


def note_datasets(output: Path, datasets: dict[str, str | None]) -> None:
    """Adds datasets to the note in an output folder."""
    before = noted_datasets(output)
    if (noted := before | datasets) != before:  # benchmarks may run side by side
        output.mkdir(parents=True, exist_ok=True)
        (output / DATASETS_FILE).write_text(json.dumps(noted, indent=2) + "\n")
