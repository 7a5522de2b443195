"""Publishing datasets and policies on the Hugging Face Hub.

A folder is checked before anything is sent. Data and card then go up in one commit, so that a repository never holds
half of them, and repeating the command sends what is missing.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import httpx
from huggingface_hub import CommitOperationAdd, CommitOperationDelete, HfApi
from huggingface_hub.errors import HfHubHTTPError, LocalTokenNotFoundError, RepositoryNotFoundError
from huggingface_hub.utils import validate_repo_id
from lerobot.datasets.dataset_metadata import CODEBASE_VERSION

from lerobot_gcdt.averaging import acting_weights
from lerobot_gcdt.evaluation.pictures import halfway
from lerobot_gcdt.hub.cards import PICTURES, dataset_card
from lerobot_gcdt.hub.checks import (
    CHECKPOINT_FILES,
    check_card,
    check_checkpoint,
    check_dataset,
    one_line,
)
from lerobot_gcdt.hub.model_card import model_card
from lerobot_gcdt.recording.facts import card_facts, recordings, task_of
from lerobot_gcdt.training import checkpoint
from lerobot_gcdt.training.whole_data import INFO_FILE, read_json

WEIGHTS = "model.safetensors"
SENT = (".json", ".md", ".mp4", ".parquet", ".png", ".safetensors")
"""Kinds of files that are published. Whatever else lies in a folder stays there."""

TAG = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
"""What a tag looks like; Git allows more, such as slashes, but all of this."""

OWNED = ("data/", "meta/", "videos/")
"""Folders of a dataset. What was published there and is there no longer is removed: LeRobot reads all that it finds."""


@dataclass(frozen=True)
class Parcel:
    """What is sent.

    Attributes:
        kind: Kind of repository, ``"dataset"`` or ``"model"``.
        folder: Where the files are.
        files: Paths of those that are sent as they are, the same in the repository.
        card: Text of the card.
        made: What is not, or not so, in the folder, by its path in the repository: the pictures that the card shows,
            and weights without those at rest (``lerobot_gcdt.averaging``).
    """

    kind: str
    folder: Path
    files: list[str]
    card: str
    made: dict[str, bytes] = field(default_factory=dict)


def publish(
    folder: str | Path, repo_id: str, private: bool = False, revision_tag: str | None = None, dry_run: bool = False
) -> None:
    """Publishes a dataset or a checkpoint with its card; the local files are only read.

    Args:
        folder: A dataset of ``gcdt record`` or ``gcdt merge``, a checkpoint's ``pretrained_model``, or the output
            folder of a training, whose last checkpoint is meant. Its own README.md, if it has one, is the card.
        repo_id: Name of the repository, ``user/name``; it is made if need be.
        private: Whether a new repository is private.
        revision_tag: Name that the published state keeps for ever, such as ``v1.0``.
        dry_run: Whether to only print what would be sent. Needs no token.

    Raises:
        ValueError: The folder is not whole, the card lacks something, or the repository holds something else.
        OSError: The Hub refuses the token or the upload, or is out of reach.
    """
    if repo_id.count("/") != 1:
        raise ValueError(f"{repo_id!r} is no name of a repository; it looks like user/name.")
    validate_repo_id(repo_id)
    if revision_tag and (
        not TAG.fullmatch(revision_tag) or ".." in revision_tag or revision_tag.endswith((".", ".lock"))
    ):
        raise ValueError(f"{revision_tag!r} is no name of a tag: letters, digits and single ., - and _, such as v1.0.")
    parcel = pack(Path(folder), repo_id)
    if dry_run:
        print(_describe(parcel, repo_id, private, revision_tag))
        return
    with _explained(repo_id, parcel.folder):
        print(f"Published: {_send(parcel, repo_id, private, revision_tag)}")


def pack(folder: Path, repo_id: str) -> Parcel:
    """Checks a folder and writes its card.

    Args:
        folder: See ``publish``.
        repo_id: Repository that the card names.

    Returns:
        What is to be sent.

    Raises:
        ValueError: The folder is not whole, is neither a dataset nor a checkpoint, or its card lacks something.
    """
    model = checkpoint(folder)
    if (folder / "meta").is_dir():
        kind, model = "dataset", folder
        check_dataset(folder)
    elif any((model / name).exists() for name in CHECKPOINT_FILES):
        kind = "model"
        check_checkpoint(model)
    else:
        raise ValueError(
            f"{folder} is neither a dataset of `gcdt record` (a folder with {INFO_FILE}) nor a checkpoint of "
            "lerobot-train (its output folder, or a pretrained_model in it)."
        )
    paths = (path.relative_to(model) for path in model.rglob("*") if path.suffix in SENT and path.is_file())
    files = sorted(str(path) for path in paths if not any(part.startswith(".") for part in path.parts))
    own = model / "README.md"
    if own.exists():
        files.remove(own.name)
        card = own.read_text()
    else:
        card = dataset_card(model, repo_id) if kind == "dataset" else model_card(model, repo_id)
    check_card(card, kind)
    made = {}
    if kind == "model" and (acting := acting_weights(model / WEIGHTS)):
        made = {WEIGHTS: acting}
    elif kind == "dataset" and not own.exists():
        made = _pictures(model)
    return Parcel(kind, model, [file for file in files if file not in made], card, made)


def _pictures(root: Path) -> dict[str, bytes]:
    """Draws the pictures that the card of a dataset shows; the same ones each time."""
    pictures = {}
    for task in map(task_of, recordings(card_facts(root))):
        halfway(task).save(file := BytesIO(), "png", optimize=True)
        pictures[f"{PICTURES}/{task}.png"] = file.getvalue()
    return pictures


def _send(parcel: Parcel, repo_id: str, private: bool, revision_tag: str | None) -> str:
    """Sends everything in one commit and tags it; returns the address of the repository."""
    api = HfApi()
    api.whoami()  # first: to a client without a good token, a private repository looks like a missing one
    try:
        present = api.repo_info(repo_id, repo_type=parcel.kind)
    except RepositoryNotFoundError:
        present = None
    # Of a model or a dataset the files are always told.
    published = {file.rfilename for file in present.siblings} if present else set()  # type: ignore[union-attr]
    if present and private and not present.private:
        raise ValueError(f"{repo_id} exists and is public; make it private in its settings, or leave out --private.")
    if parcel.kind == "dataset" and INFO_FILE in published:
        remote = api.hf_hub_download(repo_id, INFO_FILE, repo_type="dataset")
        _check_same_features(read_json(parcel.folder / INFO_FILE), read_json(Path(remote)), repo_id)
    if not present:
        api.create_repo(repo_id, repo_type=parcel.kind, private=private or None, exist_ok=True)
    stale = {file for file in published if parcel.kind == "dataset" and file.startswith(OWNED)} - set(parcel.files)
    commit = api.create_commit(
        repo_id,
        [
            CommitOperationAdd("README.md", parcel.card.encode()),
            *(CommitOperationAdd(path, content) for path, content in parcel.made.items()),
            *(CommitOperationAdd(file, parcel.folder / file) for file in parcel.files),
            *(CommitOperationDelete(file) for file in sorted(stale)),
        ],
        commit_message=f"Publish the {parcel.kind} and its card",
        repo_type=parcel.kind,
    )
    tags = {tag.name: tag.target_commit for tag in api.list_repo_refs(repo_id, repo_type=parcel.kind).tags}
    if parcel.kind == "dataset" and tags.get(CODEBASE_VERSION) != commit.oid:
        # LeRobot loads what this tag points to, so it moves with every upload.
        if CODEBASE_VERSION in tags:
            api.delete_tag(repo_id, tag=CODEBASE_VERSION, repo_type="dataset")
        api.create_tag(repo_id, tag=CODEBASE_VERSION, revision=commit.oid, repo_type="dataset")
    if revision_tag and tags.get(revision_tag) != commit.oid:
        if revision_tag in tags:
            raise ValueError(
                f"{repo_id} is up to date, but its tag {revision_tag} stays at an earlier state; choose another tag."
            )
        api.create_tag(repo_id, tag=revision_tag, revision=commit.oid, repo_type=parcel.kind)
    return str(commit.repo_url)


@contextmanager
def _explained(repo_id: str, folder: Path) -> Iterator[None]:
    """Turns the client's errors into one line that says what to do."""
    log_in = "log in with `hf auth login`, or set HF_TOKEN to a token that may write"
    try:
        yield
    except LocalTokenNotFoundError as error:
        raise OSError(f"There is no token for the Hub: {log_in} to {repo_id}.") from error
    except HfHubHTTPError as error:
        status = error.response.status_code
        if status in (401, 403):
            raise OSError(f"The Hub refuses the token ({status}): {log_in} to {repo_id}.") from error
        raise OSError(_failure(repo_id, folder, f"the Hub answered {status}: {error.server_message}")) from error
    except (httpx.HTTPError, OSError, RuntimeError) as error:  # the last one is what a large file ends with
        raise OSError(_failure(repo_id, folder, one_line(error))) from error
    except ValueError as error:
        raise ValueError(one_line(error)) from error


