"""One process at a time at a piece of work."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

LOCK_FILE = "lock"
"""In the folder. Whether it is locked is known to the operating system alone, so a killed process leaves no lock."""


@contextmanager
def alone_in(folder: Path, option: str = "--root") -> Iterator[None]:
    """Keeps other processes out of a folder until the end of the block.

    Args:
        folder: The folder. It is made where it does not exist, and removed in the end if it holds nothing.
        option: Option of the commands that names another folder.

    Raises:
        OSError: Another process is at work there, or the folder cannot be made.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / LOCK_FILE)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise OSError(
            f"another `gcdt` command is at work in {folder}; wait for its end, or choose another {option}"
        ) from None
    try:
        yield
    finally:
        # Before the release: whoever waits for the removed file's lock notices, and makes another.
        with suppress(OSError):
            if [file.name for file in folder.iterdir()] == [LOCK_FILE]:
                (folder / LOCK_FILE).unlink()
                folder.rmdir()
        lock.release()
