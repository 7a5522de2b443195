"""Recording expert demonstrations as LeRobot datasets, resumable at any moment.

Every finished episode is first kept in a file of its own beside the dataset's folder. The dataset is built from these
files when all are there, and takes its name only when it is whole. So an interrupted recording goes on where it was,
and ends with the same dataset as one that was never interrupted.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

import surrol_gym
from lerobot_gcdt.keys import TIME_TO_GOAL
from lerobot_gcdt.locking import alone_in
from lerobot_gcdt.recording.attempts import Attempts, read_columns, succeeded
from lerobot_gcdt.recording.episodes import PUSH_RATE, run_episode
from lerobot_gcdt.recording.facts import RECORDING_FILE, summary
from lerobot_gcdt.recording.features import NO_EXTRAS, Extras
from lerobot_gcdt.recording.learners import Learner
from lerobot_gcdt.recording.persons import Person
from lerobot_gcdt.recording.request import Recording
from lerobot_gcdt.recording.writing import build_dataset
from surrol_gym.by_hand import Stop
from surrol_gym.envs.psm_env import unwrapped
from surrol_gym.registry import env_class, find_law
from surrol_gym.wrappers import ImperfectSensors, complete_sensors

FAILURES_IN_A_ROW = 50
"""Failed attempts after which a recording ends. Even an expert that succeeds in one of five attempts begins such a
series but once in 70,000; a worse one is broken."""


def record(
    task: str,
    episodes: int,
    seed: int,
    root: str | Path,
    disturb: float = 0.0,
    extras: Extras = NO_EXTRAS,
    on_episode: Callable[[], None] | None = None,
    learner: Learner | None = None,
    person: Person | None = None,
    sensors: Mapping[str, Any] | None = None,
) -> Path:
    """Records successful episodes of a task as a LeRobot dataset: the expert's, those that it saves, or a person's.

    Args:
        task: Name of the task; see ``surrol_gym.find_task``.
        episodes: Number of successful episodes.
        seed: Seed of the first episode.
        root: Folder of the dataset; calling again with the same arguments goes on with an interrupted recording. The
            number of episodes may then be another one, from that of the finished ones on.
        disturb: Size of the pushes that divert the arm, in [0, 1]; see ``run_episode``.
        extras: What to record beside what every dataset holds.
        on_episode: Called for every episode that is there; nothing is printed then.
        learner: A policy that acts in the expert's place; None where the expert always acts.
        person: Somebody who acts instead of the expert, in a window; their episodes have their own lengths.
        sensors: Arguments of ``surrol_gym.wrappers.ImperfectSensors``, through which observations and achieved goals
            are recorded, while the expert acts by the truth; None for perfect ones.

    Returns:
        The folder.

    Raises:
        ValueError: The task is unknown or has no expert, a number or a sensor is out of range, or the folder holds
            something else.
        OSError: The disk is full, something else keeps files from being written, or another process records there;
            what is finished is kept.
        RuntimeError: The expert fails again and again, or the person stops; what is finished is kept.
    """
    root = Path(root)
    wanted = check_recording(task, episodes, seed, root, disturb, extras, learner, person, sensors)
    attempts = Attempts(root)
    if root.exists():
        if attempts.are_ours():
            with alone_in(attempts.folder):
                attempts.remove()  # what an earlier call, interrupted at its very end, left
        if on_episode:
            for _ in range(episodes):
                on_episode()
        else:
            print(f"{root} is complete already.")
    else:
        with alone_in(attempts.folder):
            if root.exists():  # another process has finished it just now
                wanted.check_same(root / RECORDING_FILE, root)
            else:
                _make(wanted, attempts, root, on_episode, learner, person)
            attempts.remove()
    if not on_episode:
        print(summary(root))
    return root


def check_recording(
    task: str,
    episodes: int,
    seed: int,
    root: str | Path,
    disturb: float = 0.0,
    extras: Extras = NO_EXTRAS,
    learner: Learner | None = None,
    person: Person | None = None,
    sensors: Mapping[str, Any] | None = None,
) -> Recording:
    """Checks what is asked of ``record``, and writes nothing.

    Returns:
        The recording that it would make.

    Raises:
        ValueError: As ``record`` does.
    """
    env_id = surrol_gym.find_task(task)
    if episodes < 1 or seed < 0:
        raise ValueError(f"A recording needs at least one episode and a seed from 0, got {episodes} and {seed}.")
    if not 0 <= disturb <= 1:
        raise ValueError(f"The size of disturbances must lie in [0, 1], got {disturb}.")
    if not person and not find_law(env_class(env_id)):
        raise ValueError(f"{env_id} has no scripted expert; register it with one, or act yourself with --teleop.")
    wanted = Recording(env_id, episodes, seed, float(disturb), extras, version("lerobot_policy_gcdt"))
    if disturb:
        wanted = replace(wanted, push_rate=PUSH_RATE)
    if learner:
        wanted = replace(wanted, policy=learner.name, mix=float(learner.mix))
    if person:
        wanted = replace(wanted, human=person.name)
    if sensors:
        wanted = replace(wanted, sensors=complete_sensors(sensors))
    extras.check(wanted.env_id)
    root = Path(root)
    if root.exists():
        wanted.check_same(root / RECORDING_FILE, root)
    else:
        Attempts(root).check()
    return wanted


def _make(
    wanted: Recording,
    attempts: Attempts,
    root: Path,
    on_episode: Callable[[], None] | None,
    learner: Learner | None,
    person: Person | None,
) -> None:
    """Records what is missing among the finished attempts, and builds the dataset."""
    attempts.claim(wanted)
    env = gym.make(wanted.env_id, render_mode="human" if person and person.window else None)
    if wanted.sensors:
        env = ImperfectSensors(env, **wanted.sensors)
    try:
        kept = _record_episodes(env, wanted, attempts, on_episode, learner, person)
        facts = wanted.facts() | {
            "seeds": [int(file.stem) for file in kept],
            "attempts": int(kept[-1].stem) - wanted.seed + 1,
        }
        if person:
            facts["frames"] = sum(len(read_columns(file)[TIME_TO_GOAL]) for file in kept)
        shown = tqdm(kept, desc="Writing the dataset", unit="episode", disable=on_episode is not None)
        build_dataset(env, wanted.extras, map(read_columns, shown), facts, attempts.folder / "dataset", root)
    except OSError as error:
        told = f"{error.strerror or error}; finished episodes are kept, repeat the command to go on"
        raise OSError(error.errno, told, str(attempts.folder)) from error
    finally:
        env.close()


def _record_episodes(
    env: gym.Env,
    wanted: Recording,
    attempts: Attempts,
    on_episode: Callable[[], None] | None,
    learner: Learner | None,
    person: Person | None,
) -> list[Path]:
    """Records attempts until enough succeeded; returns the files of the successful ones, in order of their seeds."""
    kept: list[Path] = []
    name = f"Recording {unwrapped(env).task}"
    with tqdm(total=wanted.episodes, desc=name, unit="episode", disable=on_episode is not None) as bar:
        on_episode = on_episode or bar.update
        seed, failures = wanted.seed, 0
        while len(kept) < wanted.episodes:
            file = attempts.file(seed)
            if not file.exists():
                unfinished = file.with_suffix(".unfinished")
                with unfinished.open("wb") as stream:
                    try:
                        episode = (
                            person.run_episode(env, seed, wanted.extras)
                            if person
                            else run_episode(env, seed, wanted.disturb, wanted.extras, learner)
                        )
                    except Stop:
                        raise RuntimeError(
                            f"Stopped. The {len(kept)} episodes of {wanted.episodes} that are finished are kept in "
                            f"{attempts.folder}; the same command goes on with seed {seed}"
                            + (f", and with --episodes {len(kept)} it ends with these." if kept else ".")
                        ) from None
                    np.savez_compressed(stream, **episode)  # type: ignore[arg-type]  # none is called allow_pickle
                os.replace(unfinished, file)
            if succeeded(file):
                kept.append(file)
                on_episode()
                failures = 0
            else:
                failures += 1
            if failures == FAILURES_IN_A_ROW:
                raise RuntimeError(
                    f"{'A policy and the' if learner else 'The'} expert of {wanted.env_id} failed {failures} times in "
                    f"a row, the last time with seed {seed}; the {len(kept)} successful episodes are kept in "
                    f"{attempts.folder}. "
                    + (f"Ask for these with --episodes {len(kept)}, or start" if kept else "Start")
                    + " from another seed in another folder."
                )
            seed += 1
    return kept