def _failure(repo_id: str, folder: Path, reason: str) -> str:
    reason = reason.rstrip(".")
    return f"Publishing {repo_id} failed: {reason}. {folder} is untouched; repeat the command to go on."


def _describe(parcel: Parcel, repo_id: str, private: bool, revision_tag: str | None) -> str:
    tags = [*([CODEBASE_VERSION] if parcel.kind == "dataset" else []), *([revision_tag] if revision_tag else [])]
    tagged = f", tagged {', '.join(tags)}" if tags else ""
    sizes = {"README.md": len(parcel.card.encode())}
    sizes |= {path: len(content) for path, content in parcel.made.items()}
    sizes |= {file: (parcel.folder / file).stat().st_size for file in parcel.files}
    return "\n".join(
        [
            f"{repo_id}: a {'private' if private else 'public'} {parcel.kind}{tagged}",
            *(f"{size:>12,} bytes  {file}" for file, size in sizes.items()),
            f"{sum(sizes.values()):>12,} bytes  in all. The card begins:",
            *parcel.card.splitlines()[:25],
        ]
    )


def _check_same_features(mine: dict, theirs: dict, repo_id: str) -> None:
    mine, theirs = mine["features"], theirs["features"]
    differing = sorted(key for key in mine.keys() | theirs.keys() if mine.get(key) != theirs.get(key))
    if differing:
        raise ValueError(f"{repo_id} exists with other features: {', '.join(differing)} differ. Choose another name.")
