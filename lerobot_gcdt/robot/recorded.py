"""What a recording tells of an episode that a simulated robot plays again."""

import json
from pathlib import Path

import numpy as np

from lerobot_gcdt.errors import OptionError
from lerobot_gcdt.keys import DISTURBANCE


def recorded_task(root: Path) -> str:
    """Returns the task of a dataset of ``gcdt record``; see ``surrol_gym.find_task``.

    Raises:
        OptionError: It is none, or does not tell the seeds of its episodes.
    """
    return _facts(root)["env_id"]


def recorded_episode(root: Path, episode: int) -> tuple[int, np.ndarray]:
    """Returns the seed of a recorded episode, and what was added to its actions, (T, A).

    Raises:
        OptionError: As ``recorded_task``, or there is no such episode.
    """
    from lerobot_gcdt.data.columns import read_columns  # slow to load, and seldom needed

    seeds = _facts(root)["seeds"]
    if episode >= len(seeds):
        raise OptionError(f"{root} holds {len(seeds)} episodes, counted from 0; there is no {episode}.")
    columns = read_columns(root, (DISTURBANCE, "episode_index"))
    return seeds[episode], columns[DISTURBANCE][columns["episode_index"] == episode]


def _facts(root: Path) -> dict:
    from lerobot_gcdt.recording.facts import RECORDING_FILE  # slow to load, and seldom needed

    note = root / RECORDING_FILE
    if not note.exists():
        raise OptionError(f"{root} is no dataset of `gcdt record`: there is no {note}.")
    facts = json.loads(note.read_text())
    if "seeds" not in facts:
        raise OptionError(f"{root} does not tell the seeds of its episodes; only recordings of one task do.")
    return facts
