"""The finished attempts of a recording that is not finished itself."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from lerobot_gcdt.locking import LOCK_FILE
from lerobot_gcdt.recording.features import to_columns
from lerobot_gcdt.recording.request import Recording

NOTE, UNFINISHED_NOTE = "recording.json", "recording.unfinished"
"""In the folder: the recording that the attempts belong to, and the name of this file while it is written."""


class Attempts:
    """Finished attempts, a file each, in a folder beside that of the dataset.

    Args:
        root: Folder of the dataset.

    Attributes:
        folder: The folder of the attempts.
    """

    def __init__(self, root: Path):
        self.folder = root.with_name(root.name + ".recording")

    def file(self, seed: int) -> Path:
        """Returns the file of the attempt from a seed, whether it is there or not."""
        return self.folder / f"{seed:09d}.npz"

    def are_ours(self) -> bool:
        """Returns whether the folder is there and ``record`` wrote it, even if that was killed at once."""
        if not self.folder.exists():
            return False
        files = {file.name for file in self.folder.iterdir()}
        return NOTE in files or files <= {LOCK_FILE, UNFINISHED_NOTE}

    def check(self) -> None:
        """Raises ValueError if something else has the folder's name."""
        if self.folder.exists() and not self.are_ours():
            raise ValueError(f"{self.folder} exists and was not written by `gcdt record`; choose another --root.")

    def claim(self, wanted: Recording) -> None:
        """Notes the recording in the folder, which exists, and checks that the attempts there belong to it.

        An attempt does not depend on how many episodes there are, so this number may differ from that of an earlier
        call.

        Raises:
            ValueError: They belong to another recording, or more of them succeeded than are wanted.
        """
        note = self.folder / NOTE
        if note.exists():
            replace(wanted, episodes=json.loads(note.read_text())["episodes"]).check_same(note, self.folder)
            kept = sum(map(succeeded, self.folder.glob("*.npz")))
            if wanted.episodes < kept:
                raise ValueError(
                    f"{self.folder} holds {kept} finished episodes, more than {wanted.episodes}; ask for at least as "
                    "many, or choose another --root."
                )
        (self.folder / UNFINISHED_NOTE).write_text(json.dumps(wanted.facts()))
        os.replace(self.folder / UNFINISHED_NOTE, note)

    def remove(self) -> None:
        """Empties the folder, the note that tells it from any other folder last."""
        for file in self.folder.iterdir():
            if file.is_dir():
                shutil.rmtree(file)
            elif file.name not in (NOTE, LOCK_FILE):
                file.unlink()
        (self.folder / NOTE).unlink(missing_ok=True)


def succeeded(file: Path) -> bool:
    """Returns whether a finished attempt ended in success."""
    with np.load(file) as episode:
        return bool(episode["success"].any())


def read_columns(file: Path) -> dict[str, np.ndarray]:
    """Reads a finished attempt that succeeded, as the columns of a dataset (``to_columns``)."""
    with np.load(file) as episode:
        return to_columns(dict(episode))
