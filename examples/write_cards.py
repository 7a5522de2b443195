"""Writes the cards of the published datasets and their index into dataset_cards/.

    python examples/write_cards.py

Needs no dataset: what the cards have to know is in dataset_cards/manifest.json, which
`gcdt record --all --root datasets --write_manifest` writes; the rest is in the docstrings of the environments.
"""

import argparse
import json
from pathlib import Path

from lerobot_gcdt.hub.card_tables import table
from lerobot_gcdt.hub.cards import card, steps_to_success, success_rate
from lerobot_gcdt.recording.collection import CROSS_TASK
from lerobot_gcdt.recording.facts import frames_of, recordings
from lerobot_gcdt.recording.manifest import MANIFEST

CARDS = Path(__file__).parent.parent / "dataset_cards"
PICTURES = "../examples/tasks"

INDEX = """\
# Dataset cards

One card a dataset: what every number means, how it was made, how often the expert succeeded, statistics, limits. The
datasets themselves are not in the repository: `gcdt record --all --root datasets` makes them and compares every episode
with `manifest.json`, byte for byte.

{cards}

The cards are written by `python examples/write_cards.py`, from `manifest.json` and the docstrings of the
environments; a test fails where they differ. After a change of an environment or an expert, `gcdt record --all --root
datasets --write_manifest` writes the manifest anew. `gcdt publish` writes the card of any dataset from its own files.
"""


def cards() -> dict[str, str]:
    """Returns the text of every file by its name."""
    manifest = json.loads(MANIFEST.read_text())
    facts = manifest | {CROSS_TASK: {"merged_from": list(manifest.values())}}
    texts = {f"{name}.md": card(of, f"user/{name}", PICTURES) for name, of in facts.items()}
    return texts | {"README.md": INDEX.format(cards=_index(facts))}


def _index(facts: dict[str, dict]) -> str:
    rows = []
    for name, of in facts.items():
        parts = recordings(of)
        row = [f"[{name}]({name}.md)", f"{sum(part['episodes'] for part in parts):,}"]
        row.append(f"{sum(map(frames_of, parts)):,}")
        rows.append([*row, success_rate(of), steps_to_success(of)] if len(parts) == 1 else [*row, "all of the above"])
    return table(["card", "episodes", "frames", "successful attempts", "steps to the first success"], rows)


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    for name, text in cards().items():
        (CARDS / name).write_text(text)
        print(f"{CARDS.name}/{name}")


if __name__ == "__main__":
    main()
