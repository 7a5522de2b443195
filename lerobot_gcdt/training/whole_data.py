"""Is a dataset whole?"""

import json
from collections.abc import Iterable
from pathlib import Path

import pyarrow.parquet as pq
from lerobot.datasets.dataset_metadata import CODEBASE_VERSION

INFO_FILE = "meta/info.json"
LEROBOTS_FILES = (INFO_FILE, "meta/stats.json", "meta/tasks.parquet")


def check_whole(root: Path) -> None:
    """Raises ValueError, with the name of what is wrong, unless a dataset is whole; frames and films are not read."""
    check_files(root, LEROBOTS_FILES)
    info = read_json(root / INFO_FILE)
    if info.get("codebase_version") != CODEBASE_VERSION:
        raise ValueError(f"{root} has LeRobot's format {info.get('codebase_version')}, not {CODEBASE_VERSION}.")
    for what, folder in (("total_frames", "data"), ("total_episodes", "meta/episodes")):
        rows = sum(_rows(file) for file in sorted((root / folder).rglob("*.parquet")))
        if rows != info.get(what):
            raise ValueError(
                f"{root / folder} holds {rows} rows, but {INFO_FILE} says {what} = {info.get(what)}; copy all of it."
            )


def check_files(folder: Path, names: Iterable[str]) -> None:
    """Raises ValueError, with the names of those that are missing, unless files lie in a folder."""
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise ValueError(f"{folder} lacks {', '.join(missing)}.")


def read_json(file: Path) -> dict:
    """Reads a JSON file; raises ValueError, with its name, if it is none."""
    try:
        return json.loads(file.read_text())
    except ValueError as error:
        raise ValueError(f"{file} is not JSON: {error}") from error


def _rows(file: Path) -> int:
    try:
        return pq.read_metadata(file).num_rows  # in the file's last bytes, which a truncated one lacks
    except (ValueError, OSError) as error:
        raise ValueError(f"{file} cannot be read: {error}") from error
