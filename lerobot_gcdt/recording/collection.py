"""The published datasets: one a task and their merger, recorded side by side."""

import json
import multiprocessing
import os
import re
import signal
from functools import partial
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from tqdm import tqdm

import surrol_gym
from lerobot_gcdt.recording.demonstrations import check_recording, record
from lerobot_gcdt.recording.facts import RECORDING_FILE, summary
from lerobot_gcdt.recording.features import NO_EXTRAS, Extras
from lerobot_gcdt.recording.merging import merge

CROSS_TASK = "surrol_cross_task"
"""Name of the merged dataset."""

PUBLISHED_DISTURB = 0.3
"""Size of the pushes in the published datasets."""

Job = tuple[str, int, int, Path, float, Extras]
"""Arguments of ``record``."""


def dataset_name(task: str) -> str:
    """Returns the name of a task's published dataset, such as ``surrol_needle_pick`` of ``NeedlePick``."""
    return "surrol" + re.sub("([A-Z])", r"_\1", task).lower()


def record_all(
    root: str | Path,
    episodes: int = 100,
    seed: int = 0,
    disturb: float = PUBLISHED_DISTURB,
    extras: Extras = NO_EXTRAS,
    workers: int | None = None,
) -> list[Path]:
    """Records the datasets of all tasks and merges them; what is there already is kept.

    Args:
        root: Folder of the datasets; calling again goes on with what was interrupted.
        episodes: Number of successful episodes of each task.
        seed: Seed of each task's first episode.
        disturb: Size of the pushes; see ``lerobot_gcdt.recording.episodes.run_episode``.
        extras: What to record beside what every dataset holds.
        workers: Processes at a time; None for one a core.

    Returns:
        The folders of the tasks' datasets; the merged one lies beside them.

    Raises:
        ValueError: A number is out of range, a task lacks a camera, or a folder holds something else.
        OSError: Files cannot be written, or another process records there; what is finished is kept.
        RuntimeError: An expert fails again and again; what is finished is kept.
    """
    workers = os.cpu_count() or 1 if workers is None else workers
    if workers < 1:
        raise ValueError(f"Recording needs at least one worker, got {workers}.")
    jobs = _jobs(root, episodes, seed, disturb, extras)
    roots = [job[3] for job in jobs]
    with tqdm(total=len(jobs) * episodes, desc="Recording", unit="episode") as bar:
        for job in jobs:
            if job[3].exists():
                record(*job, on_episode=bar.update)
        # The last tasks have the longest episodes.
        _run([job for job in reversed(jobs) if not job[3].exists()], workers, bar)
    for folder in roots:
        print(summary(folder))
    _merge_all(roots, Path(root) / CROSS_TASK)
    return roots


def recording_units(
    root: str | Path,
    episodes: int = 100,
    seed: int = 0,
    disturb: float = PUBLISHED_DISTURB,
    extras: Extras = NO_EXTRAS,
) -> list[partial[Path]]:
    """Returns what ``record_all`` does before it merges, a unit a task, for ``lerobot_gcdt.executors.run_units``.

    Arguments and errors are those of ``record_all``; nothing is written.
    """
    jobs = _jobs(root, episodes, seed, disturb, extras)
    return [partial(record, *job) for job in reversed(jobs)]  # the last tasks have the longest episodes


def _jobs(root: str | Path, episodes: int, seed: int, disturb: float, extras: Extras) -> list[Job]:
    """The recordings of all tasks, checked before the first of them begins."""
    jobs = [(task, episodes, seed, Path(root) / dataset_name(task), disturb, extras) for task in surrol_gym.TASKS]
    for job in jobs:
        check_recording(*job)
    return jobs


def _run(jobs: list[Job], workers: int, bar: tqdm) -> None:
    """Calls ``record`` with each tuple of arguments, in a process of its own."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["lerobot_gcdt.recording"])  # the processes are forked after the slow imports
    waiting = iter(jobs)
    running: dict[Connection, BaseProcess] = {}
    try:
        while True:
            while len(running) < workers and (job := next(waiting, None)):
                receiver, sender = context.Pipe(duplex=False)
                running[receiver] = context.Process(target=_record_one, args=(sender, job), daemon=True)
                running[receiver].start()
                sender.close()  # the process has its own: when it ends, the receiver notices
            if not running:
                return
            for receiver in running.keys() & wait(running):
                _hear(receiver, running, bar)
    finally:
        for process in running.values():
            process.terminate()
        for process in running.values():
            process.join()  # until then it keeps the command from being repeated


def _hear(receiver: Connection, running: dict[Connection, BaseProcess], bar: tqdm) -> None:
    """Takes one message: None for an episode, an error, or the end of the process."""
    try:
        message = receiver.recv()
    except EOFError:
        process = running.pop(receiver)
        process.join()
        if process.exitcode:
            raise ChildProcessError(f"a worker ended with status {process.exitcode}; repeat the command") from None
        return
    if message is not None:
        raise message
    bar.update()


def _record_one(sender: Connection, job: Job) -> None:
    """Records one dataset; tells of every episode and of an error."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl+C reaches all processes; one of them speaks
    try:
        record(*job, on_episode=partial(sender.send, None))
    except BrokenPipeError:
        pass  # the command was killed and may have been started again, so nobody else may write here
    except (ValueError, OSError, RuntimeError) as error:
        sender.send(error)


def _merge_all(roots: list[Path], merged: Path) -> None:
    """Merges the datasets, or checks that the merged one is theirs."""
    if not merged.exists():
        merge(roots, merged)
        return
    note = merged / RECORDING_FILE
    sources = json.loads(note.read_text()).get("merged_from") if note.exists() else None
    if sources != [json.loads((root / RECORDING_FILE).read_text()) for root in roots]:
        raise ValueError(f"{merged} was not merged from these recordings; remove it and repeat the command.")
    print(f"{merged} is complete already.")
